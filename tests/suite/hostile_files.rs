//! Damaged files: small valid files of every format, changed at random, the same way each time.
//!
//! Whatever comes, a reader gives a valid mesh or an error; it never panics, and never asks for more memory than a
//! small multiple of the file (which the memory limit would report).
#![cfg(feature = "formats")]

use crate::common::small::Random;
use lodestream::io::read::{Format, ReadErrorKind, ReadOptions, read_bytes};
use lodestream::io::write::write_to;
use lodestream::mesh::{Image, Layer, LayerKind, Mesh, NO_VALUE, Stored};

const CASES: usize = 20_000;

/// What stands where numbers or words were.
const WORDS: [&[u8]; 20] = [
    b"-1",
    b"0",
    b"4294967295",
    b"4294967296",
    b"99999999999999999999",
    b"9223372036854775807",
    b"1e999",
    b"nan",
    b"-inf",
    b"\\",
    b"\r",
    b"",
    b"#",
    b"/",
    b"f 1 1",
    b"null",
    b"[]",
    b"{}",
    b"\"\"",
    b"2147483648",
];

const BYTES: [u8; 8] = [0, 1, 0x7f, 0x80, 0xff, b'\n', b' ', b'9'];

fn change(file: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(file.len());
    let length = 1 + random.below(8);
    let end = (at + length).min(file.len());
    match random.below(8) {
        0 if at < file.len() => file[at] ^= 1 << random.below(8),
        1 if at < file.len() => file[at] = BYTES[random.below(BYTES.len())],
        2 => file.truncate(at),
        3 => drop(file.drain(at..end)),
        4 => {
            let copy = file[at..end].to_vec();
            let to = random.below(file.len());
            file.splice(to..to, copy);
        }
        5 => {
            for byte in &mut file[at..end] {
                *byte = random.next() as u8;
            }
        }
        _ => {
            // A whole word for another, where the file is text.
            let part = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'-');
            let start = file[..at].iter().rposition(|b| !part(b)).map_or(0, |i| i + 1);
            let stop = file[at..].iter().position(|b| !part(b)).map_or(file.len(), |i| at + i);
            file.splice(start..stop, WORDS[random.below(WORDS.len())].iter().copied());
        }
    }
}

fn storm(format: Format, seed: u64, files: &[Vec<u8>]) {
    let mut random = Random(seed);
    let (mut read, mut refused) = (0, 0);
    for case in 0..CASES {
        let mut file = files[case % files.len()].clone();
        for _ in 0..=random.below(4) {
            change(&mut file, &mut random);
        }
        // Enough for a mesh of the file's own size, far too little for a count that was made up.
        let limit = Some(300 * file.len() as u64 + 65_536);
        let weld = [None, Some(true), Some(false)][random.below(3)];
        match read_bytes(&file, format, None, &ReadOptions { weld, memory_limit: limit, ..Default::default() }) {
            Ok(found) => {
                found.mesh.validate().unwrap();
                assert!(found.map.iter().all(|&v| (v as usize) < found.mesh.vertex_count()));
                read += 1;
            }
            Err(error) => {
                let memory = matches!(error.kind, ReadErrorKind::Memory { .. });
                assert!(!memory, "case {case}: {error}\n{}", file.escape_ascii());
                let line = error.to_string();
                assert!(line.lines().count() == 1 && line.len() < 600, "case {case}: {line}");
                refused += 1;
            }
        }
    }
    // The storm is neither a breeze nor the end of the world.
    assert!(read > CASES / 50 && refused > CASES / 50, "{format:?}: {read} read, {refused} refused");
}

