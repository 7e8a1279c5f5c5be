//! Experiments: round trip of given files, with times.
use lodestream::compare::*;
use lodestream::decode::*;
use lodestream::encode::*;
use lodestream::lattice::*;
use lodestream::read::*;
use std::time::Instant;
fn main() {
    for path in std::env::args().skip(1) {
        let read = match read_path(std::path::Path::new(&path), &ReadOptions::default()) {
            Ok(r) => r,
            Err(e) => {
                println!("{path}: {e}");
                continue;
            }
        };
        let m = read.mesh;
        let o = EncodeOptions::default();
        let t = Instant::now();
        let e = match encode(&m, &o, &|_| {}) {
            Ok(e) => e,
            Err(e) => {
                println!("{path}: ERROR {e}");
                continue;
            }
        };
        let te = t.elapsed().as_secs_f64();
        let t = Instant::now();
        let mut d = Decoder::new(DecodeOptions::default());
        d.push(&e.bytes);
        loop {
            match d.next_level() {
                Ok(Step::Level(_)) => {}
                Ok(Step::Full) => break,
                x => {
                    println!("{path}: DECODE {x:?}");
                    break;
                }
            }
        }
        let td = t.elapsed().as_secs_f64();
        let lattice = Lattice::choose(Quantization::Bits(12), &m.positions).unwrap();
        let back = d.to_mesh();
        let verdict = by_map(&m, &back, &lattice, &e.map).and(by_position(&m, &back, &lattice));
        let n = m.positions.len().max(1);
        println!(
            "{:40} {:7}v {:7}f {:8} B {:6.2} bpv levels {:3} enc {:.2}s {:.0}k/s dec {:.3}s {:.0}k/s  {:?}",
            std::path::Path::new(&path).file_name().unwrap().to_string_lossy(),
            n,
            m.face_count(),
            e.bytes.len(),
            e.bytes.len() as f64 * 8.0 / n as f64,
            e.report.levels,
            te,
            n as f64 / te / 1e3,
            td,
            n as f64 / td / 1e3,
            verdict
        );
    }
}
