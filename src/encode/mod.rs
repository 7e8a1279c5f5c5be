//! The encoder's front door: a mesh in, the bytes of a `.lods` file and an account of the work out.

mod assemble;
mod attributes;
#[doc(hidden)]
pub mod cost;
#[doc(hidden)]
pub mod levels;
mod loss;
#[cfg(all(feature = "quality", feature = "recompress"))]
pub mod pipeline;
#[cfg(feature = "quality")]
pub mod quality_order;
mod schedule;
mod sets;
#[doc(hidden)]
pub mod simplify;
#[doc(hidden)]
pub mod trace;

pub use attributes::AttributeError;
pub use loss::{LayerLoss, Loss, LossWarning};
pub use schedule::Schedule;

use crate::encode::cost::Engine;
use crate::encode::levels::LevelsError;
use crate::format::container::ContainerError;
use crate::image::jpeg::{Exactness, Treatment};
use crate::mesh::lattice::{LatticeError, Quantization};
use crate::mesh::quantizer::Precision;
use crate::mesh::{Mesh, MeshError};
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

/// What the user chooses. Fields have methods of the same name that set them, one after the other:
/// `EncodeOptions::default().color_bits(10).lock_borders(true)`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct EncodeOptions {
    /// The lattice of the positions.
    pub quantization: Quantization,
    /// Never move a vertex of a border, so that tiles fit at every level.
    pub lock_borders: bool,
    /// Texture coordinates: bits on the longest side of their box, or a step.
    pub uv: Precision,
    /// Bits of each of the two numbers of a normal or tangent, 2 to 16.
    pub normal_bits: u8,
    /// Bits of each component of a colour, 1 to 24.
    pub color_bits: u8,
    /// Bits on the range of any other attribute, 1 to 24; whole numbers stay whole where 24 bits hold them.
    pub scalar_bits: u8,
    /// Whether images come back with the same pixels, or byte by byte; see [`texture`](crate::image::jpeg).
    pub images: Exactness,
    /// What comes first, the mesh or its images.
    pub schedule: Schedule,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        EncodeOptions {
            quantization: Quantization::Bits(12),
            lock_borders: false,
            uv: Precision::Bits(12),
            normal_bits: 10,
            color_bits: 8,
            scalar_bits: 16,
            images: Exactness::default(),
            schedule: Schedule::default(),
        }
    }
}

impl EncodeOptions {
    /// Set [`EncodeOptions::quantization`](field@EncodeOptions::quantization).
    pub fn quantization(mut self, quantization: Quantization) -> Self {
        self.quantization = quantization;
        self
    }

    /// Set [`EncodeOptions::lock_borders`](field@EncodeOptions::lock_borders).
    pub fn lock_borders(mut self, lock_borders: bool) -> Self {
        self.lock_borders = lock_borders;
        self
    }

    /// Set [`EncodeOptions::uv`](field@EncodeOptions::uv).
    pub fn uv(mut self, uv: Precision) -> Self {
        self.uv = uv;
        self
    }

    /// Set [`EncodeOptions::normal_bits`](field@EncodeOptions::normal_bits).
    pub fn normal_bits(mut self, normal_bits: u8) -> Self {
        self.normal_bits = normal_bits;
        self
    }

    /// Set [`EncodeOptions::color_bits`](field@EncodeOptions::color_bits).
    pub fn color_bits(mut self, color_bits: u8) -> Self {
        self.color_bits = color_bits;
        self
    }

    /// Set [`EncodeOptions::scalar_bits`](field@EncodeOptions::scalar_bits).
    pub fn scalar_bits(mut self, scalar_bits: u8) -> Self {
        self.scalar_bits = scalar_bits;
        self
    }

    /// Set [`EncodeOptions::images`](field@EncodeOptions::images).
    pub fn images(mut self, images: Exactness) -> Self {
        self.images = images;
        self
    }

