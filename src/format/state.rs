//! The state of a level, which encoder and decoder advance batch by batch: what is coded next depends on nothing else.
//!
//! A chunk of small levels holds one coder that runs through all of them. A large level has one chunk for each segment, each with a
//! coder of its own that starts with the models as the first segment of the coarser level's batch left them (core paper
//! section 5; Qin 2002 for batches without order; `docs/format/levels.md` for segments).
//!
//! Invariant: [`LevelState::advance`] checks all there is to check before the finer level replaces the coarser one.

use crate::format::coder::InvalidStream;
use crate::format::coder::range::Coder;
use crate::format::complex::{
    Attributes, Batch, Faces, Level, NONE, Scheme, Side, Star, Wanted, refine, refine_attributes, touched,
};
use crate::format::segment::{Coded, Given, ModelState, Scratch, SegmentTask, code_segment};
use crate::format::split::neighbourhood::LevelGeometry;
use crate::parallel;
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
    let end = |s: usize| (vertices as u64 * s as u64 / of as u64) as u32;
    end(s)..end(s + 1)
}

/// A level, and what the finer one is worked out from.
#[derive(Clone, Debug)]
pub struct LevelState {
    /// Positions and elements.
    pub level: Level,
    /// Its attributes.
    pub attributes: Attributes,
    /// For each vertex its vertex in the level before; [`NONE`] for a new vertex.
    pub parents: Vec<u32>,
    /// The elements around each vertex, once [`LevelState::prepare`] was called.
    star: Option<Star>,
    /// Where they begin, if that is known.
    star_start: Vec<u32>,
}

impl Default for LevelState {
    fn default() -> Self {
        let level = Level { positions: Vec::new(), faces: Faces::new(), shift: 0 };
        LevelState::base(level, Attributes::default())
    }
}

/// What is the same for all segments of a batch.
#[derive(Clone, Debug, Default)]
pub struct BatchPlan {
    /// Vertices, and elements, that the header says the finer level has more; as many as there can be for an encoder.
    pub growth: (u64, u64),
    /// The same for the wedges of each layer; empty for an encoder.
    pub wedge_growth: Vec<u64>,
    /// The shift of the finer level.
    pub shift: u8,
    /// The rounding of midpoints, 0 or 1.
    pub bias: i32,
}

/// A segment on its way through a coder.
pub struct Segment<'a, C> {
    /// The coder of its chunk.
    pub coder: C,
    /// What an encoder has to say; a decoder has nothing.
    pub given: Option<Given<'a>>,
}

/// A segment that is coded, its splits taken out.
pub struct CodedSegment<C> {
    /// The coder of its chunk.
    pub coder: C,
    /// What is left of it beside its batch.
    pub coded: Coded,
    /// New wedges of each layer.
    pub new_wedges: Vec<u32>,
}

/// Counts of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Vertices.
    pub vertices: u64,
    /// Elements.
    pub elements: u64,
    /// Corners.
    pub corners: u64,
}

impl LevelState {
    /// The coarsest level.
    pub fn base(level: Level, attributes: Attributes) -> Self {
        let parents = vec![NONE; level.positions.len()];
        LevelState { level, attributes, parents, star: None, star_start: Vec::new() }
    }

    /// Find the elements around each vertex, which coding and refining ask for. Not done where nothing finer is wanted.
    pub fn prepare(&mut self) {
        if self.star.is_none() {
            let start = std::mem::take(&mut self.star_start);
            let vertices = self.level.positions.len();
            self.star = Some(if start.len() == vertices + 1 {
                Star::fill(start, &self.level.faces, true)
            } else {
                Star::with_next(vertices, &self.level.faces)
            });
        }
    }

    /// The elements around `v`, of a level that was prepared.
    pub fn around(&self, v: u32) -> &[u32] {
        self.star.as_ref().map_or(&[], |star| star.get(v))
    }

    /// Counts of the level.
    pub fn counts(&self) -> Counts {
        Counts {
            vertices: self.level.positions.len() as u64,
            elements: self.level.faces.len() as u64,
            corners: self.level.faces.corners.len() as u64,
        }
    }

    /// Counts of the level that `batch` leads to.
    pub fn counts_after(&self, batch: &Batch) -> Counts {
        let Counts { vertices, elements, corners } = self.counts();
        let inserted = batch.triangles.len() as u64 + batch.edges.iter().map(|&e| e as u64).sum::<u64>();
        let grown = batch.sides.iter().filter(|&&s| matches!(s, Side::Grow12 | Side::Grow21)).count() as u64;
        Counts {
            vertices: vertices + batch.len() as u64 + batch.new_vertices.len() as u64,
            elements: elements + inserted,
            corners: corners + grown + 2 * inserted + batch.triangles.len() as u64,
        }
    }

    /// How many wedges layer `l` has after `batch`.
    pub fn wedges_after(&self, batch: &Batch, l: usize) -> u64 {
        let layer = &self.attributes.layers[l];
        let new = batch.attributes.layers.get(l).map_or(0, |b| b.fresh.len() / layer.width.max(1));
        (layer.len() + new) as u64
    }

