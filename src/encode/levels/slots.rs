//! Which slot of the history each vertex, element and wedge of the level at hand has, and what the coder is given of a batch by that.

use crate::encode::simplify::{History, StoredBatch};
use crate::format::attributes::{GivenAttributes, GivenLayer, Named};
use crate::format::complex::{Batch, Inserted, Level, NEW, NONE, Side, Split};
use crate::format::points::canonical_order;
use crate::format::segment::Given;
use crate::format::state::LevelState;
use std::ops::Range;

/// Slots of the level at hand.
pub(super) struct Slots<'a> {
    /// The slot of each wedge, layer by layer.
    wedge: Vec<Vec<u32>>,
    /// Width and the values of all slots at the finer level, layer by layer.
    values: Vec<(usize, Vec<i32>)>,
    /// The label of each element's slot.
    labels: &'a [u16],
    pub(super) vertex: Vec<u32>,
    face: Vec<u32>,
    /// The vertex of the level that has a slot.
    of_slot: Vec<u32>,
    /// The split (plus one) of a slot in the batch at hand.
    split_of: Vec<u32>,
    low_bits: Vec<[u16; 3]>,
}

/// A segment for the coder, and the stored split behind each of its splits.
pub(super) struct Prepared<'s> {
    pub(super) given: Given<'s>,
    pub(super) stored: Vec<u32>,
}

/// What coding a batch told.
#[derive(Default)]
pub(super) struct Told {
    /// The stored split behind each coded one, and whether its children changed places.
    pub(super) splits: Vec<(u32, bool)>,
    /// Of each segment, the wedges that have slots, and how many new wedges it makes in each layer.
    pub(super) wedges: Vec<(Named, Vec<u32>)>,
}

impl<'a> Slots<'a> {
    /// Slots of the base, whose vertices, elements and wedges have these; slots are below `slots`.
    pub(super) fn new(
        history: &'a History,
        slots: usize,
        vertex: Vec<u32>,
        face: Vec<u32>,
        wedge: Vec<Vec<u32>>,
    ) -> Self {
        let deferred = history.batches.iter().any(|b| !b.low_bits.is_empty());
        Slots {
            wedge,
            values: history.attributes.layers.iter().map(|l| (l.width, l.values.clone())).collect(),
            labels: &history.labels,
            vertex,
            face,
            of_slot: vec![NONE; slots],
            split_of: vec![0; slots],
            low_bits: vec![[0; 3]; if deferred { slots } else { 0 }],
        }
    }

    /// Note where the slots of the level are and which of them split.
    pub(super) fn announce(&mut self, stored: &StoredBatch, level: &Level) {
        for v in 0..level.positions.len() {
            self.of_slot[self.vertex[v] as usize] = v as u32;
        }
        for (i, pair) in stored.pairs.iter().enumerate() {
            self.split_of[pair[0] as usize] = i as u32 + 1;
        }
        for &(slot, low) in &stored.low_bits {
            self.low_bits[slot as usize] = low;
        }
        for ((width, values), layer) in self.values.iter_mut().zip(&stored.layers) {
            for (&w, value) in layer.changed.iter().zip(layer.values.chunks_exact(*width)) {
                values[w as usize * *width..][..*width].copy_from_slice(value);
            }
        }
    }

    /// Give the wedges of the finer level their slots;
    pub(super) fn rename(&mut self, told: &Told) {
        for (l, names) in self.wedge.iter_mut().enumerate() {
            for (Named(lists), fresh) in &told.wedges {
                let base = names.len();
                names.resize(base + fresh.get(l).copied().unwrap_or(0) as usize, NONE);
                for &(w, slot) in lists.get(l).into_iter().flatten() {
                    let at = if w & NEW != 0 { base + (w & !NEW) as usize } else { w as usize };
                    names[at] = slot;
                }
            }
        }
    }

