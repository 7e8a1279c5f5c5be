//! The encoder's view of the elements still to be coded.

use super::Origin;
use crate::format::complex::Faces;

/// The elements, with those that are coded marked.
#[derive(Debug)]
pub(super) struct Source {
    faces: Faces,
    used: Vec<bool>,
    /// Directed edges `(from, to, number of seed, corner)` of elements of degree ≥ 3, sorted.
    edges: Vec<[u32; 4]>,
    /// For the first entry of each directed edge: how many of its entries are known to be used.
    skip: Vec<u32>,
    /// The elements, rotated to their least vertex, in lexicographic order of their corners.
    seeds: Vec<Origin>,
    /// From where on the seeds are still to be looked at.
    cursor: usize,
}

impl Source {
    /// Sort the edges and seeds; a decoder's is empty.
    pub(super) fn new(faces: Faces, decoding: bool) -> Self {
        let (mut edges, mut seeds, mut used) = (Vec::new(), Vec::new(), Vec::new());
        if !decoding {
            used.resize(faces.len(), false);
            for (element, corners) in (0u32..).zip(faces.iter()) {
                let least = corners.iter().zip(0u32..).min();
                seeds.push(Origin { element, rotation: least.map_or(0, |(_, k)| k) });
            }
            let rotated = |o: &Origin| {
                let (tail, head) = faces.get(o.element).split_at(o.rotation as usize);
                head.iter().chain(tail)
            };
            seeds.sort_unstable_by(|a, b| rotated(a).cmp(rotated(b)).then(a.element.cmp(&b.element)));
            for (number, seed) in (0u32..).zip(&seeds) {
                let corners = faces.get(seed.element);
                for (k, &a) in (0u32..).zip(corners).filter(|_| corners.len() > 2) {
                    edges.push([a, corners[(k as usize + 1) % corners.len()], number, k]);
                }
            }
            edges.sort_unstable();
        }
        let skip = vec![0; edges.len()];
        Source { faces, used, edges, skip, seeds, cursor: 0 }
    }

    /// An element left that runs `a → b`, which become its first two corners.
    pub(super) fn with_edge(&mut self, a: u32, b: u32) -> Option<Origin> {
        let first = self.edges.partition_point(|e| [e[0], e[1]] < [a, b]);
        loop {
            let entry = self.edges.get(first + *self.skip.get(first)? as usize)?;
            if [entry[0], entry[1]] != [a, b] {
                return None;
            }
            let element = self.seeds[entry[2] as usize].element;
            if !self.used[element as usize] {
                return Some(Origin { element, rotation: entry[3] });
            }
            self.skip[first] += 1;
        }
    }

    /// The element left whose least vertex is the least; it becomes the first corner.
    pub(super) fn next_seed(&mut self) -> Option<Origin> {
        loop {
            let seed = *self.seeds.get(self.cursor)?;
            if !self.used[seed.element as usize] {
                return Some(seed);
            }
            self.cursor += 1;
        }
    }

    pub(super) fn take(&mut self, origin: Origin) {
        self.used[origin.element as usize] = true;
    }

    pub(super) fn degree(&self, origin: Origin) -> u32 {
        self.faces.get(origin.element).len() as u32
    }

    /// Corner `k` of an element after its rotation.
    pub(super) fn corner(&self, origin: Origin, k: u32) -> u32 {
        let corners = self.faces.get(origin.element);
        corners[(origin.rotation as usize + k as usize) % corners.len()]
    }
}
