//! What is written reads back; what cannot be written says so and leaves nothing behind.

use std::fs;
use std::io;

use proptest::prelude::*;

use super::*;
use crate::read::{ReadMesh, ReadOptions, read_bytes, read_path};

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
    read_bytes(bytes, format, None, &ReadOptions { weld, ..Default::default() }).unwrap()
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
