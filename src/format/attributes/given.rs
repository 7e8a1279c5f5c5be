//! The attributes of splits as an encoder hands them to the coder, and what it is told back; a decoder has neither.
//!
//! Wedges go by names that the encoder chose, its *keys*: the coder only asks which of them are equal, and what values they have.

use super::values::{Value, WIDTH};
use crate::format::complex::{Inserted, NEW, NONE, Split};

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

/// One layer of the splits of a segment.
#[derive(Clone, Debug, Default)]
pub struct GivenLayer<'a> {
    /// For each side of each split the keys at the children, in the encoder's order of them: at the first and the second child
    /// of an element that grows, twice the same else.
    pub star: Vec<[u32; 2]>,
    /// For each element that appears, a split's triangles before its dangling edges: the keys at the first child, the second, the apex.
    pub inserted: Vec<[u32; 3]>,
    /// The key of each wedge of the coarser level.
    pub key_of_wedge: &'a [u32],
    /// Components of a value.
    pub width: usize,
    /// The values at the finer level by key, `width` integers each.
    pub values: &'a [i32],
}

impl GivenLayer<'_> {
    /// The key of wedge `w` of the coarser level.
    pub(super) fn key(&self, w: u32) -> u32 {
        self.key_of_wedge.get(w as usize).copied().unwrap_or(NONE)
    }

    /// The value at the finer level of the wedge with this key.
    pub(super) fn value(&self, key: u32) -> Value {
        let mut out = [0; WIDTH];
        if let Some(value) = self.values.get(key as usize * self.width..(key as usize + 1) * self.width) {
            out[..self.width].copy_from_slice(value);
        }
        out
    }
}

/// The attributes of the splits of a segment.
#[derive(Clone, Debug, Default)]
pub struct GivenAttributes<'a> {
    /// The labels of the elements that appear, in the order of [`GivenLayer::inserted`].
    pub labels: Vec<u16>,
    /// Layer by layer.
    pub layers: Vec<GivenLayer<'a>>,
}

/// One split of them, which the coder has brought into canonical form.
#[derive(Clone, Copy, Debug)]
pub struct GivenSplit<'a> {
    /// The attributes of the segment.
    pub attributes: &'a GivenAttributes<'a>,
    /// Its first side.
    pub side: usize,
    /// Its first element that appears.
    pub inserted: usize,
    /// Its triangles, in the encoder's order and with its children.
    pub triangles: &'a [Inserted],
    /// Whether the children changed places on the way to the canonical form.
    pub swapped: bool,
}

impl GivenSplit<'_> {
    /// Labels and keys in the order of the canonical form, `split`.
    pub(super) fn arrange(&self, split: &Split, used: &mut Vec<bool>, out: &mut SplitAttributes) {
        let GivenSplit { attributes, side, inserted, triangles, swapped } = *self;
        let children = |[one, two]: [u32; 2]| if swapped { [two, one] } else { [one, two] };
        out.labels.clear();
        out.layers.resize_with(attributes.layers.len(), Keys::default);
        for (layer, keys) in attributes.layers.iter().zip(&mut out.layers) {
            keys.star.clear();
            keys.star.extend(layer.star[side..side + split.sides.len()].iter().map(|&pair| children(pair)));
            keys.inserted.clear();
        }
        let mut put = |at: usize| {
            out.labels.push(attributes.labels.get(at).copied().unwrap_or(0));
            for (layer, keys) in attributes.layers.iter().zip(&mut out.layers) {
                let [one, two, apex] = layer.inserted[at];
                let [one, two] = children([one, two]);
                keys.inserted.push([one, two, apex]);
            }
        };
        used.clear();
        used.resize(triangles.len(), false);
        for t in &split.triangles {
            let found = (0..triangles.len())
                .find(|&j| !used[j] && triangles[j].apex == t.apex && (triangles[j].reversed ^ swapped) == t.reversed);
            if let Some(j) = found {
                used[j] = true;
                put(inserted + j);
            }
        }
        for e in 0..split.edges as usize {
            put(inserted + triangles.len() + e);
        }
    }
}

/// Which wedge stands for which key at the finer level, layer by layer: an old number, or a new one (`NEW | i`). Old numbers
/// that keep their key are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Named(pub Vec<Vec<(u32, u32)>>);

impl Named {
    /// Note that wedge `w` stands for `key`.
    pub(super) fn note(&mut self, l: usize, layer: &GivenLayer, w: u32, key: u32) {
        if w & NEW != 0 || layer.key(w) != key {
            if self.0.len() <= l {
                self.0.resize_with(l + 1, Vec::new);
            }
            self.0[l].push((w, key));
        }
    }
}
