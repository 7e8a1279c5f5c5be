//! The values of wedges: what the children of a split have where their parent had one value.
//!
//! Core paper section 5.4 predicts texture coordinates by the similarity between the patch in space and its image in texture space (its Figure 8).
//! Here a linear map from the tangent plane to the values is fitted to the corners around (least squares, which follows stretch and shear too);
//! along the difference of the children it says how much the values differ. How well it fits around says how far to trust it. The same serves
//! normals, colours and scalars: a learned fraction shrinks the prediction where it does not help.

use super::super::density::{Density, MIN_SPREAD, Q};
use super::super::patch::{Patch, length};
use super::super::range::{Bit, Coder};
use super::super::spread::half_octaves;
use super::Spoke;
use crate::complex::Wedges;
use crate::complex::placement::{cross, dot, root, unit};
use crate::mesh::MAX_WIDTH;

/// Values stay within ±`VALUE_LIMIT`.
pub const VALUE_LIMIT: i32 = 1 << 26;
/// Components of a value, at most.
pub const WIDTH: usize = MAX_WIDTH as usize;
/// A value; components beyond the width are 0.
pub type Value = [i32; WIDTH];

const SIZES: usize = 48;
const SHAPES: usize = 8;
/// Spokes looked at.
const LOOK: usize = 64;

/// Mean absolute residual over what the fit suggests, in 1/4096, in a context, and how often the context was seen.
#[derive(Clone, Copy, Debug, Default)]
struct Ratio {
    mean: u32,
    seen: u32,
}

impl Ratio {
    /// The spread to expect where a fit is rough by `rough`.
    fn spread(&self, overall: u32, rough: i64) -> i64 {
        let seen = self.seen.min(30) as u64;
        let mean = ((self.mean as u64 * seen + 4 * overall as u64) / (seen + 4)) as i64;
        ((mean * rough >> 12) * 5 / 4 + 40).clamp(MIN_SPREAD, 1 << 32)
    }

    fn learn(&mut self, overall: &mut u32, error: i64, rough: i64) {
        let ratio = ((error.abs() << 12) / rough).min(1 << 20);
        self.seen = (self.seen + 1).min(60_000);
        self.mean = (self.mean as i64 + (ratio - self.mean as i64) / (self.seen.min(80) as i64 + 1)) as u32;
        *overall = (*overall as i64 + ((ratio - *overall as i64) >> 6)) as u32;
    }
}

/// What a value that no fit suggests is told from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Far {
    /// The last value told so: a chart that begins.
    Last,
    /// A value at the other end of an edge.
    Edge,
    /// The third corner of a triangle in the shape that it has in space.
    Corner,
    /// Another value of the same vertex.
    Same,
}

const KINDS: usize = 4;

/// Models of one component.
#[derive(Clone, Debug)]
struct Component {
    ratio: [[Ratio; SHAPES]; SIZES],
    overall: u32,
    /// Sums for the fraction of the prediction.
    along: i64,
    square: i64,
    /// Sums for what the component before says about this one.
    cross: i64,
    cross_square: i64,
    density: [Density; 3],
    /// Values at an apex, by how well a fit suggests them.
    reach: [Ratio; SIZES],
    reach_overall: u32,
    reach_density: Density,
    far: [Density; KINDS],
    far_mean: [i64; KINDS],
}

impl Default for Component {
    fn default() -> Self {
        Component {
            ratio: [[Ratio::default(); SHAPES]; SIZES],
            overall: 1500,
            along: 62 << 8,
            square: 64 << 8,
            cross: 0,
            cross_square: 1 << 16,
            density: Default::default(),
            reach: [Ratio::default(); SIZES],
            reach_overall: 3000,
            reach_density: Density::default(),
            far: Default::default(),
            far_mean: [64 << 8; KINDS],
        }
    }
}

/// Adaptive models of the values of one layer.
#[derive(Clone, Debug)]
pub struct ValueModels {
    component: Vec<Component>,
    still: [Bit; 2],
    /// The value that was last told from afar.
    pub last: Value,
}

