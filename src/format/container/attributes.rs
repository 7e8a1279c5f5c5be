//! What the front of a file says about its attributes: the layers, how they are quantized, and the labels of elements.

use super::error::{ContainerError, Place, inconsistent};
use super::number::{MAX_COUNT, Number, count, float, raw};
use crate::format::attributes::VALUE_LIMIT;
use crate::format::coder::range::Coder;
use crate::format::complex::MAX_WEDGES;
use crate::format::complex::{MAX_LAYERS, Scheme};
use crate::mesh::quantizer::{Quantizer, WIDTH};
use crate::mesh::{LayerKind, MAX_WIDTH, Stored};

/// The longest name of a layer, in bytes.
pub const MAX_NAME: usize = 1 << 10;

/// The most elements of a complex with attributes.
const MAX_ELEMENTS: u32 = 1 << 31;

/// The most labels of a file.
pub const MAX_LABELS: usize = 1 << 16;

/// One layer of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerHeader {
    /// Its name.
    pub name: String,
    /// What it means.
    pub kind: LayerKind,
    /// Components of a value, 1 to 4.
    pub width: u8,
    /// How the source stored the numbers.
    pub stored: Stored,
    /// How integers become values.
    pub quantizer: Quantizer,
    /// Wedges of the full level; no level has more.
    pub wedges: u32,
}

/// What holds for elements with this label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Label {
    /// Their material plus one; 0 without.
    pub material: u32,
    /// The layers in which they have values, a bit each.
    pub layers: u32,
}

/// All that the front of a file says about attributes. Empty for a bare mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AttributeHeader {
    /// The layers, at most 32.
    pub layers: Vec<LayerHeader>,
    /// The labels; with a single one nothing is told of elements.
    pub labels: Vec<Label>,
    /// Whether degenerate faces, or isolated vertices, have values: a chunk of their own.
    pub extra: bool,
    /// Materials of the file.
    pub materials: u32,
    /// Whether there is a chunk of materials, textures, samplers and names of images.
    pub appearance: bool,
    /// Images of the file, a chunk each.
    pub images: u32,
}

impl AttributeHeader {
    /// What the codec has to know.
    pub fn scheme(&self) -> Scheme {
        Scheme {
            widths: self.layers.iter().map(|l| l.quantizer.width(l.kind, l.width as usize)).collect(),
            presence: self.labels.iter().map(|l| l.layers).collect(),
        }
    }

    /// Whether a decoder has nothing to carry from level to level.
    pub fn is_bare(&self) -> bool {
        self.layers.is_empty() && self.labels.len() < 2
    }

    /// Whether it makes sense for a full level of so many elements and corners.
    pub(super) fn validate(&self, elements: u32, corners: u32) -> Result<(), ContainerError> {
        let fail = |what| inconsistent(Place::Header, what);
        if !self.is_bare() && elements > MAX_ELEMENTS {
            return fail("more than 2^31 elements with attributes");
        }
        if self.layers.len() > MAX_LAYERS {
            return fail("more than 32 layers");
        }
        if self.labels.len() > MAX_LABELS || (self.labels.is_empty() && !self.layers.is_empty()) {
            return fail("too many labels, or layers without one");
        }
        for l in &self.layers {
            if l.name.len() > MAX_NAME || !(1..=MAX_WIDTH).contains(&l.width) {
                return fail("a layer with too long a name or a width outside 1 to 4");
            }
            if l.wedges as usize > MAX_WEDGES || l.wedges > corners {
                return fail("more wedges than corners");
            }
            let fits = match (l.quantizer, l.kind) {
                (Quantizer::Linear { origin, step }, kind) => {
                    !matches!(kind, LayerKind::Normal | LayerKind::Tangent)
                        && step > 0.0
                        && origin.iter().all(|c| (c.abs() + step * VALUE_LIMIT as f64).is_finite())
                }
                (Quantizer::Octahedral { bits }, LayerKind::Normal) => (2..=16).contains(&bits) && l.width == 3,
                (Quantizer::Octahedral { bits }, LayerKind::Tangent) => (2..=16).contains(&bits) && l.width == 4,
                _ => false,
            };
            if !fits {
                return fail("a quantizer that does not fit its layer");
            }
        }
        let known = if self.layers.len() >= 32 { u32::MAX } else { (1 << self.layers.len()) - 1 };
        if self.labels.iter().any(|l| l.layers & !known != 0 || l.material > self.materials) {
            return fail("a label with a layer or material that is not there");
        }
        if (self.materials > 0 || self.images > 0) && !self.appearance {
            return fail("materials or images without a chunk that names them");
        }
        if self.images > MAX_COUNT || self.materials > MAX_COUNT - 1 {
            return fail("a count beyond 2^32 - 2");
        }
        Ok(())
    }
}

