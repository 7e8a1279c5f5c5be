//! The arithmetic of `edge_weight`: a pure function of a small flat patch.
//!
//! Triangles lie in blocks of eight lanes, which `lanes` computes with vectors of whatever width the machine has; no
//! operation is contracted or reordered, so the result is the same for every width. What skips work
//! (a sample whose distance cannot exceed the largest so far) compares upper bounds that are distances themselves.

#![allow(clippy::needless_range_loop)] // lanes are numbered

mod folds;
mod spokes;

use self::folds::{folds_polygons, folds_triangles};
use self::spokes::{Crossing, crossings, frame, middles};
use super::lanes::{LANES, Lane, Lane3, V, V3, all3, of3, put3, vcross, vdot, vscale, vsub};
use super::weight::{Class, MAX_RING, Patch, Weight};
use pulp::{Scalar, Simd};

/// Where the lanes without a triangle lie: far from everything, yet its square is finite.
const FAR: f32 = 1e18;

/// Triangles `c, c + e0, c + e1`, and what the distance of a point to them needs.
#[derive(Clone, Copy, Debug)]
struct Block {
    c: Lane3,
    e0: Lane3,
    e1: Lane3,
    /// Normal `e0 × e1`.
    n: Lane3,
    /// Dual basis of `e0, e1` in the plane; zero where the triangle is a segment or nearly so.
    m0: Lane3,
    m1: Lane3,
    /// One over the squared lengths of the edges `e0`, `e1`, `e1 − e0`, and of the normal; zero for zero.
    i0: Lane,
    i1: Lane,
    i2: Lane,
    inn: Lane,
}

const EMPTY: Block = Block {
    c: [[FAR; LANES]; 3],
    e0: [[0.0; LANES]; 3],
    e1: [[0.0; LANES]; 3],
    n: [[0.0; LANES]; 3],
    m0: [[0.0; LANES]; 3],
    m1: [[0.0; LANES]; 3],
    i0: [0.0; LANES],
    i1: [0.0; LANES],
    i2: [0.0; LANES],
    inn: [0.0; LANES],
};

