//! The loop: weigh, select, collapse, until nothing is left to collapse.
//!
//! Core paper section 3 and 4.3. Weights read positions that are never rounded (the merged vertex at the true midpoint), so that deferred
//! precision does not blur the choice; the integer level is what the decoder will have.
//!
//! Where a device weighs, the processor bounds the error of the batch before (which nothing but the next bounds reads) and
//! makes its record meanwhile; otherwise one follows the other, and the finer level is let go first.

use super::error::bound_errors;
use super::history::{History, StoredBatch};
use super::select::{SelectInput, SelectOptions, select};
use super::wedges::collapse_wedges;
use crate::encode::cost::{Carried, Engine, Fixed, SeamInput, WeighInput, Weigher, add_seams, dirty_vertices};
use crate::encode::trace::Trace;
use crate::format::complex::{Attributes, Coarsened, Level, NONE, Placement, Star, coarsen};
use crate::format::split::neighbourhood::mean_edge;
use std::time::Instant;

/// What the simplification is told.
#[derive(Clone, Debug, PartialEq)]
pub struct SimplifyOptions {
    /// Never move a border vertex.
    pub lock_borders: bool,
    /// Threshold of a batch over the mean weight, in 1/256.
    pub factor: u32,
    /// Curvature compensation in 1/256, for levels of at most `alpha_share` of the vertices.
    pub alpha: u8,
    /// See `alpha`, in 1/256.
    pub alpha_share: u32,
    /// Deferred precision: the mean edge has about this many steps of a level, where the level has at most an eighth of the vertices.
    pub edge_steps: u32,
    /// The same on finer levels.
    pub fine_edge_steps: u32,
    /// Layers whose seams weights protect (texture coordinates); labels always count.
    pub seams: Vec<usize>,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        SimplifyOptions {
            lock_borders: false,
            factor: 384,
            alpha: 20,
            alpha_share: 26,
            edge_steps: 32,
            fine_edge_steps: 128,
            seams: Vec::new(),
        }
    }
}

/// Isolated vertices up to this many stay; of more, one in eight.
const FEW: usize = 32;

/// Simplify `level`, whose wedges are numbered by `attributes`, down to its base, on the processor. `progress` hears how
/// many vertices are left, and says whether to go on.
pub fn simplify(
    level: Level,
    attributes: Attributes,
    options: &SimplifyOptions,
    progress: &(dyn Fn(u64) -> bool + Sync),
) -> History {
    simplify_on(level, attributes, options, Engine::default(), progress)
}

/// The same with somebody who weighs. If that one fails, the processor goes on; [`History::fallback`] tells.
pub fn simplify_on(
    level: Level,
    attributes: Attributes,
    options: &SimplifyOptions,
    engine: Engine,
    progress: &(dyn Fn(u64) -> bool + Sync),
) -> History {
    let mut simplifier = Simplifier::new(level, attributes, options, engine);
    loop {
        simplifier.weigh();
        let batch = simplifier.select();
        if batch.edges.is_empty() && batch.leaving.is_empty() {
            break;
        }
        simplifier.collapse(&batch);
        if !progress(simplifier.history.base.positions.len() as u64) {
            simplifier.history.cancelled = true;
            break;
        }
    }
    simplifier.finish()
}

/// What goes between one level and the next coarser one.
struct Selected {
    /// The edges that collapse, independent, in increasing order.
    edges: Vec<[u32; 2]>,
    /// Isolated vertices that leave.
    leaving: Vec<u32>,
}

