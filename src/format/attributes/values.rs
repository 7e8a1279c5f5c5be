//! The values of wedges: what the children of a split have where their parent had one value.
//!
//! Core paper section 5.4 predicts texture coordinates by the similarity between the patch in space and its image in texture space (its Figure 8).
//! Here a linear map from the tangent plane to the values is fitted to the corners around (least squares, which follows stretch and shear too);
//! along the difference of the children it says how much the values differ. How well it fits around says how far to trust it. The same serves
//! normals, colours and scalars: a learned fraction shrinks the prediction where it does not help.

use super::ElementCorners;
use crate::format::coder::density::{Density, MIN_SPREAD, Q};
use crate::format::coder::range::{Bit, Coder};
use crate::format::complex::Wedges;
use crate::format::complex::placement::{cross, dot, root, unit};
use crate::format::split::fan::Shape;
use crate::format::split::neighbourhood::{Neighbourhood, length};
use crate::format::split::vector::half_octaves;
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

/// Sums for the fraction of what a fit says that is to be believed.
#[derive(Clone, Copy, Debug)]
struct Fraction {
    along: i64,
    square: i64,
}

impl Fraction {
    /// In 1/4096.
    fn get(&self) -> i64 {
        (self.along << 12) / self.square.max(1)
    }

    /// Follow a difference, of which the fit said `full`, both in 1/256, over the larger of `full` and what is rough.
    fn learn(&mut self, value: i64, full: i64, rough: i64) {
        let scale = full.abs().max(rough);
        let scaled = |x: i64| ((x << 8) / scale).clamp(-(1 << 12), 1 << 12);
        let (x, y) = (scaled(value), scaled(full));
        self.along += ((x * y) >> 4) - (self.along >> 8);
        self.square += ((y * y) >> 4) - (self.square >> 8);
        self.square = self.square.max(1 << 8);
        self.along = self.along.clamp(0, self.square + (self.square >> 2));
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
    fraction: [[Fraction; 3]; 2],
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
            fraction: [[Fraction { along: 63 << 8, square: 64 << 8 }; 3]; 2],
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
    /// How far the children are apart in the plane, in 1/4096 mean edge.
    apart: i64,
    /// 2^40 over the mean edge.
    inverse: i64,
    wide: usize,
}

impl Frame {
    /// The frame of a split whose children differ by `delta`.
    pub fn new(patch: &Neighbourhood, delta: [i32; 3]) -> Self {
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
        Frame { delta, along, across: cross(n, along).map(|c| c >> 14), apart: reach * inverse >> 28, inverse, wide }
    }

    /// Coordinates of a ring vector in the plane, in 1/256 mean edge, within ±2^13.
    #[inline]
    fn place(&self, r: [i64; 3], mean: i64) -> (i64, i64) {
        let clamp = |x: i64| ((x >> 6).clamp(-32 * mean, 32 * mean) * self.inverse + (1 << 31)) >> 32;
        (clamp(dot(r, self.along)), clamp(dot(r, self.across)))
    }
}

/// Terms of the fit, in the order in which they are eliminated: `y`, `x²`, `xy`, `y²`, `x`, all of length 256 at a mean edge.
const TERMS: usize = 5;

/// The terms at a place.
#[inline]
fn terms(x: i64, y: i64) -> [i64; TERMS] {
    [y, x * x >> 8, x * y >> 8, y * y >> 8, x]
}

/// Sums of the least-squares fit of a quadratic map, through the vertex itself, over the corners of one wedge.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: i64,
    /// Products of two terms, by the powers of `x` and `y` in them: 20, 11, 02; 30, 21, 12, 03; 40, 31, 22, 13, 04.
    moments: [i64; 12],
    /// Products of the terms with the values.
    values: [[i64; TERMS]; WIDTH],
    uu: [i64; WIDTH],
}

