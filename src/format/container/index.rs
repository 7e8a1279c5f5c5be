//! The front of a file: everything before the first chunk, as bytes and back.
//!
//! ```text
//! magic 8 | version 1 | length of the body, LEB128 | body | CRC-32 of all that, 4
//! body: required features, LEB128 | optional features, LEB128 | chunks, LEB128 | CRC-32 of each chunk, 4 | tables, range coded
//! ```

use super::chunk::{Chunk, ChunkInfo, check_order, memory_amount, memory_code};
use super::error::{ContainerError, Place, inconsistent};
use super::header::Header;
use super::kind::Kind;
use super::{
    KNOWN_REQUIRED, MAGIC, MAX_BODY, MEMORY_PER_CORNER, MEMORY_PER_ELEMENT, MEMORY_PER_EXTRA_VALUE,
    MEMORY_PER_LAYER_CORNER, MEMORY_PER_NEW_VERTEX, MEMORY_PER_VERTEX, MEMORY_PER_WEDGE_COMPONENT, VERSION, table,
};
use crate::leb128;

/// Bytes of memory that a row of the table of chunks takes while it is read.
const MEMORY_PER_CHUNK: u64 = 128;

/// The front of a file, checked: what a client needs to plan.
#[derive(Clone, Debug, PartialEq)]
pub struct FileIndex {
    header: Header,
    chunks: Vec<ChunkInfo>,
    /// Bytes of the front itself.
    length: u64,
    /// For each level how many chunks, from the first, it needs.
    needs: Vec<usize>,
    /// For each level the most working memory that the chunks of one run of levels take together, up to this level.
    working: Vec<u64>,
    /// For each level the bytes of images and previews in the chunks up to those that it needs; for the full level of all images.
    images: Vec<u64>,
}

/// What came of reading a front.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)] // one at a time, and moved once
pub enum Parsed {
    /// The file has to be known up to this many bytes at least.
    NeedBytes(u64),
    /// The front is whole.
    Ready(FileIndex),
}

impl FileIndex {
    /// Read the front of a file of which `bytes` is a prefix.
    ///
    /// Allocates no more than a small multiple of the front's own bytes, plus 64 K rows of levels at the very most,
    /// whatever the file claims.
    ///
    /// # Errors
    /// Every kind but [`ContainerError::ChunkDamaged`], [`Truncated`](ContainerError::Truncated),
    /// [`TrailingBytes`](ContainerError::TrailingBytes) and [`MemoryLimit`](ContainerError::MemoryLimit).
    pub fn parse(bytes: &[u8]) -> Result<Parsed, ContainerError> {
        FileIndex::parse_within(bytes, u64::MAX)
    }

    /// The same within so many bytes of memory for the table of chunks.
    ///
    /// # Errors
    /// Those of [`parse`](Self::parse), and [`ContainerError::MemoryLimit`].
    pub fn parse_within(bytes: &[u8], memory_limit: u64) -> Result<Parsed, ContainerError> {
        check_magic(bytes)?;
        let Some(&version) = bytes.get(MAGIC.len()) else {
            return Ok(Parsed::NeedBytes(MAGIC.len() as u64 + 2));
        };
        if version != VERSION {
            return Err(ContainerError::Version { found: version, supported: VERSION });
        }
        let mut at = MAGIC.len() + 1;
        let Some(body_length) = number_at(bytes, &mut at)? else {
            return Ok(Parsed::NeedBytes(bytes.len() as u64 + 1));
        };
        if body_length > MAX_BODY {
            return inconsistent(Place::Header, "a front of more than 64 MiB");
        }
        let body_end = at + body_length as usize;
        let length = body_end + 4;
        let (Some(body), Some(stored)) = (bytes.get(at..body_end), bytes.get(body_end..length)) else {
            return Ok(Parsed::NeedBytes(length as u64));
        };
        let (stored, computed) = (le32(stored), crc32fast::hash(&bytes[..body_end]));
        if stored != computed {
            return Err(ContainerError::HeaderDamaged { length: body_end as u64, stored, computed });
        }
        Ok(Parsed::Ready(FileIndex::parse_body(body, length as u64, memory_limit)?))
    }

