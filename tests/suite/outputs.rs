//! An output never replaces an input of its command or another output of it, nor what is protected; it appears whole or not
//! at all, and never waits for somebody at the other end of a pipe.

use crate::common::{Scratch, lodestream, lodestream_with};
use std::path::Path;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nvt 0 0\nvt 1 0\nvt 0 1\nmtllib scan.mtl\nusemtl a\nf 1/1 2/2 3/3\nf 2/2 4/1 3/3\n";

/// A folder with a mesh, its library and image, and a `.lods` file of it.
fn folder(name: &str) -> Scratch {
    let s = Scratch::new(name);
    s.write("scan.obj", TRIANGLE);
    s.write("scan.mtl", "newmtl a\nmap_Kd wood.png\n");
    s.write("wood.png", b"\x89PNG\r\n\x1a\n and so on");
    s.write("scan.gltf", GLTF);
    s.write("scan.bin", [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].map(f32::to_le_bytes).concat());
    lodestream(s.folder(), "encode scan.obj -o scan.lods").ok();
    s
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";

const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":"scan.bin","byteLength":36}],
"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}]}"#;

/// All files of a folder with their bytes; of a link those of what it names.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .flatten()
        .filter(|e| e.path().is_file())
        .map(|e| (e.file_name().to_string_lossy().into_owned(), std::fs::read(e.path()).unwrap()))
        .collect();
    all.sort();
    all
}

/// The command is refused with a line that begins so, and no file is another than before.
#[track_caller]
fn refused(s: &Scratch, words: &str, line: &str) {
    let before = contents(s.folder());
    let run = lodestream(s.folder(), words);
    assert_eq!(run.code, 1, "{words}: {}{}", run.stdout, run.stderr);
    assert!(run.stderr.starts_with(&format!("lodestream: {line}")), "{words}: {}", run.stderr);
    assert_eq!((run.stderr.lines().count(), run.stdout.as_str()), (1, ""), "{words}: {}", run.stderr);
    assert!(contents(s.folder()) == before, "{words} changed a file");
}

const AN_INPUT: &str = "this is an input of the command, which writing would destroy; choose another name";

#[test]
fn an_output_is_never_an_input() {
    let s = folder("output-is-input");
    s.write("scan.ply", PLY);
    for (words, output) in [
        ("encode scan.obj -o scan.obj", "scan.obj"),
        ("encode scan.obj -o o.lods --map scan.obj", "scan.obj"),
        ("encode scan.obj -o o.lods --trace scan.obj", "scan.obj"),
        ("encode --format obj scan.obj -o scan.obj", "scan.obj"),
        ("decode scan.lods -o scan.lods --format ply", "scan.lods"),
        ("compare scan.obj scan.ply --heatmap scan.ply", "scan.ply"),
        ("compare scan.ply scan.obj --heatmap scan.ply", "scan.ply"),
    ] {
        refused(&s, words, &format!("{output}: {AN_INPUT}"));
    }
    for (words, output) in [
        // What the input names: library, image, buffer.
        ("encode scan.obj -o scan.mtl", "scan.mtl"),
        ("encode scan.obj -o o.lods --map wood.png", "wood.png"),
        ("encode scan.gltf -o scan.bin", "scan.bin"),
        ("render scan.obj -o wood.png", "wood.png"),
        ("compare scan.lods scan.obj --heatmap wood.png", "wood.png"),
    ] {
        refused(&s, words, &format!("{output}: an input of the command names this file, which writing would destroy"));
    }
    std::fs::copy(s.path("scan.lods"), s.path("report.json")).unwrap();
    refused(&s, "report scan.obj report.json -o .", "./report.json: this is the input report.json of the command");
}

#[test]
fn an_output_is_no_other_output() {
    let s = folder("output-twice");
    std::fs::create_dir(s.path("sub")).unwrap();
    for (words, line) in [
        (
            "encode scan.obj -o o.lods --map o.lods",
            "o.lods: this is the output o.lods too; give each a name of its own",
        ),
        ("encode scan.obj -o o.lods --map sub/../o.lods", "sub/../o.lods: this is the output o.lods too"),
        ("encode scan.obj -o o.lods --trace ./O.LODS", "./O.LODS: this is the output o.lods too"),
        ("encode scan.obj -o scan.lods --map ./scan.lods", "./scan.lods: this is the output scan.lods too"),
    ] {
        refused(&s, words, line);
    }
    // A device takes both.
    if Path::new("/dev/null").exists() {
        lodestream(s.folder(), "encode scan.obj -o /dev/null --map /dev/null").ok();
    }
}

