//! JPEG textures in the stream: pieces, orders of chunks, prefixes, exact bytes, damage.
#![cfg(all(feature = "encode", feature = "samples"))]

use crate::common::small;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use lodestream::encode::{EncodeOptions, Encoded, Schedule, encode};
use lodestream::format::container::{Chunk, FileIndex, Kind, Parsed, Preview, write};
use lodestream::format::decoder::{DecodeError, DecodeOptions, Decoder, MissingImages, Step};
use lodestream::image::jpeg::{Exactness, Treatment, same_picture};
use lodestream::mesh::{Image, Mesh};
use lodestream::samples::torus;
use small::{Random, with_attributes};

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
    let mut mesh = with_attributes(mesh, 4);
    let colour = jpeg(side, ColorType::Rgb, false);
    let cut = colour[..colour.len() - 7].to_vec();
    let files = [colour, jpeg(side, ColorType::Luma, true), cut, Vec::new(), b"\x89PNG and so on".to_vec()];
    let image = |(i, bytes)| Image { name: format!("{i}.jpg"), mime: "image/jpeg".into(), bytes, previews: Vec::new() };
    mesh.appearance.images = files.into_iter().enumerate().map(image).collect();
    mesh
}

fn encoded(mesh: &Mesh, schedule: Schedule, images: Exactness) -> Encoded {
    encode(mesh, &EncodeOptions::default().schedule(schedule).images(images)).unwrap()
}

