//! `lodestream ingest` among what is no mesh: links, pipes, devices, hidden files, names that differ in case only.

#![cfg(unix)]

use crate::common::{Run, Scratch, lodestream};
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::process::Command;

const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
const STAGING: &str = ".lodestream-staging";

/// A folder with the meshes of these names in `raw/`.
fn raw(name: &str, meshes: &[&str]) -> Scratch {
    let s = Scratch::new(name);
    for mesh in meshes {
        let path = s.path("raw").join(mesh);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, MESH).unwrap();
    }
    s
}

fn pipe(s: &Scratch, name: &str) {
    assert!(Command::new("mkfifo").arg(s.path(name)).status().unwrap().success());
}

#[track_caller]
fn says(run: &Run, code: i32, text: &str) {
    assert!(run.code == code && run.stderr.contains(text), "{}: {}{}", run.code, run.stdout, run.stderr);
}

#[test]
fn files_behind_a_link_are_left_alone() {
    let s = raw("staging-link", &["a.obj"]);
    fs::create_dir(s.path("theirs")).unwrap();
    s.write("theirs/1-2.part", "theirs");
    s.write("theirs/letter.txt", "theirs");
    fs::create_dir(s.path("out")).unwrap();
    symlink(s.path("theirs"), s.path("out").join(STAGING)).unwrap();
    let run = lodestream(s.folder(), "ingest raw -o out");
    says(&run, 1, "out/.lodestream-staging is a link, not a folder of this program; remove it");
    let run = lodestream(s.folder(), "ingest raw -o other --report out/report.json");
    says(&run, 1, "out/.lodestream-staging is a link, not a folder of this program; remove it");
    assert_eq!(fs::read_dir(s.path("theirs")).unwrap().count(), 2);
    // In a folder of our own what has another name, is a link or a pipe stays, and stops nobody.
    fs::remove_file(s.path("out").join(STAGING)).unwrap();
    fs::create_dir(s.path("out").join(STAGING)).unwrap();
    s.write(&format!("out/{STAGING}/letter.txt"), "theirs");
    s.write(&format!("out/{STAGING}/7-7.part"), "ours");
    symlink(s.path("theirs/letter.txt"), s.path("out").join(STAGING).join("1-1.part")).unwrap();
    pipe(&s, &format!("out/{STAGING}/1-3.part"));
    lodestream(s.folder(), "ingest raw -o out").ok();
    let mut left: Vec<_> =
        fs::read_dir(s.path("out").join(STAGING)).unwrap().flatten().map(|e| e.file_name()).collect();
    left.sort();
    assert_eq!(left, ["1-1.part", "1-3.part", "letter.txt"]);
    assert_eq!(fs::read(s.path("theirs/letter.txt")).unwrap(), b"theirs");
}

#[test]
fn special_files_cost_only_themselves() {
    let s = raw("special-sources", &["a.obj", "b.obj"]);
    pipe(&s, "raw/pipe.ply");
    symlink("/dev/zero", s.path("raw/zero.stl")).unwrap();
    symlink("/proc/self/pagemap", s.path("raw/pages.stl")).unwrap();
    pipe(&s, "raw/b.mtl");
    s.write("raw/b.obj", format!("mtllib b.mtl\n{MESH}"));
    pipe(&s, "raw/c.bin");
    s.write(
        "raw/c.gltf",
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":"c.bin","byteLength":36}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}]}"#,
    );
    let run = lodestream(s.folder(), "ingest raw -o out --jobs 2");
    says(&run, 3, "raw/pipe.ply: cannot be read: this is a pipe, not a regular file");
    says(&run, 3, "raw/zero.stl: cannot be read: this is a device, not a regular file");
    says(&run, 3, "raw/pages.stl: cannot be read: ");
    assert!(run.stdout.contains("6: 2 done, 0 skipped, 4 failed"), "{}", run.stdout);
    // Named by themselves they are no better.
    let run = lodestream(s.folder(), "ingest raw/pipe.ply -o out");
    says(&run, 3, "raw/pipe.ply: cannot be read: this is a pipe, not a regular file");
    pipe(&s, "jobs.csv");
    says(&lodestream(s.folder(), "ingest --manifest jobs.csv -o out"), 1, "jobs.csv: cannot be read: this is a pipe");
    pipe(&s, "report.json");
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json");
    says(&run, 1, "report.json: there is a pipe of that name; choose another");
}

#[test]
fn hidden_files_are_passed_over_and_counted() {
    let meshes = ["a.obj", "._a.obj", ".git/x.obj", "__MACOSX/._a.obj", "day/.b.obj", "day/b.obj"];
    let s = raw("hidden", &meshes);
    s.write("raw/.DS_Store", "no mesh");
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json").ok();
    assert!(run.stdout.contains("2: 2 done, 0 skipped, 0 failed"), "{}", run.stdout);
    assert!(run.stdout.contains("hidden     4 files and folders passed over; --hidden takes them"), "{}", run.stdout);
    let report: serde_json::Value = serde_json::from_slice(&fs::read(s.path("report.json")).unwrap()).unwrap();
    assert_eq!(report["summary"]["hidden"], 4);
    let run = lodestream(s.folder(), "ingest raw -o all --hidden").ok();
    assert!(run.stdout.contains("6: 6 done, 0 skipped, 0 failed") && !run.stdout.contains("hidden"), "{}", run.stdout);
    // Who names them means them.
    let run = lodestream(s.folder(), "ingest raw/._a.obj -o one").ok();
    assert!(run.stdout.contains("1: 1 done"), "{}", run.stdout);
    let run = lodestream(s.folder(), "ingest raw/day/.*.obj -o two").ok();
    assert!(run.stdout.contains("1: 1 done"), "{}", run.stdout);
    let only = raw("hidden-only", &[".a.obj"]);
    let run = lodestream(only.folder(), "ingest raw -o out");
    says(&run, 1, "no mesh was found");
    says(&run, 1, "; 1 hidden files and folders were passed over, which --hidden takes");
}

