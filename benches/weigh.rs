//! Speed of weighing and selecting: `cargo bench --bench weigh`. With `LODESTREAM_DATA` it takes the dragon, too.
#![allow(missing_docs)]

use std::time::Instant;

use lodestream::complex::{Faces, Star};
use lodestream::generate;
use lodestream::metric::{BoundScratch, Class, EdgeList, Gatherer, Patch, WeighInput, Weigher, hausdorff_bound};
use lodestream::read::{ReadOptions, read_path};
use lodestream::simplify::{SelectInput, SelectOptions, select};

/// Time this thread spent on a core, where the system says so (others may share the machine), else time that passed.
struct Clock(Option<u64>, Instant);

impl Clock {
    fn busy() -> Option<u64> {
        std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
    }

    fn now() -> Self {
        Clock(Clock::busy(), Instant::now())
    }

    fn seconds(&self) -> f64 {
        match (self.0, Clock::busy()) {
            (Some(from), Some(to)) => (to - from) as f64 * 1e-9,
            _ => self.1.elapsed().as_secs_f64(),
        }
    }
}

fn main() {
    let smoke = std::env::args().any(|a| a == "--smoke" || a == "--test");
    let frequency = if smoke { 10 } else { 200 };
    let mesh = generate::sphere(frequency, 0.02, 1);
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|c| (c * 2000.0) as f32)).collect();
    let mut faces = Faces::new();
    mesh.faces().for_each(|f| faces.push(f));
    measure("noisy sphere", &faces, &positions, smoke);
    dragon(smoke);
}

/// The dragon at 12 bits an axis.
fn dragon(smoke: bool) {
    let Some(folder) = std::env::var_os("LODESTREAM_DATA").filter(|_| !smoke) else {
        println!("dragon: skipped, LODESTREAM_DATA is not set or this is a smoke run");
        return;
    };
    let path = std::path::Path::new(&folder).join("classic/dragon_vrip.ply.gz");
    let mesh = match read_path(&path, &ReadOptions::default()) {
        Ok(read) => read.mesh,
        Err(error) => {
            println!("dragon: skipped, {error}");
            return;
        }
    };
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for p in &mesh.positions {
        for k in 0..3 {
            (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
        }
    }
    let side = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let step = side / 4095.0;
    let positions: Vec<[f32; 3]> =
        mesh.positions.iter().map(|p| [0, 1, 2].map(|k| ((p[k] - low[k]) / step).round() as f32)).collect();
    let mut faces = Faces::new();
    for f in mesh.faces() {
        if (1..f.len()).all(|i| !f[..i].contains(&f[i])) {
            faces.push(f);
        }
    }
    measure("dragon", &faces, &positions, smoke);
}

fn measure(name: &str, faces: &Faces, positions: &[[f32; 3]], smoke: bool) {
    let star = Star::build(positions.len(), faces);
    let started = Clock::now();
    let edges = EdgeList::build(faces, &star);
    let build = started.seconds();
    println!("{name}: {} vertices, {} edges; edge list in {:.1} ms", positions.len(), edges.len(), build * 1e3);

    let (mut gatherer, mut patch) = (Gatherer::new(), Patch::default());
    for round in 0..if smoke { 1 } else { 3 } {
        let started = Clock::now();
        let mut ring = 0;
        for a in 0..positions.len() as u32 {
            for &b in edges.larger(a) {
                gatherer.read(faces, &star, positions, a, b, &mut patch);
                ring += patch.ring.len();
            }
        }
        let gather = started.seconds();
        gatherer.forget();
        gatherer.forget();
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() else { return };
        let (seconds, mean, folds) = pool.install(|| {
            let mut weigher = Weigher::new(4000.0);
            let started = Clock::now();
            weigher.weigh(WeighInput { faces, star: &star, positions, locked: None }, None);
            let seconds = started.seconds();
            let ordinary = || weigher.weights().iter().filter(|w| w.class() == Class::Ordinary && !w.folds());
            let sum: u64 = ordinary().map(|w| u64::from(w.value())).sum();
            let mean = weigher.scale().length(1) * sum as f64 / ordinary().count() as f64;
            (seconds, mean, weigher.weights().iter().filter(|w| w.folds()).count())
        });
        println!(
            "  round {round}: {:.2} M edges/s on one core (gathering alone {:.2} M/s); mean {mean:.4}, folds {folds}, ring {:.2}",
            edges.len() as f64 / seconds / 1e6,
            edges.len() as f64 / gather / 1e6,
            ring as f64 / edges.len() as f64,
        );
    }

    let mut bounds = BoundScratch::default();
    let started = Clock::now();
    let (mut measured, mut tight, mut sum) = (0, 0, 0.0);
    for a in (0..positions.len() as u32).step_by(8) {
        for &b in edges.larger(a) {
            gatherer.read(faces, &star, positions, a, b, &mut patch);
            let length = 2.0 * patch.half.iter().map(|&c| f64::from(c * c)).sum::<f64>().sqrt();
            let bound = hausdorff_bound(&patch, [0.0; 3], 0.0, &mut bounds);
            measured += 1;
            sum += bound;
            tight += u32::from(bound < 0.25 * length);
        }
    }
    let each = started.seconds() / f64::from(measured);
    println!(
        "  guaranteed bounds: {:.2} µs each, mean {:.4}, {:.1} % below half the motion",
        each * 1e6,
        sum / f64::from(measured),
        100.0 * f64::from(tight) / f64::from(measured)
    );
    gatherer.forget();

    let started = Instant::now();
    let mut weigher = Weigher::new(4000.0);
    weigher.weigh(WeighInput { faces, star: &star, positions, locked: None }, None);
    let weigh = started.elapsed().as_secs_f64();
    let slots: Vec<u32> = (0..positions.len() as u32).collect();
    let started = Instant::now();
    let input = SelectInput { faces, star: &star, edges: weigher.edges(), weights: weigher.weights(), slots: &slots };
    let chosen = select(input, &SelectOptions::default());
    println!(
        "  all threads: weigh {:.1} ms, select {:.1} ms: {} edges",
        weigh * 1e3,
        started.elapsed().as_secs_f64() * 1e3,
        chosen.len()
    );
}
