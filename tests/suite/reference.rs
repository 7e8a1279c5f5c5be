//! The reference decoder in `reference`, written from docs/format alone, against the program, on the files of `golden/v1`
//! and `conformance`.
//!
//! While the format may still change, `LODESTREAM_BLESS=1 cargo test --test suite reference` writes `conformance` anew,
//! with its traces if python3 is there.
#![cfg(feature = "samples")]

use crate::common::outcome;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

fn tests() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests"].iter().collect()
}

/// Runs `check.py`; `None` where there is no python3.
fn check(arguments: &[&str]) -> Option<(bool, String)> {
    let script = tests().join("reference").join("check.py");
    let output = Command::new("python3").arg("-B").arg(script).args(arguments).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    Some((output.status.success(), text))
}

#[test]
fn the_reference_decoder_agrees_with_what_is_expected() {
    if std::env::var_os("LODESTREAM_BLESS").is_some() {
        return;
    }
    match check(&[]) {
        Some((true, _)) => {}
        Some((false, text)) => panic!("{text}"),
        None => {
            let what = "the_reference_decoder_agrees_with_what_is_expected: skipped, there is no python3";
            assert!(std::env::var("CI").as_deref() != Ok("true"), "{what}");
            eprintln!("{what}");
        }
    }
}

#[test]
fn conformance_files_decode_to_what_is_expected() {
    if std::env::var_os("LODESTREAM_BLESS").is_some() {
        return;
    }
    let folder = tests().join("conformance");
    let mut files = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "lods") {
            let name = path.file_stem().unwrap().to_str().unwrap();
            let expected = fs::read_to_string(path.with_extension("expected")).unwrap();
            assert_eq!(outcome::expected(name, &fs::read(&path).unwrap()), expected, "{name}");
            files += 1;
        }
    }
    assert!(files >= 20, "{files} files");
}

#[cfg(feature = "encode")]
mod files {
    use super::{check, tests};
    use crate::common::{outcome, small};
    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
    use lodestream::encode::{EncodeOptions, Schedule, encode};
    use lodestream::format::container::{Chunk, FileIndex, Kind, Parsed, write};
    use lodestream::image::jpeg::Exactness;
    use lodestream::mesh::{Image, Layer, LayerKind, Mesh, NO_VALUE, Stored};
    use lodestream::samples::{asteroid, crumbs, mixed, point_cloud, soup, sphere, torus};
    use small::{Random, file, with_attributes};
    use std::fs;

    /// Taken from the golden files.
    const GOLDEN: [&str; 11] = [
        "empty",
        "tetrahedron",
        "non-manifold",
        "repeating",
        "mixed",
        "uv-sphere",
        "dressed-soup",
        "dressed-repeating",
        "facets",
        "colours",
        "coloured-points",
    ];

    /// Stars of more than 64 elements, polygons of more than 64 corners, isolated vertices.
    fn wide() -> Mesh {
        let mut mesh = Mesh::default();
        let ring = 90u32;
        mesh.positions.push([0.0, 0.0, 1.0]);
        for i in 0..ring {
            let (s, c) = (f64::from(i) * std::f64::consts::TAU / f64::from(ring)).sin_cos();
            mesh.positions.push([c, s, 0.1 * f64::from(i % 3)]);
        }
        for i in 0..ring {
            mesh.push_face(&[0, 1 + i, 1 + (i + 1) % ring]);
        }
        let below: Vec<u32> = (1..=ring).rev().collect();
        mesh.push_face(&below);
        for i in 0..40 {
            let at = mesh.positions.len() as u32;
            mesh.positions.push([2.0, f64::from(i) * 0.05, f64::from(i % 7) * 0.1]);
            if i % 3 == 0 {
                mesh.push_face(&[0, at]);
            }
        }
        mesh
    }

