//! JPEG textures in the stream: pieces, orders of chunks, prefixes, exact bytes, damage.
#![cfg(all(feature = "encode", feature = "samples"))]

#[path = "common/small.rs"]
mod small;

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use lodestream::container::{Chunk, Front, Kind, Parsed, write};
use lodestream::decode::{DecodeError, DecodeOptions, Decoder, MissingImages, Step};
use lodestream::encode::{EncodeOptions, Encoded, Schedule, encode};
use lodestream::generate::torus;
use lodestream::mesh::{Image, Mesh};
use lodestream::texture::{Exactness, Way, same_picture};
use small::{Random, dress};

/// A picture with something to see, by an encoder that is not ours.
fn jpeg(side: u16, color: ColorType, progressive: bool) -> Vec<u8> {
    let channels = if color == ColorType::Luma { 1 } else { 3 };
    let mut r = Random(9);
    let mut pixels = Vec::new();
    for y in 0..side as usize {
        for x in 0..side as usize {
            for c in 0..channels {
                pixels.push((x * (c + 1) + y * 2 + if (x / 9 + y / 14) % 2 == 0 { 60 } else { 0 } + r.below(24)) as u8);
            }
        }
    }
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, 90);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder.set_progressive(progressive);
    encoder.add_app_segment(1, b"Exif\0\0 tags").unwrap();
    encoder.encode(&pixels, side, side, color).unwrap();
    out
}

/// A mesh with a baseline, a progressive, a damaged and a missing JPEG, and a file that is none.
fn textured(side: u16) -> Mesh {
    with_images(torus(14, 11), side)
}

fn with_images(mesh: Mesh, side: u16) -> Mesh {
    let mut mesh = dress(mesh, 4);
    let colour = jpeg(side, ColorType::Rgb, false);
    let cut = colour[..colour.len() - 7].to_vec();
    let files = [colour, jpeg(side, ColorType::Luma, true), cut, Vec::new(), b"\x89PNG and so on".to_vec()];
    let image = |(i, bytes)| Image { name: format!("{i}.jpg"), mime: "image/jpeg".into(), bytes };
    mesh.appearance.images = files.into_iter().enumerate().map(image).collect();
    mesh
}

fn encoded(mesh: &Mesh, schedule: Schedule, images: Exactness) -> Encoded {
    encode(mesh, &EncodeOptions { schedule, images, ..EncodeOptions::default() }, &|_| {}).unwrap()
}

fn front(bytes: &[u8]) -> Front {
    match Front::parse(bytes) {
        Ok(Parsed::Ready(front)) => front,
        other => panic!("{other:?}"),
    }
}

/// Decode as far as the bytes go.
fn run(bytes: &[u8]) -> (Result<Step, DecodeError>, Decoder) {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    loop {
        match decoder.next_level() {
            Ok(Step::Level(_)) => {}
            end => return (end, decoder),
        }
    }
}

fn pixels(bytes: &[u8]) -> Vec<u8> {
    zune_jpeg::JpegDecoder::new(std::io::Cursor::new(bytes)).decode().unwrap()
}

const EXACTNESS: [Exactness; 2] = [Exactness::Coefficients, Exactness::Bytes];

#[test]
fn images_come_back_without_loss_in_every_order() {
    let mesh = textured(150);
    for schedule in Schedule::ALL {
        for exactness in EXACTNESS {
            let Encoded { bytes, report, .. } = encoded(&mesh, schedule, exactness);
            let ways: Vec<Way> = report.images.iter().map(|i| i.way).collect();
            let progressive = if exactness == Exactness::Bytes { Way::Cut } else { Way::Transcoded };
            assert!(matches!(ways[..], [Way::Transcoded, _, Way::Kept(_), Way::Kept(_)]), "{ways:?}");
            assert_eq!(ways[1], progressive);
            assert_eq!(report.images[2].name, "2.jpg");
            if exactness == Exactness::Coefficients {
                assert!(report.images[0].stored < report.images[0].bytes, "progressive is smaller");
            }
            let stored: u64 = report.images.iter().map(|i| i.stored).sum();
            assert_eq!(report.bits.images, stored as f64 * 8.0);
            let (end, mut decoder) = run(&bytes);
            assert_eq!(end, Ok(Step::Full));
            decoder.finish().unwrap();
            assert_eq!(decoder.missing_images(), MissingImages { all: 5, none: 0, part: 0 });
            let back = decoder.to_mesh().appearance;
            for (i, (a, b)) in mesh.appearance.images.iter().zip(&back.images).enumerate() {
                assert!(same_picture(&a.bytes, &b.bytes), "{schedule}: image {i}");
                // Only sound ones have changed their form, and only where they may.
                assert_eq!(a.bytes == b.bytes, i > 1 || exactness == Exactness::Bytes, "{schedule}: image {i}");
            }
            assert_eq!(pixels(&back.images[0].bytes), pixels(&mesh.appearance.images[0].bytes));
            assert!(!same_picture(&back.images[0].bytes, &back.images[1].bytes));
        }
    }
}

