//! Many points: an octree, coded plane of bits by plane of bits.
//!
//! A plane's occupied cells stand in lexicographic order with their numbers of points. A cell is split along x, its
//! halves along y, the quarters along z; each split says whether both sides hold points or which one does, and how many
//! lie in the lower one. What predicts a split are the 26 cells around, found by nine pointers that move along the list
//! once: of those before the cell the eight children are known already, of those behind it only that they hold points.
//! Both are gathered in masks of 4×4×4 subcells: the cell's own 2×2×2 and a rim of one around them. Where they are empty,
//! a plane through the nearest cells, however far (`links`), and what points of the same absolute coordinate did so far:
//! scans and distance fields are full of lattices. All predictions are mixed (`mix`).
//!
//! The children are put in lexicographic order by walking each slab and row twice, so that no plane needs sorting, and
//! the last plane's cells are the points in canonical order.

mod links;
mod mix;

use self::links::{Fit, LINKS, NONE};
use self::mix::Mixer;
use crate::format::coder::range::Coder;

/// An occupied cell of the current plane.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// Coordinates in cells.
    at: [u32; 3],
    /// Points in it, ≥ 1.
    count: u32,
    /// Where an encoder's points of it begin.
    start: u32,
    /// Where the numbers of points of its children begin.
    first: u32,
    /// Which children hold points: bit `4 cx + 2 cy + cz`.
    mask: u8,
}

/// The seven splits of a cell, each with the subcells of its two sides as masks of the 4×4×4 window.
struct Split {
    axis: usize,
    /// Rim subcells that touch the lower side by a face, the higher by a face, the lower at all, the higher at all.
    faces: [u64; 2],
    touch: [u64; 2],
}

const fn window(x: usize, y: usize, z: usize) -> u64 {
    1 << (16 * x + 4 * y + z)
}

/// Which subcell of the window child `c` of neighbour `n = 9 (dx + 1) + 3 (dy + 1) + dz + 1` is; 0 outside of it.
const PLACE: [[u64; 8]; 27] = {
    let mut t = [[0u64; 8]; 27];
    let mut n = 0;
    while n < 27 {
        let mut c = 0;
        while c < 8 {
            let (x, y, z) = (2 * (n / 9) + (c >> 2), 2 * (n / 3 % 3) + (c >> 1 & 1), 2 * (n % 3) + (c & 1));
            if x >= 1 && x <= 4 && y >= 1 && y <= 4 && z >= 1 && z <= 4 {
                t[n][c] = window(x - 1, y - 1, z - 1);
            }
            c += 1;
        }
        n += 1;
    }
    t
};

/// All subcells of a neighbour that lie in the window.
const WHOLE: [u64; 27] = {
    let mut t = [0; 27];
    let mut n = 0;
    while n < 27 {
        let mut c = 0;
        while c < 8 {
            t[n] |= PLACE[n][c];
            c += 1;
        }
        n += 1;
    }
    t
};

/// Rim subcells near the block of own subcells `lo..=hi` (window coordinates): with a common face, or at all.
const fn near(lo: [usize; 3], hi: [usize; 3], faces_only: bool) -> u64 {
    let mut mask = 0;
    let mut k = 0;
    while k < 64 {
        let at = [k >> 4, k >> 2 & 3, k & 3];
        let (mut off, mut far, mut own) = (0, false, true);
        let mut a = 0;
        while a < 3 {
            if at[a] < lo[a] || at[a] > hi[a] {
                off += 1;
                far |= at[a] + 1 < lo[a] || at[a] > hi[a] + 1;
            }
            own &= at[a] == 1 || at[a] == 2;
            a += 1;
        }
        if !own && !far && off > 0 && (!faces_only || off == 1) {
            mask |= 1 << k;
        }
        k += 1;
    }
    mask
}

const fn split(axis: usize, x: [usize; 2], y: [usize; 2], z: [usize; 2]) -> Split {
    let (lo, hi) = ([x[0], y[0], z[0]], [x[1], y[1], z[1]]);
    let (mut low_hi, mut high_lo) = (hi, lo);
    low_hi[axis] = 1;
    high_lo[axis] = 2;
    Split {
        axis,
        faces: [near(lo, low_hi, true), near(high_lo, hi, true)],
        touch: [near(lo, low_hi, false), near(high_lo, hi, false)],
    }
}

/// Split 0 along x, 1 and 2 along y in its halves, 3 to 6 along z in the quarters.
static SPLITS: [Split; 7] = [
    split(0, [1, 2], [1, 2], [1, 2]),
    split(1, [1, 1], [1, 2], [1, 2]),
    split(1, [2, 2], [1, 2], [1, 2]),
    split(2, [1, 1], [1, 1], [1, 2]),
    split(2, [1, 1], [2, 2], [1, 2]),
    split(2, [2, 2], [1, 1], [1, 2]),
    split(2, [2, 2], [2, 2], [1, 2]),
];

