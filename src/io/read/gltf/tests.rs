//! Small documents, right and wrong, made here.

use base64::Engine as _;
use serde_json::{Value, json};

use super::super::{Format, Layer, ReadError, ReadErrorKind, ReadMesh, ReadOptions, Warning, read_bytes, read_path};

fn apart() -> ReadOptions {
    ReadOptions { weld: Some(false), ..ReadOptions::default() }
}

fn uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

fn read(doc: &Value, options: &ReadOptions) -> Result<ReadMesh, ReadError> {
    read_bytes(doc.to_string().as_bytes(), Format::Gltf, None, options)
}

fn gltf(doc: &Value) -> ReadMesh {
    read(doc, &apart()).unwrap()
}

fn error(doc: &Value) -> String {
    read(doc, &apart()).unwrap_err().to_string()
}

fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
    m.mesh.faces().map(<[u32]>::to_vec).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

const SQUARE: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0];

/// A square of four vertices (48 bytes) and then the given 16-bit indices.
fn square(indices: &[u16], mode: u64) -> Value {
    let mut data = floats(&SQUARE);
    data.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": indices.len(), "type": "SCALAR"}
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 2 * indices.len()}
        ],
        "buffers": [{"byteLength": data.len(), "uri": uri(&data)}]
    })
}