#[cfg(unix)]
#[test]
fn links_do_not_hide_an_input() {
    let s = folder("output-through-links");
    std::os::unix::fs::symlink("scan.obj", s.path("soft.lods")).unwrap();
    std::fs::hard_link(s.path("scan.obj"), s.path("hard.lods")).unwrap();
    std::os::unix::fs::symlink(".", s.path("here")).unwrap();
    std::os::unix::fs::symlink("scan.lods", s.path("soft.ply")).unwrap();
    for (words, output, input) in [
        ("encode scan.obj -o soft.lods", "soft.lods", "scan.obj"),
        ("encode scan.obj -o hard.lods", "hard.lods", "scan.obj"),
        ("encode scan.obj -o here/scan.obj", "here/scan.obj", "scan.obj"),
        ("encode here/scan.obj -o o.lods --map scan.obj", "scan.obj", "here/scan.obj"),
        ("decode scan.lods -o soft.ply", "soft.ply", "scan.lods"),
    ] {
        refused(&s, words, &format!("{output}: this is the input {input} of the command, which writing would destroy"));
    }
    // What the shell has opened is an input too.
    let before = contents(s.folder());
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_lodestream"))
        .args(["encode", "-", "--format", "obj", "-o", "scan.obj"])
        .current_dir(s.folder())
        .stdin(std::fs::File::open(s.path("scan.obj")).unwrap())
        .output()
        .unwrap();
    let said = String::from_utf8(run.stderr).unwrap();
    assert!(said.starts_with("lodestream: scan.obj: this is the input standard input of the command"), "{said}");
    assert!(contents(s.folder()) == before);
}

#[cfg(unix)]
#[test]
fn what_is_protected_is_not_replaced() {
    use std::os::unix::fs::PermissionsExt;
    let s = folder("write-protected");
    for name in ["o.lods", "o.map", "o.ply", "o.png"] {
        s.write(name, "kept");
        std::fs::set_permissions(s.path(name), std::fs::Permissions::from_mode(0o444)).unwrap();
    }
    let protected = "this file is write-protected; choose another name or change its mode\n";
    for (words, output) in [
        ("encode scan.obj -o o.lods", "o.lods"),
        ("encode scan.obj -o new.lods --map o.map", "o.map"),
        ("decode scan.lods -o o.ply", "o.ply"),
        ("render scan.obj -o o.png", "o.png"),
        ("compare scan.obj scan.obj --heatmap o.png", "o.png"),
    ] {
        refused(&s, words, &format!("{output}: {protected}"));
    }
    // An image that is there already as it is to be is no reason to refuse.
    std::fs::create_dir(s.path("out")).unwrap();
    lodestream(s.folder(), "decode scan.lods -o out/a.obj").ok();
    std::fs::set_permissions(s.path("out/wood.png"), std::fs::Permissions::from_mode(0o444)).unwrap();
    lodestream(s.folder(), "decode scan.lods -o out/b.obj").ok();
}

#[test]
fn a_level_goes_into_a_pipe() {
    let s = folder("decode-to-pipe");
    lodestream(s.folder(), "decode scan.lods -o o.ply").ok();
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_lodestream"))
        .args(["decode", "scan.lods", "-o", "-", "--format", "ply"])
        .current_dir(s.folder())
        .output()
        .unwrap();
    let said = String::from_utf8(run.stderr).unwrap();
    let left_out = "lodestream: warning: standard output: 1 file of materials and images left out";
    assert!(run.status.code() == Some(0) && said.contains(left_out), "{said}");
    let mesh = |bytes: &[u8]| {
        let options = lodestream::io::read::ReadOptions::default();
        lodestream::io::read::read_bytes(bytes, lodestream::io::read::Format::Ply, None, &options).unwrap().mesh
    };
    let file = mesh(&std::fs::read(s.path("o.ply")).unwrap());
    assert_eq!(mesh(&run.stdout).positions, file.positions);
    refused(
        &s,
        "decode scan.lods -o -",
        "standard output: its format is not known; name it with --format, as in --format ply\n",
    );
    refused(&s, "decode scan.lods -o - --format ply --json", "--json and -o - cannot both have standard output");
    // A format that is said counts more than the name.
    lodestream(s.folder(), "decode scan.lods -o o.bin --format stl").ok();
    assert_eq!(std::fs::read(s.path("o.bin")).unwrap().len(), 84 + 2 * 50);
    let run = lodestream(s.folder(), "decode scan.lods -o o.off --format off");
    assert!(run.code == 2 && run.stderr.contains("obj, ply, stl and glb can be written"), "{}", run.stderr);
}