const KINDS: [LayerKind; 5] =
    [LayerKind::Scalar, LayerKind::Uv, LayerKind::Normal, LayerKind::Tangent, LayerKind::Color];
const STORED: [Stored; 8] =
    [Stored::F32, Stored::F64, Stored::U8, Stored::U16, Stored::U32, Stored::I8, Stored::I16, Stored::I32];

/// A string, at most `most` bytes.
fn text<C: Coder>(c: &mut C, size: &mut Number, value: &str, most: usize) -> Result<String, ContainerError> {
    let length = size.code(c, value.len() as u64);
    if length > most as u64 {
        return inconsistent(Place::Header, "too long a name");
    }
    let bytes = value.as_bytes();
    let out = (0..length as usize).map(|i| raw(c, 8, bytes.get(i).copied().unwrap_or(0) as u64) as u8).collect();
    String::from_utf8(out).or_else(|_| inconsistent(Place::Header, "a name that is not UTF-8"))
}

/// The symbols of an attribute header.
pub(super) fn code<C: Coder>(
    c: &mut C,
    size: &mut Number,
    known: Option<&AttributeHeader>,
) -> Result<AttributeHeader, ContainerError> {
    let empty = AttributeHeader::default();
    let known = known.unwrap_or(&empty);
    let mut any = crate::format::coder::range::Bit::default();
    if !c.bit(&mut any, *known != empty) {
        return Ok(empty);
    }
    let layers = size.code(c, known.layers.len() as u64);
    if layers > MAX_LAYERS as u64 {
        return inconsistent(Place::Header, "more than 32 layers");
    }
    let mut out = AttributeHeader::default();
    for l in 0..layers as usize {
        let given = known.layers.get(l);
        let name = text(c, size, given.map_or("", |g| &g.name), MAX_NAME)?;
        let kind = given.map_or(0, |g| KINDS.iter().position(|&k| k == g.kind).unwrap_or(0));
        let kind = KINDS[c.uniform(KINDS.len() as u32, kind as u32) as usize % KINDS.len()];
        let width = raw(c, 3, given.map_or(0, |g| g.width as u64)) as u8;
        let stored = given.map_or(0, |g| STORED.iter().position(|&k| k == g.stored).unwrap_or(0));
        let stored = STORED[c.uniform(STORED.len() as u32, stored as u32) as usize % STORED.len()];
        let quantizer = given.map_or(Quantizer::Octahedral { bits: 0 }, |g| g.quantizer);
        let linear = raw(c, 1, matches!(quantizer, Quantizer::Linear { .. }) as u64) == 1;
        let (origin, step, bits) = match quantizer {
            Quantizer::Linear { origin, step } => (origin, step, 0),
            Quantizer::Octahedral { bits } => ([0.0; WIDTH], 1.0, bits),
        };
        let quantizer = if linear {
            Quantizer::Linear { step: float(c, step), origin: origin.map(|x| float(c, x)) }
        } else {
            Quantizer::Octahedral { bits: raw(c, 5, bits as u64) as u8 }
        };
        let wedges = count(size.code(c, given.map_or(0, |g| g.wedges as u64)))?;
        out.layers.push(LayerHeader { name, kind, width, stored, quantizer, wedges });
    }
    out.materials = count(size.code(c, known.materials as u64))?;
    let labels = size.code(c, known.labels.len() as u64);
    if labels > MAX_LABELS as u64 {
        return inconsistent(Place::Header, "more than 65,536 labels");
    }
    for l in 0..labels as usize {
        let given = known.labels.get(l).copied().unwrap_or_default();
        let material = count(size.code(c, given.material as u64))?;
        out.labels.push(Label { material, layers: raw(c, layers as u32, given.layers as u64) as u32 });
        if c.overrun() {
            return inconsistent(Place::Header, "the tables end early");
        }
    }
    out.extra = raw(c, 1, known.extra as u64) == 1;
    out.appearance = raw(c, 1, known.appearance as u64) == 1;
    out.images = count(size.code(c, known.images as u64))?;
    Ok(out)
}
