//! The weight against a naive reference in `f64` that learns what a collapse does from `coarsen`, and the weigher
//! against itself.

use super::*;
use crate::format::complex::{Faces, Level, Placement, Star, coarsen, legal};
use crate::mesh::Mesh;
use crate::samples;

type V = [f64; 3];

fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn mix(a: V, b: V, t: f64) -> V {
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])]
}

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Distance of a point to a segment, by the book.
fn to_segment(x: V, a: V, b: V) -> f64 {
    let e = sub(b, a);
    let t = if dot(e, e) > 0.0 { (dot(sub(x, a), e) / dot(e, e)).clamp(0.0, 1.0) } else { 0.0 };
    let r = sub(x, mix(a, b, t));
    dot(r, r).sqrt()
}

/// Distance of a point to a triangle: the foot on the plane if its barycentric coordinates allow, else the edges.
pub(crate) fn to_triangle(x: V, t: &[V; 3]) -> f64 {
    let (u, v, w) = (sub(t[1], t[0]), sub(t[2], t[0]), sub(x, t[0]));
    let (uu, uv, vv, wu, wv) = (dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v));
    let det = uu * vv - uv * uv;
    if det > 1e-14 * uu * vv {
        let (s, r) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
        if s >= 0.0 && r >= 0.0 && s + r <= 1.0 {
            let foot = [0, 1, 2].map(|k| t[0][k] + s * u[k] + r * v[k]);
            let d = sub(x, foot);
            return dot(d, d).sqrt();
        }
    }
    to_segment(x, t[0], t[1]).min(to_segment(x, t[1], t[2])).min(to_segment(x, t[2], t[0]))
}

fn nearest(x: V, triangles: &[[V; 3]]) -> f64 {
    triangles.iter().map(|t| to_triangle(x, t)).fold(f64::INFINITY, f64::min)
}

/// Largest distance of points spread over `from` (a grid of `n` parts a side) to `to`.
pub(crate) fn sampled(from: &[[V; 3]], to: &[[V; 3]], n: u32) -> f64 {
    let mut worst = 0.0f64;
    for t in from {
        for i in 0..=n {
            for j in 0..=n - i {
                let (s, r) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                let p = [0, 1, 2].map(|k| t[0][k] + s * (t[1][k] - t[0][k]) + r * (t[2][k] - t[0][k]));
                worst = worst.max(nearest(p, to));
            }
        }
    }
    worst
}

pub(crate) fn level_of(mesh: &Mesh, size: f64) -> (Level, Vec<[f32; 3]>) {
    let mut faces = Faces::new();
    for f in mesh.faces() {
        let repeats = (1..f.len()).any(|i| f[..i].contains(&f[i]));
        if f.len() >= 2 && !repeats {
            faces.push(f);
        }
    }
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|c| (c * size) as f32)).collect();
    let lattice = positions.iter().map(|p| p.map(|c| c.round() as i32)).collect();
    (Level { positions: lattice, faces, shift: 0 }, positions)
}

pub(crate) fn small_meshes() -> Vec<(&'static str, Mesh)> {
    ["asteroid", "crumbs", "cylinder", "fan-book", "mixed", "soup", "sphere", "terrain", "torus"]
        .into_iter()
        .flat_map(|name| [40, 120].into_iter().map(move |size| (name, size)))
        .filter_map(|(name, size)| Some((name, samples::by_name(name, size, 3)?)))
        .collect()
}

/// The elements at a vertex as the weight sees them: fans from the first of `apexes` that an element holds.
fn fans(faces: &Faces, star: &Star, apexes: &[u32], at: &dyn Fn(u32) -> V) -> Vec<[V; 3]> {
    let mut elements: Vec<u32> = apexes.iter().flat_map(|&v| star.get(v)).copied().collect();
    elements.sort_unstable();
    elements.dedup();
    let mut out = Vec::new();
    for f in elements {
        let e = faces.get(f);
        let i = apexes.iter().find_map(|v| e.iter().position(|x| x == v)).unwrap();
        let c = |k: usize| at(e[(i + k) % e.len()]);
        if e.len() == 2 {
            out.push([c(0), c(1), c(1)]);
        }
        for k in 1..e.len() - 1 {
            out.push([c(0), c(k), c(k + 1)]);
        }
    }
    out
}

