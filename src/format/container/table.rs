//! The header fields, level table and chunk table as symbols of the range coder.
//!
//! One function, generic over the direction, so that writer and reader cannot drift apart. Tables have to be tiny (a
//! mesh of nine thousand vertices has fifty levels): each number is told as the difference from what the rows before it
//! suggest, through adaptive models. `docs/format/container.md` says the same.

use super::attributes;
use super::chunk::{ChunkInfo, MAX_MEMORY_CODE, memory_amount, memory_code};
use super::error::{ContainerError, Place, inconsistent};
use super::header::{DegenerateCounts, ErrorBound, Header, LevelInfo, MAX_LEVELS};
use super::kind::Kind;
use super::number::{MAX_COUNT, Number, count, float, raw};
use crate::format::coder::range::{Bit, Coder, Decoder, Encoder, exp_golomb};
use crate::mesh::lattice::Lattice;

/// Models for [`exp_golomb`] that start with the probability `p`, of 65536, for a number above 0.
fn above_zero(p: u16) -> [Bit; 64] {
    let mut models = [Bit::default(); 64];
    models[0] = Bit::with(p);
    models
}

/// Beginnings of flags that are mostly set, or mostly not: tables are too short to learn it.
const OFTEN: u16 = 60_000;
const SELDOM: u16 = 65_535 - OFTEN;
const EVEN: u16 = 32_768;

/// Models of a difference: a flag for zero, a sign, an exponential-Golomb code of the rest.
struct Difference {
    zero: Bit,
    negative: Bit,
    size: [Bit; 64],
}

impl Difference {
    /// Models that start with the given probabilities, of 65536, for zero and for a sign.
    fn new(zero: u16, negative: u16) -> Self {
        Difference { zero: Bit::with(zero), negative: Bit::with(negative), size: [Bit::default(); 64] }
    }

    /// A difference of less than `2^32` either way; `scale ≤ 31` low bits of its size less 1 go raw.
    fn code<C: Coder>(&mut self, c: &mut C, scale: u32, value: i64) -> i64 {
        if c.bit(&mut self.zero, value == 0) {
            return 0;
        }
        let negative = c.bit(&mut self.negative, value < 0);
        let size = value.unsigned_abs().saturating_sub(1);
        let high = exp_golomb(c, &mut self.size, (size >> scale) as u32) as i64;
        let size = (high << scale | c.bypass(scale, (size & ((1 << scale) - 1)) as u32) as i64) + 1;
        if negative { -size } else { size }
    }
}

/// Bits of a number: 0 for 0, else the position of its highest bit plus 1.
fn width(value: u64) -> u32 {
    64 - value.leading_zeros()
}

/// What a table holds: the header, and the chunks without their checksums and offsets, which stand elsewhere or follow.
type Tables = (Header, Vec<ChunkInfo>);

/// Write the tables.
pub(super) fn encode(header: &Header, chunks: &[ChunkInfo]) -> Result<Vec<u8>, ContainerError> {
    let mut coder = Encoder::new();
    tables(&mut coder, chunks.len(), Some((header, chunks)))?;
    Ok(coder.finish())
}

/// Read the tables of a file with `chunks` chunks. Features, checksums and offsets come out as 0.
pub(super) fn decode(bytes: &[u8], chunks: usize) -> Result<Tables, ContainerError> {
    let mut coder = Decoder::new(bytes);
    let tables = tables(&mut coder, chunks, None)?;
    if coder.overrun() {
        return inconsistent(Place::Header, "the tables end early");
    }
    Ok(tables)
}

fn tables<C: Coder>(
    c: &mut C,
    chunk_count: usize,
    given: Option<(&Header, &[ChunkInfo])>,
) -> Result<Tables, ContainerError> {
    let known = given.map(|g| g.0);
    let known_lattice = known.map_or(Lattice { origin: [0.0; 3], step: 1.0 }, |h| h.lattice);
    let step = float(c, known_lattice.step);
    let origin = known_lattice.origin.map(|x| float(c, x));
    let bits = c.uniform(22, known.and_then(|h| h.position_bits).unwrap_or(0) as u32) as u8;
    let mut size = Number::new();
    let known_aside = known.map_or(DegenerateCounts::default(), |h| h.degenerate);
    let degenerate = DegenerateCounts {
        elements: count(size.code(c, known_aside.elements as u64))?,
        corners: count(size.code(c, known_aside.corners as u64))?,
    };
    let levels = levels(c, &mut size, known)?;
    let full = levels.last().copied().unwrap_or_default();
    let missing = (full.vertices as u64).saturating_sub(known.map_or(0, |h| h.components) as u64);
    let components = count((full.vertices as u64).saturating_sub(size.code(c, missing)))?;
    let bounds = if full.vertices == 0 { None } else { Some(bounds(c, known)?) };
    let attributes = attributes::code(c, &mut size, known.map(|h| &h.attributes))?;
    let header = Header {
        required: 0,
        optional: 0,
        lattice: Lattice { origin, step },
        position_bits: (bits != 0).then_some(bits),
        bounds,
        components,
        degenerate,
        levels,
        attributes,
    };
    let chunks = chunks(c, chunk_count, given.map(|g| g.1))?;
    Ok((header, chunks))
}

