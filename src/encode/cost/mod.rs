//! What a collapse costs: the edges of a level, the weight of each, and bounds of the error a collapse makes.
//!
//! Follows Caillaud et al. 2016, section 4.2, with the corrections stated in the modules. Encoder side only: floating
//! point is used up to [`Fixed`], and every decision after it is made on integers.

mod bisect;
mod bound;
mod choice;
mod edges;
mod evaluator;
mod fixed;
mod gather;
mod kernel;
mod lanes;
mod seam;
mod weigher;
mod weight;

pub use bound::{BoundScratch, hausdorff_between, hausdorff_bound};
pub use choice::DeviceChoice;
pub use edges::{EdgeList, neighbours};
pub use evaluator::{Carried, Cpu, Engine, EvaluateError, Evaluator, Task, WeighInput, weigh_some};
pub use fixed::{Fixed, Scale};
pub use gather::Gatherer;
#[cfg(feature = "gpu")]
pub(crate) use gather::Side;
pub use seam::{SeamInput, SeamPatch, SeamReader, add_seams, seam_displacement};
pub use weigher::{Weigher, dirty_vertices};
pub use weight::{Class, MAX_RING, Patch, PatchTriangle, RingVertex, Scratch, Weight, edge_weight, triangle_distance2};

#[cfg(test)]
pub(crate) mod tests;
