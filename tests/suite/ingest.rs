//! `lodestream ingest` as a user starts it: folders, manifests, failures, kills, full disks.

#![cfg(unix)]

use crate::common::{Scratch, lodestream};
use lodestream::io::write::{self, WriteOptions};
use lodestream::mesh::{Layer, LayerKind, Mesh, Stored};
use lodestream::samples;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// `count` meshes of many sizes and formats in `raw/`.
fn scans(name: &str, count: u32) -> Scratch {
    let scratch = Scratch::new(name);
    for i in 0..count {
        let extension = ["ply", "obj", "stl", "glb"][i as usize % 4];
        let mesh = samples::asteroid(3 + i % 9, u64::from(i));
        let folder = scratch.path(&format!("raw/day-{}", i % 3));
        std::fs::create_dir_all(&folder).unwrap();
        write::write_path(folder.join(format!("scan-{i:03}.{extension}")), &mesh, None, &WriteOptions::default())
            .unwrap();
    }
    scratch
}

/// All files below a folder with their bytes, by relative name.
fn tree(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(&next).into_iter().flatten().flatten() {
            if entry.file_type().unwrap().is_dir() {
                folders.push(entry.path());
            } else {
                let name = entry.path().strip_prefix(folder).unwrap().display().to_string();
                found.push((name, std::fs::read(entry.path()).unwrap_or_default()));
            }
        }
    }
    found.sort();
    found
}

fn report(scratch: &Scratch) -> Value {
    serde_json::from_slice(&std::fs::read(scratch.path("report.json")).unwrap()).unwrap()
}

#[test]
fn a_folder_becomes_a_folder_and_every_output_is_its_source() {
    let s = scans("ingest-folder", 12);
    s.write("raw/readme.txt", "not a mesh");
    let run = lodestream(s.folder(), "ingest raw -o out --verify --jobs 2 --report report.json").ok();
    assert!(run.stdout.contains("12: 12 done, 0 skipped, 0 failed"), "{}", run.stdout);
    assert!(run.stderr.contains("all files are found"), "{}", run.stderr);
    let outputs = tree(&s.path("out"));
    assert_eq!(outputs.len(), 12, "{:?}", outputs.iter().map(|o| &o.0).collect::<Vec<_>>());
    lodestream(s.folder(), "verify out/day-0/scan-000.lods --against raw/day-0/scan-000.ply").ok();
    let info = lodestream(s.folder(), "info out/day-1/scan-001.lods --chunks").ok();
    assert!(info.stdout.contains("source"), "{}", info.stdout);
    let report = report(&s);
    assert_eq!(report["summary"]["done"], 12);
    let files = report["files"].as_array().unwrap();
    assert_eq!(files.len(), 12);
    for file in files {
        assert_eq!(file["status"], "done");
        assert!(file["predicted_bytes"].as_u64().unwrap() > 0 && file["vertices"].as_u64().unwrap() > 0);
        assert_eq!(file["sha256"].as_str().unwrap().len(), 64);
    }
    // Patterns; one file into one; an HTML report.
    let run = lodestream(s.folder(), "ingest raw/**/*.ply -o some --jobs 1").ok();
    assert!(run.stdout.contains("3: 3 done"), "{}", run.stdout);
    lodestream(s.folder(), "ingest raw/day-0/scan-000.ply -o one.lods --report report.html").ok();
    assert_eq!(std::fs::read(s.path("one.lods")).unwrap(), outputs[0].1);
    assert!(std::fs::read_to_string(s.path("report.html")).unwrap().contains("scan-000.ply"));
    let names = s.names();
    assert_eq!(names, ["one.lods", "out", "raw", "report.html", "report.json", "some"], "no debris");
}

