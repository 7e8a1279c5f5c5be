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
mod scratch;
mod structure;
mod values;
mod wedge_selection;
mod wedge_values;

pub use base::{ExtraAttributes, code_base_layers, code_extra_attributes};
pub use structure::{AttributeScratch, code_attributes};
pub use values::{VALUE_LIMIT, Value, WIDTH};

use self::structure::StructureModels;
use self::values::ValueModels;
use crate::format::coder::range::Bit;
use crate::format::complex::Split;
use crate::format::split::neighbourhood::LevelGeometry;

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

/// Adaptive models of all attributes.
#[derive(Clone, Debug, Default)]
pub struct AttributeModels {
    labels: LabelModels,
    layers: Vec<(StructureModels, ValueModels)>,
}

impl AttributeModels {
    /// Models for the layers of `scheme`.
    pub fn new(scheme: &Scheme) -> Self {
        let layers = scheme.widths.iter().map(|&w| (StructureModels::default(), ValueModels::new(w))).collect();
        AttributeModels { labels: LabelModels::default(), layers }
    }
}

#[derive(Clone, Debug)]
struct LabelModels {
    same: [Bit; 3],
    second: Bit,
}

impl Default for LabelModels {
    fn default() -> Self {
        LabelModels { same: [Bit::with(60000), Bit::default(), Bit::with(50000)], second: Bit::with(60000) }
    }
}

/// An element around a vertex: its place in the star, and the corners of the vertex and of its neighbours there, counted over the level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElementCorners {
    /// Its place in the star.
    pub place: u32,
    /// The corner of the vertex.
    pub own: u32,
    /// The corner after it.
    pub next: u32,
    /// The corner before it.
    pub prev: u32,
}

/// The wedges of one layer around the children of a split, by names that the source chose: its *keys*.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Keys {
    /// For each element of the star, in its order, the wedge at the child that gets it; at the first and the second child where it grows.
    pub star: Vec<[u32; 2]>,
    /// For each element that appears, a split's triangles before its dangling edges: at the first child, at the second, at the apex.
    pub inserted: Vec<[u32; 3]>,
}

/// What an encoder knows of the attributes around the children of a split.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SplitAttributes {
    /// The labels of the elements that appear.
    pub labels: Vec<u16>,
    /// Layer by layer.
    pub layers: Vec<Keys>,
}

/// Where an encoder's attributes come from; a decoder has none.
pub trait AttributeSource {
    /// The attributes around the children of `v`, for a split in canonical form.
    fn quantize_attributes(&mut self, _view: &LevelGeometry, _v: u32, _split: &Split, _dress: &mut SplitAttributes) {}
    /// The key of wedge `w` of the coarser level.
    fn key(&self, _layer: usize, _w: u32) -> u32 {
        0
    }
    /// The value at the finer level of the wedge with this key.
    fn value(&self, _layer: usize, _key: u32) -> Value {
        [0; WIDTH]
    }
    /// Hears which wedge stands for which key at the finer level: an old number, or a new one (`NEW | i`).
    fn named(&mut self, _layer: usize, _w: u32, _key: u32) {}
}
