//! Vertices without a place, files of other kinds, packed files, headers that are made to take long.

use lodestream::io::read::{Format, Invalid, ReadErrorKind, ReadMesh, ReadOptions, read_bytes, read_path};
use lodestream::mesh::{LayerKind, NO_VALUE};

use super::{at_vertex, case, case_path, faces, read, read_file, warnings};
use crate::common::{Scratch, lodestream};

fn dropping(bytes: &[u8], format: Format, weld: Option<bool>) -> ReadMesh {
    let options = ReadOptions { invalid: Invalid::Drop, weld, ..ReadOptions::default() };
    read_bytes(bytes, format, None, &options).unwrap()
}

/// A grid of 4 × 4 points as a depth camera writes it, points without a measure as NaN.
const SCAN: &str = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv nan nan nan 0 0 0\nv 0 1 0 0 0 1\nv 1 1 0 1 1 0\nv inf 1 0 0 0 0\nv 2 2 2 1 1 1\n\
    vt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 5/3\nusemtl b\nf 2/1 3/2 5/3\nusemtl c\nf 1/3 5/2 4/1\nl 5 6\n";

#[test]
fn vertices_without_a_place_are_dropped_where_that_is_asked_for() {
    let error = read(SCAN, Format::Obj).unwrap_err();
    assert!(matches!(error.kind, ReadErrorKind::NotFinite { vertex: 2, .. }), "{error}");
    for weld in [Some(false), Some(true)] {
        let m = dropping(SCAN.as_bytes(), Format::Obj, weld);
        m.mesh.validate().unwrap();
        assert_eq!(m.mesh.vertex_count(), 5);
        assert_eq!(m.map, [0, 1, NO_VALUE, 2, 3, NO_VALUE, 4]);
        assert_eq!(faces(&m), [[0, 1, 3], [0, 3, 2]]);
        assert_eq!(m.mesh.material, [0, 2]);
        assert_eq!(at_vertex(&m, LayerKind::Color, 2), [0.0, 0.0, 1.0]);
        assert_eq!(at_vertex(&m, LayerKind::Uv, 3), [1.0, 1.0]);
        let said = warnings(&m);
        let wanted = "2 vertices without a finite place left out, with 2 faces and edges that use them";
        assert!(said.iter().any(|w| w == wanted), "{said:?}");
    }
}

#[test]
fn every_format_drops() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 nan\n0 1 0\n1 1 0\n3 0 1 2\n3 0 3 2\n";
    let off = "OFF\n4 2 0\n0 0 0\n1 0 -nan\n0 1 0\n1 1 0\n3 0 1 2\n3 0 3 2\n";
    let stl = "solid\nfacet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 nan vertex 0 1 0 endloop endfacet\n\
        facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 1 0 vertex 0 1 0 endloop endfacet\nendsolid\n";
    for (text, format) in [(ply, Format::Ply), (off, Format::Off), (stl, Format::Stl)] {
        let m = dropping(text.as_bytes(), format, None);
        m.mesh.validate().unwrap();
        assert_eq!((m.mesh.vertex_count(), m.mesh.face_count(), m.warnings.len()), (3, 1, 1), "{format:?}");
    }
    let all = dropping(b"v 0 0 0\nv nan 0 0\n", Format::Obj, None);
    assert_eq!((all.mesh.vertex_count(), all.mesh.face_count()), (1, 0));
    let options = ReadOptions { invalid: Invalid::Drop, ..ReadOptions::default() };
    assert_eq!(read_bytes(b"v nan 0 0\n", Format::Obj, None, &options).unwrap_err().kind, ReadErrorKind::Empty);
}

#[test]
fn the_program_drops_and_verifies() {
    let s = Scratch::new("invalid");
    s.write("scan.obj", SCAN);
    let run = lodestream(s.folder(), "encode scan.obj -o scan.lods --map scan.map --invalid drop").ok();
    assert!(run.stderr.contains("2 vertices without a finite place left out"), "{}", run.stderr);
    assert_eq!(std::fs::read_to_string(s.path("scan.map")).unwrap().lines().filter(|l| *l == "-").count(), 2);
    lodestream(s.folder(), "verify scan.lods --against scan.obj --map scan.map").ok();
    lodestream(s.folder(), "verify scan.lods --against scan.obj").ok();
    assert_eq!(lodestream(s.folder(), "ingest scan.obj -o out").code, 3);
    lodestream(s.folder(), "ingest scan.obj -o out --invalid drop --verify").ok();
}

