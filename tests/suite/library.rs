//! The library as other programs use it: buffers for renderers, what stays after an error, cancellation.
#![cfg(all(feature = "encode", feature = "samples"))]

use crate::common::repair::repair;
use crate::common::small;
use lodestream::format::complex::NONE;
use lodestream::{BufferError, DecodeOptions, Decoder, EncodeOptions, Step, encode};
use std::sync::atomic::{AtomicBool, Ordering};

/// Decode the levels of a file one after the other.
fn each_level(bytes: &[u8], mut look: impl FnMut(&Decoder)) {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    while let Step::Level(_) = decoder.next_level().unwrap() {
        look(&decoder);
    }
}

#[test]
fn split_vertices_say_what_the_mesh_says() {
    for (name, bytes) in small::files() {
        each_level(&bytes, |decoder| {
            let (mesh, shape) = (decoder.to_mesh(), decoder.render_level());
            assert!(shape.vertex.is_sorted(), "{name}");
            let at = |i: u32| shape.vertex[i as usize];
            // Polygons are fans, in order within each material; dangling edges lines; what nothing names a point.
            let mut expected = (Vec::new(), Vec::new());
            for f in decoder.faces().iter() {
                match f {
                    &[a, b] => expected.1.extend([a, b]),
                    f => (2..f.len()).for_each(|k| expected.0.push([f[0], f[k - 1], f[k]])),
                }
            }
            let mut found: Vec<[u32; 3]> = shape.triangles.chunks(3).map(|t| [at(t[0]), at(t[1]), at(t[2])]).collect();
            expected.0.sort_unstable();
            found.sort_unstable();
            assert_eq!(found, expected.0, "{name}");
            let lines: Vec<u32> = shape.lines.iter().map(|&i| at(i)).collect();
            assert_eq!(lines.len(), expected.1.len(), "{name}");
            let end = shape.groups.iter().fold(0, |end, group| {
                assert_eq!(group.indices.start, end, "{name}: groups follow each other");
                group.indices.end
            });
            assert_eq!(end as usize, shape.triangles.len(), "{name}");
            let mut used = vec![false; mesh.vertex_count()];
            decoder.faces().corners.iter().for_each(|&v| used[v as usize] = true);
            assert!(shape.points.iter().all(|&i| !used[at(i) as usize]), "{name}");
            assert_eq!(shape.points.len(), used.iter().filter(|u| !**u).count(), "{name}");

            // Positions, two ways.
            let origin = mesh.positions.first().copied().unwrap_or_default();
            let mut positions = vec![0f32; 3 * shape.vertex.len()];
            decoder.write_positions(&shape, origin, &mut positions).unwrap();
            let mut quantized = vec![0i32; positions.len()];
            decoder.write_quantized_positions(&shape, &mut quantized).unwrap();
            let transform = decoder.position_transform().unwrap();
            for (i, &v) in shape.vertex.iter().enumerate() {
                for k in 0..3 {
                    let exact = mesh.positions[v as usize][k];
                    let (found, wanted) = (f64::from(positions[3 * i + k]), exact - origin[k]);
                    assert!((found - wanted).abs() <= 1e-7 * (1.0 + wanted.abs()), "{name}: {found} {wanted}");
                    let scaled = transform.offset[k] + transform.scale * f64::from(quantized[3 * i + k]);
                    assert!((scaled - exact).abs() <= 1e-12 * (1.0 + exact.abs()), "{name}: {scaled} {exact}");
                }
            }

            // Values: every pair of vertex and value that a corner has is there, and no other.
            for (l, layer) in mesh.layers.iter().enumerate() {
                let width = decoder.layer_width(l).unwrap();
                assert_eq!(width, layer.width as usize);
                let mut values = vec![9f32; width * shape.vertex.len()];
                decoder.write_layer(&shape, l, &mut values).unwrap();
                let bits = |v: u32, value: Vec<f32>| (v, value.iter().map(|c| c.to_bits()).collect::<Vec<_>>());
                let mut found: Vec<_> = (0..shape.vertex.len())
                    .map(|i| bits(shape.vertex[i], values[i * width..(i + 1) * width].to_vec()))
                    .filter(|(v, _)| used[*v as usize])
                    .collect();
                let mut expected: Vec<_> = decoder
                    .faces()
                    .corners
                    .iter()
                    .zip(&layer.corners)
                    .map(|(&v, &i)| {
                        let none = || vec![0.0; width];
                        bits(v, if i == NONE { none() } else { layer.value(i).iter().map(|&c| c as f32).collect() })
                    })
                    .collect();
                for list in [&mut found, &mut expected] {
                    list.sort();
                    list.dedup();
                }
                assert_eq!(found, expected, "{name}: {}", layer.name);
            }
        });
    }
}