fn front(bytes: &[u8]) -> FileIndex {
    match FileIndex::parse(bytes) {
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
            let ways: Vec<Treatment> = report.images.iter().map(|i| i.way).collect();
            let progressive = if exactness == Exactness::Bytes { Treatment::Cut } else { Treatment::Transcoded };
            assert!(matches!(ways[..], [Treatment::Transcoded, _, Treatment::Kept(_), Treatment::Kept(_)]), "{ways:?}");
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
                let (step, decoder) = run(&bytes[..end as usize]);
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
        let of = |c: &&lodestream::format::container::ChunkInfo| (c.kind, c.image, c.segment) == (kind, image, segment);
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
        offer(&mut decoder, Kind::Reconstruction, 0, 0),
        Err(format!("level 0: the reconstruction of an image before the image{tail}"))
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
    let mut mesh = textured(40);
    mesh.appearance.images[0].previews = vec![vec![0xFF, 0xD8, 0xFF, 0]];
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

/// The chunks of a file with their payloads.
fn chunks(bytes: &[u8]) -> (FileIndex, Vec<Chunk>) {
    let front = front(bytes);
    let chunk = |k: usize| front.chunks()[k].chunk(front.payload(bytes, k).unwrap().unwrap().to_vec());
    let chunks = (0..front.chunks().len()).map(chunk).collect();
    (front, chunks)
}

/// A mesh with two previews of a JPEG, one of something else, and one of an image that is not there.
fn previewed() -> Mesh {
    let mut mesh = textured(150);
    let images = &mut mesh.appearance.images;
    images[0].previews = vec![jpeg(8, ColorType::Rgb, false), jpeg(20, ColorType::Rgb, true)];
    images[3].previews = vec![jpeg(8, ColorType::Luma, false)];
    images[4].mime = "image/png".into();
    images[4].previews = vec![jpeg(16, ColorType::Luma, false)];
    mesh
}

#[test]
fn previews_stand_in_until_something_better_comes() {
    let mesh = previewed();
    let images = &mesh.appearance.images;
    for schedule in Schedule::ALL {
        for exactness in EXACTNESS {
            let Encoded { bytes, report, .. } = encoded(&mesh, schedule, exactness);
            let lengths = |i: usize| images[i].previews.iter().map(|p| p.len() as u64 + 2).collect::<Vec<_>>();
            // What has no bytes has no previews, and no report.
            assert_eq!(report.images[3].previews, lengths(4));
            assert_eq!(report.images[0].previews, lengths(0));
            assert_eq!(report.bits.previews, 8.0 * lengths(0).iter().chain(&lengths(4)).sum::<u64>() as f64);
            let (front, chunks) = chunks(&bytes);
            let mut there = [0, 0];
            for (k, info) in front.chunks().iter().enumerate() {
                let (step, decoder) = run(&bytes[..info.end() as usize]);
                assert!(matches!(step, Ok(Step::NeedBytes | Step::Full)), "{step:?}");
                let Some(found) = decoder.appearance().cloned() else { continue };
                if info.kind == Kind::Preview {
                    let preview = Preview::of(&chunks[k].payload).unwrap();
                    there[usize::from(preview.image == 4)] = 1 + preview.number as usize;
                }
                // One of no bytes is there with what stands before it.
                let begun = |i: u32| {
                    front.chunks().iter().any(|c| c.kind == Kind::Image && c.image == i && c.end() <= info.end())
                };
                for (i, there) in [(0, there[0]), (4, there[1])] {
                    let image = &found.images[i as usize];
                    let (mime, own) = (image.mime.as_str(), &images[i as usize]);
                    match (begun(i), there) {
                        (false, 0) => assert_eq!((mime, image.bytes.len()), (own.mime.as_str(), 0)),
                        (false, n) => assert_eq!((mime, &image.bytes), ("image/jpeg", &own.previews[n - 1])),
                        (true, _) => assert!(mime == own.mime && !own.previews.contains(&image.bytes)),
                    }
                }
                assert!(found.images.iter().all(|i| i.previews.is_empty()));
                let missing = decoder.missing_images();
                let none = (0..5u32).filter(|&i| !(begun(i) || i == 0 && there[0] > 0 || i == 4 && there[1] > 0));
                assert_eq!(missing.none, none.count());
            }
            assert_eq!(there, [2, 1]);
            // The coarsest come in front of all levels but the first.
            let place = |of: &dyn Fn(&Chunk) -> bool| chunks.iter().position(of).unwrap();
            assert_eq!(place(&|c| c.kind == Kind::Preview), place(&|c| c.kind == Kind::Appearance) + 1);
            // Without them, and with all of them at the end, it is the same at the full level.
            let (whole, without) = (run(&bytes).1.to_mesh(), |c: &Chunk| c.kind != Kind::Preview);
            let (kept, cut): (Vec<Chunk>, Vec<Chunk>) = chunks.into_iter().partition(without);
            for chunks in [kept.clone(), [kept, cut].concat()] {
                let file = write(front.header(), &chunks).unwrap();
                let (end, decoder) = run(&file);
                assert_eq!((end, decoder.to_mesh()), (Ok(Step::Full), whole.clone()));
            }
            let plain = encoded(&textured(150), schedule, exactness).bytes;
            let mut plain = run(&plain).1.to_mesh();
            plain.appearance.images[4].mime = "image/png".into();
            assert_eq!(plain, whole);
        }
    }
}

#[test]
fn previews_that_make_no_sense_are_passed_over() {
    let mesh = textured(150);
    let bytes = encoded(&mesh, Schedule::MeshFirst, Exactness::Coefficients).bytes;
    let whole = run(&bytes).1.to_mesh();
    let (front, chunks) = chunks(&bytes);
    let small = jpeg(8, ColorType::Rgb, false);
    let of = |image, number, bytes: &[u8]| Chunk::preview(0, &Preview { image, number, bytes });
    let appearance = chunks.iter().position(|c| c.kind == Kind::Appearance).unwrap();
    let with = |at: usize, extra: &[Chunk]| {
        let file: Vec<Chunk> = [&chunks[..at], extra, &chunks[at..]].concat();
        let file = write(front.header(), &file).unwrap();
        let (end, decoder) = run(&file);
        assert_eq!((end, decoder.to_mesh()), (Ok(Step::Full), whole.clone()));
        let first = FileIndex::parse(&file).unwrap();
        let Parsed::Ready(first) = first else { panic!("a front") };
        let piece = first.chunks().iter().find(|c| c.kind == Kind::Image && c.image == 0).unwrap().offset;
        run(&file[..piece as usize]).1.appearance().unwrap().images[0].clone()
    };
    let shown = with(appearance + 1, &[of(0, 3, &small)]);
    assert_eq!((shown.bytes.as_slice(), shown.mime.as_str()), (&small[..], "image/jpeg"));
    // Coarser behind finer, the same number twice.
    let other = jpeg(9, ColorType::Rgb, false);
    assert_eq!(with(appearance + 1, &[of(0, 3, &small), of(0, 2, &other), of(0, 3, &other)]).bytes, small);
    assert_eq!(with(appearance + 1, &[of(0, 0, &small), of(0, u32::MAX, &other)]).bytes, other);
    let empty = Chunk { payload: Vec::new(), ..of(0, 0, &small) };
    let odd = Chunk { segment: 3, segments: 9, ..of(0, 0, b"GIF89a") };
    for wrong in [empty, odd, of(5, 0, &small), of(u32::MAX, 0, &small), of(0, 0, &[]), of(0, 0, &[0xFF, 0xD8])] {
        assert!(with(appearance + 1, &vec![wrong; 20]).bytes.is_empty());
    }
    // In front of the materials nothing is known of images.
    assert!(with(appearance, &[of(0, 0, &small)]).bytes.is_empty());
    // They take memory, which is counted before.
    let many: Vec<Chunk> = (0..20).map(|k| of(0, k, &small)).collect();
    let file = write(front.header(), &[&chunks[..=appearance], &many, &chunks[appearance + 1..]].concat()).unwrap();
    let Ok(Parsed::Ready(more)) = FileIndex::parse(&file) else { panic!("a front") };
    let full = front.full_level();
    assert_eq!(more.memory(full), front.memory(full) + 20 * (small.len() as u64 + 2));
}

#[test]
fn previews_may_be_fetched_apart() {
    let mesh = previewed();
    let bytes = encoded(&mesh, Schedule::MeshFirst, Exactness::Coefficients).bytes;
    let (front, chunks) = chunks(&bytes);
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(&bytes[..front.length() as usize]);
    assert_eq!(decoder.next_level(), Ok(Step::NeedBytes));
    for kind in [Kind::Appearance, Kind::Preview] {
        for (info, chunk) in front.chunks().iter().zip(&chunks).filter(|(c, _)| c.kind == kind) {
            decoder.offer(*info, chunk.payload.clone()).unwrap();
        }
    }
    assert_eq!(decoder.appearance().unwrap().images[0].bytes, mesh.appearance.images[0].previews[1]);
    assert_eq!(decoder.missing_images(), MissingImages { all: 5, none: 3, part: 2 });
    decoder.push(&bytes[front.length() as usize..]);
    while let Step::Level(_) = decoder.next_level().unwrap() {}
    assert_eq!(decoder.to_mesh(), run(&bytes).1.to_mesh());
}

/// Payloads that pass their checksums and are nonsense, and tables that contradict themselves.
#[test]
fn hostile_pictures_do_no_harm() {
    let mut mesh = textured(40);
    mesh.appearance.images[0].previews = vec![vec![0xFF, 0xD8, 0xFF, 0], b"\x89PNG".to_vec()];
    let bytes = encoded(&mesh, Schedule::Linear, Exactness::Bytes).bytes;
    let front = front(&bytes);
    let chunks: Vec<Chunk> = (0..front.chunks().len())
        .map(|k| {
            let c = front.chunks()[k];
            c.chunk(front.payload(&bytes, k).unwrap().unwrap().to_vec())
        })
        .collect();
    let pictures: Vec<usize> = (0..chunks.len())
        .filter(|&k| matches!(chunks[k].kind, Kind::Image | Kind::Reconstruction | Kind::Preview))
        .collect();
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
            4 => c.kind = [Kind::Image, Kind::Reconstruction, Kind::Preview][r.below(3)],
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
