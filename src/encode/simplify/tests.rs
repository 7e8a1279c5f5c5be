//! The rules of a batch, checked directly.

use super::*;
use crate::encode::cost::tests::{level_of, small_meshes};
use crate::encode::cost::{Carried, Class, Fixed, WeighInput, Weigher, dirty_vertices};
use crate::format::complex::{Level, Placement, Star, coarsen, legal};

fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// No element touches two of the edges, every edge is legal, and the greedy order was kept.
fn check(input: SelectInput, chosen: &[u32], name: &str) {
    let mut owner = vec![u32::MAX; input.slots.len()];
    for &e in chosen {
        let (a, b) = input.edges.ends(e);
        assert!(legal(input.faces, input.star, a, b), "{name}");
        assert!(input.weights[e as usize] != Fixed::ILLEGAL, "{name}");
        for v in [a, b] {
            assert_eq!(owner[v as usize], u32::MAX, "{name}: vertex {v} twice");
            owner[v as usize] = e;
        }
    }
    for element in input.faces.iter() {
        let mut owners: Vec<u32> = element.iter().map(|&v| owner[v as usize]).filter(|&e| e != u32::MAX).collect();
        owners.sort_unstable();
        owners.dedup();
        assert!(owners.len() <= 1, "{name}: element {element:?} touches {owners:?}");
    }
}

/// The greedy set by definition: all edges of the class sorted once.
fn naive(input: SelectInput, class: Class, factor: u32) -> Vec<u32> {
    let of = |e: u32| input.weights[e as usize];
    let all: Vec<u32> = (0..input.edges.len() as u32).filter(|&e| of(e).class() == class).collect();
    let plain: Vec<u32> = all.iter().copied().filter(|&e| !of(e).folds()).collect();
    let counted = if plain.is_empty() { &all } else { &plain };
    let sum: u64 = counted.iter().map(|&e| u64::from(of(e).value())).sum();
    let Some(mean) = sum.checked_div(counted.len() as u64) else { return Vec::new() };
    let mut order: Vec<_> = all
        .into_iter()
        .filter(|&e| u64::from(of(e).value()) <= (mean * u64::from(factor)) >> 8)
        .map(|e| {
            let (a, b) = input.edges.ends(e);
            (of(e).value(), select::hash(input.slots[a as usize], input.slots[b as usize]), e)
        })
        .collect();
    order.sort_unstable();
    let mut blocked: std::collections::HashSet<u32> = Default::default();
    let mut chosen = Vec::new();
    for (_, _, e) in order {
        let (a, b) = input.edges.ends(e);
        if !blocked.contains(&a) && !blocked.contains(&b) {
            chosen.push(e);
            for &f in input.star.get(a).iter().chain(input.star.get(b)) {
                blocked.extend(input.faces.get(f));
            }
        }
    }
    chosen
}

