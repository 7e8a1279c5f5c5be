//! Files of other formats: readers, with a survey that foresees their size, and writers.

pub(crate) mod beside;
pub mod files;
pub(crate) mod memory;
pub(crate) mod name;
pub mod read;
pub mod write;
