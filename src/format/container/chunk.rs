//! Chunks, and in what order they may stand.

use super::error::{ContainerError, Place, inconsistent};
use super::header::Header;
use super::kind::{FIRST_OPTIONAL_KIND, Kind};
use super::preview::Preview;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// A chunk on its way into a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chunk<B = Vec<u8>> {
    /// What it holds.
    pub kind: Kind,
    /// The first level that it serves.
    pub first_level: u32,
    /// The last level that it serves.
    pub last_level: u32,
    /// Its number among the segments of these levels, from 0.
    pub segment: u32,
    /// How many segments these levels have, at least 1.
    pub segments: u32,
    /// The image that a piece or reconstruction belongs to; 0 for other kinds (the payload of a preview says it).
    pub image: u32,
    /// Bytes of working memory that decoding it takes beyond the levels themselves; rounded up by
    /// at most an eighth (and to at least 64) in the file.
    pub memory: u64,
    /// Its bytes.
    pub payload: B,
}

impl Chunk {
    /// Level 0 and the levels coded with it, up to `last`.
    pub fn base(last: u32, payload: Vec<u8>) -> Self {
        Chunk {
            kind: Kind::Base,
            first_level: 0,
            last_level: last,
            segment: 0,
            segments: 1,
            image: 0,
            memory: 0,
            payload,
        }
    }

    /// A run of levels in one chunk.
    pub fn levels(levels: RangeInclusive<u32>, payload: Vec<u8>) -> Self {
        let (first_level, last_level) = levels.into_inner();
        Chunk { kind: Kind::Levels, first_level, last_level, segment: 0, segments: 1, image: 0, memory: 0, payload }
    }

    /// Segment `segment` of the `segments` segments of the batch that leads to `level`.
    pub fn segment(level: u32, segment: u32, segments: u32, payload: Vec<u8>) -> Self {
        Chunk {
            kind: Kind::Segment,
            first_level: level,
            last_level: level,
            segment,
            segments,
            image: 0,
            memory: 0,
            payload,
        }
    }

    /// The elements that repeat a vertex.
    pub fn degenerate(full_level: u32, payload: Vec<u8>) -> Self {
        Chunk {
            kind: Kind::Degenerate,
            first_level: full_level,
            last_level: full_level,
            segment: 0,
            segments: 1,
            image: 0,
            memory: 0,
            payload,
        }
    }

    /// Values outside the complex.
    pub fn extra(full_level: u32, payload: Vec<u8>) -> Self {
        Chunk { kind: Kind::ExtraAttributes, ..Chunk::degenerate(full_level, payload) }
    }

    /// Materials and what they refer to; `level` is the one that it stands behind.
    pub fn appearance(level: u32, payload: Vec<u8>) -> Self {
        Chunk { kind: Kind::Appearance, ..Chunk::degenerate(level, payload) }
    }

    /// A preview of an image; `level` is the one that it stands behind.
    pub fn preview(level: u32, preview: &Preview<'_>) -> Self {
        Chunk { kind: Kind::Preview, ..Chunk::degenerate(level, preview.to_payload()) }
    }
}

impl<B> Chunk<B> {
    /// Piece `piece` of the `pieces` pieces of image `image`; `level` is the one that it stands behind.
    pub fn image(level: u32, image: u32, piece: u32, pieces: u32, payload: B) -> Self {
        let (first_level, last_level) = (level, level);
        let (segment, segments) = (piece, pieces);
        Chunk { kind: Kind::Image, first_level, last_level, segment, segments, image, memory: 0, payload }
    }

    /// What gives the very bytes of image `image` back; `level` is the one that it stands behind.
    pub fn reconstruction(level: u32, image: u32, payload: B) -> Self {
        Chunk { kind: Kind::Reconstruction, ..Chunk::image(level, image, 0, 1, payload) }
    }

    /// The same chunk, with its need for working memory stated.
    #[must_use]
    pub fn with_memory(mut self, bytes: u64) -> Self {
        self.memory = bytes;
        self
    }

    /// The same with its bytes in another form.
    #[cfg(feature = "encode")]
    pub(crate) fn map<C>(self, form: impl FnOnce(B) -> C) -> Chunk<C> {
        let Chunk { kind, first_level, last_level, segment, segments, image, memory, payload } = self;
        Chunk { kind, first_level, last_level, segment, segments, image, memory, payload: form(payload) }
    }
}

impl<B: AsRef<[u8]>> Chunk<B> {
    /// The same with its bytes where they are.
    pub(crate) fn borrowed(&self) -> Chunk<&[u8]> {
        let &Chunk { kind, first_level, last_level, segment, segments, image, memory, ref payload } = self;
        Chunk { kind, first_level, last_level, segment, segments, image, memory, payload: payload.as_ref() }
    }
}

/// A row of the chunk table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChunkInfo {
    /// What it holds.
    pub kind: Kind,
    /// The first level that it serves.
    pub first_level: u32,
    /// The last level that it serves.
    pub last_level: u32,
    /// Its number among the segments of these levels, from 0.
    pub segment: u32,
    /// How many segments these levels have, at least 1.
    pub segments: u32,
    /// The image that a piece or reconstruction belongs to; 0 for other kinds.
    pub image: u32,
    /// Bytes of working memory that decoding it takes, as the encoder says: for planning, not for allocating.
    pub memory: u64,
    /// Its first byte in the file.
    pub offset: u64,
    /// Its length in bytes.
    pub length: u64,
    /// CRC-32 of its bytes.
    pub checksum: u32,
}

impl ChunkInfo {
    /// The chunk with this payload, on its way into another file.
    pub fn chunk<B>(&self, payload: B) -> Chunk<B> {
        let &ChunkInfo { kind, first_level, last_level, segment, segments, image, memory, .. } = self;
        Chunk { kind, first_level, last_level, segment, segments, image, memory, payload }
    }

