//! The nearest of many lattice points, by a k-d tree: `O(log n)` for a query however the points lie, also where all of
//! them lie at a few places, as missing pixels of depth cameras do.
//!
//! Invariant: what is found is the least pair of squared distance and number, as a look at all points would find it.

use std::ops::Range;

/// Points below which a look at all of them is quicker than a tree.
const LEAF: usize = 8;

/// Points and their numbers, each place once.
pub(super) struct Nearest {
    /// The middle of each range divides it along the axis of its depth.
    points: Vec<([i32; 3], u32)>,
}

impl Nearest {
    /// The tree of `points`, numbered in their order.
    pub(super) fn new(points: &[[i32; 3]]) -> Self {
        let mut points: Vec<([i32; 3], u32)> = points.iter().copied().zip(0..).collect();
        points.sort_unstable();
        // Of equal points the first is the one that is found.
        points.dedup_by_key(|p| p.0);
        let mut ranges = vec![(0..points.len(), 0)];
        while let Some((range, axis)) = ranges.pop() {
            if range.len() > LEAF {
                let middle = range.len() / 2;
                points[range.clone()].select_nth_unstable_by_key(middle, |p| p.0[axis]);
                let middle = range.start + middle;
                ranges.push((range.start..middle, (axis + 1) % 3));
                ranges.push((middle + 1..range.end, (axis + 1) % 3));
            }
        }
        Nearest { points }
    }

    /// Squared distance and number of the nearest point, of several the first; `None` without points.
    pub(super) fn of(&self, p: [i32; 3]) -> Option<(i64, u32)> {
        let mut best: Option<(i64, u32)> = None;
        let mut offer = |(q, v): ([i32; 3], u32)| {
            let d = (0..3).map(|k| (i64::from(q[k]) - i64::from(p[k])).pow(2)).sum();
            if best.is_none_or(|b| (d, v) < b) {
                best = Some((d, v));
            }
            best.map_or(i64::MAX, |b| b.0)
        };
        let mut nearest = i64::MAX;
        // Ranges still to be looked at, with the least that the squared distance to a point of them can be.
        let mut ranges: Vec<(Range<usize>, usize, i64)> = vec![(0..self.points.len(), 0, 0)];
        while let Some((range, axis, least)) = ranges.pop() {
            if least > nearest {
                continue;
            }
            if range.len() <= LEAF {
                for &q in &self.points[range] {
                    nearest = offer(q);
                }
                continue;
            }
            let middle = range.start + range.len() / 2;
            nearest = offer(self.points[middle]);
            let off = i64::from(p[axis]) - i64::from(self.points[middle].0[axis]);
            let (low, high) = (range.start..middle, middle + 1..range.end);
            let (near, far) = if off < 0 { (low, high) } else { (high, low) };
            let next = (axis + 1) % 3;
            ranges.push((far, next, least.max(off * off)));
            ranges.push((near, next, least));
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_first_of_the_nearest_is_found(
            points in prop::collection::vec(prop::array::uniform3(-4i32..4), 0..200),
            far in prop::array::uniform3(-(1i32 << 25)..1 << 25),
            queries in prop::collection::vec(prop::array::uniform3(-6i32..6), 1..20),
        ) {
            let mut points = points;
            points.push(far);
            let tree = Nearest::new(&points);
            for q in queries {
                let d = |p: &[i32; 3]| (0..3).map(|k| (p[k] as i64 - q[k] as i64).pow(2)).sum::<i64>();
                let all = points.iter().zip(0u32..).map(|(p, v)| (d(p), v)).min();
                prop_assert_eq!(tree.of(q), all);
            }
        }
    }

    #[test]
    fn no_point_is_near_where_there_is_none() {
        assert_eq!(Nearest::new(&[]).of([0; 3]), None);
    }
}
