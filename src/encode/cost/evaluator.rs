//! Who weighs edges: one trait, two twins. This file has the trait and the twin on the processor; the other is
//! [`gpu`](crate::gpu).
//!
//! Both get a [`Task`] (a level, its edges, and what is known of them from the level before) and fill one array, edge by
//! edge. Weights become integers in one place, [`Scale::fixed`](super::Scale::fixed), from the `f32` that either computed.

use std::fmt::Debug;
use std::ops::Range;

use rayon::prelude::*;
use thiserror::Error;

use super::edges::EdgeList;
use super::fixed::{Fixed, Scale};
use super::gather::Gatherer;
use super::weight::{Patch, Scratch, edge_weight_by};
use crate::encode::trace::Trace;
use crate::format::complex::{Faces, Star};

/// Edges (about) that one task of the processor weighs.
const CHUNK: usize = 2048;

/// Why an evaluator gave up: the job goes on with the processor.
#[derive(Debug, Error)]
#[error("{0}")]
pub struct EvaluateError(pub Box<dyn std::error::Error + Send + Sync>);

/// Something that weighs the edges of a level.
pub trait Evaluator: Debug + Send {
    /// What it runs on, in words: `cpu`, or the name of a device.
    fn name(&self) -> String;

    /// Whether it works beside the processor, so that the caller's threads are free while it weighs.
    fn beside(&self) -> bool {
        false
    }

    /// Write the weight of every edge of the task to its place in `out`; returns how many were weighed rather than known.
    ///
    /// # Errors
    /// [`EvaluateError`] when the device cannot go on. What stands in `out` is then worth nothing.
    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError>;
}

/// Who weighs in a job, and where its spans go.
#[derive(Debug)]
pub struct Engine {
    /// Who weighs.
    pub evaluator: Box<dyn Evaluator>,
    /// Where spans go.
    pub trace: Trace,
}

impl Default for Engine {
    /// The processor, and no trace.
    fn default() -> Self {
        Engine { evaluator: Box::new(Cpu), trace: Trace::off() }
    }
}

/// A level as the weigher sees it.
#[derive(Clone, Copy, Debug)]
pub struct WeighInput<'a> {
    /// The elements.
    pub faces: &'a Faces,
    /// Their stars.
    pub star: &'a Star,
    /// One position for each vertex, in lattice steps relative to an integer anchor.
    pub positions: &'a [[f32; 3]],
    /// Vertices that must not move, or nothing: an edge with a locked end is illegal. What is locked must not change between levels.
    pub locked: Option<&'a [bool]>,
}

/// What the level has in common with the one weighed before.
#[derive(Clone, Copy, Debug)]
pub struct Carried<'a> {
    /// For each vertex its number in the level before (for a merged one that of either child), strictly increasing.
    pub old_of_new: &'a [u32],
    /// Whether the vertex merged or moved, or shares an element with one that did: see [`dirty_vertices`](super::dirty_vertices).
    pub dirty: &'a [bool],
}

/// The edges of one level, to be weighed.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The level.
    pub level: WeighInput<'a>,
    /// Its edges.
    pub edges: &'a EdgeList,
    /// What it has in common with the level before.
    pub carried: Option<Carried<'a>>,
    /// The edges of the level before, and their weights.
    pub old: (&'a EdgeList, &'a [Fixed]),
    /// The unit of weights.
    pub scale: &'a Scale,
    /// Where spans go.
    pub trace: &'a Trace,
}

/// The edges of no level.
static NO_EDGES: EdgeList = EdgeList::none();

impl<'a> Task<'a> {
    /// All edges of a level of which nothing is known yet.
    pub fn first(level: WeighInput<'a>, edges: &'a EdgeList, scale: &'a Scale, trace: &'a Trace) -> Self {
        Task { level, edges, carried: None, old: (&NO_EDGES, &[]), scale, trace }
    }

    /// The weight of `{a, b}` (`a < b`) where it need not be weighed: it is that of the level before, or an end is locked.
    #[inline(always)]
    pub fn known(&self, a: u32, b: u32) -> Option<Fixed> {
        if let Some(c) = self.carried
            && !c.dirty[a as usize]
            && !c.dirty[b as usize]
            && let Some(e) = self.old.0.find(c.old_of_new[a as usize], c.old_of_new[b as usize])
        {
            return Some(self.old.1[e as usize]);
        }
        let locked = |v: u32| self.level.locked.is_some_and(|l| l[v as usize]);
        (locked(a) || locked(b)).then_some(Fixed::ILLEGAL)
    }

