//! What the order of chunks is worth on textured models: `LODESTREAM_DATA=… cargo bench --bench schedule -- [MODEL…] [--full]`.
//!
//! Each model is encoded once; its chunks are then put in four orders. Prefixes of each are decoded as a viewer would, drawn and compared with the
//! whole file. Printed are the areas under the curves of mean MS-SSIM over the logarithm of bytes, from 10 kB to the whole file, the bytes
//! at which 0.95 and 0.99 are reached, and the same against Draco's single rate with the same images, which shows nothing before its
//! last byte. Images that are not JPEG become JPEG of quality 90 first, for both, but with `--keep`; with `--no-previews` images have none. `--full` looks with 42 views of 512² pixels, the
//! measure of quality; without it 12 views of 256² do. Without the data folder, or with `--smoke`, a generated model is measured.
#![allow(missing_docs)]

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use lodestream::encode::quality_order::{Effort, Options, by_quality};
use lodestream::encode::{EncodeOptions, Schedule, encode};
use lodestream::format::container::{FileIndex, Kind, Parsed, Preview};
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use lodestream::image::is_jpeg;
use lodestream::image::preview::{Previews, add_previews};
use lodestream::io::read::{ReadOptions, read_path};
use lodestream::io::write::{WriteOptions, write_path};
use lodestream::mesh::{Appearance, Image, Layer, LayerKind, Mesh, Stored};
use lodestream::quality::picture::{Shading, Textures, decode};
use lodestream::quality::{Snapshots, ViewOptions};
use lodestream::samples;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

const MODELS: [&str; 7] = [
    "textured/DamagedHelmet.glb",
    "textured/FlightHelmet/FlightHelmet.gltf",
    "textured/YcbBanana/textured_simple_reoriented.obj",
    "textured/Avocado/Avocado.gltf",
    "textured/spot/spot.obj",
    "textured/CesiumMilkTruck.glb",
    "textured/ToyCar/ToyCar.gltf",
];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let has = |word: &str| words.iter().any(|w| w == word);
    let wanted: Vec<&String> = words.iter().filter(|w| !w.starts_with("--")).collect();
    let effort = if has("--full") { Effort::High } else { Effort::Normal };
    println!("views {:?}; scheduled with views {:?}", effort.views(), Effort::default().views());
    println!(
        "{:<26}{:>9}{:>9} |{:>9}{:>9}{:>9}{:>9} | {:>9}{:>9} |{:>10}{:>8}{:>8}{:>8} |{:>8}",
        "model",
        "vertices",
        "bytes",
        "quality",
        "mesh",
        "texture",
        "linear",
        "at 0.95",
        "at 0.99",
        "Draco",
        "0.95",
        "0.99",
        "whole",
        "seconds"
    );
    let data = std::env::var_os("LODESTREAM_DATA").filter(|_| !has("--smoke")).map(PathBuf::from);
    let Some(data) = data else {
        let side = if has("--smoke") { 128 } else { 1024 };
        measure("generated", ball(if has("--smoke") { 12 } else { 120 }, side), effort);
        return;
    };
    for model in MODELS.iter().filter(|m| wanted.is_empty() || wanted.iter().any(|w| m.contains(w.as_str()))) {
        match read_path(data.join(model), &ReadOptions::default()) {
            Ok(read) => measure(model.rsplit('/').next().unwrap_or(model), read.mesh, effort),
            Err(why) => println!("{model}: skipped, {why}"),
        }
    }
}

/// A state of a file: its level, and the number of previews and pieces of images.
type State = (u32, usize, usize);

