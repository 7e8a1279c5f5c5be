//! What a level is worth: exact comparison, distances between meshes, pictures of them and the likeness of the pictures, the
//! error of their texture coordinates.
//!
//! It measures and decides nothing, and uses floating point freely. Results are the same for any number of threads.

#[cfg(feature = "quality")]
mod appearance;
#[cfg(feature = "quality")]
mod distance;
pub mod exact;
#[cfg(feature = "quality")]
pub mod heat;
#[cfg(feature = "images")]
pub mod picture;
#[cfg(feature = "quality")]
mod ssim;
#[cfg(feature = "quality")]
mod surface;
#[cfg(feature = "quality")]
mod uv;

#[cfg(feature = "quality")]
pub use appearance::{Appearance, MAX_VIEWS, Snapshots, ViewOptions, directions};
#[cfg(feature = "quality")]
pub use distance::{Directed, Geometry, SampleOptions, Sampled, Weights, diagonal, geometry, geometry_of};
#[cfg(feature = "quality")]
pub use ssim::{MIN_SIDE, SsimError, ms_ssim};
#[cfg(feature = "quality")]
pub use surface::{Nearest, Origin, Surface};
#[cfg(feature = "quality")]
pub use uv::{Stretch, UvError, layer as uv_layer, stretch, uv_error};
