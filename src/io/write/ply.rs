//! PLY, binary, little endian: `vertex`, `face`, and `edge` for dangling edges.
//!
//! Coordinates are `float` where all of them read back to the same lattice point (without a lattice: to the same
//! number), else `double`. Layers with one value per vertex are properties of vertices, in the type that they were stored
//! in. Texture coordinates with seams are lists `texcoord` at faces; for any other layer with seams vertices repeat, and a
//! comment says so. Of materials the image of the base colour stays, as `TextureFile` and `texnumber`.

use std::collections::BTreeSet;
use std::io::Write;

use serde_json::Value;

use super::sidecars::Sidecars;
use super::split::{Split, per_vertex};
use super::{Census, WriteErrorKind, WriteWarning, moved, mtl, single};
use crate::io::read::{DISTINCT, REPEATED};
use crate::mesh::lattice::Lattice;
use crate::mesh::{Layer, LayerKind, Mesh, NO_VALUE, Stored};

/// A layer as properties of vertices.
struct Column<'m> {
    layer: &'m Layer,
    stored: Stored,
    /// Where its values stand in the split.
    at: usize,
}

pub(super) fn write<'m>(
    out: &mut impl Write,
    mesh: &'m Mesh,
    lattice: Option<&Lattice>,
    beside: &mut Sidecars<'m>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let mut warnings = Vec::new();
    let census = Census::of(mesh);
    let short = moved(mesh, lattice, 0.0, single).count == 0;
    let real = if short { "float" } else { "double" };
    let wide = mesh.faces().any(|f| f.len() > 255);
    let count = if wide { "uint" } else { "uchar" };

    // Which layers go where. One set of texture coordinates has names on vertices.
    let sets: Vec<&Layer> = mesh.layers.iter().filter(|l| l.kind == LayerKind::Uv).collect();
    let uv_on_vertices = sets.len() == 1 && per_vertex(mesh, sets[0]);
    let lists: Vec<&Layer> = if uv_on_vertices { Vec::new() } else { sets };
    let on_vertices: Vec<&Layer> = mesh.layers.iter().filter(|l| uv_on_vertices || l.kind != LayerKind::Uv).collect();
    let split = Split::new(mesh, &on_vertices);
    let columns: Vec<Column<'_>> =
        on_vertices.iter().enumerate().map(|(at, layer)| Column { layer, stored: fitting(layer), at }).collect();
    // Most programs know `int` alone; `uint` only where it is needed.
    let index = if split.vertex.len() > i32::MAX as usize { "uint" } else { "int" };
    let textures = textures(mesh, beside, &mut warnings);
    let several = textures.names.len() > 1
        || textures.names.len() == 1 && (0..mesh.face_count()).any(|f| textures.of_face(mesh, f) != 0);

    write!(out, "ply\nformat binary_little_endian 1.0\ncomment lodestream\n")?;
    if split.repeated(mesh) > 0 {
        writeln!(out, "comment {REPEATED}")?;
        warnings.push(WriteWarning::Repeated { count: split.repeated(mesh) });
    } else if uv_on_vertices {
        writeln!(out, "comment {DISTINCT}")?;
    }
    for name in &textures.names {
        writeln!(out, "comment TextureFile {name}")?;
    }
    writeln!(out, "element vertex {}", split.vertex.len())?;
    write!(out, "property {real} x\nproperty {real} y\nproperty {real} z\n")?;
    let mut taken: BTreeSet<String> = ["x", "y", "z"].map(String::from).into();
    for column in &columns {
        let missing = split.values[column.at].iter().filter(|i| **i == NO_VALUE).count() as u64;
        // A floating-point number can say that it is none.
        if missing > 0 && (column.layer.kind != LayerKind::Scalar || column.stored.is_integer()) {
            warnings.push(WriteWarning::Filled { layer: column.layer.name.clone(), count: missing });
        }
        for name in property_names(column.layer, &mut taken) {
            writeln!(out, "property {} {name}", type_name(column.stored))?;
        }
    }
    write!(out, "element face {}\nproperty list {count} {index} vertex_indices\n", census.faces)?;
    for (n, _) in lists.iter().enumerate() {
        let number = if n == 0 { String::new() } else { n.to_string() };
        writeln!(
            out,
            "property list {} float texcoord{number}",
            if mesh.faces().any(|f| f.len() > 127) { "uint" } else { "uchar" }
        )?;
    }
    if several {
        writeln!(out, "property int texnumber")?;
    }
    if census.edges > 0 {
        write!(out, "element edge {}\nproperty {index} vertex1\nproperty {index} vertex2\n", census.edges)?;
    }
    out.write_all(b"end_header\n")?;

    let mut record = Vec::with_capacity(64);
    for (place, &v) in split.vertex.iter().enumerate() {
        record.clear();
        for &x in &mesh.positions[v as usize] {
            put(&mut record, if short { Stored::F32 } else { Stored::F64 }, x);
        }
        for Column { layer, stored, at } in &columns {
            let value = split.values[*at][place];
            let scale = scale(layer.kind, *stored);
            for k in 0..layer.width as usize {
                let x = match value {
                    NO_VALUE if layer.kind == LayerKind::Scalar && !stored.is_integer() => f64::NAN,
                    NO_VALUE => 0.0,
                    value => layer.value(value)[k] * scale,
                };
                put(&mut record, *stored, x);
            }
        }
        out.write_all(&record)?;
    }
    let long = mesh.faces().any(|f| f.len() > 127);
    for f in (0..mesh.face_count()).filter(|&f| mesh.face(f).len() > 2) {
        let own = mesh.face_start[f] as usize..mesh.face_start[f + 1] as usize;
        record.clear();
        let degree = own.len() as u32;
        record.extend_from_slice(&degree.to_le_bytes()[..if wide { 4 } else { 1 }]);
        for v in &split.corners[own.clone()] {
            record.extend_from_slice(&v.to_le_bytes());
        }
        for layer in &lists {
            let has = layer.corners[own.start] != NO_VALUE;
            let count = if has { 2 * degree } else { 0 };
            record.extend_from_slice(&count.to_le_bytes()[..if long { 4 } else { 1 }]);
            for &i in &layer.corners[own.clone()] {
                if has {
                    layer.value(i).iter().for_each(|&x| put(&mut record, Stored::F32, x));
                }
            }
        }
        if several {
            record.extend_from_slice(&textures.of_face(mesh, f).to_le_bytes());
        }
        out.write_all(&record)?;
    }
    let mut of_edges = 0;
    for f in (0..mesh.face_count()).filter(|&f| mesh.face(f).len() == 2) {
        let own = mesh.face_start[f] as usize..mesh.face_start[f + 1] as usize;
        of_edges += u64::from(lists.iter().any(|l| l.corners[own.start] != NO_VALUE));
        for v in &split.corners[own] {
            out.write_all(&v.to_le_bytes())?;
        }
    }
    if of_edges > 0 {
        warnings.push(WriteWarning::EdgeValuesLeftOut { layer: lists[0].name.clone(), count: of_edges });
    }
    Ok(warnings)
}

