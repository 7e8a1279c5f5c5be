//! Work on a GPU through wgpu: which device, how much of its memory, how long to wait for it, and the kernels.
//!
//! Nothing here is needed: every kernel has a CPU twin of the same name that is its reference, and whatever goes wrong
//! with a device is a [`DeviceError`] upon which the caller goes on with the twin. So nothing here panics on a device's
//! account, and every wait has a deadline.
//!
//! - [`device`](Device): choosing and opening one; limits; errors that arrive out of turn.
//! - `layout`, `shader`: the texts in `shaders/*.wgsl`, put together; their layout, which a test compares with Rust's.
//! - `buffers`: memory on the device, and dispatches whose results come back by deadline.
//! - `stars`, `resident`, `window`: a level as the kernels read it; how it stays on the device from batch to batch; what is
//!   done where it does not fit.
//! - [`GpuWeights`]: the evaluator of edge weights, twin of [`Cpu`](crate::encode::cost::Cpu).
//! - [`SharedGpu`]: the same for several jobs at a time.
//! - [`distances`]: of points to triangles, and the twin; [`seam_displacements`]: of seams by collapses.

mod buffers;
mod device;
mod error;
mod hausdorff;
mod layout;
mod resident;
mod seams;
mod shader;
mod shared;
mod stars;
mod weights;
mod window;

pub use crate::encode::cost::DeviceChoice;
pub use device::{Device, DeviceInfo, DeviceKind, DeviceOptions, devices, select_device};
pub use error::DeviceError;
pub use hausdorff::{Distances, distances};
pub use seams::seam_displacements;
pub use shared::SharedGpu;
pub use weights::GpuWeights;

#[cfg(test)]
mod tests;