fn measure(name: &str, mut mesh: Mesh, effort: Effort) {
    let has = |word: &str| std::env::args().any(|a| a == word);
    let shown = Textures::shown(&mesh.appearance);
    for (image, &shown) in mesh.appearance.images.iter_mut().zip(&shown) {
        if !has("--keep") {
            to_jpeg(image, shown);
        }
    }
    add_previews(&mut mesh.appearance, if has("--no-previews") { Previews::None } else { Previews::Auto });
    let file = |schedule| {
        let options = EncodeOptions::default().schedule(schedule);
        encode(&mesh, &options).expect("it encodes").bytes
    };
    let orders = [Schedule::MeshFirst, Schedule::TextureFirst, Schedule::Linear];
    let mut files: Vec<Vec<u8>> = orders.into_iter().map(file).collect();
    let clock = Instant::now();
    let scheduled = by_quality(&files[0], &Options::default(), &|_, _| {}).expect("it can be put in order");
    let seconds = clock.elapsed().as_secs_f64();
    files.insert(0, scheduled.bytes);

    let (views, size) = effort.views();
    let options = ViewOptions { views, size, shading: Shading::Smooth };
    let snapshots = Snapshots::new(&last(&files[0]), &options).expect("pictures");
    let mut known = HashMap::new();
    let curves: Vec<Vec<(u64, f64)>> = files.iter().map(|file| curve(file, &shown, &snapshots, &mut known)).collect();
    let areas: Vec<f64> = curves.iter().map(|curve| area(curve, files[0].len() as u64)).collect();
    let reached = |quality: f64| curves[0].iter().find(|p| p.1 >= quality).map_or(files[0].len() as u64, |p| p.0);
    let [fair, good] = [0.95, 0.99].map(reached);
    let whole = files[0].len() as u64;
    let draco = draco(&mesh);
    let ratio = |bytes: u64| draco.map_or("".to_string(), |d| format!("{:.3}", bytes as f64 / d as f64));
    println!(
        "{name:<26}{:>9}{whole:>9} |{:>9.4}{:>9.4}{:>9.4}{:>9.4} | {fair:>9}{good:>9} |{:>10}{:>8}{:>8}{:>8} |{seconds:>8.1}",
        mesh.vertex_count(),
        areas[0],
        areas[1],
        areas[2],
        areas[3],
        draco.map_or("none".to_string(), |d| d.to_string()),
        ratio(fair),
        ratio(good),
        ratio(whole),
    );
    if has("--curves") {
        for (name, curve) in ["quality", "mesh-first", "texture-first", "linear"].iter().zip(&curves) {
            println!("{name}: {}", curve.iter().map(|(b, q)| format!("{b} {q:.4}")).collect::<Vec<_>>().join(", "));
        }
    }
}

/// Opaque images as JPEG: colours with halved chroma, anything else without.
fn to_jpeg(image: &mut Image, colour: bool) {
    let Ok(pixels) = decode(&image.bytes) else { return };
    let fits = pixels.width <= 65_000 && pixels.height <= 65_000;
    if is_jpeg(&image.bytes) || !fits || pixels.rgba.chunks_exact(4).any(|p| p[3] < 255) {
        return;
    }
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, 90);
    encoder.set_sampling_factor(if colour { SamplingFactor::F_2_2 } else { SamplingFactor::F_1_1 });
    encoder.encode(&pixels.rgba, pixels.width as u16, pixels.height as u16, ColorType::Rgba).expect("pixels");
    image.bytes = out;
    image.mime = "image/jpeg".into();
    image.name = Path::new(&image.name).with_extension("jpg").to_string_lossy().into_owned();
}

