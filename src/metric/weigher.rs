//! The weights of a level's edges, kept from batch to batch.
//!
//! The weight of an edge depends on the elements at its two ends and on nothing else, so after a batch only the edges with an
//! end that merged, or that shares an element with a merged vertex, are weighed anew; the others carry their
//! weight over. Each task weighs a range of vertices into its own part of one array: the outcome does not depend on
//! the number of threads.

use rayon::prelude::*;

use super::edges::EdgeList;
use super::fixed::{Fixed, Scale};
use super::gather::Gatherer;
use super::weight::{Patch, Scratch, edge_weight};
use crate::complex::{Faces, Star};

/// Edges (about) that one task weighs.
const CHUNK: usize = 2048;

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
    /// Whether the vertex merged or moved, or shares an element with one that did: see [`dirty_vertices`].
    pub dirty: &'a [bool],
}

/// For each vertex of a level, whether it is one of `merged` or shares an element with one.
pub fn dirty_vertices(faces: &Faces, star: &Star, merged: &[u32]) -> Vec<bool> {
    let mut dirty = vec![false; star.start.len().saturating_sub(1)];
    for &v in merged {
        dirty[v as usize] = true;
        for &f in star.get(v) {
            for &x in faces.get(f) {
                dirty[x as usize] = true;
            }
        }
    }
    dirty
}

/// Owns the edges of the current level and their weights. Takes 12 bytes an edge and 4 bytes a vertex, twice that
/// while a level follows another.
#[derive(Clone, Debug)]
pub struct Weigher {
    scale: Scale,
    edges: EdgeList,
    weights: Vec<Fixed>,
    weighed: u64,
}

impl Weigher {
    /// For a mesh whose bounding box has this diagonal, in lattice steps.
    pub fn new(diagonal: f64) -> Self {
        Weigher { scale: Scale::new(diagonal), edges: EdgeList::default(), weights: Vec::new(), weighed: 0 }
    }

    /// Go to a level: weigh all of its edges, or with `carried` only those that the level before does not answer for.
    pub fn weigh(&mut self, level: WeighInput, carried: Option<Carried>) {
        let edges = EdgeList::build(level.faces, level.star);
        let mut weights = vec![Fixed::ILLEGAL; edges.len()];
        let mut tasks = Vec::new();
        let mut rest = weights.as_mut_slice();
        let (mut from, mut done) = (0, 0);
        for a in 0..edges.vertices() {
            let end = edges.from(a as u32).end;
            if end - done >= CHUNK || a + 1 == edges.vertices() {
                let (part, later) = rest.split_at_mut(end - done);
                tasks.push((from as u32..a as u32 + 1, part));
                (rest, from, done) = (later, a + 1, end);
            }
        }
        let old = (&self.edges, self.weights.as_slice());
        let scale = &self.scale;
        let weighed: u64 = tasks
            .into_par_iter()
            .map_init(Worker::default, |worker, (vertices, out)| {
                let task = Range { worker, level, carried, old, scale, edges: &edges, vertices, out };
                // The widest vectors this machine has: they change the speed and no bit of the result.
                pulp::Arch::new().dispatch(task)
            })
            .sum();
        self.weighed += weighed;
        self.edges = edges;
        self.weights = weights;
    }

    /// The edges of the current level.
    pub fn edges(&self) -> &EdgeList {
        &self.edges
    }

    /// Their weights, by number of edge.
    pub fn weights(&self) -> &[Fixed] {
        &self.weights
    }

    /// The unit of the weights.
    pub fn scale(&self) -> Scale {
        self.scale
    }

    /// How many edges were weighed since the beginning, not counting those carried over.
    pub fn weighed(&self) -> u64 {
        self.weighed
    }
}

/// The memory of one task.
#[derive(Default)]
struct Worker {
    gatherer: Gatherer,
    patch: Patch,
    scratch: Scratch,
}

/// What one task does: weigh the edges whose smaller end is in `vertices`.
struct Range<'a> {
    worker: &'a mut Worker,
    level: WeighInput<'a>,
    carried: Option<Carried<'a>>,
    old: (&'a EdgeList, &'a [Fixed]),
    scale: &'a Scale,
    edges: &'a EdgeList,
    vertices: std::ops::Range<u32>,
    out: &'a mut [Fixed],
}

impl pulp::NullaryFnOnce for Range<'_> {
    type Output = u64;

    /// Returns how many edges were not carried over.
    #[inline(always)]
    fn call(self) -> u64 {
        let Range { worker, level, carried, old: (old_edges, old_weights), scale, edges, vertices, out } = self;
        worker.gatherer.forget();
        let locked = |v: u32| level.locked.is_some_and(|l| l[v as usize]);
        let mut out = out.iter_mut();
        let mut weighed = 0;
        for a in vertices {
            for &b in edges.larger(a) {
                let Some(out) = out.next() else { return weighed };
                if let Some(c) = carried
                    && !c.dirty[a as usize]
                    && !c.dirty[b as usize]
                    && let Some(e) = old_edges.find(c.old_of_new[a as usize], c.old_of_new[b as usize])
                {
                    *out = old_weights[e as usize];
                    continue;
                }
                if locked(a) || locked(b) {
                    continue;
                }
                weighed += 1;
                worker.gatherer.read(level.faces, level.star, level.positions, a, b, &mut worker.patch);
                *out = scale.fixed(edge_weight(&worker.patch, &mut worker.scratch));
            }
        }
        weighed
    }
}
