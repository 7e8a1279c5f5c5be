//! The nearest occupied cells of a cell, however far away, and where a point is expected among them.
//!
//! Where cells are much smaller than the distance between points, the 26 cells around are empty. So each cell keeps
//! [`LINKS`] near ones; on the finer plane they are chosen among the children of the coarser plane's links and the
//! siblings. A plane fitted to them (linear regression of one coordinate on the two others) says where a surface passes.

use super::Cell;

/// Cells that a cell keeps as near ones.
pub(super) const LINKS: usize = 8;

/// No cell.
pub(super) const NONE: u32 = u32::MAX;

/// Links of the children from those of their parents. `place` has the number of each child among `next`, in the order of
/// `cells` and `first`.
pub(super) fn descend(
    cells: &[Cell],
    links: &[[u32; LINKS]],
    place: &[u32],
    next: &[Cell],
    finer: &mut Vec<[u32; LINKS]>,
) {
    finer.clear();
    finer.resize(next.len(), [NONE; LINKS]);
    let children = |c: &Cell| &place[c.first as usize..][..c.mask.count_ones() as usize];
    for (cell, near) in cells.iter().zip(links) {
        for &child in children(cell) {
            let at = next[child as usize].at;
            let mut best = [(u64::MAX, NONE); LINKS];
            let mut offer = |other: u32| {
                let to = next[other as usize].at;
                let distance = (0..3).map(|k| (to[k].abs_diff(at[k]) as u64).pow(2)).sum::<u64>();
                if (distance, other) < best[LINKS - 1] {
                    let mut k = LINKS - 1;
                    while k > 0 && (distance, other) < best[k - 1] {
                        best[k] = best[k - 1];
                        k -= 1;
                    }
                    best[k] = (distance, other);
                }
            };
            children(cell).iter().filter(|&&c| c != child).for_each(|&c| offer(c));
            for &link in near.iter().take_while(|&&l| l != NONE) {
                children(&cells[link as usize]).iter().for_each(|&c| offer(c));
            }
            finer[child as usize] = best.map(|(_, c)| c);
        }
    }
}

/// Sums over the links of a cell, in units of 1/16 of its side from its middle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fit {
    n: i64,
    sum: [i64; 3],
    /// Of the products xx, xy, xz, yy, yz, zz, as `n · Σ ab − Σa · Σb`.
    product: [i64; 6],
    /// For each axis: how many links that are split already and have the cell's coordinate hold points in their lower
    /// and in their higher half. Points of a lattice or of a scan line agree.
    pub(super) votes: [[usize; 2]; 3],
}

/// Offsets of links are cut to this, so that products of two sums of products fit.
const FAR: i64 = 1 << 14;

/// `[a][b]`: the place of the product ab.
const PRODUCT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

impl Fit {
    /// Sum up the links of cell `i`; those before it in the list are known by their children.
    #[allow(clippy::needless_range_loop)]
    pub(super) fn new(cells: &[Cell], near: &[u32; LINKS], i: usize) -> Self {
        let at = cells[i].at;
        let mut fit = Fit::default();
        let mut products = [0i64; 6];
        for &link in near.iter().take_while(|&&l| l != NONE) {
            let other = &cells[link as usize];
            let mut d: [i64; 3] = std::array::from_fn(|k| 16 * (other.at[k] as i64 - at[k] as i64));
            if (link as usize) < i {
                let all = other.mask.count_ones() as i64;
                for (k, high) in [0xf0u8, 0xcc, 0xaa].into_iter().enumerate() {
                    let high = (other.mask & high).count_ones() as i64;
                    d[k] += 4 * (2 * high - all) / all;
                    if other.at[k] == at[k] {
                        fit.votes[k][0] += (high < all) as usize;
                        fit.votes[k][1] += (high > 0) as usize;
                    }
                }
            }
            let d = d.map(|c| c.clamp(-FAR, FAR));
            fit.n += 1;
            for a in 0..3 {
                fit.sum[a] += d[a];
                for b in a..3 {
                    products[PRODUCT[a][b]] += d[a] * d[b];
                }
            }
        }
        for a in 0..3 {
            for b in a..3 {
                let k = PRODUCT[a][b];
                fit.product[k] = fit.n * products[k] - fit.sum[a] * fit.sum[b];
            }
        }
        fit
    }

    /// Where the coordinate `axis` is expected of a point whose two others are those of `at`, and the variance of that.
    pub(super) fn expect(&self, axis: usize, at: [i64; 3]) -> Option<(i64, i64)> {
        if self.n < 2 {
            return None;
        }
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let s = |a: usize, b: usize| self.product[PRODUCT[a][b]];
        // A ridge that stands for the extent of the cells themselves.
        let ridge = self.n * self.n * 8;
        let (uu, vv, uv) = (s(u, u) + ridge, s(v, v) + ridge, s(u, v));
        let (au, av) = (s(axis, u), s(axis, v));
        let det = uu as i128 * vv as i128 - uv as i128 * uv as i128;
        let alpha = au as i128 * vv as i128 - av as i128 * uv as i128;
        let beta = av as i128 * uu as i128 - au as i128 * uv as i128;
        // Down to 40 bits, then slopes with 12 fractional bits.
        let shift = (128 - det.leading_zeros()).saturating_sub(40);
        let det = ((det >> shift) as i64).max(1);
        let slope = |n: i128| (((n >> shift).clamp(-(1 << 46), 1 << 46) as i64) << 12) / det;
        let (alpha, beta) = (slope(alpha), slope(beta));
        let rest = |k: usize| self.n * at[k] - self.sum[k];
        let expected =
            self.sum[axis] as i128 + ((alpha as i128 * rest(u) as i128 + beta as i128 * rest(v) as i128) >> 12);
        let explained = (alpha as i128 * au as i128 + beta as i128 * av as i128) >> 12;
        let variance = (s(axis, axis) as i128 - explained).clamp(0, 1 << 50) as i64;
        Some((expected.clamp(-(1 << 50), 1 << 50) as i64 / self.n, variance / (self.n * self.n)))
    }
}

/// The class of an expected place: 0..21, 10 for the middle.
pub(super) fn place_class(expected: i64) -> usize {
    let class = match expected.unsigned_abs() {
        0 => 0,
        1 => 1,
        2 => 2,
        3..=4 => 3,
        5..=6 => 4,
        7..=9 => 5,
        10..=14 => 6,
        15..=22 => 7,
        23..=40 => 8,
        41..=90 => 9,
        _ => 10,
    };
    if expected < 0 { 10 - class } else { 10 + class }
}

/// The class of a variance: 0..14.
pub(super) fn spread_class(variance: i64) -> usize {
    (64 - (variance / 2).leading_zeros() as usize).min(13)
}
