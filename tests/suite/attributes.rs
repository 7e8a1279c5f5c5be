//! Attributes, materials and images out of files: what each format says, and what comes of files that say it badly.
#![cfg(feature = "formats")]

use std::fs;
use std::path::Path;

use base64::Engine as _;
use lodestream::io::read::{DropSet, Format, ReadErrorKind, ReadMesh, ReadOptions, read_bytes, read_path};
use lodestream::mesh::{Layer, LayerKind, Mesh, NO_VALUE, Stored};
use serde_json::{Value, json};

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n and so on";

fn layer(mesh: &Mesh, kind: LayerKind) -> &Layer {
    mesh.layers.iter().find(|l| l.kind == kind).unwrap_or_else(|| panic!("no {kind:?}"))
}

fn texts(read: &ReadMesh) -> Vec<String> {
    read.warnings.iter().map(ToString::to_string).collect()
}

fn parse(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

const TEXTURED: &str = "mtllib the materials.mtl\nv 0 0 0\nv 1 0 0 0.5 0.5 0.25\nv 0 1 0 1 0 0\nv 1 1 0 0 0 0\nvt 0.5\nvt 0 1 \n\
    vt 1 -2.5 0\nvn 0 0 1\nvn 0 0 nan\nusemtl red one\nf 1/1/1 2/2/1 3/-1/1\nusemtl none\nf 3/1/2 2/2/1 4/9/1\n\
    usemtl red one\nf 2 3 4\nl 1/1 2/2 3/3\n";

#[test]
fn obj_with_a_library() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    put("mesh.obj", TEXTURED.as_bytes());
    put(
        "The Materials.MTL",
        b"newmtl unused\nmap_Kd unused.png\nnewmtl red one\r\nKd 1 0 0\r\nmap_Kd -clamp on C:\\work\\Red Tex.PNG\r\nmap_Ks gone.jpg\r\n",
    );
    put("red tex.png", PNG);
    let read = read_path(folder.path().join("mesh.obj"), &ReadOptions::default()).unwrap();
    read.mesh.validate().unwrap();
    assert_eq!(
        texts(&read),
        [
            "1 image file not found: gone.jpg",
            "1 material is used but not described; the name is kept: none",
            "1 corner names a value of `uv` that the file does not have; they are read as without",
            "1 face has values of `uv` at some corners only; they were left out",
            "1 value of `normal` not finite and left out",
            "1 face has values of `normal` at some corners only; they were left out",
            "2 faces have values of `color` at some corners only; they were left out",
        ]
    );
    let mesh = &read.mesh;
    let none = NO_VALUE;
    let uv = layer(mesh, LayerKind::Uv);
    assert_eq!(uv.values, [0.5, 0.0, 0.0, 1.0, 1.0, -2.5]);
    assert_eq!(uv.corners, [0, 1, 2, none, none, none, none, none, none, 0, 1, 1, 2]);
    assert_eq!(layer(mesh, LayerKind::Normal).corners[..6], [0, 0, 0, none, none, none]);
    assert_eq!(layer(mesh, LayerKind::Color).corners[3..9], [2, 1, 3, 1, 2, 3]);
    assert_eq!(mesh.material, [0, 1, 0, 0, 0]);
    let material = parse(&mesh.appearance.materials[0]);
    assert_eq!(material["name"], "red one");
    assert_eq!(material["pbrMetallicRoughness"]["baseColorFactor"], json!([1.0, 0.0, 0.0, 1.0]));
    assert_eq!(material["extras"]["mtl"][1], "map_Kd -clamp on C:\\work\\Red Tex.PNG");
    assert_eq!(parse(&mesh.appearance.materials[1]), json!({"name": "none"}));
    assert_eq!(parse(&mesh.appearance.textures[0]), json!({"source": 0, "sampler": 0}));
    let images: Vec<_> =
        mesh.appearance.images.iter().map(|i| (i.name.as_str(), i.mime.as_str(), i.bytes.len())).collect();
    assert_eq!(images, [("C:\\work\\Red Tex.PNG", "image/png", PNG.len()), ("gone.jpg", "image/jpeg", 0)]);

    // From a stream nothing is found, and that is said.
    let stream = read_bytes(TEXTURED.as_bytes(), Format::Obj, None, &ReadOptions::default()).unwrap();
    assert!(
        texts(&stream).contains(&"1 material library not found: the materials.mtl".to_string()),
        "{:?}",
        texts(&stream)
    );
    assert_eq!(stream.mesh.appearance.materials, [r#"{"name":"red one"}"#, r#"{"name":"none"}"#]);

    // Nothing that is dropped is looked at or warned of.
    let all = ReadOptions { drop: DropSet::ALL, ..ReadOptions::default() };
    let bare = read_path(folder.path().join("mesh.obj"), &all).unwrap();
    assert_eq!((texts(&bare).len(), bare.mesh.layers.len(), bare.mesh.material.len()), (0, 0, 0));
    assert!(bare.mesh.appearance.is_empty());
    let images = ReadOptions { drop: DropSet { images: true, ..DropSet::NONE }, ..ReadOptions::default() };
    let named = read_path(folder.path().join("mesh.obj"), &images).unwrap().mesh.appearance.images;
    assert!(named.len() == 2 && named.iter().all(|i| i.bytes.is_empty() && !i.name.is_empty()));
}

#[test]
fn no_file_but_an_image_is_carried_away() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    put("secret", b"root:x:0:0");
    put("m.mtl", b"newmtl a\nmap_Kd secret\nmap_Ks m.mtl\nmap_Kd .\n");
    put("m.obj", b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n");
    let read = read_path(folder.path().join("m.obj"), &ReadOptions::default()).unwrap();
    assert!(read.mesh.appearance.images.iter().all(|i| i.bytes.is_empty()));
    assert_eq!(texts(&read), ["3 image files not found: secret, m.mtl, ."]);
    // An image larger than any is an error, without a byte of it read.
    let huge = fs::File::create(folder.path().join("huge.png")).unwrap();
    huge.set_len(3 << 30).unwrap();
    put("m.mtl", b"newmtl a\nmap_Kd huge.png\n");
    let error = read_path(folder.path().join("m.obj"), &ReadOptions::default()).unwrap_err();
    assert_eq!(
        error.kind.to_string(),
        "the image file \"huge.png\" has 3221225472 bytes, more than the 1073741824 that an image may have; check the reference or leave images out"
    );
    // And within the limit of memory.
    put("huge.png", &[PNG, &[0; 100_000]].concat());
    let limited = ReadOptions { memory_limit: Some(50_000), ..ReadOptions::default() };
    let error = read_path(folder.path().join("m.obj"), &limited).unwrap_err();
    assert!(matches!(error.kind, ReadErrorKind::Memory { .. }), "{error}");
}

#[test]
fn libraries_of_any_bytes_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let obj = folder.path().join("m.obj");
    fs::write(&obj, "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n").unwrap();
    let good = b"newmtl a\nKd 1 1 1\nd -halo 0.5\nKe 3 2 1\nPm .5\nmap_Kd -s 1 2 3 -o 1 -bm 2 a.png\nmap_d -clamp on a.png\nTr x\n\xff\xfe\\\n";
    let mut state = 7u64;
    for _ in 0..400 {
        let mut bad = good.to_vec();
        for _ in 0..3 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let at = (state >> 33) as usize % bad.len();
            bad[at] = [b' ', b'\n', b'-', b'"', b'9', 0xff, 0, b'\\'][(state >> 20) as usize % 8];
        }
        fs::write(folder.path().join("m.mtl"), &bad).unwrap();
        let read = read_path(&obj, &ReadOptions::default()).unwrap();
        read.mesh.appearance.materials.iter().for_each(|m| assert!(parse(m).is_object()));
    }
}

