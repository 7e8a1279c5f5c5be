use super::*;
use crate::mesh::Image;
use png::{BitDepth, ColorType};

/// A picture of slopes, edges and noise, one byte or two for each channel of each pixel.
fn samples(width: usize, height: usize, bytes: usize, mut of: impl FnMut(usize, usize, usize) -> usize) -> Vec<u8> {
    let mut noise = 3u32;
    let mut out = Vec::new();
    for y in 0..height {
        for x in 0..width {
            for c in 0..bytes {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                out.push((of(x, y, c) + (noise >> 28) as usize).min(255) as u8);
            }
        }
    }
    out
}

fn png(width: usize, height: usize, color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    out
}

/// Pixels by a decoder that is not ours: red, green, blue, alpha.
fn decoded(file: &[u8]) -> crate::quality::picture::Pixels {
    crate::quality::picture::decode(file).unwrap()
}

fn alone(bytes: Vec<u8>) -> Appearance {
    let material = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
    Appearance {
        materials: vec![material.into()],
        textures: vec![r#"{"source":0}"#.into()],
        samplers: Vec::new(),
        images: vec![Image { name: "x".into(), mime: String::new(), bytes, previews: Vec::new() }],
    }
}

fn previews(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut all = alone(bytes.to_vec());
    add_previews(&mut all, Previews::None);
    assert!(all.images[0].previews.is_empty());
    add_previews(&mut all, Previews::Auto);
    assert_eq!(all.images[0].bytes, bytes);
    all.images.remove(0).previews
}

/// Each preview is like the mean of the boxes of the image, weighted by alpha.
fn check(name: &str, file: &[u8], part: usize) -> Vec<Vec<u8>> {
    let found = previews(file);
    assert!(!found.is_empty(), "{name}");
    assert!(found.iter().map(Vec::len).sum::<usize>() * part <= file.len(), "{name}");
    let whole = decoded(file);
    let (w, h) = (whole.width as usize, whole.height as usize);
    for (small, next) in found.iter().zip(found.iter().skip(1)) {
        assert!(GROWTH * small.len() <= next.len(), "{name}");
    }
    for small in &found {
        let small = decoded(small);
        let (sw, sh) = (small.width as usize, small.height as usize);
        assert_eq!((sw * h).abs_diff(sh * w) / w.max(h), 0, "{name}: {sw} by {sh} of {w} by {h}");
        let mut sum = 0.0;
        for y in 0..sh {
            for x in 0..sw {
                let mut mean = [0.0; 4];
                let (rows, columns) = (y * h / sh..(y + 1) * h / sh, x * w / sw..(x + 1) * w / sw);
                let count = (rows.len() * columns.len()) as f64;
                for p in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
                    let p = &whole.rgba[4 * (p.0 * w + p.1)..][..4];
                    let alpha = f64::from(p[3]);
                    (0..3).for_each(|c| mean[c] += f64::from(p[c]) * alpha / count);
                    mean[3] += alpha / count;
                }
                let p = &small.rgba[4 * (y * sw + x)..][..4];
                let alpha = f64::from(p[3]);
                for c in 0..3 {
                    sum += ((f64::from(p[c]) * alpha - mean[c]) / 255.0).powi(2);
                }
                sum += (alpha - mean[3]).powi(2);
            }
        }
        let error = (sum / (4 * sw * sh) as f64).sqrt();
        eprintln!("{name}: {sw} by {sh}, off by {error:.2}");
        assert!(error < 6.0, "{name}: {error}");
    }
    found
}

#[test]
fn previews_of_png_are_small_pictures_of_it() {
    let slope = |x: usize, y: usize, c: usize| x / (2 + c) + y / 3 + if x / 32 % 2 == y / 40 % 2 { 40 } else { 0 };
    let rgb = samples(400, 300, 3, slope);
    let found = check("rgb", &png(400, 300, ColorType::Rgb, BitDepth::Eight, &rgb), 16);
    assert!(found.iter().all(|f| f.starts_with(&[0xFF, 0xD8])));
    let grey = samples(500, 611, 1, slope);
    let found = check("grey", &png(500, 611, ColorType::Grayscale, BitDepth::Eight, &grey), 16);
    // One component.
    assert!(found.iter().all(|f| eighth(f).unwrap().planes.len() == 1));
    // Every other byte is the high one.
    let deep = samples(400, 300, 6, |x, y, c| if c % 2 == 0 { slope(x, y, c / 2) } else { 7 });
    check("16 bits", &png(400, 300, ColorType::Rgb, BitDepth::Sixteen, &deep), 16);
    // Colours that nobody sees do not leak into those that are seen.
    let hole = |x: usize, y: usize| x / 8 % 3 == y / 8 % 3;
    // Sizes that halve, so that coarse sizes have the same boxes as if they were made of the image itself.
    let rgba = samples(512, 384, 4, |x, y, c| match (c, hole(x, y)) {
        (3, true) => 0,
        (3, false) => 240,
        (_, true) => 255,
        _ => slope(x, y, c) / 2,
    });
    let found = check("alpha", &png(512, 384, ColorType::Rgba, BitDepth::Eight, &rgba), 16);
    assert!(found.iter().all(|f| f.starts_with(b"\x89PNG")));
    let opaque: Vec<u8> = rgb.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    let plain = png(400, 300, ColorType::Rgb, BitDepth::Eight, &rgb);
    let found = previews(&png(400, 300, ColorType::Rgba, BitDepth::Eight, &opaque));
    assert_eq!(found.first(), previews(&plain).first(), "alpha that is everywhere 255 is none");
}