impl ValueModels {
    /// Models for values of `width` components.
    pub fn new(width: usize) -> Self {
        ValueModels { component: vec![Component::default(); width], still: [Bit::with(60000); 2], last: [0; WIDTH] }
    }
}

/// The tangent plane of a split, shared by its layers: along the difference of the children, and across.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame {
    /// The difference of the children.
    pub delta: [i32; 3],
    along: [i64; 3],
    across: [i64; 3],
    /// How far the children are apart in the plane, in 1/64 mean edge.
    apart: i64,
    /// 2^40 over the mean edge.
    inverse: i64,
    wide: usize,
}

impl Frame {
    /// The frame of a split whose children differ by `delta`.
    pub fn new(patch: &Patch, delta: [i32; 3]) -> Self {
        let d = delta.map(|c| c as i64);
        let n = patch.normal;
        let lift = dot(d, n) >> 14;
        let flat: [i64; 3] = std::array::from_fn(|k| (d[k] << 8) - (lift * n[k] >> 6));
        let mut along = unit(flat);
        if along == [0; 3] {
            along = unit(if n[0].abs() < n[1].abs() { cross(n, [1 << 14, 0, 0]) } else { cross(n, [0, 1 << 14, 0]) });
        }
        let inverse = (1i64 << 40) / patch.mean.max(1);
        let fine = flat.iter().all(|c| c.abs() < 1 << 26);
        let reach = if fine { length(flat) >> 8 } else { length(flat.map(|c| c >> 8)) }.min(32 * patch.mean);
        let wide = match (reach << 4) / patch.mean {
            0..=11 => 0,
            12..=19 => 1,
            20..=27 => 2,
            _ => 3,
        };
        Frame { delta, along, across: cross(n, along).map(|c| c >> 14), apart: reach * inverse >> 34, inverse, wide }
    }

    /// Coordinates of a ring vector in the plane, in 1/64 mean edge, within ±2^11.
    #[inline]
    fn place(&self, r: [i64; 3], mean: i64) -> (i64, i64) {
        let clamp = |x: i64| ((x >> 6).clamp(-32 * mean, 32 * mean) * self.inverse) >> 34;
        (clamp(dot(r, self.along)), clamp(dot(r, self.across)))
    }
}

/// Sums of the least-squares fit of a linear map over the corners of one wedge.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: i64,
    xx: i64,
    xy: i64,
    yy: i64,
    xu: [i64; WIDTH],
    yu: [i64; WIDTH],
    uu: [i64; WIDTH],
}

/// The solution of the normal equations.
struct Fit {
    xx: i128,
    xy: i128,
    yy: i128,
    determinant: i128,
}

impl Fit {
    fn new(s: &Sums) -> Self {
        // A ridge of an eighth of the mean edge, so that few or aligned corners do no harm.
        let ridge = (s.n + 1) << 6;
        let (xx, xy, yy) = ((s.xx + ridge) as i128, s.xy as i128, (s.yy + ridge) as i128);
        Fit { xx, xy, yy, determinant: (xx * yy - xy * xy).max(1) }
    }

    /// The slopes of component `c` along and across, in 1/65536 over 1/64 mean edge, and how rough the fit is: the root mean square residual
    /// in 1/256, plus what rounding alone makes of it.
    fn component(&self, s: &Sums, c: usize) -> (i128, i128, i64) {
        let (xu, yu) = (s.xu[c] as i128, s.yu[c] as i128);
        let along = ((self.yy * xu - self.xy * yu) << 16) / self.determinant;
        let across = ((self.xx * yu - self.xy * xu) << 16) / self.determinant;
        let explained = (along * xu + across * yu) >> 16;
        let rest = (s.uu[c] as i128 - explained).clamp(0, 1 << 54) as u64;
        (along, across, (root((rest / s.n.max(1) as u64) << 8) << 4) as i64 + 64)
    }
}

/// Differences of values enter the fit within ± this, so that sums stay in 64 bits.
const STEEP: i64 = 1 << 24;