/// Edges at `apexes` that exactly one element has, as flat triangles.
fn border(faces: &Faces, star: &Star, apexes: &[u32], at: &dyn Fn(u32) -> V) -> Vec<[V; 3]> {
    let mut edges = Vec::new();
    for &v in apexes {
        for &f in star.get(v) {
            let e = faces.get(f);
            let i = e.iter().position(|&x| x == v).unwrap();
            edges.push((v, e[(i + 1) % e.len()]));
            if e.len() > 2 {
                edges.push((v, e[(i + e.len() - 1) % e.len()]));
            }
        }
    }
    let single = edges.iter().filter(|x| edges.iter().filter(|y| y == x).count() == 1);
    // The edge between both was met at either end.
    let inner = edges.iter().filter(|(v, x)| apexes.contains(x) && v < x);
    let inner = inner.filter(|x| edges.iter().filter(|y| y == x).count() == 1);
    single.filter(|(_, x)| !apexes.contains(x)).chain(inner).map(|&(v, x)| [at(v), at(x), at(x)]).collect()
}

#[test]
fn weights_agree_with_dense_sampling() {
    let (mut ratios, mut compared, mut dangling) = (Vec::new(), 0, 0);
    for (name, mesh) in small_meshes() {
        let (level, positions) = level_of(&mesh, 100.0);
        let star = Star::build(positions.len(), &level.faces);
        let edges = EdgeList::build(&level.faces, &star);
        let (mut gatherer, mut patch, mut scratch) = (Gatherer::new(), Patch::default(), Scratch::default());
        for e in 0..edges.len() as u32 {
            let (a, b) = edges.ends(e);
            gatherer.read(&level.faces, &star, &positions, a, b, &mut patch);
            let weight = edge_weight(&patch, &mut scratch);
            assert_eq!(weight.class != Class::Illegal, legal(&level.faces, &star, a, b), "{name} {a} {b}");
            if weight.class == Class::Illegal || (name == "soup" && e % 7 > 0) {
                continue;
            }
            let coarse = coarsen(&level, &star, &[[a, b]], &[], Placement::default());
            let v = coarse.vertex[a as usize];
            let wide = |p: [f32; 3]| p.map(f64::from);
            let (pa, pb) = (wide(positions[a as usize]), wide(positions[b as usize]));
            let mut moved = vec![[0.0; 3]; coarse.level.positions.len()];
            for (old, &new) in coarse.vertex.iter().enumerate() {
                if (new as usize) < moved.len() {
                    moved[new as usize] = wide(positions[old]);
                }
            }
            moved[v as usize] = mix(pa, pb, 0.5);
            let count = |faces: &Faces| faces.iter().filter(|e| e.len() == 2).count();
            let length = to_segment(pa, pb, pb);
            let tolerance = 1e-4 * length + 1e-3;
            match weight.class {
                Class::Dangling => {
                    dangling += 1;
                    assert!((f64::from(weight.value) - length).abs() < tolerance);
                    continue;
                }
                Class::Breaking => continue,
                _ => assert!(count(&coarse.level.faces) <= count(&level.faces), "{name} {a} {b}: a dangling edge"),
            }
            let at = |x: u32| wide(positions[x as usize]);
            let before = fans(&level.faces, &star, &[a, b], &at);
            let after_at = |x: u32| moved[x as usize];
            let after = fans(&coarse.level.faces, &coarse.star, &[v], &after_at);
            let ends = nearest(pa, &after).max(nearest(pb, &after));
            let n = 10;
            let mut true_distance = sampled(&before, &after, n).max(sampled(&after, &before, n));
            let old = border(&level.faces, &star, &[a, b], &at);
            let new = border(&coarse.level.faces, &coarse.star, &[v], &after_at);
            if !old.is_empty() && !new.is_empty() {
                true_distance = true_distance.max(nearest(mix(pa, pb, 0.5), &old));
                let open = |v: u32| !border(&level.faces, &star, &[v], &at).is_empty();
                for (x, p) in [(a, pa), (b, pb)] {
                    if open(x) {
                        true_distance = true_distance.max(nearest(p, &new));
                    }
                }
            }
            let longest = before.iter().map(|t| to_segment(t[0], t[1], t[1]).max(to_segment(t[0], t[2], t[2])));
            let spacing = longest.fold(0.0, f64::max) / f64::from(n);
            let value = f64::from(weight.value) - if weight.folds { length } else { 0.0 };
            assert!(value >= ends - tolerance, "{name} {a} {b}: {value} < {ends} at the ends");
            assert!(value <= true_distance + spacing, "{name} {a} {b}: {value} > {true_distance}");
            assert!(value <= 0.5 * length + tolerance, "{name} {a} {b}: more than the motion");
            if true_distance > 0.02 * length {
                ratios.push(value / true_distance);
            }
            compared += 1;
        }
    }
    ratios.sort_by(f64::total_cmp);
    let quantile = |q: usize| ratios[ratios.len() * q / 100];
    assert!(compared > 1000 && dangling > 10, "{compared} compared, {dangling} dangling");
    assert!(
        quantile(50) > 0.99 && quantile(10) > 0.9 && quantile(1) > 0.5,
        "{} {} {}",
        quantile(50),
        quantile(10),
        quantile(1)
    );
}

