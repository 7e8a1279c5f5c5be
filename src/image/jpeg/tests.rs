use super::*;
use crate::image::jpeg::frame::{Blocks, Tables};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use proptest::prelude::*;

/// A picture with edges, slopes and some noise.
fn picture(width: u16, height: u16, channels: usize) -> Vec<u8> {
    let mut noise = 12345u32;
    let mut out = Vec::new();
    for y in 0..height as u32 {
        for x in 0..width as u32 {
            for c in 0..channels as u32 {
                noise = noise.wrapping_mul(1664525).wrapping_add(1013904223);
                let edge = if (x / 13 + y / 7 + c) % 3 == 0 { 90 } else { 0 };
                out.push((x * (c + 2) / 2 + y * 2 + edge + (noise >> 29)) as u8);
            }
        }
    }
    out
}

/// A file by an encoder that is not ours.
fn jpeg(width: u16, height: u16, color: ColorType, set: impl FnOnce(&mut Encoder<&mut Vec<u8>>)) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, 85);
    set(&mut encoder);
    let channels = match color {
        ColorType::Luma => 1,
        ColorType::Rgb => 3,
        _ => 4,
    };
    encoder.encode(&picture(width, height, channels), width, height, color).unwrap();
    out
}

/// Pixels by a decoder that is not ours.
fn pixels(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut decoder = zune_jpeg::JpegDecoder::new(std::io::Cursor::new(bytes));
    decoder.decode().map_err(|e| format!("{e:?}"))
}

fn coefficients(file: &[u8]) -> Blocks {
    let parsed = Parsed::new(file).unwrap();
    let frame = Frame::new(&parsed, MAX_COEFFICIENT_BYTES).unwrap();
    match parsed.process {
        0xC2 => progressive::decode(&parsed, &frame).unwrap(),
        _ => {
            let mut blocks = sequential::decode(&parsed, &frame).unwrap();
            frame.take_filling(&mut blocks);
            blocks
        }
    }
}

/// Kinds of baseline files.
fn kinds() -> Vec<(&'static str, Vec<u8>)> {
    let sampled = |factor| move |e: &mut Encoder<&mut Vec<u8>>| e.set_sampling_factor(factor);
    vec![
        ("4:2:0", jpeg(160, 120, ColorType::Rgb, sampled(SamplingFactor::F_2_2))),
        ("4:4:4", jpeg(160, 120, ColorType::Rgb, sampled(SamplingFactor::F_1_1))),
        ("4:2:2", jpeg(160, 120, ColorType::Rgb, sampled(SamplingFactor::F_2_1))),
        ("4:4:0", jpeg(160, 120, ColorType::Rgb, sampled(SamplingFactor::F_1_2))),
        ("4:1:1", jpeg(160, 120, ColorType::Rgb, sampled(SamplingFactor::F_4_1))),
        ("grey", jpeg(160, 120, ColorType::Luma, |_| ())),
        ("CMYK", jpeg(160, 120, ColorType::Cmyk, |_| ())),
        ("YCCK", jpeg(160, 120, ColorType::CmykAsYcck, |_| ())),
        ("odd, 4:2:0", jpeg(133, 71, ColorType::Rgb, sampled(SamplingFactor::F_2_2))),
        ("one row, 4:2:0", jpeg(97, 1, ColorType::Rgb, sampled(SamplingFactor::F_2_2))),
        ("one pixel", jpeg(1, 1, ColorType::Rgb, |_| ())),
        ("odd grey", jpeg(65, 9, ColorType::Luma, |_| ())),
        ("restarts", jpeg(160, 120, ColorType::Rgb, |e| e.set_restart_interval(3))),
        (
            "restarts, odd, 4:2:0",
            jpeg(131, 77, ColorType::Rgb, |e| {
                e.set_restart_interval(1);
                e.set_sampling_factor(SamplingFactor::F_2_2);
            }),
        ),
        ("best tables", jpeg(160, 120, ColorType::Rgb, |e| e.set_optimized_huffman_tables(true))),
        (
            "ICC and EXIF",
            jpeg(160, 120, ColorType::Rgb, |e| {
                e.add_icc_profile(&[7; 70_000]).unwrap();
                e.add_app_segment(1, b"Exif\0\0 some tags").unwrap();
            }),
        ),
    ]
}