    /// Set [`EncodeOptions::schedule`](field@EncodeOptions::schedule).
    pub fn schedule(mut self, schedule: Schedule) -> Self {
        self.schedule = schedule;
        self
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
    /// Level 0, isolated vertices and new vertices.
    pub points: f64,
    /// Which vertices split, and how.
    pub connectivity: f64,
    /// Where the children of the splits lie.
    pub geometry: f64,
    /// Faces that repeat a vertex, which travel aside.
    pub degenerate: f64,
    /// Labels, wedges and their values.
    pub attributes: f64,
    /// Materials, textures and samplers.
    pub appearance: f64,
    /// Images.
    pub images: f64,
    /// Previews of images.
    pub previews: f64,
}

/// What was done with an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageReport {
    /// Its name, or `image` and its number where it has none.
    pub name: String,
    /// Bytes of its file.
    pub bytes: u64,
    /// Bytes of its chunks, without those of its previews.
    pub stored: u64,
    /// Bytes of the chunk of each of its previews, coarse before fine.
    pub previews: Vec<u64>,
    /// Pieces that it came into; each prefix of them is a picture.
    pub pieces: usize,
    /// What was done with it.
    pub way: Treatment,
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
    /// Who weighed them: `cpu` or the name of a device. The bytes do not say.
    pub weighed_by: String,
    /// Why the device that was to weigh them did not go on and the processor did.
    pub fallback: Option<String>,
    /// Seconds spent weighing edges; on a device, beside collapsing.
    pub weigh_seconds: f64,
    /// Seconds spent selecting batches.
    pub select_seconds: f64,
    /// Seconds spent collapsing.
    pub collapse_seconds: f64,
    /// Seconds spent coding.
    pub encode_seconds: f64,
    /// The images, in their order; without those of which the source had but the name.
    pub images: Vec<ImageReport>,
    /// What quantization cost.
    pub loss: Loss,
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
    /// Its attributes cannot be carried.
    #[error(transparent)]
    Attributes(#[from] AttributeError),
    /// The container cannot hold it.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// The caller stopped it.
    #[error("stopped by the caller")]
    Cancelled,
    /// A bug of the encoder.
    #[error("{0}; this is a bug of the encoder, please report it with the mesh")]
    Bug(#[from] LevelsError),
}

/// Progress and cancellation of one encoding.
#[derive(Clone, Copy, Default)]
pub struct Control<'a> {
    progress: Option<&'a (dyn Fn(Progress) + Sync)>,
    cancel: Option<&'a AtomicBool>,
}

impl<'a> Control<'a> {
    /// Nobody listens, and nobody stops it.
    pub fn new() -> Self {
        Control::default()
    }

    /// Tell `progress` where the work stands, several times a second while it lasts; from any thread.
    pub fn progress(mut self, progress: &'a (dyn Fn(Progress) + Sync)) -> Self {
        self.progress = Some(progress);
        self
    }

    /// Stop soon after `cancel` becomes true, with [`EncodeError::Cancelled`].
    pub fn cancel(mut self, cancel: &'a AtomicBool) -> Self {
        self.cancel = Some(cancel);
        self
    }

    /// Report progress; whether to go on.
    fn report(&self, stage: Stage, done: u64, total: u64) -> bool {
        if let Some(progress) = self.progress {
            progress(Progress { stage, done, total });
        }
        !self.cancelled()
    }

    fn cancelled(&self) -> bool {
        self.cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed))
    }
}

/// Encode `mesh`. Runs on the current rayon pool; the bytes do not depend on its size.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use lodestream::{EncodeOptions, Mesh, Quantization};
///
/// let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..Mesh::default() };
/// mesh.push_face(&[0, 1, 2]);
/// let encoded = lodestream::encode(&mesh, &EncodeOptions::default().quantization(Quantization::Bits(14)))?;
/// assert_eq!(lodestream::decode(&encoded.bytes)?.face_count(), 1);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`EncodeError`] when the mesh is invalid or its coordinates do not fit the lattice.
pub fn encode(mesh: &Mesh, options: &EncodeOptions) -> Result<Encoded, EncodeError> {
    encode_with(mesh, options, Engine::default(), Control::new())
}

/// [`encode`] with somebody who weighs edges, and with progress and cancellation. A device that fails is replaced by the
/// processor, which [`EncodeReport::fallback`] tells; the file is exact either way.
///
/// # Errors
/// As [`encode`], and [`EncodeError::Cancelled`].
pub fn encode_with(
    mesh: &Mesh,
    options: &EncodeOptions,
    engine: Engine,
    control: Control,
) -> Result<Encoded, EncodeError> {
    Ok(assemble::assemble(mesh, options, engine, control)?.write()?)
}
