//! The generic vertex split, a batch at a time: coarser level and batch in, finer level out.
//!
//! Caillaud et al. 2016, section 4.1. The finer level is built by prefix sums, never in place: two splits may share a
//! ring vertex. Children take consecutive places; births come last. The elements of a split appear before the first
//! element of its star, so that neighbours in space stay neighbours in memory. Runs of elements and of splits are worked on
//! in parallel; what comes out does not depend on it.

use super::batch::{Batch, Side};
use super::placement::{children, compensation};
use super::{Faces, Level, Star};
use crate::par;
use std::ops::Range;

/// A finer level.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The level.
    pub level: Level,
    /// Its stars, if they were asked for; empty otherwise.
    pub star: Star,
    /// For each vertex its vertex in the coarser level; [`NONE`] for a birth.
    pub parent: Vec<u32>,
    /// For each element, if that was asked for, its element in the coarser level, or `NEW | i` for the `i`-th that the
    /// batch inserts, counted split by split, a split's triangles before its dangling edges.
    pub element: Vec<u32>,
    /// Whether two splits share an element, which a valid batch does not have; the level then makes no sense.
    pub conflict: bool,
}

/// What [`refine`] is asked for beside the level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// The stars of the finer level.
    pub star: bool,
    /// Where its elements come from.
    pub element: bool,
}

/// No vertex.
pub const NONE: u32 = u32::MAX;
/// Marks an element that a batch inserts.
pub const NEW: u32 = 1 << 31;

/// Elements, or splits, that one task works on.
const RUN: usize = 1 << 14;

/// On an element: a corner of it splits (its side in the two lowest bits).
const TOUCHED: u8 = 4;
/// On an element: it is the first of the star of that vertex.
const FIRST: u8 = 8;

/// Build the finer level. `batch` has to be valid for `level`: its vertices increase and share no element, it has a side for each
/// element of each of their stars, and low bits for all vertices where the shift falls.
/// The stars are taken, and let go as soon as nothing asks for them: the finer level is larger than the coarser one.
pub fn refine(level: &Level, star: Star, batch: &Batch, bias: i32, wanted: Wanted) -> Refined {
    let coarse = level.positions.len();
    let mut renumber = Vec::with_capacity(coarse);
    let mut splits = 0;
    for v in 0..coarse as u32 {
        renumber.push(v + splits as u32);
        splits += (batch.vertex.get(splits) == Some(&v)) as usize;
    }
    let marks = Marks::new(level, &star, batch);
    // Compensation looks at the stars.
    let star = (batch.alpha > 0).then_some(star);
    let ((faces, element, stars), (positions, parent)) = par::join(
        || {
            let (faces, element) = elements(level, &marks, batch, &renumber, wanted.element);
            let fine = coarse + batch.len() + batch.births.len();
            let stars = if wanted.star { Star::build(fine, &faces) } else { Star::default() };
            (faces, element, stars)
        },
        || vertices(level, star, batch, bias),
    );
    Refined {
        level: Level { positions, faces, shift: batch.shift },
        star: stars,
        parent,
        element,
        conflict: marks.conflict,
    }
}

/// Positions and parents.
fn vertices(level: &Level, star: Option<Star>, batch: &Batch, bias: i32) -> (Vec<[i32; 3]>, Vec<u32>) {
    let coarse = level.positions.len();
    let mut merged = Vec::new();
    if batch.alpha > 0 {
        merged.resize(coarse, false);
        for &v in &batch.vertex {
            merged[v as usize] = true;
        }
    }
    let pairs = par::map(par::ranges(batch.len(), RUN / 8), |range| {
        range
            .map(|i| {
                let v = batch.vertex[i];
                let p = level.positions[v as usize];
                let off = star.as_ref().map_or([0; 3], |star| compensation(level, star, &merged, v, batch.alpha));
                let mid = [p[0].wrapping_sub(off[0]), p[1].wrapping_sub(off[1]), p[2].wrapping_sub(off[2])];
                children(mid, batch.delta[i], bias)
            })
            .collect::<Vec<_>>()
    });
    let fine = coarse + batch.len() + batch.births.len();
    let mut positions = Vec::with_capacity(fine);
    let mut parent = Vec::with_capacity(fine);
    let mut from = 0;
    for (&v, (p1, p2)) in batch.vertex.iter().zip(pairs.into_iter().flatten()) {
        positions.extend_from_slice(&level.positions[from..v as usize]);
        parent.extend(from as u32..v);
        positions.extend_from_slice(&[p1, p2]);
        parent.extend_from_slice(&[v, v]);
        from = v as usize + 1;
    }
    positions.extend_from_slice(&level.positions[from..]);
    parent.extend(from as u32..coarse as u32);
    positions.extend_from_slice(&batch.births);
    parent.resize(fine, NONE);
    let up = (level.shift - batch.shift) as u32;
    if up > 0 {
        for (p, low) in positions.iter_mut().zip(&batch.low_bits) {
            for k in 0..3 {
                p[k] = p[k].wrapping_shl(up) | low[k] as i32;
            }
        }
    }
    (positions, parent)
}