/// A level on its way down.
struct Simplifier<'a> {
    options: &'a SimplifyOptions,
    trace: Trace,
    /// Vertices of the full level.
    total: usize,
    /// What positions are relative to, so that `f32` is precise.
    anchor: [i32; 3],
    weigher: Weigher,
    /// Positions of the level at hand without rounding, relative to `anchor`.
    exact: Vec<[f32; 3]>,
    star: Star,
    /// Vertices that must not move.
    locked: Option<Vec<bool>>,
    /// The bound of the error at each vertex, in steps.
    error: Vec<f32>,
    /// The level at hand, `base`, and what led to it.
    history: History,
    /// Whether the level at hand was weighed beside the batch before.
    weighed_already: bool,
    /// Where the level's vertices were in the finer one, and which of them have new edges.
    carried: Option<(Vec<u32>, Vec<bool>)>,
}

impl<'a> Simplifier<'a> {
    fn new(level: Level, attributes: Attributes, options: &'a SimplifyOptions, engine: Engine) -> Self {
        let total = level.positions.len();
        let (anchor, diagonal) = frame(&level.positions);
        let Engine { evaluator, trace } = engine;
        let star = Star::build(total, &level.faces);
        Simplifier {
            options,
            total,
            anchor,
            exact: level.positions.iter().map(|p| std::array::from_fn(|k| (p[k] - anchor[k]) as f32)).collect(),
            locked: options.lock_borders.then(|| border_vertices(&level, &star)),
            star,
            error: vec![0f32; total],
            history: History {
                vertex_slot: (0..total as u32).collect(),
                face_slot: (0..level.faces.len() as u32).collect(),
                base: level,
                labels: attributes.labels.clone(),
                attributes,
                batches: Vec::new(),
                edges_weighed: 0,
                seconds: [0.0; 3],
                weighed_by: evaluator.name(),
                fallback: None,
                cancelled: false,
            },
            weigher: Weigher::with(diagonal, evaluator, trace.clone()),
            trace,
            weighed_already: false,
            carried: None,
        }
    }

    /// Weigh the edges of the level, unless that was done beside the batch before.
    fn weigh(&mut self) {
        let clock = Instant::now();
        if !self.weighed_already {
            let input = WeighInput {
                faces: &self.history.base.faces,
                star: &self.star,
                positions: &self.exact,
                locked: self.locked.as_deref(),
            };
            self.weigher.weigh(input, self.carried.as_ref().map(|(old, dirty)| Carried { old_of_new: old, dirty }));
        }
        self.history.seconds[0] += clock.elapsed().as_secs_f64();
    }

    /// The weights with what collapses do to seams, where there are any to protect.
    fn weights_with_seams(&self) -> Option<Vec<Fixed>> {
        let attributes = &self.history.attributes;
        if self.options.seams.is_empty() && attributes.labels.is_empty() {
            return None;
        }
        let _span = self.trace.span("loop", "add seams");
        let mut weights = self.weigher.weights().to_vec();
        let (faces, layers) = (&self.history.base.faces, &self.options.seams[..]);
        let input = SeamInput { faces, star: &self.star, positions: &self.exact, attributes, layers };
        add_seams(&input, self.weigher.edges(), &self.weigher.scale(), &mut weights);
        Some(weights)
    }

    /// The independent set of edges that collapses, and the isolated vertices that leave.
    fn select(&mut self) -> Selected {
        let clock = Instant::now();
        let seamed = self.weights_with_seams();
        let selecting = Instant::now();
        let _span = self.trace.span("loop", "select");
        let (level, slots) = (&self.history.base, &self.history.vertex_slot);
        let options = SelectOptions {
            factor: self.options.factor,
            least: 1 + level.positions.len() / 128,
            ..SelectOptions::default()
        };
        let chosen = select(
            SelectInput {
                faces: &level.faces,
                star: &self.star,
                edges: self.weigher.edges(),
                weights: seamed.as_deref().unwrap_or(self.weigher.weights()),
                slots,
            },
            &options,
        );
        let mut edges: Vec<[u32; 2]> = chosen.iter().map(|&e| self.weigher.edges().ends(e).into()).collect();
        edges.sort_unstable();
        let leaving = leaving(&self.star, slots, edges.is_empty());
        self.history.seconds[0] += (selecting - clock).as_secs_f64();
        self.history.seconds[1] += selecting.elapsed().as_secs_f64();
        Selected { edges, leaving }
    }

