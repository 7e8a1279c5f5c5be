//! The distance of two surfaces, measured by sampling: every vertex (up to a limit), the middle of every edge and
//! the centre of every triangle of one, against the nearest triangle of the other, by a tree of boxes.
//!
//! Independent of the encoder's own metric: f64, exact nearest points, no patches. A sampled maximum is a lower bound of the true distance.

use lodestream::mesh::Mesh;
use rayon::prelude::*;

type Point = [f64; 3];

/// Samples per direction, at most.
const SAMPLES: usize = 60_000;
/// Triangles in a leaf.
const LEAF: usize = 8;

/// Triangles in a tree.
pub struct Surface {
    triangles: Vec<[Point; 3]>,
    /// Boxes in depth-first order; a leaf has `right == 0`.
    nodes: Vec<Node>,
    samples: Vec<Point>,
}

struct Node {
    lo: Point,
    hi: Point,
    /// Triangles of a leaf.
    from: u32,
    to: u32,
    /// The second child (the first follows its parent).
    right: u32,
}

impl Surface {
    /// The surface of a mesh: polygons as fans about their centroids, dangling edges and isolated vertices as flat triangles. `None` where there is nothing.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        let p = |v: u32| mesh.positions[v as usize];
        let mut triangles: Vec<[Point; 3]> = Vec::new();
        let mut used = vec![false; mesh.vertex_count()];
        mesh.corners.iter().for_each(|&v| used[v as usize] = true);
        for face in mesh.faces() {
            if let [a, b] = *face {
                triangles.push([p(a), p(b), p(b)]);
            }
            if let [a, b, c] = *face {
                triangles.push([p(a), p(b), p(c)]);
            } else if face.len() > 3 {
                // A polygon need not be flat. About its centroid it is the same surface whichever corner comes first.
                let n = face.len() as f64;
                let centre: Point = std::array::from_fn(|k| face.iter().map(|&v| p(v)[k]).sum::<f64>() / n);
                triangles.extend((0..face.len()).map(|i| [p(face[i]), p(face[(i + 1) % face.len()]), centre]));
            }
        }
        triangles.extend((0..used.len()).filter(|&v| !used[v]).map(|v| [mesh.positions[v]; 3]));
        if triangles.is_empty() {
            return None;
        }
        let middle = |a: Point, b: Point| std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
        let mut samples = mesh.positions.clone();
        for &[a, b, c] in &triangles {
            samples.extend([middle(a, b), middle(b, c), middle(c, a), middle(middle(a, b), c)]);
        }
        let stride = samples.len().div_ceil(SAMPLES);
        let samples = samples.into_iter().step_by(stride).collect();
        let mut surface = Surface { nodes: Vec::new(), samples, triangles };
        let n = surface.triangles.len();
        surface.build(0, n);
        Some(surface)
    }

    fn build(&mut self, from: usize, to: usize) {
        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in self.triangles[from..to].iter().flatten() {
            for k in 0..3 {
                lo[k] = lo[k].min(corner[k]);
                hi[k] = hi[k].max(corner[k]);
            }
        }
        let at = self.nodes.len();
        self.nodes.push(Node { lo, hi, from: from as u32, to: to as u32, right: 0 });
        if to - from <= LEAF {
            return;
        }
        let axis = (0..3).max_by(|&a, &b| (hi[a] - lo[a]).total_cmp(&(hi[b] - lo[b]))).unwrap_or(0);
        let half = (to - from) / 2;
        let key = |t: &[Point; 3]| t[0][axis] + t[1][axis] + t[2][axis];
        self.triangles[from..to].select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)));
        self.build(from, from + half);
        self.nodes[at].right = self.nodes.len() as u32;
        self.build(from + half, to);
    }

    /// The larger of the two directed distances, as far as samples see.
    pub fn distance(&self, other: &Surface) -> Option<f64> {
        let directed = |a: &Surface, b: &Surface| a.samples.par_iter().map(|p| b.nearest(*p)).reduce(|| 0.0, f64::max);
        let squared: f64 = directed(self, other).max(directed(other, self));
        squared.is_finite().then(|| squared.sqrt())
    }

    /// The squared distance of the nearest triangle.
    fn nearest(&self, p: Point) -> f64 {
        let mut best = f64::INFINITY;
        let mut stack = vec![(0usize, 0.0)];
        while let Some((at, bound)) = stack.pop() {
            if bound >= best {
                continue;
            }
            let node = &self.nodes[at];
            if node.right == 0 {
                for t in &self.triangles[node.from as usize..node.to as usize] {
                    best = best.min(to_triangle(p, t));
                }
                continue;
            }
            let mut children = [at + 1, node.right as usize].map(|c| (c, to_box(p, &self.nodes[c])));
            // The nearer one is looked at first, so it goes on top.
            if children[0].1 < children[1].1 {
                children.swap(0, 1);
            }
            stack.extend(children.into_iter().filter(|c| c.1 < best));
        }
        best
    }
}

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn to_box(p: Point, node: &Node) -> f64 {
    (0..3).map(|k| (node.lo[k] - p[k]).max(p[k] - node.hi[k]).max(0.0).powi(2)).sum()
}

fn to_segment(p: Point, a: Point, b: Point) -> f64 {
    let (d, e) = (sub(b, a), sub(p, a));
    let length = dot(d, d);
    let t = if length > 0.0 { (dot(d, e) / length).clamp(0.0, 1.0) } else { 0.0 };
    let r: Point = std::array::from_fn(|k| e[k] - t * d[k]);
    dot(r, r)
}

/// Squared distance of a point and a triangle: over the inside the plane's, else the nearest side's.
fn to_triangle(p: Point, &[a, b, c]: &[Point; 3]) -> f64 {
    let (u, v, w) = (sub(b, a), sub(c, a), sub(p, a));
    let (uu, uv, vv, wu, wv) = (dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v));
    let det = uu * vv - uv * uv;
    if det > 1e-12 * uu * vv {
        let (s, t) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            let r: Point = std::array::from_fn(|k| w[k] - s * u[k] - t * v[k]);
            return dot(r, r);
        }
    }
    to_segment(p, a, b).min(to_segment(p, b, c)).min(to_segment(p, c, a))
}
