//! Which properties of a PLY element are which attribute.
//!
//! The names are those in use: `nx ny nz`; `s t`, `u v`, `texture_u texture_v`; `red green blue alpha`, also behind a
//! prefix such as `diffuse_`; `texcoord` and `texnumber` at faces. Any other number of a vertex is a layer of its own.

use std::collections::HashMap;

use super::super::attribute::{Attribute, MAX_LAYERS, Place};
use super::super::build::Builder;
use super::header::{Element, Scalar};
use crate::mesh::{LayerKind, Stored};

/// Names of texture coordinates on vertices.
const UVS: [[&str; 2]; 4] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

pub(super) fn has_texture_coordinates(e: &Element<'_>) -> bool {
    UVS.iter().any(|pair| pair.iter().all(|name| e.scalar(name).is_some()))
}

/// The properties of a layer, in the order of its components.
pub(super) struct Columns {
    pub layer: usize,
    pub properties: Vec<usize>,
}

/// What is read of a vertex.
pub(super) struct VertexPlan {
    pub xyz: [usize; 3],
    pub columns: Vec<Columns>,
    /// For each property whether it is wanted.
    pub used: Vec<bool>,
    /// Names of those that mean nothing here.
    pub unknown: Vec<String>,
}

impl VertexPlan {
    /// Find the layers and prepare them in the builder.
    pub fn new(b: &mut Builder, e: &Element<'_>, xyz: [usize; 3]) -> Self {
        let mut plan =
            VertexPlan { xyz, columns: Vec::new(), used: vec![false; e.properties.len()], unknown: Vec::new() };
        let mut taken = vec![false; e.properties.len()];
        xyz.iter().for_each(|&k| (taken[k], plan.used[k]) = (true, true));
        // The first of each name; a header may have very many.
        let mut places = HashMap::new();
        for (k, p) in e.properties.iter().enumerate().filter(|(_, p)| p.list.is_none()) {
            places.entry(p.name).or_insert(k);
        }
        let find = |names: &[&str]| -> Option<Vec<usize>> { names.iter().map(|n| places.get(n).copied()).collect() };
        let mut add = |name: &str, kind: LayerKind, properties: Vec<usize>| {
            if properties.iter().any(|&k| taken[k]) {
                return;
            }
            properties.iter().for_each(|&k| taken[k] = true);
            if b.drop.kind(kind) {
                return;
            }
            if b.layers.len() >= MAX_LAYERS {
                plan.unknown.extend(properties.iter().map(|&k| e.properties[k].name.to_string()));
                return;
            }
            properties.iter().for_each(|&k| plan.used[k] = true);
            let stored = match properties.first().map(|&k| e.properties[k].scalar) {
                Some(Scalar::I8) => Stored::I8,
                Some(Scalar::U8) => Stored::U8,
                Some(Scalar::I16) => Stored::I16,
                Some(Scalar::U16) => Stored::U16,
                Some(Scalar::I32) => Stored::I32,
                Some(Scalar::U32) => Stored::U32,
                Some(Scalar::F32) | None => Stored::F32,
                Some(Scalar::F64 | Scalar::I64 | Scalar::U64) => Stored::F64,
            };
            plan.columns.push(Columns { layer: b.layers.len(), properties: properties.clone() });
            b.layers.push(Attribute::new(name, kind, properties.len() as u8, stored).everywhere());
        };
        for pair in UVS {
            if let Some(properties) = find(&pair) {
                add("uv", LayerKind::Uv, properties);
            }
        }
        if let Some(properties) = find(&["nx", "ny", "nz"]) {
            add("normal", LayerKind::Normal, properties);
        }
        if let Some(properties) = find(&["tangent_x", "tangent_y", "tangent_z", "tangent_w"]) {
            add("tangent", LayerKind::Tangent, properties);
        }
        for p in &e.properties {
            let Some(prefix) = p.name.strip_suffix("red") else { continue };
            let names = ["red", "green", "blue", "alpha"].map(|c| format!("{prefix}{c}"));
            let names = names.each_ref().map(String::as_str);
            let name = match prefix.strip_suffix('_') {
                Some("diffuse") | None => "color",
                Some(prefix) => prefix,
            };
            if let Some(properties) = find(&names).or_else(|| find(&names[..3])) {
                add(name, LayerKind::Color, properties);
            }
        }
        if let Some(properties) = find(&["r", "g", "b", "a"]).or_else(|| find(&["r", "g", "b"])) {
            add("color", LayerKind::Color, properties);
        }
        for (k, p) in e.properties.iter().enumerate() {
            if p.list.is_none() {
                add(p.name, LayerKind::Scalar, vec![k]);
            }
        }
        plan.unknown.extend(e.properties.iter().filter(|p| p.list.is_some()).map(|p| p.name.to_string()));
        plan
    }

