//! Where points are seen, numbers for what is drawn, how lines become samples, the codes of light.
//!
//! Projection runs in double precision: coordinates of national grids do not fit into single precision.

use super::scene::{LOOSE, Scene};
use super::texture::{to_linear, to_srgb};
use super::vector::unit;
use super::view::View;
use crate::parallel;
use glam::DVec3;

/// What is behind the mesh.
const BACKGROUND: [u8; 3] = [38, 42, 50];
/// The edges of [`Shading::Wire`](super::Shading::Wire).
const WIRES: [u8; 3] = [30, 60, 92];
/// Samples per pixel along each axis.
pub(super) const SAMPLES: usize = 2;
/// Parts of a sample that coordinates are rounded to.
pub(super) const PARTS: f64 = 256.0;
/// Coordinates beyond it, in parts, are drawn to there.
const FAR: f64 = (1i64 << 28) as f64;
/// From where the light comes most: right, up, towards the eye.
const LAMP: DVec3 = DVec3::new(-0.48, 0.6, 0.64);
/// Steps between no light and full light that have a code of their own.
pub(super) const CODES: usize = 4096;

/// Numbers of nothing and of lines in place of triangles'; those of lone points follow the triangles'.
pub(super) const EMPTY: u32 = u32::MAX;
pub(super) const WIRE: u32 = u32::MAX - 1;
pub(super) const DANGLING: u32 = u32::MAX - 2;

/// A point as it is seen: column and row in parts of a sample, depth, and how much nearer than the centre it is.
#[derive(Clone, Copy)]
pub(super) struct Seen {
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) depth: f32,
    pub(super) near: f32,
    pub(super) there: bool,
}

/// A scene's points from one view, and the lamp in the scene's axes.
pub(super) struct Screen {
    pub(super) seen: Vec<Seen>,
    pub(super) lamp: [f32; 3],
    /// Samples.
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Screen {
    /// For a picture of so many samples.
    pub(super) fn new(scene: &Scene, view: &View, width: usize, height: usize) -> Self {
        let half = 0.5 * width.min(height) as f64;
        let (middle_x, middle_y) = (0.5 * width as f64, 0.5 * height as f64);
        let part = |c: f64| (c * PARTS).round().clamp(-FAR, FAR) as i32;
        let seen = parallel::map(parallel::ranges(scene.points.len(), 1 << 14), |range| {
            let see = |p: &[f64; 3]| match view.project(*p) {
                Some(([x, y], depth, near)) => Seen {
                    x: part(middle_x + half * x),
                    y: part(middle_y - half * y),
                    depth: depth as f32,
                    near: near as f32,
                    there: true,
                },
                None => Seen { x: 0, y: 0, depth: 0.0, near: 1.0, there: false },
            };
            scene.points[range].iter().map(see).collect::<Vec<Seen>>()
        });
        let lamp = unit(LAMP);
        let [right, up, towards] = view.axes;
        let lamp = (lamp.x * right + lamp.y * up + lamp.z * towards).as_vec3().to_array();
        Screen { seen: seen.concat(), lamp, width, height }
    }

    /// Lines lie in the faces that they border; a hair's breadth lifts them out.
    pub(super) fn lift(&self) -> f32 {
        3.0 / self.width.min(self.height).max(1) as f32
    }

    /// Hand the samples of all lines and lone points whose rows may be among `rows` to `plot`: column, row, depth, number. In the order in
    /// which they are drawn, after the triangles.
    pub(super) fn lines_and_points(
        &self,
        scene: &Scene,
        rows: std::ops::Range<usize>,
        mut plot: impl FnMut(i64, i64, f32, u32),
    ) {
        for (lines, id, lift) in [(&scene.wires, WIRE, self.lift()), (&scene.dangling, DANGLING, 0.0)] {
            for line in lines.iter() {
                let [a, b] = line.map(|p| self.seen[p as usize]);
                self.line(a, b, lift, &rows, |x, y, depth| plot(x, y, depth, id));
            }
        }
        for (i, (p, _)) in scene.isolated.iter().enumerate() {
            let p = self.seen[*p as usize];
            let id = (scene.triangles.len() + i) as u32;
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                if p.there {
                    let place = |c: i32| i64::from(c).div_euclid(PARTS as i64);
                    plot(place(p.x) + dx, place(p.y) + dy, p.depth, id);
                }
            }
        }
    }

    fn line(&self, a: Seen, b: Seen, lift: f32, rows: &std::ops::Range<usize>, mut plot: impl FnMut(i64, i64, f32)) {
        let (low, high) = (f64::from(a.y.min(b.y)) / PARTS, f64::from(a.y.max(b.y)) / PARTS);
        if !a.there || !b.there || high < rows.start as f64 || low > rows.end as f64 {
            return;
        }
        let [from, to] = [a, b].map(|p| [f64::from(p.x) / PARTS, f64::from(p.y) / PARTS]);
        // Coordinates beyond the picture by more than its size would only cost time.
        let longest = (from[0] - to[0]).abs().max((from[1] - to[1]).abs());
        let steps = longest.ceil().clamp(1.0, 16.0 * self.width as f64);
        for i in 0..=steps as u64 {
            let t = i as f64 / steps;
            let [x, y] = [0, 1].map(|k| from[k] + t * (to[k] - from[k]));
            plot(x.floor() as i64, y.floor() as i64, a.depth + t as f32 * (b.depth - a.depth) + lift);
        }
    }
}

/// Linear light of what is no triangle: the background, wires, dangling edges.
pub(super) fn plain_lights() -> [[f32; 3]; 3] {
    let linear = |colour: [u8; 3]| colour.map(|c| to_linear(f32::from(c) / 255.0));
    [linear(BACKGROUND), linear(WIRES), LOOSE]
}

/// What a step of light is in the picture, for 0 to [`CODES`].
pub(super) fn codes() -> Vec<u8> {
    (0..=CODES).map(|i| (255.0 * to_srgb(i as f32 / CODES as f32) + 0.5) as u8).collect()
}
