//! glTF and GLB: the counts of accessors, and how many different positions there are.

use std::collections::BTreeSet;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use serde_json::Value;

use super::super::gltf::meaning;
use super::Survey;
use super::distinct::Distinct;
use crate::image::jpeg::Working;
use crate::io::beside::{Folder, open_regular};

/// The most JSON that is parsed for a survey.
const MOST: u64 = 64 << 20;

fn int(v: &Value, key: &str) -> Option<u64> {
    v.get(key).and_then(Value::as_u64)
}

fn item<'a>(doc: &'a Value, list: &str, i: u64) -> Option<&'a Value> {
    doc.get(list)?.get(usize::try_from(i).ok()?)
}

/// The JSON of a document, where the binary chunk begins, and the bytes of the JSON.
pub(super) fn document(input: &mut (impl Read + Seek), size: u64) -> io::Result<Option<(Value, u64, u64)>> {
    let mut head = [0u8; 20];
    input.seek(SeekFrom::Start(0))?;
    let mut have = 0;
    while have < head.len() {
        match input.read(&mut head[have..])? {
            0 => break,
            n => have += n,
        }
    }
    let word = |i: usize| u64::from(u32::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3]]));
    let (start, length) = if head.starts_with(b"glTF") { (20, word(12)) } else { (0, size) };
    if length > MOST || start + length > size {
        return Ok(None);
    }
    input.seek(SeekFrom::Start(start))?;
    let mut text = Vec::new();
    input.take(length).read_to_end(&mut text)?;
    Ok(serde_json::from_slice(&text).ok().map(|json| (json, start + length + 8, length)))
}

/// Count the meshes of a document, each as often as nodes show it.
pub(super) fn counts(doc: &Value, mut distinct: impl FnMut(&Value) -> Option<u64>) -> Survey {
    let empty = Vec::new();
    let array = |key: &str| doc.get(key).and_then(Value::as_array).unwrap_or(&empty).as_slice();
    let meshes = array("meshes");
    let mut shown = vec![0u64; meshes.len()];
    for node in array("nodes") {
        let copies = node
            .pointer("/extensions/EXT_mesh_gpu_instancing/attributes")
            .and_then(Value::as_object)
            .and_then(|a| a.values().next()?.as_u64())
            .and_then(|i| int(item(doc, "accessors", i)?, "count"))
            .unwrap_or(1);
        if let Some(n) = int(node, "mesh").and_then(|m| shown.get_mut(usize::try_from(m).ok()?)) {
            *n = n.saturating_add(copies);
        }
    }
    let mut s = Survey { exact: true, ..Survey::default() };
    for image in array("images") {
        let inside = int(image, "bufferView").and_then(|view| int(item(doc, "bufferViews", view)?, "byteLength"));
        s.images = s.images.saturating_add(inside.unwrap_or(0));
    }
    let mut names: BTreeSet<&str> = BTreeSet::new();
    for (mesh, &times) in meshes.iter().zip(&shown) {
        let mut seen: Vec<u64> = Vec::new();
        let mut seen_values: BTreeSet<(&str, u64)> = BTreeSet::new();
        for primitive in mesh.get("primitives").and_then(Value::as_array).unwrap_or(&empty) {
            let Some(at) = primitive.pointer("/attributes/POSITION").and_then(Value::as_u64) else { continue };
            let Some(accessor) = item(doc, "accessors", at) else { continue };
            let records = int(accessor, "count").unwrap_or(0);
            let used =
                int(primitive, "indices").and_then(|i| int(item(doc, "accessors", i)?, "count")).unwrap_or(records);
            // Primitives of one mesh often share a set of positions.
            if !seen.contains(&at) {
                seen.push(at);
                let different = distinct(accessor).unwrap_or(records).min(records);
                s.records = s.records.saturating_add(times.saturating_mul(records));
                s.vertices = s.vertices.saturating_add(times.saturating_mul(different));
            }
            for (name, number) in primitive.get("attributes").and_then(Value::as_object).into_iter().flatten() {
                let (Some((kind, .., width)), Some(number)) = (meaning(name), number.as_u64()) else { continue };
                let Some(accessor) = item(doc, "accessors", number) else { continue };
                if !seen_values.insert((name, number)) {
                    continue;
                }
                let components = match accessor.get("type").and_then(Value::as_str) {
                    Some("SCALAR") => 1,
                    Some("VEC2") => 2,
                    Some("VEC3") => 3,
                    _ => 4,
                };
                let width = if width > 0 { u64::from(width) } else { components };
                let values = times.saturating_mul(int(accessor, "count").unwrap_or(0));
                s.add(kind, u64::from(names.insert(name)), values, width);
            }
            let (elements, corners) = match int(primitive, "mode").unwrap_or(4) {
                0 => (0, 0),
                1 => (used / 2, used),
                2 | 3 => (used, used.saturating_mul(2)),
                4 => (used / 3, used),
                _ => (used, used.saturating_mul(3)),
            };
            s.elements = s.elements.saturating_add(times.saturating_mul(elements));
            s.corners = s.corners.saturating_add(times.saturating_mul(corners));
        }
    }
    s
}

