//! The attributes of a mesh as the codec takes them: values quantized, corners of a vertex that agree gathered into wedges, materials and
//! the presence of values told by labels.

use super::EncodeOptions;
use crate::format::attributes::{ExtraAttributes, Value};
use crate::format::complex::{Attributes, Faces, MAX_LAYERS, MAX_WEDGES, NONE, Scheme, Wedges};
use crate::format::container::{AttributeHeader, Label, LayerHeader, MAX_LABELS, MAX_NAME};
use crate::mesh::lattice::PROPORTION;
use crate::mesh::quantizer::{Precision, Quantizer, QuantizerError};
use crate::mesh::{Layer, LayerKind, Mesh, NO_VALUE};
use crate::parallel;
use std::borrow::Cow;
use std::collections::HashMap;
use thiserror::Error;

/// Why attributes cannot be carried.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum AttributeError {
    /// Values cannot be quantized.
    #[error(transparent)]
    Quantizer(#[from] QuantizerError),
    /// More layers than a file holds.
    #[error("{layers} attribute layers, a file holds {MAX_LAYERS}; drop some")]
    Layers {
        /// How many there are.
        layers: usize,
    },
    /// More combinations of material and layers than a file holds.
    #[error("more than {MAX_LABELS} combinations of materials and attribute layers; merge materials")]
    Labels,
    /// More wedges than 31-bit numbers hold.
    #[error("layer {layer} has more than {MAX_WEDGES} different values at corners; drop it or split the mesh")]
    Wedges {
        /// The layer.
        layer: String,
    },
    /// A name that is too long.
    #[error("the name of layer {layer} has more than {MAX_NAME} bytes; rename it")]
    Name {
        /// How the name begins.
        layer: String,
    },
}

/// The attributes of a mesh, ready to be simplified and coded.
#[derive(Clone, Debug, Default)]
pub(super) struct QuantizedAttributes {
    pub header: AttributeHeader,
    pub scheme: Scheme,
    pub attributes: Attributes,
    /// Values outside the complex; those of degenerate faces in the order of the mesh.
    pub extra: ExtraAttributes,
    /// Values of vertices that no element names: vertex, layer, value, in increasing order.
    pub isolated: Vec<(u32, u32, Value)>,
}

/// Which elements of the mesh are in the complex, and which are degenerate faces, in order.
pub(super) struct Parts<'a> {
    pub faces: &'a Faces,
    /// For each element of the complex its number in the mesh.
    pub of_face: Vec<u32>,
    /// For each degenerate face its number in the mesh.
    pub of_degenerate: Vec<u32>,
}

pub(super) fn quantize_attributes(
    mesh: &Mesh,
    parts: &Parts,
    options: &EncodeOptions,
) -> Result<QuantizedAttributes, AttributeError> {
    let mut out = QuantizedAttributes::default();
    if mesh.layers.is_empty() && mesh.material.is_empty() && mesh.appearance.is_empty() {
        return Ok(out);
    }
    if mesh.layers.len() > MAX_LAYERS {
        return Err(AttributeError::Layers { layers: mesh.layers.len() });
    }
    // Labels, in order of first appearance, the most frequent one first so that it is 0.
    let label = |f: u32| {
        let first = mesh.face_start[f as usize] as usize;
        let mut layers = 0u32;
        for (l, layer) in mesh.layers.iter().enumerate() {
            layers |= ((layer.corners[first] != NO_VALUE) as u32) << l;
        }
        let material = mesh.material.get(f as usize).copied().unwrap_or(NO_VALUE);
        Label { material: material.wrapping_add(1), layers }
    };
    let mut number: HashMap<Label, u16> = HashMap::new();
    let mut last = None;
    let mut all = |list: &[u32]| -> Result<Vec<u16>, AttributeError> {
        let mut labels = Vec::with_capacity(list.len());
        for &f in list {
            let l = label(f);
            let n = match last {
                Some((known, n)) if known == l => n,
                _ => {
                    let next = number.len();
                    if next >= MAX_LABELS && !number.contains_key(&l) {
                        return Err(AttributeError::Labels);
                    }
                    *number.entry(l).or_insert_with(|| {
                        out.header.labels.push(l);
                        next as u16
                    })
                }
            };
            last = Some((l, n));
            labels.push(n);
        }
        Ok(labels)
    };
    out.attributes.labels = all(&parts.of_face)?;
    out.extra.labels = all(&parts.of_degenerate)?;
    if out.header.labels.is_empty() {
        out.header.labels.push(Label::default());
    }
    if out.header.labels.len() < 2 {
        out.attributes.labels = Vec::new();
        out.extra.labels = Vec::new();
    }

    for (l, layer) in mesh.layers.iter().enumerate() {
        if layer.name.len() > MAX_NAME {
            return Err(AttributeError::Name { layer: layer.name.chars().take(40).collect() });
        }
        let precision = match layer.kind {
            LayerKind::Uv => options.uv,
            LayerKind::Normal | LayerKind::Tangent => Precision::Bits(options.normal_bits),
            LayerKind::Color => Precision::Bits(options.color_bits),
            _ => Precision::Bits(options.scalar_bits),
        };
        let width = layer.width as usize;
        let whole = layer.stored.is_integer();
        let quantizer = Quantizer::choose(&layer.name, layer.kind, width, &named_values(layer), precision, whole)?;
        for &[_, value] in &layer.isolated {
            quantizer.check(&layer.name, layer.value(value))?;
        }
        let coded = quantizer.width(layer.kind, width);
        let ranges = parallel::ranges(layer.len(), 1 << 16);
        let values: Vec<Value> = parallel::map(ranges, |range| {
            range.map(|i| quantizer.quantize(layer.kind, layer.value(i as u32))).collect::<Vec<_>>()
        })
        .concat();
        let wedges = gather(mesh, layer, parts, &values, coded)?;
        out.header.layers.push(LayerHeader {
            name: layer.name.clone(),
            kind: layer.kind,
            width: layer.width,
            stored: layer.stored,
            quantizer,
            wedges: wedges.len() as u32,
        });
        out.scheme.widths.push(coded);
        out.attributes.layers.push(wedges);
        let mut degenerate = Vec::new();
        for &f in &parts.of_degenerate {
            let own = mesh.face_start[f as usize] as usize..mesh.face_start[f as usize + 1] as usize;
            degenerate.extend(layer.corners[own].iter().map(|&i| (i != NO_VALUE).then(|| values[i as usize])));
        }
        out.extra.corners.push(degenerate);
        out.isolated.extend(layer.isolated.iter().map(|&[v, i]| (v, l as u32, values[i as usize])));
    }
    out.scheme.presence = out.header.labels.iter().map(|l| l.layers).collect();
    out.isolated.sort_unstable_by_key(|i| (i.0, i.1));
    let bare = mesh.layers.is_empty() && out.header.labels.len() < 2;
    out.header.extra = (!parts.of_degenerate.is_empty() && !bare) || !out.isolated.is_empty();
    out.header.materials = mesh.appearance.materials.len() as u32;
    out.header.images = mesh.appearance.images.len() as u32;
    out.header.appearance = !mesh.appearance.is_empty();
    Ok(out)
}