    /// Cut the vertices into runs with about `edges` edges each (as smaller ends), each with its part of `out`.
    pub fn parts<'o>(&self, edges: usize, out: &'o mut [Fixed]) -> Vec<(Range<u32>, &'o mut [Fixed])> {
        let mut parts = Vec::new();
        let mut rest = out;
        let (mut from, mut done) = (0, 0);
        for a in 0..self.edges.vertices() {
            let end = self.edges.from(a as u32).end;
            if end - done >= edges || a + 1 == self.edges.vertices() {
                let (part, later) = rest.split_at_mut(end - done);
                parts.push((from as u32..a as u32 + 1, part));
                (rest, from, done) = (later, a + 1, end);
            }
        }
        parts
    }
}

/// The twin on the processor: all threads of the current pool, the widest vectors the machine has. The outcome depends
/// on neither.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cpu;

impl Evaluator for Cpu {
    fn name(&self) -> String {
        "cpu".to_string()
    }

    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError> {
        let weighed = task
            .parts(CHUNK, out)
            .into_par_iter()
            .map_init(Worker::default, |worker, (vertices, out)| {
                let mut span = task.trace.work("weigh on the processor");
                let weighed = pulp::Arch::new().dispatch(Part { worker, task, vertices, out });
                span.items(weighed);
                weighed
            })
            .sum();
        Ok(weighed)
    }
}

/// Weigh a few edges of the task, by their numbers in increasing order, and write their weights.
pub fn weigh_some(task: &Task, numbers: &[u32], out: &mut [Fixed]) {
    let weights: Vec<Vec<Fixed>> = numbers
        .par_chunks(CHUNK / 8)
        .map_init(Worker::default, |worker, numbers| {
            let mut span = task.trace.work("weigh what the device left");
            span.items(numbers.len() as u64);
            pulp::Arch::new().dispatch(Listed { worker, task, numbers })
        })
        .collect();
    for (&e, weight) in numbers.iter().zip(weights.into_iter().flatten()) {
        out[e as usize] = weight;
    }
}

/// The memory of one worker.
#[derive(Default)]
struct Worker {
    gatherer: Gatherer,
    patch: Patch,
    scratch: Scratch,
}

impl Worker {
    #[inline(always)]
    fn weigh<S: pulp::Simd>(&mut self, simd: S, task: &Task, a: u32, b: u32) -> Fixed {
        let WeighInput { faces, star, positions, .. } = task.level;
        self.gatherer.read(faces, star, positions, a, b, &mut self.patch);
        task.scale.fixed(edge_weight_by(simd, &self.patch, &mut self.scratch))
    }
}

/// Weigh the edges whose smaller end is in `vertices`.
struct Part<'a> {
    worker: &'a mut Worker,
    task: &'a Task<'a>,
    vertices: Range<u32>,
    out: &'a mut [Fixed],
}

impl pulp::WithSimd for Part<'_> {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> u64 {
        let Part { worker, task, vertices, out } = self;
        worker.gatherer.forget();
        let mut out = out.iter_mut();
        let mut weighed = 0;
        for a in vertices {
            for &b in task.edges.larger(a) {
                let Some(out) = out.next() else { return weighed };
                *out = match task.known(a, b) {
                    Some(weight) => weight,
                    None => {
                        weighed += 1;
                        worker.weigh(simd, task, a, b)
                    }
                };
            }
        }
        weighed
    }
}

/// Weigh the edges of these numbers.
struct Listed<'a> {
    worker: &'a mut Worker,
    task: &'a Task<'a>,
    numbers: &'a [u32],
}

impl pulp::WithSimd for Listed<'_> {
    type Output = Vec<Fixed>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Vec<Fixed> {
        let Listed { worker, task, numbers } = self;
        worker.gatherer.forget();
        numbers
            .iter()
            .map(|&e| {
                let (a, b) = task.edges.ends(e);
                worker.weigh(simd, task, a, b)
            })
            .collect()
    }
}
