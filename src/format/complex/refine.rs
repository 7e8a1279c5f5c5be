//! The generic vertex split, a batch at a time: coarser level and batch in, finer level out.
//!
//! Caillaud et al. 2016, section 4.1. The finer level is built by prefix sums, never in place: two splits may share a
//! ring vertex. Children take consecutive places; new vertices come last. The elements of a split appear before the first
//! element of its star, so that neighbours in space stay neighbours in memory. Runs of elements and of splits are worked on
//! in parallel; what comes out does not depend on it.

use super::batch::{Batch, NEW, NONE, Side};
use super::placement::{children, compensation};
use super::{Faces, Level, Star};
use crate::parallel;
use std::ops::Range;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering::Relaxed};

/// A finer level.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The level.
    pub level: Level,
    /// Where its stars begin, if they were asked for, and empty otherwise: for [`Star::fill`], once the coarser level and the batch are
    /// gone, which would be in memory beside them.
    pub star_start: Vec<u32>,
    /// For each vertex its vertex in the coarser level; [`NONE`] for a new vertex.
    pub parent: Vec<u32>,
    /// For each element, if that was asked for, its element in the coarser level, or `NEW | i` for the `i`-th that the
    /// batch inserts, counted split by split, a split's triangles before its dangling edges.
    pub element: Vec<u32>,
    /// Whether two splits share an element, which a valid batch does not have; nothing else is there then.
    pub conflict: bool,
}

/// What [`refine`] is asked for beside the level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Where the stars of the finer level begin.
    pub star: bool,
    /// Where its elements come from.
    pub element: bool,
}

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
    let fine = level.positions.len() + batch.len() + batch.new_vertices.len();
    let (renumber, marks) =
        parallel::join(|| renumber(level.positions.len(), batch), || Marks::new(level, &star, batch));
    if marks.conflict {
        let level = Level { positions: Vec::new(), faces: Faces::new(), shift: batch.shift };
        return Refined { level, star_start: Vec::new(), parent: Vec::new(), element: Vec::new(), conflict: true };
    }
    // Compensation looks at the stars, and so do those of the finer level.
    let star = (batch.alpha > 0 || wanted.star).then_some(star);
    let around = star.as_ref();
    let (sizes, ((faces, element), (positions, parent))) = parallel::join(
        || around.filter(|_| wanted.star).map_or(Vec::new(), |star| stars(star, batch, &renumber, fine)),
        || {
            parallel::join(
                || elements(level, &marks, batch, &renumber, wanted.element),
                || vertices(level, around, batch, &renumber, bias),
            )
        },
    );
    let level = Level { positions, faces, shift: batch.shift };
    Refined { level, star_start: sizes, parent, element, conflict: false }
}

/// The new number of each vertex, of its first child if it splits, and at the end how many vertices come from vertices: so `v`
/// splits when the next number is larger by two.
fn renumber(vertices: usize, batch: &Batch) -> Vec<u32> {
    let mut numbers = vec![0u32; vertices + 1];
    let runs = numbers.chunks_mut(RUN).enumerate().collect();
    parallel::map(runs, |(k, run): (usize, &mut [u32])| {
        let first = (k * RUN) as u32;
        let mut splits = batch.vertex.partition_point(|&v| v < first);
        for (v, number) in (first..).zip(run) {
            *number = v + splits as u32;
            splits += (batch.vertex.get(splits) == Some(&v)) as usize;
        }
    });
    numbers
}

/// Where the star of each vertex of the finer level begins, and the end: from the stars of the coarser one, which saves counting
/// corners.
fn stars(star: &Star, batch: &Batch, renumber: &[u32], fine: usize) -> Vec<u32> {
    let mut sizes = vec![0u32; fine + 1];
    let (mut from, mut to) = (0, 0);
    for (i, &v) in batch.vertex.iter().enumerate() {
        let v = v as usize;
        let new = renumber[v] as usize;
        for (size, ends) in sizes[to..new].iter_mut().zip(star.start[from..].windows(2)) {
            *size += ends[1] - ends[0];
        }
        (from, to) = (v + 1, new + 2);
        let both = batch.triangles_of(i).len() as u32 + batch.edges[i];
        let (mut one, mut two) = (both, both);
        for &side in batch.sides_of(i) {
            one += (side != Side::Two) as u32;
            two += (side != Side::One) as u32;
        }
        sizes[new] += one;
        sizes[new + 1] += two;
        for t in batch.triangles_of(i) {
            sizes[renumber[t.apex as usize] as usize] += 1;
        }
    }
    for (size, ends) in sizes[to..].iter_mut().zip(star.start[from..].windows(2)) {
        *size += ends[1] - ends[0];
    }
    let mut sum = 0;
    for size in &mut sizes {
        (*size, sum) = (sum, sum + *size);
    }
    sizes
}

