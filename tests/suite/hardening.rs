//! What can happen to a file on its way: every bit of small files flipped, every prefix of them, bytes behind the end; and
//! meshes with vertices of huge valence, through the whole codec.
#![cfg(all(feature = "encode", feature = "samples"))]

use crate::common::small;
use lodestream::format::container::{ContainerError, FileIndex, Parsed};
use lodestream::format::decoder::{DecodeError, DecodeOptions, Decoder, Step};
use lodestream::mesh::{Layer, LayerKind, Mesh};
use small::{file, files};

/// Decode as far as it goes: the levels reached, and how it ended.
fn run(bytes: &[u8]) -> (Option<u32>, Result<Step, DecodeError>, Decoder) {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    let mut reached = None;
    loop {
        match decoder.next_level() {
            Ok(Step::Level(l)) => reached = Some(l),
            end => return (reached, end, decoder),
        }
    }
}

#[test]
fn no_flipped_bit_goes_unnoticed() {
    for (name, bytes) in files() {
        let mut damaged = bytes.clone();
        for bit in 0..8 * bytes.len() {
            damaged[bit / 8] ^= 1 << (bit % 8);
            let (reached, end, mut decoder) = run(&damaged);
            let finish = decoder.finish();
            let whole = end == Ok(Step::Full) && finish.is_ok();
            assert!(!whole, "{name}: bit {bit} flipped, and all is well at level {reached:?}");
            if let Err(error) = end {
                assert_eq!(error.to_string().lines().count(), 1, "{name}: {error}");
                // It stays at what it had, and says the same again.
                assert_eq!(decoder.next_level(), Err(error), "{name}: bit {bit}");
                assert_eq!(decoder.level(), reached);
            }
            damaged[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

#[test]
fn every_prefix_gives_the_best_whole_level() {
    for (name, bytes) in files() {
        let mut whole = Vec::new();
        let mut decoder = Decoder::new(DecodeOptions::default());
        decoder.push(&bytes);
        while let Ok(Step::Level(_)) = decoder.next_level() {
            whole.push((decoder.complex().clone(), decoder.attributes().clone()));
        }
        let mesh = decoder.to_mesh();
        for cut in 0..bytes.len() {
            let (reached, end, mut decoder) = run(&bytes[..cut]);
            // A last chunk may be empty: then all levels are there, whatever follows.
            assert!(matches!(end, Ok(Step::NeedBytes | Step::Full)), "{name} cut at {cut}: {end:?}");
            let level = match FileIndex::parse(&bytes[..cut]) {
                Ok(Parsed::Ready(front)) => front.whole_level(cut as u64),
                Ok(Parsed::NeedBytes(_)) => None,
                Err(error) => panic!("{name} cut at {cut}: {error}"),
            };
            assert_eq!(reached, level, "{name} cut at {cut}");
            if let Some(l) = reached {
                let wanted = &whole[l as usize];
                assert_eq!((decoder.complex(), decoder.attributes()), (&wanted.0, &wanted.1), "{name} cut at {cut}");
                decoder.to_mesh().validate().unwrap();
            }
            match decoder.finish() {
                Err(DecodeError::Container(ContainerError::Truncated { have, need, level: l, exact })) => {
                    assert_eq!(have, cut as u64, "{name}");
                    assert!(need > have && (!exact || need == bytes.len() as u64), "{name} cut at {cut}: {need}");
                    assert_eq!(l, level, "{name} cut at {cut}");
                }
                other => panic!("{name} cut at {cut}: {other:?}"),
            }
            // What comes later goes on where it stopped.
            decoder.push(&bytes[cut..]);
            while let Step::Level(_) = decoder.next_level().unwrap() {}
            assert_eq!(decoder.to_mesh(), mesh, "{name} cut at {cut}, then the rest");
            decoder.finish().unwrap();
        }
    }
}

#[test]
fn nothing_may_follow_the_last_chunk() {
    for (name, mut bytes) in files() {
        let total = bytes.len() as u64;
        for extra in 1..4 {
            bytes.push(extra as u8);
            let (_, _, mut decoder) = run(&bytes);
            assert_eq!(
                decoder.finish(),
                Err(DecodeError::Container(ContainerError::TrailingBytes { have: total + extra, total })),
                "{name}"
            );
        }
    }
}

#[test]
fn bytes_may_come_one_by_one() {
    for (name, bytes) in files() {
        let (_, _, whole) = run(&bytes);
        let mut decoder = Decoder::new(DecodeOptions::default());
        for b in &bytes {
            while let Step::Level(_) = decoder.next_level().unwrap() {}
            decoder.push(&[*b]);
        }
        while let Step::Level(_) = decoder.next_level().unwrap() {}
        decoder.finish().unwrap();
        assert_eq!(decoder.complex(), whole.complex(), "{name}");
        assert_eq!(decoder.degenerate(), whole.degenerate(), "{name}");
        assert_eq!(decoder.attributes(), whole.attributes(), "{name}");
        assert_eq!(decoder.to_mesh(), whole.to_mesh(), "{name}");
    }
}

/// Encode and decode, and compare the counts of vertices and faces. Sane time is what the test would not end without.
fn there_and_back(mesh: &Mesh) {
    let (_, end, mut decoder) = run(&file(mesh, 12));
    assert_eq!(end, Ok(Step::Full));
    decoder.finish().unwrap();
    let back = decoder.to_mesh();
    back.validate().unwrap();
    assert_eq!((back.vertex_count(), back.face_count()), (mesh.vertex_count(), mesh.face_count()));
    assert_eq!(back.corners.len(), mesh.corners.len());
}

const HUGE: u32 = 100_000;

/// Points on a wavy circle around the first.
fn around(n: u32) -> Mesh {
    let mut random = small::Random(11);
    let mut mesh = small::of(&[[0.0, 0.0, 0.5]], &[]);
    for k in 0..n {
        let (s, c) = (f64::from(k) * std::f64::consts::TAU / f64::from(n)).sin_cos();
        mesh.positions.push([c, s, random.below(1000) as f64 * 1e-4]);
    }
    mesh
}

#[test]
fn a_fan_of_very_many_triangles() {
    let mut mesh = around(HUGE);
    (1..HUGE).for_each(|k| mesh.push_face(&[0, k, k + 1]));
    there_and_back(&mesh);
}

#[test]
fn a_star_of_very_many_dangling_edges() {
    let mut mesh = around(HUGE);
    (1..=HUGE).for_each(|k| mesh.push_face(&[0, k]));
    there_and_back(&mesh);
}

#[test]
fn an_edge_of_very_many_triangles() {
    let mut mesh = around(HUGE);
    (2..=HUGE).for_each(|k| mesh.push_face(&if k % 3 == 0 { [0, 1, k] } else { [1, 0, k] }));
    there_and_back(&mesh);
}

/// Hubs whose elements all have other values, few values, or none: what is looked for around a vertex has an end.
#[test]
fn values_around_very_many_elements() {
    let few = HUGE / 4;
    let fan = |mesh: &mut Mesh| (1..few).for_each(|k| mesh.push_face(&[0, k, k + 1]));
    let book = |mesh: &mut Mesh| (2..=few).for_each(|k| mesh.push_face(&[k % 2, 1 - k % 2, k]));
    let edges = |mesh: &mut Mesh| (1..=few).for_each(|k| mesh.push_face(&[0, 1 + k % 2]));
    let big = |mesh: &mut Mesh| {
        let ring: Vec<u32> = (1..=few).collect();
        mesh.push_face(&ring);
        (1..few).for_each(|k| mesh.push_face(&[k, k + 1, 0]));
    };
    let builds: [&dyn Fn(&mut Mesh); 4] = [&fan, &book, &edges, &big];
    for build in builds {
        let mut mesh = around(few);
        build(&mut mesh);
        let mut random = small::Random(5);
        mesh.layers.push(small::any_layer(&mesh, "uv", LayerKind::Uv, 2, &mut random));
        let n = mesh.corners.len();
        let values = (0..2 * n).map(|i| (i % 4099) as f64 / 4099.0).collect();
        let all = Layer { name: "own".into(), kind: LayerKind::Uv, width: 2, values, ..Layer::default() };
        mesh.layers.push(Layer { corners: (0..n as u32).collect(), ..all });
        there_and_back(&mesh);
    }
}

#[test]
fn a_polygon_of_very_many_corners() {
    let mut mesh = around(HUGE);
    let ring: Vec<u32> = (1..=HUGE).collect();
    mesh.push_face(&ring);
    (1..HUGE).step_by(2).for_each(|k| mesh.push_face(&[k, k + 1, 0]));
    there_and_back(&mesh);
}

#[test]
fn one_edge_very_many_times() {
    let mut mesh = around(3);
    (0..HUGE).for_each(|k| mesh.push_face(&[k % 2, 1 - k % 2]));
    (0..HUGE).for_each(|_| mesh.push_face(&[1, 2, 3]));
    there_and_back(&mesh);
}

#[test]
fn very_many_vertices_in_one_place() {
    let mut mesh = around(1000);
    mesh.positions.iter_mut().for_each(|p| *p = [1.0, 2.0, 3.0]);
    (1..1000).for_each(|k| mesh.push_face(&[0, k, k + 1]));
    there_and_back(&mesh);
    // And a corner of them far away: mean edges of nothing beside the longest there are.
    mesh.positions[1] = [1e6, 2.0, 3.0];
    mesh.positions[1000] = [1.0, 2e6, 3.0];
    for bits in [12, 16, 21] {
        let (_, end, _) = run(&file(&mesh, bits));
        assert_eq!(end, Ok(Step::Full));
    }
}
