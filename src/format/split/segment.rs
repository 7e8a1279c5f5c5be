//! A segment of a batch: the splits of a range of the coarser level's vertices, symbol by symbol.
//!
//! Core paper section 5.1 and Qin 2002: which vertices split, in the canonical order of the level, skipping those next to one
//! that already splits. A segment's symbols depend on the coarser level and on the segment's own earlier symbols only.

use crate::format::attributes::{AttributeModels, AttributeScratch, AttributeSource, Scheme, code_attributes};
use crate::format::coder::range::{Bit, Coder};
use crate::format::complex::{Batch, Split};
use crate::format::split::connectivity::{ConnectivityModels, ConnectivityScratch, code_connectivity};
use crate::format::split::neighbourhood::{LevelGeometry, Neighbourhood};
use crate::format::split::vector::{VectorModels, code_delta};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// All adaptive models of a stream of splits. A level's segments start with the models that the first segment of
/// the coarser level's batch ended with.
#[derive(Clone, Debug, Default)]
pub struct Models {
    flags: Flags,
    /// Connectivity.
    pub cut: ConnectivityModels,
    spread: VectorModels,
    attributes: AttributeModels,
}

impl Models {
    /// Models for a file whose attributes are those of `scheme`.
    pub fn new(scheme: &Scheme) -> Self {
        Models { attributes: AttributeModels::new(scheme), ..Models::default() }
    }
}

#[derive(Clone, Debug)]
struct Flags {
    split: Vec<Bit>,
}

const VALENCES: usize = 12;
const LENGTHS: usize = 10;
const NEIGHBOURS: usize = 4;

impl Default for Flags {
    fn default() -> Self {
        Flags { split: vec![Bit::with(14000); VALENCES * LENGTHS * NEIGHBOURS + 1] }
    }
}

impl Flags {
    /// Elements at the vertex, length of its edges over the mean of the level, and elements at its neighbours.
    #[inline]
    fn context(view: &LevelGeometry, patch: &Neighbourhood) -> usize {
        let n = patch.elements;
        if n == 0 {
            return VALENCES * LENGTHS * NEIGHBOURS;
        }
        let (long, near) = (patch.long(view), patch.near());
        ((n.min(VALENCES) - 1) * LENGTHS + long) * NEIGHBOURS + near
    }
}

/// Buffers reused from vertex to vertex and from segment to segment.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    patch: Neighbourhood,
    cut: ConnectivityScratch,
    split: Split,
    blocked: Vec<bool>,
    attributes: AttributeScratch,
}

/// Bits by kind of one segment.
#[derive(Clone, Copy, Debug, Default)]
pub struct SegmentBits {
    /// Which vertices split, and how.
    pub connectivity: f64,
    /// Where the children lie, and low bits.
    pub geometry: f64,
    /// Labels, wedges and their values.
    pub attributes: f64,
}

/// A stream that makes no sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InvalidStream(pub &'static str);

/// Where an encoder's symbols come from. A decoder has none: [`Stream`].
pub trait Source: AttributeSource {
    /// Whether `v` splits: fills `split`, with a side for each element of the star, and returns `v1 − v2`.
    fn split(&mut self, v: u32, split: &mut Split) -> Option<[i32; 3]>;
    /// Hears the canonical form of the split that was asked for last, and whether the children changed places.
    fn settled(&mut self, split: &Split, swapped: bool);
    /// Hears the canonical order of the new_vertices.
    fn new_vertices(&mut self, new_vertices: &[[i32; 3]]);
    /// Low bits of a child of `v` (0 also for a vertex that does not split).
    fn low_bits(&mut self, v: u32, child: u32) -> [u16; 3];
    /// Low bits of a new_vertex.
    fn new_vertex_low_bits(&mut self, new_vertex: u32) -> [u16; 3];
}

/// The source of a decoder: everything is in the stream.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stream;

impl AttributeSource for Stream {}

impl Source for Stream {
    fn split(&mut self, _: u32, _: &mut Split) -> Option<[i32; 3]> {
        None
    }
    fn settled(&mut self, _: &Split, _: bool) {}
    fn new_vertices(&mut self, _: &[[i32; 3]]) {}
    fn low_bits(&mut self, _: u32, _: u32) -> [u16; 3] {
        [0; 3]
    }
    fn new_vertex_low_bits(&mut self, _: u32) -> [u16; 3] {
        [0; 3]
    }
}

/// Code the splits of the coarser level's vertices `range`, appending them to `batch`; `budget` is the number of elements that
/// may still appear, `room` that of [`code_connectivity`], `wedges` that of [`code_attributes`].
#[allow(clippy::too_many_arguments)]
pub fn code_splits<C: Coder, S: Source>(
    coder: &mut C,
    m: &mut Models,
    scratch: &mut Scratch,
    view: &LevelGeometry,
    range: std::ops::Range<u32>,
    source: &mut S,
    batch: &mut Batch,
    room: &AtomicU64,
    wedges: &[AtomicU64],
    budget: &mut u64,
    bias: i32,
    bits: &mut SegmentBits,
) -> Result<(), InvalidStream> {
    let Scratch { patch, cut, split, blocked, attributes } = scratch;
    blocked.clear();
    blocked.resize(range.len(), false);
    let positions = &view.level.positions;
    for v in range.clone() {
        if blocked[(v - range.start) as usize] {
            continue;
        }
        // Behind its end a stream is all zeros: no reason to go on for as long as the header likes.
        if coder.overrun() {
            return Err(InvalidStream("a segment that ends too early"));
        }
        let start = coder.bits();
        patch.survey(view, v);
        let mut delta = if C::DECODING { None } else { source.split(v, split) };
        let flag = &mut m.flags.split[Flags::context(view, patch)];
        if !coder.bit(flag, delta.is_some()) {
            bits.connectivity += coder.bits() - start;
            continue;
        }
        patch.order(view);
        let swap = code_connectivity(coder, &mut m.cut, cut, view, patch, split, room)
            .ok_or(InvalidStream("a split without a form, or more elements than the header announces"))?;
        source.settled(split, swap);
        if swap {
            delta = delta.map(|d| d.map(|c| -c));
        }
        let inserted = split.triangles.len() as u64 + split.edges as u64;
        *budget = budget.checked_sub(inserted).ok_or(InvalidStream("more elements than the header announces"))?;
        let mid = coder.bits();
        let delta = code_delta(coder, &mut m.spread, positions, patch, split, delta.unwrap_or_default());
        if delta.iter().any(|c| c.unsigned_abs() > 1 << 27) {
            return Err(InvalidStream("a split of impossible size"));
        }
        bits.connectivity += mid - start;
        let end = coder.bits();
        bits.geometry += end - mid;
        batch.push(v, split, delta);
        if !view.scheme.is_empty() {
            // With attributes an edge that appears is more than a count.
            if C::DECODING && room.fetch_update(Relaxed, Relaxed, |r| r.checked_sub(split.edges as u64)).is_err() {
                return Err(InvalidStream("more elements than the header announces"));
            }
            let (m, out) = (&mut m.attributes, &mut batch.attributes);
            code_attributes(coder, m, attributes, view, patch, split, delta, bias, wedges, source, out)?;
            bits.attributes += coder.bits() - end;
        }
        for &f in view.star.get(v) {
            for &x in view.level.faces.get(f) {
                if range.contains(&x) {
                    blocked[(x - range.start) as usize] = true;
                }
            }
        }
    }
    Ok(())
}
