//! The mesh as a file gives it and as a file gets it: positions in `f64`, polygons of any degree, no order
//! or manifoldness assumed.
//!
//! Invariants (checked by [`Mesh::validate`]): `face_start` begins with 0, is non-decreasing and ends with
//! `corners.len()`; every element has at least two corners; every corner names a vertex; coordinates are finite; a layer has a value or
//! [`NO_VALUE`] for each corner, the latter at all corners of an element or at none, and its numbers are finite.

mod appearance;
mod isolated;
pub mod lattice;
mod layer;
pub mod quantizer;

pub use appearance::{Appearance, Image};
pub use layer::{Layer, LayerKind, MAX_WIDTH, NO_VALUE, Stored};

use thiserror::Error;

/// A polygon mesh in the coordinates of its file.
///
/// *Elements* are polygons of degree ≥ 3 and dangling edges, which are elements of degree 2. A vertex that
/// no element names is an isolated vertex. An element may repeat a vertex; equal elements may occur many times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// One position per vertex, in the units of the file.
    pub positions: Vec<[f64; 3]>,
    /// Element `f` has the corners `corners[face_start[f] .. face_start[f + 1]]`; `len = elements + 1`, or 0 when there are none.
    pub face_start: Vec<u32>,
    /// The vertex of each corner.
    pub corners: Vec<u32>,
    /// Attributes on corners.
    pub layers: Vec<Layer>,
    /// For each element its material, or [`NO_VALUE`]; empty where no element has one.
    pub material: Vec<u32>,
    /// Materials, textures and images.
    pub appearance: Appearance,
}

/// What is wrong with a mesh handed in by a caller.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not a finite number ({value})")]
    NotFinite {
        /// The vertex, from 0.
        vertex: usize,
        /// The offending coordinate.
        value: f64,
    },
    /// A corner names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are {vertices} vertices")]
    IndexOutOfRange {
        /// The face, from 0.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// The number of vertices.
        vertices: usize,
    },
    /// `face_start` is not a partition of `corners`.
    #[error("face_start is not a partition of the {corners} corners (element {face})")]
    BadFaceStart {
        /// The first offending element.
        face: usize,
        /// The number of corners.
        corners: usize,
    },
    /// An element of fewer than two corners.
    #[error("face {face} has {degree} corners; an element has at least two")]
    Degree {
        /// The face, from 0.
        face: usize,
        /// Its number of corners.
        degree: usize,
    },
    /// A layer is not one of the mesh: `what` says how.
    #[error("layer {layer}: {what} ({at})")]
    Layer {
        /// Its name.
        layer: String,
        /// What is wrong.
        what: &'static str,
        /// Where: a corner, a face or a value, from 0, as `what` says.
        at: usize,
    },
    /// Materials that the mesh does not have, or not one for each element.
    #[error("{what} ({at})")]
    Material {
        /// What is wrong.
        what: &'static str,
        /// The face, or the number of entries.
        at: usize,
    },
    /// More vertices or corners than 32-bit numbers hold.
    #[error("{what}: {count} exceed the limit of {limit}")]
    TooLarge {
        /// `"vertices"` or `"corners"`.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
}

impl Mesh {
    /// Number of vertices, isolated ones included.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Number of elements: polygons and dangling edges.
    pub fn face_count(&self) -> usize {
        self.face_start.len().saturating_sub(1)
    }

    /// The corners of element `f`, in its orientation.
    pub fn face(&self, f: usize) -> &[u32] {
        &self.corners[self.face_start[f] as usize..self.face_start[f + 1] as usize]
    }

