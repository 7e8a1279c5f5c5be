//! What is written reads back; what cannot be written says so and leaves nothing behind.

use std::fs;
use std::io;

use proptest::prelude::*;

use super::*;
use crate::io::read::{ReadMesh, ReadOptions, read_bytes, read_path};

/// A polygon soup: anything a mesh may be, edges with two ends.
fn soup(coordinate: impl Strategy<Value = f64> + Clone) -> impl Strategy<Value = Mesh> {
    let position = [coordinate.clone(), coordinate.clone(), coordinate];
    (1usize..24).prop_flat_map(move |n| {
        let face = prop::collection::vec(0..n as u32, 2..7).prop_filter("an edge", |f| f.len() > 2 || f[0] != f[1]);
        let faces = prop::collection::vec(face, 0..30);
        (prop::collection::vec(position.clone(), n), faces).prop_map(|(positions, faces)| {
            let mut mesh = Mesh { positions, ..Default::default() };
            faces.iter().for_each(|f| mesh.push_face(f));
            mesh
        })
    })
}

/// Small numbers, large ones, awkward ones.
fn coordinate() -> impl Strategy<Value = f64> + Clone {
    prop_oneof![-1.0..1.0, -1e7..1e7, (-50i32..50).prop_map(f64::from), -1e-30..1e-30, Just(-0.0), Just(1e300)]
}

fn lattice() -> impl Strategy<Value = (Lattice, i32)> {
    let origin = [-1e7..1e7f64, -1e6..1e6f64, -1.0..1.0f64];
    (origin, -12i32..4, 1.0..10.0f64, 1u32..22)
        .prop_map(|(origin, power, digits, bits)| (Lattice { origin, step: digits * 10f64.powi(power) }, 1 << bits))
}

/// A lattice fit for `f64`: its step is not lost beside its origin.
fn on_lattice() -> impl Strategy<Value = (Lattice, Mesh)> {
    lattice()
        .prop_filter("a step that f64 resolves", |(l, _)| l.step > 1e-8)
        .prop_flat_map(|(l, side)| (Just(l), soup((0..side).prop_map(f64::from))))
        .prop_map(|(l, mut mesh)| {
            mesh.positions.iter_mut().for_each(|p| *p = l.point(p.map(|x| x as i32)));
            (l, mesh)
        })
}

fn bytes(mesh: &Mesh, format: Format, lattice: Option<&Lattice>) -> (Vec<u8>, Vec<WriteWarning>) {
    let mut out = Vec::new();
    let warnings = write_to(&mut out, format, mesh, lattice).unwrap();
    (out, warnings)
}

fn back(bytes: &[u8], format: Format, weld: Option<bool>) -> ReadMesh {
    read_bytes(bytes, format, None, &ReadOptions { weld, allow_empty: true, ..Default::default() }).unwrap()
}

/// The mesh with its edges behind its faces.
fn edges_last(mesh: &Mesh) -> Mesh {
    let mut out = Mesh { positions: mesh.positions.clone(), ..Default::default() };
    mesh.faces().filter(|f| f.len() > 2).for_each(|f| out.push_face(f));
    mesh.faces().filter(|f| f.len() == 2).for_each(|f| out.push_face(f));
    out
}

/// The mesh with its polygons as fans and its edges behind them.
fn fans(mesh: &Mesh) -> Mesh {
    let mut out = Mesh { positions: mesh.positions.clone(), ..Default::default() };
    triangles(mesh).for_each(|t| out.push_face(&t));
    mesh.faces().filter(|f| f.len() == 2).for_each(|f| out.push_face(f));
    out
}