    /// Where merged vertices lie, and the precision of the coarser level.
    fn placement(&self, collapses: usize) -> Placement {
        let (options, level) = (self.options, &self.history.base);
        let (n, total) = (level.positions.len(), self.total);
        let edge_steps = mean_edge(&level.positions, &level.faces) >> 8;
        let mut shift = level.shift;
        // Where most of the vertices are, bits that come raw cost more than they save, and values of attributes are told from positions.
        let coarse = (n - collapses) as u64 * 8 <= total as u64;
        let least = if coarse { options.edge_steps } else { options.fine_edge_steps };
        // Borders that must not move cannot lose bits either: the tile beside this one would lose others.
        while !options.lock_borders
            && !level.faces.is_empty()
            && (edge_steps >> (shift - level.shift)) >= 2 * least as i64
            && shift < level.shift + 8
        {
            shift += 1;
        }
        let alpha = if n as u64 * 256 <= total as u64 * options.alpha_share as u64 { options.alpha } else { 0 };
        Placement { shift, alpha, bias: self.history.batches.len() as i32 & 1 }
    }

    /// Collapse a batch: the level becomes the coarser one, and the history learns the way back.
    fn collapse(&mut self, batch: &Selected) {
        let clock = Instant::now();
        let placement = self.placement(batch.edges.len());
        let mut span = self.trace.span("loop", "collapse");
        span.items(batch.edges.len() as u64);
        let history = &mut self.history;
        let c = coarsen(&history.base, &self.star, &batch.edges, &batch.leaving, placement);
        let mut stored = StoredBatch::new(&c, &history.base, &history.vertex_slot, &history.face_slot, placement);
        if !history.attributes.layers.is_empty() || !history.attributes.labels.is_empty() {
            let fine = std::mem::take(&mut history.attributes);
            let faces = &history.base.faces;
            (history.attributes, stored.layers) =
                collapse_wedges(&c, faces, &self.star, fine, &history.face_slot, placement.bias);
        }
        self.exact = merge_positions(&c, &self.exact, &history.base);
        let old_of_new = first_of(&c);
        history.vertex_slot = old_of_new.iter().map(|&v| history.vertex_slot[v as usize]).collect();
        history.face_slot = c.element.iter().map(|&f| history.face_slot[f as usize]).collect();
        if let Some(l) = &mut self.locked {
            *l = old_of_new.iter().map(|&v| l[v as usize]).collect();
        }
        let dirty = dirty_vertices(&c.level.faces, &c.star, &c.batch.vertex);
        drop(span);
        let known = Carried { old_of_new: &old_of_new, dirty: &dirty };
        self.bound_and_weigh(&c, &mut stored, known);
        self.carried = Some((old_of_new, dirty));
        self.history.batches.push(stored);
        self.star = c.star;
        self.history.base = c.level;
        self.history.seconds[2] += clock.elapsed().as_secs_f64();
    }

    /// Bound the errors of the coarser level, and beside that weigh its edges if somebody else does it.
    fn bound_and_weigh(&mut self, c: &Coarsened, stored: &mut StoredBatch, known: Carried) {
        let Simplifier { trace, history, star, error, anchor, weigher, exact, locked, .. } = self;
        let fine = &history.base;
        let mut bound = || {
            let _span = trace.span("loop", "bound errors");
            *error = bound_errors(c, fine, star, error, *anchor);
            stored.error = error.iter().fold(0f32, |a, &b| a.max(b)) as f64;
        };
        self.weighed_already = weigher.evaluator().beside();
        if !self.weighed_already {
            bound();
            return;
        }
        let input = WeighInput { faces: &c.level.faces, star: &c.star, positions: exact, locked: locked.as_deref() };
        let weigh = || {
            let clock = Instant::now();
            weigher.weigh(input, Some(known));
            clock.elapsed().as_secs_f64()
        };
        let (_, seconds) = rayon::join(bound, weigh);
        history.seconds[0] += seconds;
    }

