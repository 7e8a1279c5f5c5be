//! Reading and writing from outside: paths, packed files, limits; and every mesh file of the test data.
#![cfg(feature = "formats")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use lodestream::io::read::{Format, ReadErrorKind, ReadMesh, ReadOptions, read_bytes, read_from, read_path};
use lodestream::io::write::{WriteOptions, write_path, write_to};
use lodestream::mesh::{LayerKind, Mesh, NO_VALUE};

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

#[test]
fn extensions_name_formats() {
    for (path, format) in [
        ("a.obj", Format::Obj),
        ("dir.x/A.PLY", Format::Ply),
        ("a.b.stl.gz", Format::Stl),
        ("a.Off.GZ", Format::Off),
        ("a.gltf", Format::Gltf),
        ("a.glb", Format::Glb),
    ] {
        assert_eq!(Format::from_path(Path::new(path)), Ok(format));
    }
    for (path, extension) in [("a", ""), ("a.gz", ""), ("a.xyz.gz", "xyz"), (".obj", ""), ("a.obj.bz2", "bz2")] {
        assert_eq!(Format::from_path(Path::new(path)), Err(extension.to_string()), "{path}");
    }
}

#[test]
fn packed_files_of_any_number_of_members() {
    let folder = tempfile::tempdir().unwrap();
    let mut packed = gzip(&TRIANGLE[..10]);
    packed.extend(gzip(&TRIANGLE[10..]));
    let path = folder.path().join("a.obj.gz");
    fs::write(&path, &packed).unwrap();
    let options = ReadOptions::default();
    let expected = read_bytes(TRIANGLE, Format::Obj, None, &options).unwrap();
    assert_eq!(read_path(&path, &options).unwrap(), expected);
    assert_eq!(read_bytes(&packed, Format::Obj, None, &options).unwrap(), expected);
    assert_eq!(read_from(packed.as_slice(), "standard input", Format::Obj, None, &options).unwrap(), expected);
    fs::write(&path, &packed[..packed.len() - 9]).unwrap();
    let error = read_path(&path, &options).unwrap_err();
    assert!(matches!(error.kind, ReadErrorKind::Packed(_)), "{error}");
    fs::write(&path, TRIANGLE).unwrap();
    assert_eq!(
        read_path(&path, &options).unwrap_err().kind.to_string(),
        "this is not gzip: \"v 0 0 0\" stands where 1f 8b belongs; check the file or name its true format"
    );
}

#[test]
fn paths_that_are_no_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("a.thing"), "1 2 3").unwrap();
    fs::write(path("plain"), "1 2 3").unwrap();
    fs::create_dir(path("d.obj")).unwrap();
    let known = "is not a known mesh format; known are .obj .ply .stl .off .gltf .glb, each also with .gz, .zst or .xz. Rename the file or name its format";
    for (name, text) in [
        ("none.obj", "there is no such file; check the path".to_string()),
        ("plain/x.obj", "there is no such file; check the path".to_string()),
        ("d.obj", "this is a folder; name a mesh file".to_string()),
        ("a.thing", format!("the extension .thing {known}")),
        ("plain", format!("a file without extension {known}")),
    ] {
        let error = read_path(path(name), &ReadOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), format!("{}: {text}", path(name).display()));
    }
    let bad = path("bad.obj");
    fs::write(&bad, "v 0 0 0\nf 1 2 3\n").unwrap();
    assert_eq!(
        read_path(&bad, &ReadOptions::default()).unwrap_err().to_string(),
        format!(
            "{}, line 2: a face names vertex 3, but the file has 1 vertex, numbered from 1; mend the index or add the vertex",
            bad.display()
        )
    );
}

#[test]
fn the_memory_limit_holds_for_every_format() {
    let mut obj = Vec::new();
    for i in 0..3000 {
        writeln!(obj, "v {i} 0 0\nf {} {} {}", i + 1, i % 7 + 1, i % 3 + 1).unwrap();
    }
    let mesh = read_bytes(&obj, Format::Obj, None, &ReadOptions::default()).unwrap().mesh;
    for format in [Format::Obj, Format::Ply, Format::Stl, Format::Glb] {
        let mut file = Vec::new();
        write_to(&mut file, format, &mesh, None).unwrap();
        let size = file.len() as u64;
        for packed in [false, true] {
            let file = if packed { gzip(&file) } else { file.clone() };
            for limit in [0, 1000, size, size + 20_000] {
                let options = ReadOptions { memory_limit: Some(limit), ..Default::default() };
                let error = read_from(file.as_slice(), "x", format, None, &options).unwrap_err();
                let memory = matches!(error.kind, ReadErrorKind::Memory { limit: Some(l), .. } if l == limit);
                assert!(memory, "{format:?} within {limit}: {error}");
            }
            let options = ReadOptions { memory_limit: Some(2 * size + 1_000_000), ..Default::default() };
            read_from(file.as_slice(), "x", format, None, &options).unwrap();
        }
    }
    let options = ReadOptions { memory_limit: Some(1000), ..Default::default() };
    let error = read_from(obj.as_slice(), "standard input", Format::Obj, None, &options).unwrap_err();
    assert_eq!(
        error.to_string(),
        "standard input: reading it needs at least 1001 bytes of memory, the limit is 1000; raise the limit or cut the mesh into tiles"
    );
}

/// All files below a folder, in order.
fn walk(folder: &Path, into: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            walk(&path, into);
        } else {
            into.push(path);
        }
    }
}

/// A row of the inventory by its column names.
type Row = BTreeMap<String, String>;

