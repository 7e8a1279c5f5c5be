//! Replays every file under `fuzz/findings/<target>/` through its reader: what was trouble once stays mended.
#![cfg(feature = "formats")]

use crate::common::picture;
use crate::common::repair;
use std::fs;
use std::path::Path;

use lodestream::io::read::{Format, ReadErrorKind, ReadOptions, read_bytes};

#[test]
fn findings_of_the_readers_stay_mended() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/findings");
    if !folder.exists() {
        // A packaged crate comes without them.
        eprintln!("skipped: findings_of_the_readers_stay_mended (there is no {})", folder.display());
        return;
    }
    let mut replayed = 0;
    for (target, format) in [
        ("read_obj", Format::Obj),
        ("read_ply", Format::Ply),
        ("read_stl", Format::Stl),
        ("read_off", Format::Off),
        ("read_gltf", Format::Gltf),
    ] {
        let Ok(entries) = fs::read_dir(folder.join(target)) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            let bytes = fs::read(&path).unwrap();
            let limit = Some(400 * bytes.len() as u64 + 65_536);
            for weld in [None, Some(true), Some(false)] {
                match read_bytes(&bytes, format, None, &ReadOptions { weld, memory_limit: limit, ..Default::default() })
                {
                    Ok(read) => read.mesh.validate().unwrap_or_else(|e| panic!("{}: {e}", path.display())),
                    Err(error) => {
                        let memory = matches!(error.kind, ReadErrorKind::Memory { .. });
                        assert!(!memory, "{}: {error}", path.display());
                        assert_eq!(error.to_string().lines().count(), 1, "{}: {error}", path.display());
                    }
                }
            }
            replayed += 1;
        }
    }
    assert!(replayed > 0, "no findings in {}", folder.display());
}

#[test]
fn findings_of_the_decoder_stay_mended() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/findings/decode");
    if !folder.exists() {
        eprintln!("skipped: findings_of_the_decoder_stay_mended (there is no {})", folder.display());
        return;
    }
    let mut replayed = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        let mut bytes = fs::read(entry.unwrap().path()).unwrap();
        repair::decode(&bytes);
        if repair::repair(&mut bytes).is_some() {
            repair::decode(&bytes);
        }
        replayed += 1;
    }
    assert!(replayed > 0, "no findings in {}", folder.display());
}

#[test]
fn findings_of_images_stay_mended() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/findings/texture");
    if !folder.exists() {
        eprintln!("skipped: findings_of_images_stay_mended (there is no {})", folder.display());
        return;
    }
    let mut replayed = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        picture::check(&fs::read(entry.unwrap().path()).unwrap());
        replayed += 1;
    }
    assert!(replayed > 0, "no findings in {}", folder.display());
}
