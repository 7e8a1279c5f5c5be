//! The adaptive models of all attributes of a file.

use super::structure::StructureModels;
use super::values::ValueModels;
use crate::format::coder::range::Bit;
use crate::format::complex::Scheme;

/// Adaptive models of all attributes.
#[derive(Clone, Debug, Default)]
pub struct AttributeModels {
    pub(super) labels: LabelModels,
    pub(super) layers: Vec<(StructureModels, ValueModels)>,
}

impl AttributeModels {
    /// Models for the layers of `scheme`.
    pub fn new(scheme: &Scheme) -> Self {
        let layers = scheme.widths.iter().map(|&w| (StructureModels::default(), ValueModels::new(w))).collect();
        AttributeModels { labels: LabelModels::default(), layers }
    }
}

#[derive(Clone, Debug)]
pub(super) struct LabelModels {
    pub(super) same: [Bit; 3],
    pub(super) second: Bit,
}

impl Default for LabelModels {
    fn default() -> Self {
        LabelModels { same: [Bit::with(60000), Bit::default(), Bit::with(50000)], second: Bit::with(60000) }
    }
}
