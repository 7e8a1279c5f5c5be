//! Distances between meshes by sampling, as METRO does it (Cignoni, Rocchini, Scopigno 1998).
//!
//! Samples of one mesh are its vertices, points along its edges by length, and points on its faces by area; each looks for the nearest point
//! of the other. There is no chance in it: samples along edges and faces stand at equal steps of the running sum of lengths and areas,
//! and inside a face follow the R2 sequence (Roberts 2018), so that they spread evenly within large faces and over many small ones.
//! Sums are taken in blocks of fixed size, so results do not depend on the number of threads.
//!
//! A sampled maximum is a lower bound of the Hausdorff distance; mean and root mean square converge quickly.

use super::surface::{Surface, nearest_weights};
use crate::mesh::Mesh;
use crate::parallel;
use glam::DVec3;

/// Samples that one task looks up.
const BLOCK: usize = 4096;

/// How samples count in mean and root mean square. The maximum is over all of them either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weights {
    /// The surface integral, as METRO: samples on faces alone. A mesh without area is measured along its edges, without edges at its vertices.
    #[default]
    Area,
    /// Each sample the same: vertices, edges and faces together, as PyMeshLab's filter of the Hausdorff distance.
    Samples,
}

/// How to sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleOptions {
    /// Samples on faces; as many along edges, and at most as many vertices (all where there are fewer, else evenly chosen ones).
    pub samples: usize,
    /// How they count.
    pub weights: Weights,
}

impl Default for SampleOptions {
    fn default() -> Self {
        SampleOptions { samples: 300_000, weights: Weights::Area }
    }
}

/// Distances from one mesh to another, in units of the meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Directed {
    /// The mean.
    pub mean: f64,
    /// The root mean square.
    pub rms: f64,
    /// The maximum.
    pub max: f64,
    /// The sample that is farthest.
    pub farthest: [f64; 3],
    /// Vertices looked up.
    pub vertices: usize,
    /// Samples along edges.
    pub edges: usize,
    /// Samples on faces.
    pub faces: usize,
}

/// Distances between two meshes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Geometry {
    /// From the first mesh to the second.
    pub forward: Directed,
    /// From the second mesh to the first.
    pub backward: Directed,
    /// The diagonal of the first mesh's bounding box.
    pub diagonal: f64,
}

impl Geometry {
    /// The larger mean of the two directions.
    pub fn mean(&self) -> f64 {
        self.forward.mean.max(self.backward.mean)
    }

    /// The larger root mean square of the two directions.
    pub fn rms(&self) -> f64 {
        self.forward.rms.max(self.backward.rms)
    }

    /// The Hausdorff distance, as far as samples tell.
    pub fn max(&self) -> f64 {
        self.forward.max.max(self.backward.max)
    }
}

/// A mesh ready to be measured from and to.
pub struct Sampled<'a> {
    /// Its surface.
    pub surface: Surface,
    mesh: &'a Mesh,
    /// Vertices in the order of the tree.
    vertices: Vec<u32>,
    /// Edges in the order of the tree, each once, and the running sum of their lengths.
    edges: Vec<[u32; 2]>,
    lengths: Vec<f64>,
    /// The running sum of the triangles' areas.
    areas: Vec<f64>,
}

impl<'a> Sampled<'a> {
    /// Prepare a valid mesh.
    pub fn new(mesh: &'a Mesh) -> Self {
        let surface = Surface::new(mesh);
        let local = surface.local();
        let areas = running(local.iter().map(|t| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length()));
        let mut seen = vec![false; mesh.positions.len()];
        let mut vertices = Vec::with_capacity(mesh.positions.len());
        let mut edges = Vec::with_capacity(local.len() * 3 / 2);
        for i in 0..local.len() as u32 {
            let origin = surface.origin(i);
            if origin.face == crate::mesh::NO_VALUE {
                vertices.push(origin.corner);
                continue;
            }
            let face = mesh.face(origin.face as usize);
            let mut side = |a: usize, b: usize| {
                let (a, b) = (face[a % face.len()], face[b % face.len()]);
                if !std::mem::replace(&mut seen[a as usize], true) {
                    vertices.push(a);
                }
                edges.push([a.min(b), a.max(b)]);
            };
            match face.len() {
                2 => {
                    side(0, 1);
                    side(1, 0);
                }
                3 => (0..3).for_each(|c| side(c, c + 1)),
                _ => side(origin.corner as usize, origin.corner as usize + 1),
            }
        }
        let edges = once(edges, mesh.positions.len());
        let lengths = running(edges.iter().map(|e| {
            let [a, b] = e.map(|v| DVec3::from(mesh.positions[v as usize]));
            a.distance(b)
        }));
        Sampled { surface, mesh, vertices, edges, lengths, areas }
    }

