//! Packed files: gzip, Zstandard and xz, by their first bytes.
//!
//! Files of several members or streams one after the other are one file. Zeros behind the last are padding, as tapes
//! and some stores leave it. What the decoders hold is bounded: 128 MiB of window, whatever a header asks for.

use std::io::{self, BufRead, Read};

use flate2::bufread::GzDecoder;
use lzma_rust2::XzReader;
use ruzstd::decoding::StreamingDecoder;

/// How a file is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packing {
    Gzip,
    Zstd,
    Xz,
}

/// The most that a decoder may hold of what it has unpacked.
const WINDOW: u64 = 128 << 20;

impl Packing {
    const ALL: [Packing; 3] = [Packing::Gzip, Packing::Zstd, Packing::Xz];

    /// By the first bytes of a file.
    pub fn of(bytes: &[u8]) -> Option<Packing> {
        Packing::ALL.into_iter().find(|p| bytes.starts_with(p.magic()))
    }

    /// By an extension without its dot.
    pub fn from_extension(extension: &str) -> Option<Packing> {
        Packing::ALL.into_iter().find(|p| extension.eq_ignore_ascii_case(p.extension()))
    }

    fn extension(self) -> &'static str {
        match self {
            Packing::Gzip => "gz",
            Packing::Zstd => "zst",
            Packing::Xz => "xz",
        }
    }

    fn magic(self) -> &'static [u8] {
        match self {
            Packing::Gzip => &[0x1f, 0x8b],
            Packing::Zstd => &[0x28, 0xb5, 0x2f, 0xfd],
            Packing::Xz => &[0xfd, b'7', b'z', b'X', b'Z', 0],
        }
    }

    /// For messages: the name, and how its files begin.
    pub fn name(self) -> (&'static str, &'static str) {
        match self {
            Packing::Gzip => ("gzip", "1f 8b"),
            Packing::Zstd => ("zstd", "28 b5 2f fd"),
            Packing::Xz => ("xz", "fd 37 7a 58 5a 00"),
        }
    }

    /// What is inside.
    pub fn reader<'a>(self, input: impl BufRead + 'a) -> Box<dyn Read + 'a> {
        match self {
            Packing::Gzip => Box::new(Gzip::Member(Box::new(GzDecoder::new(input)))),
            Packing::Zstd => Box::new(Zstd::Between(input)),
            Packing::Xz => Box::new(XzReader::new_mem_limit(input, true, (WINDOW >> 10) as u32)),
        }
    }
}

/// Past zeros; whether something follows.
fn past_padding(input: &mut impl BufRead) -> io::Result<bool> {
    loop {
        let held = input.fill_buf()?;
        let zeros = held.iter().take_while(|b| **b == 0).count();
        if zeros == 0 {
            return Ok(!held.is_empty());
        }
        input.consume(zeros);
    }
}

/// Members of gzip.
enum Gzip<R: BufRead> {
    Member(Box<GzDecoder<R>>),
    End,
}

impl<R: BufRead> Read for Gzip<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while let Gzip::Member(member) = self {
            let n = member.read(out)?;
            if n > 0 || out.is_empty() {
                return Ok(n);
            }
            let Gzip::Member(member) = std::mem::replace(self, Gzip::End) else { break };
            let mut rest = member.into_inner();
            if past_padding(&mut rest)? {
                *self = Gzip::Member(Box::new(GzDecoder::new(rest)));
            }
        }
        Ok(0)
    }
}

/// Frames of Zstandard.
enum Zstd<R: BufRead> {
    Between(R),
    Frame(Box<StreamingDecoder<R, ruzstd::decoding::FrameDecoder>>),
    End,
}

impl<R: BufRead> Read for Zstd<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            *self = match std::mem::replace(self, Zstd::End) {
                Zstd::End => return Ok(0),
                Zstd::Frame(mut frame) => {
                    let n = frame.read(out)?;
                    if n > 0 || out.is_empty() {
                        *self = Zstd::Frame(frame);
                        return Ok(n);
                    }
                    Zstd::Between(frame.into_inner())
                }
                Zstd::Between(mut input) => {
                    if !past_padding(&mut input)? {
                        return Ok(0);
                    }
                    if skip_frame(&mut input)? {
                        Zstd::Between(input)
                    } else {
                        let frame = StreamingDecoder::new_with_max_window_size(input, WINDOW);
                        Zstd::Frame(Box::new(
                            frame.map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e.to_string()))?,
                        ))
                    }
                }
            }
        }
    }
}

/// Past a frame without content, `50..=5f 2a 4d 18`, its length and so many bytes.
fn skip_frame(input: &mut impl BufRead) -> io::Result<bool> {
    let held = input.fill_buf()?;
    if !(matches!(held.first(), Some(0x50..=0x5f)) && held.get(1..4) == Some(&[0x2a, 0x4d, 0x18])) {
        return Ok(false);
    }
    let mut head = [0; 8];
    input.read_exact(&mut head)?;
    let length = u64::from(u32::from_le_bytes([head[4], head[5], head[6], head[7]]));
    let skipped = io::copy(&mut input.take(length), &mut io::sink())?;
    if skipped == length { Ok(true) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unpacked(packed: &[u8]) -> io::Result<Vec<u8>> {
        let mut out = Vec::new();
        Packing::of(packed).unwrap().reader(packed).read_to_end(&mut out)?;
        Ok(out)
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        io::Write::write_all(&mut out, bytes).unwrap();
        out.finish().unwrap()
    }

    /// A frame of one block that is stored as it is.
    const FRAME: &[u8] = b"\x28\xb5\x2f\xfd\x20\x08\x41\0\0v 0 0 0\n";

    #[test]
    fn members_padding_and_frames() {
        let twice = [gzip(b"one "), gzip(b"two")].concat();
        assert_eq!(unpacked(&twice).unwrap(), b"one two");
        assert_eq!(unpacked(&[&twice[..], &[0; 700]].concat()).unwrap(), b"one two");
        assert!(unpacked(&[&twice[..], b"more"].concat()).is_err());
        assert!(unpacked(&twice[..twice.len() - 3]).is_err());
        assert_eq!(unpacked(&gzip(b"")).unwrap(), b"");
        assert_eq!(unpacked(FRAME).unwrap(), b"v 0 0 0\n");
        let between = [FRAME, &[0x53, 0x2a, 0x4d, 0x18, 3, 0, 0, 0, 1, 2, 3], FRAME].concat();
        assert_eq!(unpacked(&between).unwrap(), b"v 0 0 0\nv 0 0 0\n");
        assert!(unpacked(&FRAME[..12]).is_err());
    }
}