fn bounds<C: Coder>(c: &mut C, known: Option<&Header>) -> Result<[[i32; 3]; 2], ContainerError> {
    let [lo, hi] = known.and_then(|h| h.bounds).unwrap_or_default();
    let mut size = Number::new();
    let mut out = [[0i32; 3]; 2];
    for k in 0..3 {
        let zigzag = size.code(c, ((lo[k] as i64) << 1 ^ (lo[k] as i64) >> 63) as u64);
        let low = (zigzag >> 1) as i64 ^ -((zigzag & 1) as i64);
        let Ok(low) = i32::try_from(low) else {
            return inconsistent(Place::Header, "bounds beyond the coordinate limit");
        };
        out[0][k] = low;
    }
    // The extents with as many bits as the longest of them takes.
    let extents: [u32; 3] = std::array::from_fn(|k| hi[k].abs_diff(lo[k]));
    let bits = c.uniform(33, width(extents.into_iter().fold(0, |a, b| a | b) as u64));
    for k in 0..3 {
        let Some(high) = out[0][k].checked_add_unsigned(raw(c, bits, extents[k] as u64) as u32) else {
            return inconsistent(Place::Header, "bounds beyond the coordinate limit");
        };
        out[1][k] = high;
    }
    Ok(out)
}

/// How the corners of a level are guessed from its vertices and elements.
#[derive(Clone, Copy)]
enum Corners {
    /// Three for each new element.
    Triangles,
    /// Two for each new vertex and element: what a collapse inside a closed surface of any polygons takes away.
    Polygons,
}

fn levels<C: Coder>(c: &mut C, size: &mut Number, known: Option<&Header>) -> Result<Vec<LevelInfo>, ContainerError> {
    let rows = known.map_or(&[][..], |h| &h.levels);
    let count = size.code(c, rows.len() as u64);
    if count == 0 || count > MAX_LEVELS as u64 {
        return inconsistent(Place::Header, "no levels or too many");
    }
    let triangles = rows.iter().all(|r| r.corners as u64 == 3 * r.elements as u64);
    let guess = if c.bit(&mut Bit::default(), triangles) { Corners::Triangles } else { Corners::Polygons };
    let mut vertices = Difference::new(SELDOM, EVEN);
    let (mut elements, mut corners) = (Difference::new(OFTEN, EVEN), Difference::new(OFTEN, EVEN));
    let (mut shifts, mut errors) = (above_zero(SELDOM), Difference::new(SELDOM, OFTEN));
    let mut out: Vec<LevelInfo> = Vec::new();
    for l in 0..count as usize {
        let row = rows.get(l).copied().unwrap_or_default();
        let place = Place::Level(l as u32);
        let add = |from: i64, difference: i64| match u32::try_from(from.saturating_add(difference)) {
            Ok(v) if v <= MAX_COUNT => Ok(v),
            _ => inconsistent(place, "a count below 0 or beyond 2^32 - 2"),
        };
        let Some(&before) = out.last() else {
            // Level 0: plain numbers.
            let first = LevelInfo {
                vertices: add(0, size.code(c, row.vertices as u64).min(1 << 40) as i64)?,
                elements: add(0, size.code(c, row.elements as u64).min(1 << 40) as i64)?,
                corners: add(0, size.code(c, row.corners as u64).min(1 << 40) as i64)?,
                shift: c.bypass(5, row.shift as u32) as u8,
                error: error_code(c.bypass(10, row.error.code() as u32) as i64, place)?,
            };
            out.push(first);
            continue;
        };
        // What the last levels added, against what they added it to. Level 0 counts as having added a quarter of itself, two
        // elements for each vertex.
        let (v, e, n) = (before.vertices as i64, before.elements as i64, before.corners as i64);
        let window = &out[l.saturating_sub(WINDOW + 1)..l - 1];
        let (grown_v, grown_e, from_v) = match window.first() {
            Some(r) => {
                let sum = window.iter().map(|r| r.vertices as i64).sum();
                (v - r.vertices as i64, e - r.elements as i64, sum)
            }
            None => (v, 2 * v, 4 * v),
        };
        let clamp = |guess: i64| guess.clamp(0, MAX_COUNT as i64);
        let guess_v = clamp(v + scaled(grown_v, v, from_v));
        let new_v = add(
            guess_v,
            vertices.code(c, width((guess_v - v).unsigned_abs()).saturating_sub(3), row.vertices as i64 - guess_v),
        )?;
        let delta_v = new_v as i64 - v;
        let guess_e = clamp(e + if grown_v > 0 { scaled(delta_v, grown_e, grown_v) } else { 2 * delta_v });
        let new_e = add(guess_e, elements.code(c, 0, row.elements as i64 - guess_e))?;
        let delta_e = new_e as i64 - e;
        let guess_n = clamp(match guess {
            Corners::Triangles => n + 3 * delta_e,
            Corners::Polygons => n + 2 * delta_v + 2 * delta_e,
        });
        let new_n = add(guess_n, corners.code(c, 0, row.corners as i64 - guess_n))?;
        let drop = exp_golomb(c, &mut shifts, before.shift.saturating_sub(row.shift) as u32);
        let Some(shift) = u8::try_from(drop).ok().and_then(|d| before.shift.checked_sub(d)) else {
            return inconsistent(place, "a shift below 0");
        };
        let error = before.error.code() as i64;
        let error = error_code(error.saturating_add(errors.code(c, 0, row.error.code() as i64 - error)), place)?;
        out.push(LevelInfo { vertices: new_v, elements: new_e, corners: new_n, shift, error });
    }
    Ok(out)
}

