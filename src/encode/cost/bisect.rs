//! Distances between two small sets of triangles, bounded by cutting triangles in two: see `bound`, which this serves.
//!
//! Nearly all of the time goes into distances of points to triangles, so these are computed for a block of triangles at once,
//! and not at all where a triangle is too far to matter: the distance to a triangle changes by no more than one walks, so
//! what is known at the ends of an edge bounds what can be at its middle. No operation is contracted or reordered, so
//! the result is the same on every machine.

#![allow(clippy::needless_range_loop)] // lanes are numbered

use std::cmp::Ordering;
use std::collections::BinaryHeap;

pub(super) type V = [f64; 3];

/// Points that bisection may measure in one direction, beside the corners.
const BUDGET: usize = 128;
/// Bisection stops where bound over attained distance is below this.
const CLOSE: f64 = 1.2;
/// Triangles of a block.
const LANES: usize = 4;
type Lane = [f64; LANES];
type Lane3 = [Lane; 3];
/// How far the lanes without a triangle are.
const FAR: f64 = 1e18;
/// Room for rounding where distances are added, in relative terms.
const ROOM: f64 = 1.0 + 1e-9;

/// Triangles `c, c + e0, c + e1`, segments and points among them.
#[derive(Clone, Copy, Debug)]
struct Block {
    c: Lane3,
    e0: Lane3,
    e1: Lane3,
    /// Normal, and dual basis of `e0, e1` in the plane; zero where the triangle is a segment or nearly so.
    n: Lane3,
    m0: Lane3,
    m1: Lane3,
    /// One over the squared lengths of `e0`, `e1`, `e1 − e0`, and of the normal; zero for zero.
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

/// Memory that is reused from patch to patch.
#[derive(Clone, Debug, Default)]
pub(super) struct BisectScratch {
    blocks: Vec<Block>,
    points: Vec<V>,
    /// Per point its distance to every triangle, by block; where that is too large to matter, something smaller that is too large as well.
    rows: Vec<Lane>,
    nodes: BinaryHeap<Node>,
}

/// A part of a triangle: the numbers of its corners and an upper bound of its distance.
#[derive(Clone, Copy, Debug)]
struct Node {
    bound: f64,
    corners: [u32; 3],
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Node {}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Node {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

#[inline(always)]
fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn scale(a: V, s: f64) -> V {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
fn lane(a: &Lane3, l: usize) -> V {
    [a[0][l], a[1][l], a[2][l]]
}

#[inline(always)]
fn put(a: &mut Lane3, l: usize, v: V) {
    a[0][l] = v[0];
    a[1][l] = v[1];
    a[2][l] = v[2];
}

#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Into 0 ..= 1.
#[inline(always)]
fn unit(x: f64) -> f64 {
    smaller(larger(x, 0.0), 1.0)
}

#[inline(always)]
fn inverse(x: f64) -> f64 {
    let r = 1.0 / x;
    if x > 0.0 { r } else { 0.0 }
}

/// The blocks of some triangles.
#[inline(always)]
fn prepare(triangles: &[[V; 3]], blocks: &mut Vec<Block>) {
    blocks.clear();
    for some in triangles.chunks(LANES) {
        let mut b = EMPTY;
        for (l, t) in some.iter().enumerate() {
            put(&mut b.c, l, t[0]);
            put(&mut b.e0, l, sub(t[1], t[0]));
            put(&mut b.e1, l, sub(t[2], t[0]));
        }
        for l in 0..LANES {
            let (e0, e1) = (lane(&b.e0, l), lane(&b.e1, l));
            let e2 = sub(e1, e0);
            let (d0, d1, d2) = (dot(e0, e0), dot(e1, e1), dot(e2, e2));
            let n = cross(e0, e1);
            let nn = dot(n, n);
            // Below an angle of 1e-8 the normal is noise: there the edges alone stand for the triangle.
            let inn = if nn > 1e-16 * d0 * d1 { inverse(nn) } else { 0.0 };
            put(&mut b.n, l, n);
            put(&mut b.m0, l, scale(cross(e1, n), inn));
            put(&mut b.m1, l, scale(cross(n, e0), inn));
            b.i0[l] = inverse(d0);
            b.i1[l] = inverse(d1);
            b.i2[l] = inverse(d2);
            b.inn[l] = inn;
        }
        blocks.push(b);
    }
}

/// Distance of a point to each triangle of a block.
#[inline(always)]
fn distances(x: V, b: &Block) -> Lane {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let w = sub(x, lane(&b.c, l));
        let (e0, e1) = (lane(&b.e0, l), lane(&b.e1, l));
        let r0 = sub(w, scale(e0, unit(dot(w, e0) * b.i0[l])));
        let r1 = sub(w, scale(e1, unit(dot(w, e1) * b.i1[l])));
        let (w2, e2) = (sub(w, e0), sub(e1, e0));
        let r2 = sub(w2, scale(e2, unit(dot(w2, e2) * b.i2[l])));
        let edges = smaller(smaller(dot(r0, r0), dot(r1, r1)), dot(r2, r2));
        let (s, t) = (dot(w, lane(&b.m0, l)), dot(w, lane(&b.m1, l)));
        let h = dot(w, lane(&b.n, l));
        let plane = h * h * b.inn[l];
        // Strict, so that a segment, whose m0 and m1 are zero, is never taken for a plane.
        let inside = smaller(smaller(s, t), 1.0 - (s + t));
        out[l] = if inside > 0.0 { plane } else { edges }.sqrt();
    }
    out
}

#[inline(always)]
fn least(a: Lane) -> f64 {
    smaller(smaller(a[0], a[2]), smaller(a[1], a[3]))
}

/// The distance of the farthest corner from the triangle for which that is least.
#[inline(always)]
fn single(rows: &[Lane], m: usize, corners: [u32; 3]) -> f64 {
    let row = |i: usize| &rows[corners[i] as usize * m..][..m];
    let (r0, r1, r2) = (row(0), row(1), row(2));
    let mut best = [f64::INFINITY; LANES];
    for j in 0..m {
        for l in 0..LANES {
            best[l] = smaller(best[l], larger(larger(r0[j][l], r1[j][l]), r2[j][l]));
        }
    }
    least(best)
}

/// Which distance is asked for, and what is known of it.
pub(super) struct Bisect<'a> {
    pub from: &'a [[V; 3]],
    pub to: &'a [[V; 3]],
    /// A distance that is good enough.
    pub floor: f64,
    /// A distance that is attained, by this direction or the other.
    pub attained: f64,
    /// An upper bound known already: the search ends where the distance attained comes close to it.
    pub ceiling: f64,
    pub scratch: &'a mut BisectScratch,
}

impl pulp::NullaryFnOnce for Bisect<'_> {
    type Output = Option<(f64, f64)>;