    /// The mesh.
    pub fn mesh(&self) -> &'a Mesh {
        self.mesh
    }

    /// Distances from this mesh to `other`. All zero where either has nothing.
    pub fn to(&self, other: &Surface, options: &SampleOptions) -> Directed {
        if self.surface.is_empty() || other.is_empty() {
            return Directed::default();
        }
        let n = options.samples.max(1);
        let has = |sum: &[f64]| sum.last().is_some_and(|&s| s > 0.0);
        let vertices = self.vertices.len().min(n);
        let edges = if has(&self.lengths) { n } else { 0 };
        let faces = if has(&self.areas) { n } else { 0 };
        let parts = [
            self.sum(other, vertices, |block, f| {
                let pick =
                    |k: usize| self.vertices[(k as u128 * self.vertices.len() as u128 / vertices as u128) as usize];
                block.for_each(|k| f(self.mesh.positions[pick(k) as usize].into()));
            }),
            self.sum(other, edges, |block, f| self.along_edges(block, edges, options.weights, f)),
            self.sum(other, faces, |block, f| self.on_faces(block, faces, |_, _, x| f(x))),
        ];
        let counted = match options.weights {
            Weights::Samples => &parts[..],
            Weights::Area => match parts.iter().rposition(|p| p.count > 0) {
                Some(kind) => &parts[kind..=kind],
                None => &parts[..],
            },
        };
        let total = |f: fn(&Sum) -> f64| counted.iter().map(f).sum::<f64>();
        let count = total(|p| p.count as f64).max(1.0);
        let worst = parts.iter().fold(&parts[0], |a, b| if b.max > a.max { b } else { a });
        Directed {
            mean: total(|p| p.sum) / count,
            rms: (total(|p| p.squares) / count).sqrt(),
            max: worst.max.sqrt(),
            farthest: worst.farthest.to_array(),
            vertices,
            edges,
            faces,
        }
    }

    /// The samples `block` of `of` along the edges: at equal steps of the running length, or the same number on each edge but
    /// evenly between its ends, as PyMeshLab places them (which keeps off the ends of short edges).
    fn along_edges(&self, block: std::ops::Range<usize>, of: usize, weights: Weights, f: &mut dyn FnMut(DVec3)) {
        let step = self.lengths[self.lengths.len() - 1] / of as f64;
        let mut e = 0;
        for k in block {
            let at = (k as f64 + 0.5) * step;
            e = reach(&self.lengths, e, at);
            let before = if e == 0 { 0.0 } else { self.lengths[e - 1] };
            let length = self.lengths[e] - before;
            let t = if weights == Weights::Samples {
                let first = (before / step - 0.5).ceil();
                let count = (self.lengths[e] / step - 0.5).ceil() - first;
                (k as f64 - first + 1.0) / (count + 1.0)
            } else {
                (at - before) / length
            };
            let t = if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.5 };
            let [a, b] = self.edges[e].map(|v| DVec3::from(self.mesh.positions[v as usize]));
            f(a + t * (b - a));
        }
    }

    /// The samples `block` of `of` on the faces: triangle, barycentric weights, point.
    pub(super) fn on_faces(&self, block: std::ops::Range<usize>, of: usize, mut f: impl FnMut(u32, [f64; 3], DVec3)) {
        let Some(&area) = self.areas.last() else { return };
        let step = area / of as f64;
        let centre = self.surface.centre();
        let mut t = 0;
        for k in block {
            t = reach(&self.areas, t, (k as f64 + 0.5) * step);
            // R2: multiples of 1/g and 1/g² for the root g of g³ = g + 1.
            let mut u = (k as f64 * 0.754_877_666_246_692_8 + 0.5).fract();
            let mut v = (k as f64 * 0.569_840_290_998_053_3 + 0.5).fract();
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let w = [1.0 - u - v, u, v];
            let [a, b, c] = self.surface.local()[t];
            f(t as u32, w, w[0] * a + w[1] * b + w[2] * c + centre);
        }
    }

    fn sum(
        &self,
        other: &Surface,
        count: usize,
        samples: impl Fn(std::ops::Range<usize>, &mut dyn FnMut(DVec3)) + Sync + Send,
    ) -> Sum {
        if count == 0 {
            return Sum::default();
        }
        let blocks = parallel::map(parallel::ranges(count, BLOCK), |block| {
            let (mut sum, mut hint) = (Sum::default(), 0);
            samples(block, &mut |x| {
                let Some(nearest) = other.nearest(x.to_array(), hint) else { return };
                hint = nearest.triangle;
                sum.add(x, nearest.distance2);
            });
            sum
        });
        blocks.into_iter().fold(Sum::default(), Sum::and)
    }

    /// For each vertex the distance to `other`, 0 where that is nothing.
    pub fn vertex_distances(&self, other: &Surface) -> Vec<f64> {
        let blocks = parallel::map(parallel::ranges(self.vertices.len(), BLOCK), |block| {
            let mut hint = 0;
            let near = |&v: &u32| {
                let Some(nearest) = other.nearest(self.mesh.positions[v as usize], hint) else { return 0.0 };
                hint = nearest.triangle;
                nearest.distance2.sqrt()
            };
            self.vertices[block].iter().map(near).collect::<Vec<f64>>()
        });
        let mut distances = vec![0.0; self.mesh.positions.len()];
        self.vertices.iter().zip(blocks.into_iter().flatten()).for_each(|(&v, d)| distances[v as usize] = d);
        distances
    }
}