impl Sums {
    /// A corner at `(x, y)` whose value differs by `u`, by component.
    #[inline]
    fn add(&mut self, (x, y): (i64, i64), u: impl Iterator<Item = i64>) {
        let t = terms(x, y);
        let [_, xx, xy, yy, _] = t;
        self.n += 1;
        let products =
            [x * x, x * y, y * y, x * xx, y * xx, x * yy, y * yy, xx * xx, xx * xy, xx * yy, xy * yy, yy * yy];
        for (sum, product) in self.moments.iter_mut().zip(products) {
            *sum += product;
        }
        for ((sums, uu), u) in self.values.iter_mut().zip(&mut self.uu).zip(u) {
            let u = u.clamp(-STEEP, STEEP);
            for (sum, t) in sums.iter_mut().zip(t) {
                *sum += t * u;
            }
            *uu += u * u;
        }
    }
}

/// The normal equations, eliminated: `L D Lᵀ`.
struct Fit {
    /// Below the diagonal, in 1/65536.
    lower: [[i64; TERMS]; TERMS],
    /// `2^62` over each pivot: divisions are slow.
    inverse: [i64; TERMS],
}

#[inline]
fn scaled(a: i64, b: i64) -> i64 {
    (a as i128 * b as i128 >> 16) as i64
}

/// `a` over the pivot of `inverse`, in 1/65536.
#[inline]
fn over(a: i64, inverse: i64) -> i64 {
    (a as i128 * inverse as i128 >> 46) as i64
}

impl Fit {
    fn new(s: &Sums) -> Self {
        let [m20, m11, m02, m30, m21, m12, m03, m40, m31, m22, m13, m04] = s.moments;
        // Ridges, so that few or aligned corners do no harm: 1/1024 of what one edge gives to the linear terms, 1/32 for the others.
        let (linear, square) = ((s.n + 1) << 6, (s.n + 1) << 11);
        let mut m = [
            [m02 + linear, 0, 0, 0, 0],
            [m21, m40 + square, 0, 0, 0],
            [m12, m31, m22 + square, 0, 0],
            [m03, m22, m13, m04 + square, 0],
            [m11, m30, m21, m12, m20 + linear],
        ];
        let mut lower = [[0; TERMS]; TERMS];
        let mut inverse = [0; TERMS];
        for p in 0..TERMS {
            inverse[p] = (1 << 62) / m[p][p].max(1);
            let column: [i64; TERMS] = std::array::from_fn(|i| m[i][p]);
            for i in p + 1..TERMS {
                let l = over(column[i], inverse[p]);
                lower[i][p] = l;
                for j in p + 1..=i {
                    m[i][j] = m[i][j].wrapping_sub(scaled(l, column[j]));
                }
            }
        }
        Fit { lower, inverse }
    }

    /// Forwards through the equations of component `c`: the last of its coefficients, that of `x`, and what stands for the others yet, in 1/65536
    /// over 1/256 mean edge; and how rough the fit is: the root mean square residual in 1/256, plus what rounding alone makes of it.
    fn component(&self, s: &Sums, c: usize) -> ([i64; TERMS], i64) {
        let mut b = s.values[c];
        let mut rest = s.uu[c];
        let mut a = [0; TERMS];
        for p in 0..TERMS {
            a[p] = over(b[p], self.inverse[p]);
            rest = rest.wrapping_sub(scaled(a[p], b[p]));
            for i in p + 1..TERMS {
                b[i] = b[i].wrapping_sub(scaled(self.lower[i][p], b[p]));
            }
        }
        (a, (root((rest.clamp(0, 1 << 54) as u64 / s.n.max(1) as u64) << 8) << 4) as i64 + 64)
    }

    /// Back through them: all coefficients.
    fn coefficients(&self, mut a: [i64; TERMS]) -> [i64; TERMS] {
        for p in (0..TERMS).rev() {
            for i in p + 1..TERMS {
                a[p] = a[p].wrapping_sub(scaled(self.lower[i][p], a[i]));
            }
        }
        a
    }
}

/// Differences of values enter the fit within ± this, so that sums stay in 64 bits.
const STEEP: i64 = 1 << 21;

