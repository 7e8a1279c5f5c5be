//! The order by quality: the same file in another order, each prefix of which looks at least as good.
#![cfg(all(feature = "encode", feature = "quality", feature = "recompress", feature = "samples"))]

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use lodestream::encode::quality_order::{Effort, Options, ScheduleError, Scheduled, by_quality};
use lodestream::encode::{EncodeOptions, Schedule, encode};
use lodestream::format::container::{ChunkInfo, FileIndex, Kind, Parsed, Preview};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::image::preview::{Previews, add_previews};
use lodestream::io::write::{WriteOptions, write_path};
use lodestream::mesh::{Appearance, Image, Layer, LayerKind, Mesh, Stored};
use lodestream::quality::picture::Shading;
use lodestream::quality::{Snapshots, ViewOptions};
use lodestream::samples;

const OPTIONS: Options = Options { effort: Effort::Low, image_cache: 1 << 30, memory_limit: 1 << 30 };

/// Spots of all sizes, as a JPEG of another encoder.
fn spots(side: u16, seed: u32) -> Vec<u8> {
    let mut pixels = Vec::new();
    for y in 0..u32::from(side) {
        for x in 0..u32::from(side) {
            let mut value = 0.0f64;
            for octave in 1..6 {
                let size = f64::from(side) / f64::from(1 << octave);
                let (u, v) = (f64::from(x) / size, f64::from(y) / size);
                value += (u + f64::from(seed)).sin() * (v * 1.3 + f64::from(octave)).cos() / f64::from(octave);
            }
            let grain = (x * 7919 + y * 104_729 + seed) % 23;
            pixels.extend([0, 1, 2].map(|k| (128.0 + 50.0 * value + f64::from(grain) + f64::from(k * 9)) as u8));
        }
    }
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, 90);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder.encode(&pixels, side, side, ColorType::Rgb).expect("a picture");
    out
}

/// A bumpy ball with a colour image, and a normal map that pictures do not show.
fn textured(side: u16) -> Mesh {
    let mut mesh = samples::asteroid(24, 5);
    let values = mesh.positions.iter().flat_map(|p| {
        let around = p[1].atan2(p[0]) / std::f64::consts::TAU + 0.5;
        let up = p[2] / p.iter().map(|c| c * c).sum::<f64>().sqrt();
        [around, 0.5 + 0.5 * up]
    });
    mesh.layers = vec![Layer {
        name: "TEXCOORD_0".into(),
        kind: LayerKind::Uv,
        width: 2,
        stored: Stored::F32,
        values: values.collect(),
        corners: mesh.corners.clone(),
        isolated: Vec::new(),
    }];
    mesh.material = vec![0; mesh.face_count()];
    let material = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}},"normalTexture":{"index":1}}"#;
    let image = |name: &str, seed| Image {
        name: name.into(),
        mime: "image/jpeg".into(),
        bytes: spots(side, seed),
        previews: Vec::new(),
    };
    mesh.appearance = Appearance {
        materials: vec![material.into()],
        textures: vec![r#"{"source":0}"#.into(), r#"{"source":1}"#.into()],
        samplers: Vec::new(),
        images: vec![image("colour", 1), image("normals", 2)],
    };
    mesh.validate().expect("a sound mesh");
    mesh
}

fn file(mesh: &Mesh, schedule: Schedule) -> Vec<u8> {
    let options = EncodeOptions::default().schedule(schedule);
    encode(mesh, &options).expect("it encodes").bytes
}

fn ordered(file: &[u8]) -> Scheduled {
    by_quality(file, &OPTIONS, &|_, _| {}).expect("it can be put in order")
}

fn front(bytes: &[u8]) -> FileIndex {
    match FileIndex::parse(bytes) {
        Ok(Parsed::Ready(front)) => front,
        other => panic!("{other:?}"),
    }
}

/// What a viewer has of the first bytes of a file.
fn prefix(bytes: &[u8]) -> Mesh {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    while let Step::Level(_) = decoder.next_level().expect("prefixes decode") {}
    decoder.to_mesh()
}

