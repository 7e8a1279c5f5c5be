//! What a level is worth: distances between meshes, the likeness of their pictures, the error of their texture coordinates.
//!
//! It measures and decides nothing: no other room of the library depends on it, and it uses floating point freely. Results are the same
//! for any number of threads.

mod appearance;
mod distance;
pub mod heat;
mod ssim;
mod surface;
mod uv;

pub use appearance::{Appearance, MOST_VIEWS, Snapshots, ViewOptions, directions};
pub use distance::{Directed, Geometry, SampleOptions, Sampled, Weights, diagonal, geometry, geometry_of};
pub use ssim::{LEAST_SIDE, SsimError, ms_ssim};
pub use surface::{Nearest, Origin, Surface};
pub use uv::{Stretch, UvError, layer as uv_layer, stretch, uv_error};
