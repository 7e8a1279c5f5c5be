//! Distances between meshes, measured: many points of one against every triangle of the other, in `f64`. Written apart from
//! the bounds that it checks.
//!
//! A mesh is the union of its triangles, its polygons, its dangling edges as segments and its isolated vertices as points.
//! A polygon of more than three corners is what `lodestream::encode::cost` says it is: the triangles between its edges and
//! the mean of its corners.

use lodestream::mesh::Mesh;

type V = [f64; 3];

fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn mix(t: &[V; 3], u: [f64; 3]) -> V {
    std::array::from_fn(|k| u[0] * t[0][k] + u[1] * t[1][k] + u[2] * t[2][k])
}

fn to_segment(x: V, a: V, b: V) -> f64 {
    let (w, e) = (sub(x, a), sub(b, a));
    let ee = dot(e, e);
    let u = if ee > 0.0 { (dot(w, e) / ee).clamp(0.0, 1.0) } else { 0.0 };
    let r: V = std::array::from_fn(|k| w[k] - u * e[k]);
    dot(r, r)
}

/// Squared distance of a point to a triangle, which may be a segment or a point.
fn to_triangle(x: V, t: &[V; 3]) -> f64 {
    let (u, v, w) = (sub(t[1], t[0]), sub(t[2], t[0]), sub(x, t[0]));
    let (uu, uv, vv, wu, wv) = (dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v));
    let det = uu * vv - uv * uv;
    if det > 1e-14 * uu * vv {
        let (s, r) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
        if s >= 0.0 && r >= 0.0 && s + r <= 1.0 {
            let d: V = std::array::from_fn(|k| w[k] - s * u[k] - r * v[k]);
            return dot(d, d);
        }
    }
    to_segment(x, t[0], t[1]).min(to_segment(x, t[1], t[2])).min(to_segment(x, t[2], t[0]))
}

/// The triangles of a mesh in a uniform grid.
pub struct Surface {
    pub triangles: Vec<[V; 3]>,
    lo: V,
    cell: f64,
    size: [usize; 3],
    start: Vec<u32>,
    held: Vec<u32>,
}

impl Surface {
    pub fn new(mesh: &Mesh) -> Surface {
        let p = |v: u32| mesh.positions[v as usize];
        let mut triangles = Vec::new();
        let mut used = vec![false; mesh.positions.len()];
        for f in mesh.faces() {
            f.iter().for_each(|&v| used[v as usize] = true);
            match *f {
                [a, b] => triangles.push([p(a), p(b), p(b)]),
                [a, b, c] => triangles.push([p(a), p(b), p(c)]),
                _ => {
                    let mut mean = [0.0; 3];
                    f.iter().for_each(|&v| (0..3).for_each(|k| mean[k] += p(v)[k] / f.len() as f64));
                    triangles.extend((0..f.len()).map(|i| [mean, p(f[i]), p(f[(i + 1) % f.len()])]));
                }
            }
        }
        triangles.extend((0..used.len()).filter(|&v| !used[v]).map(|v| [mesh.positions[v]; 3]));

        let (mut lo, mut hi) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for c in triangles.iter().flatten() {
            for k in 0..3 {
                lo[k] = lo[k].min(c[k]);
                hi[k] = hi[k].max(c[k]);
            }
        }
        let mut s = Surface { triangles, lo, cell: 1.0, size: [1; 3], start: Vec::new(), held: Vec::new() };
        if s.triangles.is_empty() {
            return s;
        }
        let side = (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f64::max);
        // A surface meets about as many cells as a side has, squared.
        let mut parts = (s.triangles.len() as f64).sqrt().clamp(1.0, 160.0);
        loop {
            s.cell = if side > 0.0 { side / parts } else { 1.0 };
            s.size = std::array::from_fn(|k| ((hi[k] - lo[k]) / s.cell) as usize + 1);
            // Large triangles across each other would fill every cell.
            let mut held = 0;
            s.triangles.iter().for_each(|t| s.boxed(t, |_| held += 1));
            if held <= 24 * s.triangles.len() || parts <= 1.0 {
                break;
            }
            parts /= 2.0;
        }
        // Counting sort of the triangles by the cells of their boxes.
        let mut counts = vec![0u32; s.size.iter().product::<usize>() + 1];
        for t in &s.triangles {
            s.boxed(t, |c| counts[c + 1] += 1);
        }
        for i in 1..counts.len() {
            counts[i] += counts[i - 1];
        }
        s.start = counts.clone();
        let mut held = vec![0u32; counts[counts.len() - 1] as usize];
        for (i, t) in s.triangles.iter().enumerate() {
            s.boxed(t, |c| {
                held[counts[c] as usize] = i as u32;
                counts[c] += 1;
            });
        }
        s.held = held;
        s
    }