/// A square grid in the plane, cut into triangles.
fn grid(n: u32) -> (Faces, Vec<[f32; 3]>) {
    let mut faces = Faces::new();
    let mut positions = Vec::new();
    for y in 0..n {
        for x in 0..n {
            positions.push([x as f32 * 10.0, y as f32 * 10.0, 5.0]);
            if x > 0 && y > 0 {
                let v = y * n + x;
                faces.push(&[v - n - 1, v - n, v]);
                faces.push(&[v - n - 1, v, v - 1]);
            }
        }
    }
    (faces, positions)
}

#[test]
fn a_flat_grid_is_free_inside_and_costs_at_its_corners() {
    let n = 8;
    let (faces, positions) = grid(n);
    let star = Star::build(positions.len(), &faces);
    let mut weigher = Weigher::new(100.0);
    weigher.weigh(WeighInput { faces: &faces, star: &star, positions: &positions, locked: None }, None);
    let mut locked = vec![false; positions.len()];
    for v in 0..n * n {
        let inside = |v: u32| (1..n - 1).contains(&(v % n)) && (1..n - 1).contains(&(v / n));
        locked[v as usize] = !inside(v);
        for &w in weigher.edges().larger(v) {
            let weight = weigher.weights()[weigher.edges().find(w, v).unwrap() as usize];
            let corner = |v: u32| [0, n - 1].contains(&(v % n)) && [0, n - 1].contains(&(v / n));
            let along = !inside(v) && !inside(w) && (v % n == w % n || v / n == w / n);
            if inside(v) && inside(w) || along && !corner(v) && !corner(w) {
                assert_eq!((weight.class(), weight.value()), (Class::Ordinary, 0), "{v} {w}");
            } else if weight.class() == Class::Ordinary {
                assert!(weigher.scale().length(weight.value()) > 1.0, "{v} {w}: the border erodes for free");
            }
        }
    }
    weigher.weigh(WeighInput { faces: &faces, star: &star, positions: &positions, locked: Some(&locked) }, None);
    for e in 0..weigher.edges().len() as u32 {
        let (a, b) = weigher.edges().ends(e);
        let weight = weigher.weights()[e as usize];
        assert_eq!(weight == Fixed::ILLEGAL, locked[a as usize] || locked[b as usize]);
    }
}