#[test]
fn a_manifest_is_checked_before_anything_is_done() {
    let s = scans("ingest-manifest", 3);
    s.write("jobs.csv", "source,output,position_bits\nday-0/scan-000.ply,a,10\nday-1/scan-001.obj,b,99\n,c,\n");
    let run = lodestream(s.folder(), "ingest raw -o out --manifest jobs.csv");
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("jobs.csv, line 3: position_bits is a number from 1 to 21"), "{}", run.stderr);
    assert!(run.stderr.contains("jobs.csv, line 4: there is no source"), "{}", run.stderr);
    assert!(!s.path("out").exists(), "nothing was started");
    s.write(
        "jobs.csv",
        "source,output,position_bits\nday-0/scan-000.ply,deep/a,10\nday-1/scan-001.obj,b.lods,14\nnot-there.ply,,\n",
    );
    let run = lodestream(s.folder(), "ingest raw -o out --manifest jobs.csv --report report.json --log-format json");
    assert_eq!(run.code, 3, "{}", run.stderr);
    let bits =
        |path: &str| lodestream(s.folder(), &format!("info {path} --json")).json()["quantization"]["bits"].clone();
    assert_eq!((bits("out/deep/a.lods"), bits("out/b.lods")), (Value::from(10), Value::from(14)));
    let lines: Vec<Value> =
        run.stderr.lines().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{l}: {e}"))).collect();
    let failed = lines.iter().find(|l| l["level"] == "ERROR").unwrap();
    assert_eq!(failed["kind"], "missing");
    assert!(failed["message"].as_str().unwrap().contains("line 4 of the manifest"), "{failed}");
    assert_eq!(report(&s)["summary"]["failures"]["missing"], 1);
}

#[test]
fn bad_files_cost_only_themselves() {
    let s = scans("ingest-bad", 27);
    s.write("raw/broken.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    let whole = std::fs::read(s.path("raw/day-0/scan-000.ply")).unwrap();
    s.write("raw/cut.ply", &whole[..whole.len() / 2]);
    s.write("raw/noise.glb", [0x9d; 5000]);
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(
        run.stdout.contains("30: 27 done, 0 skipped, 3 failed") && run.stdout.contains("failed: input"),
        "{}",
        run.stdout
    );
    let report = report(&s);
    let errors: Vec<&str> = report["files"].as_array().unwrap().iter().filter_map(|f| f["error"].as_str()).collect();
    assert_eq!(errors.len(), 3);
    assert!(errors.iter().any(|e| e.contains("broken.obj, line 3")), "{errors:?}");
    assert!(
        errors.iter().any(|e| e.contains("cut.ply")) && errors.iter().any(|e| e.contains("noise.glb")),
        "{errors:?}"
    );
    assert_eq!(tree(&s.path("out")).len(), 27);
}

/// Texture coordinates, normals and colours for every vertex.
fn dressed(mut mesh: Mesh) -> Mesh {
    let layers = [("uv", LayerKind::Uv, 2), ("normal", LayerKind::Normal, 3), ("color", LayerKind::Color, 3)];
    for (name, kind, width) in layers {
        let unit = |p: &[f64; 3]| p.map(|x| (x - x.floor()).clamp(0.01, 1.0));
        let values = mesh.positions.iter().flat_map(|p| unit(p).into_iter().take(width)).collect();
        let (name, stored, corners) = (name.to_string(), Stored::F32, mesh.corners.clone());
        mesh.layers.push(Layer { name, kind, width: width as u8, stored, values, corners, isolated: Vec::new() });
    }
    mesh
}

#[test]
fn memory_is_foreseen_with_attributes_and_without() {
    let s = Scratch::new("ingest-foreseen");
    let plain = || samples::terrain(40_000, 1);
    for (name, mesh, drop) in [
        ("plain.ply", plain(), "none"),
        ("plain.obj", plain(), "none"),
        ("plain.stl", plain(), "none"),
        ("dressed.ply", dressed(plain()), "none"),
        ("dressed.glb", dressed(plain()), "none"),
        ("dressed.obj", dressed(plain()), "none"),
        ("dropped.ply", dressed(plain()), "all"),
        ("mixed.ply", dressed(samples::mixed(150, 150, 1)), "none"),
        ("cloud.ply", samples::point_cloud(60_000, 1), "none"),
    ] {
        write::write_path(s.path(name), &mesh, None, &WriteOptions::default()).unwrap();
        let drop = if drop == "all" { "--drop all" } else { "" };
        // Each in a run of its own, or the largest of them would be all that the system tells.
        lodestream(s.folder(), &format!("ingest {name} -o out --jobs 1 --report report.json {drop}")).ok();
        let report = report(&s);
        let number = |key: &str| report["summary"][key].as_u64().unwrap() as f64 / 1e6;
        let (foreseen, took) = (number("predicted_bytes"), number("peak_bytes"));
        let off = foreseen / took - 1.0;
        println!("{name}: {foreseen:.1} MB foreseen, {took:.1} MB taken ({:+.1} %)", 100.0 * off);
        if took > 0.0 {
            assert!(off.abs() < 0.25, "{name}: {foreseen:.1} MB foreseen, {took:.1} MB taken");
        }
    }
}

/// Start a run and kill it after so many milliseconds, unless it ends before.
fn killed(folder: &Path, words: &str, after: u64) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_lodestream"))
        .args(words.split_whitespace())
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_millis(after));
    let _ = child.kill();
    child.wait().unwrap();
}

