//! Compressed glTF: meshoptimizer, Draco, quantized attributes.
//!
//! Streams of meshoptimizer come from its own encoder, those of Draco from the encoder of its authors in
//! gltf-transform.

use base64::Engine as _;
use lodestream::io::read::{Format, ReadErrorKind, ReadOptions, read_bytes};
use lodestream::io::write::write_to;
use lodestream::mesh::LayerKind;
use serde_json::{Value, json};

use super::{case, faces, read, warnings};

/// A grid of 6 × 5 vertices: x, y, and a height in quarters.
fn positions() -> Vec<[f32; 3]> {
    (0..30).map(|k| (k % 6, k / 6)).map(|(i, j)| [i as f32, j as f32, (i * j % 4) as f32 / 4.0]).collect()
}

fn triangles() -> Vec<u32> {
    let corner = (0..20).map(|k| 6 * (k / 5) + k % 5);
    corner.flat_map(|k| [k, k + 1, k + 7, k, k + 7, k + 6]).collect()
}

fn uri(bytes: &[u8]) -> Value {
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    json!(format!("data:application/octet-stream;base64,{text}"))
}

/// A document whose buffer views are the streams, each with its extension object; items: count, stride, accessor.
struct Packed {
    data: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    extension: &'static str,
}

impl Packed {
    fn new(extension: &'static str) -> Self {
        Packed { data: Vec::new(), views: Vec::new(), accessors: Vec::new(), extension }
    }

    fn add(&mut self, stream: &[u8], count: usize, stride: usize, mut packed: Value, mut accessor: Value) {
        for (key, value) in [("buffer", 0), ("byteOffset", self.data.len()), ("byteLength", stream.len())] {
            packed[key] = json!(value);
        }
        packed["count"] = json!(count);
        packed["byteStride"] = json!(stride);
        self.data.extend(stream);
        accessor["bufferView"] = json!(self.views.len());
        let mut view = json!({"buffer": 1, "byteLength": count * stride, "extensions": {self.extension: packed}});
        if view["extensions"][self.extension]["mode"] == "ATTRIBUTES" {
            view["byteStride"] = json!(stride);
        }
        self.views.push(view);
        self.accessors.push(accessor);
    }

    fn document(self) -> Value {
        let extension = self.extension;
        let size = self.views.iter().filter_map(|v| v["byteLength"].as_u64()).sum::<u64>();
        json!({
            "asset": {"version": "2.0"},
            "extensionsUsed": [extension, "KHR_mesh_quantization"],
            "extensionsRequired": [extension, "KHR_mesh_quantization"],
            "meshes": [{"primitives": [{
                "attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2, "TEXCOORD_0": 3}, "indices": 4
            }]}],
            "accessors": self.accessors, "bufferViews": self.views,
            "buffers": [
                {"byteLength": self.data.len(), "uri": uri(&self.data)},
                {"byteLength": size, "extensions": {extension: {"fallback": true}}}
            ]
        })
    }
}

/// The grid with normals by the octahedral filter, colours, 16-bit texture coordinates and triangles.
fn packed(extension: &'static str) -> Value {
    let mut p = Packed::new(extension);
    let attributes = || json!({"mode": "ATTRIBUTES"});
    let stream = meshopt::encode_vertex_buffer(&positions()).unwrap();
    p.add(&stream, 30, 12, attributes(), json!({"componentType": 5126, "count": 30, "type": "VEC3"}));
    let normals = meshopt::encode_filter_oct::<i8>(&[[0.0, 0.0, 1.0, 0.0]; 30], 8);
    let filtered = json!({"mode": "ATTRIBUTES", "filter": "OCTAHEDRAL"});
    let accessor = json!({"componentType": 5120, "normalized": true, "count": 30, "type": "VEC3"});
    p.add(&meshopt::encode_vertex_buffer(&normals).unwrap(), 30, 4, filtered, accessor);
    let colours: Vec<[u8; 4]> = (0..30).map(|k| [8 * k, 255 - k, 128, 255]).collect();
    let accessor = json!({"componentType": 5121, "normalized": true, "count": 30, "type": "VEC4"});
    p.add(&meshopt::encode_vertex_buffer(&colours).unwrap(), 30, 4, attributes(), accessor);
    let uvs: Vec<[u16; 2]> = (0..30).map(|k| [(k % 6) * 13107, (k / 6) * 16383]).collect();
    let accessor = json!({"componentType": 5123, "normalized": true, "count": 30, "type": "VEC2"});
    p.add(&meshopt::encode_vertex_buffer(&uvs).unwrap(), 30, 4, attributes(), accessor);
    let stream = meshopt::encode_index_buffer(&triangles(), 30).unwrap();
    p.add(
        &stream,
        120,
        2,
        json!({"mode": "TRIANGLES"}),
        json!({"componentType": 5123, "count": 120, "type": "SCALAR"}),
    );
    p.document()
}

