//! `KHR_draco_mesh_compression`: primitives whose triangles and attributes are packed by Draco.
//!
//! What a stream holds goes into buffers of our own in the layout of the accessors that announce it, so that all that
//! is behind reads it as if it had stood there. The library has limits of its own, which come from the memory limit;
//! its counts and numbers are checked here against the document.

use std::collections::BTreeMap;

use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};
use serde_json::Value;

use super::super::build::{Budget, Kind, MAX};
use super::super::error::{At, Fail, Place, ReadErrorKind};
use super::accessor::{Accessor, Component, Replacement};
use super::json::{as_uint, in_range, list, needed, text, uint};
use super::meshopt::UNPACK;
use super::{Document, top};

pub(super) const NAME: &str = "KHR_draco_mesh_compression";

/// What was unpacked so far, by the buffer view and what is taken from it.
#[derive(Default)]
pub(super) struct Unpacked(BTreeMap<(u64, String), Primitive>);

/// What the stream of a primitive holds.
#[derive(Clone)]
struct Primitive {
    /// By the numbers of the accessors.
    attributes: BTreeMap<u64, Replacement>,
    triangles: Replacement,
}

/// Unpack the data of a primitive that has some and needs them: the accessors of its attributes are replaced in the
/// document until the next primitive. The corners of its triangles.
pub(super) fn unpack(
    doc: &mut Document<'_>,
    primitive: &Value,
    at: impl Fn() -> Place,
    budget: &mut Budget,
) -> Result<Option<Accessor>, Fail> {
    doc.replaced.clear();
    let Some(packed) = primitive.get("extensions").and_then(|e| e.get(NAME)) else { return Ok(None) };
    let accessors = list(doc.json, "accessors").at(top)?;
    let empty = Value::Null;
    let announced = primitive.get("attributes").unwrap_or(&empty);
    // Where the extension is not required, the data may stand beside it as they are.
    let position = announced.get("POSITION").and_then(as_uint).and_then(|n| accessors.get(usize::try_from(n).ok()?));
    if position.is_some_and(|a| a.get("bufferView").is_some()) {
        return Ok(None);
    }
    let view = needed(packed, "bufferView").at(&at)?;
    let key = (view, format!("{announced}{packed}"));
    let known = match doc.draco.0.get(&key) {
        Some(known) => known.clone(),
        None => {
            // Numbers that no accessor of the document has, as there are fewer bytes than that.
            let identity = (doc.draco.0.len() as u64 + 1) << 32;
            let new = primitive_of(doc, packed, announced, view, identity, &at, budget)?;
            doc.draco.0.insert(key, new.clone());
            new
        }
    };
    let number = match uint(primitive, "indices").at(&at)? {
        Some(number) => {
            let number = in_range(number, accessors.len(), "accessors").at(&at)?;
            let count = needed(&accessors[number], "count").at(&at)?;
            // Of a strip there are fewer.
            let strip = uint(primitive, "mode").at(&at)? == Some(5);
            if count != known.triangles.count as u64 && !strip {
                return Err(differ("corners", known.triangles.count, count)).at(&at);
            }
            number
        }
        None => 0,
    };
    doc.replaced = known.attributes;
    Ok(Some(Accessor::indices(number, known.triangles)))
}

fn differ(what: &str, found: usize, announced: u64) -> Kind {
    let message = format!("the Draco data hold {found} {what}, but {announced} are announced; export the file again");
    ReadErrorKind::Syntax(message)
}