    fn parse_body(body: &[u8], length: u64, limit: u64) -> Result<FileIndex, ContainerError> {
        let mut at = 0;
        let mut number = || match number_at(body, &mut at)? {
            Some(n) => Ok(n),
            None => inconsistent(Place::Header, "the front ends early"),
        };
        let (required, optional, count) = (number()?, number()?, number()?);
        check_features(required)?;
        // Each chunk has four bytes of checksum here, so that the table is bounded by the bytes at hand.
        let rest = &body[at..];
        let needed = count.saturating_mul(MEMORY_PER_CHUNK).saturating_add(body.len() as u64);
        if needed > limit {
            return Err(ContainerError::MemoryLimit { needed, limit });
        }
        let Some((checksums, tables)) =
            usize::try_from(count).ok().and_then(|n| n.checked_mul(4)).and_then(|n| rest.split_at_checked(n))
        else {
            return inconsistent(Place::Header, "more chunks than the front has room for");
        };
        let (mut header, mut chunks) = table::decode(tables, checksums.len() / 4)?;
        (header.required, header.optional) = (required, optional);
        let mut offset = length;
        for (index, (chunk, sum)) in chunks.iter_mut().zip(checksums.chunks_exact(4)).enumerate() {
            chunk.checksum = le32(sum);
            chunk.offset = offset;
            offset = end_of(index, offset, chunk.length)?;
        }
        FileIndex::assemble(header, chunks, length)
    }

    /// The checked front from its parts; `chunks` have their offsets.
    fn assemble(header: Header, chunks: Vec<ChunkInfo>, length: u64) -> Result<FileIndex, ContainerError> {
        header.validate()?;
        let needs = check_order(&header, &chunks)?;
        let mut working = vec![0u64; needs.len()];
        for c in &chunks {
            // Materials and images stay, whatever the level.
            let known = !matches!(c.kind, Kind::Other(_) | Kind::Appearance | Kind::Image | Kind::Preview);
            if let Some(w) = working.get_mut(c.first_level as usize).filter(|_| known) {
                *w = w.saturating_add(c.memory).saturating_add(c.length);
            }
        }
        let (mut most, mut before) = (0, 0);
        for (w, row) in working.iter_mut().zip(&header.levels) {
            *w = w.saturating_add(row.vertices.saturating_sub(before) as u64 * MEMORY_PER_NEW_VERTEX);
            before = row.vertices;
            most = most.max(*w);
            *w = most;
        }
        let (mut images, mut sum, mut at) = (Vec::with_capacity(needs.len()), 0u64, 0);
        for (level, &need) in needs.iter().enumerate() {
            let end = if level + 1 == needs.len() { chunks.len() } else { need };
            let pieces = chunks[at..end].iter().filter(|c| matches!(c.kind, Kind::Image | Kind::Preview));
            sum = pieces.fold(sum, |sum, c| sum.saturating_add(c.length));
            at = end;
            images.push(sum);
        }
        Ok(FileIndex { header, chunks, length, needs, working, images })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The chunk table, in the order of the file.
    pub fn chunks(&self) -> &[ChunkInfo] {
        &self.chunks
    }

    /// Bytes before the first chunk.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes of the whole file.
    pub fn total_bytes(&self) -> u64 {
        self.chunks.last().map_or(self.length, ChunkInfo::end)
    }

    /// The number of the full level.
    pub fn full_level(&self) -> u32 {
        self.header.full_level()
    }

    /// How many bytes of the file, from its first, `level` needs; `None` beyond the full level. Degenerate faces
    /// belong to the full level.
    pub fn prefix_bytes(&self, level: u32) -> Option<u64> {
        let &chunks = self.needs.get(level as usize)?;
        Some(self.end_of_chunks(chunks))
    }

    /// How many chunks of the file, from its first, `level` needs; `None` beyond the full level.
    pub fn prefix_chunks(&self, level: u32) -> Option<usize> {
        self.needs.get(level as usize).copied()
    }

    /// The finest level that is whole when the first `bytes` bytes of the file are at hand.
    pub fn whole_level(&self, bytes: u64) -> Option<u32> {
        (self.needs.partition_point(|&chunks| self.end_of_chunks(chunks) <= bytes) as u32).checked_sub(1)
    }

    /// How many chunks are whole when the first `bytes` bytes of the file are at hand.
    pub fn whole_chunks(&self, bytes: u64) -> usize {
        self.chunks.partition_point(|c| c.end() <= bytes)
    }

    fn end_of_chunks(&self, chunks: usize) -> u64 {
        chunks.checked_sub(1).and_then(|last| self.chunks.get(last)).map_or(self.length, ChunkInfo::end)
    }

    /// The payload of chunk `index`, its checksum verified, from a prefix of the file; `None` when the prefix ends before the
    /// chunk does, or there is no such chunk.
    ///
    /// # Errors
    /// [`ContainerError::ChunkDamaged`].
    pub fn payload<'a>(&self, file: &'a [u8], index: usize) -> Result<Option<&'a [u8]>, ContainerError> {
        let Some(info) = self.chunks.get(index) else { return Ok(None) };
        let range = usize::try_from(info.offset).ok().zip(usize::try_from(info.end()).ok());
        let Some(payload) = range.and_then(|(a, b)| file.get(a..b)) else { return Ok(None) };
        verify(index, info, payload)?;
        Ok(Some(payload))
    }

    /// Check that `payload` is what the table says of chunk `index`, for one that was fetched apart.
    ///
    /// # Errors
    /// [`ContainerError::ChunkDamaged`]; a chunk that is not there is [`ContainerError::Inconsistent`].
    pub fn check_chunk(&self, index: usize, payload: &[u8]) -> Result<(), ContainerError> {
        match self.chunks.get(index) {
            Some(info) if info.length == payload.len() as u64 => verify(index, info, payload),
            _ => inconsistent(Place::Chunk(index), "not a chunk of this file"),
        }
    }

    /// Check that the file, of `bytes` bytes, neither ends early nor goes on.
    ///
    /// # Errors
    /// [`ContainerError::Truncated`] or [`ContainerError::TrailingBytes`].
    pub fn check_length(&self, bytes: u64) -> Result<(), ContainerError> {
        let total = self.total_bytes();
        if bytes < total {
            let level = self.whole_level(bytes);
            return Err(ContainerError::Truncated { have: bytes, need: total, exact: true, level });
        }
        if bytes > total {
            return Err(ContainerError::TrailingBytes { have: bytes, total });
        }
        Ok(())
    }

    /// About how many bytes of memory decoding up to `level` takes: the counts of that level by the constants of this module,
    /// and the most that one batch takes to decode. Levels beyond the full one count as the full one.
    pub fn memory(&self, level: u32) -> u64 {
        let level = level.min(self.full_level());
        let Some(row) = self.header.levels.get(level as usize) else { return 0 };
        let (mut elements, mut corners) = (row.elements as u64, row.corners as u64);
        if level == self.full_level() {
            elements += self.header.degenerate.elements as u64;
            corners += self.header.degenerate.corners as u64;
        }
        let levels =
            row.vertices as u64 * MEMORY_PER_VERTEX + elements * MEMORY_PER_ELEMENT + corners * MEMORY_PER_CORNER;
        let layers = &self.header.attributes.layers;
        let mut attributes = 0u64;
        for (layer, width) in layers.iter().zip(self.header.attributes.scheme().widths) {
            let wedges = (layer.wedges as u64).min(corners);
            attributes = attributes
                .saturating_add(corners * MEMORY_PER_LAYER_CORNER)
                .saturating_add(wedges * width as u64 * MEMORY_PER_WEDGE_COMPONENT);
        }
        if level == self.full_level() && self.header.attributes.extra {
            let extra = row.vertices as u64 + self.header.degenerate.corners as u64;
            attributes = attributes.saturating_add(extra * layers.len() as u64 * MEMORY_PER_EXTRA_VALUE);
        }
        if !self.header.attributes.is_bare() {
            attributes = attributes.saturating_add(elements * MEMORY_PER_ELEMENT);
        }
        if let Some(c) = self.chunks.iter().find(|c| self.header.attributes.appearance && c.kind == Kind::Appearance) {
            attributes = attributes.saturating_add(c.memory).saturating_add(c.length);
        }
        let attributes = attributes.saturating_add(self.image_bytes(level));
        levels.saturating_add(attributes).saturating_add(self.working.get(level as usize).copied().unwrap_or(0))
    }

    /// Bytes of images and previews in the chunks up to those that `level` needs; for the full level of all images.
    pub(crate) fn image_bytes(&self, level: u32) -> u64 {
        self.images.get(level as usize).copied().unwrap_or(0)
    }

    /// Check, before anything is allocated by the counts of the file, that decoding up to `level` fits.
    ///
    /// # Errors
    /// [`ContainerError::MemoryLimit`].
    pub fn check_memory(&self, level: u32, limit: u64) -> Result<(), ContainerError> {
        let needed = self.memory(level);
        if needed > limit { Err(ContainerError::MemoryLimit { needed, limit }) } else { Ok(()) }
    }
}