fn rotated(faces: &[Vec<u32>]) -> Vec<Vec<u32>> {
    let mut out: Vec<Vec<u32>> = faces
        .iter()
        .map(|f| {
            let first = (0..f.len()).min_by_key(|&i| f[i]).unwrap();
            f[first..].iter().chain(&f[..first]).copied().collect()
        })
        .collect();
    out.sort();
    out
}

fn grid() -> Vec<Vec<u32>> {
    let faces: Vec<Vec<u32>> = triangles().chunks(3).map(<[u32]>::to_vec).collect();
    rotated(&faces)
}

#[test]
fn meshopt_gives_back_what_was_packed() {
    for extension in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let m = read(packed(extension).to_string(), Format::Gltf).unwrap();
        assert_eq!(warnings(&m), [""; 0], "{extension}");
        let wanted: Vec<[f64; 3]> = positions().iter().map(|p| p.map(f64::from)).collect();
        assert_eq!(m.mesh.positions, wanted);
        // The encoder may turn triangles, and keeps their order.
        assert_eq!(rotated(&faces(&m)), grid());
        let of = |kind| m.mesh.layers.iter().find(|l| l.kind == kind).unwrap();
        assert_eq!(of(LayerKind::Normal).value(7), [0.0, 0.0, 1.0]);
        assert_eq!(of(LayerKind::Color).value(9), [72.0 / 255.0, 246.0 / 255.0, 128.0 / 255.0, 1.0]);
        let uv = of(LayerKind::Uv).value(11);
        assert_eq!(uv, [1.0, 1.0 - 16383.0 / 65535.0]);
        let mut out = Vec::new();
        write_to(&mut out, Format::Glb, &m.mesh, None).unwrap();
        assert_eq!(read(&out, Format::Glb).unwrap().mesh.positions, m.mesh.positions);
    }
}

#[test]
fn filters_of_meshopt() {
    let mut doc = packed("KHR_meshopt_compression");
    let exponents = meshopt::encode_filter_exp::<3>(&positions(), 15, meshopt::EncodeExpMode::Separate);
    let stream = meshopt::encode_vertex_buffer(&exponents).unwrap();
    doc["buffers"].as_array_mut().unwrap().push(json!({"byteLength": stream.len(), "uri": uri(&stream)}));
    let packed = &mut doc["bufferViews"][0]["extensions"]["KHR_meshopt_compression"];
    *packed = json!({
        "buffer": 2, "byteLength": stream.len(), "byteStride": 12, "count": 30, "mode": "ATTRIBUTES", "filter": "EXPONENTIAL"
    });
    let m = read(doc.to_string(), Format::Gltf).unwrap();
    for (found, wanted) in m.mesh.positions.iter().zip(positions()) {
        assert!((0..3).all(|k| (found[k] - f64::from(wanted[k])).abs() < 1e-3), "{found:?} {wanted:?}");
    }
    let sequence = meshopt::encode_index_sequence(&triangles(), 30).unwrap();
    doc["buffers"].as_array_mut().unwrap().push(json!({"byteLength": sequence.len(), "uri": uri(&sequence)}));
    doc["bufferViews"][4]["extensions"]["KHR_meshopt_compression"] =
        json!({"buffer": 3, "byteLength": sequence.len(), "byteStride": 2, "count": 120, "mode": "INDICES"});
    let exact = read(doc.to_string(), Format::Gltf).unwrap();
    assert_eq!(faces(&exact).concat(), triangles());
}