    /// Give colours their range, when all values are there.
    pub fn finish(&self, b: &mut Builder, e: &Element<'_>) {
        for Columns { layer, properties } in &self.columns {
            let attribute = &mut b.layers[*layer];
            if attribute.kind != LayerKind::Color {
                continue;
            }
            let scale = match properties.first().map(|&k| e.properties[k].scalar) {
                Some(Scalar::U8) => 255.0,
                Some(Scalar::U16) => 65535.0,
                _ => {
                    attribute.scale_colours(&mut b.tally);
                    let kept = matches!(attribute.stored, Stored::F64 | Stored::U8 | Stored::U16);
                    if attribute.kind == LayerKind::Color && !kept {
                        attribute.stored = Stored::F32;
                    }
                    continue;
                }
            };
            attribute.values.iter_mut().for_each(|x| *x /= scale);
        }
    }
}

/// What is read of a face.
pub(super) struct FacePlan {
    /// The list of vertices.
    pub list: usize,
    /// Lists of texture coordinates and their layers.
    pub uvs: Vec<(usize, usize)>,
    /// The number of a texture.
    pub texture: Option<usize>,
    /// Names of properties that mean nothing here.
    pub unknown: Vec<String>,
}

impl FacePlan {
    /// Find the layers and prepare them in the builder.
    pub fn new(b: &mut Builder, e: &Element<'_>, list: usize) -> Self {
        let mut plan = FacePlan { list, uvs: Vec::new(), texture: None, unknown: Vec::new() };
        for (k, p) in e.properties.iter().enumerate() {
            let uv = p.name.strip_prefix("texcoord").is_some_and(|n| n.bytes().all(|c| c.is_ascii_digit()));
            match p.name {
                _ if k == list => {}
                _ if p.list.is_some() && uv => {
                    if !b.drop.uvs && b.layers.len() < MAX_LAYERS {
                        let known = b.layers.iter().filter(|l| l.kind == LayerKind::Uv).count();
                        let name = if known == 0 { "uv".to_string() } else { format!("uv{known}") };
                        let mut layer = Attribute::new(name, LayerKind::Uv, 2, Stored::F32);
                        layer.place = Place::Listed(Vec::new());
                        plan.uvs.push((k, b.layers.len()));
                        b.layers.push(layer);
                    }
                }
                "texnumber" | "texture_number" if p.list.is_none() => {
                    if !b.drop.materials {
                        plan.texture = Some(k);
                    }
                }
                name => plan.unknown.push(name.to_string()),
            }
        }
        plan
    }

    /// Whether there is nothing but vertices to read.
    pub fn bare(&self) -> bool {
        self.uvs.is_empty() && self.texture.is_none()
    }
}

/// One number of each record into a column.
pub(super) fn column<'v, const BIG: bool>(
    column: impl Iterator<Item = &'v mut f64>,
    records: &[u8],
    stride: usize,
    offset: usize,
    scalar: Scalar,
) {
    fn fill<'v, const N: usize>(
        column: impl Iterator<Item = &'v mut f64>,
        records: &[u8],
        stride: usize,
        offset: usize,
        big: bool,
        number: impl Fn([u8; N]) -> f64,
    ) {
        for (x, record) in column.zip(records.chunks_exact(stride)) {
            let mut bytes = [0; N];
            bytes.copy_from_slice(&record[offset..offset + N]);
            if big {
                bytes.reverse();
            }
            *x = number(bytes);
        }
    }
    match scalar {
        Scalar::I8 => fill(column, records, stride, offset, BIG, |x| f64::from(i8::from_le_bytes(x))),
        Scalar::U8 => fill(column, records, stride, offset, BIG, |[x]| f64::from(x)),
        Scalar::I16 => fill(column, records, stride, offset, BIG, |x| f64::from(i16::from_le_bytes(x))),
        Scalar::U16 => fill(column, records, stride, offset, BIG, |x| f64::from(u16::from_le_bytes(x))),
        Scalar::I32 => fill(column, records, stride, offset, BIG, |x| f64::from(i32::from_le_bytes(x))),
        Scalar::U32 => fill(column, records, stride, offset, BIG, |x| f64::from(u32::from_le_bytes(x))),
        Scalar::I64 => fill(column, records, stride, offset, BIG, |x| i64::from_le_bytes(x) as f64),
        Scalar::U64 => fill(column, records, stride, offset, BIG, |x| u64::from_le_bytes(x) as f64),
        Scalar::F32 => fill(column, records, stride, offset, BIG, |x| f64::from(f32::from_le_bytes(x))),
        Scalar::F64 => fill(column, records, stride, offset, BIG, f64::from_le_bytes),
    }
}
