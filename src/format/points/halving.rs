//! A handful of points: halve the box along its longest side; the number of points in the lower half is binomially
//! distributed. A lone point is uniform in what is left.

use super::SMALL;
use crate::format::coder::range::Coder;

/// Code `count ≤ SMALL` points of a box with the given side lengths (each ≥ 1, at most 2^26 + 1).
pub(super) fn code<C: Coder>(coder: &mut C, size: [u32; 3], points: &mut Vec<[u32; 3]>, count: usize) {
    let mut work = std::mem::take(points);
    // Boxes still to be divided: corner, sides, number of points, and where an encoder's points of it begin.
    let mut todo = vec![([0u32; 3], size, count, 0usize)];
    while let Some((lo, size, count, start)) = todo.pop() {
        let axis = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
        if count == 0 {
            continue;
        }
        if count == 1 || size[axis] == 1 {
            let seen = if C::DECODING { lo } else { work[start] };
            let mut p = lo;
            for k in 0..3 {
                if size[k] > 1 {
                    p[k] += coder.uniform(size[k], seen[k].wrapping_sub(lo[k]));
                }
            }
            points.extend(std::iter::repeat_n(p, count));
            continue;
        }
        let half = size[axis] / 2;
        let mut below = 0;
        if !C::DECODING {
            let mine = &mut work[start..start + count];
            mine.sort_unstable_by_key(|p| p[axis]);
            below = mine.partition_point(|p| p[axis] - lo[axis] < half);
        }
        let below = binomial(coder, count, half, size[axis], below);
        let (mut high_lo, mut low_size, mut high_size) = (lo, size, size);
        high_lo[axis] += half;
        low_size[axis] = half;
        high_size[axis] -= half;
        todo.push((high_lo, high_size, count - below, start + below));
        todo.push((lo, low_size, below, start));
    }
}

/// How many of `count` points lie in the lower `part` of `whole`; `whole / 3 ≤ part ≤ whole / 2`.
fn binomial<C: Coder>(coder: &mut C, count: usize, part: u32, whole: u32, value: usize) -> usize {
    let rest = (whole - part) as u128;
    // Probabilities of 2^60; the smallest, (1/3)^24, keeps more than 20 bits.
    let mut p = 1u128 << 60;
    for _ in 0..count {
        p = p * rest / whole as u128;
    }
    let mut freqs = [0u32; SMALL + 1];
    let mut total = 0;
    for (k, freq) in freqs[..=count].iter_mut().enumerate() {
        *freq = (p >> 36) as u32 + 1;
        total += *freq;
        p = p * (count - k) as u128 * part as u128 / ((k as u128 + 1) * rest);
    }
    coder.symbol(&freqs[..=count], total, value)
}