/// What one layer sees around the vertex that splits.
#[derive(Clone, Copy)]
pub struct Sight<'a> {
    /// The level's positions, and for each corner its vertex.
    pub positions: &'a [[i32; 3]],
    pub names: &'a [u32],
    /// The layer.
    pub wedges: &'a Wedges,
    /// The vertex, its plane, and the elements around it.
    pub patch: &'a Patch,
    pub frame: &'a Frame,
    pub spokes: &'a [Spoke],
}

impl Sight<'_> {
    /// Sums over the corners around the vertex that see wedge `w`.
    fn gather(&self, w: u32) -> Sums {
        let mut s = Sums::default();
        let wedges = self.wedges;
        let width = wedges.width;
        let own = wedges.value(w);
        let mut add = |corner: u32| {
            let at = self.positions[self.names[corner as usize] as usize];
            let r: [i64; 3] = std::array::from_fn(|k| at[k] as i64 - self.patch.at[k] as i64);
            let (x, y) = self.frame.place(r, self.patch.mean);
            s.n += 1;
            s.xx += x * x;
            s.xy += x * y;
            s.yy += y * y;
            let value = wedges.value(wedges.corner[corner as usize]);
            for c in 0..width {
                let u = (value[c] as i64 - own[c] as i64).clamp(-STEEP, STEEP);
                s.xu[c] += x * u;
                s.yu[c] += y * u;
                s.uu[c] += u * u;
            }
        };
        for spoke in self.spokes.iter().take(LOOK) {
            if wedges.corner[spoke.own as usize] == w {
                add(spoke.next);
                if spoke.prev != spoke.next {
                    add(spoke.prev);
                }
            }
        }
        s
    }
}

/// Code the difference of the values of a split's children, whose parent has wedge `w`.
pub fn code_pair<C: Coder>(coder: &mut C, m: &mut ValueModels, sight: &Sight, w: u32, difference: Value) -> Value {
    let Sight { wedges, patch, frame, .. } = *sight;
    let width = wedges.width;
    let s = sight.gather(w);
    let open = (patch.around.shape != super::super::around::Shape::Closed) as usize;
    // Where all values around are equal, so are mostly those of the children.
    if s.uu == [0; WIDTH] && coder.bit(&mut m.still[open], difference == [0; WIDTH]) {
        return [0; WIDTH];
    }
    let fit = Fit::new(&s);
    let mut out = [0i32; WIDTH];
    // The residual of the component before, over its spread, in 1/64.
    let mut before = 0i64;
    for c in 0..width {
        let (along, _, rough) = fit.component(&s, c);
        let k = &mut m.component[c];
        let full = (along * frame.apart as i128 >> 8).clamp(-(1 << 33), 1 << 33) as i64;
        let fraction = (k.along << 12) / k.square.max(1);
        let r = &mut k.ratio[half_octaves(rough >> 5).min(SIZES - 1)][frame.wide * 2 + open];
        let spread = r.spread(k.overall, rough);
        let slope = (k.cross << 12) / k.cross_square.max(1);
        let mu = (full * fraction >> 12) + (before * slope * (spread >> 6).max(1) >> 12);
        let class = if spread < Q {
            0
        } else if spread < 4 * Q {
            1
        } else {
            2
        };
        let value = k.density[class].code(coder, mu, spread, difference[c]);
        out[c] = value;

        // Follow what was seen.
        let error = (value as i64 * Q - mu).clamp(-(1 << 36), 1 << 36);
        r.learn(&mut k.overall, error, rough);
        let scale = full.abs().max(rough);
        let scaled = |x: i64| ((x << 8) / scale).clamp(-(1 << 12), 1 << 12);
        let (x, y) = (scaled(value as i64 * Q), scaled(full));
        k.along += ((x * y) >> 4) - (k.along >> 8);
        k.square += ((y * y) >> 4) - (k.square >> 8);
        k.square = k.square.max(1 << 8);
        k.along = k.along.clamp(0, k.square + (k.square >> 2));
        // Against the spread, without what the component before had said.
        let alone = error + (before * slope * (spread >> 6).max(1) >> 12);
        let now = ((alone << 6) / spread).clamp(-512, 512);
        k.cross += ((before * now) >> 2) - (k.cross >> 7);
        k.cross_square += ((before * before) >> 2) - (k.cross_square >> 7);
        k.cross_square = k.cross_square.max(1 << 12);
        k.cross = k.cross.clamp(-k.cross_square, k.cross_square);
        before = now;
    }
    out
}