/// Bytes and quality after each change of what a viewer has.
fn curve(file: &[u8], shown: &[bool], snapshots: &Snapshots, known: &mut HashMap<State, f64>) -> Vec<(u64, f64)> {
    let Ok(Parsed::Ready(front)) = FileIndex::parse(file) else { panic!("a file") };
    let mut decoder = Decoder::new(DecodeOptions::default());
    let (mut previews, mut pieces, mut level, mut done) = (0, 0, None, 0);
    let mut points: Vec<(u64, f64)> = Vec::new();
    for (i, c) in front.chunks().iter().enumerate() {
        decoder.push(&file[done..c.end() as usize]);
        done = c.end() as usize;
        while let Ok(Step::Level(at)) = decoder.next_level() {
            level = Some(at);
        }
        let Some(at) = level else { continue };
        // Which of the images it belongs to, if it belongs to one.
        let image = |i: usize| match front.chunks()[i].kind {
            Kind::Image => Some(front.chunks()[i].image as usize),
            Kind::Preview => Preview::of(front.payload(file, i).ok()??).map(|p| p.image as usize),
            _ => None,
        };
        let seen = image(i).is_some_and(|image| shown[image]);
        if seen {
            let all = if c.kind == Kind::Image { &mut pieces } else { &mut previews };
            *all += 1;
        }
        // Small steps are left to the next one; the last one that changes anything counts.
        let rest = (i + 1..front.chunks().len()).any(|i| image(i).is_none_or(|image| shown[image]));
        let before = points.last().map_or(0, |p| p.0);
        if rest && (c.end() as f64) < 1.12 * before as f64 || !seen && image(i).is_some() {
            continue;
        }
        let quality = *known
            .entry((at, previews, pieces))
            .or_insert_with(|| snapshots.compare(&decoder.to_mesh()).expect("pictures").ms_ssim);
        points.push((c.end(), quality));
    }
    points
}

fn last(file: &[u8]) -> Mesh {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(file);
    while let Ok(Step::Level(_)) = decoder.next_level() {}
    decoder.to_mesh()
}

/// The mean quality over the logarithm of bytes, from 10 kB to the whole file.
fn area(curve: &[(u64, f64)], whole: u64) -> f64 {
    let place = |bytes: u64| (bytes.clamp(10_000, whole.max(10_001)) as f64).ln();
    let ends = curve.iter().skip(1).map(|p| p.0).chain([whole]);
    let sum: f64 = curve.iter().zip(ends).map(|(p, end)| p.1 * (place(end) - place(p.0))).sum();
    sum / (place(whole) - place(0))
}

/// Draco's mesh and the images, bytes; `None` where it is not installed or refuses.
fn draco(mesh: &Mesh) -> Option<u64> {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("schedule-bench");
    std::fs::create_dir_all(&folder).ok()?;
    let (obj, drc) = (folder.join("mesh.obj"), folder.join("mesh.drc"));
    let mut bare = mesh.clone();
    bare.appearance = Appearance::default();
    bare.material = Vec::new();
    write_path(&obj, &bare, None, &WriteOptions::default()).ok()?;
    let run = Command::new("draco_encoder")
        .args(["-qp", "12", "-qt", "12", "-qn", "10", "-cl", "10", "-i"])
        .arg(&obj)
        .arg("-o")
        .arg(&drc)
        .output()
        .ok()?;
    let bytes = std::fs::metadata(&drc).ok().filter(|_| run.status.success())?.len();
    let _ = std::fs::remove_dir_all(&folder);
    Some(bytes + mesh.appearance.images.iter().map(|i| i.bytes.len() as u64).sum::<u64>())
}

/// A bumpy ball with a picture on it.
fn ball(detail: u32, side: u16) -> Mesh {
    let mut mesh = samples::asteroid(detail, 5);
    let values = mesh.positions.iter().flat_map(|p| {
        let up = p[2] / p.iter().map(|c| c * c).sum::<f64>().sqrt();
        [p[1].atan2(p[0]) / std::f64::consts::TAU + 0.5, 0.5 + 0.5 * up]
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
    let mut pixels = Vec::new();
    for y in 0..u32::from(side) {
        for x in 0..u32::from(side) {
            let wave = (f64::from(x) * 0.05).sin() * (f64::from(y) * 0.07).cos();
            let grain = f64::from((x * 7919 + y * 104_729) % 31);
            pixels.extend([0.0, 20.0, 40.0].map(|k| (110.0 + 60.0 * wave + grain + k) as u8));
        }
    }
    let mut bytes = Vec::new();
    Encoder::new(&mut bytes, 90).encode(&pixels, side, side, ColorType::Rgb).expect("pixels");
    mesh.appearance = Appearance {
        materials: vec![r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#.into()],
        textures: vec![r#"{"source":0}"#.into()],
        samplers: Vec::new(),
        images: vec![Image { name: "colour".into(), mime: "image/jpeg".into(), bytes, previews: Vec::new() }],
    };
    mesh
}
