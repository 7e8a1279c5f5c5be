//! The entropy coder: a range coder with adaptive binary models, and densities of residuals on top of it.

pub mod density;
pub mod range;
