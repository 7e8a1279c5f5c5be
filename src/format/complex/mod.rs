//! The complex: connectivity and integer positions of one level of detail, and the operators between levels.
//!
//! Follows Caillaud et al. 2016, section 4.1 (generic edge collapse and vertex split), with levels as multisets:
//! elements that become equal stay, both.

mod attributes;
mod batch;
mod coarsen;
mod level;
pub mod placement;
mod refine;
mod scheme;
mod star;
#[cfg(test)]
pub(crate) mod tests;

pub use attributes::{Attributes, MAX_WEDGES, Wedges, first_of_middle, middle, refine_attributes, touched};
pub use batch::{AttributeBatch, Batch, Inserted, NEW, NONE, Side, Split, WedgeBatch};
pub use coarsen::{Coarsened, Placement, coarsen, legal};
pub use level::{Faces, Level};
pub use refine::{Refined, Wanted, refine};
pub use scheme::{MAX_LAYERS, Scheme};
pub use star::{BIG, Star};
