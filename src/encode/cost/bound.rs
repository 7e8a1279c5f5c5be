//! A guaranteed upper bound of what one collapse does: the symmetric Hausdorff distance between the patch before and
//! the patch after, for any place of the merged vertex. Levels state their error with it, so it must never be too
//! small.
//!
//! The smallest of up to three bounds, each of which is one by itself:
//! - **Motion.** Carry each point of a fan along with its corners: nothing goes farther than `a` or `b` does. True of every patch.
//! - **Heights.** Where both patches are closed fans of triangles that project injectively onto one plane over the same ring, both are
//!   piecewise linear heights over one domain, whose difference is largest at a vertex of the overlay of
//!   both: `a`, `b`, `v`, or a crossing of an edge before with an edge after. Injective: the boundary of the two
//!   patches is the same chain of edges, every triangle of both keeps its orientation, so over each point lie as many triangles as the
//!   ring winds around it; and the ring winds around `v` once, so that is one or none.
//! - **Bisection.** The distance to a triangle is a convex function, so over a triangle it is largest at a
//!   corner: the farthest corner from the best single triangle of the other patch bounds it. Where that is not good enough
//!   the triangle is cut in two, the worst one first, until the bound is within a fifth of a distance that is attained, or a
//!   budget is spent. For borders, polygons, folds, everything not manifold, and where heights are slanted.
//!
//! A polygon of more than three corners is taken as the triangles between its edges and the mean of its corners: unlike
//! a fan from a corner (as `weight` has it) that does not depend on which corner comes first, which no level keeps.
//! Arithmetic is `f64`, and what rounding can do is added.

use super::bisect::{Bisect, BisectScratch, V};
use super::weight::Patch;

/// Patches of more triangles are not bisected: the cost is quadratic.
const BISECT_MOST: usize = 256;
/// Heights are trusted to be near the distance where no triangle is steeper than this cosine.
const LEVEL: f64 = 0.85;
/// What rounding can do, relative to the size of the patch: far above the rounding of `f64`, and above that of the `f32`
/// coordinates of the patch where they are not integers.
const SLACK: f64 = 1.0 / (1 << 21) as f64;

/// Memory that [`hausdorff_bound`] reuses from patch to patch.
#[derive(Clone, Debug, Default)]
pub struct BoundScratch {
    ring: Vec<V>,
    flat: Vec<V>,
    before: Vec<[V; 3]>,
    after: Vec<[V; 3]>,
    chain: Vec<[i32; 2]>,
    bisect: BisectScratch,
}

#[inline]
fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
fn norm(a: V) -> f64 {
    dot(a, a).sqrt()
}

#[inline]
fn normal(t: &[V; 3]) -> V {
    cross(sub(t[1], t[0]), sub(t[2], t[0]))
}

/// An upper bound, in lattice steps, of the symmetric Hausdorff distance between the patch as it is and with `a` and
/// `b` merged at `v`, a point relative to the midpoint of the edge (so `[0.0; 3]` is the midpoint).
///
/// `enough` says when the caller does not care for a better one: the search ends as soon as the bound is not larger.
/// The patch is taken at its coordinates; they are exact where positions were integers below 2^22.
pub fn hausdorff_bound(patch: &Patch, v: V, enough: f64, scratch: &mut BoundScratch) -> f64 {
    let b = patch.half.map(f64::from);
    let a = b.map(|c| -c);
    let motion = norm(sub(v, a)).max(norm(sub(v, b)));
    scratch.ring.clear();
    scratch.ring.extend(patch.ring.iter().map(|r| r.at.map(f64::from)));
    let extent = scratch.ring.iter().chain([&a, &b, &v]).map(|&p| norm(p)).fold(0.0, f64::max);
    let slack = extent * SLACK;
    let mut best = motion + slack;
    if best <= enough {
        return best;
    }
    scratch.before.clear();
    scratch.after.clear();
    for t in &patch.triangles {
        let (p, q) = (scratch.ring[t.p as usize], scratch.ring[t.q as usize]);
        scratch.before.push([if t.at_b { b } else { a }, p, q]);
        scratch.after.push([v, p, q]);
    }
    for &(x, reversed) in &patch.vanishing {
        let x = scratch.ring[x as usize];
        scratch.before.push(if reversed { [b, a, x] } else { [a, b, x] });
        // What remains of it, should nothing else hold that edge.
        scratch.after.push([v, x, x]);
    }
    if patch.vanishing.is_empty() {
        // No triangle holds the edge: it is one of the dangling edges itself.
        scratch.before.push([a, b, b]);
    }
    if scratch.after.is_empty() {
        // A dangling edge alone: it shrinks to v.
        return best;
    }
    if closed(patch, &mut scratch.chain)
        && let Some((height, cosine)) = heights(patch, [a, b, v], scratch)
    {
        best = best.min(height + slack);
        if cosine >= LEVEL {
            return best;
        }
    }
    bisected(best, slack, enough, scratch)
}

