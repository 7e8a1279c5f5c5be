//! Triangles, lines and points into a z-buffer.

use super::Picture;
use crate::mesh::Mesh;

/// How faces are shaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shading {
    /// One brightness per face: the facets of a coarse level show.
    Flat,
    /// Normals averaged at the vertices and blended over the faces.
    Smooth,
    /// Flat, with the edges drawn over it.
    Wire,
}

/// An orthographic camera: a rotation and the square that fits into the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Rows: to the right, up, towards the eye; orthonormal.
    axes: [[f64; 3]; 3],
    /// In the middle of the picture.
    centre: [f64; 3],
    /// Half of the shorter side of the picture, in the units of the mesh.
    radius: f64,
}

impl View {
    /// From straight ahead (along −z), slightly from above and the right.
    pub fn front(mesh: &Mesh) -> Self {
        View::from_angles(mesh, -0.45, 0.35)
    }

    /// Turned about the upright y axis by `yaw`, then lifted by `pitch` (radians), with `mesh` filling nine tenths of the picture.
    pub fn from_angles(mesh: &Mesh, yaw: f64, pitch: f64) -> Self {
        let ((sy, cy), (sp, cp)) = (yaw.sin_cos(), pitch.sin_cos());
        let axes = [[cy, 0.0, sy], [sp * sy, cp, -sp * cy], [-cp * sy, sp, cp * cy]];
        let mut lo = [f64::INFINITY; 3];
        let mut hi = [f64::NEG_INFINITY; 3];
        for p in &mesh.positions {
            for k in 0..3 {
                let c = dot(axes[k], *p);
                lo[k] = lo[k].min(c);
                hi[k] = hi[k].max(c);
            }
        }
        let middle = |k: usize| if lo[k] <= hi[k] { 0.5 * (lo[k] + hi[k]) } else { 0.0 };
        let centre = std::array::from_fn(|j| (0..3).map(|k| axes[k][j] * middle(k)).sum());
        let radius = 0.5 * (hi[0] - lo[0]).max(hi[1] - lo[1]) / 0.9;
        View { axes, centre, radius: if radius > 0.0 && radius.is_finite() { radius } else { 1.0 } }
    }