fn primitive_of(
    doc: &mut Document<'_>,
    packed: &Value,
    announced: &Value,
    view: u64,
    identity: u64,
    at: &impl Fn() -> Place,
    budget: &mut Budget,
) -> Result<Primitive, Fail> {
    let json = doc.json;
    let span = doc.buffers.span(json, view, budget)?;
    let source = &doc.buffers.get(span.buffer)[span.start..span.start + span.length];
    let mesh = decode(source, budget).at(at)?;
    let points = mesh.num_points();
    let accessors = list(json, "accessors").at(top)?;
    let mut attributes = BTreeMap::new();
    for (name, id) in packed.get("attributes").and_then(Value::as_object).into_iter().flatten() {
        let Some(number) = announced.get(name).and_then(as_uint) else { continue };
        let accessor = &accessors[in_range(number, accessors.len(), "accessors").at(at)?];
        let count = needed(accessor, "count").at(at)?;
        if count != points as u64 {
            return Err(differ("vertices", points, count)).at(at);
        }
        let found = as_uint(id).and_then(|id| mesh.attribute_by_unique_id(u32::try_from(id).ok()?));
        let missing = || ReadErrorKind::Syntax(format!("the Draco data have no attribute {id}; export the file again"));
        let attribute = found.ok_or_else(missing).at(at)?;
        let component = needed(accessor, "componentType").and_then(Component::parse).at(at)?;
        let width = match text(accessor, "type").at(at)? {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            _ => 4,
        };
        if usize::from(attribute.num_components()) != width {
            return Err(differ("components of an attribute", attribute.num_components().into(), width as u64)).at(at);
        }
        let whole = component != Component::F32 && attribute.data_type() != DataType::Float32;
        let component = if whole { component } else { Component::F32 };
        let bytes = values(attribute, points, component, budget).at(at)?;
        let identity = identity | number;
        let buffer = doc.buffers.add(bytes);
        attributes.insert(number, Replacement { buffer, count: points, component, identity });
    }
    let mut corners = Vec::new();
    budget.reserve(&mut corners, mesh.num_faces().saturating_mul(12)).at(at)?;
    for corner in mesh.faces().iter().flatten() {
        if corner.0 as usize >= points {
            let (index, vertices) = (i64::from(corner.0), points as u64);
            return Err(ReadErrorKind::IndexOutOfRange { what: "a Draco face", index, vertices, first: 0 }).at(at);
        }
        corners.extend(corner.0.to_le_bytes());
    }
    let buffer = doc.buffers.add(corners);
    let component = Component::U32;
    Ok(Primitive { attributes, triangles: Replacement { buffer, count: 3 * mesh.num_faces(), component, identity } })
}

/// The mesh of a stream, within what is left of the budget.
fn decode(source: &[u8], budget: &Budget) -> Result<Mesh, Kind> {
    let left = budget.left();
    // Tables of corners take several times what a face does, and values are held twice while they are predicted.
    let limits = DecodeLimits::default()
        .with_max_points((left / 16).min(MAX as u64))
        .with_max_faces((left / 64).min(MAX as u64 / 3))
        .with_max_decoded_bytes(left / 3);
    let mut buffer = DecoderBuffer::new(source).with_limits(limits);
    let mut mesh = Mesh::new();
    MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|e| {
        let text = e.to_string();
        match text.contains("nsupported") {
            true => ReadErrorKind::Unsupported { what: format!("this kind of Draco data ({text})"), advice: UNPACK },
            false => {
                ReadErrorKind::Syntax(format!("the Draco data are damaged: {text}; fetch or export the file again"))
            }
        }
    })?;
    Ok(mesh)
}

/// The values of an attribute at all points, one after the other, as numbers of this type.
fn values(a: &PointAttribute, points: usize, component: Component, budget: &mut Budget) -> Result<Vec<u8>, Kind> {
    let width = usize::from(a.num_components());
    let mut out = Vec::new();
    budget.reserve(&mut out, points.saturating_mul(width * component.size()))?;
    let (stride, size) = (usize::try_from(a.byte_stride()).unwrap_or(0), a.data_type().byte_length());
    let data = a.buffer().data();
    for point in 0..points as u32 {
        let start = (a.mapped_index(PointIndex(point)).0 as usize).saturating_mul(stride);
        for k in 0..width {
            let from = start.saturating_add(k * size);
            let Some(number) = data.get(from..).and_then(|rest| rest.get(..size)) else {
                return Err(ReadErrorKind::Syntax("the Draco data lack values; export the file again".to_string()));
            };
            let value = number_of(a.data_type(), number);
            // What does not fit becomes the nearest number that does.
            match component {
                Component::I8 => out.extend((value as i8).to_le_bytes()),
                Component::U8 => out.extend((value as u8).to_le_bytes()),
                Component::I16 => out.extend((value as i16).to_le_bytes()),
                Component::U16 => out.extend((value as u16).to_le_bytes()),
                Component::U32 => out.extend((value as u32).to_le_bytes()),
                Component::F32 => out.extend((value as f32).to_le_bytes()),
            }
        }
    }
    Ok(out)
}

/// A number of the library's, whose types have the byte order of files.
fn number_of(kind: DataType, b: &[u8]) -> f64 {
    let mut eight = [0; 8];
    let n = b.len().min(8);
    eight[..n].copy_from_slice(&b[..n]);
    let word = u64::from_le_bytes(eight);
    match kind {
        DataType::Int8 => f64::from(word as i8),
        DataType::Int16 => f64::from(word as i16),
        DataType::Int32 => f64::from(word as i32),
        DataType::Int64 => word as i64 as f64,
        DataType::Float32 => f64::from(f32::from_bits(word as u32)),
        DataType::Float64 => f64::from_bits(word),
        _ => word as f64,
    }
}
