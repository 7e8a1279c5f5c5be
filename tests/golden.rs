//! Files of this version of the format decode for ever: `golden/v1` holds them, and what they decode to.
//!
//! While the format may still change, `LODESTREAM_BLESS=1 cargo test --test golden` writes them anew.
#![cfg(feature = "samples")]

#[cfg(feature = "encode")]
#[path = "common/small.rs"]
mod small;

use lodestream::decode::{DecodeOptions, Decoder, Step};
use std::fs;
use std::path::PathBuf;

fn folder() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests", "golden", "v1"].iter().collect()
}

/// What a file decodes to: levels, vertices, faces (those that repeat a vertex included), and a checksum of every
/// level's coordinates, elements and parents, and of the elements aside.
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
    }
    if let Some(aside) = decoder.aside() {
        aside.start.iter().chain(&aside.corners).for_each(|&c| put(c));
    }
    decoder.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    let mesh = decoder.to_mesh();
    mesh.validate().unwrap_or_else(|error| panic!("{name}: {error}"));
    // Coordinates too, bit for bit.
    let mut put = |n: u64| sum.update(&n.to_le_bytes());
    mesh.positions.iter().flatten().for_each(|c| put(c.to_bits()));
    let (vertices, faces) = (mesh.vertex_count(), mesh.face_count());
    format!("{name}: {levels} levels, {vertices} vertices, {faces} faces, checksum {:08x}\n", sum.finalize())
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