/// The type that holds all values of a layer: the one it was stored in, if that is possible.
fn fitting(layer: &Layer) -> Stored {
    let whole = |range: std::ops::RangeInclusive<f64>| {
        let scale = scale(layer.kind, layer.stored);
        layer.values.iter().all(|x| {
            let y = x * scale;
            range.contains(&y) && (y - y.round()).abs() <= if scale == 1.0 { 0.0 } else { 1e-9 }
        })
    };
    let fits = match layer.stored {
        Stored::F32 | Stored::F64 => true,
        // Only colours and numbers of no particular meaning are integers in PLY.
        _ if !matches!(layer.kind, LayerKind::Color | LayerKind::Scalar) => false,
        Stored::U8 => whole(0.0..=255.0),
        Stored::U16 => whole(0.0..=65535.0),
        Stored::U32 => whole(0.0..=f64::from(u32::MAX)),
        Stored::I8 => whole(-128.0..=127.0),
        Stored::I16 => whole(-32768.0..=32767.0),
        Stored::I32 => whole(f64::from(i32::MIN)..=f64::from(i32::MAX)),
    };
    if fits { layer.stored } else { Stored::F32 }
}

/// What a value is multiplied by for its type.
fn scale(kind: LayerKind, stored: Stored) -> f64 {
    match (kind, stored) {
        (LayerKind::Color, Stored::U8) => 255.0,
        (LayerKind::Color, Stored::U16) => 65535.0,
        _ => 1.0,
    }
}

fn put(record: &mut Vec<u8>, stored: Stored, x: f64) {
    match stored {
        Stored::F32 => record.extend_from_slice(&(x as f32).to_le_bytes()),
        Stored::F64 => record.extend_from_slice(&x.to_le_bytes()),
        Stored::U8 => record.push(x.round() as u8),
        Stored::U16 => record.extend_from_slice(&(x.round() as u16).to_le_bytes()),
        Stored::U32 => record.extend_from_slice(&(x.round() as u32).to_le_bytes()),
        Stored::I8 => record.extend_from_slice(&(x.round() as i8).to_le_bytes()),
        Stored::I16 => record.extend_from_slice(&(x.round() as i16).to_le_bytes()),
        Stored::I32 => record.extend_from_slice(&(x.round() as i32).to_le_bytes()),
    }
}