#[test]
fn killed_at_any_moment_and_resumed_the_result_is_that_of_one_run() {
    let s = scans("ingest-killed", 40);
    lodestream(s.folder(), "ingest raw -o clean").ok();
    let clean = tree(&s.path("clean"));
    let mut random = samples::Random::new(7);
    let (mut partial, words) = (0, "ingest raw -o out --resume --jobs 2 --report out/report.json");
    for _ in 0..20 {
        if tree(&s.path("out")).len() >= 30 {
            std::fs::remove_dir_all(s.path("out")).unwrap();
        }
        std::fs::create_dir_all(s.path("out")).unwrap();
        killed(s.folder(), words, u64::from(random.below(150)));
        let done = tree(&s.path("out"));
        partial += usize::from(!done.is_empty() && done.len() < 40);
        // A run that was done before it could be killed has left its report, which tells its own story.
        let outputs = |name: &str| !name.contains(".lodestream-staging") && name != "report.json";
        for (name, bytes) in done.iter().filter(|(name, _)| outputs(name)) {
            let whole = clean.iter().find(|(n, _)| n == name);
            assert!(whole.map(|w| &w.1) == Some(bytes), "{name} is there, but not whole");
        }
    }
    assert!(partial > 0, "no run was killed in the middle");
    lodestream(s.folder(), words).ok();
    std::fs::remove_file(s.path("out/report.json")).unwrap();
    assert!(tree(&s.path("out")) == clean, "the outputs differ, or there is debris");
    assert!(!s.path("out/.lodestream-staging").exists());
}

#[test]
fn two_runs_on_one_destination_do_not_harm_each_other() {
    let s = scans("ingest-two", 24);
    lodestream(s.folder(), "ingest raw -o clean").ok();
    std::thread::scope(|scope| {
        for words in ["ingest raw -o out --resume", "ingest raw -o out", "ingest raw -o out --shard 1/2"] {
            let s = &s;
            scope.spawn(move || lodestream(s.folder(), words).ok());
        }
    });
    assert!(tree(&s.path("clean")) == tree(&s.path("out")));
}

#[test]
fn a_signal_ends_a_run_without_debris() {
    let s = scans("ingest-signal", 4);
    let big = samples::terrain(60_000, 1);
    write::write_path(s.path("raw/big.ply"), &big, None, &WriteOptions::default()).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_lodestream"))
        .args("ingest raw -o out --report out/report.json".split_whitespace())
        .current_dir(s.folder())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    // The report's own file is on its way from the beginning.
    while !s.path("out/.lodestream-staging").exists() && start.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(!s.path("out/.lodestream-staging").exists());
}

#[test]
fn what_cannot_be_read_or_written_is_named() {
    let s = scans("ingest-refused", 4);
    let run = lodestream(s.folder(), "ingest nowhere -o out");
    assert_eq!((run.code, run.stderr.contains("nowhere: there is no such file")), (1, true), "{}", run.stderr);
    let run = lodestream(s.folder(), "ingest raw -o out.lods");
    assert_eq!((run.code, run.stderr.contains("many sources cannot go into one file")), (2, true), "{}", run.stderr);
    let run = lodestream(s.folder(), "ingest ftp://x/y -o out");
    assert_eq!((run.code, run.stderr.contains("the scheme ftp:// is not known")), (2, true), "{}", run.stderr);
    let run = lodestream(s.folder(), "ingest raw -o out --shard 5/4");
    assert_eq!(run.code, 2);
}

