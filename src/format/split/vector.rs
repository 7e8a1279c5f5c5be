//! Where the children of a split lie: the difference `v1 − v2`, coordinate by coordinate.
//!
//! `docs/design/codec.md`: the prediction is a fraction of the difference of the two sides' centroids, its covariance
//! has axes along the local frame (tangent, lateral, normal), and x, then y given x, then z given both are coded with
//! their conditional means and deviations. The fraction and the deviations follow what was seen, in fixed point.

use crate::format::coder::density::{Density, MIN_SPREAD, Q};
use crate::format::coder::range::Coder;
use crate::format::complex::placement::{cross, dot, root, sub, unit};
use crate::format::complex::{Side, Split};
use crate::format::split::neighbourhood::{Neighbourhood, length};

const SIZES: usize = 40;
const SHAPES: usize = 24;

/// Mean absolute residual over the mean edge, in 1/65536, in a context, and how often the context was seen.
#[derive(Clone, Copy, Debug)]
struct Ratio {
    mean: u32,
    seen: u32,
}

/// Adaptive models of geometry.
#[derive(Clone, Debug)]
pub struct VectorModels {
    ratio: [[[Ratio; SHAPES]; SIZES]; 3],
    overall: [u32; 3],
    /// Sums for the fraction of the centroid difference.
    along: i64,
    square: i64,
    density: [[Density; 3]; 3],
}

impl Default for VectorModels {
    fn default() -> Self {
        VectorModels {
            ratio: [[[Ratio { mean: 0, seen: 0 }; SHAPES]; SIZES]; 3],
            overall: [12000, 12000, 5000],
            along: 45 << 8,
            square: 100 << 8,
            density: Default::default(),
        }
    }
}

/// The difference of the centroids of the two sides, in 1/256 step.
fn centroid_gap(view_positions: &[[i32; 3]], patch: &Neighbourhood, split: &Split) -> [i64; 3] {
    let mut sum = [[0i64; 3]; 2];
    let mut n = [0i64; 2];
    let mut add = |child: usize, x: u32| {
        let r = sub(view_positions[x as usize], patch.at);
        for k in 0..3 {
            sum[child][k] += r[k];
        }
        n[child] += 1;
    };
    for s in &patch.around.spokes {
        let (of_prev, of_next) = match split.sides[s.place as usize] {
            Side::One => (0, 0),
            Side::Two => (1, 1),
            Side::Grow12 => (0, 1),
            Side::Grow21 => (1, 0),
        };
        add(of_prev, s.prev);
        add(of_next, s.next);
    }
    for t in &split.triangles {
        add(0, t.apex);
        add(1, t.apex);
    }
    std::array::from_fn(|k| sum[0][k] * Q / n[0].max(1) - sum[1][k] * Q / n[1].max(1))
}

/// Some unit vector across `n`.
fn across(n: [i64; 3]) -> [i64; 3] {
    let axis = if n[0].abs() <= n[1].abs().min(n[2].abs()) {
        [1 << 14, 0, 0]
    } else if n[1].abs() <= n[2].abs() {
        [0, 1 << 14, 0]
    } else {
        [0, 0, 1 << 14]
    };
    unit(cross(n, axis))
}

/// `2 log2`, from the leading bit and the one below it.
#[inline]
pub fn half_octaves(x: i64) -> usize {
    let b = 63 - (x.max(1) as u64).leading_zeros() as usize;
    2 * b + if b > 0 { (x >> (b - 1)) as usize & 1 } else { 0 }
}

