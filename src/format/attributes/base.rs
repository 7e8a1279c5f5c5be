//! Attributes that no split tells: those of the base level, of degenerate faces, and of isolated vertices.

use super::values::{Far, VALUE_LIMIT, Value, ValueModels, WIDTH, code_far};
use crate::format::coder::InvalidStream;
use crate::format::coder::range::{Bit, Coder};
use crate::format::complex::{Attributes, Faces, MAX_LAYERS, MAX_WEDGES, NONE, Scheme, Wedges};

/// Wedges of a vertex that are considered; a further corner gets a wedge of its own.
const NEAR: usize = 64;

struct Models {
    label: Bit,
    known: Bit,
    last: Bit,
    present: Bit,
}

impl Default for Models {
    fn default() -> Self {
        Models { label: Bit::with(50000), known: Bit::with(50000), last: Bit::with(50000), present: Bit::default() }
    }
}

fn padded(value: &[i32]) -> Value {
    let mut out = [0; WIDTH];
    out[..value.len()].copy_from_slice(value);
    out
}

fn checked(value: Value) -> Result<Value, InvalidStream> {
    if value.iter().any(|c| c.unsigned_abs() > VALUE_LIMIT as u32) {
        return Err(InvalidStream("a value out of range"));
    }
    Ok(value)
}

fn ends_early<C: Coder>(coder: &C) -> Result<(), InvalidStream> {
    if coder.overrun() { Err(InvalidStream("values that end too early")) } else { Ok(()) }
}

fn code_labels<C: Coder>(
    coder: &mut C,
    m: &mut Models,
    scheme: &Scheme,
    labels: &mut Vec<u16>,
    elements: usize,
) -> Result<(), InvalidStream> {
    if scheme.presence.len() < 2 {
        labels.clear();
        return Ok(());
    }
    let source = std::mem::take(labels);
    labels.reserve_exact(elements);
    let mut last = 0u16;
    for f in 0..elements {
        ends_early(coder)?;
        let wanted = source.get(f).copied().unwrap_or(0);
        if !coder.bit(&mut m.label, wanted == last) {
            last = coder.uniform(scheme.presence.len() as u32, wanted as u32) as u16;
        }
        labels.push(last);
    }
    Ok(())
}

/// Code the attributes of the elements of level 0, which has `vertices` vertices.
///
/// An encoder's wedges may be numbered in any way; they leave in the order in which corners name them, and what is returned tells layer by layer
/// which number each had before. A decoder comes with nothing but `most`, how many wedges each layer may have; an encoder's is empty.
///
/// # Errors
/// [`InvalidStream`] from a stream that contradicts itself.
pub fn code_base_layers<C: Coder>(
    coder: &mut C,
    scheme: &Scheme,
    vertices: usize,
    faces: &Faces,
    attributes: &mut Attributes,
    most: &[u32],
) -> Result<Vec<Vec<u32>>, InvalidStream> {
    if scheme.is_empty() {
        return Ok(Vec::new());
    }
    let mut models = Models::default();
    code_labels(coder, &mut models, scheme, &mut attributes.labels, faces.len())?;
    attributes.layers.resize_with(scheme.widths.len().min(MAX_LAYERS), Wedges::default);
    let mut names = Vec::new();
    for (l, (layer, &width)) in attributes.layers.iter_mut().zip(&scheme.widths).enumerate() {
        let source = std::mem::replace(layer, Wedges { width, ..Wedges::default() });
        layer.corner.reserve_exact(faces.corners.len());
        let most = most.get(l).map_or(usize::MAX, |&n| n as usize);
        let mut values = ValueModels::new(width);
        let mut own: Vec<u32> = Vec::new();
        // The last wedge of each vertex, and the one before each wedge.
        let mut head = vec![NONE; vertices];
        let mut before: Vec<u32> = Vec::new();
        for f in 0..faces.len() {
            ends_early(coder)?;
            let label = attributes.labels.get(f).copied().unwrap_or(0);
            let mut guess = values.last;
            let mut from = Far::Last;
            for (k, &v) in faces.get(f as u32).iter().enumerate() {
                if !scheme.has(label, l) {
                    layer.corner.push(NONE);
                    continue;
                }
                let wanted = if C::DECODING { 0 } else { source.corner[faces.start[f] as usize + k] };
                let mut found = NONE;
                let mut count = 0;
                let mut index = 0;
                let mut at = head[v as usize];
                while at != NONE && count < NEAR {
                    if !C::DECODING && found == NONE && own[at as usize] == wanted {
                        (found, index) = (at, count);
                    }
                    at = before[at as usize];
                    count += 1;
                }
                let known = count > 0 && coder.bit(&mut models.known, found != NONE);
                let w = if known {
                    if count > 1 && !coder.bit(&mut models.last, index == 0) {
                        index = 1 + coder.uniform(count as u32 - 1, index.saturating_sub(1) as u32) as usize;
                    }
                    let mut at = head[v as usize];
                    for _ in 0..index {
                        at = before[at as usize];
                    }
                    at
                } else {
                    let value = if C::DECODING { [0; WIDTH] } else { padded(source.value(wanted)) };
                    let value = checked(code_far(coder, &mut values, from, guess, value))?;
                    let w = before.len() as u32;
                    if before.len() >= most.min(MAX_WEDGES) {
                        return Err(InvalidStream("more wedges than the header announces"));
                    }
                    before.push(head[v as usize]);
                    head[v as usize] = w;
                    if !C::DECODING {
                        own.push(wanted);
                    }
                    layer.values.extend_from_slice(&value[..width]);
                    w
                };
                guess = padded(layer.value(w));
                from = Far::Edge;
                layer.corner.push(w);
            }
        }
        names.push(own);
    }
    Ok(names)
}

