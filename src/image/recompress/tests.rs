use super::*;
use png::{BitDepth, ColorType, Encoder};

/// A picture with edges, slopes and a little noise; one byte for each channel of each pixel.
fn picture(width: usize, height: usize, channels: usize) -> Vec<u8> {
    let mut noise = 7u32;
    let mut out = Vec::new();
    for y in 0..height {
        for x in 0..width {
            for c in 0..channels {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let edge = if (x / 16 + y / 20) % 2 == 0 { 50 } else { 0 };
                out.push((40 + edge + x * (c + 1) / 3 % 100 + y / 2 + (noise >> 29) as usize).min(255) as u8);
            }
        }
    }
    out
}

fn png(width: u32, height: u32, color: ColorType, depth: BitDepth, data: &[u8], profile: Option<&[u8]>) -> Vec<u8> {
    let mut out = Vec::new();
    let mut info = png::Info::with_size(width, height);
    info.color_type = color;
    info.bit_depth = depth;
    if color == ColorType::Indexed {
        info.palette = Some(vec![10, 20, 30, 200, 100, 50].into());
    }
    info.icc_profile = profile.map(|p| p.to_vec().into());
    let mut writer = Encoder::with_info(&mut out, info).unwrap().write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    out
}

fn image(name: &str, bytes: Vec<u8>) -> Image {
    Image { name: name.into(), mime: "image/png".into(), bytes, previews: Vec::new() }
}

/// Samples by a decoder that is not ours, as many as are expected: it repeats those of grey.
fn samples(bytes: &[u8], count: usize) -> Vec<u8> {
    let all = zune_jpeg::JpegDecoder::new(Cursor::new(bytes)).decode().unwrap();
    if all.len() == 3 * count { all.into_iter().step_by(3).collect() } else { all }
}

/// Signal to noise, in decibels.
fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    10.0 * (255.0f64.powi(2) * a.len() as f64 / sum.max(1e-9)).log10()
}

/// One texture for each image, and materials that use them.
fn appearance(images: Vec<Image>, materials: &[&str]) -> Appearance {
    Appearance {
        materials: materials.iter().map(|m| m.to_string()).collect(),
        textures: (0..images.len()).map(|i| format!("{{\"source\":{i}}}")).collect(),
        samplers: Vec::new(),
        images,
    }
}

#[test]
fn images_become_what_they_are_for() {
    let rgb = || png(120, 91, ColorType::Rgb, BitDepth::Eight, &picture(120, 91, 3), None);
    let grey: Vec<u8> = picture(120, 91, 1).iter().flat_map(|&g| [g; 3]).collect();
    let images = vec![
        image("colour", rgb()),
        image("normal", rgb()),
        image("both", rgb()),
        image("unused", rgb()),
        image("", png(120, 91, ColorType::Rgb, BitDepth::Eight, &grey, None)),
        image("glow", rgb()),
    ];
    let materials = [
        r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0},"metallicRoughnessTexture":{"index":2}},"normalTexture":{"index":1}}"#,
        r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":2}},"emissiveTexture":{"index":4},
            "extensions":{"KHR_materials_sheen":{"sheenColorTexture":{"index":5}}}}"#,
    ];
    let mut all = appearance(images, &materials);
    let before = all.clone();
    assert_eq!(recompress(&mut all, Textures::Keep), []);
    assert_eq!(all, before);
    let report = recompress(&mut all, Textures::Jpeg(90));
    let outcomes: Vec<_> = report.iter().map(|r| r.outcome.unwrap()).collect();
    assert_eq!(
        outcomes,
        [Sampling::Halved, Sampling::Full, Sampling::Full, Sampling::Full, Sampling::Grey, Sampling::Halved]
    );
    assert_eq!((report[4].image, report[4].name.as_str()), (4, "image 4"));
    for (r, image) in report.iter().zip(&all.images) {
        assert_eq!((r.to, image.mime.as_str()), (image.bytes.len() as u64, "image/jpeg"));
        assert!(r.to < r.from);
        let (expected, least) = match r.outcome {
            Ok(Sampling::Grey) => (picture(120, 91, 1), 38.0),
            Ok(Sampling::Full) => (picture(120, 91, 3), 38.0),
            // The noise of each channel by itself is not there.
            _ => (picture(120, 91, 3), 24.0),
        };
        let noise = psnr(&samples(&image.bytes, expected.len()), &expected);
        eprintln!("{}: {} to {} bytes, {noise:.1} dB", r.name, r.from, r.to);
        assert!(noise > least, "{}: {noise}", r.name);
    }
    // What is JPEG now stays so.
    let once = all.clone();
    assert_eq!(recompress(&mut all, Textures::Jpeg(10)), []);
    assert_eq!(all, once);
}

