//! From a level to the next coarser one: which edges go together.

mod select;

pub use select::{SelectInput, SelectOptions, select};

#[cfg(test)]
mod tests;