    /// Code the batch that leads to the finer level, segment by segment, side by side if there are several. There is one segment, or
    /// [`segments`] of them; `state` becomes what the first one leaves.
    ///
    /// # Errors
    /// [`InvalidStream`] from a decoder whose stream contradicts the header or itself.
    pub fn code_batch<C: Coder + Send>(
        &mut self,
        scheme: &Scheme,
        state: &mut ModelState,
        scratch: &mut Scratch,
        plan: &BatchPlan,
        segments: Vec<Segment<C>>,
    ) -> Result<(Batch, Vec<CodedSegment<C>>), InvalidStream> {
        self.prepare();
        let none = Star::default();
        let star = self.star.as_ref().unwrap_or(&none);
        let view = LevelGeometry::with(&self.level, star, &self.attributes, scheme);
        let (vertices, of) = (self.level.positions.len(), segments.len());
        // Segments are coded side by side: what they list together is held to the header's count.
        let element_budget = AtomicU64::new(plan.growth.1);
        let wedge_budget: Vec<AtomicU64> = plan.wedge_growth.iter().map(|&n| AtomicU64::new(n)).collect();
        let task = |k: usize| {
            let range = segment_range(vertices, k, of);
            SegmentTask {
                view,
                range: (range.start, range.end),
                first: k == 0,
                growth: plan.growth,
                element_budget: &element_budget,
                wedge_budget: &wedge_budget,
                shift: plan.shift,
                bias: plan.bias,
            }
        };
        let mut parts = Vec::with_capacity(of);
        if of == 1 {
            for Segment { mut coder, given } in segments {
                let coded = code_segment(&mut coder, state, scratch, &task(0), given.as_ref())?;
                parts.push((coder, coded));
            }
        } else {
            let before = &*state;
            let coded = parallel::map(segments.into_iter().enumerate().collect(), |(k, segment)| {
                let Segment { mut coder, given } = segment;
                let (mut models, mut scratch) = (before.clone(), Scratch::default());
                let coded = code_segment(&mut coder, &mut models, &mut scratch, &task(k), given.as_ref())?;
                if coder.overrun() {
                    return Err(InvalidStream("a segment that ends too early"));
                }
                Ok((coder, coded, (k == 0).then_some(models)))
            });
            let mut after = None;
            for part in coded {
                let (coder, coded, models) = part?;
                after = after.or(models);
                parts.push((coder, coded));
            }
            if let Some(after) = after {
                *state = after;
            }
        }
        let mut batches = Vec::with_capacity(of);
        let coded = parts
            .into_iter()
            .map(|(coder, mut coded)| {
                let batch = std::mem::take(&mut coded.batch);
                let new_wedges = new_wedges(&batch, scheme);
                batches.push(batch);
                CodedSegment { coder, coded, new_wedges }
            })
            .collect();
        Ok((join(batches, &self.level, &scheme.widths), coded))
    }

    /// Go to the finer level, unless `accept`, which sees it first, refuses it; then nothing has changed. `batch` has been checked
    /// against the level's counts. `origins` asks for where elements come from ([`crate::format::complex::Refined::element`]),
    /// `last` says that nothing finer will be wanted.
    ///
    /// # Errors
    /// [`InvalidStream`] where two splits share an element, or what `accept` says.
    pub fn advance<E: From<InvalidStream>>(
        &mut self,
        scheme: &Scheme,
        batch: &Batch,
        bias: i32,
        origins: bool,
        last: bool,
        accept: impl FnOnce(&Level) -> Result<(), E>,
    ) -> Result<Vec<u32>, E> {
        self.prepare();
        let bare = scheme.is_empty();
        let star = self.star.take().unwrap_or_default();
        let touched = if bare { Vec::new() } else { touched(&self.level.faces, &star, batch) };
        let mut fine = refine(&self.level, star, batch, bias, Wanted { star: !last, element: origins || !bare });
        if fine.conflict {
            return Err(InvalidStream("two splits that share an element").into());
        }
        accept(&fine.level)?;
        if !bare {
            let coarse = std::mem::take(&mut self.attributes);
            self.attributes = refine_attributes(coarse, &self.level.faces, &touched, batch, &fine);
        }
        self.star_start = std::mem::take(&mut fine.star_start);
        self.level = fine.level;
        self.parents = fine.parent;
        Ok(fine.element)
    }
}

/// How many wedges a segment adds to each layer.
fn new_wedges(part: &Batch, scheme: &Scheme) -> Vec<u32> {
    part.attributes.layers.iter().zip(&scheme.widths).map(|(l, &w)| (l.fresh.len() / w.max(1)) as u32).collect()
}

/// Put the segments of a batch together. Low bits of the new vertices, which the first segment holds, go to the end.
fn join(parts: Vec<Batch>, level: &Level, widths: &[usize]) -> Batch {
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