proptest! {
    #[test]
    fn obj_and_ply_keep_every_bit(mesh in soup(coordinate())) {
        let (obj, warnings) = bytes(&mesh, Format::Obj, None);
        prop_assert!(warnings.is_empty());
        let read = back(&obj, Format::Obj, None);
        prop_assert_eq!(&read.mesh, &mesh);
        prop_assert!(read.warnings.is_empty());
        let (ply, warnings) = bytes(&mesh, Format::Ply, None);
        prop_assert!(warnings.is_empty());
        let read = back(&ply, Format::Ply, None);
        prop_assert_eq!(read.mesh, edges_last(&mesh));
        prop_assert!(read.warnings.is_empty());
    }

    #[test]
    fn lattice_points_come_back((lattice, mesh) in on_lattice()) {
        let q = lattice.quantize(&mesh.positions).unwrap();
        for (format, expected) in [
            (Format::Obj, mesh.clone()), (Format::Ply, edges_last(&mesh)), (Format::Glb, fans(&mesh))
        ] {
            let (file, warnings) = bytes(&mesh, format, Some(&lattice));
            let read = back(&file, format, Some(false));
            prop_assert_eq!(lattice.quantize(&read.mesh.positions).unwrap(), q.clone(), "{:?}", format);
            prop_assert_eq!(&read.mesh.corners, &expected.corners);
            prop_assert_eq!(&read.mesh.face_start, &expected.face_start);
            let rounded = warnings.iter().any(|w| matches!(w, WriteWarning::Rounded { .. }));
            prop_assert!(!rounded);
        }
    }

    #[test]
    fn stl_keeps_the_triangles(mesh in soup((-1000i32..1000).prop_map(f64::from))) {
        let (file, warnings) = bytes(&mesh, Format::Stl, None);
        let read = back(&file, Format::Stl, None);
        let corners = |m: &Mesh| triangles(m).map(|t| t.map(|v| m.positions[v as usize])).collect::<Vec<_>>();
        prop_assert_eq!(corners(&read.mesh), corners(&mesh));
        let census = Census::of(&mesh);
        let warned = |w: WriteWarning| warnings.contains(&w);
        prop_assert_eq!(census.edges > 0, warned(WriteWarning::EdgesLeftOut { count: census.edges }));
        let count = census.isolated.len() as u64;
        prop_assert_eq!(count > 0, warned(WriteWarning::PointsLeftOut { count }));
        prop_assert_eq!(census.polygons > 0, warned(WriteWarning::Triangulated { polygons: census.polygons }));
        // From one format into the next: nothing more is lost.
        let (again, _) = bytes(&read.mesh, Format::Stl, None);
        prop_assert_eq!(back(&again, Format::Stl, None).mesh, read.mesh.clone());
        let (glb, _) = bytes(&read.mesh, Format::Glb, None);
        prop_assert_eq!(back(&glb, Format::Glb, None).mesh, read.mesh);
    }
}

#[test]
fn ply_is_as_wide_as_the_lattice_needs() {
    let mesh = |x: f64| Mesh { positions: vec![[x, 0.5, 0.25]], ..Default::default() };
    let header = |m: &Mesh, l| String::from_utf8_lossy(&bytes(m, Format::Ply, l).0).into_owned();
    assert!(header(&mesh(0.5), None).contains("float x"));
    assert!(header(&mesh(0.1), None).contains("double x"));
    let lattice = Lattice { origin: [0.0; 3], step: 0.001 };
    assert!(header(&mesh(0.1), Some(&lattice)).contains("float x"));
    assert!(header(&mesh(512_345.678), Some(&lattice)).contains("double x"));
}

#[test]
fn ply_lists_of_more_than_a_byte() {
    let mut mesh = Mesh { positions: vec![[0.0; 3]; 300], ..Default::default() };
    mesh.push_face(&(0..300).collect::<Vec<_>>());
    assert_eq!(back(&bytes(&mesh, Format::Ply, None).0, Format::Ply, None).mesh, mesh);
}

/// The JSON of a GLB.
fn document(glb: &[u8]) -> serde_json::Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    assert_eq!(glb.len(), u32::from_le_bytes(glb[8..12].try_into().unwrap()) as usize);
    assert_eq!(glb.len() % 4, 0);
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