/// What the splits do to the elements.
struct Marks {
    /// For each element [`TOUCHED`] with a side, [`FIRST`], or 0.
    of: Vec<u8>,
    /// Splits of vertices without elements.
    last: Vec<u32>,
    /// Whether two splits share an element.
    conflict: bool,
}

impl Marks {
    fn new(level: &Level, star: &Star, batch: &Batch) -> Self {
        let mut mark = vec![0u8; level.faces.len()];
        let mut last: Vec<u32> = Vec::new();
        let mut conflict = false;
        for (i, &v) in batch.vertex.iter().enumerate() {
            let around = star.get(v);
            for (&f, &side) in around.iter().zip(batch.sides_of(i)) {
                conflict |= mark[f as usize] != 0;
                mark[f as usize] = TOUCHED | side as u8;
            }
            match around.first() {
                Some(&f) => mark[f as usize] |= FIRST,
                None => last.push(i as u32),
            }
        }
        Marks { of: mark, last, conflict }
    }
}

/// Elements and where they come from.
fn elements(level: &Level, marks: &Marks, batch: &Batch, renumber: &[u32], origin: bool) -> (Faces, Vec<u32>) {
    // The first inserted element of each split.
    let mut count = 0u32;
    let new_first: Vec<u32> = (0..batch.len())
        .map(|i| {
            let first = count;
            count += batch.triangles_of(i).len() as u32 + batch.edges[i];
            first
        })
        .collect();
    let last = &marks.last;
    let work = Work { level, batch, renumber, mark: &marks.of, new_first: &new_first };
    // How much each run gives, then each into its own part of the whole.
    let ranges = par::ranges(level.faces.len(), RUN);
    let mut sizes = par::map(ranges.clone(), |range| work.measure(range));
    let tail = last.iter().fold((0, 0), |(e, c), &i| {
        let (elements, corners) = work.inserted(i as usize);
        (e + elements, c + corners)
    });
    sizes.push(tail);
    let (count, corners) = sizes.iter().fold((0, 0), |(e, c), s| (e + s.0, c + s.1));
    let mut faces = Faces { start: vec![0; count + 1], corners: vec![0; corners] };
    let mut element = vec![0; if origin { count } else { 0 }];
    let mut runs = Vec::with_capacity(sizes.len());
    let (mut ends, mut places, mut origins) = (&mut faces.start[1..], &mut faces.corners[..], &mut element[..]);
    let mut base = 0;
    for (k, &(count, corners)) in sizes.iter().enumerate() {
        let (end, ends_left) = ends.split_at_mut(count);
        let (place, places_left) = places.split_at_mut(corners);
        let (origin, origins_left) = origins.split_at_mut(if origin { count } else { 0 });
        runs.push((ranges.get(k).cloned(), Run { end, corners: place, origin, elements: 0, filled: 0, base }));
        (ends, places, origins) = (ends_left, places_left, origins_left);
        base += corners as u32;
    }
    par::map(runs, |(range, mut run)| match range {
        Some(range) => work.fill(range, &mut run),
        None => last.iter().for_each(|&i| work.insert(i as usize, &mut run)),
    });
    (faces, element)
}