    /// The same camera for a mesh whose y and z axes are exchanged (z upright, as in most scans).
    pub fn z_up(mesh: &Mesh, yaw: f64, pitch: f64) -> Self {
        let swap = |p: [f64; 3]| [p[0], p[2], -p[1]];
        let turned = Mesh { positions: mesh.positions.iter().map(|&p| swap(p)).collect(), ..Mesh::default() };
        let view = View::from_angles(&turned, yaw, pitch);
        let back = |p: [f64; 3]| [p[0], -p[2], p[1]];
        View { axes: view.axes.map(back), centre: back(view.centre), radius: view.radius }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn normalized(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    if length > 0.0 { a.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
}

const BACKGROUND: [u8; 3] = [38, 42, 50];
/// Samples per pixel along each axis.
const SAMPLES: u32 = 2;
/// Rows of samples that one task draws.
const BAND: usize = 32;

/// A mesh seen by a camera, in samples; z grows towards the eye.
struct Scene<'a> {
    mesh: &'a Mesh,
    points: Vec<[f64; 3]>,
    /// Per vertex for smooth shading, else per face.
    normals: Vec<[f64; 3]>,
    isolated: Vec<u32>,
    shading: Shading,
    width: usize,
    height: usize,
}

/// Draw `mesh` into a picture of the given size.
pub fn render(mesh: &Mesh, view: &View, shading: Shading, width: u32, height: u32) -> Picture {
    let (columns, rows) = ((width * SAMPLES) as usize, (height * SAMPLES) as usize);
    let scale = columns.min(rows) as f64 / (2.0 * view.radius);
    let points: Vec<[f64; 3]> = mesh
        .positions
        .iter()
        .map(|p| {
            let d = std::array::from_fn(|k| p[k] - view.centre[k]);
            let [x, y, z] = view.axes.map(|axis| dot(axis, d) * scale);
            [0.5 * columns as f64 + x, 0.5 * rows as f64 - y, z]
        })
        .collect();
    let face_normals = mesh.faces().map(|face| newell(&points, face));
    let mut used = vec![false; points.len()];
    mesh.corners.iter().for_each(|&v| used[v as usize] = true);
    let isolated = (0..points.len() as u32).filter(|&v| !used[v as usize]).collect();
    let normals = if shading == Shading::Smooth {
        let mut sums = vec![[0.0; 3]; points.len()];
        for (face, n) in mesh.faces().zip(face_normals) {
            for &v in face {
                (0..3).for_each(|k| sums[v as usize][k] += n[k]);
            }
        }
        sums.into_iter().map(normalized).collect()
    } else {
        face_normals.map(normalized).collect()
    };
    let scene = Scene { mesh, points, normals, isolated, shading, width: columns, height: rows };
    scene.resolve(&scene.draw(), width, height)
}

/// Twice the area vector of a polygon, y turned up again.
fn newell(points: &[[f64; 3]], face: &[u32]) -> [f64; 3] {
    let at = |i: usize| points[face[i % face.len()] as usize];
    let mut sum = [0.0; 3];
    for i in 1..face.len().saturating_sub(1) {
        let (a, b, c) = (at(0), at(i), at(i + 1));
        let n = cross(std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        // The picture's y points down, which turns the orientation round.
        [n[0], -n[1], n[2]].iter().enumerate().for_each(|(k, c)| sum[k] -= c);
    }
    sum
}

/// Brightness under a lamp at the upper left behind the eye, fill light from the other side; back faces are tinted.
fn shade(normal: [f64; 3]) -> [u8; 3] {
    let back = normal[2] < 0.0;
    let n = if back { normal.map(|c| -c) } else { normal };
    let lamp = dot(n, [-0.48, 0.6, 0.64]).max(0.0);
    let fill = dot(n, [0.7, -0.2, 0.68]).max(0.0);
    let light = 0.12 + 0.78 * lamp + 0.16 * fill;
    let tint = if back { [0.80, 0.58, 0.46] } else { [0.86, 0.88, 0.92] };
    tint.map(|t| (255.0 * (light * t).min(1.0).powf(1.0 / 1.6)) as u8)
}

/// Rows `first..` of the z-buffer.
struct Band<'a> {
    first: usize,
    width: usize,
    rows: usize,
    depth: &'a mut [f32],
    colour: &'a mut [[u8; 3]],
}

impl Band<'_> {
    fn plot(&mut self, x: i64, y: i64, z: f64, colour: [u8; 3]) {
        let row = y - self.first as i64;
        if x >= 0 && x < self.width as i64 && row >= 0 && row < self.rows as i64 {
            let at = row as usize * self.width + x as usize;
            if z as f32 > self.depth[at] {
                self.depth[at] = z as f32;
                self.colour[at] = colour;
            }
        }
    }

    fn triangle(&mut self, p: [[f64; 3]; 3], colour: impl Fn([f64; 3]) -> [u8; 3]) {
        let low = |k: usize| p[0][k].min(p[1][k]).min(p[2][k]);
        let high = |k: usize| p[0][k].max(p[1][k]).max(p[2][k]);
        let top = (low(1) - 0.5).ceil().max(self.first as f64) as usize;
        let bottom = (high(1) - 0.5).floor().min((self.first + self.rows) as f64 - 1.0);
        let left = (low(0) - 0.5).ceil().max(0.0) as usize;
        let right = (high(0) - 0.5).floor().min(self.width as f64 - 1.0);
        let area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        if bottom < 0.0 || right < 0.0 || area == 0.0 {
            return;
        }
        let side =
            |a: [f64; 3], b: [f64; 3], x: f64, y: f64| ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area;
        for y in top..=bottom as usize {
            for x in left..=right as usize {
                let (sx, sy) = (x as f64 + 0.5, y as f64 + 0.5);
                let w = [side(p[1], p[2], sx, sy), side(p[2], p[0], sx, sy), side(p[0], p[1], sx, sy)];
                if w.iter().all(|&c| c >= 0.0) {
                    let z = (0..3).map(|i| w[i] * p[i][2]).sum();
                    self.plot(x as i64, y as i64, z, colour(w));
                }
            }
        }
    }

    fn line(&mut self, a: [f64; 3], b: [f64; 3], lift: f64, colour: [u8; 3]) {
        let (lo, hi) = (a[1].min(b[1]), a[1].max(b[1]));
        if hi < self.first as f64 || lo > (self.first + self.rows) as f64 {
            return;
        }
        // Coordinates beyond the picture by more than its size would only cost time.
        let steps = (a[0] - b[0]).abs().max((a[1] - b[1]).abs()).ceil().clamp(1.0, 16.0 * self.width as f64);
        for i in 0..=steps as u64 {
            let t = i as f64 / steps;
            let [x, y, z] = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
            self.plot(x.floor() as i64, y.floor() as i64, z + lift, colour);
        }
    }
}

impl Scene<'_> {
    fn draw(&self) -> Vec<[u8; 3]> {
        let mut colour = vec![BACKGROUND; self.width * self.height];
        let mut depth = vec![f32::NEG_INFINITY; self.width * self.height];
        let size = (BAND * self.width).max(1);
        let bands = colour.chunks_mut(size).zip(depth.chunks_mut(size)).enumerate();
        let band = |(i, (colour, depth)): (usize, (&mut [[u8; 3]], &mut [f32]))| {
            let rows = colour.len() / self.width;
            self.draw_band(&mut Band { first: i * BAND, width: self.width, rows, depth, colour });
        };
        #[cfg(feature = "parallel")]
        {
            use rayon::prelude::*;
            bands.collect::<Vec<_>>().into_par_iter().for_each(band);
        }
        #[cfg(not(feature = "parallel"))]
        bands.for_each(band);
        colour
    }