#[test]
fn the_same_file_in_another_order() {
    let mesh = textured(256);
    let plain = file(&mesh, Schedule::MeshFirst);
    let scheduled = ordered(&plain);
    assert_ne!(scheduled.bytes, plain);
    // The table of chunks takes a few bytes more or less.
    assert!(scheduled.bytes.len().abs_diff(plain.len()) < 32);
    assert_eq!(prefix(&scheduled.bytes), prefix(&plain));
    let mut chunks = [&plain, &scheduled.bytes].map(|bytes| {
        let chunks: Vec<_> = front(bytes).chunks().iter().map(|c| (c.kind, c.image, c.segment, c.checksum)).collect();
        chunks
    });
    // The normal map is not seen: it comes last.
    let last = chunks[1].last().expect("chunks");
    assert_eq!((last.0, last.1), (Kind::Image, 1));
    chunks.iter_mut().for_each(|c| c.sort_by_key(|c| (c.0.number(), c.1, c.2, c.3)));
    assert_eq!(chunks[0], chunks[1]);
    // Images that are decoded again for every look are the same.
    let again = by_quality(&plain, &Options { image_cache: 0, ..OPTIONS }, &|_, _| {}).expect("it can be put in order");
    assert!(again.bytes == scheduled.bytes);
    // Wherever it comes from.
    for schedule in [Schedule::TextureFirst, Schedule::Linear] {
        assert_eq!(ordered(&file(&mesh, schedule)).bytes, scheduled.bytes, "{schedule}");
    }
    assert_eq!(ordered(&scheduled.bytes).bytes, scheduled.bytes);
    // And with any number of threads.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    assert_eq!(one.install(|| ordered(&plain).bytes), scheduled.bytes);
}

/// What stands in front of which of the images, in order.
fn pictures(bytes: &[u8]) -> Vec<(Kind, u32, u32)> {
    let front = front(bytes);
    let row = |(i, c): (usize, &ChunkInfo)| match c.kind {
        Kind::Image => Some((c.kind, c.image, c.segment)),
        Kind::Preview => {
            let preview = Preview::of(front.payload(bytes, i).ok()??)?;
            Some((c.kind, preview.image, preview.number))
        }
        _ => None,
    };
    front.chunks().iter().enumerate().filter_map(row).collect()
}

#[test]
fn previews_come_where_they_are_worth_it() {
    let mut mesh = textured(512);
    add_previews(&mut mesh.appearance, Previews::Auto);
    assert!(mesh.appearance.images.iter().all(|i| !i.previews.is_empty()));
    let plain = file(&mesh, Schedule::MeshFirst);
    let Scheduled { bytes, curve, areas, .. } = ordered(&plain);
    assert!(areas.chosen >= areas.mesh_first.max(areas.texture_first).max(areas.linear), "{areas:?}");
    assert_eq!(prefix(&bytes), prefix(&plain));
    // Those of the colour in front of its pieces; the normals, which are not seen, with theirs behind all that is seen.
    let order = pictures(&bytes);
    let first = order.iter().position(|p| p.0 == Kind::Image).expect("pieces");
    let count = mesh.appearance.images[0].previews.len();
    assert_eq!(first, count);
    assert!(order[..count].iter().enumerate().all(|(k, p)| *p == (Kind::Preview, 0, k as u32)), "{order:?}");
    let normals = order.iter().position(|p| p.1 == 1).expect("the other image");
    assert!(order[normals..].iter().all(|p| p.1 == 1) && order[normals].0 == Kind::Preview, "{order:?}");
    // The curve knows them, and says what pictures say.
    assert!(curve.iter().any(|p| p.previews > 0 && p.pieces == 0));
    assert_eq!(curve.last().map(|p| p.previews), Some(count));
    let (views, size) = OPTIONS.effort.views();
    let options = ViewOptions { views, size, shading: Shading::Smooth };
    let snapshots = Snapshots::new(&prefix(&plain), &options).expect("pictures");
    for point in curve.iter().filter(|p| p.previews > 0).step_by(3) {
        let seen = snapshots.compare(&prefix(&bytes[..point.bytes as usize])).expect("pictures").ms_ssim;
        assert!((seen - point.quality).abs() < 1e-3, "{point:?}: {seen}");
    }
    assert_eq!(ordered(&bytes).bytes, bytes);
    assert_eq!(ordered(&file(&mesh, Schedule::Linear)).bytes, bytes);
}