#[test]
fn a_face_that_turns_over_is_penalized() {
    // v lands beyond the edge between 2 and 3, so the face (0, 2, 3) turns.
    let points = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, -2.0, 0.0], [-9.0, 0.0, 0.0]];
    let mut faces = Faces::new();
    for t in [[0, 1, 2], [1, 0, 3], [0, 2, 4], [0, 4, 3]] {
        faces.push(&t);
    }
    faces.push(&[1, 5, 2]);
    faces.push(&[1, 3, 5]);
    let mut positions = points.to_vec();
    positions.push([20.0, 0.0, 0.0]);
    let star = Star::build(6, &faces);
    let (mut gatherer, mut patch, mut scratch) = (Gatherer::new(), Patch::default(), Scratch::default());
    gatherer.read(&faces, &star, &positions, 0, 1, &mut patch);
    assert!(!edge_weight(&patch, &mut scratch).folds, "the faces to the left only stretch");
    positions[2] = [6.0, 8.0, 0.0];
    positions[4] = [6.0, 1.0, 0.0];
    let mut gatherer = Gatherer::new();
    gatherer.read(&faces, &star, &positions, 0, 1, &mut patch);
    let weight = edge_weight(&patch, &mut scratch);
    assert!(weight.folds && weight.value >= 10.0, "{weight:?}");
}

#[test]
fn edges_are_found_by_their_ends() {
    for (name, mesh) in small_meshes() {
        let (level, positions) = level_of(&mesh, 100.0);
        let star = Star::build(positions.len(), &level.faces);
        let edges = EdgeList::build(&level.faces, &star);
        let mut naive = std::collections::BTreeSet::new();
        for e in level.faces.iter() {
            for i in 0..e.len() {
                let (a, b) = (e[i], e[(i + 1) % e.len()]);
                naive.insert((a.min(b), a.max(b)));
            }
        }
        let listed: Vec<(u32, u32)> = (0..edges.len() as u32).map(|e| edges.ends(e)).collect();
        assert_eq!(listed, naive.into_iter().collect::<Vec<_>>(), "{name}");
        let mut near = Vec::new();
        for a in 0..positions.len() as u32 {
            neighbours(&level.faces, &star, a, &mut near);
            let found: Vec<u32> = (0..positions.len() as u32).filter(|&b| edges.find(b, a).is_some()).collect();
            assert_eq!(near, found, "{name}");
        }
    }
}

#[test]
fn a_hub_is_weighed_cheaply_or_left_alone() {
    for rim in [100u32, 300, 1000, 4000] {
        let mut faces = Faces::new();
        let mut positions = vec![[0.0f32, 0.0, 50.0]];
        for i in 0..rim {
            let (s, c) = (i as f32 / rim as f32 * std::f32::consts::TAU).sin_cos();
            positions.push([100.0 * c, 100.0 * s, 0.0]);
            faces.push(&[0, i + 1, (i + 1) % rim + 1]);
        }
        let star = Star::build(positions.len(), &faces);
        let mut weigher = Weigher::new(300.0);
        weigher.weigh(WeighInput { faces: &faces, star: &star, positions: &positions, locked: None }, None);
        let rim_edge = weigher.edges().find(1, 2).unwrap() as usize;
        assert_eq!(weigher.weights()[rim_edge].class(), Class::Ordinary);
        let spoke = weigher.weights()[weigher.edges().find(0, 1).unwrap() as usize];
        assert_eq!(spoke.class(), if rim < 2700 { Class::Ordinary } else { Class::Illegal });
    }
}

#[test]
fn fixed_weights_order_by_class_and_never_overflow() {
    let scale = Scale::new(100.0);
    let of = |class, value| scale.fixed(Weight { class, value, folds: false });
    let rising = [
        of(Class::Ordinary, 0.0),
        of(Class::Ordinary, 150.0),
        of(Class::Ordinary, f32::INFINITY),
        of(Class::Breaking, 1.0),
        of(Class::Breaking, 1e30),
        of(Class::Dangling, 0.0),
        of(Class::Dangling, 100.0),
        scale.fixed(Weight::ILLEGAL),
    ];
    assert!(rising.is_sorted() && rising.windows(2).all(|w| w[0] != w[1]));
    assert_eq!(of(Class::Ordinary, f32::NAN).value(), 0);
    assert!((scale.length(of(Class::Ordinary, 12.5).value()) - 12.5).abs() < 1e-6);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(Scale::new(bad).length(1 << 27), 1.0);
    }
}