    fn draw_band(&self, band: &mut Band<'_>) {
        const EDGE: [u8; 3] = [30, 60, 92];
        const DANGLING: [u8; 3] = [235, 170, 70];
        let (first, last) = (band.first as f64, (band.first + band.rows) as f64);
        for (f, face) in self.mesh.faces().enumerate() {
            let at = |i: usize| self.points[face[i % face.len()] as usize];
            let (mut top, mut bottom) = (f64::INFINITY, f64::NEG_INFINITY);
            for i in 0..face.len() {
                top = top.min(at(i)[1]);
                bottom = bottom.max(at(i)[1]);
            }
            if bottom < first || top > last {
                continue;
            }
            if face.len() == 2 {
                band.line(at(0), at(1), 1.0, DANGLING);
                continue;
            }
            let flat = if self.shading == Shading::Smooth { [0; 3] } else { shade(self.normals[f]) };
            for i in 1..face.len() - 1 {
                let p = [at(0), at(i), at(i + 1)];
                if self.shading == Shading::Smooth {
                    let n = [0, i, i + 1].map(|c| self.normals[face[c] as usize]);
                    band.triangle(p, |w| {
                        shade(normalized(std::array::from_fn(|k| (0..3).map(|c| w[c] * n[c][k]).sum())))
                    });
                } else {
                    band.triangle(p, |_| flat);
                }
            }
            if self.shading == Shading::Wire {
                (0..face.len()).for_each(|i| band.line(at(i), at(i + 1), 0.75, EDGE));
            }
        }
        for &v in &self.isolated {
            let [x, y, z] = self.points[v as usize];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                band.plot(x.floor() as i64 + dx, y.floor() as i64 + dy, z, DANGLING);
            }
        }
    }

    /// The mean of the samples of each pixel.
    fn resolve(&self, samples: &[[u8; 3]], width: u32, height: u32) -> Picture {
        let mut picture = Picture::new(width, height, BACKGROUND);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0u32; 3];
                for s in 0..SAMPLES * SAMPLES {
                    let (column, row) = (x * SAMPLES + s % SAMPLES, y * SAMPLES + s / SAMPLES);
                    let sample = samples[row as usize * self.width + column as usize];
                    (0..3).for_each(|k| sum[k] += u32::from(sample[k]));
                }
                picture.set(x, y, sum.map(|c| (c / (SAMPLES * SAMPLES)) as u8));
            }
        }
        picture
    }
}
