//! A `.lods` file as the commands read it: the front first, then no more bytes than a level needs.

use crate::progress::Bars;
use crate::shared;
use anyhow::{Context, Result};
use lodestream::format::container::{ContainerError, FileIndex, Kind, MAGIC, Parsed};
use lodestream::format::decoder::{DecodeOptions, Decoder, MissingImages, Step};
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

/// Bytes per read.
const BLOCK: u64 = 1 << 18;

/// An open `.lods` file whose front has been read.
pub struct Stream {
    name: String,
    source: Box<dyn Read>,
    front: FileIndex,
    /// Bytes read and not yet handed to a decoder.
    pending: Vec<u8>,
    bytes_read: u64,
    read_time: Duration,
}

/// What decoding reached.
pub struct Reached {
    /// The decoder at the finest level reached; `None` when the bytes end before level 0 does.
    pub decoder: Decoder,
    /// The level, `None` when not even level 0 is whole.
    pub level: Option<u32>,
    /// Why the level asked for was not reached: the file is cut.
    pub cut: Option<ContainerError>,
    /// Time spent decoding, reading left out.
    pub decode_time: Duration,
}

impl Stream {
    /// Open a file or standard input and read its front, which may take so many bytes of memory.
    pub fn open(path: &Path, memory_limit: u64) -> Result<Self> {
        Self::new(shared::name(path), shared::open(path)?, memory_limit)
    }

    /// Read the front of what `source` gives; `name` stands for it in errors.
    pub fn new(name: String, mut source: Box<dyn Read>, memory_limit: u64) -> Result<Self> {
        let (mut bytes, mut read_time) = (Vec::new(), Duration::ZERO);
        let mut need = MAGIC.len() as u64 + 2;
        loop {
            let have = bytes.len() as u64;
            let wanted = need.saturating_sub(have);
            read_time += read(&mut source, &mut bytes, wanted).with_context(|| format!("{name}: cannot be read"))?;
            let ended = (bytes.len() as u64) < need;
            match FileIndex::parse_within(&bytes, memory_limit).with_context(|| name.clone())? {
                Parsed::Ready(front) => {
                    let bytes_read = bytes.len() as u64;
                    return Ok(Stream { name, source, front, pending: bytes, bytes_read, read_time });
                }
                Parsed::NeedBytes(more) if ended => {
                    let have = bytes.len() as u64;
                    let cut = ContainerError::Truncated { have, need: more, exact: false, level: None };
                    return Err(cut).context(name);
                }
                Parsed::NeedBytes(more) => need = more.max(need + 1),
            }
        }
    }

    /// What the file says about itself.
    pub fn front(&self) -> &FileIndex {
        &self.front
    }

    /// Bytes read so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read
    }

    /// Time spent reading so far.
    pub fn read_time(&self) -> Duration {
        self.read_time
    }

    /// Read up to `n` more bytes and forget what was pending; returns how many came.
    fn next(&mut self, n: u64) -> Result<u64> {
        self.pending.clear();
        self.read_time +=
            read(&mut self.source, &mut self.pending, n).with_context(|| format!("{}: cannot be read", self.name))?;
        self.bytes_read += self.pending.len() as u64;
        Ok(self.pending.len() as u64)
    }

    /// Decode up to `level`, reading no further than that needs; `each` sees the decoder at every level.
    pub fn decode(
        &mut self,
        level: u32,
        options: DecodeOptions,
        bars: &Bars,
        mut each: impl FnMut(u32, &mut Decoder) -> Result<()>,
    ) -> Result<Reached> {
        let end = self.front.prefix_bytes(level).unwrap_or(u64::MAX);
        let total = self.vertices(level);
        let mut decoder = Decoder::new(options);
        let mut decode_time = Duration::ZERO;
        let mut reached = None;
        let mut cut = None;
        loop {
            let start = Instant::now();
            decoder.push(&self.pending);
            while reached != Some(level) {
                match decoder.next_level().with_context(|| self.name.clone())? {
                    Step::Level(l) => {
                        reached = Some(l);
                        bars.show("decode", self.vertices(l), total);
                        each(l, &mut decoder)?;
                    }
                    Step::NeedBytes | Step::Full => break,
                }
            }
            decode_time += start.elapsed();
            if reached == Some(level) {
                break;
            }
            let wanted = end.saturating_sub(self.bytes_read).min(BLOCK);
            if self.next(wanted)? == 0 {
                let (have, need) = (self.bytes_read, self.front.total_bytes());
                cut = Some(ContainerError::Truncated { have, need, exact: true, level: reached });
                break;
            }
        }
        bars.finish();
        Ok(Reached { decoder, level: reached, cut, decode_time })
    }

    /// Hand the materials and images that lie behind what was read, and end within the first `limit` bytes, to the decoder.
    /// Returns what is missing then.
    pub fn pictures(&mut self, decoder: &mut Decoder, limit: u64) -> Result<MissingImages> {
        for index in 0..self.front.chunks().len() {
            let info = self.front.chunks()[index];
            if !matches!(info.kind, Kind::Appearance | Kind::Image | Kind::Reconstruction | Kind::Preview)
                || info.offset < self.bytes_read
            {
                continue;
            }
            if info.end() > limit {
                break;
            }
            while self.bytes_read < info.offset {
                let wanted = (info.offset - self.bytes_read).min(BLOCK);
                if self.next(wanted)? == 0 {
                    return Ok(decoder.missing_images());
                }
            }
            if self.next(info.length)? < info.length {
                break;
            }
            self.front.check_chunk(index, &self.pending).with_context(|| self.name.clone())?;
            decoder.offer(info, std::mem::take(&mut self.pending)).with_context(|| self.name.clone())?;
        }
        Ok(decoder.missing_images())
    }

    /// Bytes that follow the last chunk, an error of the file; looks only as far as needed.
    pub fn check_end(&mut self) -> Result<()> {
        let total = self.front.total_bytes();
        while self.bytes_read <= total {
            let wanted = (total + 1 - self.bytes_read).min(BLOCK);
            if self.next(wanted)? == 0 {
                break;
            }
        }
        self.front.check_length(self.bytes_read).with_context(|| self.name.clone())
    }

    /// Vertices of a level.
    pub fn vertices(&self, level: u32) -> u64 {
        self.front.header().levels.get(level as usize).map_or(0, |row| u64::from(row.vertices))
    }

    /// Elements of a level; those that travel aside belong to the full one.
    pub fn faces(&self, level: u32) -> u64 {
        let header = self.front.header();
        if level == header.full_level() {
            return u64::from(header.elements());
        }
        header.levels.get(level as usize).map_or(0, |row| u64::from(row.elements))
    }
}

/// Read up to `n` bytes behind those that are there, fewer only at the end.
fn read(source: &mut impl Read, bytes: &mut Vec<u8>, n: u64) -> std::io::Result<Duration> {
    let start = Instant::now();
    source.take(n).read_to_end(bytes)?;
    Ok(start.elapsed())
}