/// Values outside the complex: of degenerate faces, and of vertices that no element names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExtraAttributes {
    /// The labels of the degenerate faces; empty where all have label 0.
    pub labels: Vec<u16>,
    /// For each layer a value for each corner aside; `None` where the label leaves it out.
    pub corners: Vec<Vec<Option<Value>>>,
    /// For each layer a value, or none, for each vertex that no element names, in their order.
    pub isolated: Vec<Vec<Option<Value>>>,
}

/// Code the values of the elements `aside` and of `isolated` vertices.
///
/// # Errors
/// [`InvalidStream`] from a stream that contradicts itself.
pub fn code_extra_attributes<C: Coder>(
    coder: &mut C,
    scheme: &Scheme,
    degenerate: &Faces,
    isolated: usize,
    extra: &mut ExtraAttributes,
) -> Result<(), InvalidStream> {
    let mut models = Models::default();
    code_labels(coder, &mut models, scheme, &mut extra.labels, degenerate.len())?;
    let source = std::mem::take(extra);
    extra.labels.clone_from(&source.labels);
    for (l, &width) in scheme.widths.iter().enumerate() {
        let mut values = ValueModels::new(width);
        let given = |list: &Vec<Vec<Option<Value>>>, i: usize| list.get(l).and_then(|c| c.get(i).copied()).flatten();
        let mut corners = Vec::with_capacity(degenerate.corners.len());
        for f in 0..degenerate.len() {
            ends_early(coder)?;
            let label = extra.labels.get(f).copied().unwrap_or(0);
            for k in degenerate.start[f]..degenerate.start[f + 1] {
                corners.push(if scheme.has(label, l) {
                    let value = given(&source.corners, k as usize).unwrap_or_default();
                    let guess = values.last;
                    Some(checked(code_far(coder, &mut values, Far::Last, guess, value))?)
                } else {
                    None
                });
            }
        }
        extra.corners.push(corners);
        let mut list = Vec::with_capacity(isolated);
        models.present = Bit::default();
        for i in 0..isolated {
            ends_early(coder)?;
            let value = given(&source.isolated, i);
            list.push(if coder.bit(&mut models.present, value.is_some()) {
                let guess = values.last;
                Some(checked(code_far(coder, &mut values, Far::Edge, guess, value.unwrap_or_default()))?)
            } else {
                None
            });
        }
        extra.isolated.push(list);
    }
    Ok(())
}