#[test]
fn glb_puts_large_coordinates_into_the_node() {
    let mut mesh = Mesh {
        positions: vec![
            [512_345.678, 5_412_345.001, 312.4],
            [512_346.0, 5_412_345.5, 312.5],
            [512_345.0, 5_412_346.0, 312.0],
        ],
        ..Default::default()
    };
    mesh.push_face(&[0, 1, 2]);
    let lattice = Lattice { origin: [512_000.0, 5_412_000.0, 0.0], step: 0.001 };
    let (file, warnings) = bytes(&mesh, Format::Glb, Some(&lattice));
    assert!(warnings.is_empty());
    let doc = document(&file);
    assert!(doc["nodes"][0]["translation"][0].as_f64().unwrap() > 512_000.0);
    assert!(doc["accessors"][0]["max"][1].as_f64().unwrap() < 1.0);
    let read = back(&file, Format::Glb, None).mesh;
    assert_eq!(lattice.quantize(&read.positions).unwrap(), lattice.quantize(&mesh.positions).unwrap());
    // Small ones stay where they are.
    mesh.positions = vec![[0.1, 0.2, 0.3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert!(document(&bytes(&mesh, Format::Glb, None).0)["nodes"][0].get("translation").is_none());
}

#[test]
fn single_precision_is_warned_of_and_has_an_end() {
    let mut mesh =
        Mesh { positions: vec![[5_412_345.001, 0.0, 0.0], [5_412_346.0, 1.0, 0.0], [0.0; 3]], ..Default::default() };
    mesh.push_face(&[0, 1, 2]);
    let lattice = Lattice { origin: [0.0; 3], step: 0.001 };
    let (_, warnings) = bytes(&mesh, Format::Stl, Some(&lattice));
    assert_eq!(
        warnings[0].to_string(),
        "1 vertex moved by up to 1.0e-3 in the single precision of the format; PLY and OBJ keep them"
    );
    mesh.positions[2][2] = 1e300;
    for format in [Format::Stl, Format::Glb] {
        let error = write_to(Vec::new(), format, &mesh, None).unwrap_err().to_string();
        assert_eq!(
            error,
            "output: coordinates reach 1e300, beyond the single precision of the format; write PLY or OBJ instead"
        );
    }
}

#[test]
fn warnings_count_what_is_left_out() {
    let mut mesh = Mesh { positions: vec![[0.0; 3]; 6], ..Default::default() };
    mesh.push_face(&[0, 1, 2, 3]);
    mesh.push_face(&[0, 1]);
    let texts: Vec<_> = bytes(&mesh, Format::Stl, None).1.iter().map(ToString::to_string).collect();
    assert_eq!(
        texts,
        [
            "1 polygon cut into triangles: the format has no polygons",
            "1 dangling edge left out: the format has only triangles",
            "2 isolated vertices left out: the format has only triangles",
        ]
    );
    let glb = bytes(&mesh, Format::Glb, None);
    assert_eq!(glb.1, [WriteWarning::Triangulated { polygons: 1 }]);
    let modes: Vec<_> = document(&glb.0)["meshes"][0]["primitives"].as_array().unwrap().clone();
    assert_eq!(modes.iter().map(|p| p["mode"].as_u64().unwrap()).collect::<Vec<_>>(), [4, 1, 0]);
}

#[test]
fn empty_meshes_everywhere() {
    let empty = Mesh::default();
    for format in [Format::Obj, Format::Ply, Format::Stl, Format::Glb] {
        assert_eq!(back(&bytes(&empty, format, None).0, format, None).mesh, empty, "{format:?}");
    }
}

#[test]
fn files_appear_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let mut mesh = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ..Default::default() };
    mesh.push_face(&[0, 1, 2]);
    let write = |name: &str, mesh: &Mesh| {
        write_path(folder.path().join(name), mesh, None, &WriteOptions::default())
            .map_err(|e| e.to_string().replace(&folder.path().display().to_string(), "DIR"))
    };
    let listing = || fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect::<Vec<_>>();
    for (name, text) in [
        ("a/b.ply", "DIR/a/b.ply: the folder DIR/a does not exist; create it first"),
        ("a.xyz", "DIR/a.xyz: cannot write .xyz files; write .obj, .ply, .stl or .glb"),
        ("a.off", "DIR/a.off: cannot write .off files; write .obj, .ply, .stl or .glb"),
        ("a", "DIR/a: cannot write a file without extension; write .obj, .ply, .stl or .glb"),
    ] {
        assert_eq!(write(name, &mesh).unwrap_err(), text);
    }
    let broken = Mesh { positions: vec![[f64::NAN; 3]], ..Default::default() };
    assert_eq!(
        write("a.ply", &broken).unwrap_err(),
        "DIR/a.ply: the mesh is not valid: vertex 0 has a coordinate that is not a finite number (NaN)"
    );
    let far = Mesh { positions: vec![[1e300; 3], [0.0; 3]], ..Default::default() };
    assert!(write("a.glb", &far).is_err());
    assert!(listing().is_empty());
    fs::create_dir(folder.path().join("c.ply")).unwrap();
    assert_eq!(write("c.ply", &mesh).unwrap_err(), "DIR/c.ply: this is a folder; name a file in it");

    write("d.PLY", &mesh).unwrap();
    let read = read_path(folder.path().join("d.PLY"), &ReadOptions::default()).unwrap().mesh;
    assert_eq!((read, listing().len()), (mesh.clone(), 2));
    // A failure leaves the old file as it was.
    assert!(write("d.PLY", &broken).is_err());
    assert_eq!(read_path(folder.path().join("d.PLY"), &ReadOptions::default()).unwrap().mesh, mesh);
}

