//! GLB (glTF 2.0): triangles, with polygons as fans; dangling edges as LINES; isolated vertices as POINTS.
//!
//! glTF has no double precision. Where single precision does not hold the positions (scans in national grid
//! coordinates), the node carries a translation and the vertices what is left: readers add the two.
//!
//! Vertices repeat where their corners differ in any layer ([`Split`]). All primitives share one run of vertices; there is
//! one primitive for each material and each set of layers that its faces have. Materials, textures and samplers go in as
//! they are, images as parts of the file.

mod parts;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;

use serde_json::{Value, json};

use super::sidecars::Sidecars;
use super::split::Split;
use super::stl::tolerance;
use super::{Census, WriteErrorKind, WriteWarning, moved, single};
use crate::io::read::{NO_MATERIAL, extensions_in};
use crate::mesh::lattice::Lattice;
use crate::mesh::{LayerKind, Mesh, NO_VALUE};
use parts::{Attribute, Part};

pub(super) fn write<'m>(
    out: &mut impl Write,
    mesh: &'m Mesh,
    lattice: Option<&Lattice>,
    beside: &mut Sidecars<'m>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let census = Census::of(mesh);
    let mut warnings: Vec<WriteWarning> = census.fanned().into_iter().collect();
    let shift = translation(mesh, lattice, &mut warnings)?;
    let scene = Scene::new(mesh, &census, beside, &mut warnings);
    let (document, parts) = scene.document(&shift);
    let size: u64 = parts.iter().map(|p| p.size(&scene).next_multiple_of(4)).sum();
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
    if size > 0 {
        out.write_all(&(size as u32).to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        for part in &parts {
            part.write(out, &scene, &shift)?;
        }
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

/// Faces of one primitive: whether they are edges, material, the layers they have.
type Key = (bool, u32, u64);

/// A mesh laid out for glTF.
struct Scene<'m> {
    mesh: &'m Mesh,
    split: Split,
    attributes: Vec<Attribute<'m>>,
    /// Runs of faces in `order`: what they share, and where they end.
    groups: Vec<(Key, usize)>,
    order: Vec<u32>,
    /// Isolated vertices by the layers that have values for them.
    points: BTreeMap<u64, Vec<u32>>,
    images: Vec<String>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    /// The most sets of texture coordinates that a material asks for.
    asked: Vec<usize>,
}

impl<'m> Scene<'m> {
    fn new(mesh: &'m Mesh, census: &Census, beside: &mut Sidecars<'m>, warnings: &mut Vec<WriteWarning>) -> Self {
        let layers: Vec<_> = mesh.layers.iter().collect();
        let split = Split::new(mesh, &layers);
        let attributes = parts::attributes(mesh, warnings);
        let mut keys: BTreeMap<Key, usize> = BTreeMap::new();
        let key = |f: usize| -> Key {
            let first = mesh.face_start[f] as usize;
            let has = layers.iter().enumerate().filter(|(_, l)| l.corners[first] != NO_VALUE);
            let mask = has.fold(0, |m, (k, _)| m | 1u64 << k.min(63));
            let material = mesh.material.get(f).copied().unwrap_or(NO_VALUE);
            (mesh.face(f).len() == 2, material, mask)
        };
        for f in 0..mesh.face_count() {
            *keys.entry(key(f)).or_default() += 1;
        }
        // A counting sort: faces stay in their order within a group.
        let mut groups = Vec::with_capacity(keys.len());
        let mut end = 0;
        for (key, count) in &mut keys {
            end += *count;
            groups.push((*key, end));
            *count = end - *count;
        }
        let mut order = vec![0; mesh.face_count()];
        for f in 0..mesh.face_count() {
            if let Some(place) = keys.get_mut(&key(f)) {
                order[*place] = f as u32;
                *place += 1;
            }
        }
        let mut points: BTreeMap<u64, Vec<u32>> = BTreeMap::new();
        for &v in &census.isolated {
            let has = split.values.iter().enumerate().filter(|(_, values)| values[v as usize] != NO_VALUE);
            let mask = has.fold(0, |m, (k, _)| m | 1u64 << k.min(63));
            points.entry(mask).or_default().push(v);
        }
        let appearance = &mesh.appearance;
        let parse = |text: &String| match serde_json::from_str::<Value>(text) {
            Ok(value) if value.is_object() => value,
            _ => json!({}),
        };
        let mut materials: Vec<Value> = appearance.materials.iter().map(parse).collect();
        let asked = materials.iter().map(sets_asked).collect();
        if groups.iter().any(|g| g.0.1 == NO_VALUE) || !points.is_empty() {
            // Seen from both sides: scans are not always turned the same way all over.
            materials.push(json!({
                "doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}, "extras": {"lodestream": NO_MATERIAL},
            }));
        }
        let mut textures: Vec<Value> = appearance.textures.iter().map(parse).collect();
        for texture in &mut textures {
            // glTF itself knows PNG and JPEG alone.
            let source = texture["source"].as_u64().and_then(|i| Some((i, appearance.images.get(i as usize)?)));
            if let (Some((i, image)), Some(object)) = (source, texture.as_object_mut())
                && image.mime == "image/webp"
            {
                object.remove("source");
                object.entry("extensions").or_insert_with(|| json!({}))["EXT_texture_webp"] = json!({ "source": i });
            }
        }
        let missing = appearance.images.iter().filter(|i| i.bytes.is_empty()).count() as u64;
        if missing > 0 {
            warnings.push(WriteWarning::ImagesMissing { count: missing });
        }
        let known = ["image/png", "image/jpeg", "image/webp", "image/ktx2", "image/vnd-ms.dds", "image/avif"];
        let foreign = appearance.images.iter().filter(|i| !i.bytes.is_empty() && !known.contains(&i.mime.as_str()));
        let foreign = foreign.count() as u64;
        if foreign > 0 {
            warnings.push(WriteWarning::ForeignImages { count: foreign });
        }
        // Nothing is written beside a GLB: only the names are wanted.
        let images = beside.images(mesh);
        beside.files.clear();
        Scene { mesh, split, attributes, groups, order, points, images, materials, textures, asked }
    }

    /// The JSON, and what the binary chunk is made of.
    fn document(&self, shift: &[f64; 3]) -> (Value, Vec<Part>) {
        let mesh = self.mesh;
        let mut document = json!({
            "asset": {"version": "2.0", "generator": concat!("lodestream ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{}],
        });
        let mut parts = Parts::default();
        if !mesh.positions.is_empty() {
            let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
            for p in &mesh.positions {
                let s = stored(p, shift);
                for k in 0..3 {
                    lo[k] = lo[k].min(s[k]);
                    hi[k] = hi[k].max(s[k]);
                }
            }
            let count = self.split.vertex.len();
            parts.add(self, Part::Positions, json!({
                "componentType": 5126, "count": count, "type": "VEC3", "min": lo.map(f64::from), "max": hi.map(f64::from),
            }));
            let mut primitives = Vec::new();
            let mut first = 0;
            for &((edges, material, mask), end) in &self.groups {
                let run = first..end;
                first = end;
                let corners = |f: &u32| mesh.face(*f as usize).len();
                let indices: usize = match edges {
                    true => 2 * run.len(),
                    false => self.order[run.clone()].iter().map(|f| 3 * (corners(f) - 2)).sum(),
                };
                let mode = if edges { 1 } else { 4 };
                primitives.push(self.primitive(&mut parts, Part::Faces(run), indices, mode, mask, material));
            }
            for (&mask, points) in &self.points {
                primitives.push(self.primitive(&mut parts, Part::Points(mask), points.len(), 0, mask, NO_VALUE));
            }
            let mut node = json!({"mesh": 0});
            if *shift != [0.0; 3] {
                node["translation"] = json!(shift);
            }
            document["scenes"] = json!([{"nodes": [0]}]);
            document["nodes"] = json!([node]);
            document["meshes"] = json!([{ "primitives": primitives }]);
        }
        let mut images = Vec::new();
        for (i, image) in mesh.appearance.images.iter().enumerate() {
            let mut item = if image.bytes.is_empty() {
                json!({"uri": percent_encode(&self.images[i])})
            } else {
                let view = parts.view(self, Part::Image(i));
                json!({"bufferView": view, "mimeType": if image.mime.is_empty() { "image/png" } else { &image.mime }})
            };
            if !image.name.is_empty() && !image.bytes.is_empty() {
                item["name"] = json!(image.name);
            }
            images.push(item);
        }
        let samplers: Vec<Value> =
            mesh.appearance.samplers.iter().map(|s| serde_json::from_str(s).unwrap_or_else(|_| json!({}))).collect();
        let mut extensions = BTreeSet::new();
        for value in self.materials.iter().chain(&self.textures).chain(&samplers) {
            extensions_in(value, &mut extensions);
        }
        let mut required = BTreeSet::new();
        for texture in self.textures.iter().filter(|t| t.get("source").is_none()) {
            let known = texture["extensions"].as_object();
            required.extend(known.into_iter().flatten().filter(|e| e.1.get("source").is_some()).map(|e| e.0.clone()));
        }
        let size: u64 = parts.parts.iter().map(|p| p.size(self).next_multiple_of(4)).sum();
        for (key, list) in [
            ("accessors", parts.accessors),
            ("bufferViews", parts.views),
            ("materials", self.materials.clone()),
            ("textures", self.textures.clone()),
            ("samplers", samplers),
            ("images", images),
            ("buffers", if size > 0 { vec![json!({ "byteLength": size })] } else { Vec::new() }),
            ("extensionsUsed", extensions.into_iter().map(Value::from).collect()),
            ("extensionsRequired", required.into_iter().map(Value::from).collect()),
        ] {
            // glTF has no empty lists.
            if !list.is_empty() {
                document[key] = list.into();
            }
        }
        (document, parts.parts)
    }

    fn primitive(&self, parts: &mut Parts, part: Part, count: usize, mode: u8, mask: u64, material: u32) -> Value {
        let mut attributes = json!({"POSITION": 0});
        let asked = self.asked.get(material as usize).copied().unwrap_or(0);
        let has = |k: usize| mask >> k.min(63) & 1 == 1;
        let set = |kind: LayerKind, n: usize| self.attributes.iter().filter(move |a| a.layer.kind == kind).nth(n);
        for attribute in &self.attributes {
            // Sets are counted without gaps, and a material needs those that it names.
            let numbered = matches!(attribute.layer.kind, LayerKind::Uv | LayerKind::Color);
            let later = numbered
                && self
                    .attributes
                    .iter()
                    .any(|a| a.layer.kind == attribute.layer.kind && a.set > attribute.set && has(a.at));
            let needed = attribute.layer.kind == LayerKind::Uv && attribute.set < asked && mode == 4;
            let alone = attribute.layer.kind == LayerKind::Tangent
                && !set(LayerKind::Normal, 0).is_some_and(|normal| has(normal.at));
            if (has(attribute.at) || later || needed) && !alone {
                let next = parts.accessors.len();
                let number = *parts.of_attribute.entry(attribute.at).or_insert(next);
                if number == next {
                    parts.add(self, Part::Attribute(attribute.at), attribute.accessor(self.split.vertex.len()));
                }
                attributes[&attribute.name] = json!(number);
            }
        }
        let indices = parts.accessors.len();
        parts.add(self, part, json!({"componentType": 5125, "count": count, "type": "SCALAR"}));
        let material = if material == NO_VALUE { self.materials.len() - 1 } else { material as usize };
        json!({"attributes": attributes, "indices": indices, "mode": mode, "material": material})
    }
}

/// How many sets of texture coordinates a material names.
fn sets_asked(material: &Value) -> usize {
    match material {
        Value::Object(object) => {
            let own = match object.get("index") {
                Some(_) => 1 + object.get("texCoord").and_then(Value::as_u64).unwrap_or(0) as usize,
                None => 0,
            };
            let inner = object.iter().filter(|(k, _)| *k != "extras").map(|(_, v)| sets_asked(v)).max();
            // KHR_texture_transform may name another set.
            let moved = object.get("texCoord").and_then(Value::as_u64).map_or(0, |n| n as usize + 1);
            own.max(moved).max(inner.unwrap_or(0)).min(64)
        }
        Value::Array(items) => items.iter().map(sets_asked).max().unwrap_or(0),
        _ => 0,
    }
}

/// A name as a reference.
fn percent_encode(name: &str) -> String {
    name.bytes().fold(String::new(), |mut out, b| {
        if b.is_ascii_alphanumeric() || b"-._~".contains(&b) {
            out.push(char::from(b));
        } else {
            out.push_str(&format!("%{b:02X}"));
        }
        out
    })
}

/// Accessors, buffer views and what fills them, in the order of the file.
#[derive(Default)]
struct Parts {
    accessors: Vec<Value>,
    views: Vec<Value>,
    parts: Vec<Part>,
    size: u64,
    /// The accessors of layers.
    of_attribute: BTreeMap<usize, usize>,
}

impl Parts {
    /// A buffer view for a part.
    fn view(&mut self, scene: &Scene<'_>, part: Part) -> usize {
        let size = part.size(scene);
        let mut view = json!({"buffer": 0, "byteOffset": self.size, "byteLength": size});
        match &part {
            Part::Image(_) => {}
            Part::Faces(_) | Part::Points(_) => view["target"] = json!(34963),
            Part::Positions => view["target"] = json!(34962),
            Part::Attribute(at) => {
                view["target"] = json!(34962);
                view["byteStride"] = json!(scene.attributes[*at].stride());
            }
        }
        self.size += size.next_multiple_of(4);
        self.views.push(view);
        self.parts.push(part);
        self.views.len() - 1
    }

    /// An accessor to a part.
    fn add(&mut self, scene: &Scene<'_>, part: Part, mut accessor: Value) {
        accessor["bufferView"] = json!(self.view(scene, part));
        self.accessors.push(accessor);
    }
}