/// What is known around a cell.
#[derive(Clone, Copy, Debug, Default)]
struct CellNeighbours {
    /// Subcells known to hold points.
    known: u64,
    /// Subcells of cells that hold points and are not yet split.
    open: u64,
    /// Which of the 26 neighbours hold points.
    cells: u32,
}

/// The table whose contexts are absolute coordinates.
const ABSOLUTE: usize = 7;

/// The adaptive models.
struct Models {
    side: Mixer,
    both: Mixer,
    share: Mixer,
    /// Slots for absolute coordinates, less one.
    mask: usize,
}

/// Code `count` points of a box with the given side lengths (each ≥ 1, at most 2^26 + 1); `points` come out in
/// lexicographic order.
pub(super) fn code<C: Coder>(coder: &mut C, size: [u32; 3], points: &mut Vec<[u32; 3]>, count: usize) {
    let depth: [u32; 3] = size.map(|s| 32 - (s - 1).leading_zeros());
    let planes = depth.into_iter().max().unwrap_or(0);
    let mut models = Models::new(count);
    let mut cells = vec![Cell { at: [0; 3], count: count as u32, start: 0, first: 0, mask: 0 }];
    let mut next = Vec::new();
    let mut children: Vec<u32> = Vec::new();
    let mut place: Vec<u32> = Vec::new();
    let (mut links, mut finer) = (vec![[NONE; LINKS]], Vec::new());
    for plane in (0..planes).rev() {
        children.clear();
        models.side.refresh();
        models.both.refresh();
        // The last cell of each axis, in cells of the finer plane.
        let last = size.map(|s| (s - 1) >> plane);
        let mut rows = [0usize; 9];
        for i in 0..cells.len() {
            let around = look_around(&cells, &mut rows, i);
            let fit = Fit::new(&cells, &links[i], i);
            let cell = cells[i];
            let mut counts = [0u32; 8];
            if !C::DECODING {
                let mine = &mut points[cell.start as usize..][..cell.count as usize];
                let octant = |p: &[u32; 3]| (p[0] >> plane & 1) << 2 | (p[1] >> plane & 1) << 1 | p[2] >> plane & 1;
                if mine.len() > 1 {
                    mine.sort_unstable_by_key(octant);
                }
                for p in mine.iter() {
                    counts[octant(p) as usize] += 1;
                }
            }
            cells[i].first = children.len() as u32;
            split_cell(coder, &mut models, &cell, &around, &fit, plane, last, &mut counts);
            for (child, &n) in counts.iter().enumerate() {
                if n > 0 {
                    children.push(n);
                    cells[i].mask |= 1 << child;
                }
            }
        }
        descend(&cells, &children, &mut next, &mut place);
        links::descend(&cells, &links, &place, &next, &mut finer);
        std::mem::swap(&mut cells, &mut next);
        std::mem::swap(&mut links, &mut finer);
    }
    points.clear();
    for cell in &cells {
        points.extend(std::iter::repeat_n(cell.at, cell.count as usize));
    }
}