#[test]
fn every_prefix_gives_the_pictures_so_far() {
    let mesh = textured(150);
    for schedule in Schedule::ALL {
        let bytes = encoded(&mesh, schedule, Exactness::Bytes).bytes;
        let front = front(&bytes);
        let mut seen = Vec::new();
        for (k, chunk) in front.chunks().iter().enumerate() {
            // Just whole, and one byte short of the next.
            let next = front.chunks().get(k + 1).map_or(chunk.end(), |c| (c.end() - 1).max(chunk.end()));
            for end in [chunk.end(), next] {
                let (step, mut decoder) = run(&bytes[..end as usize]);
                assert!(matches!(step, Ok(Step::NeedBytes | Step::Full)), "{step:?}");
                let Some(appearance) = decoder.appearance().cloned() else { continue };
                let begun =
                    |i: u32| front.chunks()[..=k].iter().any(|c| c.kind == Kind::Image && c.image == i && c.length > 0);
                for i in [0, 1] {
                    let file = &appearance.images[i as usize].bytes;
                    assert_eq!(!file.is_empty(), begun(i), "{schedule}, chunk {k}");
                    if begun(i) {
                        let full = pixels(&mesh.appearance.images[i as usize].bytes);
                        assert_eq!(pixels(file).len(), full.len());
                    }
                }
                let missing = decoder.missing_images();
                assert_eq!(missing.all, 5);
                seen.push((missing.none, missing.part));
            }
        }
        // An image of no bytes is there at once where images come first.
        assert!(seen[0].0 >= 4 && seen.iter().any(|s| s.1 == 2) && seen.last() == Some(&(0, 0)), "{seen:?}");
    }
}

#[test]
fn orders_do_what_they_say() {
    // Large enough for several chunks.
    let mesh = with_images(torus(90, 80), 150);
    let place = |schedule| {
        let bytes = encoded(&mesh, schedule, Exactness::Coefficients).bytes;
        let front = front(&bytes);
        let of = |image: bool| {
            let mut list = front.chunks().iter().enumerate().filter(|(_, c)| (c.kind == Kind::Image) == image);
            let first = list.clone().nth(if image { 0 } else { 2 }).unwrap().0;
            (first, list.next_back().unwrap().0)
        };
        (of(false), of(true))
    };
    let ((_, mesh_end), (image, _)) = place(Schedule::MeshFirst);
    assert!(mesh_end < image);
    let ((level, _), (_, image_end)) = place(Schedule::TextureFirst);
    assert!(image_end < level);
    let ((level, mesh_end), (image, image_end)) = place(Schedule::Linear);
    assert!(image < mesh_end && level < image_end);
}