#[test]
fn plain_data_beside_compressed_ones_are_read() {
    let m = read(case("gltf-meshopt-fallback/packed.gltf"), Format::Gltf).unwrap();
    assert_eq!(m.mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!((faces(&m), warnings(&m)), (vec![vec![0, 1, 2], vec![0, 2, 3]], Vec::new()));
    // A stand-in that was left behind: the compressed data serve.
    let mut doc = packed("EXT_meshopt_compression");
    doc["buffers"][1]["uri"] = json!("left-behind.bin");
    assert_eq!(read(doc.to_string(), Format::Gltf).unwrap().mesh.vertex_count(), 30);
}

#[test]
fn a_stride_of_zero_is_none() {
    let mut doc: Value = serde_json::from_slice(&case("gltf-meshopt-fallback/packed.gltf")).unwrap();
    doc["bufferViews"][0]["byteStride"] = json!(0);
    doc["bufferViews"][1]["byteStride"] = json!(0);
    assert_eq!(read(doc.to_string(), Format::Gltf).unwrap().mesh.face_count(), 2);
}

#[test]
fn what_is_wrong_with_compressed_views_is_said() {
    let error = |change: &dyn Fn(&mut Value)| {
        let mut doc = packed("EXT_meshopt_compression");
        change(&mut doc);
        read(doc.to_string(), Format::Gltf).unwrap_err().to_string()
    };
    let of = |doc: &mut Value, view: usize, key: &str, value: Value| {
        doc["bufferViews"][view]["extensions"]["EXT_meshopt_compression"][key] = value;
    };
    assert_eq!(
        error(&|d| of(d, 0, "count", json!(29))),
        "input, bufferViews[0].extensions.EXT_meshopt_compression: 29 items of 12 bytes do not fill a view of 360 bytes; mend the document"
    );
    let many = error(&|d| of(d, 0, "count", json!(4_000_000)));
    assert!(many.contains("4000000 items of 12 bytes are announced, but the"), "{many}");
    let damaged = error(&|d| of(d, 0, "byteLength", json!(20)));
    assert!(
        damaged.starts_with("input, bufferViews[0].extensions.EXT_meshopt_compression: the meshopt data is damaged:")
    );
    assert_eq!(
        error(&|d| of(d, 0, "mode", json!("SPLATS"))),
        "input, bufferViews[0].extensions.EXT_meshopt_compression: the mode \"SPLATS\" of meshopt compression is not supported; unpack the file with `gltf-transform copy IN.glb OUT.glb`"
    );
    let outside = error(&|d| of(d, 0, "byteOffset", json!(1 << 30)));
    assert!(outside.contains("it ends at byte"), "{outside}");
    let text = packed("EXT_meshopt_compression").to_string();
    let options = ReadOptions { memory_limit: Some(6000), ..ReadOptions::default() };
    let limited = read_bytes(text.as_bytes(), Format::Gltf, None, &options);
    assert!(matches!(limited.unwrap_err().kind, ReadErrorKind::Memory { .. }));
}

const DRACO: [&str; 3] = ["edgebreaker", "valence", "sequential"];

#[test]
fn draco_gives_back_what_was_packed() {
    for name in DRACO {
        let m = read(case(&format!("draco/{name}.glb")), Format::Glb).unwrap();
        assert_eq!((m.mesh.vertex_count(), m.mesh.face_count()), (30, 40), "{name}");
        assert_eq!(warnings(&m), [""; 0], "{name}");
        // Draco orders vertices as it likes; their numbers stand beside them.
        let numbers = m.mesh.layers.iter().find(|l| l.kind == LayerKind::Scalar).unwrap();
        let (uvs, colours) = (
            &m.mesh.layers.iter().find(|l| l.kind == LayerKind::Uv).unwrap(),
            &m.mesh.layers.iter().find(|l| l.kind == LayerKind::Color).unwrap(),
        );
        let mut renamed = m.mesh.corners.clone();
        for (c, &v) in m.mesh.corners.iter().enumerate() {
            let number = numbers.value(numbers.corners[c])[0] as u32;
            let (i, j) = (number % 1000, number / 1000);
            renamed[c] = 6 * j + i;
            let wanted = positions()[renamed[c] as usize];
            let found = m.mesh.positions[v as usize];
            assert!((0..3).all(|k| (found[k] - f64::from(wanted[k])).abs() < 5.0 / 16383.0), "{found:?} {wanted:?}");
            let uv = uvs.value(uvs.corners[c]);
            let wanted = [f64::from(i) / 5.0, 1.0 - f64::from(j) / 4.0];
            assert!((0..2).all(|k| (uv[k] - wanted[k]).abs() < 1.0 / 4095.0), "{uv:?} {wanted:?}");
            let whole = |x: u32| f64::from(x) / 255.0;
            assert_eq!(colours.value(colours.corners[c]), [whole(50 * i), whole(60 * j), whole(128), 1.0], "{name}");
        }
        let found: Vec<Vec<u32>> = renamed.chunks(3).map(<[u32]>::to_vec).collect();
        assert_eq!(rotated(&found), grid(), "{name}");
    }
}

/// A GLB with another document of the same length.
fn with_json(glb: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let at = glb.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
    let mut out = glb.to_vec();
    out[at..at + to.len()].copy_from_slice(to.as_bytes());
    out
}

#[test]
fn draco_is_held_against_the_document() {
    let glb = case("draco/edgebreaker.glb");
    let error = |from: &str, to: &str| read(with_json(&glb, from, to), Format::Glb).unwrap_err().to_string();
    assert_eq!(
        error("\"count\":120", "\"count\":117"),
        "input, meshes[0].primitives[0]: the Draco data hold 120 corners, but 117 are announced; export the file again"
    );
    assert_eq!(
        error("5126,\"count\":30,\"max\"", "5126,\"count\":31,\"max\""),
        "input, meshes[0].primitives[0]: the Draco data hold 30 vertices, but 31 are announced; export the file again"
    );
    assert_eq!(
        error("\"_NUMBER\":4", "\"_NUMBER\":9"),
        "input, meshes[0].primitives[0]: the Draco data have no attribute 9; export the file again"
    );
    let options = ReadOptions { memory_limit: Some(8000), ..ReadOptions::default() };
    assert!(read_bytes(&glb, Format::Glb, None, &options).is_err());
}

#[test]
fn damaged_streams_are_errors_and_no_panics() {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = move |n: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % n as u64) as usize
    };
    let mut refused = 0;
    for name in DRACO {
        let glb = case(&format!("draco/{name}.glb"));
        let start = glb.windows(5).position(|w| w == b"DRACO").unwrap();
        for _ in 0..400 {
            let mut bad = glb.clone();
            match random(3) {
                // The rest of the stream is zeros: cut.
                0 => bad[start + random(glb.len() - start)..].fill(0),
                1 => bad[start + random(40)] = random(256) as u8,
                _ => bad[start + random(glb.len() - start)] ^= 1 << random(8),
            }
            refused += usize::from(read(&bad, Format::Glb).is_err());
        }
    }
    assert!(refused > 300, "{refused}");
    let doc = packed("KHR_meshopt_compression");
    let text = doc["buffers"][0]["uri"].as_str().unwrap().split_once(',').unwrap().1.to_string();
    let data = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
    for _ in 0..400 {
        let mut bad = data.clone();
        let at = random(bad.len());
        match random(2) {
            0 => bad[at..].fill(0),
            _ => bad[at] = random(256) as u8,
        }
        let mut doc = doc.clone();
        doc["buffers"][0]["uri"] = uri(&bad);
        if let Ok(m) = read(doc.to_string(), Format::Gltf) {
            m.mesh.validate().unwrap();
        }
    }
}