#[test]
fn every_mode() {
    let of = |mode, indices: &[u16]| faces(&gltf(&square(indices, mode)));
    assert_eq!(of(0, &[0, 1, 2]), Vec::<Vec<u32>>::new());
    assert_eq!(of(1, &[0, 1, 2, 3]), [[0, 1], [2, 3]]);
    assert_eq!(of(2, &[0, 1, 2]), [[0, 1], [1, 2], [2, 0]]);
    assert_eq!(of(3, &[0, 1, 2]), [[0, 1], [1, 2]]);
    assert_eq!(of(4, &[0, 1, 2, 0, 2, 3]), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(of(5, &[0, 1, 2, 3]), [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(of(6, &[0, 1, 2, 3]), [[1, 2, 0], [2, 3, 0]]);
    let strip = gltf(&square(&[0, 1, 2, 2, 3, 3, 0], 5));
    assert_eq!(strip.warnings, [Warning::StripConnectors { count: 4 }]);
    assert_eq!(faces(&strip), [[0, 1, 2]]);
    assert_eq!(gltf(&square(&[0, 1, 2, 3], 4)).warnings, [Warning::IncompletePrimitives { count: 1 }]);
    assert_eq!(gltf(&square(&[1, 1], 1)).warnings, [Warning::PointEdges { count: 1 }]);
}

#[test]
fn without_indices_and_welded() {
    let mut doc = square(&[], 5);
    doc["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    assert_eq!(faces(&gltf(&doc)), [[0, 1, 2], [1, 3, 2]]);
    // Two nodes at one place: apart when asked, one by default.
    doc["scenes"][0]["nodes"] = json!([0, 1]);
    doc["nodes"] = json!([{"mesh": 0}, {"mesh": 0}]);
    assert_eq!((gltf(&doc).mesh.vertex_count(), gltf(&doc).mesh.face_count()), (8, 4));
    let welded = read(&doc, &ReadOptions::default()).unwrap();
    assert_eq!((welded.mesh.vertex_count(), welded.mesh.face_count()), (4, 4));
    assert_eq!(welded.map, [0, 1, 2, 3, 0, 1, 2, 3]);
}

#[test]
fn nodes_place_meshes_and_mirrors_turn_faces() {
    let mut doc = square(&[0, 1, 2], 4);
    let quarter = std::f64::consts::FRAC_1_SQRT_2;
    doc["nodes"] = json!([
        {"translation": [100000.5, 0, 0], "scale": [2, 2, 2], "children": [1, 2]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 3, 1]},
        {"mesh": 0, "rotation": [0, 0, quarter, quarter]}
    ]);
    let m = gltf(&doc);
    assert_eq!(m.mesh.positions[..3], [[100000.5, 0.0, 6.0], [100002.5, 0.0, 6.0], [100002.5, 2.0, 6.0]]);
    let turned = m.mesh.positions[5];
    assert!((turned[0] - 100000.5).abs() < 1e-9 && (turned[1] - 2.0).abs() < 1e-9, "{turned:?}");
    assert_eq!(faces(&m), [[0, 2, 1], [4, 5, 6]]);
}

#[test]
fn scenes_choose() {
    let mut doc = square(&[0, 1, 2], 4);
    doc["meshes"].as_array_mut().unwrap().push(json!({"primitives": []}));
    doc["scenes"] = json!([{}, {"nodes": [0]}]);
    let nothing = read(&doc, &ReadOptions { allow_empty: true, ..apart() }).unwrap();
    assert_eq!(nothing.warnings, [Warning::UnusedMeshes { count: 2 }]);
    doc["scene"] = json!(1);
    assert_eq!(gltf(&doc).mesh.face_count(), 1);
    doc.as_object_mut().unwrap().remove("scenes");
    doc.as_object_mut().unwrap().remove("scene");
    assert_eq!(gltf(&doc).mesh.face_count(), 1);
    doc.as_object_mut().unwrap().remove("nodes");
    assert_eq!(gltf(&doc).mesh.face_count(), 1);
    assert!(error(&json!({"asset": {"version": "2.0"}})).starts_with("input: there is no vertex in it"));
}

#[test]
fn primitives_share_positions() {
    let mut doc = square(&[0, 1, 2, 3], 3);
    let primitives = doc["meshes"][0]["primitives"].as_array_mut().unwrap();
    primitives.push(json!({"attributes": {"POSITION": 0, "NORMAL": 0}, "mode": 0, "material": 3}));
    let m = gltf(&doc);
    assert_eq!((m.mesh.vertex_count(), m.mesh.face_count()), (4, 3));
    let dropped = |layer, count| Warning::NotCarried { layer, count };
    // All vertices have edges, and those have no normals.
    let expected = [dropped(Layer::Normals, 4), dropped(Layer::Materials, 1)];
    assert_eq!(m.warnings, expected);
}

#[test]
fn quantized_sparse_and_strided() {
    // Normalized signed bytes, four apart; the third vertex replaced through `sparse`.
    let mut data: Vec<u8> = vec![0, 0, 0, 99, 127, 0, 0, 99, 0, 127, 129, 99];
    data.extend([2, 0]);
    data.extend([0, 0, 128, 0]);
    let mut doc = json!({
        "asset": {"version": "2.0"},
        "extensionsRequired": ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_unlit"],
        "nodes": [{"mesh": 0, "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5120, "normalized": true, "count": 3, "type": "VEC3"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12, "byteStride": 4},
            {"buffer": 0, "byteOffset": 12, "byteLength": 2},
            {"buffer": 0, "byteOffset": 14, "byteLength": 4}
        ],
        "buffers": [{"byteLength": data.len(), "uri": uri(&data)}]
    });
    let m = gltf(&doc);
    assert_eq!(m.mesh.positions, [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, -2.0]]);
    assert_eq!(faces(&m), [[0, 1, 2]]);
    doc["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": {"bufferView": 1, "componentType": 5123},
        "values": {"bufferView": 2}
    });
    assert_eq!(gltf(&doc).mesh.positions[2], [0.0, 0.0, -2.0]);
    doc["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(gltf(&doc).mesh.positions, [[0.0; 3], [0.0; 3], [0.0, 0.0, -2.0]]);
    doc["accessors"][0]["normalized"] = json!(false);
    assert_eq!(gltf(&doc).mesh.positions[2], [0.0, 0.0, -256.0]);
}

#[test]
fn gpu_instances_are_copies() {
    let mut doc = square(&[0, 1, 2], 4);
    let moves = floats(&[0.0, 0.0, 5.0, 0.0, 0.0, 6.0]);
    doc["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    doc["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 24, "uri": uri(&moves)}));
    doc["bufferViews"].as_array_mut().unwrap().push(json!({"buffer": 1, "byteLength": 24}));
    let moves = json!({"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"});
    doc["accessors"].as_array_mut().unwrap().push(moves);
    doc["nodes"][0] = json!({
        "mesh": 0,
        "translation": [1, 0, 0],
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}
    });
    let m = gltf(&doc);
    assert_eq!((m.mesh.positions[1], m.mesh.positions[5]), ([2.0, 0.0, 5.0], [2.0, 0.0, 6.0]));
    assert_eq!(faces(&m), [[0, 1, 2], [4, 5, 6]]);
}

