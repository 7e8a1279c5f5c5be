//! glTF 2.0, as JSON or as GLB: every primitive of every mesh of the default scene, placed by its nodes.
//!
//! Follows the Khronos glTF 2.0 specification (sections 3.5 scenes and transforms, 3.6 buffers and accessors, 3.7
//! meshes, 4.4 GLB), `KHR_mesh_quantization`, `EXT_mesh_gpu_instancing`, `EXT_meshopt_compression`,
//! `KHR_meshopt_compression` and `KHR_draco_mesh_compression`. Each node with a mesh contributes a copy of it.
//! Triangles of a mirrored node are turned round, as the specification asks. Lines become dangling edges, points
//! isolated vertices. Attributes become layers on corners; materials, textures, samplers and images keep their
//! numbers, and the first three come as they stand, extensions included. An extension that a file requires and that
//! changes what the mesh is, is an error that names it; those of lights and the like are skipped with a warning.

mod accessor;
mod appearance;
mod attribute;
mod buffer;
mod draco;
mod json;
mod meshopt;
mod primitive;
mod scene;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use super::build::Builder;
use super::error::{At, Fail, Place, ReadErrorKind, printable};
use super::warning::{Layer, Warning};
use super::{ReadMesh, ReadOptions};
use crate::io::beside::Folder;
pub(crate) use appearance::extensions_in;
pub(super) use attribute::meaning;

use accessor::Replacement;
use attribute::Wanted;
use buffer::Buffers;
use json::{list, text};
use primitive::MeshPlan;

/// Extensions that are read, outside of materials and textures.
const READ: [&str; 5] =
    ["KHR_mesh_quantization", "EXT_mesh_gpu_instancing", meshopt::NAMES[0], meshopt::NAMES[1], draco::NAME];

/// Extensions that may be required because they do not change geometry or connectivity, or because they are read.
fn harmless(extension: &str) -> bool {
    const PREFIXES: [&str; 9] = [
        "KHR_materials_",
        "KHR_texture_",
        "EXT_texture_",
        "MSFT_texture_",
        "KHR_lights_",
        "EXT_lights_",
        "KHR_xmp",
        "KHR_animation_",
        "EXT_materials_",
    ];
    const OTHERS: [&str; 6] = [
        "KHR_techniques_webgl",
        "EXT_structural_metadata",
        "EXT_mesh_features",
        "EXT_instance_features",
        "MSFT_packing_normalRoughnessMetallic",
        "MSFT_packing_occlusionRoughnessMetallic",
    ];
    READ.contains(&extension)
        || OTHERS.contains(&extension)
        || PREFIXES.iter().any(|prefix| extension.starts_with(prefix))
}

/// A parsed document and its buffers.
pub(super) struct Document<'a> {
    json: &'a Value,
    buffers: Buffers<'a>,
    /// While a primitive with Draco data is read: what its accessors hold.
    replaced: BTreeMap<u64, Replacement>,
    draco: draco::Unpacked,
}

pub(super) fn read(bytes: &[u8], folder: Option<&Folder>, options: &ReadOptions) -> Result<ReadMesh, Fail> {
    let mut b = Builder::new(options, true, bytes.len());
    let (text, chunk) = split(&mut b, bytes)?;
    // A number in a list takes two bytes of text and 32 as a value.
    b.budget.take(64 * memchr::memchr_iter(b',', text).count() as u64)?;
    let json: Value = serde_json::from_slice(text).map_err(|e| {
        let kind = match e.classify() {
            serde_json::error::Category::Eof => {
                ReadErrorKind::Truncated { what: "the JSON".to_string(), missing: None }
            }
            _ => ReadErrorKind::Syntax(format!("the JSON is damaged: {e}; mend it")),
        };
        Fail { place: Some(Place::Line(e.line() as u64)), kind }
    })?;
    check_version(&json)?;
    for extension in list(&json, "extensionsRequired").at(top)? {
        let name = extension.as_str().unwrap_or("?");
        if !harmless(name) {
            // What stands in a file may be anything; what stands in a message is one line.
            return Err(ReadErrorKind::Extension(name.escape_debug().take(80).collect()).into());
        }
    }
    let buffers = Buffers::new(&json, chunk, folder, bytes.len())?;
    let mut doc = Document { json: &json, buffers, replaced: BTreeMap::new(), draco: draco::Unpacked::default() };
    appearance::read(&mut doc, &mut b, folder)?;
    let instances = scene::instances(&mut doc, &mut b)?;

    let meshes = list(&json, "meshes").at(top)?.len();
    let used: BTreeSet<usize> = instances.iter().map(|i| i.mesh).collect();
    let mut plans: Vec<Option<MeshPlan>> = (0..meshes).map(|_| None).collect();
    let mut wanted = Wanted::default();
    for &mesh in &used {
        plans[mesh] = Some(MeshPlan::new(&mut doc, mesh, &mut wanted, &mut b)?);
    }
    wanted.prepare(&mut b);
    // The sizes are known before anything is made: instances can multiply a small file without end.
    let (mut records, mut faces, mut corners) = (0usize, 0usize, 0usize);
    for plan in instances.iter().filter_map(|i| plans[i.mesh].as_ref()) {
        records = records.saturating_add(plan.records);
        faces = faces.saturating_add(plan.faces);
        corners = corners.saturating_add(plan.corners);
    }
    b.expect_records(records)?;
    if records <= bytes.len() / 4 {
        b.expect_distinct(records);
    }
    b.expect_faces(faces, corners)?;
    for instance in &instances {
        if let Some(plan) = &plans[instance.mesh] {
            plan.emit(&doc, &instance.matrix, &wanted, &mut b)?;
        }
    }
    if used.len() < meshes {
        b.tally.others.push(Warning::UnusedMeshes { count: (meshes - used.len()) as u64 });
    }
    b.tally.drop_layer(Layer::Animations, list(&json, "animations").at(top)?.len() as u64);
    unsaid(&json, &mut b)?;
    drop(doc);
    drop(json);
    Ok(b.finish()?)
}

