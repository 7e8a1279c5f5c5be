//! A segment of a batch, symbol by symbol: its head, the splits of a range of the coarser level's vertices, new vertices, low bits.
//!
//! Core paper section 5.1 and Qin 2002: which vertices split, in the canonical order of the level, skipping those next to one
//! that already splits. A segment's symbols depend on the coarser level and on the segment's own earlier symbols only.

use crate::format::attributes::{
    AttributeModels, AttributeScratch, GivenAttributes, GivenSplit, Named, SplitTask, code_attributes,
};
use crate::format::coder::InvalidStream;
use crate::format::coder::range::{Bit, Coder, exp_golomb};
use crate::format::complex::{Batch, Scheme, Split};
use crate::format::points::code_points;
use crate::format::split::connectivity::{ConnectivityModels, ConnectivityScratch, code_connectivity};
use crate::format::split::neighbourhood::{LevelGeometry, Neighbourhood};
use crate::format::split::vector::{VectorModels, code_delta};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// All adaptive models of a stream of splits. A level's segments start with the models that the first segment of
/// the coarser level's batch ended with.
#[derive(Clone, Debug, Default)]
pub struct Models {
    flags: Flags,
    connectivity: ConnectivityModels,
    vector: VectorModels,
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
    connectivity: ConnectivityScratch,
    split: Split,
    blocked: Vec<bool>,
    attributes: AttributeScratch,
}

/// What runs through the segments of a file beside the models of splits.
#[derive(Clone, Debug, Default)]
pub struct ModelState {
    /// Models of splits.
    pub models: Models,
    alpha: u8,
    same_alpha: Bit,
    new_vertices: NewVertexModels,
}

impl ModelState {
    /// The state at the beginning of a file whose attributes are those of `scheme`.
    pub fn new(scheme: &Scheme) -> Self {
        ModelState { models: Models::new(scheme), ..ModelState::default() }
    }
}

#[derive(Clone, Debug)]
struct NewVertexModels([Bit; 64]);

impl Default for NewVertexModels {
    fn default() -> Self {
        NewVertexModels([Bit::with(20000); 64])
    }
}

/// What a segment is part of.
#[derive(Clone, Copy, Debug)]
pub struct SegmentTask<'a> {
    /// The coarser level.
    pub view: LevelGeometry<'a>,
    /// The vertices of the segment.
    pub range: (u32, u32),
    /// Whether it is the first segment of its batch, which tells the placement and the new vertices.
    pub first: bool,
    /// Vertices, and elements, that the header says the finer level has more.
    pub growth: (u64, u64),
    /// Elements that all segments of the batch may still list on the general road; a decoder begins with `growth.1`.
    pub element_budget: &'a AtomicU64,
    /// Wedges that each layer may still gain in all segments of the batch; empty for an encoder.
    pub wedge_budget: &'a [AtomicU64],
    /// The shift of the finer level.
    pub shift: u8,
    /// The rounding of midpoints, 0 or 1.
    pub bias: i32,
}

/// What an encoder has to say in a segment; a decoder has nothing.
#[derive(Clone, Debug, Default)]
pub struct Given<'a> {
    /// The splits of the segment's vertices, which share no element. The children of each, its triangles and its dangling edges
    /// come in any order. In the first segment also the new vertices, in canonical order, and the placement.
    pub batch: Batch,
    /// Their attributes.
    pub attributes: GivenAttributes<'a>,
    /// Where the shift falls, for each vertex of the segment the bits that its children gain; its own come first if it stays.
    pub low_bits: Vec<[[u16; 3]; 2]>,
    /// The same for the new vertices.
    pub new_low_bits: Vec<[u16; 3]>,
}

/// What becomes of a segment.
#[derive(Clone, Debug, Default)]
pub struct Coded {
    /// Its splits, in canonical form.
    pub batch: Batch,
    /// For an encoder, whether the children of each split changed places.
    pub swapped: Vec<bool>,
    /// For an encoder, which wedge stands for which key at the finer level.
    pub named: Named,
    /// Bits by kind.
    pub account: Account,
}

