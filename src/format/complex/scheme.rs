//! What holds for the attributes of every level of a file.

/// What holds for the attributes of a whole file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Scheme {
    /// Components of the values of each layer.
    pub widths: Vec<usize>,
    /// For each label the layers in which its elements have values, a bit each. Never empty when there are layers.
    pub presence: Vec<u32>,
}

/// The most layers of a file: presence has a bit for each.
pub const MAX_LAYERS: usize = 32;

impl Scheme {
    /// Whether elements of label `label` have values in layer `layer`.
    #[inline]
    pub fn has(&self, label: u16, layer: usize) -> bool {
        self.presence.get(label as usize).is_some_and(|p| p >> layer & 1 == 1)
    }

    /// Whether there is nothing to carry.
    pub fn is_empty(&self) -> bool {
        self.widths.is_empty() && self.presence.len() < 2
    }
}