/// A part of the finer level's elements on its way.
struct Run<'a> {
    end: &'a mut [u32],
    corners: &'a mut [u32],
    origin: &'a mut [u32],
    elements: usize,
    filled: usize,
    /// Corners before this part.
    base: u32,
}

impl Run<'_> {
    #[inline]
    fn put(&mut self, corners: &[u32]) {
        self.corners[self.filled..self.filled + corners.len()].copy_from_slice(corners);
        self.filled += corners.len();
    }

    /// End an element that comes from `origin`.
    #[inline]
    fn close(&mut self, origin: u32) {
        self.end[self.elements] = self.base + self.filled as u32;
        if let Some(o) = self.origin.get_mut(self.elements) {
            *o = origin;
        }
        self.elements += 1;
    }
}

/// What a run of elements is made from.
struct Work<'a> {
    level: &'a Level,
    batch: &'a Batch,
    renumber: &'a [u32],
    mark: &'a [u8],
    new_first: &'a [u32],
}

impl Work<'_> {
    /// The split of `v`, if it splits: as many splits come before a vertex as its number grows.
    #[inline]
    fn split(&self, v: u32) -> Option<usize> {
        let i = (self.renumber[v as usize] - v) as usize;
        (self.batch.vertex.get(i) == Some(&v)).then_some(i)
    }

    /// The split before whose first element `f`, with these corners, stands.
    fn before(&self, corners: &[u32], mark: u8) -> Option<usize> {
        if mark & FIRST == 0 { None } else { corners.iter().find_map(|&v| self.split(v)) }
    }

    /// Elements, and corners, that a split inserts.
    fn inserted(&self, i: usize) -> (usize, usize) {
        let (triangles, edges) = (self.batch.triangles_of(i).len(), self.batch.edges[i] as usize);
        (triangles + edges, 3 * triangles + 2 * edges)
    }

    /// Elements, and corners, that become of a range of elements.
    fn measure(&self, range: Range<usize>) -> (usize, usize) {
        let old = &self.level.faces;
        let mut elements = range.len();
        let mut corners = (old.start[range.end] - old.start[range.start]) as usize;
        for f in range {
            let mark = self.mark[f];
            if mark != 0 {
                let names = old.get(f as u32);
                if mark & 3 >= Side::Grow12 as u8 {
                    corners += names.iter().filter(|&&v| self.split(v).is_some()).count();
                }
                if let Some(i) = self.before(names, mark) {
                    let (e, c) = self.inserted(i);
                    elements += e;
                    corners += c;
                }
            }
        }
        (elements, corners)
    }

    fn fill(&self, range: Range<usize>, run: &mut Run) {
        let old = &self.level.faces;
        for f in range {
            let corners = old.get(f as u32);
            let mark = self.mark[f];
            if mark == 0 {
                if let &[x, y, z] = corners {
                    let r = self.renumber;
                    run.put(&[r[x as usize], r[y as usize], r[z as usize]]);
                } else {
                    for &v in corners {
                        run.put(&[self.renumber[v as usize]]);
                    }
                }
            } else {
                if let Some(i) = self.before(corners, mark) {
                    self.insert(i, run);
                }
                for &v in corners {
                    let new = self.renumber[v as usize];
                    match (self.split(v), mark & 3) {
                        (None, _) | (_, 0) => run.put(&[new]),
                        (_, 1) => run.put(&[new + 1]),
                        (_, 2) => run.put(&[new, new + 1]),
                        _ => run.put(&[new + 1, new]),
                    }
                }
            }
            run.close(f as u32);
        }
    }

    /// What split `i` inserts.
    fn insert(&self, i: usize, run: &mut Run) {
        let v1 = self.renumber[self.batch.vertex[i] as usize];
        let v2 = v1 + 1;
        let mut new = self.new_first[i] | NEW;
        for t in self.batch.triangles_of(i) {
            let x = self.renumber[t.apex as usize];
            run.put(&if t.reversed { [v2, v1, x] } else { [v1, v2, x] });
            run.close(new);
            new += 1;
        }
        for _ in 0..self.batch.edges[i] {
            run.put(&[v1, v2]);
            run.close(new);
            new += 1;
        }
    }
}