/// The children of `cells` in lexicographic order; `place` gets the number of each child, parallel to `children`.
fn descend(cells: &[Cell], children: &[u32], next: &mut Vec<Cell>, place: &mut Vec<u32>) {
    next.clear();
    place.clear();
    place.resize(children.len(), 0);
    next.reserve(children.len());
    for slab in cells.chunk_by(|a, b| a.at[0] == b.at[0]) {
        for cx in 0..2u32 {
            for row in slab.chunk_by(|a, b| a.at[1] == b.at[1]) {
                for cy in 0..2u32 {
                    let pair = 4 * cx + 2 * cy;
                    for cell in row {
                        if cell.mask >> pair & 3 == 0 {
                            continue;
                        }
                        let before = (cell.mask & ((1 << pair) - 1)).count_ones();
                        let mut index = cell.first;
                        let mut start = cell.start;
                        for _ in 0..before {
                            start = start.wrapping_add(children[index as usize]);
                            index += 1;
                        }
                        for cz in 0..2u32 {
                            if cell.mask >> (pair + cz) & 1 == 1 {
                                let count = children[index as usize];
                                let at = [2 * cell.at[0] + cx, 2 * cell.at[1] + cy, 2 * cell.at[2] + cz];
                                place[index as usize] = next.len() as u32;
                                next.push(Cell { at, count, start, first: 0, mask: 0 });
                                start = start.wrapping_add(count);
                                index += 1;
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Find the 26 neighbours of cell `i`. `rows` points into the rows beside, and only moves forward as `i` does.
#[inline]
fn look_around(cells: &[Cell], rows: &mut [usize; 9], i: usize) -> CellNeighbours {
    let at = cells[i].at;
    let key = |c: &Cell| ((c.at[0] as u64 + 1) << 32 | (c.at[1] as u64 + 1), c.at[2] as u64 + 1);
    let mut around = CellNeighbours::default();
    for (r, pointer) in rows.iter_mut().enumerate() {
        let row = (at[0] as u64 + r as u64 / 3) << 32 | (at[1] as u64 + r as u64 % 3);
        let from = at[2] as u64;
        while *pointer < cells.len() && key(&cells[*pointer]) < (row, from) {
            *pointer += 1;
        }
        for (k, cell) in cells[*pointer..].iter().take(3).enumerate() {
            let (its_row, z) = key(cell);
            if its_row != row || z > from + 2 {
                break;
            }
            let n = 3 * r + (z - from) as usize;
            if n == 13 {
                continue;
            }
            around.cells |= 1 << n;
            if *pointer + k < i {
                let mut mask = cell.mask;
                while mask != 0 {
                    around.known |= PLACE[n][mask.trailing_zeros() as usize];
                    mask &= mask - 1;
                }
            } else {
                around.open |= WHOLE[n];
            }
        }
    }
    around
}

/// Code the numbers of points of the eight children.
#[allow(clippy::too_many_arguments)]
fn split_cell<C: Coder>(
    coder: &mut C,
    models: &mut Models,
    cell: &Cell,
    around: &CellNeighbours,
    fit: &Fit,
    plane: u32,
    last: [u32; 3],
    counts: &mut [u32; 8],
) {
    let fits: [bool; 3] = std::array::from_fn(|k| 2 * cell.at[k] < last[k]);
    let mut part = [0u32; 7];
    part[0] = cell.count;
    for (s, split) in SPLITS.iter().enumerate() {
        let n = part[s];
        if n == 0 {
            continue;
        }
        // The children of this split's sides, `side << shift` and its successors.
        let (first, width) = match s {
            0 => (0, 4),
            1 | 2 => (4 * (s - 1), 2),
            _ => (2 * (s - 3), 1),
        };
        let low = counts[first..first + width].iter().sum();
        let low = if fits[split.axis] { models.code(coder, s, split, n, low, around, fit, plane, cell.at) } else { n };
        if s < 3 {
            part[2 * s + 1] = low;
            part[2 * s + 2] = n - low;
        } else {
            counts[first] = low;
            counts[first + 1] = n - low;
        }
    }
}

impl Models {
    fn new(count: usize) -> Self {
        let mask = (4 * count.min(1 << 14)).next_power_of_two().max(64) - 1;
        Models {
            mask,
            side: Mixer::new(
                [6 * 6 * 3 * 3 * 3, 8 * 8 * 9 * 3, 7 * 64, 27 * 7, 1 + 21 * 14 * 3, 1 + 63 * 16, 75, 2 * (mask + 1)],
                3 * 8 * 2,
            ),
            both: Mixer::new([8 * 6 * 6 * 9, 8 * 16 * 16, 32 * 27, 7 * 64, 1 + 11 * 14 * 8, 1, 1, mask + 1], 8),
            share: Mixer::new([8 * 64, 16 * 16, 1, 1, 1, 1, 1, 1], 1),
        }
    }

    /// Code how many of `n ≥ 1` points lie on the lower side of a split.
    #[allow(clippy::too_many_arguments)]
    fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        s: usize,
        split: &Split,
        n: u32,
        low: u32,
        around: &CellNeighbours,
        fit: &Fit,
        plane: u32,
        cell_at: [u32; 3],
    ) -> u32 {
        let count = |mask: u64| mask.count_ones() as usize;
        let known_faces = split.faces.map(|m| count(m & around.known));
        let known = split.touch.map(|m| count(m & around.known));
        let open_faces = split.faces.map(|m| count(m & around.open));
        let open = split.touch.map(|m| count(m & around.open));
        let axis = split.axis;
        // A byte, so that its order of bits does not depend on the machine.
        let faces6: u8 = [4, 10, 12, 14, 16, 22]
            .into_iter()
            .enumerate()
            .map(|(k, bit)| ((around.cells >> bit & 1) as u8) << k)
            .sum();
        let own: [i64; 3] = match s {
            0 => [0; 3],
            1 | 2 => [8 * (s as i64 - 1) - 4, 0, 0],
            _ => [8 * ((s as i64 - 3) / 2) - 4, 8 * ((s as i64 - 3) % 2) - 4, 0],
        };
        let expected = fit.expect(axis, own);
        let absolute = hash(&[axis as u32, plane, cell_at[axis]]) as usize & self.mask;
        if n > 1 {
            let class = size_class(n);
            let (a, b) = (known_faces[0].min(5), known_faces[1].min(5));
            let (a, b) = (a.max(b), a.min(b));
            let (c, d) = (open_faces[0].div_ceil(4).min(2), open_faces[1].div_ceil(4).min(2));
            let contexts = [
                ((class * 6 + a) * 6 + b) * 9 + 3 * c.max(d) + c.min(d),
                (class * 16 + count(around.known).min(31) / 2) * 16 + (around.cells.count_ones() as usize).min(15),
                (n.min(31) as usize) * 27 + plane as usize,
                s * 64 + faces6 as usize,
                expected.map_or(0, |(e, v)| {
                    1 + (links::place_class(e).abs_diff(10) * 14 + links::spread_class(v)) * 8 + class
                }),
                0,
                0,
                absolute,
            ];
            let both = self.both.code(coder, contexts, class, low != 0 && low != n);
            if both {
                return 1 + self.share(coder, n - 2, low.wrapping_sub(1));
            }
        }
        // Mirror so that the lower side is the one with more around it.
        let rank = |k: usize| (known_faces[k], open_faces[k], known[k], open[k]);
        let flip = (rank(1) > rank(0)) as usize;
        let (f, g) = (flip, 1 - flip);
        let (mut plane_context, mut ratio_context) = (0, 0);
        if let Some((expected, variance)) = expected {
            let expected = if flip == 1 { -expected } else { expected };
            plane_context = 1 + (links::place_class(expected) * 14 + links::spread_class(variance)) * 3 + axis;
            // Of the normal distribution's argument at the middle, 8 steps to a standard deviation.
            let ratio = (expected * 8 / (variance + 4).isqrt()).clamp(-31, 31) + 31;
            ratio_context = 1 + (ratio as usize * 4 + known_faces[f].min(3)) * 4 + known_faces[g].min(3);
        }
        let contexts = [
            ((((known_faces[f].min(5) * 6) + known_faces[g].min(5)) * 3 + open_faces[f].div_ceil(4).min(2)) * 3
                + open_faces[g].div_ceil(4).min(2))
                * 3
                + axis,
            (((known[f].min(7) * 8) + known[g].min(7)) * 9
                + open[f].div_ceil(4).min(2) * 3
                + open[g].div_ceil(4).min(2))
                * 3
                + axis,
            s * 64 + if flip == 1 { faces6.reverse_bits() >> 2 } else { faces6 } as usize,
            plane as usize * 7 + s,
            plane_context,
            ratio_context,
            (fit.votes[axis][f].min(4) * 5 + fit.votes[axis][g].min(4)) * 3 + axis,
            absolute * 2 + f,
        ];
        let told = self.side.told(ABSOLUTE, contexts[ABSOLUTE]) as usize;
        let set = (axis * 8 + (around.cells.count_ones() as usize).min(7)) * 2 + told;
        let lower = self.side.code(coder, contexts, set, (low != 0) ^ (flip == 1)) ^ (flip == 1);
        if lower { n } else { 0 }
    }

    /// A number within `0..=m` by halving the interval, with models for its first steps.
    fn share<C: Coder>(&mut self, coder: &mut C, m: u32, value: u32) -> u32 {
        let (mut lo, mut hi) = (0u32, m);
        let mut node = 1usize;
        let class = (31 - (m + 1).leading_zeros()).min(7) as usize;
        while lo < hi {
            let mid = lo + (hi - lo) / 2;
            let high = if node < 64 {
                let exact = if m < 16 { m as usize * 16 + node.min(15) } else { 0 };
                self.share.code(coder, [class * 64 + node, exact, 0, 0, 0, 0, 0, 0], 0, value > mid)
            } else {
                coder.uniform(2, (value > mid) as u32) == 1
            };
            if high {
                lo = mid + 1;
            } else {
                hi = mid;
            }
            node = (2 * node + high as usize).min(64);
        }
        lo
    }
}

/// Classes of numbers ≥ 2: 2, 3, 4, 5…6, 7…10, 11…20, 21…60, more.
fn size_class(n: u32) -> usize {
    match n {
        0..=4 => n.saturating_sub(2) as usize,
        5..=6 => 3,
        7..=10 => 4,
        11..=20 => 5,
        21..=60 => 6,
        _ => 7,
    }
}

/// A hash of a few numbers.
fn hash(values: &[u32]) -> u32 {
    values.iter().fold(0u32, |h, &v| (h ^ v).wrapping_mul(0x9e37_79b1).rotate_left(15)).wrapping_mul(0x85eb_ca6b) >> 12
}
