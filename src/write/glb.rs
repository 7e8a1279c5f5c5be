//! GLB (glTF 2.0): triangles, with polygons as fans; dangling edges as LINES; isolated vertices as POINTS.
//!
//! glTF has no double precision. Where single precision does not hold the positions (scans in national grid
//! coordinates), the node carries a translation and the vertices what is left: readers add the two.

use std::io::Write;

use serde_json::{Value, json};

use super::stl::tolerance;
use super::{Census, WriteErrorKind, WriteWarning, moved, single, triangles};
use crate::lattice::Lattice;
use crate::mesh::Mesh;

pub(super) fn write(
    out: &mut impl Write,
    mesh: &Mesh,
    lattice: Option<&Lattice>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let census = Census::of(mesh);
    let mut warnings: Vec<WriteWarning> = census.fanned().into_iter().collect();
    let shift = translation(mesh, lattice, &mut warnings)?;
    let (document, size) = document(mesh, &census, &shift);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    // The binary chunk is left out when it would be empty.
    let chunk = if size > 0 { 8 + size } else { 0 };
    let total = 12 + 8 + text.len() as u64 + chunk;
    let Ok(total) = u32::try_from(total) else {
        return Err(WriteErrorKind::TooLarge { what: "bytes", count: total, limit: u64::from(u32::MAX) });
    };
    out.write_all(b"glTF\x02\0\0\0")?;
    out.write_all(&total.to_le_bytes())?;
    out.write_all(&(text.len() as u32).to_le_bytes())?;
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    if size == 0 {
        return Ok(warnings);
    }
    out.write_all(&(size as u32).to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    for p in &mesh.positions {
        for x in stored(p, &shift) {
            out.write_all(&x.to_le_bytes())?;
        }
    }
    for v in triangles(mesh).flatten() {
        out.write_all(&v.to_le_bytes())?;
    }
    for v in mesh.faces().filter(|f| f.len() == 2).flatten() {
        out.write_all(&v.to_le_bytes())?;
    }
    for v in &census.isolated {
        out.write_all(&v.to_le_bytes())?;
    }
    Ok(warnings)
}

/// What a vertex stores.
fn stored(p: &[f64; 3], shift: &[f64; 3]) -> [f32; 3] {
    std::array::from_fn(|k| (p[k] - shift[k]) as f32)
}

/// The translation of the node: none where single precision holds the positions as they are.
fn translation(
    mesh: &Mesh,
    lattice: Option<&Lattice>,
    warnings: &mut Vec<WriteWarning>,
) -> Result<[f64; 3], WriteErrorKind> {
    let Some((lo, hi)) = mesh.bounds() else { return Ok([0.0; 3]) };
    let plain = moved(mesh, lattice, tolerance(mesh), single);
    if plain.count == 0 {
        return Ok([0.0; 3]);
    }
    // The middle, on the lattice if there is one: then the small numbers are whole steps, nearly.
    let shift: [f64; 3] = std::array::from_fn(|k| {
        let middle = lo[k] / 2.0 + hi[k] / 2.0;
        match lattice {
            Some(l) => {
                let steps = ((middle - l.origin[k]) / l.step).round();
                let on = l.origin[k] + steps * l.step;
                if on.is_finite() { on } else { middle }
            }
            None => middle,
        }
    });
    let shifted = moved(mesh, lattice, tolerance(mesh), |p| {
        let s = stored(p, &shift);
        std::array::from_fn(|k| f64::from(s[k]) + shift[k])
    });
    if shifted.farthest.is_infinite() {
        let largest = lo.iter().chain(&hi).fold(0.0, |m: f64, x| m.max(x.abs()));
        return Err(WriteErrorKind::Coordinate { largest });
    }
    if shifted.count > 0 {
        warnings.push(WriteWarning::Rounded { count: shifted.count, farthest: shifted.farthest });
    }
    Ok(shift)
}

/// The JSON and the size of the binary chunk.
fn document(mesh: &Mesh, census: &Census, shift: &[f64; 3]) -> (Value, u64) {
    let asset = json!({"version": "2.0", "generator": concat!("lodestream ", env!("CARGO_PKG_VERSION"))});
    if mesh.positions.is_empty() {
        return (json!({"asset": asset, "scene": 0, "scenes": [{}]}), 0);
    }
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in &mesh.positions {
        let s = stored(p, shift);
        for k in 0..3 {
            lo[k] = lo[k].min(s[k]);
            hi[k] = hi[k].max(s[k]);
        }
    }
    let mut size = 12 * mesh.positions.len() as u64;
    let mut views = vec![json!({"buffer": 0, "byteLength": size, "target": 34962})];
    let mut accessors = vec![json!({
        "bufferView": 0, "componentType": 5126, "count": mesh.positions.len(), "type": "VEC3",
        "min": lo.map(f64::from), "max": hi.map(f64::from),
    })];
    let mut primitives = Vec::new();
    for (mode, indices) in [(4, 3 * census.triangles), (1, 2 * census.edges), (0, census.isolated.len() as u64)] {
        if indices == 0 {
            continue;
        }
        let number = accessors.len();
        views.push(json!({"buffer": 0, "byteOffset": size, "byteLength": 4 * indices, "target": 34963}));
        accessors.push(json!({"bufferView": number, "componentType": 5125, "count": indices, "type": "SCALAR"}));
        primitives.push(json!({"attributes": {"POSITION": 0}, "indices": number, "mode": mode, "material": 0}));
        size += 4 * indices;
    }
    let mut node = json!({"mesh": 0});
    if *shift != [0.0; 3] {
        node["translation"] = json!(shift);
    }
    let document = json!({
        "asset": asset,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": primitives}],
        // Seen from both sides: scans are not always turned the same way all over.
        "materials": [{"doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": size}],
    });
    (document, size)
}
