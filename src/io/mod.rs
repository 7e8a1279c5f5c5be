//! Files of other formats: readers, with a survey that foresees their size, and writers.

pub mod read;
pub mod write;
