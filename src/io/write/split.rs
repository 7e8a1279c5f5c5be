//! One value per vertex: what GLB needs of all layers, PLY and OBJ of some.
//!
//! A vertex whose corners differ in their values is repeated, once for each combination. The first combination keeps
//! the vertex's number; the others follow behind all vertices, in the order of their corners.

use crate::mesh::{Layer, Mesh, NO_VALUE};

/// A mesh whose vertices have one value of each of some layers.
pub(super) struct Split {
    /// For each vertex in the file the vertex of the mesh.
    pub vertex: Vec<u32>,
    /// For each corner its vertex in the file.
    pub corners: Vec<u32>,
    /// For each layer and each vertex in the file the value, or [`NO_VALUE`].
    pub values: Vec<Vec<u32>>,
}

impl Split {
    /// How many combinations of a vertex are compared; beyond it the vertex repeats without need.
    const LONGEST: usize = 64;

    pub fn new(mesh: &Mesh, layers: &[&Layer]) -> Split {
        let n = mesh.vertex_count();
        let mut split = Split {
            vertex: (0..n as u32).collect(),
            corners: mesh.corners.clone(),
            values: layers.iter().map(|_| vec![NO_VALUE; n]).collect(),
        };
        if layers.is_empty() {
            return split;
        }
        for (layer, values) in layers.iter().zip(&mut split.values) {
            layer.isolated.iter().for_each(|&[v, i]| values[v as usize] = i);
        }
        let mut seen = vec![false; n];
        // For each vertex in the file the next one of the same vertex of the mesh.
        let mut next = vec![NO_VALUE; n];
        for (corner, &v) in mesh.corners.iter().enumerate() {
            let wanted = |k: usize| layers[k].corners[corner];
            let mut at = v as usize;
            let mut found = None;
            if !std::mem::replace(&mut seen[at], true) {
                (0..layers.len()).for_each(|k| split.values[k][at] = wanted(k));
                found = Some(at);
            }
            for _ in 0..Self::LONGEST {
                if found.is_some() {
                    break;
                }
                if (0..layers.len()).all(|k| same(layers[k], split.values[k][at], wanted(k))) {
                    found = Some(at);
                } else if next[at] == NO_VALUE {
                    break;
                } else {
                    at = next[at] as usize;
                }
            }
            let found = found.unwrap_or_else(|| {
                let new = split.vertex.len();
                split.vertex.push(v);
                (0..layers.len()).for_each(|k| split.values[k].push(wanted(k)));
                // Behind the first of its vertex, so that the chain stays whole.
                let behind = std::mem::replace(&mut next[v as usize], new as u32);
                next.push(behind);
                new
            });
            split.corners[corner] = found as u32;
        }
        split
    }

    /// How many vertices there are more than in the mesh.
    pub fn repeated(&self, mesh: &Mesh) -> u64 {
        (self.vertex.len() - mesh.vertex_count()) as u64
    }
}

/// Equal values, whatever their numbers.
fn same(layer: &Layer, a: u32, b: u32) -> bool {
    if a == b || a == NO_VALUE || b == NO_VALUE {
        return a == b;
    }
    layer.value(a).iter().zip(layer.value(b)).all(|(x, y)| x.to_bits() == y.to_bits())
}

/// Whether every vertex has one value: no seams, and none without.
pub(super) fn per_vertex(mesh: &Mesh, layer: &Layer) -> bool {
    let mut at = vec![NO_VALUE; mesh.vertex_count()];
    layer.isolated.iter().for_each(|&[v, i]| at[v as usize] = i);
    for (&v, &i) in mesh.corners.iter().zip(&layer.corners) {
        let known = &mut at[v as usize];
        if *known == NO_VALUE {
            *known = i;
        }
        if i == NO_VALUE || !same(layer, *known, i) {
            return false;
        }
    }
    !at.contains(&NO_VALUE)
}