/// An upper bound of the symmetric Hausdorff distance between two sets of triangles (segments and points among them) given
/// relative to a point near by. `motion` is such a bound known already, `enough` as for [`hausdorff_bound`].
pub fn hausdorff_between(
    before: &[[V; 3]],
    after: &[[V; 3]],
    motion: f64,
    enough: f64,
    scratch: &mut BoundScratch,
) -> f64 {
    let extent = before.iter().chain(after).flatten().map(|&p| norm(p)).fold(0.0, f64::max);
    let slack = extent * SLACK;
    if before.is_empty() || after.is_empty() {
        return motion + slack;
    }
    scratch.before.clear();
    scratch.before.extend_from_slice(before);
    scratch.after.clear();
    scratch.after.extend_from_slice(after);
    bisected(motion + slack, slack, enough, scratch)
}

/// The better of `best` and what bisection of the patches in `scratch` finds.
fn bisected(best: f64, slack: f64, enough: f64, scratch: &mut BoundScratch) -> f64 {
    let BoundScratch { before, after, bisect, .. } = scratch;
    if best <= enough || before.len() > BISECT_MOST || after.len() > BISECT_MOST {
        return best;
    }
    let floor = (enough - slack).max(0.0);
    let arch = pulp::Arch::new();
    let mut farthest = |from: &[[V; 3]], to: &[[V; 3]], attained| {
        arch.dispatch(Bisect { from, to, floor, attained, ceiling: best, scratch: bisect })
    };
    let Some(there) = farthest(before, after, 0.0) else { return best };
    let Some(back) = farthest(after, before, there.1) else { return best };
    best.min(there.0.max(back.0) + slack)
}

/// Whether the patch is closed fans of triangles: every edge at `a` and `b` is run once each way, as often as needed.
fn closed(patch: &Patch, chain: &mut Vec<[i32; 2]>) -> bool {
    if patch.polygons {
        return false;
    }
    chain.clear();
    chain.resize(patch.ring.len(), [0; 2]);
    let mut ab = 0;
    for t in &patch.triangles {
        if t.p == t.q {
            return false;
        }
        chain[t.p as usize][t.at_b as usize] += 1;
        chain[t.q as usize][t.at_b as usize] -= 1;
    }
    for &(x, reversed) in &patch.vanishing {
        let sign = if reversed { -1 } else { 1 };
        // (a, b, x) runs a → b, b → x, x → a.
        ab += sign;
        chain[x as usize][0] -= sign;
        chain[x as usize][1] += sign;
    }
    ab == 0 && chain.iter().all(|&c| c == [0, 0])
}

/// The largest difference of heights of closed fans that project injectively along their mean normal; `None` where they
/// do not, or too steeply to be sure. With the cosine of the steepest triangle.
fn heights(patch: &Patch, [a, b, v]: [V; 3], scratch: &mut BoundScratch) -> Option<(f64, f64)> {
    let survivors = patch.triangles.len();
    let mut n = [0.0; 3];
    for t in &scratch.before {
        let m = normal(t);
        n = [n[0] + m[0], n[1] + m[1], n[2] + m[2]];
    }
    let length = norm(n);
    if !(length > 0.0 && length.is_finite()) {
        return None;
    }
    let n = n.map(|c| c / length);
    let mut cosine = 1.0f64;
    let mut faces_up = |t: &[V; 3]| {
        let m = normal(t);
        let up = dot(m, n);
        cosine = cosine.min(up / norm(m));
        let longest = norm(sub(t[1], t[0])).max(norm(sub(t[2], t[0]))).max(norm(sub(t[2], t[1])));
        // Neither steeper than 1 in 1000 nor so thin that rounding could turn it.
        up > 1e-3 * norm(m) && up > 1e-6 * longest * longest
    };
    if !scratch.before.iter().chain(&scratch.after[..survivors]).all(&mut faces_up) {
        return None;
    }
    let sign = if n[2] < 0.0 { -1.0 } else { 1.0 };
    let i = -1.0 / (sign + n[2]);
    let k = n[0] * n[1] * i;
    let x = [1.0 + sign * n[0] * n[0] * i, sign * k, -sign * n[0]];
    let y = [k, sign + n[1] * n[1] * i, -n[1]];
    // Everything relative to v.
    let flat = |p: V| {
        let p = sub(p, v);
        [dot(p, x), dot(p, y), dot(p, n)]
    };
    scratch.flat.clear();
    scratch.flat.extend(scratch.ring.iter().map(|&p| flat(p)));
    let (a, b) = (flat(a), flat(b));
    let ring = &scratch.flat;

    // All ring edges run around v the same way; once around if they leave the lower half plane once.
    let leaves = |t: &&super::weight::PatchTriangle| ring[t.p as usize][1] < 0.0 && ring[t.q as usize][1] >= 0.0;
    if patch.triangles.iter().filter(leaves).count() != 1 {
        return None;
    }

    let mut worst = 0.0f64;
    let apex = |at_b: bool| if at_b { b } else { a };
    for end in [a, b] {
        let over = patch.triangles.iter().filter_map(|t| height([0.0; 3], ring[t.p as usize], ring[t.q as usize], end));
        worst = worst.max(largest(over)?);
    }
    let under =
        patch.triangles.iter().filter_map(|t| height(apex(t.at_b), ring[t.p as usize], ring[t.q as usize], [0.0; 3]));
    let vanishing = patch.vanishing.iter().filter_map(|&(x, reversed)| {
        let (c, d) = if reversed { (b, a) } else { (a, b) };
        height(c, d, ring[x as usize], [0.0; 3])
    });
    worst = worst.max(largest(under.chain(vanishing))?);

    let mut crossing = |c: V, d: V, y: V| {
        let det = y[0] * d[1] - y[1] * d[0];
        let size = (y[0] * y[0] + y[1] * y[1]) * (d[0] * d[0] + d[1] * d[1]);
        // Parallel edges meet, if at all, at ends, and those are measured.
        if det * det <= 1e-22 * size {
            return;
        }
        let t = (c[0] * y[1] - c[1] * y[0]) / det;
        let s = (c[0] * d[1] - c[1] * d[0]) / det;
        let inside = |t: f64| (-1e-9..=1.0 + 1e-9).contains(&t);
        if inside(t) && inside(s) {
            worst = worst.max((c[2] + t * d[2] - s * y[2]).abs());
        }
    };
    for (r, &y) in patch.ring.iter().zip(ring) {
        if !(r.spoke_a || r.spoke_b) {
            continue;
        }
        crossing(a, sub(b, a), y);
        for (other, &x) in patch.ring.iter().zip(ring) {
            if other.spoke_a {
                crossing(a, sub(x, a), y);
            }
            if other.spoke_b {
                crossing(b, sub(x, b), y);
            }
        }
    }
    Some((worst, cosine))
}