fn inventory(folder: &Path) -> BTreeMap<String, Row> {
    let text = fs::read_to_string(folder.join("inventory.csv")).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| -> Row {
        names.iter().zip(line.split(',')).map(|(n, v)| (n.to_string(), v.to_string())).collect()
    };
    lines.map(row).map(|r| (r["file"].clone(), r)).collect()
}

/// Against the inventory, where it counts what the reader counts.
fn compare(name: &str, format: Format, read: &ReadMesh, row: &Row) {
    let number = |key: &str| row[key].parse::<usize>().unwrap();
    let (mesh, records) = (&read.mesh, read.map.len());
    match format {
        Format::Obj | Format::Ply | Format::Off => {
            assert_eq!(records, number("vertices"), "{name}: vertices");
            assert_eq!(mesh.face_count(), number("faces"), "{name}: faces");
        }
        Format::Stl => {
            assert_eq!(records, number("vertices"), "{name}: corners");
            assert_eq!(mesh.vertex_count(), number("unique_positions"), "{name}: vertices");
            assert_eq!(mesh.face_count(), number("faces"), "{name}: faces");
        }
        // The inventory counts each mesh once, in its own coordinates; the reader each of its places.
        Format::Gltf | Format::Glb
            if number("nodes_with_mesh") == number("meshes") && number("gpu_instancing_nodes") == 0 =>
        {
            assert_eq!(records, number("vertices"), "{name}: records");
            assert_eq!(mesh.face_count(), number("faces"), "{name}: faces");
            if number("meshes") == 1 {
                assert_eq!(mesh.vertex_count(), number("unique_positions"), "{name}: vertices");
            }
        }
        _ => {}
    }
}

/// What layers say of each corner, in the order of the corners.
fn said(mesh: &Mesh, kind: LayerKind) -> Vec<Option<Vec<f64>>> {
    let Some(layer) = mesh.layers.iter().find(|l| l.kind == kind) else { return Vec::new() };
    layer.corners.iter().map(|&i| (i != NO_VALUE).then(|| layer.value(i).to_vec())).collect()
}

/// Written and read again: the same elements, attributes, materials and images.
fn round_trip(name: &str, read: &ReadMesh) {
    let folder = tempfile::tempdir().unwrap();
    let mesh = &read.mesh;
    for file in ["mesh.obj", "mesh.ply", "mesh.glb"] {
        let path = folder.path().join(file);
        write_path(&path, mesh, None, &WriteOptions::default()).unwrap();
        let again = read_path(&path, &ReadOptions::default()).unwrap().mesh;
        assert_eq!(again.face_count(), if file == "mesh.glb" { again.face_count() } else { mesh.face_count() });
        let in_order = match file {
            "mesh.obj" => mesh.material.is_empty() || !mesh.material.contains(&NO_VALUE),
            "mesh.ply" => !mesh.faces().any(|f| f.len() == 2),
            _ => false,
        };
        if !in_order {
            continue;
        }
        assert_eq!(again.corners, mesh.corners, "{name} as {file}");
        for kind in [LayerKind::Uv, LayerKind::Normal, LayerKind::Color] {
            let (mut a, mut b) = (said(&again, kind), said(mesh, kind));
            // OBJ has no alpha, PLY texture coordinates in single precision.
            for value in a.iter_mut().chain(&mut b).flatten() {
                value.truncate(3);
                value.iter_mut().for_each(|x| *x = f64::from(*x as f32));
            }
            assert!(a == b, "{name} as {file}: {kind:?}");
        }
        if file == "mesh.obj" && !mesh.material.is_empty() {
            let bytes = |m: &Mesh| m.appearance.images.iter().map(|i| i.bytes.clone()).collect::<BTreeSet<_>>();
            assert!(bytes(&again).is_subset(&bytes(mesh)), "{name}: images");
        }
    }
}

#[test]
fn every_mesh_file_of_the_test_data() {
    let Some(folder) = std::env::var_os("LODESTREAM_DATA").map(PathBuf::from) else {
        eprintln!("skipped: every_mesh_file_of_the_test_data (LODESTREAM_DATA names no folder)");
        return;
    };
    let inventory = inventory(&folder);
    let mut files = Vec::new();
    walk(&folder, &mut files);
    let (mut read_count, mut compared) = (0, 0);
    for path in files {
        let Ok(format) = Format::from_path(&path) else { continue };
        let name = path.strip_prefix(&folder).unwrap().to_string_lossy().into_owned();
        let read = read_path(&path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        read.mesh.validate().unwrap();
        assert!(read.map.iter().all(|&v| (v as usize) < read.mesh.vertex_count()), "{name}: map");
        read_count += 1;
        match inventory.get(&name) {
            Some(row) => {
                compared += 1;
                compare(&name, format, &read, row);
            }
            None => eprintln!("{name}: not in the inventory, only read"),
        }
        round_trip(&name, &read);
        for warning in &read.warnings {
            println!("{name}: {warning}");
        }
    }
    println!("{read_count} files read, {compared} in the inventory");
    assert!(read_count >= 60, "only {read_count} mesh files below {}", folder.display());
}

#[test]
fn from_one_file_to_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let options = ReadOptions::default();
    let first = read_bytes(TRIANGLE, Format::Obj, None, &options).unwrap().mesh;
    for name in ["a.obj", "a.ply", "a.stl", "a.glb", "A.OBJ"] {
        let path = folder.path().join(name);
        assert!(write_path(&path, &first, None, &WriteOptions::default()).unwrap().is_empty());
        let read = read_path(&path, &options).unwrap();
        assert_eq!((read.mesh, read.warnings.len()), (first.clone(), 0), "{name}");
    }
}