#[test]
fn colour_keeps_its_samples_where_they_differ() {
    // Slopes lose nothing, stripes as narrow as a pixel all of it, stripes of two pixels on even columns nothing.
    let of = |pixel: fn(usize, usize) -> [u8; 3]| {
        let (width, height) = (65, 33);
        let samples: Vec<u8> = (0..width * height).flat_map(|i| pixel(i % width, i / width)).collect();
        loss_by_halving(width, &samples)
    };
    assert!(of(|x, y| [x as u8 * 3, y as u8 * 4, 100]) < MOST_LOST / 2);
    assert_eq!(of(|x, y| [((x + y) % 7 * 30) as u8; 3]), 0);
    assert_eq!(of(|x, _| if x / 2 % 2 == 0 { [200, 0, 0] } else { [0, 0, 200] }), 0);
    // Blue moves by (-33.7 - 100) / 2 and red by (100 + 16.3) / 2 around their means.
    let stripes = of(|x, _| if x % 2 == 0 { [200, 0, 0] } else { [0, 0, 200] });
    let expected = 256.0 * (66.87f64.powi(2) + 58.13f64.powi(2)) / 2.0;
    assert!((stripes as f64 / expected - 1.0).abs() < 0.01, "{stripes} {expected}");
    // No partner, nothing to lose; and nothing to divide by.
    assert_eq!((loss_by_halving(1, &[9; 30]), loss_by_halving(0, &[])), (0, 0));
    // The largest sums there are.
    assert!(of(|x, y| if (x + y) % 2 == 0 { [255, 0, 0] } else { [0, 255, 255] }) > MOST_LOST);
}

#[test]
fn odd_sizes_and_profiles_survive() {
    for (width, height) in [(1, 1), (7, 9), (17, 8), (8, 33), (250, 3)] {
        for sampling in [Sampling::Grey, Sampling::Halved, Sampling::Sharp, Sampling::Full] {
            let samples = picture(width, height, if sampling == Sampling::Grey { 1 } else { 3 });
            let profile = vec![5u8; 100_000];
            let of = Pixels { width: width as u16, height: height as u16, samples: &samples, profile: Some(&profile) };
            let file = jpeg(&of, 95, sampling).unwrap();
            let noise = psnr(&self::samples(&file, samples.len()), &samples);
            let least = match sampling {
                Sampling::Halved => 20.0,
                Sampling::Sharp => 33.0,
                _ => 37.0,
            };
            assert!(noise > least, "{width}x{height} {sampling:?}: {noise}");
            let mut decoder = zune_jpeg::JpegDecoder::new(Cursor::new(&file));
            decoder.decode_headers().unwrap();
            assert_eq!(decoder.icc_profile(), Some(profile));
        }
    }
    let none = Pixels { width: 0, height: 5, samples: &[], profile: None };
    assert_eq!(jpeg(&none, 90, Sampling::Full).unwrap_err().to_string(), "its pixels are not as many as it says");
}