    /// The first byte behind it.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(self.length)
    }
}

/// The largest code of an amount of memory: 15 · 2^42 bytes, which also stands for anything larger.
pub(super) const MAX_MEMORY_CODE: u16 = 320;

/// The code of the smallest amount on the memory scale that is at least `bytes`: 0 for 0, `m + 1` for
/// `(8 + m % 8) << (m / 8)` times 8 bytes.
pub(super) fn memory_code(bytes: u64) -> u16 {
    let (mut lo, mut hi) = (0u16, MAX_MEMORY_CODE);
    while lo < hi {
        let middle = (lo + hi) / 2;
        if memory_amount(middle) >= bytes {
            hi = middle;
        } else {
            lo = middle + 1;
        }
    }
    lo
}

/// The amount of memory with the given code.
pub(super) fn memory_amount(code: u16) -> u64 {
    match code {
        0 => 0,
        _ => {
            let m = (code.min(MAX_MEMORY_CODE) - 1) as u64;
            ((8 + m % 8) << (m / 8)) * 8
        }
    }
}

/// Check that the chunks stand in an order in which a decoder can use them and cover every level.
///
/// Returns for each level how many chunks, from the first, it needs.
pub(super) fn check_order(header: &Header, chunks: &[ChunkInfo]) -> Result<Vec<usize>, ContainerError> {
    let levels = header.levels.len() as u64;
    let mut needs = Vec::with_capacity(header.levels.len());
    // The last level, number of segments and next segment of a run of segments that is not finished.
    let mut open: Option<(u32, u32, u32)> = None;
    let (mut degenerate, mut extra, mut appearance) = (false, false, false);
    // For each image that has begun: the next piece, the number of pieces, whether its reconstruction was there.
    let mut images: BTreeMap<u32, (u32, u32, bool)> = BTreeMap::new();
    for (index, c) in chunks.iter().enumerate() {
        let fail = |what| inconsistent(Place::Chunk(index), what);
        let next = needs.len() as u64;
        if let Kind::Other(kind @ ..FIRST_OPTIONAL_KIND) = c.kind {
            return Err(ContainerError::RequiredChunk { index, kind });
        }
        if c.first_level > c.last_level || c.last_level as u64 >= levels {
            return fail("levels that the file does not have");
        }
        if c.segment >= c.segments {
            return fail("a segment beyond the number of segments");
        }
        let single = !matches!(c.kind, Kind::Segment | Kind::Image | Kind::Preview | Kind::Other(_));
        if c.segments != 1 && single {
            return fail("segments of a kind that has none");
        }
        match c.kind {
            // What may be skipped may stand anywhere, and as often as it likes.
            Kind::Preview | Kind::Other(_) => continue,
            Kind::Degenerate => {
                if next != levels || c.first_level as u64 + 1 != levels || degenerate {
                    return fail("degenerate faces have to follow the full level, once");
                }
                if header.degenerate.elements == 0 {
                    return fail("degenerate faces, but the header has none");
                }
                degenerate = true;
                if let Some(need) = needs.last_mut() {
                    *need = index + 1;
                }
                continue;
            }
            Kind::ExtraAttributes => {
                if next != levels || c.first_level as u64 + 1 != levels || extra || !header.attributes.extra {
                    return fail(
                        "values outside the complex have to follow the full level, once, where the header has them",
                    );
                }
                extra = true;
                if let Some(need) = needs.last_mut() {
                    *need = index + 1;
                }
                continue;
            }
            Kind::Appearance => {
                if appearance || !header.attributes.appearance {
                    return fail("materials told twice, or where the header has none");
                }
                appearance = true;
                continue;
            }
            Kind::Image => {
                let (next, pieces, _) = images.entry(c.image).or_insert((0, c.segments, false));
                if c.image >= header.attributes.images || !appearance || (c.segment, c.segments) != (*next, *pieces) {
                    return fail("pieces of images out of order, or before the materials");
                }
                *next += 1;
                continue;
            }
            Kind::Reconstruction => {
                match images.get_mut(&c.image) {
                    Some((next, pieces, reconstruction @ false)) if next == pieces => *reconstruction = true,
                    _ => return fail("a reconstruction told twice, or before its image"),
                }
                continue;
            }
            Kind::Base | Kind::Levels | Kind::Segment => {}
        }
        if (c.kind == Kind::Base) != (next == 0) {
            return fail("the first chunk of levels has to be a base, and only the first");
        }
        if c.first_level as u64 != next {
            return fail("levels left out or told twice");
        }
        let in_order = match open {
            None => c.segment == 0,
            Some(expected) => c.kind == Kind::Segment && (c.last_level, c.segments, c.segment) == expected,
        };
        if !in_order {
            return fail("segments out of order");
        }
        if c.segment + 1 == c.segments {
            open = None;
            needs.resize(c.last_level as usize + 1, index + 1);
        } else {
            open = Some((c.last_level, c.segments, c.segment + 1));
        }
    }
    if needs.len() as u64 != levels || open.is_some() {
        return inconsistent(Place::Header, "the chunks do not cover all levels");
    }
    if degenerate != (header.degenerate.elements > 0) {
        return inconsistent(Place::Header, "the chunk of the degenerate faces is missing");
    }
    let announced = &header.attributes;
    let whole = images.values().filter(|(next, pieces, _)| next == pieces).count();
    if extra != announced.extra || appearance != announced.appearance || whole as u64 != announced.images as u64 {
        return inconsistent(Place::Header, "a chunk of values, materials or images is missing");
    }
    Ok(needs)
}
