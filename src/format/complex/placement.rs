//! Where a merged vertex lies, in integers that both directions repeat.
//!
//! The midpoint of its children, with alternating rounding so that it does not drift, plus a curvature
//! compensation that depends on the ring alone (`docs/design/operator.md`: midpoints shrink a convex surface; half the
//! sagitta that the ring predicts, times `alpha`, puts it back).

use super::{Level, Star};

/// Lower bound of a midpoint and back. `bias` is 0 or 1.
#[inline]
pub fn midpoint(p1: [i32; 3], p2: [i32; 3], bias: i32) -> [i32; 3] {
    std::array::from_fn(|k| (p1[k] + p2[k] + bias) >> 1)
}

/// The children of `v` whose difference is `delta`: the inverse of [`midpoint`].
///
/// The parity of the sum is that of the difference, so nothing else is needed. Wraps instead of overflowing, for
/// hostile streams; the caller checks the range of the result.
#[inline]
pub fn children(v: [i32; 3], delta: [i32; 3], bias: i32) -> ([i32; 3], [i32; 3]) {
    let p1: [i32; 3] = std::array::from_fn(|k| {
        let sum = v[k].wrapping_mul(2).wrapping_sub(bias).wrapping_add(delta[k].wrapping_add(bias) & 1);
        sum.wrapping_add(delta[k]) >> 1
    });
    (p1, std::array::from_fn(|k| p1[k].wrapping_sub(delta[k])))
}

/// `⌊√(i · 2^48)⌋`.
const ROOTS: [u32; 258] = {
    let mut t = [0u32; 258];
    let mut i = 1;
    while i < 258 {
        t[i] = ((i as u64) << 48).isqrt() as u32;
        i += 1;
    }
    t
};

/// A square root to about 16 bits, never above the true one by more than that: the table of `√i`, interpolated
/// linearly. Exactness is not needed where both directions take the same value.
#[inline(always)]
pub fn root(x: u64) -> u64 {
    let k = (x | 1).leading_zeros() & !1;
    let m = x << k;
    let i = (m >> 56) as usize;
    let f = (m >> 40 & 0xffff) as i64;
    let (lo, hi) = (ROOTS[i] as i64, ROOTS[i + 1] as i64);
    (((lo + ((hi - lo) * f >> 16)) << 4) >> (k / 2)) as u64
}

/// A vector scaled to length 2^14, about. Zero stays zero.
#[inline(always)]
pub fn unit(v: [i64; 3]) -> [i64; 3] {
    let m = v[0].unsigned_abs() | v[1].unsigned_abs() | v[2].unsigned_abs() | 1;
    // To 20 bits, so that squares and products with the reciprocal fit.
    let lead = m.leading_zeros() as i32;
    let s: [i64; 3] = if lead < 44 { v.map(|c| c >> (44 - lead)) } else { v.map(|c| c << (lead - 44)) };
    let len = root((s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) as u64);
    let inverse = (1i64 << 40) / (len as i64).max(1);
    s.map(|c| c * inverse >> 26)
}

/// Cross product.
#[inline]
pub fn cross(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Dot product.
#[inline]
pub fn dot(a: [i64; 3], b: [i64; 3]) -> i64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a − b` in 64 bits.
#[inline]
pub fn sub(a: [i32; 3], b: [i32; 3]) -> [i64; 3] {
    std::array::from_fn(|k| a[k] as i64 - b[k] as i64)
}

/// What curvature compensation adds to the midpoint at `v`: `alpha/256 · o · N`.
///
/// `o` is the mean over the ring of `(r − c)·n_r`, with `c` the ring's centroid and `n_r` the unit normal at `r` from its
/// elements of at most 64 corners that name no vertex of `merged`; `N` is the direction of the mean normal. `level` is the coarser level, in which `v` stands
/// for both children; nothing here depends on where `v` lies.
pub fn compensation(level: &Level, star: &Star, merged: &[bool], v: u32, alpha: u8) -> [i32; 3] {
    if alpha == 0 {
        return [0; 3];
    }
    let p = &level.positions;
    let mut sum = [0i64; 3];
    let mut n = 0i64;
    for &f in star.get(v) {
        let c = level.faces.get(f);
        if c.len() < 3 {
            continue;
        }
        let at = c.iter().position(|&x| x == v).unwrap_or(0);
        let next = p[c[(at + 1) % c.len()] as usize];
        for k in 0..3 {
            sum[k] += next[k] as i64;
        }
        n += 1;
    }
    if !(3..=64).contains(&n) {
        return [0; 3];
    }
    let (mut total, mut normal) = (0i64, [0i64; 3]);
    for &f in star.get(v) {
        let c = level.faces.get(f);
        if c.len() < 3 {
            continue;
        }
        let at = c.iter().position(|&x| x == v).unwrap_or(0);
        let r = c[(at + 1) % c.len()];
        let mut area = [0i64; 3];
        // All of its elements or none: the order of elements is not the same in both directions.
        let around = if star.get(r).len() > 64 { &[] } else { star.get(r) };
        for &g in around {
            let d = level.faces.get(g);
            // Looking through large elements from every corner would cost the square of their size.
            if !(3..=64).contains(&d.len()) || d.iter().any(|&x| merged[x as usize]) {
                continue;
            }
            let at = d.iter().position(|&x| x == r).unwrap_or(0);
            let (next, prev) = (d[(at + 1) % d.len()], d[(at + d.len() - 1) % d.len()]);
            let x = cross(sub(p[next as usize], p[r as usize]), sub(p[prev as usize], p[r as usize]));
            for k in 0..3 {
                area[k] += x[k];
            }
        }
        let u = unit(area);
        // n·(r − c), times n: 2^14 · 2^26 · 2^6 stays far below 2^63.
        let q = p[r as usize];
        let from_centroid: [i64; 3] = std::array::from_fn(|k| q[k] as i64 * n - sum[k]);
        total += dot(from_centroid, u);
        for k in 0..3 {
            normal[k] += u[k];
        }
    }
    let direction = unit(normal);
    // total / (n·n) is o in 2^14ths of a step.
    let o = total / (n * n) * alpha as i64 / 256;
    std::array::from_fn(|k| ((o * direction[k] + (1 << 27)) >> 28) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn children_invert_midpoint(a in prop::array::uniform3(-(1i32 << 25)..1 << 25), b in prop::array::uniform3(-(1i32 << 25)..1 << 25), bias in 0..2) {
            let v = midpoint(a, b, bias);
            let delta = std::array::from_fn(|k| a[k] - b[k]);
            prop_assert_eq!(children(v, delta, bias), (a, b));
        }

        #[test]
        fn units_have_unit_length(v in prop::array::uniform3(-(1i64 << 59)..1 << 59)) {
            let u = unit(v);
            let len = ((u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) as f64).sqrt();
            prop_assert!(v == [0; 3] || (len - 16384.0).abs() < 6.0, "{len}");
        }
    }
}