/// Count what stands in a document beside meshes, materials and their places.
fn unsaid(json: &Value, b: &mut Builder) -> Result<(), Fail> {
    let (mut names, mut extras) = (0, 0);
    let mut look = |item: &Value, named: bool| {
        names += u64::from(named && item.get("name").and_then(Value::as_str).is_some_and(|name| !name.is_empty()));
        extras += u64::from(item.get("extras").is_some_and(|e| !e.is_null()));
    };
    look(json, false);
    for (list_name, named) in [("nodes", true), ("meshes", true), ("scenes", false)] {
        for item in list(json, list_name).at(top)? {
            look(item, named);
            for primitive in list(item, "primitives").at(top)? {
                look(primitive, false);
            }
        }
    }
    b.tally.drop_layer(Layer::NodeNames, names);
    b.tally.drop_layer(Layer::Extras, extras);
    b.tally.drop_layer(Layer::Cameras, list(json, "cameras").at(top)?.len() as u64);
    Ok(())
}

/// The place of what concerns the whole document.
fn top() -> Place {
    Place::Item("document".to_string())
}

fn check_version(json: &Value) -> Result<(), Fail> {
    let version = match json.get("asset") {
        Some(asset) => text(asset, "version").at(|| Place::Item("asset".to_string()))?,
        None => None,
    };
    let Some(version) = version else {
        let missing = "`asset.version` is missing, so this is no glTF 2.0 document; mend it".to_string();
        return Err(ReadErrorKind::Syntax(missing).into());
    };
    if version != "2" && !version.starts_with("2.") {
        let what = format!("glTF version {:?}", version.chars().take(12).collect::<String>());
        return Err(ReadErrorKind::Unsupported { what, advice: "convert the file to glTF 2.0" }.into());
    }
    Ok(())
}

/// The JSON, and the binary chunk of a GLB.
fn split<'a>(b: &mut Builder, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), Fail> {
    if !bytes.starts_with(b"glTF") {
        let json = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        if json.trim_ascii_start().first() != Some(&b'{') {
            let (format, found) = ("a glTF or GLB file", printable(bytes));
            return Err(ReadErrorKind::WrongMagic { format, expected: "`{` or `glTF`", found }.into());
        }
        return Ok((json, None));
    }
    let word = |at: usize| bytes.get(at..at + 4).map(|w| u32::from_le_bytes([w[0], w[1], w[2], w[3]]));
    let cut =
        |what: &str, missing: usize| ReadErrorKind::Truncated { what: what.to_string(), missing: Some(missing as u64) };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(cut("the GLB header", 12 - bytes.len())).at(|| Place::Byte(bytes.len() as u64));
    };
    if version != 2 {
        let what = format!("GLB version {version}");
        return Err(ReadErrorKind::Unsupported { what, advice: "convert the file to glTF 2.0" }).at(|| Place::Byte(4));
    }
    let length = length as usize;
    if length > bytes.len() {
        return Err(cut("the GLB", length - bytes.len())).at(|| Place::Byte(bytes.len() as u64));
    }
    if length < bytes.len() {
        b.tally.others.push(Warning::TrailingBytes { count: (bytes.len() - length) as u64 });
    }
    let (mut at, mut json, mut binary) = (12, None, None);
    // A chunk begins with eight bytes: length and type.
    while at + 8 <= length {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else { break };
        let size = size as usize;
        let start = at + 8;
        let Some(data) = bytes[..length].get(start..).and_then(|rest| rest.get(..size)) else {
            return Err(cut("a GLB chunk", size - (length - start))).at(|| Place::Byte(at as u64));
        };
        match kind {
            0x4e4f_534a if json.is_none() => json = Some(data),
            0x004e_4942 if binary.is_none() => binary = Some(data),
            _ => {}
        }
        at = start + size;
    }
    match json {
        Some(json) => Ok((json, binary)),
        None => {
            let missing = "the GLB has no JSON chunk; mend it".to_string();
            Err(ReadErrorKind::Syntax(missing)).at(|| Place::Byte(12))
        }
    }
}
