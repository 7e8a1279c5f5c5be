//! Everything comes back: through `verify --against` of the real program, and through the library by the comparison that
//! knows nothing of the codec. On every mesh of `datasets.toml` that has faces, and the generated ones.

use crate::common::{Scratch, datasets, lodestream};
use lodestream::encode::{EncodeOptions, encode};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::Quantization;
use lodestream::quality::exact;

/// Encode and decode in memory and compare through the map; the error is one line.
fn round_trip(mesh: &Mesh, options: &EncodeOptions) -> Result<(), String> {
    let encoded = encode(mesh, options).map_err(|e| e.to_string())?;
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&encoded.bytes);
    loop {
        match decoder.next_level().map_err(|e| e.to_string())? {
            Step::Level(_) => {}
            Step::Full => break,
            Step::NeedBytes => return Err("the file ends before the full level".to_string()),
        }
    }
    decoder.finish().map_err(|e| e.to_string())?;
    let lattice = decoder.index().map_err(|e| e.to_string())?.ok_or("no front")?.header().lattice;
    exact::by_map(mesh, &decoder.to_mesh(), &lattice, &encoded.map).map_err(|e| e.to_string())
}

#[test]
fn every_dataset_comes_back_through_the_library() {
    let mut failures = Vec::new();
    // The largest goes through `verify` below; once is enough in a build without full optimization.
    for dataset in datasets::available(|d| !d.large && d.vertices < 150_000) {
        for (bits, lock_borders) in [(12, false), (9, true)] {
            let options = EncodeOptions::default().quantization(Quantization::Bits(bits)).lock_borders(lock_borders);
            let result = dataset.load(None).and_then(|mesh| round_trip(&mesh, &options));
            if let Err(error) = result {
                failures.push(format!("{} at {bits} bits: {error}", dataset.name));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_dataset_comes_back_through_verify() {
    let scratch = Scratch::new("verify-all");
    let mut failures = Vec::new();
    for dataset in datasets::available(|d| !d.large && d.has_faces()) {
        let source = match dataset.file() {
            Some(file) => file,
            None => {
                let file = scratch.path("generated.ply");
                write::write_path(&file, &dataset.load(None).unwrap(), None, &WriteOptions::default()).unwrap();
                file
            }
        };
        // The paths may hold spaces, which the words of a command here may not.
        let link = scratch.path(source.file_name().unwrap().to_str().unwrap());
        let source = if source.to_str().is_some_and(|p| p.contains(char::is_whitespace)) {
            std::fs::copy(&source, &link).unwrap();
            link
        } else {
            source
        };
        let source = source.display();
        let encode = lodestream(scratch.folder(), &format!("encode {source} -o m.lods --map m.map --drop all"));
        if encode.code != 0 {
            failures.push(format!("{}: {}", dataset.name, encode.stderr));
            continue;
        }
        for options in ["--map m.map", ""] {
            let verify = lodestream(scratch.folder(), &format!("verify m.lods --against {source} {options}"));
            if verify.code != 0 {
                failures.push(format!("{} {options}: {}", dataset.name, verify.stderr));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn tiny_meshes_come_back() {
    let point = [1.0, 2.0, 3.0];
    let mesh = |n: usize, faces: &[&[u32]]| {
        let mut mesh = Mesh { positions: (0..n).map(|i| [i as f64, (i * i) as f64, 0.0]).collect(), ..Mesh::default() };
        faces.iter().for_each(|f| mesh.push_face(f));
        mesh
    };
    let cases: &[(&str, Mesh)] = &[
        ("nothing", Mesh::default()),
        ("one vertex", mesh(1, &[])),
        ("one vertex far away", Mesh { positions: vec![[4e5, 5e6, 1e3]], ..Mesh::default() }),
        ("three vertices on one point", Mesh { positions: vec![point; 3], ..Mesh::default() }),
        ("an edge", mesh(2, &[&[0, 1]])),
        ("an edge three times", mesh(2, &[&[0, 1], &[1, 0], &[0, 1]])),
        ("a triangle", mesh(3, &[&[0, 1, 2]])),
        ("a triangle in both orientations", mesh(3, &[&[0, 1, 2], &[2, 1, 0]])),
        ("a triangle twice", mesh(3, &[&[0, 1, 2], &[1, 2, 0]])),
        ("a face that repeats a vertex", mesh(3, &[&[0, 1, 0, 2]])),
        ("a face of one vertex", mesh(1, &[&[0, 0, 0]])),
        ("only such faces", mesh(2, &[&[0, 0, 1], &[1, 1]])),
        ("a face of 300 corners", mesh(300, &[&(0..300).collect::<Vec<u32>>()])),
        ("a fan of edges", mesh(6, &[&[0, 1], &[0, 2], &[0, 3], &[0, 4], &[0, 5]])),
    ];
    for (name, mesh) in cases {
        for bits in [1, 12, 21] {
            let options = EncodeOptions::default().quantization(Quantization::Bits(bits));
            round_trip(mesh, &options).unwrap_or_else(|e| panic!("{name} at {bits} bits: {e}"));
        }
    }
}

/// The vertices of a border or dangling edge, as sorted lattice points in full precision.
fn border_points(mesh: &Mesh, lattice: &lodestream::mesh::lattice::Lattice) -> Vec<[i32; 3]> {
    let mut edges = std::collections::HashMap::new();
    for face in mesh.faces() {
        for i in 0..face.len() {
            let (a, b) = (face[i], face[(i + 1) % face.len()]);
            *edges.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    let mut on_border: Vec<u32> = edges.iter().filter(|(_, n)| **n == 1).flat_map(|((a, b), _)| [*a, *b]).collect();
    on_border.sort_unstable();
    on_border.dedup();
    let q = lattice.quantize(&mesh.positions).unwrap();
    let mut points: Vec<[i32; 3]> = on_border.iter().map(|&v| q[v as usize]).collect();
    points.sort_unstable();
    points
}

#[test]
fn locked_borders_stay_at_every_level() {
    for mesh in [lodestream::samples::cylinder(40, 30, 20, 3), lodestream::samples::terrain(2500, 4)] {
        let options = EncodeOptions::default().quantization(Quantization::Bits(14)).lock_borders(true);
        let encoded = encode(&mesh, &options).unwrap();
        let mut decoder = Decoder::new(DecodeOptions::default());
        decoder.push(&encoded.bytes);
        let (mut levels, mut coarsest) = (0, usize::MAX);
        while let Step::Level(level) = decoder.next_level().unwrap() {
            let lattice = decoder.index().unwrap().unwrap().header().lattice;
            let decoded = decoder.to_mesh();
            assert_eq!(border_points(&decoded, &lattice), border_points(&mesh, &lattice), "level {level}");
            levels += 1;
            coarsest = coarsest.min(decoded.vertex_count());
        }
        assert!(levels > 3 && coarsest < mesh.vertex_count() / 2, "{levels} levels from {coarsest} vertices");
    }
}