#[test]
fn outputs_of_a_run_do_not_meet() {
    let s = raw("same-outputs", &["X.obj", "x.obj", "link/y.obj", "real/y.obj"]);
    fs::create_dir_all(s.path("out/real")).unwrap();
    symlink("real", s.path("out/link")).unwrap();
    let run = lodestream(s.folder(), "ingest raw -o out --jobs 1");
    says(&run, 3, "raw/x.obj: another source has the same output x.lods, case aside; name outputs in a manifest");
    says(&run, 3, "it is the output of another source of this run too; name outputs in a manifest");
    assert!(run.stdout.contains("4: 2 done, 0 skipped, 2 failed"), "{}", run.stdout);
    s.write("jobs.csv", "source,output\nX.obj,one\nx.obj,One\n");
    let run = lodestream(s.folder(), "ingest raw --manifest jobs.csv -o other");
    says(&run, 2, "jobs.csv, line 3: the output \"One.lods\" is that of line 2 already, case aside; name another");
}

#[test]
fn nothing_that_a_run_reads_is_replaced() {
    let s = raw("ingest-output-is-input", &["a.obj"]);
    s.write("raw/a.obj", format!("mtllib a.mtl\n{MESH}"));
    s.write("raw/a.mtl", "newmtl a\n");
    let before = fs::read(s.path("raw/a.obj")).unwrap();
    let run = lodestream(s.folder(), "ingest raw/a.obj -o raw/a.obj");
    says(&run, 3, "raw/a.obj: this output is its own source, which writing would destroy; choose another name");
    let run = lodestream(s.folder(), "ingest raw/a.obj -o raw/a.mtl");
    says(&run, 3, "raw/a.mtl: this output is a file that its source names, which writing would destroy");
    fs::create_dir(s.path("out")).unwrap();
    fs::hard_link(s.path("raw/a.obj"), s.path("out/a.lods")).unwrap();
    says(&lodestream(s.folder(), "ingest raw -o out"), 3, "out/a.lods: this output is its own source");
    fs::hard_link(s.path("raw/a.obj"), s.path("report.json")).unwrap();
    let run = lodestream(s.folder(), "ingest raw -o other --report report.json");
    says(&run, 1, "report.json: the report would replace a source of this run, or a file that one names");
    assert_eq!(fs::read(s.path("report.json")).unwrap(), before);
    s.write("jobs.csv", "source\na.obj\n");
    let run = lodestream(s.folder(), "ingest raw --manifest jobs.csv -o jobs.csv");
    says(&run, 3, "jobs.csv: this output is the manifest, which writing would destroy");
    fs::hard_link(s.path("jobs.csv"), s.path("jobs.json")).unwrap();
    let run = lodestream(s.folder(), "ingest raw --manifest jobs.csv -o other --report jobs.json");
    says(&run, 1, "jobs.json: this output is the manifest, which writing would destroy");
    assert_eq!(fs::read(s.path("raw/a.obj")).unwrap(), before);
    assert_eq!(fs::read(s.path("jobs.csv")).unwrap(), b"source\na.obj\n");
}

#[test]
fn what_is_protected_stays() {
    let s = raw("ingest-protected", &["a.obj", "b.obj"]);
    fs::create_dir(s.path("out")).unwrap();
    s.write("out/a.lods", "kept");
    s.write("report.json", "kept");
    for name in ["out/a.lods", "report.json"] {
        fs::set_permissions(s.path(name), fs::Permissions::from_mode(0o444)).unwrap();
    }
    let run = lodestream(s.folder(), "ingest raw -o out");
    says(&run, 3, "out/a.lods: this file is write-protected; choose another name or change its mode");
    assert!(run.stdout.contains("2: 1 done, 0 skipped, 1 failed"), "{}", run.stdout);
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json");
    says(&run, 1, "report.json: this file is write-protected; choose another name or change its mode");
    assert_eq!(fs::read(s.path("out/a.lods")).unwrap(), b"kept");
}

#[test]
fn the_staging_folder_is_no_place_for_outputs() {
    let s = raw("staging-output", &["a.obj"]);
    fs::create_dir_all(s.path("out").join(STAGING)).unwrap();
    symlink(format!("out/{STAGING}"), s.path("way")).unwrap();
    let no_place = "is for files on their way, which a run removes; choose another place";
    for to in [format!("out/{STAGING}"), format!("out/{STAGING}/x.lods"), "way".to_string(), "way/x.lods".to_string()] {
        says(&lodestream(s.folder(), &format!("ingest raw/a.obj -o {to}")), 2, no_place);
    }
    says(&lodestream(s.folder(), &format!("ingest raw -o out --report out/{STAGING}/r.json")), 2, no_place);
    // A run takes the folder away when it is empty.
    fs::create_dir_all(s.path("out").join(STAGING)).unwrap();
    s.write(&format!("out/{STAGING}/jobs.csv"), "source\na.obj\n");
    let run = lodestream(s.folder(), &format!("ingest raw -o out --manifest out/{STAGING}/jobs.csv"));
    says(&run, 2, "it lies among files on their way, which a run removes; move it");
    s.write("jobs.csv", format!("source,output\na.obj,{STAGING}/a\n"));
    let run = lodestream(s.folder(), "ingest raw -o out --manifest jobs.csv");
    says(&run, 2, "lies among files on their way; choose another folder");
}