#[test]
fn pieces_may_be_fetched_apart_in_their_order() {
    let bytes = encoded(&textured(150), Schedule::MeshFirst, Exactness::Bytes).bytes;
    let front = front(&bytes);
    let fetch = |kind: Kind, image: u32, segment: u32| {
        let of = |c: &&lodestream::container::ChunkInfo| (c.kind, c.image, c.segment) == (kind, image, segment);
        let info = *front.chunks().iter().find(of).unwrap();
        (info, bytes[info.offset as usize..info.end() as usize].to_vec())
    };
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&bytes[..front.length() as usize]);
    assert_eq!(decoder.next_level(), Ok(Step::NeedBytes));
    let offer = |decoder: &mut Decoder, kind, image, segment| {
        let (info, payload) = fetch(kind, image, segment);
        decoder.offer(info, payload).map_err(|e| e.to_string())
    };
    offer(&mut decoder, Kind::Appearance, 0, 0).unwrap();
    offer(&mut decoder, Kind::Image, 0, 0).unwrap();
    let tail = "; the file was made by a faulty or hostile encoder";
    assert_eq!(
        offer(&mut decoder, Kind::Image, 0, 2),
        Err(format!("level 0: a piece of an image before the pieces that it follows{tail}"))
    );
    assert_eq!(
        offer(&mut decoder, Kind::Recipe, 0, 0),
        Err(format!("level 0: the recipe of an image before the image{tail}"))
    );
    offer(&mut decoder, Kind::Image, 0, 1).unwrap();
    offer(&mut decoder, Kind::Image, 0, 0).unwrap();
    let early = decoder.appearance().unwrap().images[0].bytes.clone();
    assert!(early.ends_with(&[0xFF, 0xD9]));
    // The rest of the file, in which they are once more.
    decoder.push(&bytes[front.length() as usize..]);
    while let Step::Level(_) = decoder.next_level().unwrap() {}
    assert_eq!(decoder.appearance().unwrap().images, textured(150).appearance.images);
}

#[test]
fn damage_is_noticed_and_memory_is_kept() {
    let mesh = textured(40);
    let bytes = encoded(&mesh, Schedule::Linear, Exactness::Bytes).bytes;
    let mut damaged = bytes.clone();
    for at in 0..bytes.len() {
        let bit = 1 << (at % 8);
        damaged[at] ^= bit;
        let (end, mut decoder) = run(&damaged);
        assert!(end != Ok(Step::Full) || decoder.finish().is_err(), "byte {at}");
        damaged[at] ^= bit;
    }
    for cut in 0..bytes.len() {
        let (end, mut decoder) = run(&bytes[..cut]);
        assert!(matches!(end, Ok(Step::NeedBytes | Step::Full)), "cut at {cut}: {end:?}");
        assert!(decoder.finish().is_err());
    }
    let mut decoder = Decoder::new(DecodeOptions { memory_limit: front(&bytes).memory(0) + 2000 });
    decoder.push(&bytes);
    let error = loop {
        match decoder.next_level() {
            Ok(Step::Level(_)) => {}
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(error.contains("memory"), "{error}");
}

/// Payloads that pass their checksums and are nonsense, and tables that contradict themselves.
#[test]
fn hostile_pictures_do_no_harm() {
    let mesh = textured(40);
    let bytes = encoded(&mesh, Schedule::Linear, Exactness::Bytes).bytes;
    let front = front(&bytes);
    let chunks: Vec<Chunk> = (0..front.chunks().len())
        .map(|k| {
            let c = front.chunks()[k];
            c.chunk(front.payload(&bytes, k).unwrap().unwrap().to_vec())
        })
        .collect();
    let pictures: Vec<usize> =
        (0..chunks.len()).filter(|&k| matches!(chunks[k].kind, Kind::Image | Kind::Recipe)).collect();
    let (mut r, mut refused, mut decoded) = (Random(77), 0, 0);
    for round in 0..4000 {
        let mut changed = chunks.clone();
        let k = pictures[r.below(pictures.len())];
        let c = &mut changed[k];
        match r.below(8) {
            0 => c.image = r.below(7) as u32,
            1 => c.segment = r.below(5) as u32,
            2 => c.segments = r.below(5) as u32,
            3 => c.payload.truncate(r.below(c.payload.len() + 1)),
            4 => c.kind = [Kind::Image, Kind::Recipe][r.below(2)],
            5 => changed.swap(k, pictures[r.below(pictures.len())]),
            _ => {
                for _ in 0..1 + r.below(4) {
                    let at = r.below(c.payload.len());
                    if let Some(byte) = c.payload.get_mut(at) {
                        *byte = r.next() as u8;
                    }
                }
            }
        }
        match write(front.header(), &changed) {
            Err(_) => refused += 1,
            Ok(file) => {
                let mut decoder = Decoder::new(DecodeOptions { memory_limit: 1 << 26 });
                decoder.push(&file);
                let end = loop {
                    match decoder.next_level() {
                        Ok(Step::Level(_)) => {}
                        end => break end,
                    }
                };
                if let Err(error) = end {
                    assert_eq!(error.to_string().lines().count(), 1, "round {round}");
                }
                decoded += 1;
            }
        }
    }
    assert!(refused > 300 && decoded > 1000, "{refused} refused, {decoded} decoded");
}