#[test]
fn ply_with_textures_and_types() {
    let text = "ply\nformat ascii 1.0\ncomment TextureFile a one.png\ncomment TextureFile b.png\nelement vertex 4\n\
        property float x\nproperty float y\nproperty float z\nproperty ushort green\nproperty ushort red\nproperty ushort blue\n\
        property double nx\nproperty double ny\nproperty double nz\nproperty float quality\nproperty char level\n\
        property list uchar int more\nelement face 3\nproperty list uchar float texcoord\n\
        property list uchar int vertex_indices\nproperty int texnumber\nproperty uchar red\nend_header\n\
        0 0 0 0 65535 0 0 0 1 0.5 -3 0\n1 0 0 0 0 0 0 0 1 nan 4 1 7\n0 1 0 1 2 3 0 1 0 2 5 0\n5 5 5 9 9 9 1 0 0 3 6 0\n\
        6 0 0 1 0 .5 .5 3 0 1 2 1 9\n0 3 2 1 0 0 9\n6 1 0 0 0 .5 .5 3 1 0 2 -1 9\n";
    let read = read_bytes(text.as_bytes(), Format::Ply, None, &ReadOptions::default()).unwrap();
    read.mesh.validate().unwrap();
    assert_eq!(
        texts(&read),
        [
            "2 image files not found: a one.png, b.png",
            "PLY properties of `vertex` skipped (4 records): more",
            "PLY properties of `face` skipped (3 records): red",
            "1 value of `quality` not finite and left out",
            "3 faces have values of `quality` at some corners only; they were left out",
        ]
    );
    let mesh = &read.mesh;
    assert_eq!(mesh.vertex_count(), 4);
    let uv = layer(mesh, LayerKind::Uv);
    // The third face has two of the first one's values.
    assert_eq!((uv.len(), &uv.corners[..]), (3, &[0, 1, 2, NO_VALUE, NO_VALUE, NO_VALUE, 1, 0, 2][..]));
    let color = layer(mesh, LayerKind::Color);
    assert_eq!(
        (color.stored, color.value(0), color.isolated.as_slice()),
        (Stored::U16, &[1.0, 0.0, 0.0][..], &[[3, 3]][..])
    );
    assert_eq!(color.value(2), [2.0 / 65535.0, 1.0 / 65535.0, 3.0 / 65535.0]);
    assert_eq!(layer(mesh, LayerKind::Normal).stored, Stored::F64);
    let level = mesh.layers.iter().find(|l| l.name == "level").unwrap();
    assert_eq!((level.stored, level.values.as_slice()), (Stored::I8, &[-3.0, 4.0, 5.0, 6.0][..]));
    assert_eq!(mesh.layers.iter().find(|l| l.name == "quality").unwrap().isolated, [[3, 3]]);
    assert_eq!(mesh.material, [1, 0, NO_VALUE]);
    assert_eq!(parse(&mesh.appearance.materials[1])["pbrMetallicRoughness"]["baseColorTexture"]["index"], 1);
}

