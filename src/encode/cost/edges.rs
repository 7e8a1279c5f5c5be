//! The edges of a level, numbered by their ends.
//!
//! An edge `{a, b}` exists where an element has `a` and `b` in consecutive corners (the last corner precedes the
//! first) or is the dangling edge `{a, b}`. Edges are numbered by (smaller end, larger end), so that numbers depend on
//! the numbering of vertices alone, neither on the order of elements nor on the number of threads.

use std::ops::Range;

use rayon::prelude::*;

use crate::format::complex::{Faces, Star};

/// Vertices whose edges one task collects.
const CHUNK: usize = 4096;

/// The edges of a level: for each vertex the larger ones it shares an edge with, ascending, as one compressed sparse
/// row structure. The place in it is the number of the edge. Takes 8 bytes an edge and 4 bytes a vertex.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EdgeList {
    /// Vertex `a` is the smaller end of the edges `start[a] .. start[a + 1]`.
    start: Vec<u32>,
    /// The smaller end of each edge.
    low: Vec<u32>,
    /// The larger end of each edge.
    high: Vec<u32>,
}

impl EdgeList {
    /// No edges.
    pub const fn none() -> Self {
        EdgeList { start: Vec::new(), low: Vec::new(), high: Vec::new() }
    }

    /// Collect the edges of a level: in parallel over vertices, each looking at its own star.
    pub fn build(faces: &Faces, star: &Star) -> Self {
        let vertices = star.start.len().saturating_sub(1);
        let chunks: Vec<(Vec<u32>, Vec<u32>)> = (0..vertices.div_ceil(CHUNK))
            .into_par_iter()
            .map(|c| {
                let range = c * CHUNK..vertices.min((c + 1) * CHUNK);
                let mut counts = Vec::with_capacity(range.len());
                let mut high = Vec::with_capacity(range.len() * 3);
                let mut near = Vec::new();
                for a in range {
                    near.clear();
                    larger_neighbours(faces, star, a as u32, &mut near);
                    near.sort_unstable();
                    near.dedup();
                    high.extend_from_slice(&near);
                    counts.push(near.len() as u32);
                }
                (counts, high)
            })
            .collect();
        let edges = chunks.iter().map(|(_, high)| high.len()).sum();
        let mut list = EdgeList {
            start: Vec::with_capacity(vertices + 1),
            low: Vec::with_capacity(edges),
            high: Vec::with_capacity(edges),
        };
        list.start.push(0);
        for (counts, high) in chunks {
            for n in counts {
                let a = list.start.len() as u32 - 1;
                list.low.resize(list.low.len() + n as usize, a);
                list.start.push(list.low.len() as u32);
            }
            list.high.extend_from_slice(&high);
        }
        list
    }

    /// Number of edges.
    pub fn len(&self) -> usize {
        self.high.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.high.is_empty()
    }

    /// Number of vertices of the level it was built for.
    pub fn vertices(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// The ends of edge `e`, the smaller first.
    #[inline]
    pub fn ends(&self, e: u32) -> (u32, u32) {
        (self.low[e as usize], self.high[e as usize])
    }

    /// The numbers of the edges whose smaller end is `a`.
    #[inline]
    pub fn from(&self, a: u32) -> Range<usize> {
        self.start[a as usize] as usize..self.start[a as usize + 1] as usize
    }

    /// The larger neighbours of `a`, ascending: the other ends of the edges [`from`](Self::from)`(a)`.
    #[inline]
    pub fn larger(&self, a: u32) -> &[u32] {
        &self.high[self.from(a)]
    }

    /// The number of the edge between `a` and `b`, in either order, if there is one.
    pub fn find(&self, a: u32, b: u32) -> Option<u32> {
        let (a, b) = (a.min(b), a.max(b));
        if a as usize >= self.vertices() {
            return None;
        }
        let at = self.larger(a).binary_search(&b).ok()?;
        Some(self.start[a as usize] + at as u32)
    }
}

/// Append the larger neighbours of `a`, with repetitions.
fn larger_neighbours(faces: &Faces, star: &Star, a: u32, out: &mut Vec<u32>) {
    for &f in star.get(a) {
        let element = faces.get(f);
        let n = element.len();
        let Some(i) = element.iter().position(|&x| x == a) else { continue };
        let next = element[if i + 1 == n { 0 } else { i + 1 }];
        let previous = element[if i == 0 { n - 1 } else { i - 1 }];
        if next > a {
            out.push(next);
        }
        if previous > a {
            out.push(previous);
        }
    }
}

/// All neighbours of `a` in a level, ascending, each once, appended to a cleared `out`.
pub fn neighbours(faces: &Faces, star: &Star, a: u32, out: &mut Vec<u32>) {
    out.clear();
    for &f in star.get(a) {
        let element = faces.get(f);
        let n = element.len();
        let Some(i) = element.iter().position(|&x| x == a) else { continue };
        out.push(element[if i + 1 == n { 0 } else { i + 1 }]);
        out.push(element[if i == 0 { n - 1 } else { i - 1 }]);
    }
    out.sort_unstable();
    out.dedup();
}
