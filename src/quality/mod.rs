//! What a level is worth: distances between meshes, the likeness of their pictures, the error of their texture coordinates.
//!
//! It measures and decides nothing: no other room of the library depends on it, and it uses floating point freely. Results are the same
//! for any number of threads.

mod distance;
pub mod heat;
mod surface;

pub use distance::{Directed, Geometry, SampleOptions, Sampled, Weights, diagonal, geometry, geometry_of};
pub use surface::{Nearest, Origin, Surface};