fn sample() -> Mesh {
    let mut mesh =
        Mesh { positions: (0..9).map(|i| [f64::from(i % 3), f64::from(i / 3), 0.25]).collect(), ..Default::default() };
    for face in [&[0, 1, 4, 3][..], &[1, 2, 5], &[3, 4, 5, 7, 6], &[0, 2]] {
        mesh.push_face(face);
    }
    let n = mesh.vertex_count();
    let values = |width: usize, x: f64| (0..n * width).map(|i| x * (i % 5) as f64).collect();
    let mut add = |name: &str, kind, width, stored, x| {
        let layer = Layer::per_vertex(name, kind, width, stored, values(width as usize, x), &mesh.corners, n);
        mesh.layers.push(layer);
    };
    add("uv", LayerKind::Uv, 2, Stored::F32, 0.25);
    add("normal", LayerKind::Normal, 3, Stored::F32, 0.25);
    add("color", LayerKind::Color, 4, Stored::U8, 0.2);
    add("quality", LayerKind::Scalar, 1, Stored::I16, 3.0);
    // A seam, and a face without.
    mesh.layers[0].corners[..4].copy_from_slice(&[8, 7, 6, 5]);
    mesh.layers[0].corners[4..7].fill(NO_VALUE);
    mesh.material = vec![0, 1, NO_VALUE, 0];
    mesh.appearance.materials =
        vec![r#"{"name":"a","pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#.into(), "{}".into()];
    mesh.appearance.textures = vec![r#"{"source":0,"sampler":0}"#.into()];
    mesh.appearance.samplers = vec!["{}".into()];
    mesh.appearance.images = vec![Image {
        name: "a.png".into(),
        mime: "image/png".into(),
        bytes: b"\x89PNG\r\n\x1a\n".to_vec(),
        previews: Vec::new(),
    }];
    mesh
}

fn written(format: Format) -> Vec<u8> {
    let mut out = Vec::new();
    write_to(&mut out, format, &sample(), None).unwrap();
    out
}

const OBJ: &[u8] =
    b"mtllib a.mtl\nv 0 0 0 1\nv 1 0 0 .5 .5 .5\nv 0 1e-3 0\nv 1 1 -0.5\nvt 0 0\nvn 0 0 1\ng x\nusemtl m\n\
f 1/1/1 2//1 3/1\nf -1 -2 -3\nl 1 2 3 \\\n 4\np 2\ncurv 1 2\n# end\n";

const PLY: &[u8] = b"ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n\
property uchar red\nelement tristrips 1\nproperty list int int vertex_indices\nelement other 1\nproperty list uchar float a\n\
property int b\nelement edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n0 0 0 1\n1 0 0 1\n1 1 0 1\n0 1 .5 1\n\
6 0 1 2 -1 1 3\n2 .5 .5 7\n0 3\n";

const PLY_BINARY: &[u8] = b"ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty short x\nproperty float y\n\
property double z\nproperty list uchar short q\nelement face 1\nproperty list ushort uchar vertex_index\nproperty int f\n\
end_header\n\0\x01\0\0\0\0\0\0\0\0\0\0\0\0\x01\0\x05\0\x02\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x03\0\x01\0\0\0\0\0";

const STL: &[u8] =
    b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
facet normal 0 0 1 outer loop vertex 0 1 0 vertex 1 0 0 vertex 1 1 0 vertex 2 2 2 endloop endfacet\nendsolid a\n";

const OFF: &[u8] =
    b"OFF\n# comment\n5 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0 # four\n.5 .5 1\n4 0 1 2 3\n3 0 1 4 255 0 0\n2 0 4\n";
const COFF: &[u8] =
    b"STCNOFF\n3 1\n0 0 0 1 1 255 0 0 255 0 0 1\n1 0 0 1 1 9 9 9 9 0 0 1\n0 1 0 1 1 1 1 1 1 0 0 1\n3 0 1 2\n";

/// A document with nodes, quantized positions, sparse data and instances.
const GLTF: &[u8] = br#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"extensionsRequired":["KHR_mesh_quantization","EXT_mesh_gpu_instancing"],
"nodes":[{"children":[1,2],"scale":[2,2,2]},{"mesh":0,"rotation":[0,0,1,0]},
{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,-1,0,0,0,3,1],"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":2}}}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":5},{"attributes":{"POSITION":0},"mode":3}]}],
"accessors":[{"bufferView":0,"componentType":5120,"normalized":true,"count":4,"type":"VEC3",
"sparse":{"count":1,"indices":{"bufferView":1,"byteOffset":2,"componentType":5121},"values":{"bufferView":0}}},
{"bufferView":1,"componentType":5121,"count":4,"type":"SCALAR"},
{"bufferView":2,"componentType":5126,"count":2,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteLength":16,"byteStride":4},{"buffer":0,"byteOffset":16,"byteLength":4},
{"buffer":0,"byteOffset":16,"byteLength":24}],
"buffers":[{"byteLength":40,"uri":"data:;base64,AAAAAH8AAAAAfwAAf38AAAABAgMAAAAAAACAPwAAAAAAAABAAAAAAAAAgEAAAAA="}]}"#;

#[test]
fn obj_in_a_storm() {
    storm(Format::Obj, 0x6c6f_6465_0001, &[OBJ.to_vec(), written(Format::Obj)]);
}

#[test]
fn ply_in_a_storm() {
    storm(Format::Ply, 0x6c6f_6465_0002, &[PLY.to_vec(), PLY_BINARY.to_vec(), written(Format::Ply)]);
}

#[test]
fn stl_in_a_storm() {
    storm(Format::Stl, 0x6c6f_6465_0003, &[STL.to_vec(), written(Format::Stl)]);
}

#[test]
fn off_in_a_storm() {
    storm(Format::Off, 0x6c6f_6465_0004, &[OFF.to_vec(), COFF.to_vec()]);
}

#[test]
fn gltf_in_a_storm() {
    storm(Format::Gltf, 0x6c6f_6465_0005, &[GLTF.to_vec(), written(Format::Glb)]);
}

#[test]
fn every_cut_of_every_sample() {
    let samples: [(Format, Vec<u8>); 11] = [
        (Format::Obj, OBJ.to_vec()),
        (Format::Obj, written(Format::Obj)),
        (Format::Ply, PLY.to_vec()),
        (Format::Ply, PLY_BINARY.to_vec()),
        (Format::Ply, written(Format::Ply)),
        (Format::Stl, STL.to_vec()),
        (Format::Stl, written(Format::Stl)),
        (Format::Off, OFF.to_vec()),
        (Format::Off, COFF.to_vec()),
        (Format::Gltf, GLTF.to_vec()),
        (Format::Glb, written(Format::Glb)),
    ];
    for (format, file) in samples {
        let whole = read_bytes(&file, format, None, &ReadOptions::default());
        assert!(whole.is_ok(), "{format:?}: {whole:?}");
        // Formats that say how much follows notice every cut.
        let counted =
            matches!(format, Format::Gltf | Format::Glb) || file == PLY_BINARY || file == written(Format::Ply);
        for length in 0..file.len() {
            let cut = read_bytes(&file[..length], format, None, &ReadOptions::default());
            assert!(!counted || cut.is_err(), "{format:?} cut to {length} of {} bytes", file.len());
        }
    }
}