/// Check that the payload of a chunk is what the table says.
pub(super) fn verify(index: usize, info: &ChunkInfo, payload: &[u8]) -> Result<(), ContainerError> {
    let computed = crc32fast::hash(payload);
    if computed == info.checksum {
        return Ok(());
    }
    let ChunkInfo { kind, offset, length, checksum: stored, .. } = *info;
    Err(ContainerError::ChunkDamaged { index, kind, offset, length, stored, computed })
}

/// The bytes of the front of a file with these chunks; the file is the front and then each chunk's payload in turn.
///
/// # Errors
/// What [`FileIndex::parse`] would refuse, except for unknown features.
pub fn write_front(header: &Header, chunks: &[Chunk]) -> Result<Vec<u8>, ContainerError> {
    front_of(header, &chunks.iter().map(Chunk::borrowed).collect::<Vec<_>>())
}

/// [`write_front`] of chunks whose bytes lie elsewhere.
pub(crate) fn front_of(header: &Header, chunks: &[Chunk<&[u8]>]) -> Result<Vec<u8>, ContainerError> {
    let mut infos = Vec::with_capacity(chunks.len());
    let mut offset = 0u64;
    for (index, chunk) in chunks.iter().enumerate() {
        let length = chunk.payload.len() as u64;
        infos.push(ChunkInfo {
            kind: chunk.kind,
            first_level: chunk.first_level,
            last_level: chunk.last_level,
            segment: chunk.segment,
            segments: chunk.segments,
            image: chunk.image,
            memory: memory_amount(memory_code(chunk.memory)),
            offset,
            length,
            checksum: crc32fast::hash(chunk.payload),
        });
        offset = end_of(index, offset, length)?;
    }
    check_features(header.required)?;
    header.validate()?;
    check_order(header, &infos)?;

    let mut body = Vec::new();
    leb128::put(&mut body, header.required);
    leb128::put(&mut body, header.optional);
    leb128::put(&mut body, infos.len() as u64);
    for info in &infos {
        body.extend_from_slice(&info.checksum.to_le_bytes());
    }
    body.extend_from_slice(&table::encode(header, &infos)?);
    if body.len() as u64 > MAX_BODY {
        return inconsistent(Place::Header, "a front of more than 64 MiB");
    }
    let mut front = Vec::with_capacity(MAGIC.len() + 9 + body.len());
    front.extend_from_slice(&MAGIC);
    front.push(VERSION);
    leb128::put(&mut front, body.len() as u64);
    front.extend_from_slice(&body);
    let sum = crc32fast::hash(&front);
    front.extend_from_slice(&sum.to_le_bytes());
    Ok(front)
}

