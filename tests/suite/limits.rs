//! Limits hold: memory, work in proportion, coordinates that are numbers.

use crate::common::rock::rock;
use crate::common::{Scratch, lodestream};
use lodestream::encode::{EncodeOptions, encode};
use lodestream::format::container::{ContainerError, FileIndex};
use lodestream::image::preview::{Previews, add_previews};
use lodestream::image::recompress::{Textures, recompress};
use lodestream::mesh::{Appearance, Image, Mesh};

#[test]
fn encoding_stays_within_the_limit() {
    let s = rock("encode-limit");
    let run = lodestream(s.folder(), "encode rock.ply -o no.lods --memory-limit 250kB");
    assert_eq!(run.code, 1);
    let begins = "lodestream: rock.ply: encoding it takes about ";
    let ends = "250.0 kB are allowed; raise --memory-limit or cut the mesh into tiles\n";
    assert!(run.stderr.starts_with(begins) && run.stderr.ends_with(ends), "{}", run.stderr);
    assert!(!s.path("no.lods").exists());
    lodestream(s.folder(), "encode rock.ply -o yes.lods --memory-limit 10MB").ok();
}

#[test]
fn points_at_one_place_take_no_longer_than_others() {
    // A look at all pairs would take minutes here, in which the test is stopped.
    let mut positions = vec![[0.0; 3]; 60_000];
    positions.extend((0..60_000u32).map(|i| [f64::from(i % 40), f64::from(i / 40 % 40), f64::from(i / 1600)]));
    positions.push([1e6, 0.0, 0.0]);
    let mesh = Mesh { positions, ..Mesh::default() };
    let encoded = encode(&mesh, &EncodeOptions::default()).unwrap();
    assert_eq!(encoded.report.vertices, 120_001);
    assert_eq!(encoded.report.loss.merged, 60_000 - 1);
}

/// A PNG with these chunks behind its head, which says so many pixels of 8 bits of grey.
fn png(side: u32, chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut head = [side.to_be_bytes(), side.to_be_bytes()].concat();
    head.extend([8, 0, 0, 0, 0]);
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, data) in [(b"IHDR", head)].iter().chain(chunks) {
        out.extend((data.len() as u32).to_be_bytes());
        let body = [&kind[..], data].concat();
        out.extend(&body);
        out.extend(crc32fast::hash(&body).to_be_bytes());
    }
    out
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

fn reason(bytes: Vec<u8>) -> String {
    let image = Image { name: "a.png".into(), mime: "image/png".into(), bytes, ..Image::default() };
    let mut appearance = Appearance { images: vec![image], ..Appearance::default() };
    add_previews(&mut appearance, Previews::Auto);
    assert!(appearance.images[0].previews.is_empty());
    recompress(&mut appearance, Textures::Jpeg(90))[0].outcome.unwrap_err().to_string()
}

#[test]
fn what_a_png_holds_beside_pixels_is_bounded() {
    let mut profile = b"name\0\0".to_vec();
    profile.extend(zlib(&vec![0; 40 << 20]));
    let end = (b"IEND", Vec::new());
    let pixels = (b"IDAT", zlib(&[0; 2]));
    assert_eq!(
        reason(png(1, &[(b"iCCP", profile), pixels.clone(), end.clone()])),
        "its colour profile is damaged or too large"
    );
    assert_eq!(reason(png(65_535, &[pixels, end])), "it has more than 268,435,456 pixels");
}

#[test]
fn the_table_of_chunks_is_within_the_limit() {
    let s = rock("chunk-table");
    let file = std::fs::read(s.path("rock.lods")).unwrap();
    let needs = match FileIndex::parse_within(&file, 1000) {
        Err(ContainerError::MemoryLimit { needed, limit: 1000 }) => needed,
        other => panic!("{other:?}"),
    };
    assert!(FileIndex::parse_within(&file, needs).is_ok());
    let run = lodestream(s.folder(), "decode rock.lods -o o.ply --memory-limit 1kB");
    assert!(run.stderr.starts_with("lodestream: rock.lods: decoding needs about "), "{}", run.stderr);
}

#[test]
fn a_lattice_has_no_infinite_coordinates() {
    let s = Scratch::new("infinite-lattice");
    s.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for options in ["--position-step 1e308", "--position-step 1 --origin 1.797e308,0,0 "] {
        let run = lodestream(s.folder(), &format!("encode a.obj -o no.lods {options}"));
        assert!(run.code == 1 && run.stderr.lines().count() == 1, "{}", run.stderr);
    }
    let run = lodestream(s.folder(), "encode a.obj -o no.lods --position-step 1e308");
    assert!(run.stderr.contains("reaches coordinates that are infinite; choose a smaller step"), "{}", run.stderr);
}
