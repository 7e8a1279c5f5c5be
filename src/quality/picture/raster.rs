//! The renderer, on the processor: triangles, lines and points into a z-buffer, then light on what is seen.
//!
//! Two by two samples a pixel. Bands of rows are drawn side by side on all cores, each by itself, so the picture does not depend on how many
//! there are. Coordinates are rounded to 1/256 of a sample and edges tested in integers with the top-left rule: no sample is
//! missed or met twice where triangles share an edge. Each sample keeps the number of the nearest triangle; colours are computed once, at the end.

use super::scene::{Paint, Scene, Surface as Values, Triangle};
use super::screen::{CODES, DANGLING, EMPTY, PARTS, SAMPLES, Screen, Seen, WIRE, codes, plain_lights};
use super::{Picture, View};
use crate::parallel;

/// Rows of samples that one task draws; a multiple of [`SAMPLES`].
const BAND: usize = 32;

/// Draw `scene` into a picture of the given size.
pub fn draw(scene: &Scene, view: &View, width: u32, height: u32) -> Picture {
    let frame = Frame::new(scene, view, width as usize * SAMPLES, height as usize * SAMPLES);
    let rows = parallel::map(frame.bands(), |band| frame.draw_band(band));
    Picture { width, height, rgb: rows.concat() }
}

/// What a band of rows has to draw.
struct Band {
    first: usize,
    rows: usize,
    triangles: Vec<u32>,
}

/// One picture in the making.
struct Frame<'a> {
    scene: &'a Scene,
    screen: Screen,
    width: usize,
    height: usize,
    /// Of the background, wires, dangling edges.
    plain: [[f32; 3]; 3],
    coded: Vec<u8>,
}

/// The nearest thing at each sample of a band.
struct Buffer {
    first: usize,
    width: usize,
    rows: usize,
    depth: Vec<f32>,
    id: Vec<u32>,
}

impl<'a> Frame<'a> {
    fn new(scene: &'a Scene, view: &View, width: usize, height: usize) -> Self {
        let screen = Screen::new(scene, view, width, height);
        Frame { scene, screen, width, height, plain: plain_lights(), coded: codes() }
    }

    /// Sort the triangles into bands.
    fn bands(&self) -> Vec<Band> {
        let count = self.height.div_ceil(BAND);
        let mut bands: Vec<Band> = (0..count)
            .map(|i| Band { first: i * BAND, rows: BAND.min(self.height - i * BAND), triangles: Vec::new() })
            .collect();
        for (i, t) in self.scene.triangles.iter().enumerate() {
            let [a, b, c] = t.points.map(|p| self.screen.seen[p as usize]);
            if !(a.there && b.there && c.there) {
                continue;
            }
            let (left, right) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
            let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
            let columns = samples(left, right, self.width);
            let rows = samples(top, bottom, self.height);
            if columns.is_empty() || rows.is_empty() {
                continue;
            }
            for band in &mut bands[rows.start / BAND..=(rows.end - 1) / BAND] {
                band.triangles.push(i as u32);
            }
        }
        bands
    }

    fn draw_band(&self, band: Band) -> Vec<u8> {
        let size = self.width * band.rows;
        let mut buffer = Buffer {
            first: band.first,
            width: self.width,
            rows: band.rows,
            depth: vec![f32::NEG_INFINITY; size],
            id: vec![EMPTY; size],
        };
        for &i in &band.triangles {
            self.fill(&mut buffer, i);
        }
        let rows = band.first..band.first + band.rows;
        self.screen.lines_and_points(self.scene, rows, |x, y, depth, id| buffer.plot(x, y, depth, id));
        self.resolve(&buffer)
    }

    /// Put a triangle into the buffer.
    fn fill(&self, buffer: &mut Buffer, number: u32) {
        let triangle = &self.scene.triangles[number as usize];
        let Some(plane) = Plane::new(triangle.points.map(|p| self.screen.seen[p as usize])) else { return };
        let paint = &self.scene.materials[triangle.material as usize];
        let cut = paint.cutoff.map(|cutoff| (cutoff, Surface::new(self, triangle, &plane)));
        let columns = samples(plane.left, plane.right, self.width);
        let rows = samples(plane.top, plane.bottom, self.height);
        let rows = rows.start.max(buffer.first)..rows.end.min(buffer.first + buffer.rows);
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let step: [i64; 3] = plane.edges.map(|e| e[0] * PARTS as i64);
        for row in rows {
            let mut at = plane.at(columns.start, row);
            let line = (row - buffer.first) * buffer.width;
            let mut inside = false;
            for column in columns.clone() {
                // The bias makes samples on an edge belong to one of its two triangles.
                if (at[0] + plane.bias[0]) | (at[1] + plane.bias[1]) | (at[2] + plane.bias[2]) >= 0 {
                    inside = true;
                    let depth = plane.depth(at);
                    let place = line + column;
                    if depth > buffer.depth[place] && cut.as_ref().is_none_or(|(c, s)| s.alpha(plane.weights(at)) >= *c)
                    {
                        buffer.depth[place] = depth;
                        buffer.id[place] = number;
                    }
                } else if inside {
                    break;
                }
                (0..3).for_each(|k| at[k] += step[k]);
            }
        }
    }