/// Code the value at a neighbour of the vertex, whose ring vector is `r`, by the fit around wedge `w`.
pub fn code_reach<C: Coder>(
    coder: &mut C,
    m: &mut ValueModels,
    sight: &Sight,
    w: u32,
    r: [i64; 3],
    value: Value,
) -> Value {
    let Sight { wedges, patch, frame, .. } = *sight;
    let s = sight.gather(w);
    let fit = Fit::new(&s);
    let (x, y) = frame.place(r, patch.mean);
    let own = wedges.value(w);
    let mut out = [0i32; WIDTH];
    for c in 0..wedges.width {
        let (along, across, rough) = fit.component(&s, c);
        let mu = ((along * x as i128 + across * y as i128) >> 8).clamp(-(1 << 33), 1 << 33) as i64;
        let k = &mut m.component[c];
        let ratio = &mut k.reach[half_octaves(rough >> 5).min(SIZES - 1)];
        let spread = ratio.spread(k.reach_overall, rough);
        let d = k.reach_density.code(coder, mu, spread, value[c].wrapping_sub(own[c]));
        out[c] = own[c].wrapping_add(d);
        let error = (d as i64 * Q - mu).clamp(-(1 << 36), 1 << 36);
        ratio.learn(&mut k.reach_overall, error, rough);
    }
    out
}

/// Code a value that nothing around predicts well, near `guess`.
pub fn code_far<C: Coder>(coder: &mut C, m: &mut ValueModels, from: Far, guess: Value, value: Value) -> Value {
    let mut out = [0i32; WIDTH];
    let from = from as usize;
    for (c, k) in m.component.iter_mut().enumerate() {
        let spread = (k.far_mean[from] * 5 / 4 + 40).clamp(MIN_SPREAD, 1 << 32);
        let d = k.far[from].code(coder, 0, spread, value[c].wrapping_sub(guess[c]));
        out[c] = guess[c].wrapping_add(d);
        k.far_mean[from] += ((d as i64).abs().min(1 << 26) * Q - k.far_mean[from]) >> 4;
    }
    m.last = out;
    out
}

/// The third corner of a triangle whose image has the shape that it has in space: `e` and `f` lead from the first corner to the second and to the
/// third, `a` and `b` are the values of the first two. Two components turn with the triangle, by a quarter to the left where `left` says so;
/// further ones follow the edge alone.
pub fn similar(e: [i64; 3], f: [i64; 3], a: Value, b: Value, width: usize, left: bool) -> Value {
    let ee = dot(e, e).max(1) as i128;
    let along = ((dot(f, e) as i128) << 12) / ee;
    let n = cross(e, f);
    // |e × f| / |e|², by its largest component and a root of what is left: 24 bits are enough.
    let largest = n.iter().map(|c| c.unsigned_abs()).max().unwrap_or(0);
    let drop = (64 - largest.leading_zeros()).saturating_sub(24);
    let n = n.map(|c| c >> drop);
    let across = ((root((dot(n, n) as u64) << 8) as i128) << (drop + 8)) / ee;
    let limit = |x: i128| x.clamp(-(1 << 20), 1 << 20) as i64;
    let (along, across) = (limit(along), limit(across));
    let d: [i64; WIDTH] = std::array::from_fn(|c| b[c] as i64 - a[c] as i64);
    let mut out = a;
    for c in 0..width {
        let turned = match (width, c) {
            (2, 0) => -d[1],
            (2, 1) => d[0],
            _ => 0,
        };
        let turned = if left { turned } else { -turned };
        let step = (d[c] * along + turned * across) >> 12;
        out[c] = (a[c] as i64 + step).clamp(-(VALUE_LIMIT as i64), VALUE_LIMIT as i64) as i32;
    }
    out
}