#[cfg(unix)]
#[test]
fn links_stay_links_and_modes_are_usual() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (real, link) = (folder.path().join("real.obj"), folder.path().join("link.obj"));
    let mesh = Mesh { positions: vec![[1.0; 3]], ..Default::default() };
    fs::write(&real, "old").unwrap();
    let usual = fs::metadata(&real).unwrap().permissions().mode();
    std::os::unix::fs::symlink(&real, &link).unwrap();
    write_path(&link, &mesh, None, &WriteOptions::default()).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::read_to_string(&real).unwrap(), "v 1 1 1\np 1\n");
    assert_eq!(fs::metadata(&real).unwrap().permissions().mode(), usual);
}

/// A target that takes so many bytes and then is full.
struct Full(usize);

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = bytes.len().min(self.0);
        self.0 -= n;
        if n == 0 { Err(io::ErrorKind::StorageFull.into()) } else { Ok(n) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_wherever_it_strikes() {
    let mut mesh = Mesh { positions: vec![[0.5; 3]; 9], ..Default::default() };
    mesh.push_face(&[0, 1, 2, 3]);
    mesh.push_face(&[4, 5]);
    for format in [Format::Obj, Format::Ply, Format::Stl, Format::Glb] {
        for room in 0..bytes(&mesh, format, None).0.len() {
            let error = write_to(Full(room), format, &mesh, None).unwrap_err();
            assert_eq!(error.to_string(), "output: the disk is full; make room or write elsewhere");
        }
    }
    #[cfg(target_os = "linux")]
    {
        let options = WriteOptions { format: Some(Format::Ply) };
        let error = write_path("/dev/full", &mesh, None, &options).unwrap_err();
        assert_eq!(error.kind, WriteErrorKind::DiskFull);
    }
}

mod with_attributes {
    //! Layers, materials and images through every format and back.

    use super::*;
    use crate::mesh::{Image, Layer, LayerKind, NO_VALUE, Stored};

    /// A layer over faces of which some have no values; `values` are what its numbers may be.
    fn layer(mesh: &Mesh, name: &str, kind: LayerKind, stored: Stored, values: &[&[f64]], key: u64) -> Layer {
        let mut out = Layer { name: name.into(), kind, width: values[0].len() as u8, stored, ..Layer::default() };
        out.values = values.concat();
        let mut state = key | 1;
        let mut next = |n: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % n
        };
        for (number, f) in mesh.faces().enumerate() {
            let without = next(4) == 0 && number > 0;
            let same = next(2) == 0;
            for v in f {
                // Half of the faces go by their vertices, so that seams and smooth places both occur.
                let i = if same { u64::from(*v) % values.len() as u64 } else { next(values.len() as u64) };
                out.corners.push(if without { NO_VALUE } else { i as u32 });
            }
        }
        out
    }

    fn per_vertex(
        mesh: &Mesh,
        name: &str,
        kind: LayerKind,
        stored: Stored,
        value: impl Fn(usize) -> Vec<f64>,
    ) -> Layer {
        let n = mesh.vertex_count();
        let values: Vec<f64> = (0..n).flat_map(&value).collect();
        Layer::per_vertex(name, kind, value(0).len() as u8, stored, values, &mesh.corners, n)
    }

    /// Triangles over vertices at places of their own.
    fn triangles() -> impl Strategy<Value = Mesh> {
        (3usize..12).prop_flat_map(|n| {
            prop::collection::vec(prop::collection::vec(0..n as u32, 3), 1..20).prop_map(move |faces| {
                let positions = (0..n).map(|i| [i as f64, (i * i) as f64, 0.5]).collect();
                let mut mesh = Mesh { positions, ..Mesh::default() };
                faces.iter().for_each(|f| mesh.push_face(f));
                mesh
            })
        })
    }

    const UVS: [&[f64]; 4] = [&[0.0, 0.0], &[0.25, 0.75], &[-1.5, 3.0], &[1.0, 0.015625]];
    const NORMALS: [&[f64]; 3] = [&[0.0, 0.0, 1.0], &[0.0, -1.0, 0.0], &[1.0, 0.0, 0.0]];

    fn colour(i: usize) -> Vec<f64> {
        [i * 7, i * 31 + 5, 255 - i].map(|c| (c % 256) as f64 / 255.0).to_vec()
    }

    fn materials(mesh: &mut Mesh, key: u64) {
        mesh.material = (0..mesh.face_count()).map(|f| (f as u64 * key / 3 % 3) as u32).collect();
        mesh.appearance.materials = vec![
            r#"{"extras":{"mtl":["Kd 0.5 0.25 1","map_Kd -s 2 2 1 a b.png","illum 2"]},"name":"from mtl"}"#.into(),
            r#"{"name":"plain","pbrMetallicRoughness":{"baseColorTexture":{"index":1}}}"#.into(),
            r#"{"extensions":{"KHR_materials_unlit":{}},"name":"unlit"}"#.into(),
        ];
        mesh.appearance.textures = vec![r#"{"source":0}"#.into(), r#"{"sampler":0,"source":1}"#.into()];
        mesh.appearance.samplers = vec![r#"{"wrapS":33071}"#.into()];
        let png = |tail: u8| [b"\x89PNG\r\n\x1a\n".as_slice(), &[tail]].concat();
        mesh.appearance.images = vec![
            Image { name: "a b.png".into(), mime: "image/png".into(), bytes: png(1), previews: Vec::new() },
            Image { name: String::new(), mime: "image/png".into(), bytes: png(2), previews: Vec::new() },
        ];
    }

    /// Everything that is said of each face, sorted; and of each isolated vertex.
    fn all_said(mesh: &Mesh, kinds: &[LayerKind]) -> Vec<String> {
        let layers: Vec<&Layer> = mesh.layers.iter().filter(|l| kinds.contains(&l.kind)).collect();
        let value = |l: &Layer, i: u32| (i != NO_VALUE).then(|| format!("{}{:?}", l.name, l.value(i)));
        let mut out: Vec<String> = (0..mesh.face_count())
            .map(|f| {
                let own = mesh.face_start[f] as usize..mesh.face_start[f + 1] as usize;
                let corner = |c: usize| {
                    let mut said: Vec<_> = layers.iter().filter_map(|l| value(l, l.corners[c])).collect();
                    said.sort();
                    (mesh.positions[mesh.corners[c] as usize], said)
                };
                format!("{:?} {:?}", mesh.material.get(f), own.map(corner).collect::<Vec<_>>())
            })
            .collect();
        for l in layers {
            for &[v, i] in &l.isolated {
                out.push(format!("alone {:?} {:?}", mesh.positions[v as usize], value(l, i)));
            }
        }
        out.sort();
        out
    }

    fn through(mesh: &Mesh, name: &str) -> (Mesh, Vec<WriteWarning>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let warnings = write_path(&path, mesh, None, &WriteOptions::default()).unwrap();
        let read = read_path(&path, &ReadOptions::default()).unwrap();
        assert_eq!(read.warnings, [], "{name}");
        (read.mesh, warnings)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn obj_keeps_what_it_has_words_for(mut mesh in triangles(), key in 1u64..1000) {
            mesh.layers.push(layer(&mesh, "uv", LayerKind::Uv, Stored::F32, &UVS, key));
            mesh.layers.push(layer(&mesh, "normal", LayerKind::Normal, Stored::F32, &NORMALS, key * 3));
            mesh.layers.push(per_vertex(&mesh, "color", LayerKind::Color, Stored::F32, colour));
            materials(&mut mesh, key);
            let (again, warnings) = through(&mesh, "mesh.obj");
            prop_assert_eq!(&warnings, &[WriteWarning::MaterialsSimplified { count: 1 }]);
            prop_assert_eq!(&again.corners, &mesh.corners);
            // Materials are numbered by their first use, so they are compared by name.
            let names = |m: &Mesh| -> Vec<String> {
                let name = |&i: &u32| m.appearance.materials[i as usize].split("name\":").nth(1).unwrap()[..6].to_string();
                m.material.iter().map(name).collect()
            };
            prop_assert_eq!(names(&again), names(&mesh));
            let kinds = [LayerKind::Uv, LayerKind::Normal, LayerKind::Color];
            let (mut a, mut b) = (again, mesh);
            (a.material, b.material) = (Vec::new(), Vec::new());
            prop_assert_eq!(all_said(&a, &kinds), all_said(&b, &kinds));
        }

        #[test]
        fn ply_keeps_all_layers(mut mesh in triangles(), key in 1u64..1000, seams in any::<bool>()) {
            mesh.layers.push(layer(&mesh, "uv", LayerKind::Uv, Stored::F32, &UVS, key));
            mesh.layers.push(layer(&mesh, "uv1", LayerKind::Uv, Stored::F32, &UVS[1..], key * 7));
            if seams {
                let mut normals = layer(&mesh, "normal", LayerKind::Normal, Stored::F32, &NORMALS, key * 3);
                normals.corners.iter_mut().filter(|i| **i == NO_VALUE).for_each(|i| *i = 0);
                let used = |v: u32| mesh.corners.contains(&v);
                normals.isolated = (0..mesh.vertex_count() as u32).filter(|v| !used(*v)).map(|v| [v, 1]).collect();
                mesh.layers.push(normals);
            }
            mesh.layers.push(per_vertex(&mesh, "color", LayerKind::Color, Stored::U8, colour));
            for (name, stored) in [("a", Stored::I8), ("b", Stored::U16), ("c", Stored::F64), ("d", Stored::I32)] {
                mesh.layers.push(per_vertex(&mesh, name, LayerKind::Scalar, stored, |i| vec![i as f64]));
            }
            mesh.layers.push(layer(&mesh, "quality", LayerKind::Scalar, Stored::F32, &[&[0.5], &[7.0]], key));
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.ply");
            let warnings = write_path(&path, &mesh, None, &WriteOptions::default()).unwrap();
            prop_assert!(warnings.iter().all(|w| matches!(w, WriteWarning::Repeated { .. })), "{:?}", warnings);
            let again = read_path(&path, &ReadOptions::default()).unwrap().mesh;
            prop_assert_eq!(&again.corners, &mesh.corners);
            let kinds = [LayerKind::Uv, LayerKind::Normal, LayerKind::Color, LayerKind::Scalar];
            prop_assert_eq!(all_said(&again, &kinds), all_said(&mesh, &kinds));
            let stored = |m: &Mesh| m.layers.iter().map(|l| (l.name.clone(), l.stored)).collect::<std::collections::BTreeMap<_, _>>();
            prop_assert_eq!(stored(&again), stored(&mesh));
        }

        #[test]
        fn glb_keeps_everything(mut mesh in triangles(), key in 1u64..1000, with in any::<[bool; 3]>()) {
            if with[0] {
                mesh.layers.push(layer(&mesh, "uv", LayerKind::Uv, Stored::F32, &UVS, key));
            }
            mesh.layers.push(layer(&mesh, "normal", LayerKind::Normal, Stored::F32, &NORMALS, key * 3));
            if with[1] {
                let tangents: [&[f64]; 2] = [&[0.0, 1.0, 0.0, -1.0], &[0.0, 0.0, 1.0, 1.0]];
                let mut layer = layer(&mesh, "tangent", LayerKind::Tangent, Stored::F32, &tangents, key);
                let normals = &mesh.layers[mesh.layers.len() - 1];
                for (i, n) in layer.corners.iter_mut().zip(&normals.corners) {
                    *i = if *n == NO_VALUE { NO_VALUE } else { 0 };
                }
                mesh.layers.push(layer);
            }
            mesh.layers.push(per_vertex(&mesh, "color", LayerKind::Color, Stored::U8, colour));
            mesh.layers.push(per_vertex(&mesh, "color1", LayerKind::Color, Stored::U16, |i| vec![i as f64 / 65535.0, 0.0, 1.0, 0.0]));
            mesh.layers.push(per_vertex(&mesh, "a", LayerKind::Scalar, Stored::I8, |i| vec![i as f64, -1.0]));
            mesh.layers.push(layer(&mesh, "quality", LayerKind::Scalar, Stored::F32, &[&[0.5], &[7.0]], key * 5));
            if with[2] {
                materials(&mut mesh, key);
                // A texture needs coordinates where its material is used.
                if !with[0] {
                    mesh.appearance.materials[1] = "{}".into();
                }
                if with[0] && mesh.material.contains(&1) {
                    mesh.layers[0].corners.iter_mut().filter(|i| **i == NO_VALUE).for_each(|i| *i = 0);
                }
            }
            let (again, warnings) = through(&mesh, "a.glb");
            prop_assert_eq!(&warnings, &[]);
            let kinds = [LayerKind::Uv, LayerKind::Normal, LayerKind::Tangent, LayerKind::Color, LayerKind::Scalar];
            prop_assert_eq!(all_said(&again, &kinds), all_said(&mesh, &kinds));
            prop_assert_eq!(&again.appearance, &mesh.appearance);
            let stored = |m: &Mesh| m.layers.iter().map(|l| (l.name.clone(), l.stored)).collect::<std::collections::BTreeMap<_, _>>();
            prop_assert_eq!(stored(&again), stored(&mesh));
        }
    }

    fn textured() -> Mesh {
        let mut mesh =
            Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]], ..Mesh::default() };
        mesh.push_face(&[0, 1, 2]);
        mesh.push_face(&[2, 1, 3]);
        mesh.layers.push(layer(&mesh, "uv", LayerKind::Uv, Stored::F32, &UVS, 4));
        mesh.layers[0].corners = vec![0, 1, 2, 3, 1, 0];
        materials(&mut mesh, 3);
        mesh
    }

    #[test]
    fn libraries_and_images_lie_beside_the_mesh() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let listing = || {
            let mut names: Vec<_> =
                fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        };
        let mesh = textured();
        write_path(at("my mesh.obj"), &mesh, None, &WriteOptions::default()).unwrap();
        assert_eq!(listing(), ["a_b.png", "image1.png", "my mesh.obj", "my_mesh.mtl"]);
        let mtl = fs::read_to_string(at("my_mesh.mtl")).unwrap();
        assert_eq!(
            mtl,
            "# lodestream\n\nnewmtl from mtl\nKd 0.5 0.25 1\nmap_Kd -s 2 2 1 a_b.png\nillum 2\n\nnewmtl plain\nKd 1 1 1\nd 1\n\
             Pr 1\nPm 1\nillum 2\nmap_Kd image1.png\n\nnewmtl unlit\nKd 1 1 1\nd 1\nPr 1\nPm 1\nillum 2\n"
        );
        assert!(fs::read_to_string(at("my mesh.obj")).unwrap().starts_with("mtllib my_mesh.mtl\nv 0 0 0\n"));
        // Again, beside what is there; then beside a file of another content.
        write_path(at("b.ply"), &mesh, None, &WriteOptions::default()).unwrap();
        assert_eq!(listing().len(), 5);
        fs::write(at("a_b.png"), "mine").unwrap();
        for _ in 0..2 {
            write_path(at("c.obj"), &mesh, None, &WriteOptions::default()).unwrap();
            assert!(listing().contains(&"c_a_b.png".to_string()) && listing().len() == 8, "{:?}", listing());
        }
        assert_eq!(fs::read(at("a_b.png")).unwrap(), b"mine");
        let read = read_path(at("c.obj"), &ReadOptions::default()).unwrap().mesh;
        assert_eq!(read.appearance.images[0].bytes, mesh.appearance.images[0].bytes);
    }

    #[test]
    fn nothing_stays_when_a_file_beside_cannot_be_written() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("m.mtl")).unwrap();
        let error = write_path(folder.path().join("m.obj"), &textured(), None, &WriteOptions::default()).unwrap_err();
        assert_eq!(error.kind.to_string(), "m.mtl, which goes beside it, is a folder; write elsewhere");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn streams_have_nothing_beside_them() {
        let (file, warnings) = bytes(&textured(), Format::Obj, None);
        assert_eq!(
            warnings[0].to_string(),
            "3 files of materials and images left out: write the mesh to a path, or as GLB"
        );
        let read = back(&file, Format::Obj, None);
        assert_eq!(read.mesh.material.len(), 2);
        let (_, warnings) = bytes(&textured(), Format::Stl, None);
        assert_eq!(warnings[0].to_string(), "`uv` left out (4 values): the format has no place for it");
    }

    #[test]
    fn hostile_names_stay_in_the_folder() {
        let mut mesh = textured();
        mesh.appearance.images[0].name = "..\\../etc/../.hidden\n name?.png".into();
        mesh.appearance.images[1].name = "HIDDEN__name_.PNG".into();
        let folder = tempfile::tempdir().unwrap();
        write_path(folder.path().join("m.obj"), &mesh, None, &WriteOptions::default()).unwrap();
        let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["hidden__name_.png", "m.mtl", "m.obj", "m_HIDDEN__name_.PNG"]);
        // JSON that is none, and numbers beyond all lists.
        mesh.appearance.materials[0] = "{".into();
        mesh.appearance.materials[1] = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":99}}}"#.into();
        mesh.appearance.textures[0] = "[]".into();
        for format in [Format::Obj, Format::Ply, Format::Glb, Format::Stl] {
            bytes(&mesh, format, None);
        }
    }

    #[test]
    fn glb_says_which_extensions_it_uses_and_needs() {
        let mut mesh = textured();
        mesh.appearance.images[1].mime = "image/webp".into();
        mesh.appearance.images[0].bytes.clear();
        let (file, warnings) = bytes(&mesh, Format::Glb, None);
        assert_eq!(warnings, [WriteWarning::ImagesMissing { count: 1 }]);
        let doc = document(&file);
        assert_eq!(doc["extensionsUsed"], serde_json::json!(["EXT_texture_webp", "KHR_materials_unlit"]));
        assert_eq!(doc["extensionsRequired"], serde_json::json!(["EXT_texture_webp"]));
        assert_eq!(doc["images"][0]["uri"], "a_b.png");
        assert_eq!(doc["meshes"][0]["primitives"].as_array().unwrap().len(), 2);
    }
}