    /// The elements in order.
    pub fn faces(&self) -> impl ExactSizeIterator<Item = &[u32]> + '_ {
        (0..self.face_count()).map(|f| self.face(f))
    }

    /// Append an element.
    pub fn push_face(&mut self, corners: &[u32]) {
        if self.face_start.is_empty() {
            self.face_start.push(0);
        }
        self.corners.extend_from_slice(corners);
        self.face_start.push(self.corners.len() as u32);
    }

    /// The smallest axis-aligned box around all vertices, `None` without vertices.
    pub fn bounds(&self) -> Option<([f64; 3], [f64; 3])> {
        let first = *self.positions.first()?;
        Some(self.positions.iter().fold((first, first), |(mut lo, mut hi), p| {
            for k in 0..3 {
                lo[k] = lo[k].min(p[k]);
                hi[k] = hi[k].max(p[k]);
            }
            (lo, hi)
        }))
    }

    /// Check the invariants of the type.
    ///
    /// # Errors
    /// The first violation found, in the order sizes, partition, degrees and indices, coordinates.
    pub fn validate(&self) -> Result<(), MeshError> {
        let limit = u32::MAX as usize - 1;
        for (what, count) in [("vertices", self.positions.len()), ("corners", self.corners.len())] {
            if count > limit {
                return Err(MeshError::TooLarge { what, count, limit });
            }
        }
        let corners = self.corners.len();
        match (self.face_start.first(), self.face_start.last()) {
            (None, None) if corners == 0 => {}
            (Some(0), Some(&last)) if last as usize == corners => {}
            _ => return Err(MeshError::BadFaceStart { face: 0, corners }),
        }
        for f in 0..self.face_count() {
            let (a, b) = (self.face_start[f] as usize, self.face_start[f + 1] as usize);
            if a > b || b > corners {
                return Err(MeshError::BadFaceStart { face: f, corners });
            }
            if b - a < 2 {
                return Err(MeshError::Degree { face: f, degree: b - a });
            }
            for &vertex in &self.corners[a..b] {
                if vertex as usize >= self.positions.len() {
                    return Err(MeshError::IndexOutOfRange { face: f, vertex, vertices: self.positions.len() });
                }
            }
        }
        for (vertex, p) in self.positions.iter().enumerate() {
            if let Some(&value) = p.iter().find(|c| !c.is_finite()) {
                return Err(MeshError::NotFinite { vertex, value });
            }
        }
        self.layers.iter().try_for_each(|layer| self.validate_layer(layer))?;
        if !self.material.is_empty() && self.material.len() != self.face_count() {
            return Err(MeshError::Material {
                what: "there is not one material for each face",
                at: self.material.len(),
            });
        }
        let materials = self.appearance.materials.len();
        if let Some(at) = self.material.iter().position(|&m| m != NO_VALUE && m as usize >= materials) {
            return Err(MeshError::Material { what: "face has a material that is not there", at });
        }
        Ok(())
    }

    fn validate_layer(&self, layer: &Layer) -> Result<(), MeshError> {
        let fail = |what, at| Err(MeshError::Layer { layer: layer.name.clone(), what, at });
        if !(1..=MAX_WIDTH).contains(&layer.width) {
            return fail("a value has 1 to 4 components", layer.width as usize);
        }
        if !layer.values.len().is_multiple_of(layer.width as usize) || layer.len() > u32::MAX as usize - 1 {
            return fail("not a whole number of values, or more than 2^32 - 2", layer.values.len());
        }
        if layer.corners.len() != self.corners.len() {
            return fail("not one value for each corner", layer.corners.len());
        }
        let n = layer.len() as u32;
        if let Some(at) = layer.corners.iter().position(|&i| i != NO_VALUE && i >= n) {
            return fail("corner names a value that is not there", at);
        }
        for f in 0..self.face_count() {
            let own = &layer.corners[self.face_start[f] as usize..self.face_start[f + 1] as usize];
            if own.contains(&NO_VALUE) && own.iter().any(|&i| i != NO_VALUE) {
                return fail("face has values at some corners only", f);
            }
        }
        let mut last = None;
        for &[v, i] in &layer.isolated {
            if v as usize >= self.positions.len() || i >= n || last.is_some_and(|l| l >= v) {
                return fail("isolated vertices out of order or range", v as usize);
            }
            last = Some(v);
        }
        if let Some(at) = layer.values.iter().position(|x| !x.is_finite()) {
            return fail("value is not a finite number", at / layer.width as usize);
        }
        Ok(())
    }
}