/// How many steps between levels the growth is averaged over.
const WINDOW: usize = 3;

fn error_code(code: i64, place: Place) -> Result<ErrorBound, ContainerError> {
    match u16::try_from(code).ok().and_then(ErrorBound::from_code) {
        Some(bound) => Ok(bound),
        None => inconsistent(place, "an error bound outside the scale"),
    }
}

/// `a · b / c`, rounded down, for `c > 0`; 0 for `c = 0`. All within ±2^33.
fn scaled(a: i64, b: i64, c: i64) -> i64 {
    if c == 0 { 0 } else { (a as i128 * b as i128).div_euclid(c as i128).clamp(-(1 << 40), 1 << 40) as i64 }
}

fn chunks<C: Coder>(
    c: &mut C,
    chunk_count: usize,
    given: Option<&[ChunkInfo]>,
) -> Result<Vec<ChunkInfo>, ContainerError> {
    let rows = given.unwrap_or_default();
    let mut follows = Bit::default();
    let (mut kinds, mut skips) = ([Bit::default(); 64], Difference::new(OFTEN, EVEN));
    let (mut spans, mut segment_numbers) = (above_zero(SELDOM), above_zero(SELDOM));
    let (mut lengths, mut memories) = (Number::new(), Difference::new(EVEN, EVEN));
    let mut images = Number::new();
    let mut out: Vec<ChunkInfo> = Vec::with_capacity(chunk_count);
    let mut memory = 0i64;
    // A base of nothing stands before the first row.
    let (mut next_level, mut before) = (0i64, None::<ChunkInfo>);
    for index in 0..chunk_count {
        let fail = |what| inconsistent(Place::Chunk(index), what);
        let row = rows.get(index);
        let successor = before
            .filter(|b| b.segment < b.segments.saturating_sub(1))
            .map(|b| ChunkInfo { segment: b.segment + 1, ..b });
        let same_run = |s: &ChunkInfo| {
            row.is_some_and(|r| {
                (r.kind, r.first_level, r.last_level, r.segment, r.segments, r.image)
                    == (s.kind, s.first_level, s.last_level, s.segment, s.segments, s.image)
            })
        };
        let mut info = match successor {
            Some(s) if c.bit(&mut follows, same_run(&s)) => s,
            _ => {
                let number = exp_golomb(c, &mut kinds, row.map_or(0, |r| r.kind.number() as u32));
                let Ok(number) = u8::try_from(number) else {
                    return fail("a kind beyond 255");
                };
                let kind = Kind::from_number(number);
                let skip = skips.code(c, 0, row.map_or(0, |r| r.first_level as i64 - next_level));
                let first = u32::try_from(next_level.saturating_add(skip));
                let span = exp_golomb(c, &mut spans, row.map_or(0, |r| r.last_level.saturating_sub(r.first_level)));
                let segments = exp_golomb(c, &mut segment_numbers, row.map_or(0, |r| r.segments.saturating_sub(1)));
                let segment = exp_golomb(c, &mut segment_numbers, row.map_or(0, |r| r.segment));
                let image = match kind {
                    Kind::Image | Kind::Reconstruction => count(images.code(c, row.map_or(0, |r| r.image as u64)))?,
                    _ => 0,
                };
                let (Ok(first_level), Some(segments)) = (first, segments.checked_add(1)) else {
                    return fail("a level or segment out of range");
                };
                let Some(last_level) = first_level.checked_add(span) else {
                    return fail("a level out of range");
                };
                next_level = last_level as i64 + 1;
                ChunkInfo {
                    kind,
                    first_level,
                    last_level,
                    segment,
                    segments,
                    image,
                    memory: 0,
                    offset: 0,
                    length: 0,
                    checksum: 0,
                }
            }
        };
        info.length = lengths.code(c, row.map_or(0, |r| r.length));
        let code = row.map_or(0, |r| memory_code(r.memory) as i64);
        memory = memory.saturating_add(memories.code(c, 0, code - memory));
        if !(0..=MAX_MEMORY_CODE as i64).contains(&memory) {
            return fail("an amount of memory outside the scale");
        }
        info.memory = memory_amount(memory as u16);
        before = Some(info);
        out.push(info);
    }
    Ok(out)
}