#[test]
fn what_jpeg_cannot_say_stays_and_the_reason_is_told() {
    let one = |bytes: Vec<u8>| {
        let mut all = appearance(vec![image("x.png", bytes.clone())], &[]);
        let report = recompress(&mut all, Textures::Jpeg(90));
        let [Recompressed { outcome, from, to, .. }] = &report[..] else { panic!("{report:?}") };
        if outcome.is_err() {
            assert_eq!((&all.images[0], from), (&image("x.png", bytes), to));
        }
        outcome.map_err(|e| e.to_string())
    };
    let stays = |why: &str| Err(why.to_string());
    let mut rgba = picture(64, 64, 4);
    let of = |data: &[u8], color, depth| png(64, 64, color, depth, data, None);
    assert_eq!(one(of(&rgba, ColorType::Rgba, BitDepth::Eight)), stays("it has alpha"));
    rgba.chunks_exact_mut(4).for_each(|p| p[3] = 255);
    assert_eq!(one(of(&rgba, ColorType::Rgba, BitDepth::Eight)), Ok(Sampling::Full));
    let deep = one(of(&picture(64, 64, 6), ColorType::Rgb, BitDepth::Sixteen));
    assert_eq!(deep, stays("it has 16 bits per sample"));
    // A chessboard of two colours is smaller as it is.
    assert_eq!(one(of(&[0x55; 512], ColorType::Indexed, BitDepth::One)), stays("it would not become smaller"));
    let sound = of(&picture(64, 64, 3), ColorType::Rgb, BitDepth::Eight);
    assert_eq!(one(sound[..sound.len() / 2].to_vec()), stays("it is damaged"));
    // A head that promises more than its bytes can hold.
    let mut large = of(&[0; 512], ColorType::Grayscale, BitDepth::One);
    large[18..20].copy_from_slice(&[0xFF, 0xFF]);
    let sum = crc32fast::hash(&large[12..29]).to_be_bytes();
    large[29..33].copy_from_slice(&sum);
    assert_eq!(one(large), stays("it is damaged"));
    assert_eq!(one(b"RIFF....WEBP".to_vec()), stays("it is neither PNG nor JPEG"));
}

#[test]
fn choices_are_read_as_they_are_written() {
    for choice in [Textures::Keep, Textures::Fine, Textures::Jpeg(1), Textures::Jpeg(100)] {
        assert_eq!(choice.to_string().parse(), Ok(choice));
    }
    assert_eq!(Textures::beside(Exactness::Coefficients), Textures::default());
    assert_eq!(Textures::beside(Exactness::Bytes), Textures::Keep);
    for wrong in ["jpg", "jpeg:", "jpeg:0", "jpeg:101", "png", ""] {
        assert_eq!(
            wrong.parse::<Textures>().unwrap_err(),
            format!("{wrong:?} is not keep, jpeg, or jpeg:QUALITY from 1 to 100, as in jpeg:90")
        );
    }
}

/// Sizes and likeness on the PNG files of the data sets.
#[cfg(feature = "quality")]
#[test]
fn real_textures_become_smaller() {
    let Ok(folder) = std::env::var("LODESTREAM_DATA") else {
        eprintln!("skipped: PNG textures of the data sets (LODESTREAM_DATA is not set)");
        return;
    };
    let mut folders = vec![std::path::PathBuf::from(folder).join("textured")];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for path in entries.map(|e| e.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "png") {
                let bytes = std::fs::read(&path).unwrap();
                let name = path.file_name().unwrap().to_string_lossy();
                let materials = [r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#];
                let materials = if name.contains("ormal") { &[][..] } else { &materials[..] };
                for choice in [Textures::Fine, Textures::Jpeg(85), Textures::Jpeg(90), Textures::Jpeg(95)] {
                    let mut all = appearance(vec![image(&name, bytes.clone())], materials);
                    let report = recompress(&mut all, choice);
                    let Recompressed { from, to, outcome, .. } = &report[0];
                    let Ok(sampling) = outcome else {
                        eprintln!("{name}, {choice}: {from} bytes, {outcome:?}");
                        continue;
                    };
                    let before = read(&bytes).unwrap();
                    let after = samples(&all.images[0].bytes, before.samples.len());
                    let noise = psnr(&after, &before.samples);
                    let ssim = likeness(&before, &after);
                    eprintln!("{name}, {choice}: {from} -> {to} bytes, {sampling:?}, {noise:.1} dB, MS-SSIM {ssim:?}");
                    if choice == Textures::Fine {
                        let least = if *sampling == Sampling::Full { 41.0 } else { 35.0 };
                        assert!(noise > least && ssim.is_none_or(|s| s > 0.997), "{name}: {noise}, {ssim:?}");
                    }
                }
            }
        }
    }
}

/// MS-SSIM of luma, where pictures are large enough for it.
#[cfg(feature = "quality")]
fn likeness(before: &super::Picture, after: &[u8]) -> Option<f64> {
    let picture = |samples: &[u8]| {
        let rgb = if before.channels == 1 { samples.iter().flat_map(|&g| [g; 3]).collect() } else { samples.to_vec() };
        crate::quality::picture::Picture { width: before.width.into(), height: before.height.into(), rgb }
    };
    crate::quality::ms_ssim(&picture(&before.samples), &picture(after)).ok()
}
