//! Experiments: bits per vertex by kind on given files.
use lodestream::complex::*;
use lodestream::lattice::*;
use lodestream::read::*;
use lodestream::simplify::*;
use std::time::Instant;
fn main() {
    for path in std::env::args().skip(1) {
        let m = read_path(std::path::Path::new(&path), &ReadOptions::default()).unwrap().mesh;
        let lattice = Lattice::choose(Quantization::Bits(12), &m.positions).unwrap();
        let positions = lattice.quantize(&m.positions).unwrap();
        let mut used = vec![false; positions.len()];
        let mut faces = Faces::new();
        for f in m.faces() {
            if (0..f.len()).all(|i| !f[..i].contains(&f[i])) {
                faces.push(f);
            }
            for &v in f {
                used[v as usize] = true;
            }
        }
        let inuse = used.iter().filter(|&&u| u).count();
        let n = positions.len();
        let level = Level { positions, faces, shift: 0 };
        let mut options = SimplifyOptions::default();
        let env = |k: &str, d: u32| std::env::var(k).ok().and_then(|v| v.parse().ok()).unwrap_or(d);
        options.alpha = env("ALPHA", options.alpha as u32) as u8;
        options.factor = env("FACTOR", options.factor);
        options.edge_steps = env("STEPS", options.edge_steps);
        let t = Instant::now();
        let h = simplify(level, &options, &|_| {});
        let t1 = t.elapsed().as_secs_f64();
        let r = replay(&h, n, &|_| {}).unwrap();
        let t2 = t.elapsed().as_secs_f64();
        let bytes: usize = r.pieces.iter().map(|p| p.payload.len()).sum();
        if std::env::var("LEVELS").is_ok() {
            eprintln!("{:?}", r.levels.iter().map(|l| (l.0, l.3)).collect::<Vec<_>>());
        }
        let a = r.account;
        let v = inuse as f64;
        let tenth = r
            .pieces
            .iter()
            .scan(0usize, |s, p| {
                *s += p.payload.len();
                Some((p.last, *s))
            })
            .find(|&(l, _)| r.levels[l as usize].0 as usize * 10 >= n)
            .map(|(_, b)| b as f64 * 8.0 / v)
            .unwrap_or(0.0);
        println!(
            "{:30} {:7}v {:3} levels base {:5} pieces {:4} | conn {:.2} geo {:.2} pts {:.3} total {:.2} bpv | 10%: {:.2} | simplify {:.2}s ({:.2} {:.2} {:.2}) {:.0}k v/s replay {:.2}s weighed {:.1}/edge",
            std::path::Path::new(&path).file_name().unwrap().to_string_lossy(),
            n,
            r.levels.len(),
            r.levels[0].0,
            r.pieces.len(),
            a.splits.connectivity / v,
            a.splits.geometry / v,
            a.points / v,
            bytes as f64 * 8.0 / v,
            tenth,
            t1,
            h.seconds[0],
            h.seconds[1],
            h.seconds[2],
            n as f64 / t2 / 1e3,
            t2 - t1,
            h.edges_weighed as f64 / (3.0 * v)
        );
    }
}