fn glb(doc: &Value, data: &[u8]) -> Vec<u8> {
    let mut text = doc.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + text.len() as u32 + data.len() as u32).to_le_bytes());
    for (kind, bytes) in [(b"JSON", text.as_slice()), (b"BIN\0", data)] {
        out.extend((bytes.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(bytes);
    }
    out
}

#[test]
fn binary_container_and_files_beside() {
    let mut doc = square(&[0, 1, 2, 3], 6);
    let mut data = floats(&SQUARE);
    data.extend([0, 0, 1, 0, 2, 0, 3, 0]);
    let expected = gltf(&doc);
    doc["buffers"][0].as_object_mut().unwrap().remove("uri");
    let file = glb(&doc, &data);
    assert_eq!(read_bytes(&file, Format::Glb, None, &apart()).unwrap(), expected);
    let fail = |bytes: &[u8]| read_bytes(bytes, Format::Glb, None, &apart()).unwrap_err().to_string();
    assert_eq!(
        fail(&file[..file.len() - 1]),
        format!(
            "input, byte {}: the file ends inside the GLB (1 byte missing); it was cut, fetch it again",
            file.len() - 1
        )
    );
    assert_eq!(
        fail(b"glTF\x01\0\0\0\x0c\0\0\0"),
        "input, byte 4: GLB version 1 is not supported; convert the file to glTF 2.0"
    );
    assert_eq!(
        fail(b"PK\x03\x04"),
        "input: this is not a glTF or GLB file: \"PK\\x03\\x04\" stands where `{` or `glTF` belongs; check the file or name its true format"
    );

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    doc["buffers"][0]["uri"] = json!("the%20data.bin");
    std::fs::write(&path, doc.to_string()).unwrap();
    let fail = || read_path(&path, &apart()).unwrap_err().kind.to_string();
    assert_eq!(fail(), "the buffer file \"the%20data.bin\" is missing or no regular file; copy it beside the document");
    std::fs::write(folder.path().join("the data.bin"), &data[..9]).unwrap();
    assert_eq!(fail(), "the buffer file \"the%20data.bin\" is too short (9 of 56 bytes); it was cut, fetch it again");
    std::fs::write(folder.path().join("the data.bin"), &data).unwrap();
    assert_eq!(read_path(&path, &apart()).unwrap(), expected);
    // By their last name, as images: what programs write as paths of the machines they ran on.
    for other in ["../the%20data.bin", "C:\\scans\\the data.bin", "/home/me/THE%20DATA.bin"] {
        doc["buffers"][0]["uri"] = json!(other);
        std::fs::write(&path, doc.to_string()).unwrap();
        assert_eq!(read_path(&path, &apart()).unwrap(), expected, "{other}");
    }
    for outside in ["../x.bin", "/etc/passwd", "file:///etc/passwd", "%2e%2e/x", "https://a.example/x.bin"] {
        doc["buffers"][0]["uri"] = json!(outside);
        std::fs::write(&path, doc.to_string()).unwrap();
        assert!(fail().contains("does not lie in the folder of the document"), "{outside}: {}", fail());
    }
    doc["buffers"][0]["uri"] = json!("the.bin");
    assert!(error(&doc).contains("whose folder is not known"));
}

#[test]
fn errors_say_where_what_and_what_to_do() {
    let good = square(&[0, 1, 2], 4);
    let with = |pointer: &str, value: Value| {
        let mut doc = good.clone();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match doc.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => doc.pointer_mut(parent).unwrap()[key] = value,
        }
        error(&doc)
    };
    assert_eq!(
        with("/extensionsRequired", json!(["KHR_mesh_compression_of_tomorrow"])),
        "input: the file requires the glTF extension KHR_mesh_compression_of_tomorrow, which is not supported; export it without that extension, or try to unpack it with `gltf-transform copy IN.glb OUT.glb`"
    );
    assert_eq!(
        with("/asset/version", json!("1.0")),
        "input: glTF version \"1.0\" is not supported; convert the file to glTF 2.0"
    );
    assert_eq!(
        error(&square(&[0, 1, 4], 4)),
        "input, accessors[1]: a primitive names vertex 4, but the file has 4 vertices, numbered from 0; mend the index or add the vertex"
    );
    assert_eq!(
        with("/accessors/0/count", json!(5)),
        "input, accessors[0]: 5 items of 12 bytes are announced, but the 48 bytes that follow cannot hold them; the count is wrong or the file was cut"
    );
    assert_eq!(
        with("/accessors/0/count", json!(u64::MAX)),
        "input, accessors[0]: 18446744073709551615 items of 12 bytes are announced, but the 48 bytes that follow cannot hold them; the count is wrong or the file was cut"
    );
    assert_eq!(
        with("/accessors/0", json!({"componentType": 5126, "count": 1u64 << 40, "type": "VEC3"})),
        format!(
            "input, accessors[0]: 1099511627776 items without data are announced, but the {} bytes that follow cannot hold them; the count is wrong or the file was cut",
            {
                let mut doc = good.clone();
                doc["accessors"][0] = json!({"componentType": 5126, "count": 1u64 << 40, "type": "VEC3"});
                doc.to_string().len()
            }
        )
    );
    assert_eq!(
        with("/accessors/0/type", json!("VEC2")),
        "input, accessors[0]: the type is VEC2, but VEC3 is needed here; mend the document"
    );
    assert_eq!(
        with("/accessors/1/componentType", json!(5122)),
        "input, accessors[1]: indices are not unsigned whole numbers; mend the document"
    );
    assert_eq!(
        with("/bufferViews/0/byteLength", json!(100)),
        "input, bufferViews[0]: it ends at byte 100 of a buffer of 54 bytes; mend the document"
    );
    assert_eq!(
        with("/buffers/0/byteLength", json!(60)),
        "input, buffers[0]: the file ends inside the buffer (6 bytes missing); it was cut, fetch it again"
    );
    assert_eq!(
        with("/nodes/0", json!({"mesh": 7})),
        "input, nodes[0]: meshes[7] is named, but there are 1; mend the document"
    );
    assert_eq!(
        with("/nodes", json!([{"children": [0]}])),
        "input, nodes[0]: the node hangs on two others or on itself; mend the document"
    );
    assert_eq!(
        with("/meshes/0/primitives/0/mode", json!(7)),
        "input, meshes[0].primitives[0]: 7 is not a mode of primitives; mend the document"
    );
    let nan = uri(&floats(&[0.0, f32::NAN]).repeat(7));
    assert_eq!(
        with("/buffers/0/uri", json!(nan)),
        "input, accessors[0]: vertex 0 (counted from 0) has a coordinate that is not a finite number (NaN); mend or remove the vertex, or drop all such (--invalid drop)"
    );
    let text = good.to_string();
    let cut = read_bytes(&text.as_bytes()[..99], Format::Gltf, None, &apart()).unwrap_err();
    assert!(matches!(cut.kind, ReadErrorKind::Truncated { .. }), "{cut}");
}