#[test]
fn baseline_files_become_progressive_with_the_same_coefficients_pixels_and_segments() {
    for (name, file) in kinds() {
        let Pieces { pieces, reconstruction, way, .. } = cut(&file, Exactness::Coefficients);
        assert_eq!((way, reconstruction), (Treatment::Transcoded, None), "{name}");
        let joined = pieces.concat();
        assert_eq!(coefficients(&joined), coefficients(&file), "{name}");
        match (pixels(&joined), pixels(&file)) {
            // It also sees other pixels in a baseline file of one scan for each component; libjpeg-turbo sees the same in both.
            (Ok(_), Ok(_)) if name == "best tables" => {}
            (Ok(ours), Ok(seen)) => assert!(ours == seen, "{name}"),
            // zune-jpeg 0.5.15 sizes its buffers wrongly for progressive files of four components that are not sampled alike, whoever
            // wrote them; libjpeg-turbo reads ours, with the pixels of the baseline file.
            (Err(_), _) if ["CMYK", "YCCK"].contains(&name) => {}
            (ours, seen) => panic!("{name}: {ours:?}, {seen:?}"),
        }
        let segments = |bytes: &[u8]| {
            let parsed = Parsed::new(bytes).unwrap();
            let kept = |i: &Item<'_>| match *i {
                Item::Segment { marker, bytes } if frame::stays(marker) => Some(bytes[2..].to_vec()),
                _ => None,
            };
            parsed.items.iter().filter_map(kept).collect::<Vec<_>>()
        };
        assert_eq!(segments(&joined), segments(&file), "{name}");
        assert!(same_picture(&joined, &file), "{name}");
        eprintln!("{name}: {} bytes baseline, {} progressive, {} pieces", file.len(), joined.len(), pieces.len());
    }
}

#[test]
fn a_recipe_gives_the_very_bytes() {
    for (name, mut file) in kinds() {
        file.extend_from_slice(b"bytes behind the end");
        let Pieces { pieces, reconstruction, way, .. } = cut(&file, Exactness::Bytes);
        assert_eq!(way, Treatment::Transcoded, "{name}");
        let (joined, reconstruction) = (pieces.concat(), reconstruction.unwrap());
        assert_eq!(Parsed::new(&joined).unwrap().process, 0xC2, "{name}");
        assert!(reconstruction.len() < 3000, "{name}: {}", reconstruction.len());
        assert!(restore(&joined, &reconstruction, MAX_COEFFICIENT_BYTES).unwrap() == file, "{name}");
        assert_eq!(
            restore(&joined, &reconstruction, 100).unwrap_err().to_string(),
            "its coefficients take more memory than is allowed"
        );
    }
}

#[test]
fn every_prefix_of_the_pieces_is_a_picture_that_gets_better() {
    let file = jpeg(400, 300, ColorType::Rgb, |e| e.set_sampling_factor(SamplingFactor::F_2_2));
    let Pieces { pieces, .. } = cut(&file, Exactness::Coefficients);
    assert!(pieces.len() >= 4, "{}", pieces.len());
    let full = pixels(&file).unwrap();
    let mut before = f64::INFINITY;
    for n in 1..=pieces.len() {
        let mut prefix = pieces[..n].concat();
        if n < pieces.len() {
            prefix.extend_from_slice(&END);
        }
        let seen = pixels(&prefix).unwrap();
        assert_eq!(seen.len(), full.len());
        let error = seen.iter().zip(&full).map(|(&a, &b)| (a as f64 - b as f64).powi(2)).sum::<f64>();
        assert!(error <= before * 1.02, "piece {n}: {error} after {before}");
        before = error;
    }
    assert_eq!(before, 0.0);
}

#[test]
fn progressive_files_are_coded_anew_where_that_is_smaller_and_else_cut_as_they_are() {
    for color in [ColorType::Rgb, ColorType::Luma] {
        let file = jpeg(400, 300, color, |e| e.set_progressive(true));
        let ours = cut(&file, Exactness::Coefficients);
        let joined = ours.pieces.concat();
        assert_eq!((ours.way, ours.reconstruction), (Treatment::Transcoded, None));
        assert!(joined.len() < file.len());
        assert!(same_picture(&joined, &file));
        assert_eq!(pixels(&joined).unwrap(), pixels(&file).unwrap());
        for (file, exactness) in [(&joined, Exactness::Coefficients), (&file, Exactness::Bytes)] {
            let Pieces { pieces, reconstruction, way, .. } = cut(file, exactness);
            assert_eq!((way, reconstruction), (Treatment::Cut, None));
            assert!(pieces.len() > 1);
            assert_eq!(&pieces.concat(), file);
            assert!(pieces.iter().all(|p| matches!(p, Cow::Borrowed(_))));
            let mut first = pieces[0].to_vec();
            first.extend_from_slice(&END);
            assert_eq!(pixels(&first).unwrap().len(), pixels(file).unwrap().len());
        }
    }
}

