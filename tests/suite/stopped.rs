//! A program that is stopped, refused or out of space leaves no file behind, the temporary one included.
#![cfg(unix)]

use crate::common::{Scratch, lodestream};
use lodestream::io::write::{self, WriteOptions};
use lodestream::samples;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A folder with `m.ply` and `m.lods` in it.
fn folder(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    write::write_path(scratch.path("m.ply"), &samples::terrain(3000, 1), None, &WriteOptions::default()).unwrap();
    lodestream(scratch.folder(), "encode m.ply -o m.lods").ok();
    scratch
}

/// Whether this process, and so the programs it starts, ignores a signal.
fn ignores(number: u32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|l| l.strip_prefix("SigIgn:")).map(str::trim);
    mask.and_then(|m| u64::from_str_radix(m, 16).ok()).unwrap_or(0) >> (number - 1) & 1 == 1
}

/// Start the program on the beginning of its input, and once its temporary file is there, stop it.
fn stop(scratch: &Scratch, words: &str, input: &[u8], signal: &str) {
    let before = scratch.names();
    let mut child = Command::new(env!("CARGO_BIN_EXE_lodestream"))
        .args(words.split_whitespace())
        .current_dir(scratch.folder())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Kept open: the program waits for more.
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(input).unwrap();
    let start = Instant::now();
    while scratch.names() == before {
        assert!(start.elapsed() < Duration::from_secs(60), "{words}: no temporary file");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{words} after {signal}: {}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(scratch.names(), before, "{words} left a file behind after {signal}");
    drop(pipe);
}

#[test]
fn a_signal_leaves_no_file() {
    let s = folder("signal");
    let mesh = std::fs::read(s.path("m.ply")).unwrap();
    let file = std::fs::read(s.path("m.lods")).unwrap();
    for (number, signal) in [(2, "-INT"), (15, "-TERM"), (1, "-HUP")] {
        if ignores(number) {
            eprintln!("skipped: kill {signal}, which this process was started to ignore");
            continue;
        }
        stop(&s, "encode - --format ply -o o.lods --map o.map", &mesh[..mesh.len() / 2], signal);
        stop(&s, "decode - -o o.ply", &file[..file.len() / 2], signal);
    }
}

#[test]
fn a_file_that_cannot_grow_leaves_nothing() {
    let s = folder("cannot-grow");
    let before = s.names();
    let commands = ["encode m.ply -o o.lods", "encode m.ply -o o.lods --map o.map", "decode m.lods -o o.ply"];
    // A limit of one block: writing fails, as on a full disk, whether the caller has asked for the signal or not.
    for (words, trap) in commands.iter().flat_map(|words| [(words, "trap '' XFSZ; "), (words, "")]) {
        let script = format!("{trap}ulimit -f 1; exec \"$0\" {words}");
        let run = Command::new("sh")
            .args(["-c", &script, env!("CARGO_BIN_EXE_lodestream")])
            .current_dir(s.folder())
            .output()
            .unwrap();
        let error = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(1), "{words}: {error}");
        assert!(error.starts_with("lodestream: o.") && error.contains(": cannot be written: "), "{words}: {error}");
        assert_eq!((error.lines().count(), s.names()), (1, before.clone()), "{words}: {error}");
    }
}

fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|o| o.stdout == b"0\n")
}

/// The program as somebody whom permissions bind; `None` where that cannot be done.
fn unprivileged(program: &Path) -> Option<Command> {
    if !is_root() {
        return Some(Command::new(program));
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).arg(program);
    let works = Command::new("setpriv")
        .args(["--reuid", "65534", "--regid", "65534", "--clear-groups"])
        .arg(program)
        .arg("--version")
        .output()
        .is_ok_and(|o| o.status.success());
    works.then_some(command)
}

#[test]
fn missing_permissions_are_said() {
    let s = folder("permissions");
    // Where everybody may start it.
    let program: PathBuf = s.path("lodestream");
    std::fs::copy(env!("CARGO_BIN_EXE_lodestream"), &program).unwrap();
    let mode = |name: &str, mode: u32| {
        std::fs::set_permissions(s.path(name), std::fs::Permissions::from_mode(mode)).unwrap();
    };
    mode("lodestream", 0o755);
    std::fs::create_dir(s.path("open")).unwrap();
    mode("open", 0o777);
    std::fs::create_dir(s.path("shut")).unwrap();
    mode("shut", 0o555);
    for file in ["m.ply", "m.lods"] {
        std::fs::copy(s.path(file), s.path(&format!("secret-{file}"))).unwrap();
        mode(&format!("secret-{file}"), 0o000);
    }
    if unprivileged(&program).is_none() {
        eprintln!("skipped: missing permissions: the tests run as root, and setpriv cannot change that");
        return;
    }
    for (words, message) in [
        ("encode secret-m.ply -o open/o.lods", "secret-m.ply: no permission to read it; check the owner and mode"),
        ("decode secret-m.lods -o open/o.ply", "secret-m.lods: no permission to read it; check the owner and mode"),
        ("info secret-m.lods", "secret-m.lods: no permission to read it; check the owner and mode"),
        ("verify m.lods --against secret-m.ply", "secret-m.ply: no permission to read it; check the owner and mode"),
        ("encode m.ply -o shut/o.lods", "shut/o.lods: no permission to write there; choose another folder"),
        ("encode m.ply -o open/o.lods --map shut/o.map", "shut/o.map: no permission to write there; choose another"),
        ("decode m.lods -o shut/o.ply", "shut/o.ply: no permission to write there; choose another folder"),
    ] {
        let mut command = unprivileged(&program).unwrap();
        let run = command.args(words.split_whitespace()).current_dir(s.folder()).output().unwrap();
        let error = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(1), "{words}: {error}");
        assert!(error.starts_with(&format!("lodestream: {message}")), "{words}: {error}");
        assert_eq!(error.lines().count(), 1, "{words}: {error}");
        for folder in ["open", "shut"] {
            assert_eq!(std::fs::read_dir(s.path(folder)).unwrap().count(), 0, "{words} left a file in {folder}");
        }
    }
}
