//! The complex: connectivity and integer positions of one level of detail, and the operators between levels.
//!
//! Follows Caillaud et al. 2016, section 4.1 (generic edge collapse and vertex split), with levels as multisets:
//! elements that become equal stay, both.

mod level;
mod star;

pub use level::{Faces, Level};
pub use star::Star;