#[test]
fn what_is_odd_stays_as_it_is_and_the_reason_is_told() {
    let file = jpeg(160, 120, ColorType::Rgb, |_| ());
    let reason = |bytes: &[u8]| {
        let Pieces { pieces, reconstruction, way, .. } = cut(bytes, Exactness::Coefficients);
        assert_eq!((pieces, reconstruction), (vec![Cow::Borrowed(bytes)], None));
        match way {
            Treatment::Kept(odd) => odd.to_string(),
            other => panic!("{other:?}"),
        }
    };
    let of = |marker: u8| file.windows(2).position(|w| w == [0xFF, marker]).unwrap();
    let with = |at: usize, byte: u8| {
        let mut bytes = file.clone();
        bytes[at] = byte;
        bytes
    };
    assert_eq!(reason(b""), "it is no JPEG");
    assert_eq!(reason(b"\x89PNG\r\n\x1a\n"), "it is no JPEG");
    assert_eq!(reason(&file[..file.len() - 2]), "it is cut: its end marker is missing");
    let frame = of(0xC0);
    assert_eq!(reason(&with(frame + 1, 0xC9)), "it is arithmetic-coded");
    assert_eq!(reason(&with(frame + 1, 0xC3)), "it is a lossless or hierarchical JPEG");
    assert_eq!(reason(&with(frame + 4, 12)), "it has more than 8 bits per sample");
    // Larger dimensions than the data can hold.
    let mut large = with(frame + 5, 0xFF);
    assert_eq!(reason(&large), "it is cut: there are fewer bytes than its blocks need");
    large[frame + 7] = 0xFF;
    assert_eq!(reason(&large), "its coefficients take more memory than is allowed");
    let mut half = file[..file.len() * 2 / 3].to_vec();
    half.extend_from_slice(&END);
    assert!(reason(&half).starts_with("it is cut or damaged") || reason(&half).starts_with("it is damaged"));
    let mut pictures = file.clone();
    pictures.splice(2..2, *b"\xFF\xE2\x00\x08MPF\0\x01\x02");
    assert!(reason(&pictures).starts_with("it holds several pictures"));
}