/// Bits by kind.
#[derive(Clone, Copy, Debug, Default)]
pub struct Account {
    /// Which vertices split, and how.
    pub connectivity: f64,
    /// Where the children lie, and low bits.
    pub geometry: f64,
    /// Labels, wedges and their values.
    pub attributes: f64,
    /// New vertices.
    pub points: f64,
}

impl Account {
    /// Add another's bits.
    pub fn add(&mut self, other: &Account) {
        self.connectivity += other.connectivity;
        self.geometry += other.geometry;
        self.attributes += other.attributes;
        self.points += other.points;
    }
}

/// Code one segment. `given` is what an encoder says; a decoder has none.
///
/// # Errors
/// [`InvalidStream`] from a decoder whose stream contradicts the header or itself, or from an encoder whose splits share elements.
pub fn code_segment<C: Coder>(
    coder: &mut C,
    state: &mut ModelState,
    scratch: &mut Scratch,
    task: &SegmentTask,
    given: Option<&Given>,
) -> Result<Coded, InvalidStream> {
    let mut coded = Coded::default();
    let batch = &mut coded.batch;
    batch.shift = task.shift;
    batch.attributes.layers.resize_with(task.view.scheme.widths.len(), Default::default);
    if task.first {
        let alpha = given.map_or(0, |g| g.batch.alpha);
        if coder.bit(&mut state.same_alpha, alpha != state.alpha) {
            state.alpha = coder.bypass(8, alpha as u32) as u8;
        }
        batch.alpha = state.alpha;
    }
    code_splits(coder, &mut state.models, scratch, task, given, &mut coded)?;
    if task.first {
        let start = coder.bits();
        let new_vertices = given.map_or(&[][..], |g| &g.batch.new_vertices);
        let count = exp_golomb(coder, &mut state.new_vertices.0, new_vertices.len() as u32);
        if count as u64 > task.growth.0 {
            return Err(InvalidStream("more new vertices than the header announces"));
        }
        coded.batch.new_vertices.extend_from_slice(new_vertices);
        code_points(coder, &mut coded.batch.new_vertices, count as usize);
        coded.account.points += coder.bits() - start;
    }
    let up = task.view.level.shift - task.shift;
    if up > 0 {
        if up > 16 {
            return Err(InvalidStream("a jump of precision beyond 16 bits"));
        }
        code_low_bits(coder, up as u32, task, given, &mut coded);
    }
    Ok(coded)
}

/// The bits that the vertices of the finer level gain: children in the order of their parents, then new vertices.
fn code_low_bits<C: Coder>(coder: &mut C, up: u32, task: &SegmentTask, given: Option<&Given>, coded: &mut Coded) {
    let start = coder.bits();
    let mut splits = coded.batch.vertex.iter().enumerate().peekable();
    for (k, v) in (task.range.0..task.range.1).enumerate() {
        let split = splits.next_if(|s| *s.1 == v).map(|s| s.0);
        let [mut one, mut two] = given.and_then(|g| g.low_bits.get(k)).copied().unwrap_or_default();
        if split.is_some_and(|i| coded.swapped.get(i) == Some(&true)) {
            (one, two) = (two, one);
        }
        coded.batch.low_bits.push(one.map(|c| coder.bypass(up, c as u32) as u16));
        if split.is_some() {
            coded.batch.low_bits.push(two.map(|c| coder.bypass(up, c as u32) as u16));
        }
    }
    coded.account.geometry += coder.bits() - start;
    let start = coder.bits();
    for k in 0..coded.batch.new_vertices.len() {
        let low = given.and_then(|g| g.new_low_bits.get(k)).copied().unwrap_or_default();
        coded.batch.low_bits.push(low.map(|c| coder.bypass(up, c as u32) as u16));
    }
    coded.account.points += coder.bits() - start;
}

/// Where an encoder's next split stands in what it has given.
#[derive(Clone, Copy, Debug, Default)]
struct Cursor {
    split: usize,
    /// Elements that the splits before it insert.
    inserted: usize,
}

