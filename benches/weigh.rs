//! Speed of weighing and selecting: `cargo bench --bench weigh`. With `LODESTREAM_DATA` it takes the dragon, too.
#![allow(missing_docs)]

use std::time::Instant;

use lodestream::complex::{Faces, Star};
use lodestream::generate;
use lodestream::metric::{EdgeList, Gatherer, Patch, Scratch, WeighInput, Weigher, edge_weight};
use lodestream::simplify::{SelectInput, SelectOptions, select};

fn main() {
    let smoke = std::env::args().any(|a| a == "--smoke" || a == "--test");
    let frequency = if smoke { 10 } else { 200 };
    let mesh = generate::sphere(frequency, 0.02, 1);
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|c| (c * 2000.0) as f32)).collect();
    let mut faces = Faces::new();
    mesh.faces().for_each(|f| faces.push(f));
    measure("noisy sphere", &faces, &positions, smoke);
}

fn measure(name: &str, faces: &Faces, positions: &[[f32; 3]], smoke: bool) {
    let star = Star::build(positions.len(), faces);
    let started = Instant::now();
    let edges = EdgeList::build(faces, &star);
    let build = started.elapsed().as_secs_f64();
    println!("{name}: {} vertices, {} edges; edge list in {:.1} ms", positions.len(), edges.len(), build * 1e3);

    let (mut gatherer, mut patch, mut scratch) = (Gatherer::new(), Patch::default(), Scratch::default());
    for round in 0..if smoke { 1 } else { 3 } {
        let started = Instant::now();
        let mut ring = 0;
        for a in 0..positions.len() as u32 {
            for &b in edges.larger(a) {
                gatherer.read(faces, &star, positions, a, b, &mut patch);
                ring += patch.ring.len();
            }
        }
        let gather = started.elapsed().as_secs_f64();
        gatherer.forget();
        let started = Instant::now();
        let (mut sum, mut folds) = (0.0, 0);
        for a in 0..positions.len() as u32 {
            for &b in edges.larger(a) {
                gatherer.read(faces, &star, positions, a, b, &mut patch);
                let weight = edge_weight(&patch, &mut scratch);
                sum += f64::from(weight.value);
                folds += u32::from(weight.folds);
            }
        }
        gatherer.forget();
        let seconds = started.elapsed().as_secs_f64();
        println!(
            "  round {round}: {:.2} M edges/s on one core (gathering alone {:.2} M/s); mean {:.4}, folds {folds}, ring {:.2}",
            edges.len() as f64 / seconds / 1e6,
            edges.len() as f64 / gather / 1e6,
            sum / edges.len() as f64,
            ring as f64 / edges.len() as f64,
        );
    }

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
