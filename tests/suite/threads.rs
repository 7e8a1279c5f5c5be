//! The bytes of a file do not depend on how many threads made it.
#![cfg(all(feature = "encode", feature = "samples"))]

use crate::common::small;
use lodestream::encode::{EncodeOptions, encode};
use lodestream::format::container::{FileIndex, Kind, Parsed};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::mesh::Mesh;
use lodestream::samples::{crumbs, soup, sphere, terrain};

fn bytes(mesh: &Mesh, threads: usize) -> (Vec<u8>, Vec<u32>) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let encoded = pool.install(|| encode(mesh, &EncodeOptions::default())).unwrap();
    (encoded.bytes, encoded.map)
}

#[test]
fn any_number_of_threads_gives_the_same_attributes() {
    let mut mesh = terrain(36_000, 3);
    let first = mesh.vertex_count() as u32;
    let beside = soup(60, 100, 5);
    mesh.positions.extend(&beside.positions);
    for f in beside.faces() {
        let f: Vec<u32> = f.iter().map(|v| v + first).collect();
        mesh.push_face(&f);
    }
    let mesh = small::with_attributes(mesh, 8);
    let one = bytes(&mesh, 1);
    let Ok(Parsed::Ready(front)) = FileIndex::parse(&one.0) else { panic!("a valid file") };
    assert!(front.chunks().iter().any(|c| c.kind == Kind::Segment && c.segments > 1), "several segments in a batch");
    for threads in [2, 5] {
        assert!(bytes(&mesh, threads) == one, "{threads} threads give another file than one");
    }
    // Nor does what is decoded.
    let decode = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut decoder = Decoder::new(DecodeOptions::default());
            decoder.push(&one.0);
            while let Step::Level(_) = decoder.next_level().unwrap() {}
            decoder.to_mesh()
        })
    };
    let once = decode(1);
    assert!(decode(3) == once);
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    // A noisy sphere of 57,762 vertices, and crumbs beside it.
    let mut mesh = sphere(76, 0.02, 3);
    let first = mesh.vertex_count() as u32;
    let beside = crumbs(1000, 5);
    mesh.positions.extend(&beside.positions);
    for f in beside.faces() {
        let f: Vec<u32> = f.iter().map(|v| v + first).collect();
        mesh.push_face(&f);
    }
    let one = bytes(&mesh, 1);
    let Ok(Parsed::Ready(front)) = FileIndex::parse(&one.0) else { panic!("a valid file") };
    assert!(front.chunks().iter().any(|c| c.segments > 2), "several segments in a batch");
    for threads in [2, 3, 8] {
        assert!(bytes(&mesh, threads) == one, "{threads} threads give another file than one");
    }
}
