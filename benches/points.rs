//! Rate and speed of the coder of point sets, beside Draco's where `draco_encoder` is installed.
//!
//! `cargo bench --bench points [-- FILE.xyz …]`: each line of a file holds three integers. Without files, synthetic sets.

use lodestream::format::coder::range::{Decoder, Encoder};
use lodestream::format::points::code_points;
use std::time::Instant;

fn noise(state: &mut u64) -> i32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 52) as i32
}

fn synthetic() -> Vec<(String, Vec<[i32; 3]>)> {
    let mut s = 1;
    let mut sets = Vec::new();
    for count in [1, 3, 10, 20, 30, 100, 1000, 20_000] {
        let points = (0..count).map(|_| [noise(&mut s), noise(&mut s), noise(&mut s)]).collect();
        sets.push((format!("random {count}"), points));
    }
    let flat = (0..5000).map(|_| [noise(&mut s), noise(&mut s), 77]).collect();
    sets.push(("plane".to_owned(), flat));
    let line = (0..5000).map(|_| [noise(&mut s), 5, 77]).collect();
    sets.push(("line".to_owned(), line));
    let tilted = |s: &mut u64, rough: i32| {
        let (x, y) = (noise(s), noise(s));
        [x, y, (3 * x + 7 * y) / 10 + noise(s) % rough]
    };
    sets.push(("tilted plane".to_owned(), (0..5000).map(|_| tilted(&mut s, 1)).collect()));
    sets.push(("rough tilted plane".to_owned(), (0..5000).map(|_| tilted(&mut s, 8)).collect()));
    let mut crumbs = Vec::new();
    for _ in 0..100 {
        let at = [noise(&mut s), noise(&mut s), noise(&mut s)];
        crumbs.extend((0..50).map(|_| at.map(|c| c + (noise(&mut s) + noise(&mut s) + noise(&mut s)) / 256)));
    }
    sets.push(("crumbs".to_owned(), crumbs));
    sets.push(("equal".to_owned(), vec![[1, 2, 3]; 10_000]));
    sets
}

/// The size of Draco's file at 12 bits for points of at most 12 bits.
fn draco(points: &[[i32; 3]]) -> Option<u64> {
    let name = std::env::temp_dir().join(format!("points-{}", std::process::id()));
    let (input, output) = (name.with_extension("ply"), name.with_extension("drc"));
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    )
    .into_bytes();
    ply.extend(points.iter().flatten().flat_map(|&c| (c as f32).to_le_bytes()));
    std::fs::write(&input, ply).ok()?;
    let run = std::process::Command::new("draco_encoder")
        .args(["-point_cloud", "-qp", "12", "-cl", "10", "-i"])
        .arg(&input)
        .arg("-o")
        .arg(&output)
        .output();
    let size = run.ok().filter(|r| r.status.success()).and_then(|_| std::fs::metadata(&output).ok()).map(|m| m.len());
    let _ = std::fs::remove_file(input);
    let _ = std::fs::remove_file(output);
    size
}

fn main() {
    let mut sets = Vec::new();
    for file in std::env::args().skip(1).filter(|a| !a.starts_with('-')) {
        let text = std::fs::read_to_string(&file).expect("a readable file");
        let points = text
            .lines()
            .map(|l| {
                let mut c = l.split_whitespace().map(|t| t.parse().expect("three integers a line"));
                [c.next().expect("x"), c.next().expect("y"), c.next().expect("z")]
            })
            .collect();
        sets.push((file.rsplit('/').next().unwrap_or(&file).to_owned(), points));
    }
    if sets.is_empty() {
        sets = synthetic();
    }
    println!(
        "{:22} {:>8} {:>10} {:>10} {:>10} {:>7} {:>9} {:>9}",
        "set", "points", "bytes", "bits/point", "Draco", "ratio", "enc k/s", "dec k/s"
    );
    for (name, mut points) in sets {
        let count = points.len();
        let size = draco(&points);
        let t = Instant::now();
        let mut e = Encoder::new();
        code_points(&mut e, &mut points, count);
        let bytes = e.finish();
        let encode = t.elapsed().as_secs_f64();
        let t = Instant::now();
        let mut back = Vec::new();
        code_points(&mut Decoder::new(&bytes), &mut back, count);
        let decode = t.elapsed().as_secs_f64();
        assert!(back == points, "{name}: decoded points differ");
        println!(
            "{name:22} {count:>8} {:>10} {:>10.3} {:>10} {:>7} {:>9.0} {:>9.0}",
            bytes.len(),
            bytes.len() as f64 * 8.0 / count as f64,
            size.map_or("-".to_owned(), |s| s.to_string()),
            size.map_or("-".to_owned(), |s| format!("{:.3}", bytes.len() as f64 / s as f64)),
            count as f64 / encode / 1e3,
            count as f64 / decode / 1e3
        );
    }
}
