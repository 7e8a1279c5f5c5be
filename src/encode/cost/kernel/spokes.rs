//! Where the surfaces before and after are farthest apart between the ends: at the crossings of spokes before with spokes after, seen
//! along the mean normal; where there is no such view, at the middles of spokes.

use super::{Block, Scratch, distance2, dot, lane, larger, prepare, put, scale, segment2, sub};
use crate::encode::cost::lanes::{LANES, V, all3, of3, put3, vdot};
use crate::encode::cost::weight::Patch;
use pulp::Simd;

/// An orthonormal frame whose third axis is the mean normal, if no triangle of either patch faces against it.
#[inline(always)]
pub(super) fn frame<S: Simd>(simd: S, before: &[Block], after: &[Block]) -> Option<[[f32; 3]; 3]> {
    let mut sum = [[0.0f32; LANES]; 3];
    for b in before {
        for k in 0..V::<S>::PARTS {
            let (s, n) = (of3(simd, &sum, k), of3(simd, &b.n, k));
            put3([s[0] + n[0], s[1] + n[1], s[2] + n[2]], &mut sum, k);
        }
    }
    let n = sum.map(|s| ((s[0] + s[4]) + (s[1] + s[5])) + ((s[2] + s[6]) + (s[3] + s[7])));
    let mut low = V::all(simd, 0.0);
    let along = all3(simd, n);
    for b in before.iter().chain(after) {
        for k in 0..V::<S>::PARTS {
            low = low.smaller(vdot(along, of3(simd, &b.n, k)));
        }
    }
    let nn = dot(n, n);
    let against = V::any_less(low, V::all(simd, 0.0));
    if against || nn.is_nan() || nn <= 0.0 {
        return None;
    }
    let n = scale(n, 1.0 / nn.sqrt());
    // Frisvad's basis, with the sign that keeps it away from its singularity (Duff et al. 2017).
    let sign = if n[2] < 0.0 { -1.0 } else { 1.0 };
    let i = -1.0 / (sign + n[2]);
    let k = n[0] * n[1] * i;
    let x = [1.0 + sign * n[0] * n[0] * i, sign * k, -sign * n[0]];
    let y = [k, sign + n[1] * n[1] * i, -n[1]];
    Some([x, y, n])
}

/// A crossing of a spoke before with a spoke after.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    /// Squared distance between the two points.
    gap: f32,
    /// The point on the spoke before: `c + t·(x − c)`.
    before: [f32; 3],
    /// The point on the spoke after.
    after: [f32; 3],
    /// Ends of the spoke before.
    c: [f32; 3],
    x: [f32; 3],
    /// End of the spoke after; it begins at 0.
    y: [f32; 3],
}

/// Raise `worst` by the crossings of spokes before with spokes after.
#[inline(always)]
pub(super) fn crossings<S: Simd>(
    simd: S,
    patch: &Patch,
    scratch: &mut Scratch,
    frame: &[[f32; 3]; 3],
    mut worst: f32,
) -> f32 {
    find_crossings(simd, patch, scratch, frame, worst);
    let mut complete = false;
    // The largest gap first: it mostly answers for the rest.
    while let Some(at) = largest(&scratch.crossings) {
        let k = scratch.crossings[at];
        // Taken. The others keep their order, so that equals are taken in it by both twins.
        scratch.crossings[at].gap = 0.0;
        if k.gap <= worst {
            break;
        }
        // Each spoke belongs to its patch: the distance to it bounds the distance to the patch.
        if segment2(k.before, [0.0; 3], k.y) > worst {
            worst = larger(worst, distance2(simd, k.before, &scratch.after, worst));
        }
        if segment2(k.after, k.c, k.x) > worst {
            if !complete {
                for b in &mut scratch.before {
                    prepare(simd, b);
                }
                complete = true;
            }
            worst = larger(worst, distance2(simd, k.after, &scratch.before, worst));
        }
    }
    worst
}

/// Place of the largest gap, of equals the first.
#[inline(always)]
fn largest(crossings: &[Crossing]) -> Option<usize> {
    let mut best = None;
    let mut gap = 0.0;
    for (i, k) in crossings.iter().enumerate() {
        if k.gap > gap {
            (best, gap) = (Some(i), k.gap);
        }
    }
    best
}