    /// Light what is seen, and take the mean of the samples of each pixel.
    fn resolve(&self, buffer: &Buffer) -> Vec<u8> {
        let columns = self.width / SAMPLES;
        let mut rgb = Vec::with_capacity(3 * columns * buffer.rows / SAMPLES);
        let mut last: Option<(u32, Plane, Surface<'_>)> = None;
        let [background, wire, dangling] = self.plain;
        let triangles = self.scene.triangles.len();
        for y in 0..buffer.rows / SAMPLES {
            for x in 0..columns {
                let mut sum = [0.0f32; 3];
                for s in 0..SAMPLES * SAMPLES {
                    let (column, row) = (x * SAMPLES + s % SAMPLES, y * SAMPLES + s / SAMPLES);
                    let id = buffer.id[row * buffer.width + column];
                    let colour = match id {
                        EMPTY => background,
                        WIRE => wire,
                        DANGLING => dangling,
                        _ if id as usize >= triangles => self.scene.isolated[id as usize - triangles].1,
                        _ => {
                            if last.as_ref().is_none_or(|(known, ..)| *known != id) {
                                let triangle = &self.scene.triangles[id as usize];
                                last = Plane::new(triangle.points.map(|p| self.screen.seen[p as usize]))
                                    .map(|plane| (id, plane, Surface::new(self, triangle, &plane)));
                            }
                            match &last {
                                Some((_, plane, surface)) => surface
                                    .colour(plane.weights(plane.at(column, buffer.first + row)), self.screen.lamp),
                                None => background,
                            }
                        }
                    };
                    (0..3).for_each(|k| sum[k] += colour[k]);
                }
                let full = CODES as f32;
                let coded =
                    |c: f32| self.coded[(c / (SAMPLES * SAMPLES) as f32 * full + 0.5).clamp(0.0, full) as usize];
                rgb.extend(sum.map(coded));
            }
        }
        rgb
    }
}

/// The samples between two coordinates in parts, of `limit` there are: sample `i` is at `i + 1/2`.
fn samples(low: i32, high: i32, limit: usize) -> std::ops::Range<usize> {
    let (parts, half) = (PARTS as i64, PARTS as i64 / 2);
    let first = (i64::from(low) - half + parts - 1).div_euclid(parts).clamp(0, limit as i64);
    let last = (i64::from(high) - half).div_euclid(parts).clamp(-1, limit as i64 - 1);
    first as usize..(last + 1).max(first) as usize
}

/// A triangle on the screen. Edge `i` is opposite to corner `i`, its function grows inwards.
#[derive(Clone, Copy)]
struct Plane {
    edges: [[i64; 3]; 3],
    bias: [i64; 3],
    inverse: f64,
    depths: [f64; 3],
    nears: [f32; 3],
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
    /// Seen from behind.
    back: bool,
    /// In samples, of the triangle twice.
    area: f64,
}

impl Plane {
    /// `None` for one that is seen from the side, or lies behind the eye.
    fn new(corners: [Seen; 3]) -> Option<Self> {
        if corners.iter().any(|c| !c.there) {
            return None;
        }
        let p = corners.map(|c| [i64::from(c.x), i64::from(c.y)]);
        let area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
        if area == 0 {
            return None;
        }
        // Rows count downwards: what runs counterclockwise has a negative area here.
        let sign = area.signum();
        let edge = |a: [i64; 2], b: [i64; 2]| {
            let (x, y) = (sign * (a[1] - b[1]), sign * (b[0] - a[0]));
            [x, y, -(x * a[0] + y * a[1])]
        };
        let edges = [edge(p[1], p[2]), edge(p[2], p[0]), edge(p[0], p[1])];
        // Left edges and upper ones, along which the inside lies to the right or below, keep their samples.
        let bias = edges.map(|[x, y, _]| if x > 0 || x == 0 && y > 0 { 0 } else { -1 });
        let (xs, ys) = (corners.map(|c| c.x), corners.map(|c| c.y));
        let low = |v: [i32; 3]| v[0].min(v[1]).min(v[2]);
        let high = |v: [i32; 3]| v[0].max(v[1]).max(v[2]);
        Some(Plane {
            edges,
            bias,
            inverse: 1.0 / (sign * area) as f64,
            depths: corners.map(|c| f64::from(c.depth)),
            nears: corners.map(|c| c.near),
            left: low(xs),
            right: high(xs),
            top: low(ys),
            bottom: high(ys),
            back: area > 0,
            area: (sign * area) as f64 / (PARTS * PARTS),
        })
    }