    /// What the coder is given of the segment `range`; the first one has the head of the batch too.
    pub(super) fn given<'s>(
        &'s self,
        stored: &StoredBatch,
        state: &LevelState,
        range: Range<u32>,
        new_vertices: Option<&[u32]>,
    ) -> Prepared<'s> {
        let (mut given, mut of) = (Given::default(), Vec::new());
        given.attributes.layers = self
            .wedge
            .iter()
            .zip(&self.values)
            .map(|(keys, (width, values))| GivenLayer {
                key_of_wedge: keys,
                width: *width,
                values,
                ..GivenLayer::default()
            })
            .collect();
        let deferred = stored.shift < state.level.shift;
        let mut split = Split::default();
        for v in range {
            let slot = self.vertex[v as usize];
            let Some(i) = self.split_of[slot as usize].checked_sub(1) else {
                if deferred {
                    given.low_bits.push([self.low_bits[slot as usize], [0; 3]]);
                }
                continue;
            };
            of.push(i);
            let i = i as usize;
            self.split(stored, i, state.around(v), &mut split);
            given.batch.push(v, &split, stored.delta[i]);
            if deferred {
                given.low_bits.push(stored.pairs[i].map(|slot| self.low_bits[slot as usize]));
            }
            if !stored.layers.is_empty() || !self.labels.is_empty() {
                self.attributes(stored, i, v, state, &split, &mut given.attributes);
            }
        }
        if let Some(order) = new_vertices {
            given.batch.alpha = stored.placement.alpha;
            given.batch.new_vertices = order.iter().map(|&k| stored.new_vertex_positions[k as usize]).collect();
            if deferred {
                let slots = order.iter().map(|&k| stored.new_vertices[k as usize]);
                given.new_low_bits = slots.map(|slot| self.low_bits[slot as usize]).collect();
            }
        }
        Prepared { given, stored: of }
    }

    /// The new vertices of a batch in canonical order.
    pub(super) fn new_vertex_order(stored: &StoredBatch) -> Vec<u32> {
        canonical_order(&stored.new_vertex_positions)
    }

    /// Stored split `i`, of a vertex with this star, in the numbers of the level.
    fn split(&self, stored: &StoredBatch, i: usize, star: &[u32], split: &mut Split) {
        split.reset(star.len());
        for &(slot, side) in &stored.sides[stored.side_start[i] as usize..stored.side_start[i + 1] as usize] {
            if let Some(k) = star.iter().position(|&f| self.face[f as usize] == slot) {
                split.sides[k] = side;
            }
        }
        for t in &stored.triangles[stored.triangle_start[i] as usize..stored.triangle_start[i + 1] as usize] {
            split.triangles.push(Inserted { apex: self.of_slot[t.apex as usize], reversed: t.reversed });
        }
        split.edges = stored.edge_start[i + 1] - stored.edge_start[i];
    }

    /// Its attributes: labels and keys, which are slots of wedges.
    fn attributes(
        &self,
        stored: &StoredBatch,
        i: usize,
        v: u32,
        state: &LevelState,
        split: &Split,
        out: &mut GivenAttributes,
    ) {
        let faces = &state.level.faces;
        for (l, (layer, keys)) in stored.layers.iter().zip(&mut out.layers).enumerate() {
            let wedges = &state.attributes.layers[l];
            let changed = &layer.star[layer.star_start[i] as usize..layer.star_start[i + 1] as usize];
            for (&f, &side) in state.around(v).iter().zip(&split.sides) {
                let slot = self.face[f as usize];
                let known = changed.iter().position(|e| e[0] == slot);
                keys.star.push(match (known, side) {
                    (Some(k), Side::Grow12 | Side::Grow21) => [changed[k][1], changed[k + 1][1]],
                    (Some(k), _) => [changed[k][1]; 2],
                    (None, _) => {
                        let at = faces.get(f).iter().position(|&x| x == v).unwrap_or(0);
                        let w = wedges.corner[faces.start[f as usize] as usize + at];
                        [if w == NONE { NONE } else { self.wedge[l][w as usize] }; 2]
                    }
                });
            }
        }
        let label = |slot: u32| self.labels.get(slot as usize).copied().unwrap_or(0);
        for t in stored.triangle_start[i] as usize..stored.triangle_start[i + 1] as usize {
            out.labels.push(label(stored.triangles[t].slot));
            for (layer, keys) in stored.layers.iter().zip(&mut out.layers) {
                keys.inserted.push(layer.triangles[t]);
            }
        }
        for e in stored.edge_start[i] as usize..stored.edge_start[i + 1] as usize {
            out.labels.push(label(stored.edges[e]));
            for (layer, keys) in stored.layers.iter().zip(&mut out.layers) {
                let [one, two] = layer.edges[e];
                keys.inserted.push([one, two, NONE]);
            }
        }
    }

    /// Go to the finer level, whose vertices have these parents and whose elements come from `origin`.
    pub(super) fn descend(
        &mut self,
        stored: &StoredBatch,
        batch: &Batch,
        parents: &[u32],
        origin: &[u32],
        splits: &[(u32, bool)],
        new_vertex_order: &[u32],
    ) {
        let mut vertex = Vec::with_capacity(parents.len());
        let mut new_vertices = new_vertex_order.iter();
        let mut next = splits.iter();
        let mut v = 0;
        while v < parents.len() {
            let parent = parents[v];
            if parent == NONE {
                vertex.push(new_vertices.next().map_or(NONE, |&b| stored.new_vertices[b as usize]));
                v += 1;
            } else if parents.get(v + 1) == Some(&parent) {
                if let Some(&(i, swapped)) = next.next() {
                    let [a, b] = stored.pairs[i as usize];
                    vertex.extend_from_slice(&if swapped { [b, a] } else { [a, b] });
                }
                v += 2;
            } else {
                vertex.push(self.vertex[parent as usize]);
                v += 1;
            }
        }
        // Inserted elements: match each with a stored one of the same kind.
        let mut new = Vec::with_capacity(batch.triangles.len());
        let mut used: Vec<bool> = Vec::new();
        for (k, &(i, swapped)) in splits.iter().enumerate() {
            let i = i as usize;
            let list = &stored.triangles[stored.triangle_start[i] as usize..stored.triangle_start[i + 1] as usize];
            used.clear();
            used.resize(list.len(), false);
            for t in batch.triangles_of(k) {
                let apex = self.vertex[t.apex as usize];
                let found = (0..list.len())
                    .find(|&j| !used[j] && list[j].apex == apex && (list[j].reversed ^ swapped) == t.reversed);
                if let Some(j) = found {
                    used[j] = true;
                    new.push(list[j].slot);
                }
            }
            new.extend_from_slice(&stored.edges[stored.edge_start[i] as usize..stored.edge_start[i + 1] as usize]);
        }
        let face = origin
            .iter()
            .map(|&e| if e & NEW != 0 { new[(e & !NEW) as usize] } else { self.face[e as usize] })
            .collect();
        for pair in &stored.pairs {
            self.split_of[pair[0] as usize] = 0;
        }
        self.vertex = vertex;
        self.face = face;
    }
}
