//! A mesh as triangles in a tree of boxes, for nearest points.
//!
//! A mesh is the union of its triangles, its polygons, its dangling edges as segments and its isolated vertices as points. A polygon of
//! more than three corners is the triangles between its edges and the mean of its corners (as in [`crate::encode::cost`]), so that it is the
//! same surface whichever corner comes first.
//!
//! Triangles are kept in `f64` relative to the middle of the mesh: national grid coordinates have six digits before the point and
//! millimetres after it. Boxes are `f32`, widened by what rounding may cost, four to a node, so that one pass of vector operations bounds
//! all four. The tree halves the triangles by count along the longest axis of their centres; its shape depends on their number alone.
//! Leaves are in spatial order, which sampling uses too: a sample near the last one begins with its nearest triangle as a bound.

use crate::mesh::Mesh;
use glam::DVec3;

/// Triangles in a leaf, at most.
const LEAF: usize = 4;
/// Below this many triangles a subtree is sorted on one thread.
#[cfg(feature = "parallel")]
const SERIAL: usize = 1 << 14;
/// What lies behind a child without triangles.
const EMPTY: u8 = u8::MAX;

/// Where a triangle of a [`Surface`] comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The element of the mesh, or [`crate::mesh::NO_VALUE`] for an isolated vertex.
    pub face: u32,
    /// Of a polygon of more than three corners the corner (counted in the polygon) at which the triangle's edge begins, of an isolated
    /// vertex the vertex, else 0.
    pub corner: u32,
}

/// The nearest point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Squared distance.
    pub distance2: f64,
    /// The triangle, counted as [`Surface::triangle`] counts.
    pub triangle: u32,
}

/// Four children of a tree's node.
#[derive(Clone)]
struct Node {
    lo: [[f32; 4]; 3],
    hi: [[f32; 4]; 3],
    /// A node, or the first triangle of a leaf.
    child: [u32; 4],
    /// Triangles of a leaf, 0 for a node, [`EMPTY`] for nothing.
    count: [u8; 4],
}

/// A mesh, ready for nearest points.
pub struct Surface {
    centre: DVec3,
    triangles: Vec<[DVec3; 3]>,
    origins: Vec<Origin>,
    nodes: Vec<Node>,
}

struct Item {
    middle: [f32; 3],
    triangle: u32,
}

