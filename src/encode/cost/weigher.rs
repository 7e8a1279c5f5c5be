//! The weights of a level's edges, kept from batch to batch.
//!
//! The weight of an edge depends on the elements at its two ends and on nothing else, so after a batch only the edges with an
//! end that merged, or that shares an element with a merged vertex, are weighed anew; the others carry their
//! weight over. Who weighs them is an [`Evaluator`]; one that fails is replaced by the processor, and the level is weighed again.

use super::edges::EdgeList;
use super::evaluator::{Carried, Cpu, Evaluator, Task, WeighInput};
use super::fixed::{Fixed, Scale};
use crate::encode::trace::Trace;
use crate::format::complex::{Faces, Star};

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
#[derive(Debug)]
pub struct Weigher {
    scale: Scale,
    edges: EdgeList,
    weights: Vec<Fixed>,
    weighed: u64,
    evaluator: Box<dyn Evaluator>,
    fallback: Option<String>,
    trace: Trace,
}

impl Weigher {
    /// For a mesh whose bounding box has this diagonal, in lattice steps.
    pub fn new(diagonal: f64) -> Self {
        Weigher::with(diagonal, Box::new(Cpu), Trace::off())
    }

    /// The same, with somebody who weighs and a trace.
    pub fn with(diagonal: f64, evaluator: Box<dyn Evaluator>, trace: Trace) -> Self {
        Weigher {
            scale: Scale::new(diagonal),
            edges: EdgeList::default(),
            weights: Vec::new(),
            weighed: 0,
            evaluator,
            fallback: None,
            trace,
        }
    }

    /// Go to a level: weigh all of its edges, or with `carried` only those that the level before does not answer for.
    pub fn weigh(&mut self, level: WeighInput, carried: Option<Carried>) {
        let edges = {
            let _span = self.trace.work("list edges");
            EdgeList::build(level.faces, level.star)
        };
        let mut weights = vec![Fixed::ILLEGAL; edges.len()];
        let task = Task {
            level,
            edges: &edges,
            carried,
            old: (&self.edges, self.weights.as_slice()),
            scale: &self.scale,
            trace: &self.trace,
        };
        let weighed = match self.evaluator.weigh(&task, &mut weights) {
            Ok(weighed) => weighed,
            Err(error) => {
                self.fallback = Some(error.to_string());
                self.evaluator = Box::new(Cpu);
                weights.fill(Fixed::ILLEGAL);
                // The processor does not fail.
                self.evaluator.weigh(&task, &mut weights).unwrap_or(0)
            }
        };
        self.weighed += weighed;
        self.edges = edges;
        self.weights = weights;
    }

    /// Who weighs now.
    pub fn evaluator(&self) -> &dyn Evaluator {
        self.evaluator.as_ref()
    }

    /// Why the one who was to weigh no longer does.
    pub fn fallback(&self) -> Option<&str> {
        self.fallback.as_deref()
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
