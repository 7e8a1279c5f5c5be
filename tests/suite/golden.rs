//! Files of this version of the format decode for ever: `golden/v1` holds them, and what they decode to.
//!
//! While the format may still change, `LODESTREAM_BLESS=1 cargo test --test suite golden` writes them anew.
#![cfg(feature = "samples")]

use crate::common::small;
#[cfg(feature = "encode")]
use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
use std::fs;
use std::path::PathBuf;

fn folder() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests", "golden", "v1"].iter().collect()
}

/// What a file decodes to: levels, vertices, faces (those that repeat a vertex included), and a checksum of every
/// level's coordinates, elements and parents, and of the degenerate faces.
fn describe(name: &str, bytes: &[u8]) -> String {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    let mut sum = crc32fast::Hasher::new();
    let mut put = |n: u32| sum.update(&n.to_le_bytes());
    let mut levels = 0;
    loop {
        match decoder.next_level().unwrap_or_else(|error| panic!("{name}: {error}")) {
            Step::Level(_) => levels += 1,
            Step::Full => break,
            Step::NeedBytes => panic!("{name}: it ends early"),
        }
        let level = decoder.complex();
        put(level.shift as u32);
        level.positions.iter().flatten().for_each(|&c| put(c as u32));
        level.faces.start.iter().chain(&level.faces.corners).for_each(|&c| put(c));
        decoder.parents().iter().for_each(|&p| put(p));
        for layer in &decoder.attributes().layers {
            layer.corner.iter().for_each(|&w| put(w));
            layer.values.iter().for_each(|&x| put(x as u32));
        }
        decoder.attributes().labels.iter().for_each(|&l| put(l as u32));
    }
    if let Some(degenerate) = decoder.degenerate() {
        degenerate.start.iter().chain(&degenerate.corners).for_each(|&c| put(c));
    }
    decoder.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    let mesh = decoder.to_mesh();
    mesh.validate().unwrap_or_else(|error| panic!("{name}: {error}"));
    // Coordinates too, bit for bit.
    let mut put = |n: u64| sum.update(&n.to_le_bytes());
    mesh.positions.iter().flatten().for_each(|c| put(c.to_bits()));
    for layer in &mesh.layers {
        layer.values.iter().for_each(|x| put(x.to_bits()));
        layer.corners.iter().chain(layer.isolated.as_flattened()).for_each(|&i| put(i as u64));
        layer.name.bytes().for_each(|b| put(b as u64));
    }
    mesh.material.iter().for_each(|&m| put(m as u64));
    let texts = [&mesh.appearance.materials, &mesh.appearance.textures, &mesh.appearance.samplers];
    texts.into_iter().flatten().for_each(|t| t.bytes().for_each(|b| put(b as u64)));
    for image in &mesh.appearance.images {
        image.name.bytes().chain(image.mime.bytes()).chain(image.bytes.iter().copied()).for_each(|b| put(b as u64));
    }
    let (vertices, faces, layers) = (mesh.vertex_count(), mesh.face_count(), mesh.layers.len());
    let counts = format!("{levels} levels, {vertices} vertices, {faces} faces, {layers} layers");
    format!("{name}: {counts}, checksum {:08x}\n", sum.finalize())
}

#[cfg(feature = "encode")]
#[test]
fn golden_files_are_blessed_when_asked_for() {
    if std::env::var_os("LODESTREAM_BLESS").is_none() {
        return;
    }
    let folder = folder();
    fs::create_dir_all(&folder).unwrap();
    let mut list = String::new();
    let mut total = 0;
    for (name, bytes) in small::files() {
        fs::write(folder.join(name).with_extension("lods"), &bytes).unwrap();
        list += &describe(name, &bytes);
        total += bytes.len();
    }
    assert!(total < 20_000, "{total} bytes of golden files");
    fs::write(folder.join("list.txt"), list).unwrap();
}

#[test]
fn golden_files_decode_to_what_they_did() {
    if std::env::var_os("LODESTREAM_BLESS").is_some() {
        return;
    }
    let folder = folder();
    let list = fs::read_to_string(folder.join("list.txt")).unwrap();
    let mut found = String::new();
    for line in list.lines() {
        let name = line.split(':').next().unwrap();
        let bytes = fs::read(folder.join(name).with_extension("lods")).unwrap();
        found += &describe(name, &bytes);
    }
    assert!(list.lines().count() >= 10);
    assert_eq!(found, list, "a file decodes to something else than when it was written");
}