#[test]
fn folders_and_files_without_permission_fail_alone() {
    use std::os::unix::fs::PermissionsExt;
    let s = scans("ingest-permission", 4);
    let mode = |path: &str, mode: u32| {
        std::fs::set_permissions(s.path(path), std::fs::Permissions::from_mode(mode)).unwrap();
    };
    // An output whose place is taken by a folder cannot be renamed there: true for root as well.
    std::fs::create_dir_all(s.path("out/day-0/scan-000.lods/x")).unwrap();
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert_eq!(report(&s)["summary"]["failures"]["write"], 1);
    assert_eq!(report(&s)["summary"]["done"], 3);
    mode("raw/day-1/scan-001.obj", 0);
    std::fs::create_dir_all(s.path("out2")).unwrap();
    std::fs::create_dir_all(s.path("locked")).unwrap();
    mode("out2", 0o777);
    mode("locked", 0o555);
    // Modes do not bind root, who can be somebody else instead.
    let root = std::fs::read(s.path("raw/day-1/scan-001.obj")).is_ok();
    let run = |words: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream"));
        command.args(words.split_whitespace()).current_dir(s.folder());
        if root {
            std::os::unix::process::CommandExt::uid(&mut command, 65534);
        }
        command.output()
    };
    match run("ingest raw -o out2 --report out2/report.json") {
        Err(e) => println!("skipped: root cannot start the program as another user here: {e}"),
        Ok(done) => {
            let said = String::from_utf8_lossy(&done.stderr);
            assert_eq!(done.status.code(), Some(3), "{said}");
            let told: Value = serde_json::from_slice(&std::fs::read(s.path("out2/report.json")).unwrap()).unwrap();
            assert_eq!((&told["summary"]["failures"]["permission"], &told["summary"]["done"]), (&1.into(), &3.into()));
            assert!(said.contains("day-1/scan-001.obj"), "{said}");
            let refused = run("ingest raw -o locked").unwrap();
            let said = String::from_utf8_lossy(&refused.stderr);
            assert_eq!(refused.status.code(), Some(1), "{said}");
            assert!(said.contains("locked") && said.to_lowercase().contains("permission"), "{said}");
        }
    }
    mode("raw/day-1/scan-001.obj", 0o644);
}

/// A full disk, on a small file system in memory where this user may mount one.
#[test]
fn a_full_disk_fails_what_does_not_fit_and_leaves_nothing_behind() {
    let s = scans("ingest-full", 30);
    let out = s.path("out");
    std::fs::create_dir_all(&out).unwrap();
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=32k", "tmpfs"]).arg(&out).output();
    if !mount.is_ok_and(|m| m.status.success()) {
        println!("skipped: this user may not mount a small file system");
        return;
    }
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json");
    let left = tree(&out);
    let _ = Command::new("umount").arg(&out).status();
    assert_eq!(run.code, 3, "{}", run.stderr);
    let report = report(&s);
    let failed = report["summary"]["failures"]["write"].as_u64().unwrap();
    let done = report["summary"]["done"].as_u64().unwrap();
    assert!(failed > 0 && done > 0 && failed + done == 30, "{report}");
    assert!(run.stderr.contains("make room and run again with --resume"), "{}", run.stderr);
    assert_eq!(left.len() as u64, done, "only whole outputs are left");
    lodestream(s.folder(), "ingest raw -o clean").ok();
    let clean = tree(&s.path("clean"));
    assert!(left.iter().all(|o| clean.contains(o)));
}

#[test]
fn many_tiny_files_start_at_once_and_take_bounded_memory() {
    let s = Scratch::new("ingest-tiny");
    let many = 600;
    let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n";
    std::fs::create_dir_all(s.path("raw")).unwrap();
    for i in 0..many {
        s.write(&format!("raw/{i:06}.obj"), mesh);
    }
    let run = lodestream(s.folder(), "ingest raw -o out --report report.json --memory 128MiB").ok();
    assert!(run.stdout.contains("600: 600 done"), "{}", run.stdout);
    let peak = report(&s)["summary"]["peak_bytes"].as_u64().unwrap();
    assert!(peak < 64 << 20, "{peak} bytes");
}
