//! The encoder's front door: a mesh in, the bytes of a `.lods` file and an account of the work out.

use crate::lattice::{LatticeError, Quantization};
use crate::mesh::{Mesh, MeshError};
use thiserror::Error;

/// What the user chooses.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeOptions {
    /// The lattice of the positions.
    pub quantization: Quantization,
    /// Never move a vertex of a border, so that tiles fit at every level.
    pub lock_borders: bool,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        EncodeOptions { quantization: Quantization::Bits(12), lock_borders: false }
    }
}

/// Where the work stands, for progress bars.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// How much of it is done, of `total`.
    pub done: u64,
    /// How much there is to do.
    pub total: u64,
}

/// The stages of an encoding, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Weighing, selecting and collapsing; counted in vertices removed.
    Simplify,
    /// Coding batches into chunks; counted in vertices restored.
    Encode,
}

/// Bits of the file by what they say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BitsByKind {
    /// Header, level and chunk tables, checksums.
    pub header: f64,
    /// Level 0, isolated vertices and births.
    pub points: f64,
    /// Which vertices split, and how.
    pub connectivity: f64,
    /// Where the children of the splits lie.
    pub geometry: f64,
    /// Faces that repeat a vertex, which travel aside.
    pub aside: f64,
}

/// An account of one encoding.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EncodeReport {
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Its elements.
    pub faces: usize,
    /// Its connected components; an isolated vertex is one.
    pub components: usize,
    /// Levels of detail in the file, the full one included.
    pub levels: usize,
    /// Where the bits went.
    pub bits: BitsByKind,
    /// Edges weighed in all.
    pub edges_weighed: u64,
    /// Seconds spent weighing edges.
    pub weigh_seconds: f64,
    /// Seconds spent selecting batches.
    pub select_seconds: f64,
    /// Seconds spent collapsing.
    pub collapse_seconds: f64,
    /// Seconds spent coding.
    pub encode_seconds: f64,
}

/// An encoded mesh.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// The file.
    pub bytes: Vec<u8>,
    /// For each vertex of the input the number it has at the full level of the file.
    pub map: Vec<u32>,
    /// What was done.
    pub report: EncodeReport,
}

/// Why a mesh could not be encoded.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The mesh breaks its own invariants.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The lattice cannot hold it.
    #[error(transparent)]
    Lattice(#[from] LatticeError),
}

/// Encode `mesh`. Runs on the current rayon pool; the bytes do not depend on its size.
///
/// # Errors
/// [`EncodeError`] when the mesh is invalid or its coordinates do not fit the lattice.
pub fn encode(
    mesh: &Mesh,
    options: &EncodeOptions,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Encoded, EncodeError> {
    mesh.validate()?;
    let _ = (options, progress);
    Ok(Encoded { bytes: Vec::new(), map: Vec::new(), report: EncodeReport::default() })
}