#[test]
fn instances_cannot_multiply_past_the_limit() {
    let mut doc = square(&[0, 1, 2, 3], 6);
    doc["nodes"] = (0..2000).map(|_| json!({"mesh": 0})).collect();
    doc["scenes"][0]["nodes"] = (0..2000).collect();
    let limited = ReadOptions { weld: Some(false), memory_limit: Some(250_000), ..Default::default() };
    let kind = read(&doc, &limited).unwrap_err().kind;
    assert!(matches!(kind, ReadErrorKind::Memory { limit: Some(250_000), .. }), "{kind}");
    assert_eq!(gltf(&doc).mesh.vertex_count(), 8000);
}

#[test]
fn what_a_file_says_stays_on_one_line() {
    let mut doc = square(&[0, 1, 2], 4);
    doc["accessors"][0]["type"] = json!("VEC\n\u{1b}[2J");
    assert_eq!(error(&doc).lines().count(), 1);
    doc["extensionsRequired"] = json!(["a\nb"]);
    assert_eq!(
        error(&doc),
        "input: the file requires the glTF extension a\\nb, which is not supported; export it without that extension, or try to unpack it with `gltf-transform copy IN.glb OUT.glb`"
    );
}

#[test]
fn triangles_with_indices_side_by_side_keep_their_attributes() {
    let mut doc = square(&[0, 1, 2, 0, 2, 3], 4);
    doc["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(0);
    let read = gltf(&doc);
    assert_eq!(faces(&read), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(read.mesh.layers.len(), 1);
    assert_eq!(read.mesh.layers[0].corners, [0, 1, 2, 0, 2, 3]);
}