impl Surface {
    /// Build the tree; the mesh is taken to be valid ([`Mesh::validate`]).
    pub fn new(mesh: &Mesh) -> Self {
        let centre = mesh.bounds().map_or(DVec3::ZERO, |(lo, hi)| 0.5 * DVec3::from(lo) + 0.5 * DVec3::from(hi));
        let (triangles, origins) = triangles(mesh, centre);
        let mut items: Vec<Item> = triangles
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let (lo, hi) = (t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]));
                let middle = (0.5 * (lo + hi)).as_vec3().to_array();
                Item { middle, triangle: i as u32 }
            })
            .collect();
        sort(&mut items);
        let triangles: Vec<[DVec3; 3]> = items.iter().map(|i| triangles[i.triangle as usize]).collect();
        let origins = items.iter().map(|i| origins[i.triangle as usize]).collect();
        drop(items);
        let reach = triangles.iter().flatten().fold(0.0f64, |m, p| m.max(p.abs().max_element()));
        let mut surface = Surface { centre, triangles, origins, nodes: Vec::new() };
        let n = surface.triangles.len();
        if n > 0 {
            surface.nodes.reserve(n / 4 + 1);
            // Half a unit in the last place for the box and for the point, of the largest number about, and some more.
            surface.grow(0, n, (reach * 2f64.powi(-22)) as f32 + f32::MIN_POSITIVE);
        }
        surface
    }

    /// Number of triangles; polygons count several, dangling edges and isolated vertices one each.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there is nothing, and no nearest point.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Triangle `i` in the order of the tree, in the coordinates of the mesh.
    pub fn triangle(&self, i: u32) -> [[f64; 3]; 3] {
        self.triangles[i as usize].map(|p| (p + self.centre).to_array())
    }

    /// Where triangle `i` comes from.
    pub fn origin(&self, i: u32) -> Origin {
        self.origins[i as usize]
    }

    /// Triangles relative to [`centre`](Self::centre), in the order of the tree.
    pub(super) fn local(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// The middle of the mesh.
    pub(super) fn centre(&self) -> DVec3 {
        self.centre
    }

    /// The nearest point of the surface to `x`; `None` where there is no surface. `hint` is a triangle that is likely to be
    /// near, such as the last answer.
    pub fn nearest(&self, x: [f64; 3], hint: u32) -> Option<Nearest> {
        let x = DVec3::from(x) - self.centre;
        let first = self.triangles.get(hint as usize).map_or(0, |_| hint);
        let mut best = Nearest { distance2: to_triangle(x, self.triangles.get(first as usize)?), triangle: first };
        self.visit(x, best.distance2, |from, to| {
            for (i, t) in self.triangles[from..to].iter().enumerate() {
                let d = to_triangle(x, t);
                if d < best.distance2 {
                    best = Nearest { distance2: d, triangle: (from + i) as u32 };
                }
            }
            best.distance2
        });
        Some(best)
    }

    /// Call `f` with every triangle whose squared distance to `x` is at most `distance2`.
    pub fn within(&self, x: [f64; 3], distance2: f64, mut f: impl FnMut(u32)) {
        let x = DVec3::from(x) - self.centre;
        // Rounding must not leave out a triangle that has just this distance.
        let distance2 = distance2 * (1.0 + 1e-12) + f64::MIN_POSITIVE;
        self.visit(x, distance2, |from, to| {
            for (i, t) in self.triangles[from..to].iter().enumerate() {
                if to_triangle(x, t) <= distance2 {
                    f((from + i) as u32);
                }
            }
            distance2
        });
    }

    /// Show `leaf` the leaves that may hold something nearer than `best`, the nearer ones first; it answers with the new `best`.
    fn visit(&self, x: DVec3, best: f64, mut leaf: impl FnMut(usize, usize) -> f64) {
        // A bound as f32, never less than the number itself.
        let above = |d: f64| (d as f32) * (1.0 + 1e-6) + f32::MIN_POSITIVE;
        let at = x.as_vec3().to_array();
        let mut best = above(best);
        // Four ways at each of at most 16 steps down: never more than 3 stay behind each.
        let mut stack = [(0.0f32, 0u32, 0u8); 64];
        let mut depth = 1;
        if self.nodes.is_empty() {
            return;
        }
        while depth > 0 {
            depth -= 1;
            let (bound, child, count) = stack[depth];
            if bound > best {
                continue;
            }
            if count > 0 {
                best = above(leaf(child as usize, child as usize + count as usize));
                continue;
            }
            let node = &self.nodes[child as usize];
            let mut bounds = [0.0f32; 4];
            for ((lo, hi), at) in node.lo.iter().zip(&node.hi).zip(at) {
                for (i, bound) in bounds.iter_mut().enumerate() {
                    let d = (lo[i] - at).max(at - hi[i]).max(0.0);
                    *bound += d * d;
                }
            }
            let from = depth;
            for (i, &bound) in bounds.iter().enumerate() {
                // A far point rounds more coarsely than the boxes were widened for, but by its distance's last place.
                let bound = bound * (1.0 - 1e-6);
                if bound > best || node.count[i] == EMPTY {
                    continue;
                }
                let mut place = depth;
                while place > from && stack[place - 1].0 < bound {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (bound, node.child[i], node.count[i]);
                depth += 1;
            }
        }
    }

    /// Make the node of triangles `from..to` and those below; answers with its number.
    fn grow(&mut self, from: usize, to: usize, slack: f32) -> u32 {
        let at = self.nodes.len();
        self.nodes.push(Node { lo: [[0.0; 4]; 3], hi: [[0.0; 4]; 3], child: [0; 4], count: [EMPTY; 4] });
        let half = from + (to - from) / 2;
        let cuts = [from, from + (half - from) / 2, half, half + (to - half) / 2, to];
        for i in 0..4 {
            let (a, b) = (cuts[i], cuts[i + 1]);
            if a == b {
                continue;
            }
            let (child, count) = if b - a <= LEAF { (a as u32, (b - a) as u8) } else { (self.grow(a, b, slack), 0) };
            let (lo, hi) =
                if count > 0 { boxed(&self.triangles[a..b], slack) } else { self.nodes[child as usize].whole() };
            let node = &mut self.nodes[at];
            for k in 0..3 {
                node.lo[k][i] = lo[k];
                node.hi[k][i] = hi[k];
            }
            node.child[i] = child;
            node.count[i] = count;
        }
        at as u32
    }
}

impl Node {
    fn whole(&self) -> ([f32; 3], [f32; 3]) {
        let there = |i: &usize| self.count[*i] != EMPTY;
        (
            std::array::from_fn(|k| (0..4).filter(there).map(|i| self.lo[k][i]).fold(f32::INFINITY, f32::min)),
            std::array::from_fn(|k| (0..4).filter(there).map(|i| self.hi[k][i]).fold(f32::NEG_INFINITY, f32::max)),
        )
    }
}

fn boxed(triangles: &[[DVec3; 3]], slack: f32) -> ([f32; 3], [f32; 3]) {
    let all = |k: usize| triangles.iter().flatten().map(move |p| p[k] as f32);
    (
        std::array::from_fn(|k| all(k).fold(f32::INFINITY, f32::min) - slack),
        std::array::from_fn(|k| all(k).fold(f32::NEG_INFINITY, f32::max) + slack),
    )
}

/// Put triangles into the order of the tree: halves by count along the longest axis of their middles.
fn sort(items: &mut [Item]) {
    if items.len() <= LEAF {
        return;
    }
    let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in items.iter() {
        for k in 0..3 {
            lo[k] = lo[k].min(item.middle[k]);
            hi[k] = hi[k].max(item.middle[k]);
        }
    }
    let axis = (0..3).max_by(|&a, &b| (hi[a] - lo[a]).total_cmp(&(hi[b] - lo[b]))).unwrap_or(0);
    let half = items.len() / 2;
    // Numbers break ties, so that the order does not depend on the sorting algorithm.
    items.select_nth_unstable_by(half, |a, b| {
        a.middle[axis].total_cmp(&b.middle[axis]).then(a.triangle.cmp(&b.triangle))
    });
    let (a, b) = items.split_at_mut(half);
    #[cfg(feature = "parallel")]
    if a.len() > SERIAL {
        crate::parallel::join(|| sort(a), || sort(b));
        return;
    }
    sort(a);
    sort(b);
}

/// The triangles of a mesh relative to `centre`, and where they come from.
fn triangles(mesh: &Mesh, centre: DVec3) -> (Vec<[DVec3; 3]>, Vec<Origin>) {
    let p = |v: u32| DVec3::from(mesh.positions[v as usize]) - centre;
    let mut triangles = Vec::with_capacity(mesh.face_count());
    let mut origins = Vec::with_capacity(mesh.face_count());
    let mut used = vec![false; mesh.positions.len()];
    for (f, face) in mesh.faces().enumerate() {
        face.iter().for_each(|&v| used[v as usize] = true);
        let face_number = f as u32;
        match *face {
            [a, b] => triangles.push([p(a), p(b), p(b)]),
            [a, b, c] => triangles.push([p(a), p(b), p(c)]),
            _ => {
                let n = face.len();
                let mean = face.iter().map(|&v| p(v)).sum::<DVec3>() / n as f64;
                triangles.extend((0..n).map(|i| [p(face[i]), p(face[(i + 1) % n]), mean]));
                origins.extend((0..n as u32).map(|corner| Origin { face: face_number, corner }));
                continue;
            }
        }
        origins.push(Origin { face: face_number, corner: 0 });
    }
    for v in (0..used.len()).filter(|&v| !used[v]) {
        triangles.push([p(v as u32); 3]);
        origins.push(Origin { face: crate::mesh::NO_VALUE, corner: v as u32 });
    }
    (triangles, origins)
}

fn to_segment(x: DVec3, a: DVec3, b: DVec3) -> f64 {
    let (w, e) = (x - a, b - a);
    (w - along(w, e) * e).length_squared()
}

/// Where on a segment from the origin to `e` the nearest point to `w` lies, 0 to 1.
fn along(w: DVec3, e: DVec3) -> f64 {
    let ee = e.length_squared();
    if ee > 0.0 { (w.dot(e) / ee).clamp(0.0, 1.0) } else { 0.0 }
}

/// Squared distance of a point to a triangle, which may be a segment or a point.
pub(super) fn to_triangle(x: DVec3, t: &[DVec3; 3]) -> f64 {
    let [b0, b1, b2] = nearest_weights(x, t);
    (b0 * t[0] + b1 * t[1] + b2 * t[2] - x).length_squared()
}

/// The barycentric weights of the point of a triangle that is nearest to `x` (Ericson, Real-Time Collision Detection, 5.1.5;
/// sides without length are passed by, so that triangles that repeat a vertex come out as segments).
pub(super) fn nearest_weights(x: DVec3, t: &[DVec3; 3]) -> [f64; 3] {
    let (u, v, w) = (t[1] - t[0], t[2] - t[0], x - t[0]);
    let (d1, d2) = (u.dot(w), v.dot(w));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
    let (d3, d4) = (d1 - uu, d2 - uv);
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if uu > 0.0 && vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let s = d1 / uu;
        return [1.0 - s, s, 0.0];
    }
    let (d5, d6) = (d1 - uv, d2 - vv);
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vv > 0.0 && vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let s = d2 / vv;
        return [1.0 - s, 0.0, s];
    }
    let va = d3 * d6 - d5 * d4;
    let (e, f) = (d4 - d3, d5 - d6);
    if e + f > 0.0 && va <= 0.0 && e >= 0.0 && f >= 0.0 {
        let s = e / (e + f);
        return [0.0, 1.0 - s, s];
    }
    let sum = va + vb + vc;
    if sum > 1e-14 * uu * vv {
        return [va / sum, vb / sum, vc / sum];
    }
    // A sliver: rounding hides on which side the point lies. The nearest of its sides is right.
    let sides = [(0, 1), (1, 2), (2, 0)];
    let best =
        sides.into_iter().min_by(|&(a, b), &(c, d)| to_segment(x, t[a], t[b]).total_cmp(&to_segment(x, t[c], t[d])));
    let (a, b) = best.unwrap_or((0, 1));
    let s = along(x - t[a], t[b] - t[a]);
    let mut weights = [0.0; 3];
    weights[a] = 1.0 - s;
    weights[b] += s;
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use crate::samples::Random;

    fn brute(surface: &Surface, x: [f64; 3]) -> f64 {
        let x = DVec3::from(x) - surface.centre;
        surface.triangles.iter().map(|t| to_triangle(x, t)).fold(f64::INFINITY, f64::min)
    }

    /// The distance to a triangle by a road of its own: plane where the foot is inside, else sides.
    fn plain(x: DVec3, t: &[DVec3; 3]) -> f64 {
        let sides = to_segment(x, t[0], t[1]).min(to_segment(x, t[1], t[2])).min(to_segment(x, t[2], t[0]));
        let n = (t[1] - t[0]).cross(t[2] - t[0]);
        let inside = n.length_squared() > 0.0 && (0..3).all(|i| (t[(i + 1) % 3] - t[i]).cross(x - t[i]).dot(n) >= 0.0);
        if inside { (n.dot(x - t[0]).powi(2) / n.length_squared()).min(sides) } else { sides }
    }

    #[test]
    fn point_and_triangle() {
        let mut random = Random::new(3);
        for round in 0..20_000 {
            let mut t = [(); 3].map(|()| DVec3::from(random.point()));
            match round % 4 {
                1 => t[2] = t[1],
                2 => t = [t[0]; 3],
                3 => t[2] = 0.25 * t[0] + 0.75 * t[1],
                _ => {}
            }
            let x = DVec3::from(random.point());
            let (d, e) = (to_triangle(x, &t).sqrt(), plain(x, &t).sqrt());
            assert!((d - e).abs() < 1e-9, "{x:?} {t:?}: {d} {e}");
        }
    }

    #[test]
    fn the_tree_finds_the_nearest() {
        let mut random = Random::new(5);
        for mut mesh in [
            samples::asteroid(6, 1),
            samples::crumbs(50, 2),
            samples::point_cloud(70, 3),
            samples::soup(40, 200, 4),
            samples::mixed(6, 5, 5),
            samples::sphere(1, 0.0, 0),
        ] {
            for shift in [0.0, 5.4e6] {
                mesh.positions.iter_mut().flatten().for_each(|c| *c += shift);
                let surface = Surface::new(&mesh);
                let (lo, hi) = mesh.bounds().unwrap();
                let mut hint = 0;
                for round in 0..300 {
                    let scale = [0.6, 1.5, 40.0][round % 3];
                    let r = random.point();
                    let x = std::array::from_fn(|k| 0.5 * (lo[k] + hi[k]) + scale * r[k] * (hi[k] - lo[k]).max(1e-3));
                    let found = surface.nearest(x, hint).unwrap();
                    hint = found.triangle;
                    assert_eq!(found.distance2, brute(&surface, x));
                    let mut seen = false;
                    surface.within(x, found.distance2, |i| seen |= i == found.triangle);
                    assert!(seen);
                }
            }
        }
        assert!(Surface::new(&Mesh::default()).nearest([0.0; 3], 0).is_none());
    }
}