    /// Smooth layers of all kinds, a seam of normals, elements without values, three materials and some of none.
    fn smooth(mut mesh: Mesh) -> Mesh {
        let n = mesh.vertex_count();
        let mut r = Random(31);
        let corners = mesh.corners.clone();
        let per_vertex = |name: &str, kind, width: u8, stored, of: &dyn Fn([f64; 3]) -> Vec<f64>| {
            let values = mesh.positions.iter().flat_map(|&p| of(p)).collect();
            Layer::per_vertex(name, kind, width, stored, values, &corners, n)
        };
        let uv = per_vertex("uv", LayerKind::Uv, 2, Stored::F32, &|[x, y, z]| vec![x + 0.1 * z, y * 0.5 + 0.2 * x * z]);
        let mut normal = per_vertex("normal", LayerKind::Normal, 3, Stored::F32, &|[x, y, z]| vec![x, y, z + 0.3]);
        let tangent = per_vertex("tangent", LayerKind::Tangent, 4, Stored::F32, &|[x, y, z]| {
            vec![-y, x, 0.2 + z, if x > 0.4 { -1.0 } else { 1.0 }]
        });
        let colour = per_vertex("color", LayerKind::Color, 3, Stored::U8, &|p| {
            p.iter().map(|c| ((c.sin() * 120.0 + 128.0).floor() / 255.0).clamp(0.0, 1.0)).collect()
        });
        let mut scalar = per_vertex("heat", LayerKind::Scalar, 1, Stored::F64, &|[x, y, z]| vec![x * y * 1e3 - z]);
        // A crease: other normals on one side of a plane.
        let old = normal.values.len() as u32 / 3;
        let more: Vec<f64> = normal.values.iter().map(|x| -x).collect();
        normal.values.extend(more);
        let mut corner = 0;
        for face in mesh.faces() {
            let turned = face.iter().map(|&v| mesh.positions[v as usize][0]).sum::<f64>() > 0.0;
            let none = r.below(9) == 0;
            for _ in face {
                normal.corners[corner] += if turned { old } else { 0 };
                if none {
                    scalar.corners[corner] = NO_VALUE;
                }
                corner += 1;
            }
        }
        let material = |f: &[u32]| (mesh.positions[f[0] as usize][1] * 1.5 + 1.5) as u32;
        mesh.material = mesh.faces().map(|f| if r.below(12) == 0 { NO_VALUE } else { material(f).min(2) }).collect();
        mesh.layers = vec![uv, normal, tangent, colour, scalar];
        let text = |name| format!(r#"{{"name":"{name}","doubleSided":true}}"#);
        mesh.appearance.materials = ["north", "middle", "south"].map(text).to_vec();
        mesh
    }

    fn jpeg(width: u16, height: u16, sampling: SamplingFactor, progressive: bool, restarts: u16) -> Vec<u8> {
        let mut r = Random(9);
        let mut pixels = Vec::new();
        for y in 0..height as usize {
            for x in 0..width as usize {
                for c in 0..3 {
                    pixels.push(
                        (x * (c + 1) + y * 2 + if (x / 9 + y / 14) % 2 == 0 { 60 } else { 0 } + r.below(24)) as u8,
                    );
                }
            }
        }
        let mut out = Vec::new();
        let mut encoder = Encoder::new(&mut out, 85);
        encoder.set_sampling_factor(sampling);
        encoder.set_progressive(progressive);
        encoder.set_restart_interval(restarts);
        encoder.add_app_segment(1, b"Exif\0\0 tags").unwrap();
        encoder.encode(&pixels, width, height, ColorType::Rgb).unwrap();
        out
    }

    fn pictured(images: Exactness, schedule: Schedule) -> Vec<u8> {
        let mut mesh = with_attributes(torus(9, 7), 4);
        let colour = jpeg(75, 61, SamplingFactor::F_2_2, false, 0);
        let cut = colour[..colour.len() - 7].to_vec();
        let mut behind = jpeg(40, 33, SamplingFactor::F_2_1, false, 3);
        behind.extend(b"behind its end");
        let files = [colour, jpeg(66, 50, SamplingFactor::F_1_1, true, 0), behind, cut, b"\x89PNG and so on".to_vec()];
        let image =
            |(i, bytes)| Image { name: format!("{i}.jpg"), mime: "image/jpeg".into(), bytes, previews: Vec::new() };
        mesh.appearance.images = files.into_iter().enumerate().map(image).collect();
        mesh.appearance.images[0].previews =
            vec![jpeg(8, 6, SamplingFactor::F_2_2, false, 0), jpeg(16, 12, SamplingFactor::F_2_2, false, 0)];
        encode(&mesh, &EncodeOptions::default().images(images).schedule(schedule)).unwrap().bytes
    }

    /// With a source stamp in front of all else, and a chunk of a kind that no decoder knows in the middle.
    fn with_optional_chunks(bytes: &[u8]) -> Vec<u8> {
        let Ok(Parsed::Ready(front)) = FileIndex::parse(bytes) else { panic!("a front") };
        let chunk = |k: usize| front.chunks()[k].chunk(front.payload(bytes, k).unwrap().unwrap().to_vec());
        let mut chunks: Vec<Chunk> = (0..front.chunks().len()).map(chunk).collect();
        let optional = |kind, payload| Chunk {
            kind: Kind::Other(kind),
            first_level: front.full_level(),
            last_level: front.full_level(),
            segment: 0,
            segments: 1,
            image: 0,
            memory: 0,
            payload,
        };
        chunks.insert(1, optional(200, b"not known".to_vec()));
        chunks.insert(0, optional(128, [&[1][..], &[17; 64]].concat()));
        write(front.header(), &chunks).unwrap()
    }

    /// Borders stay, so level 0 has elements.
    fn locked(mesh: &Mesh) -> Vec<u8> {
        encode(mesh, &EncodeOptions::default().lock_borders(true)).unwrap().bytes
    }

    fn all() -> Vec<(&'static str, Vec<u8>)> {
        let mut out: Vec<_> = small::files().into_iter().filter(|(name, _)| GOLDEN.contains(name)).collect();
        assert_eq!(out.len(), GOLDEN.len());
        out.extend([
            ("triangles", file(&asteroid(14, 3), 12)),
            ("quads", file(&torus(30, 20), 12)),
            ("cloud", file(&point_cloud(1500, 5), 12)),
            ("components", file(&crumbs(300, 6), 14)),
            ("fine-lattice", file(&sphere(5, 0.04, 9), 21)),
            ("wide", file(&wide(), 12)),
            ("smooth", file(&smooth(mixed(16, 14, 8)), 12)),
            ("pieces", pictured(Exactness::Coefficients, Schedule::TextureFirst)),
            ("exact-images", pictured(Exactness::Bytes, Schedule::Linear)),
            ("optional-chunks", with_optional_chunks(&file(&asteroid(4, 1), 12))),
            ("locked-polygons", locked(&mixed(9, 8, 8))),
            ("locked-wide", locked(&wide())),
            ("locked-soup", locked(&with_attributes(soup(30, 70, 5), 21))),
            ("crowd", file(&with_attributes(soup(16, 110, 7), 3), 8)),
            ("segments", file(&torus(160, 130), 9)),
        ]);
        out
    }

    #[test]
    fn conformance_files_are_blessed_when_asked_for() {
        if std::env::var_os("LODESTREAM_BLESS").is_none() {
            return;
        }
        let folder = tests().join("conformance");
        let mut total = 0;
        for (name, bytes) in all() {
            fs::write(folder.join(name).with_extension("lods"), &bytes).unwrap();
            fs::write(folder.join(name).with_extension("expected"), outcome::expected(name, &bytes)).unwrap();
            total += bytes.len();
        }
        assert!(total < 200_000, "{total} bytes of conformance files");
        let segments = fs::read(folder.join("segments.lods")).unwrap();
        let Ok(Parsed::Ready(front)) = FileIndex::parse(&segments) else { panic!("a front") };
        assert!(front.chunks().iter().any(|c| c.kind == Kind::Segment), "no batch of several segments");
        if let Some((whole, text)) = check(&["--bless"]) {
            assert!(whole, "{text}");
        }
    }
}
