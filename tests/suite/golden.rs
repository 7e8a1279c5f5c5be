//! Files of this version of the format decode for ever: `golden/v1` holds them, and what they decode to.
//!
//! While the format may still change, `LODESTREAM_BLESS=1 cargo test --test suite golden` writes them anew.
#![cfg(feature = "samples")]

use crate::common::outcome::describe;
#[cfg(feature = "encode")]
use crate::common::small;
use std::fs;
use std::path::PathBuf;

fn folder() -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests", "golden", "v1"].iter().collect()
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