#[test]
fn buffers_of_another_size_are_refused() {
    let bytes = small::file(&lodestream::samples::sphere(6, 0.02, 1), 10);
    let mut first = None;
    each_level(&bytes, |decoder| {
        let shape = decoder.render_level();
        let (needed, found) = (3 * shape.vertex.len(), 3 * shape.vertex.len() + 1);
        let error = decoder.write_positions(&shape, [0.0; 3], &mut vec![0.0; found]).unwrap_err();
        assert_eq!(error, BufferError::Length { needed, found });
        assert_eq!(error.to_string(), format!("a buffer of {found} numbers for {needed}"));
        let error = decoder.write_layer(&shape, 2, &mut []).unwrap_err();
        assert_eq!(error.to_string(), "layer 2 of a file with 0");
        let first = first.get_or_insert(shape.clone());
        if first.vertex.len() != shape.vertex.len() {
            let error = decoder.write_quantized_positions(first, &mut vec![0; 3 * first.vertex.len()]).unwrap_err();
            let (found, needed) = (first.vertex.len(), shape.vertex.len());
            assert_eq!(error.to_string(), format!("a level of {found} vertices where the level at hand has {needed}"));
        }
    });
}

#[test]
fn what_is_not_among_the_changed_vertices_has_stayed() {
    for (name, bytes) in small::files() {
        let mut before: Vec<[f64; 3]> = Vec::new();
        let mut stayed = 0;
        each_level(&bytes, |decoder| {
            let now = decoder.positions();
            for gap in [0, 3] {
                let runs = decoder.changed_vertices(gap);
                assert!(runs.windows(2).all(|pair| pair[0].end + gap < pair[1].start), "{name}: {runs:?}");
                for v in (0..now.len()).filter(|&v| !runs.iter().any(|run| run.contains(&(v as u32)))) {
                    assert_eq!(decoder.parents()[v], v as u32, "{name}");
                    assert_eq!(now[v], before[v], "{name}");
                    stayed += 1;
                }
            }
            before = now;
        });
        assert!(stayed > 0 || before.len() < 40, "{name}: nothing ever stayed");
    }
}

/// What a decoder says of the level at hand, coordinates and values in full.
fn said(decoder: &Decoder) -> String {
    let (level, parents, attributes) = (decoder.complex(), decoder.parents(), decoder.attributes());
    format!("{:?} {level:?} {parents:?} {attributes:?} {:?}", decoder.level(), decoder.to_mesh())
}

/// Streams that contradict themselves behind right checksums, at any place.
#[test]
fn after_an_error_everything_is_as_it_was() {
    let mut r = small::Random(5);
    let mut refused = 0;
    for (name, bytes) in small::files().into_iter().filter(|(_, bytes)| bytes.len() > 120) {
        for _ in 0..60 {
            let mut broken = bytes.clone();
            let at = 60 + r.below(bytes.len() - 60);
            broken[at] ^= 1 << r.below(8);
            if repair(&mut broken).is_none() {
                continue;
            }
            let mut decoder = Decoder::new(DecodeOptions { memory_limit: 64 << 20 });
            decoder.push(&broken);
            let nothing = said(&decoder);
            let mut last = nothing.clone();
            let error = loop {
                match decoder.next_level() {
                    Ok(Step::Level(level)) => {
                        assert_eq!(decoder.level(), Some(level), "{name}");
                        last = said(&decoder);
                    }
                    Ok(_) => break None,
                    Err(error) => break Some(error),
                }
            };
            let Some(error) = error else { continue };
            refused += 1;
            // Images go on arriving behind the last level; they are none of a level's business.
            let strip = |text: String| text.split(" Mesh {").next().unwrap_or_default().to_string();
            assert_eq!(strip(said(&decoder)), strip(last.clone()), "{name}: {error}");
            assert_eq!(decoder.next_level(), Err(error), "{name}: the same again");
            assert_eq!(decoder.level().is_none(), strip(last) == strip(nothing), "{name}");
        }
    }
    assert!(refused > 100, "only {refused} streams were refused");
}

#[test]
fn an_encoding_stops_when_it_is_told_to() {
    use lodestream::encode::cost::Engine;
    use lodestream::encode::{Control, EncodeError, Progress, Stage, encode_with};
    let mesh = lodestream::samples::sphere(40, 0.02, 3);
    let options = EncodeOptions::default();
    for stop_at in [Stage::Simplify, Stage::Encode] {
        let cancel = AtomicBool::new(false);
        let progress = |p: Progress| {
            if p.stage == stop_at {
                cancel.store(true, Ordering::Relaxed);
            }
        };
        let control = Control::new().progress(&progress).cancel(&cancel);
        let error = encode_with(&mesh, &options, Engine::default(), control).unwrap_err();
        assert_eq!(error, EncodeError::Cancelled);
        assert_eq!(error.to_string(), "stopped by the caller");
    }
    assert!(encode(&mesh, &options).is_ok());
}

/// A file whose many levels add nothing would keep a decoder busy for hours.
#[test]
fn levels_that_add_nothing_are_refused() {
    use lodestream::format::container::{Chunk, FileIndex, LevelInfo, Parsed, write};
    let bytes = small::file(&lodestream::samples::point_cloud(3000, 2), 12);
    let Ok(Parsed::Ready(index)) = FileIndex::parse(&bytes) else { panic!("it is whole") };
    let mut header = index.header().clone();
    let row = LevelInfo { shift: 0, ..header.full() };
    header.levels = vec![row; 60_000];
    let last = header.levels.len() as u32 - 1;
    let bomb = write(&header, &[Chunk::base(last, vec![0; 64])]).unwrap();
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&bomb);
    let error = decoder.next_level().unwrap_err().to_string();
    assert_eq!(
        error,
        "level 0: more levels than such a file can have; the file was made by a faulty or hostile encoder"
    );
}