/// List the crossings whose two points are farther apart than the square root of `worst`: the others raise nothing, as neither of
/// their points is farther from the other's patch.
#[inline(always)]
fn find_crossings<S: Simd>(simd: S, patch: &Patch, scratch: &mut Scratch, frame: &[[f32; 3]; 3], worst: f32) {
    let b = patch.half;
    let a = scale(b, -1.0);
    let Scratch { flat, crossings, .. } = scratch;
    crossings.clear();
    flat.clear();
    flat.resize(patch.ring.len().div_ceil(LANES), [[0.0; LANES]; 3]);
    for (i, r) in patch.ring.iter().enumerate() {
        put(&mut flat[i / LANES], i % LANES, r.at);
    }
    for f in flat.iter_mut() {
        for k in 0..V::<S>::PARTS {
            let p = of3(simd, f, k);
            let flat = [vdot(p, all3(simd, frame[0])), vdot(p, all3(simd, frame[1])), vdot(p, all3(simd, frame[2]))];
            put3(flat, f, k);
        }
    }
    let fb = [dot(b, frame[0]), dot(b, frame[1]), dot(b, frame[2])];
    let fa = scale(fb, -1.0);
    for (i, r) in patch.ring.iter().enumerate() {
        let x = lane(&flat[i / LANES], i % LANES);
        for (has, c, fc) in [(r.spoke_a, a, fa), (r.spoke_b, b, fb)] {
            if !has {
                continue;
            }
            let d = sub(x, fc);
            let along = fc[0] * d[1] - fc[1] * d[0];
            let dx = all3(simd, d);
            for (block, f) in flat.iter().enumerate() {
                // c + t·d = s·y in the plane: t = c×y / y×d, s = c×d / y×d.
                let mut gap = [0.0f32; LANES];
                let mut ts = [[0.0f32; LANES]; 2];
                let mut any = false;
                for k in 0..V::<S>::PARTS {
                    let y = of3(simd, f, k);
                    let c = all3(simd, fc);
                    let inv = (y[0] * dx[1] - y[1] * dx[0]).reciprocal();
                    let t = (c[0] * y[1] - c[1] * y[0]) * inv;
                    let s = V::all(simd, along) * inv;
                    let z = c[2] + t * dx[2] - s * y[2];
                    // Both between 0 and 1. Parallel lines give an infinity or no number: neither passes.
                    let one = V::all(simd, 1.0);
                    let inside = s.smaller(one - s).smaller(t.smaller(one - t));
                    let zero = V::all(simd, 0.0);
                    let wide = V::if_less(zero, inside, z * z, zero);
                    if V::any_less(V::all(simd, worst), wide) {
                        any = true;
                        wide.put(&mut gap, k);
                        t.put(&mut ts[0], k);
                        s.put(&mut ts[1], k);
                    }
                }
                if !any {
                    continue;
                }
                for l in 0..LANES {
                    if gap[l] > worst {
                        let (e, t) = (sub(r.at, c), ts[0][l]);
                        let y = patch.ring[block * LANES + l].at;
                        crossings.push(Crossing {
                            gap: gap[l],
                            before: [c[0] + t * e[0], c[1] + t * e[1], c[2] + t * e[2]],
                            after: scale(y, ts[1][l]),
                            c,
                            x: r.at,
                            y,
                        });
                    }
                }
            }
        }
    }
}

/// Raise `worst` by the middles of all spokes, both ways.
#[inline(always)]
pub(super) fn middles<S: Simd>(simd: S, patch: &Patch, scratch: &mut Scratch, mut worst: f32) -> f32 {
    let b = patch.half;
    let a = scale(b, -1.0);
    let mut complete = false;
    let zero = [0.0; 3];
    for r in &patch.ring {
        // The spoke after, or before, is part of the other patch: most middles are near enough to it.
        for (has, c) in [(r.spoke_a, a), (r.spoke_b, b)] {
            let middle = [0.5 * (c[0] + r.at[0]), 0.5 * (c[1] + r.at[1]), 0.5 * (c[2] + r.at[2])];
            if has && segment2(middle, zero, r.at) > worst {
                worst = larger(worst, distance2(simd, middle, &scratch.after, worst));
            }
        }
        let middle = scale(r.at, 0.5);
        let near = |has: bool, c: [f32; 3]| has && segment2(middle, c, r.at) <= worst;
        if (r.spoke_a | r.spoke_b) && !near(r.spoke_a, a) && !near(r.spoke_b, b) {
            if !complete {
                for b in &mut scratch.before {
                    prepare(simd, b);
                }
                complete = true;
            }
            worst = larger(worst, distance2(simd, middle, &scratch.before, worst));
        }
    }
    worst
}