/// Positions and parents.
fn vertices(
    level: &Level,
    star: Option<&Star>,
    batch: &Batch,
    renumber: &[u32],
    bias: i32,
) -> (Vec<[i32; 3]>, Vec<u32>) {
    let coarse = level.positions.len();
    let mut merged = Vec::new();
    if batch.alpha > 0 {
        merged.resize(coarse, false);
        for &v in &batch.vertex {
            merged[v as usize] = true;
        }
    }
    let fine = coarse + batch.len() + batch.new_vertices.len();
    let mut positions = vec![[0; 3]; fine];
    let mut parent = vec![NONE; fine];
    let up = (level.shift - batch.shift) as u32;
    // Each run of the coarser level's vertices into its own part of the finer level's; the new vertices are a part of their own.
    let mut parts = Vec::new();
    let (mut places, mut parents, mut lows) = (&mut positions[..], &mut parent[..], &batch.low_bits[..]);
    for range in parallel::ranges(coarse, RUN).into_iter().map(Some).chain([None]) {
        let count = range.as_ref().map_or(batch.new_vertices.len(), |r| (renumber[r.end] - renumber[r.start]) as usize);
        let (place, places_left) = places.split_at_mut(count);
        let (parent, parents_left) = parents.split_at_mut(count);
        let (low, lows_left) = lows.split_at(count.min(lows.len()));
        parts.push((range, place, parent, low));
        (places, parents, lows) = (places_left, parents_left, lows_left);
    }
    parallel::map(parts, |(range, place, parent, low)| {
        if let Some(range) = range {
            let mut i = batch.vertex.partition_point(|&v| (v as usize) < range.start);
            let mut to = 0;
            for v in range {
                let p = level.positions[v];
                if batch.vertex.get(i) == Some(&(v as u32)) {
                    let v = v as u32;
                    let off = match star {
                        Some(star) if batch.alpha > 0 => compensation(level, star, &merged, v, batch.alpha),
                        _ => [0; 3],
                    };
                    let mid = [p[0].wrapping_sub(off[0]), p[1].wrapping_sub(off[1]), p[2].wrapping_sub(off[2])];
                    let (p1, p2) = children(mid, batch.delta[i], bias);
                    (place[to], place[to + 1]) = (p1, p2);
                    (parent[to], parent[to + 1]) = (v, v);
                    to += 2;
                    i += 1;
                } else {
                    (place[to], parent[to]) = (p, v as u32);
                    to += 1;
                }
            }
        } else {
            place.copy_from_slice(&batch.new_vertices);
        }
        if up > 0 {
            for (p, low) in place.iter_mut().zip(low) {
                for k in 0..3 {
                    p[k] = p[k].wrapping_shl(up) | low[k] as i32;
                }
            }
        }
    });
    (positions, parent)
}

/// What the splits do to the elements.
struct Marks {
    /// For each element [`TOUCHED`] with a side, [`FIRST`], or 0.
    of: Vec<u8>,
    /// For each run of [`RUN`] elements how many elements and corners are inserted before them, or grow.
    more: Vec<(usize, usize)>,
    /// Splits of vertices without elements.
    last: Vec<u32>,
    /// Whether two splits share an element.
    conflict: bool,
}

impl Marks {
    fn new(level: &Level, star: &Star, batch: &Batch) -> Self {
        // Splits side by side: a lost update can only be a conflict, which the number of marks shows.
        let marks: Vec<AtomicU8> = std::iter::repeat_with(AtomicU8::default).take(level.faces.len()).collect();
        let runs = level.faces.len().div_ceil(RUN);
        let more: Vec<[AtomicUsize; 2]> = std::iter::repeat_with(Default::default).take(runs).collect();
        let parts = parallel::map(parallel::ranges(batch.len(), RUN / 4), |range| {
            let (mut touched, mut last) = (0, Vec::new());
            // What the run of elements at hand gets more; neighbours in number are neighbours in space.
            let (mut run, mut elements, mut corners) = (0, 0, 0);
            let flush = |run: usize, elements: usize, corners: usize| {
                if corners > 0 {
                    more[run][0].fetch_add(elements, Relaxed);
                    more[run][1].fetch_add(corners, Relaxed);
                }
            };
            for i in range {
                let (around, sides) = (star.get(batch.vertex[i]), batch.sides_of(i));
                let Some(&first) = around.first() else {
                    last.push(i as u32);
                    continue;
                };
                touched += around.len();
                let mut of_first = FIRST;
                for (&f, &side) in around.iter().zip(sides) {
                    marks[f as usize].store(TOUCHED | side as u8 | of_first, Relaxed);
                    of_first = 0;
                    if side as u8 >= Side::Grow12 as u8 {
                        let of = f as usize / RUN;
                        if of != run {
                            flush(run, elements, corners);
                            (run, elements, corners) = (of, 0, 0);
                        }
                        corners += 1;
                    }
                }
                let of = first as usize / RUN;
                if of != run {
                    flush(run, elements, corners);
                    (run, elements, corners) = (of, 0, 0);
                }
                let inserted = inserted(batch, i);
                elements += inserted.0;
                corners += inserted.1;
            }
            flush(run, elements, corners);
            (touched, last)
        });
        let of: Vec<u8> = marks.into_iter().map(AtomicU8::into_inner).collect();
        let more = more.into_iter().map(|[e, c]| (e.into_inner(), c.into_inner())).collect();
        let mut touched = 0;
        let mut last = Vec::new();
        for (count, splits) in parts {
            touched += count;
            last.extend(splits);
        }
        let conflict = of.iter().filter(|&&m| m != 0).count() != touched;
        Marks { of, more, last, conflict }
    }
}

