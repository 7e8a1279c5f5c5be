//! The streams of a file's chunks: which symbols follow which.
//!
//! A chunk of small levels holds one coder that runs through all of them; a large level has one chunk per segment, each with a coder of its own,
//! that starts with the models as the first segment of the coarser level's batch left them (core paper section 5; Qin 2002 for batches
//! without order; segments after `docs/design/codec.md`).

use crate::format::attributes::Scheme;
use crate::format::coder::range::{Bit, Coder, exp_golomb};
use crate::format::complex::{Batch, Level};
use crate::format::points::code_points;
use crate::format::split::neighbourhood::LevelGeometry;
use crate::format::split::segment::{InvalidStream, Models, Scratch, SegmentBits, Source, code_splits};
use std::ops::Range;
use std::sync::atomic::AtomicU64;

/// Vertices of the coarser level in one segment, at most.
pub const SEGMENT: usize = 16384;

/// How many segments a batch has whose coarser level has `vertices` vertices: a power of two, so that two cores, or four, have
/// as much to do.
pub fn segments(vertices: usize) -> usize {
    vertices.div_ceil(SEGMENT).max(1).next_power_of_two()
}

/// The vertices of segment `s` of `of`.
pub fn segment_range(vertices: usize, s: usize, of: usize) -> Range<u32> {
    let cut = |s: usize| (vertices as u64 * s as u64 / of as u64) as u32;
    cut(s)..cut(s + 1)
}

/// What runs through the segments of a file beside the models of splits.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// Models of splits.
    pub models: Models,
    alpha: u8,
    same_alpha: Bit,
    new_vertices: Bits,
}

impl State {
    /// The state at the beginning of a file whose attributes are those of `scheme`.
    pub fn new(scheme: &Scheme) -> Self {
        State { models: Models::new(scheme), ..State::default() }
    }
}

#[derive(Clone, Debug)]
struct Bits([Bit; 64]);

impl Default for Bits {
    fn default() -> Self {
        Bits([Bit::with(20000); 64])
    }
}

/// What a segment is part of.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The coarser level.
    pub view: LevelGeometry<'a>,
    /// The vertices of the segment.
    pub range: (u32, u32),
    /// Whether it is the first segment of its batch, which tells the placement and the new_vertices.
    pub first: bool,
    /// Vertices, and elements, that the header says the finer level has more.
    pub more: (u64, u64),
    /// Triangles that all segments of the batch may still list on the general road; a decoder begins with `more.1`.
    pub room: &'a AtomicU64,
    /// Wedges that each layer may still gain in all segments of the batch; empty for an encoder.
    pub wedges: &'a [AtomicU64],
    /// The shift of the finer level.
    pub shift: u8,
    /// The rounding of midpoints, 0 or 1.
    pub bias: i32,
}

/// Bits by kind of one segment.
#[derive(Clone, Copy, Debug, Default)]
pub struct Account {
    /// Splits.
    pub splits: SegmentBits,
    /// Births.
    pub points: f64,
}

/// Code one segment: its head, its splits, its new_vertices, its low bits.
///
/// Encoding, `batch` comes with `alpha` and `new_vertices` set, and leaves with the splits and low bits of the segment. Decoding it comes
/// empty.
///
/// # Errors
/// [`InvalidStream`] from a decoder whose stream contradicts the header or itself.
pub fn code_segment<C: Coder, S: Source>(
    coder: &mut C,
    state: &mut State,
    scratch: &mut Scratch,
    task: &Task,
    source: &mut S,
    batch: &mut Batch,
    account: &mut Account,
) -> Result<(), InvalidStream> {
    batch.shift = task.shift;
    batch.attributes.layers.resize_with(task.view.scheme.widths.len(), Default::default);
    if task.first {
        let changed = coder.bit(&mut state.same_alpha, batch.alpha != state.alpha);
        if changed {
            state.alpha = coder.bypass(8, batch.alpha as u32) as u8;
        }
        batch.alpha = state.alpha;
    }
    let mut budget = task.more.1;
    let range = task.range.0..task.range.1;
    code_splits(
        coder,
        &mut state.models,
        scratch,
        &task.view,
        range.clone(),
        source,
        batch,
        task.room,
        task.wedges,
        &mut budget,
        task.bias,
        &mut account.splits,
    )?;
    if task.first {
        let start = coder.bits();
        let count = exp_golomb(coder, &mut state.new_vertices.0, batch.new_vertices.len() as u32);
        if count as u64 > task.more.0 {
            return Err(InvalidStream("more new_vertices than the header announces"));
        }
        code_points(coder, &mut batch.new_vertices, count as usize);
        source.new_vertices(&batch.new_vertices);
        account.points += coder.bits() - start;
    }
    let up = task.view.level.shift - task.shift;
    if up > 0 {
        if up > 16 {
            return Err(InvalidStream("a jump of precision beyond 16 bits"));
        }
        let start = coder.bits();
        let mut splits = batch.vertex.iter().peekable();
        for v in range {
            let twice = splits.next_if_eq(&&v).is_some();
            for child in 0..1 + twice as u32 {
                let low = source.low_bits(v, child);
                batch.low_bits.push(low.map(|c| coder.bypass(up as u32, c as u32) as u16));
            }
        }
        account.splits.geometry += coder.bits() - start;
        let start = coder.bits();
        for k in 0..batch.new_vertices.len() as u32 {
            let low = source.new_vertex_low_bits(k);
            batch.low_bits.push(low.map(|c| coder.bypass(up as u32, c as u32) as u16));
        }
        account.points += coder.bits() - start;
    }
    Ok(())
}

/// Put the segments of a batch together. Low bits of the new_vertices, which the first segment holds, go to the end.
pub fn join(parts: Vec<Batch>, level: &Level, widths: &[usize]) -> Batch {
    let mut parts = parts.into_iter();
    let Some(mut batch) = parts.next() else { return Batch::default() };
    let new_vertices = if batch.shift < level.shift { batch.new_vertices.len() } else { 0 };
    let tail = batch.low_bits.split_off(batch.low_bits.len() - new_vertices);
    batch.reserve(parts.as_slice());
    for part in parts {
        batch.append(&part, widths);
    }
    batch.low_bits.extend(tail);
    batch
}
