//! From batches to bits and back: the range coder, its adaptive models, and the coders of each kind of symbol.
//!
//! Everything here is integer arithmetic with stated widths, so that a file decodes alike on every machine.

pub mod appearance;
pub mod around;
pub mod aside;
pub mod base;
pub mod cut;
pub mod density;
pub mod layers;
pub mod patch;
pub mod points;
pub mod range;
pub mod segment;
pub mod spread;
pub mod stream;