/// The largest of some heights; `None` if there is none.
fn largest(heights: impl Iterator<Item = f64>) -> Option<f64> {
    heights.fold(None, |best: Option<f64>, h| Some(best.map_or(h, |b| b.max(h))))
}

/// How far `x` is above or below the triangle, if the triangle is over or under it, edges included with some room.
fn height(c: V, p: V, q: V, x: V) -> Option<f64> {
    let (e0, e1, w) = (sub(p, c), sub(q, c), sub(x, c));
    let area = e0[0] * e1[1] - e0[1] * e1[0];
    if area <= 0.0 {
        return None;
    }
    let s = (w[0] * e1[1] - w[1] * e1[0]) / area;
    let t = (e0[0] * w[1] - e0[1] * w[0]) / area;
    let room = -1e-9;
    (s >= room && t >= room && s + t <= 1.0 - room).then(|| (w[2] - s * e0[2] - t * e1[2]).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::cost::tests::{level_of, sampled, small_meshes};
    use crate::encode::cost::{Class, EdgeList, Gatherer};
    use crate::format::complex::Star;

    #[test]
    fn no_sample_is_farther_than_the_bound_and_the_bound_is_not_silly() {
        let mut random = crate::samples::Random::new(11);
        let (mut ratios, mut flat_ratios, mut scratch) = (Vec::new(), Vec::new(), BoundScratch::default());
        for (name, mesh) in small_meshes() {
            let (level, _) = level_of(&mesh, 100.0);
            let positions: Vec<[f32; 3]> = level.positions.iter().map(|p| p.map(|c| c as f32)).collect();
            let star = Star::build(positions.len(), &level.faces);
            let edges = EdgeList::build(&level.faces, &star);
            let (mut gatherer, mut patch) = (Gatherer::new(), Patch::default());
            for e in 0..edges.len() as u32 {
                let (a, b) = edges.ends(e);
                gatherer.read(&level.faces, &star, &positions, a, b, &mut patch);
                if patch.class == Class::Illegal || e % if name == "soup" { 15 } else { 3 } > 0 {
                    continue;
                }
                // At the midpoint, and anywhere near.
                let size = f64::from(patch.half.map(f32::abs).into_iter().fold(0.0, f32::max));
                for v in [[0.0; 3], random.point().map(|c| 0.4 * size * c)] {
                    let bound = hausdorff_bound(&patch, v, -1.0, &mut scratch);
                    if scratch.after.is_empty() {
                        continue;
                    }
                    let n = 8;
                    let (before, after) = (&scratch.before, &scratch.after);
                    let found = sampled(before, after, n).max(sampled(after, before, n));
                    assert!(found <= bound + 1e-9, "{name} {a} {b} to {v:?}: {found} above the bound {bound}");
                    if found > 0.01 * size {
                        ratios.push(bound / found);
                        if name == "sphere" || name == "asteroid" {
                            flat_ratios.push(bound / found);
                        }
                    }
                    let rough = hausdorff_bound(&patch, v, 2.0 * bound, &mut scratch);
                    assert!(rough >= found && rough <= (2.0 * bound).max(bound), "{name}: {rough} for {bound}");
                }
            }
        }
        for (what, ratios) in [("all", &mut ratios), ("noisy surfaces", &mut flat_ratios)] {
            ratios.sort_by(f64::total_cmp);
            let quantile = |q: usize| ratios[(ratios.len() - 1) * q / 100];
            let (half, most) = (quantile(50), quantile(95));
            assert!(ratios.len() > 300 && half < 1.5 && most < 2.5, "{what}: median {half}, 95 % {most}");
        }
    }
}
