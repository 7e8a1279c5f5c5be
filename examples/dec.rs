//! Experiments: decode a file some times; write it first with `dec IN OUT`.
use lodestream::decode::*;
use lodestream::encode::*;
use lodestream::read::*;
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    if a.len() > 2 {
        let m = read_path(std::path::Path::new(&a[1]), &ReadOptions::default()).unwrap().mesh;
        std::fs::write(&a[2], encode(&m, &EncodeOptions::default(), &|_| {}).unwrap().bytes).unwrap();
        return;
    }
    let bytes = std::fs::read(&a[1]).unwrap();
    for _ in 0..std::env::var("N").ok().and_then(|v| v.parse().ok()).unwrap_or(3) {
        let t = Instant::now();
        let mut d = Decoder::new(DecodeOptions::default());
        d.push(&bytes);
        while let Step::Level(_) = d.next_level().unwrap() {}
        let s = t.elapsed().as_secs_f64();
        let n = d.complex().positions.len();
        println!("{n} v {s:.3} s {:.0} k/s", n as f64 / s / 1e3);
    }
}