#[cfg(unix)]
#[test]
fn long_names_are_names_too() {
    let s = folder("long-names");
    let long = |extension: &str| format!("{}.{extension}", "n".repeat(249 - extension.len()));
    std::fs::copy(s.path("scan.obj"), s.path(&long("obj"))).unwrap();
    lodestream(s.folder(), &format!("encode {} -o {} --map {}", long("obj"), long("lods"), long("map"))).ok();
    lodestream(s.folder(), &format!("decode {} -o {}", long("lods"), long("ply"))).ok();
    lodestream(s.folder(), &format!("verify {} --against {}", long("lods"), long("obj"))).ok();
    let names = s.names();
    assert!(names.iter().all(|name| !name.ends_with(".part")), "{names:?}");
    // One byte too long is said as such, before any work.
    let name = format!("{}.lods", "n".repeat(251));
    let run = lodestream(s.folder(), &format!("encode scan.obj -o {name}"));
    assert!(run.code == 1 && run.stderr.contains("cannot be written: File name too long"), "{}", run.stderr);
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_do_not_stop_a_command() {
    let s = folder("special");
    assert!(std::process::Command::new("mkfifo").arg(s.path("pipe.ply")).status().unwrap().success());
    std::os::unix::fs::symlink("/dev/zero", s.path("zero.obj")).unwrap();
    let irregular = "this is no regular file (a pipe or a device)";
    let reads = |what: &str| format!("cannot be read: this is {what}, not a regular file");
    for (words, line) in [
        ("encode pipe.ply -o o.lods".to_string(), format!("pipe.ply: {irregular}")),
        ("encode pipe.ply --format ply -o o.lods".to_string(), format!("pipe.ply: {}", reads("a pipe"))),
        ("encode zero.obj -o o.lods".to_string(), format!("zero.obj: {irregular}")),
        ("info pipe.ply".to_string(), format!("pipe.ply: {}", reads("a pipe"))),
        ("verify scan.lods --against pipe.ply".to_string(), format!("pipe.ply: {irregular}")),
        (
            "decode scan.lods -o pipe.ply".to_string(),
            "pipe.ply: this is a pipe, not a regular file; choose another".to_string(),
        ),
        ("encode scan.obj -o o.lods --map pipe.ply".to_string(), "pipe.ply: this is a pipe, not".to_string()),
    ] {
        refused(&s, &words, &line);
    }
    // Standard input is the way for pipes.
    let bytes = std::fs::read(s.path("scan.obj")).unwrap();
    lodestream_with(s.folder(), "encode - --format obj -o piped.lods", Some(&bytes)).ok();
    if Path::new("/dev/fd/0").exists() {
        lodestream_with(s.folder(), "encode /dev/fd/0 --format obj -o piped.lods", Some(&bytes)).ok();
    }
}

#[cfg(unix)]
#[test]
fn names_do_not_steer_the_terminal() {
    let s = folder("escapes");
    let name = "a\u{1b}[31m\u{202e}.obj";
    s.write(name, "v 0 0 zero\n");
    let run = lodestream(s.folder(), &format!("encode {name} -o o.lods"));
    assert_eq!(run.code, 1);
    assert!(run.stderr.starts_with("lodestream: a\\u{1b}[31m\\u{202e}.obj, line 1: "), "{}", run.stderr);
    std::fs::copy(s.path("scan.obj"), s.path(name)).unwrap();
    let run = lodestream(s.folder(), &format!("render {name} -o \u{1b}]0;x.png --size 64")).ok();
    assert!(!run.stdout.contains('\u{1b}') && run.stdout.contains("\\u{1b}]0;x.png"), "{}", run.stdout);
    let run = lodestream(s.folder(), "encode \u{1b}[2J -o o.lods");
    assert!(run.code == 1 && !run.stderr.contains('\u{1b}'), "{}", run.stderr);
}