/// The images that pictures show: those of colours.
pub(crate) fn drawn_images(materials: &[Value], textures: &[Value]) -> BTreeSet<u64> {
    let mut drawn = BTreeSet::new();
    for material in materials {
        let glossy = &material["extensions"]["KHR_materials_pbrSpecularGlossiness"];
        for colours in [&material["pbrMetallicRoughness"]["baseColorTexture"], &glossy["diffuseTexture"]] {
            let number = colours["index"].as_u64().and_then(|n| usize::try_from(n).ok());
            let Some(texture) = number.and_then(|n| textures.get(n)) else { continue };
            let extensions = texture["extensions"].as_object().into_iter().flat_map(|e| e.values());
            drawn.extend(std::iter::once(texture).chain(extensions).filter_map(|t| t["source"].as_u64()));
        }
    }
    drawn
}

/// Survey a document of which the binary chunk, if any, lies in the same stream; other buffers are looked for in `folder`.
pub(super) fn survey(input: &mut (impl Read + Seek), size: u64, folder: Option<&Folder>) -> io::Result<Survey> {
    let Some((doc, chunk, length)) = document(input, size)? else {
        return Ok(Survey { unpacked: size, ..Survey::default() });
    };
    let list = |name: &str| doc.get(name).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let mut outside = 0u64;
    for buffer in doc.get("buffers").and_then(Value::as_array).into_iter().flatten() {
        // A stand-in for compressed data has no bytes, but those that it stands for will be unpacked.
        if buffer.get("uri").is_some() || buffer.get("extensions").is_some() {
            outside = outside.saturating_add(int(buffer, "byteLength").unwrap_or(0));
        }
    }
    // What Draco has packed is unpacked beside the mesh: at most sixteen bytes for a value and four for a corner.
    for primitive in list("meshes").iter().flat_map(|m| m.get("primitives").and_then(Value::as_array)).flatten() {
        let count = |number: &Value| int(item(&doc, "accessors", number.as_u64()?)?, "count");
        if primitive.pointer("/extensions/KHR_draco_mesh_compression").is_some() {
            let values = primitive.get("attributes").and_then(Value::as_object).into_iter().flat_map(|a| a.values());
            let values = values.filter_map(count).fold(0, u64::saturating_add);
            let corners = primitive.get("indices").and_then(count).unwrap_or(0);
            outside = outside.saturating_add(values.saturating_mul(16)).saturating_add(corners.saturating_mul(4));
        }
    }
    let mut s = counts(&doc, |accessor| {
        if int(accessor, "componentType") != Some(5126) {
            return None;
        }
        let view = item(&doc, "bufferViews", int(accessor, "bufferView")?)?;
        let stride = int(view, "byteStride").unwrap_or(12).max(12);
        let start = int(view, "byteOffset").unwrap_or(0).checked_add(int(accessor, "byteOffset").unwrap_or(0))?;
        let (number, count) = (int(view, "buffer")?, int(accessor, "count")?);
        match item(&doc, "buffers", number)?.get("uri").and_then(Value::as_str) {
            None if number == 0 => different(input, start.checked_add(chunk)?, count, stride).ok(),
            Some(uri) if !uri.starts_with("data:") => {
                different(&mut open_regular(&folder?.find(uri)?).ok()?.0, start, count, stride).ok()
            }
            _ => None,
        }
    });
    let drawn = drawn_images(list("materials"), list("textures"));
    for (number, image) in list("images").iter().enumerate() {
        let told = int(image, "bufferView").and_then(|view| {
            let view = item(&doc, "bufferViews", view)?;
            let (start, bytes) = (int(view, "byteOffset").unwrap_or(0), int(view, "byteLength")?);
            let number = int(view, "buffer")?;
            match item(&doc, "buffers", number)?.get("uri").and_then(Value::as_str) {
                None if number == 0 => {
                    input.seek(SeekFrom::Start(start.checked_add(chunk)?)).ok()?;
                    Some(Working::of(&mut *input, bytes))
                }
                Some(uri) if !uri.starts_with("data:") => {
                    let mut file = open_regular(&folder?.find(uri)?).ok()?.0;
                    file.seek(SeekFrom::Start(start)).ok()?;
                    Some(Working::of(&mut BufReader::new(file), bytes))
                }
                _ => None,
            }
        });
        let told = told.unwrap_or_default();
        s.working = s.working.and(if drawn.contains(&(number as u64)) { told } else { told.unseen() });
    }
    s.document = length;
    s.unpacked = size.saturating_add(outside);
    s.images = s.images.min(s.unpacked);
    Ok(s)
}

/// How many different positions lie there.
fn different(input: &mut (impl Read + Seek), start: u64, count: u64, stride: u64) -> io::Result<u64> {
    input.seek(SeekFrom::Start(start))?;
    let mut places = Distinct::new();
    let mut left = count.saturating_mul(stride);
    let stride = stride as usize;
    let mut buffer = vec![0u8; ((1 << 16) / stride).max(1) * stride];
    while left > 0 {
        let take = left.min(buffer.len() as u64) as usize;
        let mut have = 0;
        while have < take {
            match input.read(&mut buffer[have..take])? {
                0 => return Ok(places.count()),
                n => have += n,
            }
        }
        for record in buffer[..take].chunks(stride).filter(|r| r.len() >= 12) {
            let word = |i: usize| u32::from_le_bytes([record[i], record[i + 1], record[i + 2], record[i + 3]]);
            places.add_point([word(0), word(4), word(8)]);
        }
        left -= take as u64;
    }
    Ok(places.count())
}