/// Elements, and corners, that a split inserts.
fn inserted(batch: &Batch, i: usize) -> (usize, usize) {
    let (triangles, edges) = (batch.triangles_of(i).len(), batch.edges[i] as usize);
    (triangles + edges, 3 * triangles + 2 * edges)
}

/// Elements and where they come from.
fn elements(level: &Level, marks: &Marks, batch: &Batch, renumber: &[u32], origin: bool) -> (Faces, Vec<u32>) {
    // The first inserted element of each split.
    let mut count = 0u32;
    let splits = if origin { batch.len() } else { 0 };
    let new_first: Vec<u32> = (0..splits)
        .map(|i| {
            let first = count;
            count += inserted(batch, i).0 as u32;
            first
        })
        .collect();
    let (last, old) = (&marks.last, &level.faces);
    let work = Work { level, batch, renumber, mark: &marks.of, new_first: &new_first };
    // How much each run gives, then each into its own part of the whole.
    let ranges: Vec<_> = (0..marks.more.len()).map(|k| k * RUN..old.len().min((k + 1) * RUN)).collect();
    let mut sizes: Vec<_> = ranges
        .iter()
        .zip(&marks.more)
        .map(|(r, more)| (r.len() + more.0, (old.start[r.end] - old.start[r.start]) as usize + more.1))
        .collect();
    sizes.push(last.iter().fold((0, 0), |(e, c), &i| {
        let (elements, corners) = inserted(batch, i as usize);
        (e + elements, c + corners)
    }));
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
    parallel::map(runs, |(range, mut run)| match range {
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
    fn fill(&self, range: Range<usize>, run: &mut Run) {
        let old = &self.level.faces;
        let r = self.renumber;
        // The new number, and 1 for a vertex that splits.
        let new = |v: u32| {
            let number = r[v as usize];
            (number, r[v as usize + 1] - number - 1)
        };
        for f in range {
            let corners = old.get(f as u32);
            let mark = self.mark[f];
            if mark == 0 {
                // No corner splits.
                if let &[x, y, z] = corners {
                    run.put(&[r[x as usize], r[y as usize], r[z as usize]]);
                } else {
                    corners.iter().for_each(|&v| run.put(&[r[v as usize]]));
                }
                run.close(f as u32);
                continue;
            }
            if mark & FIRST != 0
                && let Some(first) = corners.iter().find_map(|&v| (new(v).1 == 1).then_some(v))
            {
                // As many splits come before a vertex as its number grows.
                self.insert((r[first as usize] - first) as usize, run);
            }
            if mark & 2 == 0 {
                let side = (mark & 1) as u32;
                let place = |v: u32| {
                    let (number, splits) = new(v);
                    number + (splits & side)
                };
                if let &[x, y, z] = corners {
                    run.put(&[place(x), place(y), place(z)]);
                } else {
                    for &v in corners {
                        run.put(&[place(v)]);
                    }
                }
            } else {
                for &v in corners {
                    match (new(v), mark & 3) {
                        ((number, 0), _) => run.put(&[number]),
                        ((number, _), 2) => run.put(&[number, number + 1]),
                        ((number, _), _) => run.put(&[number + 1, number]),
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
        let mut new = self.new_first.get(i).copied().unwrap_or(0) | NEW;
        for t in self.batch.triangles_of(i) {
            let x = self.renumber[t.apex as usize];
            run.put(&if t.reversed { [v2, v1, x] } else { [v1, v2, x] });
            run.close(new);
            new = new.wrapping_add(1);
        }
        for _ in 0..self.batch.edges[i] {
            run.put(&[v1, v2]);
            run.close(new);
            new = new.wrapping_add(1);
        }
    }
}