/// Measure both directions between two valid meshes.
pub fn geometry(a: &Mesh, b: &Mesh, options: &SampleOptions) -> Geometry {
    let (a, b) = parallel::join(|| Sampled::new(a), || Sampled::new(b));
    geometry_of(&a, &b, options)
}

/// The same for meshes that are ready.
pub fn geometry_of(a: &Sampled<'_>, b: &Sampled<'_>, options: &SampleOptions) -> Geometry {
    Geometry { forward: a.to(&b.surface, options), backward: b.to(&a.surface, options), diagonal: diagonal(a.mesh) }
}

/// The diagonal of the bounding box, 0 without vertices.
pub fn diagonal(mesh: &Mesh) -> f64 {
    mesh.bounds().map_or(0.0, |(lo, hi)| DVec3::from(lo).distance(DVec3::from(hi)))
}

/// The point of a triangle nearest to `x`, as barycentric weights.
pub(super) fn foot(surface: &Surface, triangle: u32, x: DVec3) -> [f64; 3] {
    nearest_weights(x - surface.centre(), &surface.local()[triangle as usize])
}

/// What a block of samples gave; distances squared where named so.
#[derive(Clone, Copy, Default)]
struct Sum {
    count: usize,
    sum: f64,
    squares: f64,
    max: f64,
    farthest: DVec3,
}

impl Sum {
    fn add(&mut self, x: DVec3, distance2: f64) {
        if self.count == 0 || distance2 > self.max {
            (self.max, self.farthest) = (distance2, x);
        }
        self.count += 1;
        self.sum += distance2.sqrt();
        self.squares += distance2;
    }

    fn and(self, other: Sum) -> Sum {
        let first = self.count == 0 || other.count > 0 && other.max > self.max;
        let (max, farthest) = if first { (other.max, other.farthest) } else { (self.max, self.farthest) };
        Sum {
            count: self.count + other.count,
            sum: self.sum + other.sum,
            squares: self.squares + other.squares,
            max,
            farthest,
        }
    }
}

/// Running sums.
fn running(parts: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sum = 0.0;
    parts
        .map(|part| {
            sum += part;
            sum
        })
        .collect()
}

/// The first place, from `near` on, whose running sum is above `at`; steps first, then halves.
fn reach(sums: &[f64], near: usize, at: f64) -> usize {
    let last = sums.len() - 1;
    let mut i = near.min(last);
    for _ in 0..8 {
        if sums[i] > at || i == last {
            return i;
        }
        i += 1;
    }
    (i + sums[i..].partition_point(|&s| s <= at)).min(last)
}