    fn place(&self, x: V) -> [usize; 3] {
        std::array::from_fn(|k| (((x[k] - self.lo[k]) / self.cell).max(0.0) as usize).min(self.size[k] - 1))
    }

    fn boxed(&self, t: &[V; 3], mut f: impl FnMut(usize)) {
        let a = self.place(std::array::from_fn(|k| t[0][k].min(t[1][k]).min(t[2][k])));
        let b = self.place(std::array::from_fn(|k| t[0][k].max(t[1][k]).max(t[2][k])));
        for x in a[0]..=b[0] {
            for y in a[1]..=b[1] {
                for z in a[2]..=b[2] {
                    f((x * self.size[1] + y) * self.size[2] + z);
                }
            }
        }
    }

    /// Squared distance of `x` to the surface, or anything not above `enough` where it is not above that. `hint` is a triangle
    /// that is likely to be near; it becomes the nearest.
    pub fn distance2(&self, x: V, enough: f64, hint: &mut usize) -> f64 {
        let Some(t) = self.triangles.get(*hint) else { return f64::INFINITY };
        let mut best = to_triangle(x, t);
        let at = self.place(x).map(|c| c as i64);
        let most = self.size.iter().max().copied().unwrap_or(1) as i64;
        for reach in 0..=most {
            let range = |k: usize| (at[k] - reach).max(0)..=(at[k] + reach).min(self.size[k] as i64 - 1);
            for cx in range(0) {
                for cy in range(1) {
                    let shell = (cx - at[0]).abs() == reach || (cy - at[1]).abs() == reach;
                    for cz in range(2) {
                        if best <= enough {
                            return best;
                        }
                        if !shell && (cz - at[2]).abs() != reach {
                            continue;
                        }
                        let c = (cx as usize * self.size[1] + cy as usize) * self.size[2] + cz as usize;
                        for &i in &self.held[self.start[c] as usize..self.start[c + 1] as usize] {
                            let d = to_triangle(x, &self.triangles[i as usize]);
                            if d < best {
                                (best, *hint) = (d, i as usize);
                            }
                        }
                    }
                }
            }
            // What no shell has met yet is at least `reach` cells away from the point of the box nearest to `x`.
            if best <= (reach as f64 * self.cell).powi(2) * (1.0 - 1e-9) {
                break;
            }
        }
        best
    }

    /// The largest distance found from points of `self` to `other`: corners, middles of edges, and points inside, the more
    /// the larger the triangle, about `samples` in all.
    pub fn farthest(&self, other: &Surface, samples: usize) -> f64 {
        let area = |t: &[V; 3]| {
            let (u, v) = (sub(t[1], t[0]), sub(t[2], t[0]));
            (dot(u, u) * dot(v, v) - dot(u, v).powi(2)).max(0.0).sqrt()
        };
        let whole: f64 = self.triangles.iter().map(area).sum();
        let (mut worst, mut hint) = (0.0f64, 0);
        let mut visit = |x: V| worst = worst.max(other.distance2(x, worst, &mut hint));
        for t in &self.triangles {
            visit(t[0]);
            if t[1] == t[0] && t[2] == t[0] {
                continue;
            }
            let share = if whole > 0.0 { samples as f64 * area(t) / whole } else { 1.0 };
            let parts = ((2.0 * share).sqrt().ceil() as u32).clamp(2, 64);
            let n = f64::from(parts);
            for i in 0..=parts {
                for j in 0..=parts - i {
                    let (a, b) = (f64::from(i) / n, f64::from(j) / n);
                    visit(mix(t, [a, b, 1.0 - a - b]));
                }
            }
            visit(mix(t, [1.0 / 3.0; 3]));
        }
        worst.sqrt()
    }
}

/// The symmetric distance, as far as samples tell.
pub fn symmetric(a: &Surface, b: &Surface, samples: usize) -> f64 {
    a.farthest(b, samples).max(b.farthest(a, samples))
}