/// The bytes of a whole file.
///
/// # Errors
/// As [`write_front`].
pub fn write(header: &Header, chunks: &[Chunk]) -> Result<Vec<u8>, ContainerError> {
    write_borrowed(header, &chunks.iter().map(Chunk::borrowed).collect::<Vec<_>>())
}

/// [`write`] of chunks whose bytes lie elsewhere, so that large ones (images) are not there twice.
pub(crate) fn write_borrowed(header: &Header, chunks: &[Chunk<&[u8]>]) -> Result<Vec<u8>, ContainerError> {
    let mut file = front_of(header, chunks)?;
    file.reserve_exact(chunks.iter().map(|c| c.payload.len()).sum());
    for chunk in chunks {
        file.extend_from_slice(chunk.payload);
    }
    Ok(file)
}

/// A whole file with one more chunk behind all others; `make` gets the number of the full level.
///
/// # Errors
/// As [`FileIndex::parse`], [`FileIndex::payload`] and [`write_front`]; [`ContainerError::Truncated`] where the file is cut.
pub fn with_chunk(file: &[u8], make: impl FnOnce(u32) -> Chunk) -> Result<Vec<u8>, ContainerError> {
    let have = file.len() as u64;
    let front = match FileIndex::parse(file)? {
        Parsed::Ready(front) => front,
        Parsed::NeedBytes(need) => return Err(ContainerError::Truncated { have, need, exact: false, level: None }),
    };
    front.check_length(have)?;
    let last = make(front.full_level());
    let mut chunks = Vec::with_capacity(front.chunks().len() + 1);
    for (index, &info) in front.chunks().iter().enumerate() {
        let payload = front.payload(file, index)?.unwrap_or_default();
        chunks.push(info.chunk(payload));
    }
    chunks.push(last.borrowed());
    write_borrowed(front.header(), &chunks)
}

/// The end of a chunk; files stay below 2^62 bytes.
fn end_of(index: usize, offset: u64, length: u64) -> Result<u64, ContainerError> {
    match offset.checked_add(length) {
        Some(end) if end < 1 << 62 => Ok(end),
        _ => inconsistent(Place::Chunk(index), "the file would be longer than 2^62 bytes"),
    }
}

fn check_features(required: u64) -> Result<(), ContainerError> {
    match required & !KNOWN_REQUIRED {
        0 => Ok(()),
        unknown => Err(ContainerError::RequiredFeature { bit: unknown.trailing_zeros() }),
    }
}

/// Tell a file that is none of ours, as early as its bytes allow, from one that was changed as text on its way.
fn check_magic(bytes: &[u8]) -> Result<(), ContainerError> {
    let head = &bytes[..bytes.len().min(MAGIC.len())];
    if MAGIC.starts_with(head) {
        return Ok(());
    }
    let name = 1..5;
    if head.get(name.clone()) == MAGIC.get(name) {
        Err(ContainerError::TextDamage)
    } else {
        Err(ContainerError::NotALods)
    }
}

fn le32(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | b as u32)
}

/// The number at `at`, which moves behind it; `None` where the bytes end early.
fn number_at(bytes: &[u8], at: &mut usize) -> Result<Option<u64>, ContainerError> {
    leb128::take(bytes, at)
        .or_else(|leb128::Overlong| inconsistent(Place::Header, "a number written in too many bytes"))
}