    /// Upper bound of the distance of `from` to `to`, and the largest distance that was found to be attained. `None` where
    /// that comes close to `ceiling`.
    #[inline(always)]
    fn call(self) -> Option<(f64, f64)> {
        let Bisect { from, to, floor, attained, ceiling, scratch } = self;
        let BisectScratch { blocks, points, rows, nodes } = scratch;
        prepare(to, blocks);
        let m = blocks.len();
        let mut known = attained;
        rows.clear();
        points.clear();
        nodes.clear();
        // The worst of the parts that need no cut.
        let mut done = 0.0f64;
        for t in from {
            let mut corners = [0; 3];
            for (corner, &x) in corners.iter_mut().zip(t) {
                // Neighbours share corners.
                *corner = match points.iter().position(|&p| p == x) {
                    Some(i) => i as u32,
                    None => {
                        let mut nearest = [f64::INFINITY; LANES];
                        for b in blocks.iter() {
                            let d = distances(x, b);
                            for l in 0..LANES {
                                nearest[l] = smaller(nearest[l], d[l]);
                            }
                            rows.push(d);
                        }
                        known = larger(known, least(nearest));
                        points.push(x);
                        points.len() as u32 - 1
                    }
                };
            }
            if known * CLOSE >= ceiling {
                return None;
            }
            nodes.push(Node { bound: single(rows, m, corners), corners });
        }
        let most = points.len() + BUDGET;
        // The worst first: where it is good enough or the budget is spent, so are all others.
        while let Some(node) = nodes.pop() {
            if known * CLOSE >= ceiling {
                return None;
            }
            if node.bound <= larger(floor, known * CLOSE) || points.len() >= most {
                done = larger(done, node.bound);
                break;
            }
            // Cut the longest edge.
            let at = node.corners.map(|c| points[c as usize]);
            let edge = [sub(at[1], at[0]), sub(at[2], at[1]), sub(at[0], at[2])].map(|e| dot(e, e));
            let i = if edge[0] >= edge[1] && edge[0] >= edge[2] {
                0
            } else if edge[1] >= edge[2] {
                1
            } else {
                2
            };
            let (p, q) = (at[i], at[(i + 1) % 3]);
            let middle = [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])];
            // A triangle farther from either end than this is farther from the middle than the bound of the node, which
            // only falls from here on: it is neither the nearest to the middle nor the best for any part.
            let half = 0.5 * edge[i].sqrt() * ROOM;
            let far = (node.bound + half) * ROOM;
            let (r0, r1) = (node.corners[i] as usize * m, node.corners[(i + 1) % 3] as usize * m);
            let mut nearest = [f64::INFINITY; LANES];
            for j in 0..m {
                let (d0, d1) = (rows[r0 + j], rows[r1 + j]);
                let mut at_ends = [0.0; LANES];
                for l in 0..LANES {
                    at_ends[l] = larger(d0[l], d1[l]);
                }
                let d = if least(at_ends) > far { at_ends.map(|d| d - half) } else { distances(middle, &blocks[j]) };
                for l in 0..LANES {
                    nearest[l] = smaller(nearest[l], d[l]);
                }
                rows.push(d);
            }
            known = larger(known, least(nearest));
            let middle_at = points.len() as u32;
            points.push(middle);
            for end in [i, (i + 1) % 3] {
                let mut corners = node.corners;
                corners[end] = middle_at;
                let bound = smaller(node.bound, single(rows, m, corners));
                if bound <= larger(floor, known * CLOSE) {
                    done = larger(done, bound);
                } else {
                    nodes.push(Node { bound, corners });
                }
            }
        }
        Some((done, known))
    }
}
