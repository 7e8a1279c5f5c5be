//! One outlier does not take all others with it: what nothing refers to sets no range, and what is lost is said.

use crate::common::{Scratch, lodestream};
use std::fmt::Write as _;

/// A terrain of 16 by 16 vertices and 75 cm on a national grid, with texture coordinates of 0 to 1. `vertex` and `value`:
/// lines that come first among those of their kind; `corner`: the texture coordinate of the first corner, from the end.
fn terrain(vertex: &str, value: &str, corner: &str) -> String {
    let mut text = format!("{vertex}{value}");
    let first = [vertex, value].map(|t| t.lines().count() as u32);
    for i in 0..256u32 {
        let (x, y) = (f64::from(i % 16) * 0.05, f64::from(i / 16) * 0.05);
        let z = 312.5 + 0.1 * (7.0 * x).sin() * (5.0 * y).cos();
        writeln!(text, "v {:.3} {:.3} {z:.3}\nvt {:.5} {:.5}", 512_345.1 + x, 5_403_210.4 + y, x / 0.75, y / 0.75)
            .unwrap();
    }
    for i in 0..255u32 {
        if i % 16 < 15 && i < 240 {
            let corners = [i, i + 1, i + 17, i + 16].map(|v| (v + 1 + first[0], v + 1 + first[1]));
            let mut names: Vec<String> = corners.iter().map(|(v, t)| format!("{v}/{t}")).collect();
            if i == 0 && !corner.is_empty() {
                names[0] = format!("{}/{corner}", corners[0].0);
            }
            writeln!(text, "f {}", names.join(" ")).unwrap();
        }
    }
    text
}

#[test]
fn a_stray_vertex_is_refused_or_dropped_by_name() {
    let s = Scratch::new("stray-vertex");
    s.write("plain.obj", terrain("", "", ""));
    s.write("stray.obj", terrain("v 0 0 0\n", "", ""));
    let run = lodestream(s.folder(), "encode stray.obj -o no.lods");
    assert_eq!(run.code, 1);
    let line = "lodestream: stray.obj: vertex 0, which no element uses, lies ";
    assert!(run.stderr.starts_with(line) && run.stderr.contains("--isolated drop"), "{}", run.stderr);
    assert!(!s.path("no.lods").exists());
    // Left out, all is as without it.
    let run = lodestream(s.folder(), "encode stray.obj -o dropped.lods --isolated drop --map dropped.map").ok();
    assert_eq!(run.stderr, "lodestream: warning: stray.obj: 1 vertices that nothing uses are left out\n");
    lodestream(s.folder(), "encode plain.obj -o plain.lods").ok();
    let [dropped, plain] = ["dropped.lods", "plain.lods"].map(|name| std::fs::read(s.path(name)).unwrap());
    assert!(dropped == plain);
    assert!(std::fs::read_to_string(s.path("dropped.map")).unwrap().starts_with("isolated\n"));
    for map in ["", "--map dropped.map"] {
        let run = lodestream(s.folder(), &format!("verify dropped.lods --against stray.obj {map}")).ok();
        assert!(run.stdout.contains("not kept  1 vertices that nothing uses"), "{}", run.stdout);
    }
    // In a run, and by a manifest.
    std::fs::create_dir(s.path("raw")).unwrap();
    std::fs::copy(s.path("stray.obj"), s.path("raw/stray.obj")).unwrap();
    let run = lodestream(s.folder(), "ingest raw -o out");
    assert!(run.code == 3 && run.stderr.contains("vertex 0, which no element uses"), "{}", run.stderr);
    lodestream(s.folder(), "ingest raw -o out --isolated drop").ok();
    s.write("jobs.jsonl", "{\"source\":\"stray.obj\",\"isolated\":\"drop\",\"output\":\"by-line\"}\n");
    let run = lodestream(s.folder(), "ingest raw --manifest jobs.jsonl -o out").ok();
    assert!(run.stderr.contains("1 vertices that nothing uses are left out"), "{}", run.stderr);
}