#[test]
fn no_order_is_better_by_the_pictures_of_its_prefixes() {
    let mesh = textured(256);
    let plain = file(&mesh, Schedule::MeshFirst);
    let Scheduled { bytes, curve, areas, drawn } = ordered(&plain);
    assert!(drawn > 10);
    for other in [areas.greedy, areas.mesh_first, areas.texture_first, areas.linear] {
        assert!(areas.chosen >= other, "{areas:?}");
    }
    assert!(areas.chosen > 1.01 * areas.mesh_first.max(areas.texture_first), "{areas:?}");
    assert!(curve.last().expect("points").quality > 1.0 - 1e-9);
    let front = front(&bytes);
    let seen_bytes = front.chunks().iter().rfind(|c| c.kind != Kind::Image || c.image == 0);
    assert_eq!(curve.last().map(|p| p.bytes), seen_bytes.map(|c| c.end()));
    assert!(curve.windows(2).all(|w| w[0].bytes < w[1].bytes && w[0].level <= w[1].level));
    // The curve says what the pictures of its prefixes say.
    let (views, size) = OPTIONS.effort.views();
    let options = ViewOptions { views, size, shading: Shading::Smooth };
    let snapshots = Snapshots::new(&prefix(&plain), &options).expect("pictures");
    for point in curve.iter().step_by(3) {
        let seen = snapshots.compare(&prefix(&bytes[..point.bytes as usize])).expect("pictures").ms_ssim;
        assert!((seen - point.quality).abs() < 1e-3, "{point:?}: {seen}");
    }
}

#[test]
fn files_without_pictures_stay_as_they_are() {
    let mut mesh = textured(64);
    let bare = samples::asteroid(12, 5);
    mesh.appearance.materials = vec!["{}".into()];
    for mesh in [bare, mesh, Mesh::default()] {
        let plain = file(&mesh, Schedule::Linear);
        let scheduled = ordered(&plain);
        assert_eq!((&scheduled.bytes, scheduled.drawn), (&plain, 0));
        assert_eq!(scheduled.curve.len(), 1);
    }
}

#[test]
fn what_cannot_be_put_in_order_says_why() {
    let plain = file(&textured(64), Schedule::MeshFirst);
    let why = |bytes: &[u8]| by_quality(bytes, &OPTIONS, &|_, _| {}).expect_err("no file").to_string();
    let half = plain.len() / 2;
    let cut = format!("the file is cut: {half} bytes of {}", plain.len());
    assert!(why(&plain[..half]).starts_with(&cut), "{}", why(&plain[..half]));
    assert_eq!(why(b"solid nothing"), FileIndex::parse(b"solid nothing").expect_err("no file").to_string());
    let mut flipped = plain.clone();
    *flipped.last_mut().expect("bytes") ^= 1;
    assert!(matches!(
        by_quality(&flipped, &OPTIONS, &|_, _| {}),
        Err(ScheduleError::Container(_) | ScheduleError::Decode(_))
    ));
    let small = Options { memory_limit: 1000, ..OPTIONS };
    assert!(by_quality(&plain, &small, &|_, _| {}).expect_err("no room").to_string().contains("memory"));
    assert_eq!("medium".parse::<Effort>().unwrap_err(), "\"medium\" is no effort; use low, normal or high");
}

#[test]
fn ingest_puts_files_in_order_as_encode_does() {
    let scratch = crate::common::Scratch::new("ordered");
    let folder = scratch.folder();
    write_path(scratch.path("ball.glb"), &textured(192), None, &WriteOptions::default()).expect("it is written");
    scratch.write("plain.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    scratch.write(
        "jobs.toml",
        "[[job]]\nsource = \"ball.glb\"\nschedule = \"quality\"\n[[job]]\nsource = \"plain.obj\"\n",
    );
    crate::common::lodestream(folder, "encode ball.glb -o one.lods --schedule quality --schedule-effort low").ok();
    crate::common::lodestream(
        folder,
        "ingest ball.glb plain.obj -o all --schedule quality --schedule-effort low --verify",
    )
    .ok();
    crate::common::lodestream(folder, "ingest --manifest jobs.toml -o listed --schedule-effort low").ok();
    // Ingest adds a stamp.
    let chunks = |name: &str| {
        let bytes = std::fs::read(scratch.path(name)).expect("an output");
        let chunks = front(&bytes).chunks().to_vec();
        let kept = chunks.iter().filter(|c| !matches!(c.kind, Kind::Other(_)));
        kept.map(|c| (c.kind, c.image, c.segment, c.checksum)).collect::<Vec<_>>()
    };
    let expected = chunks("one.lods");
    assert_eq!(chunks("all/ball.lods"), expected);
    assert_eq!(chunks("listed/ball.lods"), expected);
    // How closely is looked is a setting like others: another one is another output.
    let run = crate::common::lodestream(folder, "ingest ball.glb plain.obj -o all --schedule quality --resume").ok();
    assert!(run.stdout.contains("2: 2 done, 0 skipped"), "{}", run.stdout);
    let run = crate::common::lodestream(folder, "ingest ball.glb plain.obj -o all --schedule quality --resume").ok();
    assert!(run.stdout.contains("2: 0 done, 2 skipped"), "{}", run.stdout);
}
