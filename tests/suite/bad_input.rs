//! Bad input gets one clear line, exit code 1 (2 for wrong usage), and leaves no file behind.

use crate::common::{Scratch, lodestream};
use lodestream::io::write::{self, WriteOptions};
use lodestream::samples;

/// Run, and expect failure in one line that begins with `lodestream: ` and holds nothing but `message`.
#[track_caller]
fn refused(scratch: &Scratch, words: &str, message: &str) {
    let before = scratch.names();
    let run = lodestream(scratch.folder(), words);
    assert_eq!(run.stderr, format!("lodestream: {message}\n"), "{words}");
    assert_eq!((run.code, run.stdout.as_str()), (1, ""), "{words}");
    assert_eq!(scratch.names(), before, "{words} left a file behind");
}

/// The same where only the beginning and a part of the line are known.
#[track_caller]
fn refused_like(scratch: &Scratch, words: &str, beginning: &str, part: &str) {
    let before = scratch.names();
    let run = lodestream(scratch.folder(), words);
    assert_eq!((run.code, run.stdout.as_str()), (1, ""), "{words}: {}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
    assert!(run.stderr.starts_with(&format!("lodestream: {beginning}")), "{}", run.stderr);
    assert!(run.stderr.contains(part), "{}", run.stderr);
    assert_eq!(scratch.names(), before, "{words} left a file behind");
}

#[test]
fn paths_that_are_wrong() {
    let s = Scratch::new("paths");
    s.write("t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    s.write("t.thing", "0 0 0\n");
    s.write("noextension", "0 0 0\n");
    std::fs::create_dir(s.path("folder.obj")).unwrap();
    refused(&s, "encode nix.obj -o o.lods", "nix.obj: there is no such file; check the path");
    refused(&s, "encode t.obj/nix.obj -o o.lods", "t.obj/nix.obj: there is no such file; check the path");
    refused(&s, "encode folder.obj -o o.lods", "folder.obj: this is a folder; name a mesh file");
    let known = "is not a known mesh format; known are .obj .ply .stl .off .gltf .glb, each also with .gz, .zst or .xz. Rename the file or name its format";
    refused(&s, "encode t.thing -o o.lods", &format!("t.thing: the extension .thing {known}"));
    refused(&s, "encode noextension -o o.lods", &format!("noextension: a file without extension {known}"));
    refused(&s, "encode t.obj -o nix/o.lods", "nix/o.lods: the folder nix is not there; make it first");
    refused(&s, "encode t.obj -o o.lods --map nix/m", "nix/m: the folder nix is not there; make it first");
    refused(&s, "encode t.obj -o folder.obj", "folder.obj: this is a folder; name a file in it");
    refused(&s, "encode t.obj -o -", "the output has to be a file; name it with -o");
    for command in ["decode nix.lods -o o.obj", "info nix.lods", "verify nix.lods"] {
        refused(&s, command, "nix.lods: there is no such file; check the path");
    }
    refused(&s, "info folder.obj", "folder.obj: this is a folder; name a file");
    lodestream(s.folder(), "encode t.obj -o t.lods").ok();
    refused(&s, "decode t.lods -o nix/o.obj", "nix/o.obj: the folder nix is not there; make it first");
    refused(
        &s,
        "decode t.lods -o o.off",
        "o.off: the extension .off names no format that can be written; use .obj, .ply, .stl or .glb",
    );
    refused(
        &s,
        "decode t.lods -o o",
        "o: a file without extension names no format that can be written; use .obj, .ply, .stl or .glb",
    );
    refused(&s, "verify t.lods --against nix.obj", "nix.obj: there is no such file; check the path");
    refused(&s, "verify t.lods --against t.obj --map nix", "nix: there is no such file; check the path");
    refused(
        &s,
        "verify t.lods --against t.obj --map t.obj",
        "t.obj, line 1: \"v 0 0 0\" is no vertex number; give the file that encode --map wrote",
    );
}

#[test]
fn meshes_that_are_wrong() {
    let s = Scratch::new("meshes");
    s.write("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    refused(
        &s,
        "encode index.obj -o o.lods",
        "index.obj, line 4: a face names vertex 4, but the file has 3 vertices, numbered from 1; mend the index or add the vertex",
    );
    s.write("nan.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n");
    let not_finite = "vertex 1 (counted from 0) has a coordinate that is not a finite number";
    refused_like(&s, "encode nan.obj -o o.lods", "nan.obj, line 2: ", not_finite);
    s.write("inf.off", "OFF\n3 1 0\n0 0 0\n1 0 inf\n0 1 0\n3 0 1 2\n");
    refused_like(&s, "encode inf.off -o o.lods", "inf.off, ", not_finite);
    s.write("magic.ply", "play\n");
    refused_like(
        &s,
        "encode magic.ply -o o.lods",
        "magic.ply",
        "this is not a PLY file: \"play\" stands where `ply` belongs",
    );
    s.write("magic.glb", "no GLB at all, but long enough");
    refused_like(&s, "encode magic.glb -o o.lods", "magic.glb", "this is not");
    s.write("magic.off", "0 0 0\n");
    refused_like(&s, "encode magic.off -o o.lods", "magic.off", "");
    s.write("magic.obj.gz", "v 0 0 0\n");
    refused_like(&s, "encode magic.obj.gz -o o.lods", "magic.obj.gz: this is not gzip", "check the file");
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex COUNT\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let mut cut = header.replace("COUNT", "3").into_bytes();
    cut.extend([0; 20]);
    s.write("cut.ply", cut);
    refused_like(&s, "encode cut.ply -o o.lods", "cut.ply", "");
    s.write("count.ply", header.replace("COUNT", "4000000000"));
    refused_like(&s, "encode count.ply -o o.lods", "count.ply", "4000000000");
    s.write("far.obj", "v 0 0 0\nv 1e9 0 0\nv 0 1 0\nf 1 2 3\n");
    refused(
        &s,
        "encode far.obj -o o.lods --position-step 0.001",
        "far.obj: vertex 1 lies 1000000000000 lattice steps from the origin; at most 16777216 fit. Choose a larger step or an origin nearer to the mesh",
    );
    s.write("big.obj", format!("v 0 0 0\n{}", "v 1 2 3\n".repeat(10_000)));
    refused_like(&s, "encode big.obj -o o.lods --memory-limit 100kB", "big.obj", "memory");
}

#[test]
fn an_output_that_was_there_survives_a_failure() {
    let s = Scratch::new("survives");
    s.write("o.lods", "precious");
    s.write("bad.obj", "v 0 0 0\nf 1 2 3\n");
    refused_like(&s, "encode bad.obj -o o.lods", "bad.obj, line 2", "names vertex 3, but the file has 1 vertex,");
    assert_eq!(std::fs::read(s.path("o.lods")).unwrap(), b"precious");
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_said_and_nothing_stays() {
    let s = Scratch::new("full");
    write::write_path(s.path("m.ply"), &samples::terrain(3000, 1), None, &WriteOptions::default()).unwrap();
    refused_like(&s, "encode m.ply -o /dev/full", "/dev/full: cannot be written: ", "No space left on device");
    lodestream(s.folder(), "encode m.ply -o m.lods").ok();
    std::os::unix::fs::symlink("/dev/full", s.path("full.obj")).unwrap();
    refused_like(&s, "decode m.lods -o full.obj", "full.obj: ", "the disk is full");
    assert!(std::fs::symlink_metadata(s.path("full.obj")).unwrap().is_symlink());
}

#[test]
fn lods_files_that_are_wrong() {
    let s = Scratch::new("lods");
    write::write_path(s.path("m.ply"), &samples::asteroid(6, 1), None, &WriteOptions::default()).unwrap();
    lodestream(s.folder(), "encode m.ply -o m.lods").ok();
    let good = std::fs::read(s.path("m.lods")).unwrap();
    s.write("ply.lods", std::fs::read(s.path("m.ply")).unwrap());
    let magic = "ply.lods: not a .lods file: it does not begin with the magic number; check the name of the file";
    for command in ["decode ply.lods -o o.ply", "info ply.lods", "verify ply.lods"] {
        refused(&s, command, magic);
    }
    let mut version = good.clone();
    version[8] = 99;
    s.write("version.lods", version);
    refused(
        &s,
        "decode version.lods -o o.ply",
        "version.lods: byte 8: .lods format version 99, but this program reads version 1; use a newer program",
    );
    let mut text = b"\x0cLODS\r\n\n".to_vec();
    text.extend(&good[8..]);
    s.write("text.lods", text);
    refused_like(&s, "info text.lods", "text.lods: the .lods file was changed in transfer", "binary mode");
    let mut front = good.clone();
    front[20] ^= 4;
    s.write("front.lods", front);
    refused_like(&s, "info front.lods", "front.lods: ", "");
    let mut chunk = good.clone();
    *chunk.last_mut().unwrap() ^= 1;
    s.write("chunk.lods", chunk);
    refused_like(&s, "decode chunk.lods -o o.ply", "chunk.lods: chunk ", "is damaged: checksum ");
    refused_like(&s, "verify chunk.lods", "chunk.lods: chunk ", "is damaged: checksum ");
    s.write("longer.lods", [&good[..], b"more"].concat());
    let longer = format!(
        "longer.lods: the file goes on after its last byte: {} bytes, the chunk table ends at {}; cut it there",
        good.len() + 1,
        good.len()
    );
    refused(&s, "verify longer.lods", &longer);
    refused(&s, "decode longer.lods -o o.ply --strict", &longer);
    refused_like(
        &s,
        "decode m.lods -o o.ply --memory-limit 10kB",
        "m.lods: decoding needs about ",
        "the limit is 10000; raise",
    );
    refused_like(&s, "verify m.lods --memory-limit 10kB", "m.lods: decoding needs about ", "the limit is 10000; raise");
}

#[test]
fn no_flipped_bit_gives_another_mesh() {
    let s = Scratch::new("flips");
    write::write_path(s.path("m.obj"), &samples::fan_book(5, 1, 1), None, &WriteOptions::default()).unwrap();
    lodestream(s.folder(), "encode m.obj -o m.lods").ok();
    lodestream(s.folder(), "decode m.lods -o good.obj").ok();
    let good = std::fs::read(s.path("m.lods")).unwrap();
    let mesh = std::fs::read(s.path("good.obj")).unwrap();
    // Every byte, one bit of each: the library's tests flip them all.
    for byte in 0..good.len() {
        let mut bad = good.clone();
        bad[byte] ^= 1 << (byte % 8);
        s.write("bad.lods", bad);
        let run = lodestream(s.folder(), "decode bad.lods -o bad.obj");
        assert_eq!(run.stderr.lines().count(), 1, "byte {byte}: {}", run.stderr);
        if run.code == 0 {
            assert_eq!(std::fs::read(s.path("bad.obj")).unwrap(), mesh, "byte {byte}");
        }
    }
}