/// Collapse to the end as an encoder does; checks every batch and returns how many edges went in each, and how many were weighed.
fn run(name: &str, mut level: Level, mut positions: Vec<[f32; 3]>, carry: bool) -> (Vec<Vec<u32>>, u64, u64) {
    let mut slots: Vec<u32> = (0..positions.len() as u32).collect();
    let mut star = Star::build(positions.len(), &level.faces);
    let mut weigher = Weigher::new(350.0);
    let mut from: Option<(Vec<u32>, Vec<bool>)> = None;
    let (mut batches, mut total) = (Vec::new(), 0);
    loop {
        let input = WeighInput { faces: &level.faces, star: &star, positions: &positions, locked: None };
        let carried = from.as_ref().filter(|_| carry).map(|(old_of_new, dirty)| Carried { old_of_new, dirty });
        weigher.weigh(input, carried);
        total += weigher.edges().len() as u64;
        let input = SelectInput {
            faces: &level.faces,
            star: &star,
            edges: weigher.edges(),
            weights: weigher.weights(),
            slots: &slots,
        };
        let chosen = select(input, &SelectOptions::default());
        check(input, &chosen, name);
        if chosen.is_empty() {
            assert!(weigher.weights().iter().all(|&w| w == Fixed::ILLEGAL), "{name}: legal edges are left");
            return (batches, weigher.weighed(), total);
        }
        let first = weigher.weights()[chosen[0] as usize].class();
        let expected = naive(input, first, 256);
        if !expected.is_empty() {
            assert_eq!(chosen, expected, "{name}");
        }
        let pairs: Vec<[u32; 2]> = chosen.iter().map(|&e| weigher.edges().ends(e).into()).collect();
        let coarse = coarsen(&level, &star, &pairs, &[], Placement::default());
        let n = coarse.level.positions.len();
        let mut old_of_new = vec![u32::MAX; n];
        for (old, &new) in coarse.vertex.iter().enumerate().rev() {
            old_of_new[new as usize] = old as u32;
        }
        let mut moved: Vec<[f32; 3]> = old_of_new.iter().map(|&v| positions[v as usize]).collect();
        let mut merged = Vec::new();
        for &[a, b] in &pairs {
            let (p, q) = (positions[a as usize], positions[b as usize]);
            let v = coarse.vertex[a as usize];
            moved[v as usize] = [0, 1, 2].map(|k| 0.5 * (p[k] + q[k]));
            merged.push(v);
        }
        slots = old_of_new.iter().map(|&v| slots[v as usize]).collect();
        (positions, level, star) = (moved, coarse.level, coarse.star);
        from = Some((old_of_new, dirty_vertices(&level.faces, &star, &merged)));
        batches.push(chosen);
    }
}

#[test]
fn batches_are_independent_to_the_end_and_the_same_for_any_number_of_threads() {
    for (name, mesh) in small_meshes() {
        let (level, positions) = level_of(&mesh, 100.0);
        let all = run(name, level.clone(), positions.clone(), false);
        for threads in [1, 2, 4] {
            let carried = on_threads(threads, || run(name, level.clone(), positions.clone(), true));
            assert_eq!(all.0, carried.0, "{name}: carrying weights over on {threads} threads changes the batches");
            assert!(carried.1 <= all.1);
        }
    }
}

#[test]
fn large_meshes_are_weighed_and_selected_alike_on_any_number_of_threads() {
    for name in ["sphere", "mixed"] {
        let mesh = crate::samples::by_name(name, 30_000, 5).unwrap();
        let (level, positions) = level_of(&mesh, 1000.0);
        let star = Star::build(positions.len(), &level.faces);
        let slots: Vec<u32> = (0..positions.len() as u32).collect();
        let work = || {
            let mut weigher = Weigher::new(3500.0);
            let input = WeighInput { faces: &level.faces, star: &star, positions: &positions, locked: None };
            weigher.weigh(input, None);
            let (edges, weights) = (weigher.edges(), weigher.weights());
            let input = SelectInput { faces: &level.faces, star: &star, edges, weights, slots: &slots };
            let chosen = select(input, &SelectOptions::default());
            check(input, &chosen, name);
            assert!(chosen.len() > positions.len() / 20, "{name}: {} of {}", chosen.len(), positions.len());
            (edges.clone(), weights.to_vec(), chosen)
        };
        let one = on_threads(1, work);
        assert!(one == on_threads(2, work) && one == on_threads(4, work), "{name}");
    }
}

#[test]
fn limits_are_kept() {
    let mesh = crate::samples::by_name("torus", 900, 1).unwrap();
    let (level, positions) = level_of(&mesh, 100.0);
    let star = Star::build(positions.len(), &level.faces);
    let slots: Vec<u32> = (0..positions.len() as u32).collect();
    let mut weigher = Weigher::new(350.0);
    weigher.weigh(WeighInput { faces: &level.faces, star: &star, positions: &positions, locked: None }, None);
    let (edges, weights) = (weigher.edges(), weigher.weights());
    let input = SelectInput { faces: &level.faces, star: &star, edges, weights, slots: &slots };
    let all = select(input, &SelectOptions::default());
    let few = select(input, &SelectOptions { most: 7, ..SelectOptions::default() });
    assert_eq!(few, all[..7]);
    let more = select(input, &SelectOptions { least: usize::MAX, ..SelectOptions::default() });
    assert!(more.len() >= all.len() && more[..all.len()] == all, "more is the same and then some");
    check(input, &more, "torus");
}
