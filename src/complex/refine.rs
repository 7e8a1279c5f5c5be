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
pub fn refine(level: &Level, star: &Star, batch: &Batch, bias: i32, wanted: Wanted) -> Refined {
    let coarse = level.positions.len();
    let mut renumber = Vec::with_capacity(coarse);
    let mut splits = 0;
    for v in 0..coarse as u32 {
        renumber.push(v + splits as u32);
        splits += (batch.vertex.get(splits) == Some(&v)) as usize;
    }
    let ((faces, element, stars), (positions, parent)) = par::join(
        || {
            let (faces, element) = elements(level, star, batch, &renumber, wanted.element);
            let fine = coarse + batch.len() + batch.births.len();
            let stars = if wanted.star { Star::build(fine, &faces) } else { Star::default() };
            (faces, element, stars)
        },
        || vertices(level, star, batch, bias),
    );
    Refined { level: Level { positions, faces, shift: batch.shift }, star: stars, parent, element }
}

/// Positions and parents.
fn vertices(level: &Level, star: &Star, batch: &Batch, bias: i32) -> (Vec<[i32; 3]>, Vec<u32>) {
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
                let off = compensation(level, star, &merged, v, batch.alpha);
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

/// Elements and where they come from.
fn elements(level: &Level, star: &Star, batch: &Batch, renumber: &[u32], origin: bool) -> (Faces, Vec<u32>) {
    let mut mark = vec![0u8; level.faces.len()];
    let mut last: Vec<u32> = Vec::new();
    for (i, &v) in batch.vertex.iter().enumerate() {
        let around = star.get(v);
        for (&f, &side) in around.iter().zip(batch.sides_of(i)) {
            mark[f as usize] = TOUCHED | side as u8;
        }
        match around.first() {
            Some(&f) => mark[f as usize] |= FIRST,
            None => last.push(i as u32),
        }
    }
    // The first inserted element of each split.
    let mut count = 0u32;
    let new_first: Vec<u32> = (0..batch.len())
        .map(|i| {
            let first = count;
            count += batch.triangles_of(i).len() as u32 + batch.edges[i];
            first
        })
        .collect();
    let work = Work { level, batch, renumber, mark: &mark, new_first: &new_first, origin };
    let mut runs = par::map(par::ranges(level.faces.len(), RUN), |range| work.run(range));
    let mut tail = (Faces::new(), Vec::new());
    for i in last {
        work.insert(i as usize, &mut tail.0, &mut tail.1);
    }
    if !tail.0.is_empty() {
        runs.push(tail);
    }
    if runs.len() == 1 {
        return runs.pop().unwrap_or_default();
    }
    let corners = runs.iter().map(|r| r.0.corners.len()).sum();
    let elements = runs.iter().map(|r| r.0.len()).sum::<usize>();
    let mut faces = Faces { start: Vec::with_capacity(elements + 1), corners: Vec::with_capacity(corners) };
    let mut element = Vec::with_capacity(if origin { elements } else { 0 });
    faces.start.push(0);
    for (f, e) in runs {
        let base = faces.corners.len() as u32;
        faces.start.extend(f.start[1..].iter().map(|s| s + base));
        faces.corners.extend_from_slice(&f.corners);
        element.extend_from_slice(&e);
    }
    (faces, element)
}

/// What a run of elements is made from.
struct Work<'a> {
    level: &'a Level,
    batch: &'a Batch,
    renumber: &'a [u32],
    mark: &'a [u8],
    new_first: &'a [u32],
    origin: bool,
}

impl Work<'_> {
    fn run(&self, range: Range<usize>) -> (Faces, Vec<u32>) {
        let old = &self.level.faces;
        let (first, end) = (old.start[range.start] as usize, old.start[range.end] as usize);
        let mut faces = Faces::new();
        faces.start.reserve(range.len() + range.len() / 2);
        faces.corners.reserve((end - first) + (end - first) / 2);
        let mut elements = Vec::new();
        for f in range {
            let corners = &old.corners[old.start[f] as usize..old.start[f + 1] as usize];
            let mark = self.mark[f];
            if mark == 0 {
                if let &[x, y, z] = corners {
                    let r = self.renumber;
                    faces.corners.extend_from_slice(&[r[x as usize], r[y as usize], r[z as usize]]);
                } else {
                    faces.corners.extend(corners.iter().map(|&v| self.renumber[v as usize]));
                }
            } else {
                self.touched(corners, mark, &mut faces, &mut elements);
            }
            faces.start.push(faces.corners.len() as u32);
            if self.origin {
                elements.push(f as u32);
            }
        }
        (faces, elements)
    }

    /// An element with a corner that splits, and before it what the split inserts if it is the first of the star.
    fn touched(&self, corners: &[u32], mark: u8, faces: &mut Faces, elements: &mut Vec<u32>) {
        // As many splits come before a vertex as its number grows.
        let split = |v: u32| {
            let i = (self.renumber[v as usize] - v) as usize;
            (self.batch.vertex.get(i) == Some(&v)).then_some(i)
        };
        if mark & FIRST != 0
            && let Some(i) = corners.iter().find_map(|&v| split(v))
        {
            self.insert(i, faces, elements);
        }
        for &v in corners {
            let new = self.renumber[v as usize];
            if split(v).is_none() {
                faces.corners.push(new);
                continue;
            }
            match mark & 3 {
                s if s == Side::One as u8 => faces.corners.push(new),
                s if s == Side::Two as u8 => faces.corners.push(new + 1),
                s if s == Side::Grow12 as u8 => faces.corners.extend_from_slice(&[new, new + 1]),
                _ => faces.corners.extend_from_slice(&[new + 1, new]),
            }
        }
    }

    /// What split `i` inserts.
    fn insert(&self, i: usize, faces: &mut Faces, elements: &mut Vec<u32>) {
        let v1 = self.renumber[self.batch.vertex[i] as usize];
        let v2 = v1 + 1;
        let triangles = self.batch.triangles_of(i);
        for t in triangles {
            let x = self.renumber[t.apex as usize];
            faces.push(&if t.reversed { [v2, v1, x] } else { [v1, v2, x] });
        }
        for _ in 0..self.batch.edges[i] {
            faces.push(&[v1, v2]);
        }
        if self.origin {
            let first = self.new_first[i];
            let n = triangles.len() as u32 + self.batch.edges[i];
            elements.extend((first..first + n).map(|e| e | NEW));
        }
    }
}