#[test]
fn a_stray_vertex_in_reach_is_kept_and_costs_nothing() {
    let s = Scratch::new("stray-in-reach");
    s.write("plain.obj", terrain("", "", ""));
    s.write("stray.obj", terrain("v 512000 5403000 0\n", "", ""));
    let step = |name: &str| {
        let json = lodestream(s.folder(), &format!("encode {name}.obj -o {name}.lods --map {name}.map --json")).json();
        assert_eq!(json["merged_places"], 0, "{json}");
        lodestream(s.folder(), &format!("verify {name}.lods --against {name}.obj --map {name}.map")).ok();
        json["lattice_step"].clone()
    };
    assert_eq!(step("stray"), step("plain"));
    // Without faces all are points, and all count.
    s.write("points.obj", "v 0 0 0\nv 1 1 1\nv 1000 0 0\n");
    let json = lodestream(s.folder(), "encode points.obj -o points.lods --json --isolated drop").json();
    assert_eq!((json["vertices"].as_u64(), json["lattice_step"].as_f64()), (Some(3), Some(1000.0 / 4095.0)));
}

#[test]
fn a_used_outlier_is_warned_of() {
    let s = Scratch::new("used-outlier");
    let text = terrain("", "", "").replacen("v 512345.100 5403210.400", "v 0 0", 1);
    s.write("far.obj", text);
    let run = lodestream(s.folder(), "encode far.obj -o far.lods").ok();
    assert!(
        run.stderr.starts_with("lodestream: warning: far.obj: the lattice of step 1319 makes 25"),
        "{}",
        run.stderr
    );
    let says = "more --position-bits or a smaller --position-step keeps more\n";
    assert!(run.stderr.ends_with(says) && run.stderr.lines().count() == 1, "{}", run.stderr);
    assert!(run.stdout.contains("shift       at most "), "{}", run.stdout);
    let run = lodestream(s.folder(), "verify far.lods --against far.obj").ok();
    assert!(
        run.stdout.contains("are equal to the source on a lattice of step 1.319e3\nshift   at most "),
        "{}",
        run.stdout
    );
    let json = lodestream(s.folder(), "verify far.lods --against far.obj --json").json();
    assert!(json["largest_shift"].as_f64().unwrap() > 100.0 && json["lattice_step"].as_f64().unwrap() > 1000.0);
    // Ordinary meshes have no such line.
    s.write("plain.obj", terrain("", "", ""));
    assert_eq!(lodestream(s.folder(), "encode plain.obj -o plain.lods").ok().stderr, "");
}

#[test]
fn texture_coordinates_count_where_corners_use_them() {
    let s = Scratch::new("uv-outlier");
    s.write("plain.obj", terrain("", "", ""));
    // A value that no corner names changes nothing.
    s.write("unused.obj", terrain("", "vt -100000 -100000\n", ""));
    for name in ["plain", "unused"] {
        assert_eq!(lodestream(s.folder(), &format!("encode {name}.obj -o {name}.lods")).ok().stderr, "");
    }
    let [unused, plain] = ["unused.lods", "plain.lods"].map(|name| std::fs::read(s.path(name)).unwrap());
    assert!(unused == plain);
    // One that a corner names is warned of, by layer, loss and option.
    s.write("used.obj", terrain("", "vt -100000 -100000\n", "1"));
    let run = lodestream(s.folder(), "encode used.obj -o used.lods").ok();
    let begins = "lodestream: warning: used.obj: layer ";
    let says = "neighbours is 0.06667; more --uv-bits or a smaller --uv-step keeps more\n";
    assert!(run.stderr.starts_with(begins) && run.stderr.ends_with(says), "{}", run.stderr);
    assert_eq!(lodestream(s.folder(), "encode used.obj -o used.lods --uv-step 0.0005").code, 1, "out of reach");
    assert_eq!(lodestream(s.folder(), "encode used.obj -o used.lods --uv-step 0.005").ok().stderr, "");
}
