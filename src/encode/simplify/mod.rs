//! From the full level to the base: which edges go together, and what leads back.

mod driver;
mod error;
mod history;
mod nearest;
mod order;
mod select;
mod wedges;

pub use driver::{SimplifyOptions, simplify, simplify_on};
pub use history::{History, StoredBatch, StoredTriangle};
pub use order::reorder;
pub use select::{SelectInput, SelectOptions, select};

#[cfg(test)]
mod tests;
