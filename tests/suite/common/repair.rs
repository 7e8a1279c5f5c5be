//! Any bytes as a stream with valid checksums, and what a decoder has to hold to: shared by the fuzz target `decode`
//! and the replay of its findings. Without the repair no fuzzer would get past the first checksum.

use lodestream::format::container::{FileIndex, Parsed};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};

/// A number as LEB128 from `at` on, and where it ends.
fn leb128(bytes: &[u8], at: usize) -> Option<(u64, usize)> {
    let mut value = 0u64;
    for k in 0..9 {
        let byte = *bytes.get(at + k)?;
        value |= ((byte & 127) as u64) << (7 * k);
        if byte < 128 {
            return Some((value, at + k + 1));
        }
    }
    None
}

/// Make the checksums right, as far as the tables can be read; bytes behind the last chunk are cut off.
pub fn repair(bytes: &mut Vec<u8>) -> Option<()> {
    let (length, body) = leb128(bytes, 9)?;
    let end = body.checked_add(usize::try_from(length).ok()?).filter(|&e| e + 4 <= bytes.len())?;
    let seal = |bytes: &mut [u8]| {
        let sum = crc32fast::hash(&bytes[..end]);
        bytes[end..end + 4].copy_from_slice(&sum.to_le_bytes());
    };
    seal(bytes);
    let Ok(Parsed::Ready(front)) = FileIndex::parse(bytes) else { return None };
    let (_, at) = leb128(bytes, body)?;
    let (_, at) = leb128(bytes, at)?;
    let (_, sums) = leb128(bytes, at)?;
    for (k, chunk) in front.chunks().iter().enumerate() {
        let range = usize::try_from(chunk.offset).ok()?..usize::try_from(chunk.end()).ok()?;
        let sum = crc32fast::hash(bytes.get(range)?);
        bytes[sums + 4 * k..][..4].copy_from_slice(&sum.to_le_bytes());
    }
    bytes.truncate(usize::try_from(front.total_bytes()).ok()?);
    seal(bytes);
    Some(())
}

/// Decode under a small limit: every level is a valid complex, or there is an error of one line that stays.
pub fn decode(bytes: &[u8]) {
    let mut decoder = Decoder::new(DecodeOptions { memory_limit: 16 << 20 });
    decoder.push(bytes);
    let mut named: Vec<u32> = Vec::new();
    loop {
        match decoder.next_level() {
            Ok(Step::Level(_)) => {
                let level = decoder.complex();
                named.clear();
                named.resize(level.positions.len(), u32::MAX);
                for (f, corners) in (0u32..).zip(level.faces.iter()) {
                    assert!(corners.len() >= 2, "element {f} has {} corners", corners.len());
                    for &v in corners {
                        let last = &mut named[v as usize];
                        assert!(*last != f, "element {f} repeats {v}");
                        *last = f;
                    }
                }
            }
            Ok(Step::NeedBytes | Step::Full) => break,
            Err(error) => {
                assert_eq!(error.to_string().lines().count(), 1, "{error}");
                assert_eq!(decoder.next_level(), Err(error));
                break;
            }
        }
    }
    decoder.to_mesh().validate().expect("a decoder gives valid meshes");
    let _ = decoder.finish();
}