/// A baseline file of these coefficients, every sampling that the format has.
fn build(size: [u16; 2], sampling: &[[u8; 2]], restart: u16, fill: impl FnMut() -> i16) -> Vec<u8> {
    let mut fill = fill;
    let mut head = vec![0xFF, 0xD8, 0xFF, 0xC0, 0, 8 + 3 * sampling.len() as u8, 8];
    head.extend_from_slice(&size[1].to_be_bytes());
    head.extend_from_slice(&size[0].to_be_bytes());
    head.push(sampling.len() as u8);
    for (i, s) in sampling.iter().enumerate() {
        head.extend_from_slice(&[i as u8 * 5, s[0] << 4 | s[1], 0]);
    }
    head.extend_from_slice(&[0xFF, 0xDD, 0, 4]);
    head.extend_from_slice(&restart.to_be_bytes());
    // Nearly all symbols with eight bits.
    let mut counts = [0u8; 16];
    (counts[7], counts[8]) = (254, 2);
    for which in [0u8, 0x10] {
        head.extend_from_slice(&[0xFF, 0xC4]);
        head.extend_from_slice(&(19u16 + 256).to_be_bytes());
        head.push(which);
        head.extend_from_slice(&counts);
        head.extend(0..=255u8);
    }
    let mut shell = head.clone();
    shell.extend_from_slice(&[0xFF, 0xDA, 0, 2, 0xFF, 0xD9]);
    let parsed = Parsed::new(&shell).unwrap();
    let frame = Frame::new(&parsed, u64::MAX).unwrap();
    let mut blocks = frame.empty();
    for block in &mut blocks {
        for (k, value) in block.iter_mut().enumerate() {
            *value = fill() >> if k == 0 { 0 } else { 1 };
        }
    }
    let mut tables = Tables::default();
    for item in &parsed.items {
        if let Item::Segment { marker, bytes } = *item {
            tables.take(marker, bytes).unwrap();
        }
    }
    let all: Vec<usize> = (0..sampling.len()).collect();
    let scans = if frame.interleaves(&all) { vec![all] } else { all.into_iter().map(|c| vec![c]).collect() };
    let mut out = head;
    for list in scans {
        let list: Vec<(usize, u8)> = list.into_iter().map(|c| (c, 0)).collect();
        let header = frame.scan_header(&list, [0, 63], [0, 0]);
        out.extend_from_slice(&header);
        sequential::encode_scan(&frame, &header, &tables, &blocks, &mut out).unwrap();
    }
    out.extend_from_slice(&END);
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_coefficients_and_sampling_come_back(
        size in [1u16..70, 1u16..70],
        sampling in prop::collection::vec([1u8..=4, 1u8..=4], 1..=4),
        restart in 0u16..5,
        seed: u64,
        dense in 0u32..60,
    ) {
        let mut state = seed | 1;
        let fill = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let sparse = (state >> 33) as u32 % 64 > dense;
            // Sizes of all powers, small ones more often.
            if sparse { 0 } else { ((state >> 50) as i16 & 2047) - 1023 >> (state >> 40 & 15).min(10) }
        };
        let file = build(size, &sampling, restart, fill);
        let Pieces { pieces, reconstruction, way, .. } = cut(&file, Exactness::Bytes);
        prop_assert_eq!(way, Treatment::Transcoded);
        let joined = pieces.concat();
        prop_assert!(coefficients(&joined) == coefficients(&file));
        prop_assert!(restore(&joined, &reconstruction.unwrap(), MAX_COEFFICIENT_BYTES).unwrap() == file);
    }

    #[test]
    fn damage_is_an_answer_and_no_crash(at in 0usize..3000, byte: u8, cut_at in 0usize..4000, kind in 0usize..16) {
        let (_, file) = kinds().swap_remove(kind);
        let mut bytes = file.clone();
        let n = bytes.len();
        bytes[at % n] = byte;
        bytes.truncate(n - cut_at.min(n) / 40);
        let answer = cut(&bytes, Exactness::Coefficients);
        if let Treatment::Kept(_) | Treatment::Cut = answer.way {
            prop_assert_eq!(answer.pieces.concat(), bytes);
        }
        let answer = cut(&file, Exactness::Bytes);
        let (mut joined, mut reconstruction) = (answer.pieces.concat(), answer.reconstruction.unwrap());
        let (n, m) = (joined.len(), reconstruction.len());
        joined[at % n] = byte;
        let _ = restore(&joined, &reconstruction, 1 << 26);
        reconstruction[at % m] = byte;
        let _ = restore(&answer.pieces.concat(), &reconstruction, 1 << 26);
    }
}

/// Every JPEG of the data sets, by whatever encoder; none, and a word about it, where there are none.
fn real_files() -> Vec<(String, Vec<u8>)> {
    let Ok(folder) = std::env::var("LODESTREAM_DATA") else {
        eprintln!("skipped: textures of the data sets (LODESTREAM_DATA is not set)");
        return Vec::new();
    };
    let mut folders = vec![std::path::PathBuf::from(folder)];
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if path.is_dir() {
                folders.push(path);
            } else if ["jpg", "jpeg"].contains(&extension.as_str()) {
                files.push((name, std::fs::read(path).unwrap()));
            } else if extension == "glb" {
                let bytes = std::fs::read(path).unwrap();
                let starts = bytes.windows(3).enumerate().filter(|(_, w)| *w == [0xFF, 0xD8, 0xFF]).map(|(i, _)| i);
                // Up to where its parser finds the end.
                for at in starts {
                    if let Ok(parsed) = Parsed::new(&bytes[at..]) {
                        let end = bytes.len() - parsed.trailer.len();
                        files.push((format!("{name} at {at}"), bytes[at..end].to_vec()));
                    }
                }
            }
        }
    }
    files.sort();
    files
}

/// Sizes and exactness on real textures.
#[test]
fn real_textures_come_back() {
    for (name, file) in real_files() {
        let clock = std::time::Instant::now();
        let answer = cut(&file, Exactness::Bytes);
        let (joined, seconds) = (answer.pieces.concat(), clock.elapsed().as_secs_f64());
        let stops: Vec<usize> = answer
            .pieces
            .iter()
            .scan(0, |sum, p| {
                *sum += p.len();
                Some(*sum * 100 / joined.len())
            })
            .collect();
        eprintln!("{name}: {} -> {} bytes, {:?}, {stops:?} %, {seconds:.2} s", file.len(), joined.len(), answer.way);
        match answer.reconstruction {
            Some(reconstruction) => {
                assert!(restore(&joined, &reconstruction, MAX_COEFFICIENT_BYTES).unwrap() == file, "{name}")
            }
            None => assert!(joined == file, "{name}"),
        }
    }
}