/// What one layer sees around the vertex that splits.
#[derive(Clone, Copy)]
pub struct LayerNeighbourhood<'a> {
    /// The level's positions, and for each corner its vertex.
    pub positions: &'a [[i32; 3]],
    pub names: &'a [u32],
    /// The layer.
    pub wedges: &'a Wedges,
    /// The vertex, its plane, and the elements around it.
    pub patch: &'a Neighbourhood,
    pub frame: &'a Frame,
    pub spokes: &'a [ElementCorners],
}

impl LayerNeighbourhood<'_> {
    /// Sums over the corners around the vertex that see wedge `w`.
    fn gather(&self, w: u32) -> Sums {
        let mut s = Sums::default();
        let LayerNeighbourhood { wedges, patch, frame, spokes, .. } = *self;
        let own = wedges.value(w);
        let difference = |corner: u32| {
            let value = wedges.value(wedges.corner[corner as usize]);
            value.iter().zip(own).map(|(&a, &b)| a as i64 - b as i64)
        };
        if patch.around.shape == Shape::Closed && spokes.iter().all(|spoke| wedges.corner[spoke.own as usize] == w) {
            // Around a whole fan the next neighbours are all neighbours, whose vectors are known.
            for (spoke, &r) in spokes.iter().zip(&patch.ring) {
                s.add(frame.place(r, patch.mean), difference(spoke.next));
            }
            return s;
        }
        let mut add = |corner: u32| {
            let at = self.positions[self.names[corner as usize] as usize];
            let r = std::array::from_fn(|k| at[k] as i64 - patch.at[k] as i64);
            s.add(frame.place(r, patch.mean), difference(corner));
        };
        for spoke in spokes.iter().take(LOOK).filter(|spoke| wedges.corner[spoke.own as usize] == w) {
            add(spoke.next);
            if spoke.prev != spoke.next {
                add(spoke.prev);
            }
        }
        s
    }
}

/// Code the difference of the values of a split's children, whose parent has wedge `w`.
pub fn code_pair<C: Coder>(
    coder: &mut C,
    m: &mut ValueModels,
    sight: &LayerNeighbourhood,
    w: u32,
    difference: Value,
) -> Value {
    let LayerNeighbourhood { wedges, patch, frame, .. } = *sight;
    let width = wedges.width;
    let s = sight.gather(w);
    let open = (patch.around.shape != Shape::Closed) as usize;
    // Where all values around are equal, so are mostly those of the children.
    if s.uu == [0; WIDTH] && coder.bit(&mut m.still[open], difference == [0; WIDTH]) {
        return [0; WIDTH];
    }
    let fit = Fit::new(&s);
    let mut out = [0i32; WIDTH];
    // The residual of the component before, over its spread, in 1/64.
    let mut before = 0i64;
    for c in 0..width {
        let ([.., slope], rough) = fit.component(&s, c);
        let k = &mut m.component[c];
        let full = (slope as i128 * frame.apart as i128 >> 12).clamp(-(1 << 33), 1 << 33) as i64;
        let trust = if full.abs() < 2 * rough {
            0
        } else if full.abs() < 8 * rough {
            1
        } else {
            2
        };
        let believed = &mut k.fraction[open][trust];
        let fraction = believed.get();
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
        believed.learn(value as i64 * Q, full, rough);
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
    sight: &LayerNeighbourhood,
    w: u32,
    r: [i64; 3],
    value: Value,
) -> Value {
    let LayerNeighbourhood { wedges, patch, frame, .. } = *sight;
    let s = sight.gather(w);
    let fit = Fit::new(&s);
    let (x, y) = frame.place(r, patch.mean);
    let at = terms(x, y);
    let own = wedges.value(w);
    let mut out = [0i32; WIDTH];
    for c in 0..wedges.width {
        let (a, rough) = fit.component(&s, c);
        let sum: i128 = fit.coefficients(a).iter().zip(at).map(|(&a, t)| a as i128 * t as i128).sum();
        let mu = (sum >> 8).clamp(-(1 << 33), 1 << 33) as i64;
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
