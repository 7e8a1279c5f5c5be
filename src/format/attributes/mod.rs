//! Attributes of a split: labels of the elements that appear, wedges of the corners around the children, and their
//! values.
//!
//! Core paper sections 4.1 and 5.4, in another form: regions are not numbered, they follow from the wedges. Around a
//! vertex that splits, its wedges are *groups*. Nearly always a split is *regular* in a layer: each child has at most
//! one wedge of a group, a triangle that appears continues a wedge beside it, and only which of two sides it continues
//! at a seam has to be coded. Then a group that both children have differs by one coded difference around its middle,
//! and one that a single child has stays as it is. What is not regular (darts, charts that appear, several wedges out
//! of one) is coded corner by corner. `docs/format/attributes.md` and `values.md` have the whole of it.

mod base;
mod given;
mod models;
mod scratch;
mod split;
mod structure;
mod values;
mod wedge_selection;
mod wedge_values;

pub use base::{ExtraAttributes, code_base_layers, code_extra_attributes};
pub use given::{GivenAttributes, GivenLayer, GivenSplit, Named};
pub use models::AttributeModels;
pub use split::{AttributeScratch, SplitTask, code_attributes};
pub use values::{VALUE_LIMIT, Value, WIDTH};
