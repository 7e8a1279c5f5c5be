//! Whether a collapse turns a surviving face over or makes a sliver of it.

use super::{Block, cross, dot, inverse, larger, sub};
use crate::encode::cost::lanes::{V, of3, vdot, vsub};
use crate::encode::cost::weight::Patch;
use pulp::Simd;

/// Shape of a triangle: squared normal over the fourth power of the longest edge.
#[inline(always)]
fn shape(nn: f32, longest: f32) -> f32 {
    let i = inverse(longest);
    nn * i * i
}

/// Whether shapes before and after say that a triangle became a sliver: twice its area below 1/100 of the longest edge
/// squared, and a quarter of what it was.
#[inline(always)]
fn sliver(before: f32, after: f32) -> bool {
    after < SLIVER && after * 16.0 < before
}

/// See [`sliver`].
const SLIVER: f32 = 1e-4;

/// Whether a surviving triangle turns over or becomes a sliver. Dangling edges have normal 0 and shape 0 before and
/// after, and so never do.
#[inline(always)]
pub(super) fn folds_triangles<S: Simd>(simd: S, before: &[Block], after: &[Block]) -> bool {
    let (zero, one, limit) = (V::all(simd, 0.0), V::all(simd, 1.0), V::all(simd, SLIVER));
    for (b, a) in before.iter().zip(after) {
        for k in 0..V::<S>::PARTS {
            let na = of3(simd, &a.n, k);
            if V::any_less(vdot(of3(simd, &b.n, k), na), zero) {
                return true;
            }
            let i0 = V::of(simd, &a.i0, k);
            let i = i0.smaller(V::of(simd, &a.i1, k)).smaller(V::of(simd, &a.i2, k));
            let thin = vdot(na, na) * i * i;
            if !V::any_less(V::if_less(zero, i0, thin, one), limit) {
                continue;
            }
            let (e0, e1, n) = (of3(simd, &b.e0, k), of3(simd, &b.e1, k), of3(simd, &b.n, k));
            let e2 = vsub(e1, e0);
            let longest = vdot(e0, e0).larger(vdot(e1, e1)).larger(vdot(e2, e2)).inverse();
            // See `sliver`, where both conditions are the same.
            let was = V::if_less(thin, limit, vdot(n, n) * longest * longest, zero);
            if V::any_less(V::if_less(zero, i0, thin, one) * V::all(simd, 16.0), was) {
                return true;
            }
        }
    }
    false
}

/// The same for polygons: their vector areas, as far as the fan shows them.
#[inline(always)]
pub(super) fn folds_polygons(patch: &Patch, a: [f32; 3], b: [f32; 3]) -> bool {
    let mut nb = [0.0f32; 3];
    let mut na = [0.0f32; 3];
    let (mut lb, mut la) = (0.0f32, 0.0f32);
    let bad = |nb: [f32; 3], na: [f32; 3], lb: f32, la: f32| {
        dot(nb, na) < 0.0 || sliver(shape(dot(nb, nb), lb), shape(dot(na, na), la))
    };
    for t in &patch.triangles {
        let (p, q) = (patch.ring[t.p as usize].at, patch.ring[t.q as usize].at);
        let c = if t.at_b { b } else { a };
        let (e0, e1) = (sub(p, c), sub(q, c));
        let (x, y) = (cross(e0, e1), cross(p, q));
        let pq = sub(p, q);
        let mb = larger(larger(dot(e0, e0), dot(e1, e1)), dot(pq, pq));
        let ma = larger(larger(dot(p, p), dot(q, q)), dot(pq, pq));
        if t.continues {
            nb = [nb[0] + x[0], nb[1] + x[1], nb[2] + x[2]];
            na = [na[0] + y[0], na[1] + y[1], na[2] + y[2]];
            (lb, la) = (larger(lb, mb), larger(la, ma));
        } else {
            if bad(nb, na, lb, la) {
                return true;
            }
            (nb, na, lb, la) = (x, y, mb, ma);
        }
    }
    bad(nb, na, lb, la)
}
