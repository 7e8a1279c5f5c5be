//! The mesh as a file gives it and as a file gets it: positions in `f64`, polygons of any degree, no order
//! or manifoldness assumed.
//!
//! Invariants (checked by [`Mesh::validate`]): `face_start` begins with 0, is non-decreasing and ends with
//! `corners.len()`; every element has at least two corners; every corner names a vertex; coordinates are finite.

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
        Ok(())
    }
}
