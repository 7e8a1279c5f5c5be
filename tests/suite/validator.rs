//! What is written as GLB, held against the Khronos validator (`scripts/validate-gltf`), where node and its package are there.
#![cfg(feature = "formats")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::datasets;
use lodestream::io::write::{WriteOptions, write_path};
use lodestream::mesh::{Image, Layer, LayerKind, Mesh, NO_VALUE, Stored};

/// One white pixel.
const WHITE: [u8; 69] = [
    137, 80, 78, 71, 13, 10, 26, 10, 0, 0, 0, 13, 73, 72, 68, 82, 0, 0, 0, 1, 0, 0, 0, 1, 8, 2, 0, 0, 0, 144, 119, 83,
    222, 0, 0, 0, 12, 73, 68, 65, 84, 120, 156, 99, 248, 255, 255, 63, 0, 5, 254, 2, 254, 13, 239, 70, 184, 0, 0, 0, 0,
    73, 69, 78, 68, 174, 66, 96, 130,
];

/// Every kind of element and layer: seams, faces without values, edges, isolated vertices.
fn sample() -> Mesh {
    let mut mesh =
        Mesh { positions: (0..9).map(|i| [f64::from(i % 3), f64::from(i / 3), 0.25]).collect(), ..Mesh::default() };
    for face in [&[0, 1, 4, 3][..], &[1, 2, 5, 4], &[3, 4, 7], &[0, 5]] {
        mesh.push_face(face);
    }
    let n = mesh.vertex_count();
    let mut add = |name: &str, kind, stored, value: &[f64]| {
        let values: Vec<f64> = (0..n).flat_map(|_| value.iter().copied()).collect();
        mesh.layers.push(Layer::per_vertex(name, kind, value.len() as u8, stored, values, &mesh.corners, n));
    };
    add("uv", LayerKind::Uv, Stored::F32, &[0.25, 0.5]);
    add("uv1", LayerKind::Uv, Stored::F32, &[0.5, 2.5]);
    add("normal", LayerKind::Normal, Stored::F32, &[0.3, 0.0, 5.0]);
    add("tangent", LayerKind::Tangent, Stored::F32, &[3.0, 0.0, 0.0, -0.5]);
    add("color", LayerKind::Color, Stored::U8, &[0.2, 0.4, 0.6]);
    add("color1", LayerKind::Color, Stored::U16, &[0.2, 0.4, 0.6, 1.0]);
    add("quality", LayerKind::Scalar, Stored::U32, &[70_000.0]);
    add("level", LayerKind::Scalar, Stored::I8, &[-3.0, 4.0]);
    // Faces without some of them.
    mesh.layers[0].corners[..4].fill(NO_VALUE);
    mesh.layers[2].corners[4..8].fill(NO_VALUE);
    mesh.material = vec![0, 1, NO_VALUE, 0];
    mesh.appearance.materials = vec![
        r#"{"name":"a","emissiveTexture":{"index":0,"texCoord":1},"extensions":{"KHR_materials_unlit":{}}}"#.into(),
        r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":{"scale":[2,2]}}}}}"#.into(),
    ];
    mesh.appearance.textures = vec![r#"{"source":0,"sampler":0}"#.into()];
    mesh.appearance.samplers = vec![r#"{"wrapS":33071}"#.into()];
    mesh.appearance.images =
        vec![Image { name: "white".into(), mime: "image/png".into(), bytes: WHITE.to_vec(), previews: Vec::new() }];
    mesh
}

#[test]
fn the_validator_of_khronos_finds_no_errors() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("glb");
    fs::create_dir_all(&folder).unwrap();
    let mut files: Vec<PathBuf> = Vec::new();
    let mut write = |name: &str, mesh: &Mesh| {
        let path = folder.join(name.replace(['/', '.'], "_")).with_extension("glb");
        write_path(&path, mesh, None, &WriteOptions::default()).unwrap();
        files.push(path);
    };
    write("sample", &sample());
    let wanted = ["textured/", "colour/", "bad/T", "polygon/pirate"];
    for dataset in datasets::available(|d| !d.large && wanted.iter().any(|w| d.name.starts_with(w))) {
        write(&dataset.name, &dataset.load(None).unwrap());
    }
    let run = Command::new(datasets::root().join("scripts/validate-gltf")).args(&files).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    print!("{out}");
    if err.contains("skipped:") {
        eprintln!("skipped: the_validator_of_khronos_finds_no_errors: {}", err.trim());
    }
    assert!(run.status.success(), "{out}{err}");
}