    /// The edge functions at a sample.
    fn at(&self, column: usize, row: usize) -> [i64; 3] {
        let place = |i: usize| i as i64 * PARTS as i64 + PARTS as i64 / 2;
        self.edges.map(|[x, y, c]| x * place(column) + y * place(row) + c)
    }

    fn depth(&self, at: [i64; 3]) -> f32 {
        ((at[0] as f64 * self.depths[0] + at[1] as f64 * self.depths[1] + at[2] as f64 * self.depths[2]) * self.inverse)
            as f32
    }

    /// How much each corner counts at a sample, seen in perspective.
    fn weights(&self, at: [i64; 3]) -> [f32; 3] {
        let w: [f32; 3] = std::array::from_fn(|k| (at[k] as f64 * self.inverse) as f32 * self.nears[k]);
        let sum = w[0] + w[1] + w[2];
        w.map(|c| c / sum)
    }
}

/// The values at the corners of a triangle, at hand for its samples.
struct Surface<'a> {
    paint: &'a Paint,
    values: Values,
    /// The size of the texture that suits the triangle.
    size: f32,
    tint: [f32; 3],
    back: bool,
}

impl<'a> Surface<'a> {
    fn new(frame: &Frame<'a>, triangle: &Triangle, plane: &Plane) -> Self {
        let values = frame.scene.surface(triangle);
        let paint = &frame.scene.materials[triangle.material as usize];
        let size = if values.texels > 0.0 { (0.5 * (values.texels / plane.area).max(1e-6).log2()) as f32 } else { 0.0 };
        let tint = match (paint.plain, plane.back) {
            (false, _) => [1.0; 3],
            (true, false) => [0.72, 0.75, 0.81],
            (true, true) => [0.62, 0.33, 0.22],
        };
        Surface { paint, values, size, tint, back: plane.back }
    }

    /// Linear light and alpha before any lamp.
    fn base(&self, w: [f32; 3]) -> [f32; 4] {
        let mut base = self.paint.factor;
        if let Some(c) = &self.values.colours {
            (0..4).for_each(|k| base[k] *= w[0] * c[0][k] + w[1] * c[1][k] + w[2] * c[2][k]);
        }
        if let (Some(t), Some((texture, wrap))) = (&self.values.uvs, self.paint.texture()) {
            let [u, v] = [0, 1].map(|k| w[0] * t[0][k] + w[1] * t[1][k] + w[2] * t[2][k]);
            let value = texture.sample(u, v, self.size, wrap);
            (0..4).for_each(|k| base[k] *= value[k]);
        }
        base
    }

    fn alpha(&self, w: [f32; 3]) -> f32 {
        self.base(w)[3]
    }

    /// Under a bright half of the sky around `lamp`: what a surface gets of it is (1 + cos) / 2, without shadows.
    fn colour(&self, w: [f32; 3], lamp: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = &self.values.normals;
        let n: [f32; 3] = std::array::from_fn(|k| w[0] * a[k] + w[1] * b[k] + w[2] * c[k]);
        let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        let cos = if length > 0.0 { (n[0] * lamp[0] + n[1] * lamp[1] + n[2] * lamp[2]) / length } else { 0.0 };
        // Both sides of a face are seen; a back face is lit as the front of one turned round.
        let sky = 0.5 + 0.5 * if self.back { -cos } else { cos };
        let light = 0.04 + 0.96 * sky * sky;
        let base = self.base(w);
        std::array::from_fn(|k| light * base[k] * self.tint[k])
    }
}

impl Buffer {
    fn plot(&mut self, column: i64, row: i64, depth: f32, id: u32) {
        let row = row - self.first as i64;
        if column >= 0 && column < self.width as i64 && row >= 0 && row < self.rows as i64 {
            let place = row as usize * self.width + column as usize;
            if depth > self.depth[place] {
                self.depth[place] = depth;
                self.id[place] = id;
            }
        }
    }
}