/// Code `v1 − v2` of a split whose connectivity is known.
pub fn code_delta<C: Coder>(
    coder: &mut C,
    m: &mut VectorModels,
    positions: &[[i32; 3]],
    patch: &Neighbourhood,
    split: &Split,
    delta: [i32; 3],
) -> [i32; 3] {
    let gap = centroid_gap(positions, patch, split);
    let mut n = patch.normal;
    if n == [0; 3] {
        n = across(unit(gap));
        if n == [0; 3] {
            n = [0, 0, 1 << 14];
        }
    }
    let lift = dot(gap, n) >> 14;
    let flat: [i64; 3] = std::array::from_fn(|k| gap[k] - (lift * n[k] >> 14));
    let mut t = unit(flat);
    if t == [0; 3] {
        t = across(n);
    }
    let l = cross(n, t).map(|c| c >> 14);
    let reach = length(flat.map(|c| c / Q)).max(1);

    // The prediction.
    let fraction = (m.along << 12) / m.square.max(1);
    let mu: [i64; 3] = std::array::from_fn(|k| flat[k] * fraction >> 12);

    // The spreads along the frame.
    let size = half_octaves(patch.mean >> 5).min(SIZES - 1);
    let flatness = patch.flatness().min(5);
    let open = (patch.around.shape != crate::format::split::fan::Shape::Closed) as usize;
    let wide = match (reach << 4) / patch.mean {
        0..=11 => 0,
        12..=19 => 1,
        20..=27 => 2,
        _ => 3,
    };
    let shape = [wide + 4 * flatness, wide + 4 * flatness, flatness * 4 + open];
    let mut spread = [0i64; 3];
    for a in 0..3 {
        let r = &m.ratio[a][size][shape[a]];
        let mean = (r.mean as u64 * r.seen.min(30) as u64 + 4 * m.overall[a] as u64) / (r.seen.min(30) as u64 + 4);
        // Mean absolute residual to standard deviation; plus the rounding of the lattice.
        spread[a] = ((mean as i64 * patch.mean >> 16) * 5 / 4 + 40).min(1 << 26);
    }
    // Covariance, with 4 bits of spread dropped where it is wide so that squares stay small.
    let drop = (64 - (spread[0].max(spread[1]).max(spread[2]) as u64).leading_zeros()).saturating_sub(20);
    let axis = |v: [i64; 3], s: i64| v.map(|c| (s >> drop) * c >> 12);
    let (a, b, c) = (axis(t, spread[0]), axis(l, spread[1]), axis(n, spread[2]));
    let sigma = |i: usize, j: usize| (a[i] * a[j] + b[i] * b[j] + c[i] * c[j]) >> 4;
    let deviation = |v: i64| (root(v.max(0) as u64) as i64) << drop;
    let out = |coder: &mut C, m: &mut VectorModels, k: usize, mu: i64, s: i64| {
        let s = s.max(MIN_SPREAD);
        let class = if s < Q {
            0
        } else if s < 4 * Q {
            1
        } else {
            2
        };
        m.density[k][class].code(coder, mu, s, delta[k])
    };
    let xx = sigma(0, 0).max(1);
    let (xy, xz) = (sigma(0, 1), sigma(0, 2));
    let dx = out(coder, m, 0, mu[0], deviation(xx));
    let ex = (dx as i64 * Q - mu[0]).clamp(-(1 << 34), 1 << 34);
    let steep = |rise: i64, run: i64| ((rise << 12) / run).clamp(-(1 << 24), 1 << 24);
    let (slope_y, slope_z) = (steep(xy, xx), steep(xz, xx));
    let yy = (sigma(1, 1) - (slope_y.saturating_mul(xy) >> 12)).max(1);
    let yz = sigma(1, 2) - (slope_y.saturating_mul(xz) >> 12);
    let dy = out(coder, m, 1, mu[1] + (slope_y * ex >> 12), deviation(yy));
    let ey = (dy as i64 * Q - mu[1] - (slope_y * ex >> 12)).clamp(-(1 << 34), 1 << 34);
    let slope = steep(yz, yy);
    let zz = (sigma(2, 2) - (slope_z.saturating_mul(xz) >> 12) - (slope.saturating_mul(yz) >> 12)).max(1);
    let dz = out(coder, m, 2, mu[2] + (slope_z * ex >> 12) + (slope * ey >> 12), deviation(zz));
    let delta = [dx, dy, dz];

    // Follow what was seen.
    let e: [i64; 3] = std::array::from_fn(|k| (delta[k] as i64 * Q - mu[k]).clamp(-(1 << 36), 1 << 36));
    for (a, v) in [t, l, n].into_iter().enumerate() {
        let size_ratio = (((dot(e, v) >> 14).abs() << 16) / patch.mean).min(1 << 19) as u32;
        let r = &mut m.ratio[a][size][shape[a]];
        r.seen += 1;
        let rate = r.seen.min(80) as i64 + 1;
        r.mean = (r.mean as i64 + (size_ratio as i64 - r.mean as i64) / rate) as u32;
        if r.seen >= 60_000 {
            r.seen = 60_000;
        }
        let o = &mut m.overall[a];
        *o = (*o as i64 + ((size_ratio as i64 - *o as i64) >> 6)) as u32;
    }
    if reach < 1 << 24 {
        let seen = dot(delta.map(|c| c as i64), t).clamp(-(1 << 40), 1 << 40) >> 6;
        // In units of the mean edge, so that no single split rules.
        let scaled = |length: i64| ((length << 8) / patch.mean).clamp(-(1 << 16), 1 << 16);
        let (x, y) = (scaled(seen), scaled(reach));
        m.along += ((x * y) >> 6) - (m.along >> 8);
        m.square += ((y * y) >> 6) - (m.square >> 8);
        m.along = m.along.clamp(0, m.square);
    }
    delta
}