/// Memory that `edge_weight` reuses from edge to edge.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    before: Vec<Block>,
    after: Vec<Block>,
    /// Ring vertices in the frame of the patch, by block.
    flat: Vec<Lane3>,
    crossings: Vec<Crossing>,
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn scale(a: [f32; 3], s: f32) -> [f32; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
fn lane(a: &Lane3, l: usize) -> [f32; 3] {
    [a[0][l], a[1][l], a[2][l]]
}

#[inline(always)]
fn put(a: &mut Lane3, l: usize, v: [f32; 3]) {
    a[0][l] = v[0];
    a[1][l] = v[1];
    a[2][l] = v[2];
}

/// One over `x`, or 0 for 0.
#[inline(always)]
fn inverse(x: f32) -> f32 {
    let r = 1.0 / x;
    if x > 0.0 { r } else { 0.0 }
}

/// Into 0 ..= 1; compiles to two instructions.
#[inline(always)]
fn unit(x: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < 1.0 { x } else { 1.0 }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Fill in the normals: all that a patch needs which no point is compared with.
#[inline(always)]
fn prepare_normals<S: Simd>(simd: S, b: &mut Block) {
    for k in 0..V::<S>::PARTS {
        let n = vcross(of3(simd, &b.e0, k), of3(simd, &b.e1, k));
        put3(n, &mut b.n, k);
    }
}

/// What the distance of a point to some triangles needs; see [`Block`].
#[derive(Clone, Copy)]
struct Prepared<S: Simd> {
    e0: V3<S>,
    e1: V3<S>,
    n: V3<S>,
    m0: V3<S>,
    m1: V3<S>,
    i0: V<S>,
    i1: V<S>,
    i2: V<S>,
    inn: V<S>,
}

#[inline(always)]
fn prepared<S: Simd>(simd: S, e0: V3<S>, e1: V3<S>) -> Prepared<S> {
    let e2 = vsub(e1, e0);
    let (d0, d1, d2) = (vdot(e0, e0), vdot(e1, e1), vdot(e2, e2));
    let n = vcross(e0, e1);
    let nn = vdot(n, n);
    // Below an angle of 1e-4 the normal is noise: there the edges alone stand for the triangle.
    let inn = V::if_less(V::all(simd, 1e-8) * d0 * d1, nn, nn.inverse(), V::all(simd, 0.0));
    Prepared {
        e0,
        e1,
        n,
        m0: vscale(vcross(e1, n), inn),
        m1: vscale(vcross(n, e0), inn),
        i0: d0.inverse(),
        i1: d1.inverse(),
        i2: d2.inverse(),
        inn,
    }
}

/// Squared distances of points to triangles whose first corners they are seen from.
#[inline(always)]
fn near<S: Simd>(simd: S, w: V3<S>, t: &Prepared<S>) -> V<S> {
    let r0 = vsub(w, vscale(t.e0, (vdot(w, t.e0) * t.i0).unit()));
    let r1 = vsub(w, vscale(t.e1, (vdot(w, t.e1) * t.i1).unit()));
    let (w2, e2) = (vsub(w, t.e0), vsub(t.e1, t.e0));
    let r2 = vsub(w2, vscale(e2, (vdot(w2, e2) * t.i2).unit()));
    let edges = vdot(r0, r0).smaller(vdot(r1, r1)).smaller(vdot(r2, r2));
    let (s, r) = (vdot(w, t.m0), vdot(w, t.m1));
    let h = vdot(w, t.n);
    let plane = h * h * t.inn;
    // Strict, so that a segment, whose m0 and m1 are zero, is never taken for a plane.
    let inside = s.smaller(r).smaller(V::all(simd, 1.0) - (s + r));
    V::if_less(V::all(simd, 0.0), inside, plane, edges)
}

/// Fill in all that follows from `e0` and `e1`.
#[inline(always)]
fn prepare<S: Simd>(simd: S, b: &mut Block) {
    for k in 0..V::<S>::PARTS {
        let t = prepared(simd, of3(simd, &b.e0, k), of3(simd, &b.e1, k));
        put3(t.n, &mut b.n, k);
        put3(t.m0, &mut b.m0, k);
        put3(t.m1, &mut b.m1, k);
        t.i0.put(&mut b.i0, k);
        t.i1.put(&mut b.i1, k);
        t.i2.put(&mut b.i2, k);
        t.inn.put(&mut b.inn, k);
    }
}

/// The smallest lane.
#[inline(always)]
fn least(a: &Lane) -> f32 {
    let low = smaller(smaller(a[0], a[4]), smaller(a[2], a[6]));
    smaller(low, smaller(smaller(a[1], a[5]), smaller(a[3], a[7])))
}

/// Squared distance from `x` to the nearest triangle, or anything from there to `enough` where it is not larger than that.
#[inline(always)]
fn distance2<S: Simd>(simd: S, x: [f32; 3], blocks: &[Block], enough: f32) -> f32 {
    let mut best = [f32::INFINITY; LANES];
    let x = all3(simd, x);
    for (i, b) in blocks.iter().enumerate() {
        if i > 0 && least(&best) <= enough {
            break;
        }
        for k in 0..V::<S>::PARTS {
            let t = Prepared {
                e0: of3(simd, &b.e0, k),
                e1: of3(simd, &b.e1, k),
                n: of3(simd, &b.n, k),
                m0: of3(simd, &b.m0, k),
                m1: of3(simd, &b.m1, k),
                i0: V::of(simd, &b.i0, k),
                i1: V::of(simd, &b.i1, k),
                i2: V::of(simd, &b.i2, k),
                inn: V::of(simd, &b.inn, k),
            };
            let d = near(simd, vsub(x, of3(simd, &b.c, k)), &t);
            V::of(simd, &best, k).smaller(d).put(&mut best, k);
        }
    }
    least(&best)
}

/// Squared distance from `x` to the segment from `c` to `d`.
#[inline(always)]
fn segment2(x: [f32; 3], c: [f32; 3], d: [f32; 3]) -> f32 {
    let (w, e) = (sub(x, c), sub(d, c));
    let r = sub(w, scale(e, unit(dot(w, e) * inverse(dot(e, e)))));
    dot(r, r)
}

/// Squared distance from `x` to the triangle `c, p, q`. CPU twin of `triangle2` in `shaders/triangle.wgsl`.
pub fn triangle_distance2(x: [f32; 3], c: [f32; 3], p: [f32; 3], q: [f32; 3]) -> f32 {
    let one = Scalar;
    let t = prepared(one, all3(one, sub(p, c)), all3(one, sub(q, c)));
    near(one, all3(one, sub(x, c)), &t).1
}

/// The weight of the edge whose patch this is. See the module `weight` for what it measures.
pub fn edge_weight(patch: &Patch, scratch: &mut Scratch) -> Weight {
    struct Alone<'a>(&'a Patch, &'a mut Scratch);
    impl pulp::WithSimd for Alone<'_> {
        type Output = Weight;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Weight {
            edge_weight_by(simd, self.0, self.1)
        }
    }
    pulp::Arch::new().dispatch(Alone(patch, scratch))
}

/// The same within a function that is compiled for these vectors.
#[inline(always)]
pub fn edge_weight_by<S: Simd>(simd: S, patch: &Patch, scratch: &mut Scratch) -> Weight {
    match patch.class {
        Class::Illegal => Weight::ILLEGAL,
        Class::Dangling => {
            let length = 2.0 * dot(patch.half, patch.half).sqrt();
            Weight { class: Class::Dangling, value: length, folds: false }
        }
        Class::Breaking => Weight { class: Class::Breaking, value: area_change(patch).abs().sqrt(), folds: false },
        Class::Ordinary => {
            let (distance2, folds) = ordinary(simd, patch, scratch);
            let mut value = distance2.sqrt();
            if folds {
                value += 2.0 * dot(patch.half, patch.half).sqrt();
            }
            Weight { class: Class::Ordinary, value, folds }
        }
    }
}

/// Area after less area before.
fn area_change(patch: &Patch) -> f32 {
    let area = |c: [f32; 3], p: [f32; 3], q: [f32; 3]| {
        let n = cross(sub(p, c), sub(q, c));
        0.5 * dot(n, n).sqrt()
    };
    let (b, a) = (patch.half, scale(patch.half, -1.0));
    let mut change = 0.0;
    for t in &patch.triangles {
        let (p, q) = (patch.ring[t.p as usize].at, patch.ring[t.q as usize].at);
        change += area([0.0; 3], p, q) - area(if t.at_b { b } else { a }, p, q);
    }
    for &(x, _) in &patch.vanishing {
        change -= area(patch.ring[x as usize].at, a, b);
    }
    change
}

/// Squared distance and whether a face folds, for a patch of [`Class::Ordinary`].
#[inline(always)]
fn ordinary<S: Simd>(simd: S, patch: &Patch, scratch: &mut Scratch) -> (f32, bool) {
    let b = patch.half;
    let a = scale(b, -1.0);
    // No point of either patch is farther from the other than the ends move.
    let reach = dot(b, b);
    if patch.ring.len() > MAX_RING {
        return (reach, folds_polygons(patch, a, b));
    }
    lay_out(simd, patch, scratch);

    let mut worst = distance2(simd, a, &scratch.after, 0.0);
    worst = larger(worst, distance2(simd, b, &scratch.after, worst));
    if patch.borders {
        worst = larger(worst, borders(patch, a, b));
    }
    let folds = if patch.polygons {
        folds_polygons(patch, a, b)
    } else {
        folds_triangles(simd, &scratch.before, &scratch.after)
    };
    if reach <= worst {
        return (worst, folds);
    }
    match frame(simd, &scratch.before, &scratch.after) {
        Some(frame) => worst = crossings(simd, patch, scratch, &frame, worst),
        // In the middle of a spoke the motion is half as large as at its end.
        None if reach * 0.25 > worst => worst = middles(simd, patch, scratch, worst),
        None => {}
    }
    (worst, folds)
}

/// So many blocks, of which the last holds no triangles yet: the others are about to be filled, and what follows from the edges is
/// computed before it is read.
#[inline(always)]
fn make_room(blocks: &mut Vec<Block>, count: usize) {
    blocks.resize(count, EMPTY);
    if let Some(last) = blocks.last_mut() {
        last.c = [[FAR; LANES]; 3];
        last.e0 = [[0.0; LANES]; 3];
        last.e1 = [[0.0; LANES]; 3];
    }
}

/// Fill the blocks: surviving triangles in the same lanes of both, vanishing ones after them.
#[inline(always)]
fn lay_out<S: Simd>(simd: S, patch: &Patch, scratch: &mut Scratch) {
    let n = patch.triangles.len();
    let total = n + patch.vanishing.len();
    make_room(&mut scratch.after, n.div_ceil(LANES));
    make_room(&mut scratch.before, total.div_ceil(LANES));
    let b = patch.half;
    let a = scale(b, -1.0);
    for (i, t) in patch.triangles.iter().enumerate() {
        let (p, q) = (patch.ring[t.p as usize].at, patch.ring[t.q as usize].at);
        let (block, l) = (i / LANES, i % LANES);
        let after = &mut scratch.after[block];
        put(&mut after.c, l, [0.0; 3]);
        put(&mut after.e0, l, p);
        put(&mut after.e1, l, q);
        let c = if t.at_b { b } else { a };
        let before = &mut scratch.before[block];
        put(&mut before.c, l, c);
        put(&mut before.e0, l, sub(p, c));
        put(&mut before.e1, l, sub(q, c));
    }
    let ab = sub(b, a);
    for (i, &(x, reversed)) in (n..).zip(&patch.vanishing) {
        let (block, l) = (i / LANES, i % LANES);
        let before = &mut scratch.before[block];
        put(&mut before.c, l, a);
        let ax = sub(patch.ring[x as usize].at, a);
        put(&mut before.e0, l, if reversed { ax } else { ab });
        put(&mut before.e1, l, if reversed { ab } else { ax });
    }
    for block in &mut scratch.after {
        prepare(simd, block);
    }
    for block in &mut scratch.before {
        prepare_normals(simd, block);
    }
}

/// Squared distance between the borders before and after.
#[inline(always)]
fn borders(patch: &Patch, a: [f32; 3], b: [f32; 3]) -> f32 {
    let mut to_a = f32::INFINITY;
    let mut to_b = f32::INFINITY;
    // v is the middle of the edge.
    let mut to_v = if patch.border_ab { 0.0 } else { f32::INFINITY };
    let (mut at_a, mut at_b) = (false, false);
    for r in &patch.ring {
        if r.border_after {
            to_a = smaller(to_a, segment2(a, [0.0; 3], r.at));
            to_b = smaller(to_b, segment2(b, [0.0; 3], r.at));
        }
        if r.border_a {
            at_a = true;
            to_v = smaller(to_v, segment2([0.0; 3], a, r.at));
        }
        if r.border_b {
            at_b = true;
            to_v = smaller(to_v, segment2([0.0; 3], b, r.at));
        }
    }
    // Without a border on the other side there is nothing to be far from: the surface distance speaks alone.
    let mut worst = 0.0;
    for (counts, d) in [(at_a, to_a), (at_b, to_b), (to_a < f32::INFINITY, to_v)] {
        if counts && d < f32::INFINITY {
            worst = larger(worst, d);
        }
    }
    worst
}
