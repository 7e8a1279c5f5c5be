//! The entropy coder: a range coder with adaptive binary models, and densities of residuals on top of it.

pub mod density;
pub mod range;

use thiserror::Error;

/// A stream that contradicts itself, or the header; the text says what is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct InvalidStream(pub &'static str);