#[test]
fn foreign_files_are_called_by_their_names() {
    for (name, what) in [
        ("a.las", "stands for a LAS point cloud, which has no faces; make a mesh of it"),
        ("a.LAZ", "stands for a LAS point cloud"),
        ("a.e57", "an E57 point cloud"),
        ("a.pcd", "a PCL point cloud"),
        ("a.xyz", "a list of points, which has no faces"),
        ("a.pts", "a list of points"),
        ("a.fbx", "an FBX scene; export it as .glb"),
        ("a.dae", "a COLLADA scene; export it as .glb"),
        ("a.3mf", "a 3MF model; export it as .stl"),
        ("a.usdz", "a USD scene"),
        ("a.wrl", "a VRML or X3D scene"),
        ("a.step", "a CAD model"),
        ("a.b3dm", "a tile of 3D Tiles; take out the mesh"),
        ("a.zip", "an archive; unpack it and name the mesh inside"),
        ("a.7z", "an archive"),
        ("a.rar", "an archive"),
        ("a.tar.gz", "the extension .tar stands for an archive"),
        ("a.obj.bz2", "a packed file; unpack it first"),
    ] {
        let s = Scratch::new(&format!("foreign-{name}"));
        let error = read_path(s.write(name, "x"), &ReadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
        assert!(!error.contains("Rename"), "{error}");
    }
}

#[test]
fn zstandard_and_xz_are_unpacked() {
    for name in ["triangle.obj.zst", "triangle.obj.xz"] {
        let m = read_file(&case_path("packed").join(name));
        assert_eq!((faces(&m), warnings(&m)), (vec![vec![0, 1, 2]], Vec::new()), "{name}");
        let bytes = case(&format!("packed/{name}"));
        assert_eq!(read(&bytes, Format::Obj).unwrap().mesh.face_count(), 1);
        for cut in 10..bytes.len() - 1 {
            assert!(read(&bytes[..cut], Format::Obj).is_err(), "{name} cut to {cut}");
        }
        let s = Scratch::new(&format!("packed-{name}"));
        s.write(name, &bytes);
        lodestream(s.folder(), &format!("ingest {name} -o out --verify")).ok();
        assert!(s.path("out/triangle.lods").exists());
        let wrong = read_path(s.write(&format!("wrong{name}"), "v 0 0 0\n"), &ReadOptions::default()).unwrap_err();
        assert!(matches!(wrong.kind, ReadErrorKind::WrongMagic { .. }), "{wrong}");
    }
}

#[test]
fn long_headers_take_no_longer_than_they_are() {
    let elements: String = (0..100_000).map(|k| format!("element e{k} 0\nproperty int a\n")).collect();
    let body = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let m = read(format!("ply\nformat ascii 1.0\n{elements}{body}"), Format::Ply).unwrap();
    assert_eq!(faces(&m), [[0, 1, 2]]);
    let properties: String = (0..20_000).map(|k| format!("property float a{k}_red\n")).collect();
    let numbers = "0 ".repeat(20_000);
    let text = format!(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n{properties}end_header\n0 0 0 {numbers}\n"
    );
    let m = read(text, Format::Ply).unwrap();
    assert_eq!((m.mesh.vertex_count(), m.mesh.layers.len()), (1, 32));
    assert!(warnings(&m)[0].len() < 400, "{}", warnings(&m)[0]);
    let twice = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement vertex 1\nend_header\n";
    assert!(read(twice, Format::Ply).unwrap_err().to_string().contains("the element `vertex` is announced twice"));
}

#[test]
fn bombs_meet_a_limit_that_nobody_has_set() {
    // A thousand million copies of a triangle, by an accessor without data.
    let doc = serde_json::json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 0,
        "nodes": [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}}],
        "meshes": [{"primitives": (0..200).map(|_| serde_json::json!({"attributes": {"POSITION": 0}})).collect::<Vec<_>>()}],
        "accessors": [
            {"componentType": 5126, "count": 60_000, "type": "VEC3"}, {"componentType": 5126, "count": 60_000, "type": "VEC3"}
        ],
        "extras": "x".repeat(60_000)
    });
    let error = read(doc.to_string(), Format::Gltf).unwrap_err();
    let bounded = matches!(error.kind, ReadErrorKind::Memory { limit: Some(_), .. } | ReadErrorKind::TooLarge { .. });
    assert!(bounded, "{error}");
}