/// The values that set the range of a layer: those that corners name, and those of isolated vertices unless they are out of
/// all proportion. What nothing names does not count.
fn named_values(layer: &Layer) -> Cow<'_, [f64]> {
    let width = layer.width as usize;
    let mut named = vec![false; layer.len()];
    layer.corners.iter().filter(|&&v| v != NO_VALUE).for_each(|&v| named[v as usize] = true);
    let side = |named: &[bool]| {
        let values = || layer.values.chunks_exact(width.max(1)).zip(named).filter(|(_, named)| **named);
        let span = |c: usize| {
            let numbers = || values().map(|(value, _)| value[c]);
            numbers().fold(f64::NEG_INFINITY, f64::max) - numbers().fold(f64::INFINITY, f64::min)
        };
        (0..width).map(span).fold(0.0, f64::max)
    };
    let of_corners = side(&named);
    let mut all = named.clone();
    layer.isolated.iter().for_each(|&[_, v]| all[v as usize] = true);
    if !(of_corners > 0.0 && side(&all) > PROPORTION * of_corners) {
        named = all;
    }
    if named.iter().all(|&named| named) {
        return Cow::Borrowed(&layer.values);
    }
    let values = layer.values.chunks_exact(width.max(1)).zip(&named).filter(|(_, named)| **named);
    Cow::Owned(values.flat_map(|(value, _)| value).copied().collect())
}

/// Wedges of the elements of the complex: corners of a vertex with equal integers share one.
fn gather(mesh: &Mesh, layer: &Layer, parts: &Parts, values: &[Value], width: usize) -> Result<Wedges, AttributeError> {
    let faces = parts.faces;
    // The value of each corner of the complex.
    let mut value = Vec::with_capacity(faces.corners.len());
    for &f in &parts.of_face {
        value.extend_from_slice(
            &layer.corners[mesh.face_start[f as usize] as usize..mesh.face_start[f as usize + 1] as usize],
        );
    }
    // Corners by vertex.
    let n = mesh.positions.len();
    let mut start = vec![0u32; n + 2];
    for &v in &faces.corners {
        start[v as usize + 2] += 1;
    }
    for v in 2..start.len() {
        start[v] += start[v - 1];
    }
    let mut list = vec![0u32; faces.corners.len()];
    for (k, &v) in faces.corners.iter().enumerate() {
        let at = &mut start[v as usize + 1];
        list[*at as usize] = k as u32;
        *at += 1;
    }
    let mut out = Wedges { width, corner: vec![NONE; faces.corners.len()], values: Vec::new() };
    let mut own: Vec<(Value, u32)> = Vec::new();
    let mut count = 0u32;
    for v in 0..n {
        own.clear();
        let corners = &list[start[v] as usize..start[v + 1] as usize];
        own.extend(
            corners
                .iter()
                .filter(|&&k| value[k as usize] != NO_VALUE)
                .map(|&k| (values[value[k as usize] as usize], k)),
        );
        if own.windows(2).any(|w| w[0].0 != w[1].0) {
            own.sort_unstable();
        }
        for run in own.chunk_by(|a, b| a.0 == b.0) {
            if count as usize >= MAX_WEDGES >> 1 {
                return Err(AttributeError::Wedges { layer: layer.name.clone() });
            }
            out.values.extend_from_slice(&run[0].0[..width]);
            run.iter().for_each(|&(_, k)| out.corner[k as usize] = count);
            count += 1;
        }
    }
    Ok(out)
}
