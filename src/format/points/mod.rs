//! Unordered multisets of integer points: base vertices, new vertices and isolated vertices.
//!
//! The canonical order is the lexicographic one of `(x, y, z)`; equal points stand side by side. The box of the points is
//! coded, then they are located in it:
//! * up to [`SMALL`] points by halving the box: how many of the points lie in the lower half is binomially distributed, and
//!   nothing is learned (Gandoin and Devillers 2002 with an exact prior), so that a handful of points costs what its
//!   entropy is;
//! * more of them by an octree, plane of bits by plane of bits, whose decisions are mixed from contexts of
//!   the cells around (`tree`).
//!
//! Invariants: a decoder yields exactly the number of points asked for, each inside the box, whatever the bytes are; it
//! allocates in proportion to that number, and needs no recursion.

mod halving;
mod tree;

use crate::format::coder::range::Coder;

/// Coordinates of points are within ±`POINT_LIMIT`.
pub const POINT_LIMIT: i32 = 1 << 25;

/// The largest number of points that is coded without adaptive models.
pub const SMALL: usize = 24;

/// The numbers of `points` in canonical order: `order[new] = old`; equal points keep their order.
pub fn canonical_order(points: &[[i32; 3]]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_unstable_by_key(|&k| (points[k as usize], k));
    order
}

/// Code `count` points, fewer than 2^32.
///
/// An encoder reads `points`, which holds `count` points in any order, each coordinate within ±[`POINT_LIMIT`], and leaves
/// them in canonical order. A decoder replaces what is in `points`. The count itself is not coded: the caller has it, and
/// has checked it against what it is ready to allocate (about 200 bytes a point while coding).
pub fn code_points<C: Coder>(coder: &mut C, points: &mut Vec<[i32; 3]>, count: usize) {
    if count == 0 {
        points.clear();
        return;
    }
    // A cube from the origin with a power of two as its side, mirrored to the negative side where that is in use.
    let (mut bits, mut negative) = (0, false);
    if !C::DECODING {
        for &c in points.iter().flatten() {
            bits = bits.max(32 - (if c < 0 { !c } else { c }).leading_zeros());
            negative |= c < 0;
        }
    }
    let bits = coder.uniform(27, bits.min(26));
    let negative = coder.uniform(2, negative as u32) == 1;
    let hi = ((1i64 << bits) - 1).min(POINT_LIMIT as i64) as i32;
    let lo = if negative { (-hi - 1).max(-POINT_LIMIT) } else { 0 };
    code_points_in_box(coder, [lo; 3], [hi; 3], points, count);
}

/// Code `count` points of a box that both sides know, `lo` and `hi` inclusive; see [`code_points`].
///
/// An encoder's points have to lie in the box. Bounds outside ±[`POINT_LIMIT`] are moved there, and an axis with `hi < lo`
/// counts as `hi = lo`.
pub fn code_points_in_box<C: Coder>(
    coder: &mut C,
    lo: [i32; 3],
    hi: [i32; 3],
    points: &mut Vec<[i32; 3]>,
    count: usize,
) {
    if C::DECODING {
        points.clear();
    } else {
        debug_assert_eq!(points.len(), count);
        debug_assert!(points.iter().all(|p| (0..3).all(|k| lo[k] <= p[k] && p[k] <= hi[k])));
        points.sort_unstable();
    }
    if count == 0 {
        return;
    }
    let (mut origin, mut size) = ([0i32; 3], [0u32; 3]);
    for k in 0..3 {
        let a = lo[k].clamp(-POINT_LIMIT, POINT_LIMIT);
        let b = hi[k].clamp(-POINT_LIMIT, POINT_LIMIT).max(a);
        let width = (b - a) as u32 + 1;
        let (mut from, mut to) = (0, width - 1);
        if !C::DECODING {
            from = points.iter().map(|p| (p[k] - a) as u32).min().unwrap_or(0);
            to = points.iter().map(|p| (p[k] - a) as u32).max().unwrap_or(0);
        }
        // Narrow the box where that takes less than it saves.
        let spent = 1 + 2 * (32 - width.leading_zeros());
        let saved = log2_tenths(width) - log2_tenths(to - from + 1);
        let narrow = width > 1 && coder.uniform(2, (saved as u64 * count as u64 > 10 * spent as u64) as u32) == 1;
        if narrow {
            from = coder.uniform(width, from);
            to = from + coder.uniform(width - from, to.wrapping_sub(from));
        } else {
            (from, to) = (0, width - 1);
        }
        (origin[k], size[k]) = (a + from as i32, to - from + 1);
    }
    let mut local: Vec<[u32; 3]> = Vec::new();
    if !C::DECODING {
        local.extend(points.iter().map(|p| std::array::from_fn(|k| (p[k] - origin[k]) as u32)));
    }
    if count <= SMALL {
        halving::code(coder, size, &mut local, count);
        local.sort_unstable();
    } else {
        tree::code(coder, size, &mut local, count);
    }
    if C::DECODING {
        points.extend(local.iter().map(|p| -> [i32; 3] { std::array::from_fn(|k| origin[k] + p[k] as i32) }));
    }
}

/// About `10 * log2(v)`, for the encoder's choice of boxes; `v ≥ 1`.
fn log2_tenths(v: u32) -> u32 {
    let whole = 31 - v.leading_zeros();
    let part = (((v as u64) << 16 >> whole) - 65536) as u32;
    10 * whole + part * 10 / 65536
}

#[cfg(test)]
mod tests;