/// Each edge once, where it came first: edges are put together by their lower vertex, and there by the other.
fn once(edges: Vec<[u32; 2]>, vertices: usize) -> Vec<[u32; 2]> {
    let mut start = vec![0u32; vertices + 1];
    edges.iter().for_each(|e| start[e[0] as usize + 1] += 1);
    (0..vertices).for_each(|v| start[v + 1] += start[v]);
    let mut next = start.clone();
    let mut held = vec![[0u32; 2]; edges.len()];
    for (e, i) in edges.iter().zip(0..) {
        let place = &mut next[e[0] as usize];
        held[*place as usize] = [e[1], i];
        *place += 1;
    }
    let mut first = vec![false; edges.len()];
    for v in 0..vertices {
        let bucket = &mut held[start[v] as usize..start[v + 1] as usize];
        bucket.sort_unstable();
        bucket.chunk_by(|a, b| a[0] == b[0]).for_each(|same| first[same[0][1] as usize] = true);
    }
    edges.into_iter().zip(first).filter_map(|(e, first)| first.then_some(e)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    fn square(z: f64, parts: u32) -> Mesh {
        let mut mesh = Mesh::default();
        let n = parts + 1;
        for y in 0..n {
            for x in 0..n {
                mesh.positions.push([f64::from(x) / f64::from(parts), f64::from(y) / f64::from(parts), z]);
            }
        }
        for y in 0..parts {
            for x in 0..parts {
                let v = y * n + x;
                mesh.push_face(&[v, v + 1, v + n + 1, v + n]);
            }
        }
        mesh
    }

    #[test]
    fn parallel_planes_and_a_point() {
        for weights in [Weights::Area, Weights::Samples] {
            let options = SampleOptions { samples: 1000, weights };
            let g = geometry(&square(0.0, 3), &square(0.25, 5), &options);
            for d in [g.forward, g.backward] {
                for value in [d.mean, d.rms, d.max] {
                    assert!((value - 0.25).abs() < 1e-12);
                }
                assert_eq!((d.edges, d.faces), (1000, 1000));
            }
            assert_eq!((g.forward.vertices, g.backward.vertices), (16, 36));
            assert!((g.diagonal - 2f64.sqrt()).abs() < 1e-12);
        }
        // Everything to the origin: of the unit square the mean distance is (√2 + asinh 1) / 3, the mean of squares 2/3.
        let point = Mesh { positions: vec![[0.0; 3]], ..Mesh::default() };
        let g = geometry(&square(0.0, 1), &point, &SampleOptions { samples: 20_000, weights: Weights::Area });
        assert!((g.forward.mean - (2f64.sqrt() + 1f64.asinh()) / 3.0).abs() < 2e-4, "{}", g.forward.mean);
        assert!((g.forward.rms - (2f64 / 3.0).sqrt()).abs() < 2e-4);
        assert!((g.forward.max - 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(g.forward.farthest, [1.0, 1.0, 0.0]);
        assert_eq!(g.backward.max, 0.0);
    }

    #[test]
    fn samples_spread_evenly_whatever_the_faces() {
        // A plane in coarse and in fine faces under a ramp: the mean height is that of the ramp's middle.
        for parts in [1, 7, 40] {
            let mesh = square(0.0, parts);
            let sampled = Sampled::new(&mesh);
            let (mut sum, mut count) = ([0.0; 2], 0);
            sampled.on_faces(0..5000, 5000, |_, w, x| {
                assert!(w.iter().all(|&c| c >= 0.0));
                sum = [sum[0] + x[0], sum[1] + x[1]];
                count += 1;
            });
            assert_eq!(count, 5000);
            assert!(sum.iter().all(|s| (s / 5000.0 - 0.5).abs() < 2e-3), "{sum:?}");
        }
    }

    #[test]
    fn far_from_the_origin_and_on_any_number_of_threads() {
        let (mut a, mut b) = (samples::asteroid(12, 1), samples::asteroid(5, 1));
        let options = SampleOptions { samples: 3000, weights: Weights::Samples };
        let near = geometry(&a, &b, &options);
        #[cfg(feature = "parallel")]
        {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            assert_eq!(pool.install(|| geometry(&a, &b, &options)), near);
        }
        for mesh in [&mut a, &mut b] {
            mesh.positions.iter_mut().for_each(|p| *p = [p[0] + 512e3, p[1] + 5.403e6, p[2] + 300.0]);
        }
        let far = geometry(&a, &b, &options);
        assert!((far.mean() - near.mean()).abs() < 1e-6 * near.mean());
        assert!((far.max() - near.max()).abs() < 1e-6 * near.max());
    }

    #[test]
    fn edges_points_crumbs_and_nothing() {
        let book = samples::fan_book(5, 2, 1);
        let options = SampleOptions { samples: 500, weights: Weights::Area };
        for mesh in [samples::crumbs(30, 1), samples::point_cloud(40, 2), samples::soup(30, 60, 1), book] {
            let g = geometry(&mesh, &mesh, &options);
            assert!(g.max() < 1e-12, "{g:?}");
            assert_eq!(g.forward.vertices, mesh.vertex_count().min(500));
            assert_eq!(geometry(&mesh, &Mesh::default(), &options).max(), 0.0);
        }
        let mut edge = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0]], ..Mesh::default() };
        edge.push_face(&[0, 1]);
        let mut far = edge.clone();
        far.positions.iter_mut().for_each(|p| p[1] = 2.0);
        let g = geometry(&edge, &far, &options);
        assert_eq!((g.forward.mean, g.forward.edges, g.forward.faces), (2.0, 500, 0));
    }
}