    fn finish(self) -> History {
        let mut history = self.history;
        history.edges_weighed = self.weigher.weighed();
        history.weighed_by = self.weigher.evaluator().name();
        history.fallback = self.weigher.fallback().map(str::to_string);
        history
    }
}

/// An integer point in the middle of the box, and the length of its diagonal (at least 1).
fn frame(positions: &[[i32; 3]]) -> ([i32; 3], f64) {
    let Some(&first) = positions.first() else { return ([0; 3], 1.0) };
    let (mut lo, mut hi) = (first, first);
    for p in positions {
        for k in 0..3 {
            lo[k] = lo[k].min(p[k]);
            hi[k] = hi[k].max(p[k]);
        }
    }
    let d = (0..3).map(|k| (hi[k] as f64 - lo[k] as f64).powi(2)).sum::<f64>().sqrt();
    (std::array::from_fn(|k| lo[k] + (hi[k] - lo[k]) / 2), d.max(1.0))
}

/// Vertices on an edge that one polygon alone has, or on a dangling edge.
fn border_vertices(level: &Level, star: &Star) -> Vec<bool> {
    let mut border = vec![false; level.positions.len()];
    for v in 0..level.positions.len() as u32 {
        let mut ends: Vec<u32> = Vec::new();
        for &f in star.get(v) {
            let c = level.faces.get(f);
            let at = c.iter().position(|&x| x == v).unwrap_or(0);
            ends.push(c[(at + 1) % c.len()]);
            if c.len() > 2 {
                ends.push(c[(at + c.len() - 1) % c.len()]);
            }
        }
        ends.sort_unstable();
        border[v as usize] = ends.chunk_by(|a, b| a == b).any(|run| run.len() == 1);
    }
    border
}

/// The isolated vertices that leave before the next coarser level: all but one in eight, as long as there are many.
fn leaving(star: &Star, slots: &[u32], last: bool) -> Vec<u32> {
    let isolated: Vec<u32> = (0..slots.len() as u32).filter(|&v| star.get(v).is_empty()).collect();
    if isolated.len() <= FEW || (!last && isolated.len() < slots.len() / 64) {
        return Vec::new();
    }
    isolated.into_iter().filter(|&v| slots[v as usize].wrapping_mul(0x9e37_79b9) >> 29 != 0).collect()
}

/// For each vertex of the coarser level the first of the finer ones that it stands for.
fn first_of(c: &Coarsened) -> Vec<u32> {
    let mut first = vec![0u32; c.level.positions.len()];
    for (v, &w) in c.vertex.iter().enumerate().rev() {
        if w != NONE {
            first[w as usize] = v as u32;
        }
    }
    first
}

/// Positions without rounding: the merged vertex lies at the midpoint, plus what curvature compensation added.
fn merge_positions(c: &Coarsened, exact: &[[f32; 3]], fine: &Level) -> Vec<[f32; 3]> {
    let mut out: Vec<[f32; 3]> = first_of(c).iter().map(|&v| exact[v as usize]).collect();
    let down = c.level.shift - fine.shift;
    for (i, &[a, b]) in c.pairs.iter().enumerate() {
        let v = c.batch.vertex[i];
        let (p, q) = (fine.positions[a as usize].map(|x| x >> down), fine.positions[b as usize].map(|x| x >> down));
        let middle = crate::format::complex::placement::midpoint(p, q, 0);
        let placed = c.level.positions[v as usize];
        out[v as usize] = std::array::from_fn(|k| {
            let lift = if c.batch.alpha > 0 { ((placed[k] - middle[k]) << c.level.shift) as f32 } else { 0.0 };
            (exact[a as usize][k] + exact[b as usize][k]) * 0.5 + lift
        });
    }
    out
}