impl Cursor {
    /// Whether `v` splits; then `split` is how.
    fn split(&self, given: &Given, v: u32, split: &mut Split) -> Option<[i32; 3]> {
        let (batch, i) = (&given.batch, self.split);
        if batch.vertex.get(i) != Some(&v) {
            return None;
        }
        split.sides.clear();
        split.sides.extend_from_slice(batch.sides_of(i));
        split.triangles.clear();
        split.triangles.extend_from_slice(batch.triangles_of(i));
        split.edges = batch.edges[i];
        Some(batch.delta[i])
    }

    /// Its attributes.
    fn attributes<'g>(&self, given: &'g Given, swapped: bool) -> GivenSplit<'g> {
        let (batch, i) = (&given.batch, self.split);
        GivenSplit {
            attributes: &given.attributes,
            side: batch.side_start[i] as usize,
            inserted: self.inserted,
            triangles: batch.triangles_of(i),
            swapped,
        }
    }

    fn advance(&mut self, given: &Given) {
        self.inserted += given.batch.triangles_of(self.split).len() + given.batch.edges[self.split] as usize;
        self.split += 1;
    }
}

/// Code the splits of the segment's vertices.
fn code_splits<C: Coder>(
    coder: &mut C,
    m: &mut Models,
    scratch: &mut Scratch,
    task: &SegmentTask,
    given: Option<&Given>,
    coded: &mut Coded,
) -> Result<(), InvalidStream> {
    const TOO_MANY: InvalidStream = InvalidStream("more elements than the header announces");
    let Scratch { patch, connectivity, split, blocked, attributes } = scratch;
    let Coded { batch, swapped, named, account } = coded;
    let SegmentTask { view, element_budget, .. } = task;
    let range = task.range.0..task.range.1;
    let mut cursor = Cursor::default();
    // Elements that may still appear in this segment.
    let mut left = task.growth.1;
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
        let mut delta = given.and_then(|given| cursor.split(given, v, split));
        let flag = &mut m.flags.split[Flags::context(view, patch)];
        if !coder.bit(flag, delta.is_some()) {
            account.connectivity += coder.bits() - start;
            continue;
        }
        patch.order(view);
        let swap = code_connectivity(coder, &mut m.connectivity, connectivity, view, patch, split, element_budget)
            .ok_or(InvalidStream("a split without a form, or more elements than the header announces"))?;
        if swap {
            delta = delta.map(|d| d.map(|c| -c));
        }
        let inserted = split.triangles.len() as u64 + split.edges as u64;
        left = left.checked_sub(inserted).ok_or(TOO_MANY)?;
        let mid = coder.bits();
        let delta = code_delta(coder, &mut m.vector, positions, patch, split, delta.unwrap_or_default());
        if delta.iter().any(|c| c.unsigned_abs() > 1 << 27) {
            return Err(InvalidStream("a split of impossible size"));
        }
        account.connectivity += mid - start;
        let end = coder.bits();
        account.geometry += end - mid;
        batch.push(v, split, delta);
        if !view.scheme.is_empty() {
            // With attributes an edge that appears is more than a count.
            let edges = split.edges as u64;
            if C::DECODING && element_budget.fetch_update(Relaxed, Relaxed, |r| r.checked_sub(edges)).is_err() {
                return Err(TOO_MANY);
            }
            let given = given.map(|given| cursor.attributes(given, swap));
            let (bias, wedge_budget) = (task.bias, task.wedge_budget);
            let task = SplitTask { view, patch, split, delta, bias, wedge_budget, given };
            code_attributes(coder, &mut m.attributes, attributes, &task, named, &mut batch.attributes)?;
            account.attributes += coder.bits() - end;
        }
        if let Some(given) = given {
            swapped.push(swap);
            cursor.advance(given);
        }
        for &f in view.star.get(v) {
            for &x in view.level.faces.get(f) {
                if range.contains(&x) {
                    blocked[(x - range.start) as usize] = true;
                }
            }
        }
    }
    if given.is_some_and(|given| cursor.split < given.batch.len()) {
        return Err(InvalidStream("two splits that share an element"));
    }
    Ok(())
}
