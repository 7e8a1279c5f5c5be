//! All that a decoder needs, and the parts of an encoder that mirror it: integers only, so that a file decodes alike on
//! every machine.
//!
//! From the bottom up: the range `coder` and its adaptive models; the `complex`, levels and batches as data with the operators
//! between them; the symbols of a `split`; `points`, `elements` and `degenerate` faces; `attributes`; the `container` around
//! the chunks; the `decoder`, which a viewer drives. `docs/format/` is the normative text.

pub mod appearance;
pub mod attributes;
pub mod coder;
pub mod complex;
pub mod container;
pub mod decoder;
pub mod degenerate;
pub mod elements;
pub mod points;
pub mod segment;
pub mod split;
pub mod state;
