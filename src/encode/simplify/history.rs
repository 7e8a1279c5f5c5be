//! What simplification leaves behind: the base and, for each batch, what leads back.
//!
//! Vertices and elements go by *slots*: their numbers in the input, which a merged vertex inherits from one of its
//! children. So a batch can be read in any numbering of its level, also in the one that a decoder will have.

use super::wedges::StoredWedges;
use crate::format::complex::{Attributes, Coarsened, Level, Placement, Side};

/// A triangle that a split inserts, by slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredTriangle {
    /// Its own slot.
    pub slot: u32,
    /// The slot of its third vertex.
    pub apex: u32,
    /// As in [`crate::format::complex::Inserted`].
    pub reversed: bool,
}

/// A batch by slots. Takes about 60 bytes a split.
#[derive(Clone, Debug, Default)]
pub struct StoredBatch {
    /// The slots of the children of each split; the merged vertex has the first.
    pub pairs: Vec<[u32; 2]>,
    /// `v1 − v2` in steps of the coarser level.
    pub delta: Vec<[i32; 3]>,
    /// Split `i` owns `sides[side_start[i] .. side_start[i + 1]]`.
    pub side_start: Vec<u32>,
    /// Elements that do not go to the first child.
    pub sides: Vec<(u32, Side)>,
    /// Split `i` owns `triangles[triangle_start[i] .. triangle_start[i + 1]]`.
    pub triangle_start: Vec<u32>,
    /// The triangles that appear.
    pub triangles: Vec<StoredTriangle>,
    /// Split `i` owns `edges[edge_start[i] .. edge_start[i + 1]]`.
    pub edge_start: Vec<u32>,
    /// The slots of the dangling edges that appear.
    pub edges: Vec<u32>,
    /// The slots of the new vertices.
    pub new_vertices: Vec<u32>,
    /// Where the new vertices lie, in steps of the coarser level.
    pub new_vertex_positions: Vec<[i32; 3]>,
    /// The shift of the finer level.
    pub shift: u8,
    /// How the merged vertices were placed.
    pub placement: Placement,
    /// Where the shift changes: vertices of the finer level (by slot) and the low bits they lose.
    pub low_bits: Vec<(u32, [u16; 3])>,
    /// The bound on the error of the *coarser* level, in steps of the full level.
    pub error: f64,
    /// What the batch does to each layer.
    pub layers: Vec<StoredWedges>,
}

impl StoredBatch {
    /// Store what `coarsen` made; the slots are those of the finer level.
    pub fn new(c: &Coarsened, fine: &Level, vertex_slot: &[u32], face_slot: &[u32], placement: Placement) -> Self {
        let b = &c.batch;
        let mut s = StoredBatch {
            pairs: c.pairs.iter().map(|p| p.map(|v| vertex_slot[v as usize])).collect(),
            delta: b.delta.clone(),
            side_start: vec![0],
            triangle_start: vec![0],
            edge_start: vec![0],
            new_vertices: c.new_vertices.iter().map(|&v| vertex_slot[v as usize]).collect(),
            new_vertex_positions: b.new_vertices.clone(),
            shift: b.shift,
            placement,
            ..StoredBatch::default()
        };
        let mut coarse_slot = vec![0u32; c.level.positions.len()];
        for (v, &w) in c.vertex.iter().enumerate().rev() {
            if w != crate::format::complex::NONE {
                coarse_slot[w as usize] = vertex_slot[v];
            }
        }
        let mut inserted = c.inserted.iter();
        let mut slot = || face_slot[*inserted.next().unwrap_or(&0) as usize];
        for i in 0..b.len() {
            for (&f, &side) in c.star.get(b.vertex[i]).iter().zip(b.sides_of(i)) {
                if side != Side::One {
                    s.sides.push((face_slot[c.element[f as usize] as usize], side));
                }
            }
            s.side_start.push(s.sides.len() as u32);
            for t in b.triangles_of(i) {
                s.triangles.push(StoredTriangle {
                    slot: slot(),
                    apex: coarse_slot[t.apex as usize],
                    reversed: t.reversed,
                });
            }
            s.triangle_start.push(s.triangles.len() as u32);
            for _ in 0..b.edges[i] {
                s.edges.push(slot());
            }
            s.edge_start.push(s.edges.len() as u32);
        }
        let down = placement.shift - fine.shift;
        if down > 0 {
            let mask = (1 << down) - 1;
            s.low_bits =
                fine.positions.iter().zip(vertex_slot).map(|(p, &slot)| (slot, p.map(|c| (c & mask) as u16))).collect();
        }
        s
    }

    /// Number of splits.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether nothing splits.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }
}

/// A simplified mesh and the way back.
#[derive(Clone, Debug)]
pub struct History {
    /// The coarsest level.
    pub base: Level,
    /// The slot of each of its vertices.
    pub vertex_slot: Vec<u32>,
    /// The slot of each of its elements.
    pub face_slot: Vec<u32>,
    /// Its attributes: wedges by slots; the values of wedges that are gone are those that they went with.
    pub attributes: Attributes,
    /// The label of each element of the full level; empty where all have label 0.
    pub labels: Vec<u16>,
    /// The batches, finest first.
    pub batches: Vec<StoredBatch>,
    /// Edges weighed in all.
    pub edges_weighed: u64,
    /// Seconds spent weighing, selecting, collapsing.
    pub seconds: [f64; 3],
    /// Who weighed at the end: `cpu` or the name of a device.
    pub weighed_by: String,
    /// Why the one who was to weigh did not go on.
    pub fallback: Option<String>,
    /// Whether the caller stopped it: there are coarser levels.
    pub cancelled: bool,
}