fn uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

#[test]
fn gltf_with_everything() {
    let floats = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut data = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]); // 0: positions
    data.extend(floats(&[0.0, 0.0, 1.0].repeat(3))); // 36: normals
    data.extend(floats(&[1.0, 0.0, 0.0, 1.0].repeat(3))); // 72: tangents
    data.extend([0, 0, 0, 128, 255, 255, 64, 0, 0, 0, 0, 0]); // 120: uv, 16 bits, normalized
    data.extend([255, 0, 0, 0, 0, 51, 0, 0, 0, 0, 255, 0]); // 132: colours, 8 bits, four apart
    data.extend([1, 0, 2, 0, 3, 0, 0, 0]); // 144: ids
    data.extend(PNG); // 152
    let view = |offset: usize, length: usize| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    let mut strided = view(132, 12);
    strided["byteStride"] = json!(4);
    let doc = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_mesh_quantization", "KHR_materials_ior", "KHR_lights_punctual"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{"mesh": 0, "scale": [2, -1, 1]}, {"mesh": 0, "translation": [9, 0, 0]}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3, "COLOR_0": 4, "_ID": 5, "_ODD": 6}, "material": 1},
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 3}, "mode": 1, "material": 0}
        ]}],
        "materials": [{"name": "x"}, {"extensions": {"KHR_materials_ior": {"ior": 1.1}}, "extras": [1.10]}],
        "textures": [{"source": 0}], "samplers": [{"wrapS": 33071}],
        "images": [{"bufferView": 6, "mimeType": "image/png", "name": "inside"}, {"uri": "no%20such.png"}, {"uri": uri(PNG)}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC4"},
            {"bufferView": 3, "componentType": 5123, "normalized": true, "count": 3, "type": "VEC2"},
            {"bufferView": 4, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC3"},
            {"bufferView": 5, "componentType": 5123, "count": 3, "type": "SCALAR"},
            {"bufferView": 0, "componentType": 5126, "count": 1, "type": "MAT3"}
        ],
        "bufferViews": [view(0, 36), view(36, 36), view(72, 48), view(120, 12), strided, view(144, 6), view(152, PNG.len())],
        "buffers": [{"byteLength": data.len(), "uri": uri(&data)}]
    });
    let read = read_bytes(doc.to_string().as_bytes(), Format::Gltf, None, &ReadOptions::default()).unwrap();
    read.mesh.validate().unwrap();
    assert_eq!(
        texts(&read),
        [
            "further vertex attributes are not carried (3 records left out)",
            "1 image file not found: no such.png",
            "glTF extensions outside of materials and textures skipped: KHR_lights_punctual",
            "1 primitive has indices left over that make no whole element",
        ]
    );
    let mesh = &read.mesh;
    let names: Vec<_> = mesh.layers.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["uv", "normal", "tangent", "color", "ID"]);
    // Faces, edges, faces, edges; the mirrored node turns its faces, its tangents and their signs.
    assert_eq!(mesh.material, [1, 0, 1, 0]);
    let at = |kind, corner: usize| {
        let l = layer(mesh, kind);
        Some(l.corners[corner]).filter(|&i| i != NO_VALUE).map(|i| l.value(i).to_vec())
    };
    assert_eq!(at(LayerKind::Uv, 0).unwrap(), [0.0, 1.0 - 32768.0 / 65535.0]);
    assert_eq!(at(LayerKind::Uv, 4).unwrap(), [1.0, 1.0 - 64.0 / 65535.0]);
    assert_eq!(at(LayerKind::Normal, 0).unwrap(), [0.0, 0.0, 1.0]);
    assert_eq!(at(LayerKind::Normal, 3), None);
    assert_eq!(at(LayerKind::Tangent, 0).unwrap(), [1.0, 0.0, 0.0, -1.0]);
    assert_eq!(at(LayerKind::Tangent, 5).unwrap(), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(at(LayerKind::Color, 1).unwrap(), [0.0, 0.0, 1.0]);
    assert_eq!(
        (layer(mesh, LayerKind::Color).stored, layer(mesh, LayerKind::Color).value(1)),
        (Stored::U8, &[0.0, 0.2, 0.0][..])
    );
    assert_eq!((layer(mesh, LayerKind::Scalar).stored, at(LayerKind::Scalar, 5).unwrap()), (Stored::U16, vec![1.0]));
    let appearance = &mesh.appearance;
    assert_eq!(parse(&appearance.materials[1]), doc["materials"][1]);
    let images: Vec<_> =
        appearance.images.iter().map(|i| (i.name.as_str(), i.mime.as_str(), i.bytes.as_slice())).collect();
    assert_eq!(images, [("inside", "image/png", PNG), ("no such.png", "image/png", b""), ("", "image/png", PNG)]);
    let images =
        ReadOptions { drop: DropSet { images: true, tangents: true, ..DropSet::NONE }, ..ReadOptions::default() };
    let read = read_bytes(doc.to_string().as_bytes(), Format::Gltf, Some(Path::new(".")), &images).unwrap();
    assert!(read.mesh.appearance.images.iter().all(|i| i.bytes.is_empty()));
    assert!(read.mesh.layers.iter().all(|l| l.kind != LayerKind::Tangent));
}