#[test]
fn previews_of_jpeg_come_from_its_first_coefficients() {
    let slope = |x: usize, y: usize, c: usize| x / (4 + c) + y / 5 + if x / 64 % 2 == y / 80 % 2 { 60 } else { 0 };
    for (name, width, height, channels) in [("colour", 800, 600, 3), ("odd", 611, 803, 3), ("grey", 1000, 700, 1)] {
        let data = samples(width, height, channels, slope);
        for sampling in [Sampling::Halved, Sampling::Full] {
            let sampling = if channels == 1 { Sampling::Grey } else { sampling };
            let pixels = Pixels { width: width as u16, height: height as u16, samples: &data, profile: None };
            let file = jpeg(&pixels, 95, sampling).unwrap();
            let found = check(name, &file, 33);
            assert!(decoded(&found[0]).width.max(decoded(&found[0]).height) <= 128);
        }
    }
}

#[test]
fn what_is_small_or_not_read_has_none() {
    let data = samples(400, 300, 3, |x, y, c| x + y * c);
    let sound = png(400, 300, ColorType::Rgb, BitDepth::Eight, &data);
    assert!(!previews(&sound).is_empty());
    let pixels = Pixels { width: 400, height: 300, samples: &data, profile: None };
    let file = jpeg(&pixels, 98, Sampling::Full).unwrap();
    let tiny = png(40, 30, ColorType::Rgb, BitDepth::Eight, &data[..40 * 30 * 3]);
    let other = [&b"RIFF....WEBP"[..], &data].concat();
    for wrong in [&sound[..sound.len() / 2], &file[..file.len() / 2], &tiny, &other, &[0xFF; 30_000], &[]] {
        assert_eq!(previews(wrong), Vec::<Vec<u8>>::new());
    }
    // A head that promises more than its bytes can hold.
    let mut large = sound;
    large[16..24].copy_from_slice(&[0, 0, 0xFF, 0xFF, 0, 0, 0xFF, 0xFF]);
    let sum = crc32fast::hash(&large[12..29]).to_be_bytes();
    large[29..33].copy_from_slice(&sum);
    assert_eq!(previews(&large), Vec::<Vec<u8>>::new());
}

#[test]
fn choices_are_read_as_they_are_written() {
    for choice in [Previews::Auto, Previews::None] {
        assert_eq!(choice.to_string().parse(), Ok(choice));
    }
    assert_eq!("some".parse::<Previews>().unwrap_err(), "\"some\" is not auto or none");
}

/// Sizes on the images of the data sets.
#[test]
fn real_textures_have_small_previews() {
    let Ok(folder) = std::env::var("LODESTREAM_DATA") else {
        eprintln!("skipped: images of the data sets (LODESTREAM_DATA is not set)");
        return;
    };
    let folder = std::path::PathBuf::from(folder).join("textured");
    for name in ["DamagedHelmet.glb", "CesiumMilkTruck.glb", "Avocado/Avocado.gltf", "spot/spot.obj", "WaterBottle.glb"]
    {
        let Ok(read) = crate::io::read::read_path(folder.join(name), &crate::io::read::ReadOptions::default()) else {
            eprintln!("skipped: {name}");
            continue;
        };
        let mut all = read.mesh.appearance;
        add_previews(&mut all, Previews::Auto);
        for image in &all.images {
            let sizes: Vec<(usize, u32)> = image.previews.iter().map(|p| (p.len(), decoded(p).width)).collect();
            eprintln!("{name}, {}: {} bytes, previews (bytes, width) {sizes:?}", image.name, image.bytes.len());
        }
    }
}