fn type_name(stored: Stored) -> &'static str {
    match stored {
        Stored::F32 => "float",
        Stored::F64 => "double",
        Stored::U8 => "uchar",
        Stored::U16 => "ushort",
        Stored::U32 => "uint",
        Stored::I8 => "char",
        Stored::I16 => "short",
        Stored::I32 => "int",
    }
}

/// The names of a layer's properties, none of them in use.
fn property_names(layer: &Layer, taken: &mut BTreeSet<String>) -> Vec<String> {
    let plain: String =
        layer.name.chars().map(|c| if c.is_control() || c.is_whitespace() { '_' } else { c }).take(60).collect();
    let plain = if plain.is_empty() { "value".to_string() } else { plain };
    let width = layer.width as usize;
    let names = |prefix: &str, suffixes: &[&str]| -> Vec<String> {
        suffixes.iter().take(width).map(|s| format!("{prefix}{s}")).collect()
    };
    let free = |names: &[String], taken: &BTreeSet<String>| names.iter().all(|n| !taken.contains(n));
    let mut out = match layer.kind {
        LayerKind::Uv => names("", &["s", "t"]),
        LayerKind::Normal => names("", &["nx", "ny", "nz"]),
        LayerKind::Tangent => names("tangent_", &["x", "y", "z", "w"]),
        LayerKind::Color if plain == "color" => names("", &["red", "green", "blue", "alpha"]),
        LayerKind::Color => names(&format!("{plain}_"), &["red", "green", "blue", "alpha"]),
        LayerKind::Scalar if width == 1 => vec![plain.clone()],
        LayerKind::Scalar => names(&format!("{plain}_"), &["0", "1", "2", "3"]),
    };
    let mut attempt = 1;
    while !free(&out, taken) {
        attempt += 1;
        let prefix = format!("{plain}_{attempt}_");
        out = match layer.kind {
            LayerKind::Color => names(&prefix, &["red", "green", "blue", "alpha"]),
            _ => names(&prefix, &["0", "1", "2", "3"]),
        };
    }
    taken.extend(out.iter().cloned());
    out
}

/// Image files of base colours.
struct Textures {
    names: Vec<String>,
    /// For each material its place among them, −1 for none.
    of_material: Vec<i32>,
}

impl Textures {
    fn of_face(&self, mesh: &Mesh, f: usize) -> i32 {
        let material = mesh.material.get(f).copied().unwrap_or(NO_VALUE);
        self.of_material.get(material as usize).copied().unwrap_or(-1)
    }
}

fn textures<'m>(mesh: &'m Mesh, beside: &mut Sidecars<'m>, warnings: &mut Vec<WriteWarning>) -> Textures {
    let appearance = &mesh.appearance;
    let mut out = Textures { names: Vec::new(), of_material: Vec::new() };
    if appearance.materials.is_empty() {
        return out;
    }
    let mut simplified = 0;
    let mut of_image = vec![-1; appearance.images.len()];
    let names = beside.images(mesh);
    for material in &appearance.materials {
        let material: Value = serde_json::from_str(material).unwrap_or_default();
        let pbr = &material["pbrMetallicRoughness"];
        let image = mtl::image_of(&pbr["baseColorTexture"], appearance);
        let number = image.map_or(-1, |i| {
            if of_image[i] < 0 {
                of_image[i] = out.names.len() as i32;
                out.names.push(names[i].clone());
            }
            of_image[i]
        });
        out.of_material.push(number);
        let empty = serde_json::Map::new();
        let plain = material.as_object().unwrap_or(&empty).keys().all(|k| match k.as_str() {
            "name" | "doubleSided" => true,
            "pbrMetallicRoughness" => pbr
                .as_object()
                .is_none_or(|o| o.keys().all(|k| matches!(k.as_str(), "baseColorTexture" | "metallicFactor"))),
            _ => false,
        });
        simplified += u64::from(!plain);
    }
    // Other images have no use here.
    let used: BTreeSet<&String> = out.names.iter().collect();
    beside.files.retain(|file| used.contains(&file.0));
    if simplified > 0 {
        warnings.push(WriteWarning::MaterialsSimplified { count: simplified });
    }
    if beside.place.is_none() && !out.names.is_empty() {
        warnings.push(WriteWarning::FilesLeftOut { count: out.names.len() as u64 });
    } else {
        let missing = of_image.iter().zip(&appearance.images).filter(|(n, i)| **n >= 0 && i.bytes.is_empty()).count();
        if missing > 0 {
            warnings.push(WriteWarning::ImagesMissing { count: missing as u64 });
        }
    }
    out
}
