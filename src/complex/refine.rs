//! The generic vertex split, a batch at a time: coarser level and batch in, finer level out.
//!
//! Caillaud et al. 2016, section 4.1. The finer level is built by prefix sums, never in place: two splits may share a
//! ring vertex. Children take consecutive places; births come last. The elements of a split appear before the first
//! element of its star, so that neighbours in space stay neighbours in memory.

use super::batch::{Batch, Side};
use super::placement::{children, compensation};
use super::{Faces, Level, Star};

/// Where the vertices and elements of a finer level come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// For each vertex its vertex in the coarser level; [`NONE`] for a birth.
    pub parent: Vec<u32>,
    /// For each element its element in the coarser level, or `NEW | i` for the `i`-th that the batch inserts, counted
    /// split by split, a split's triangles before its dangling edges.
    pub element: Vec<u32>,
}

/// No vertex.
pub const NONE: u32 = u32::MAX;
/// Marks an element that a batch inserts.
pub const NEW: u32 = 1 << 31;

/// Build the finer level. `batch` has to be valid for `level` (see [`check`]); `origin` is filled when asked for.
pub fn refine(
    level: &Level,
    star: &Star,
    batch: &Batch,
    bias: i32,
    mut origin: Option<&mut Origin>,
) -> (Level, Vec<u32>) {
    let coarse = level.positions.len();
    let fine = coarse + batch.len() + batch.births.len();
    let up = level.shift - batch.shift;

    // Vertices.
    let mut renumber = vec![0u32; coarse];
    let mut parent = Vec::with_capacity(fine);
    let mut positions = Vec::with_capacity(fine);
    let merged = if batch.alpha == 0 {
        Vec::new()
    } else {
        let mut merged = vec![false; coarse];
        for &v in &batch.vertex {
            merged[v as usize] = true;
        }
        merged
    };
    let mut splits = batch.vertex.iter().peekable();
    let mut s = 0;
    for v in 0..coarse as u32 {
        renumber[v as usize] = positions.len() as u32;
        let p = level.positions[v as usize];
        parent.push(v);
        if splits.peek() == Some(&&v) {
            splits.next();
            let off = compensation(level, star, &merged, v, batch.alpha);
            let mid = std::array::from_fn(|k| p[k].wrapping_sub(off[k]));
            let (p1, p2) = children(mid, batch.delta[s], bias);
            positions.push(p1);
            positions.push(p2);
            parent.push(v);
            s += 1;
        } else {
            positions.push(p);
        }
    }
    positions.extend_from_slice(&batch.births);
    parent.resize(fine, NONE);
    if up > 0 {
        for (p, low) in positions.iter_mut().zip(&batch.low_bits) {
            for k in 0..3 {
                p[k] = p[k].wrapping_shl(up as u32) | low[k] as i32;
            }
        }
    }

    // What happens at each corner, and what is inserted before each element.
    let mut code = vec![0u8; level.faces.corners.len()];
    let mut before = vec![0u32; level.faces.len() + 1];
    let mut last: Vec<u32> = Vec::new();
    let mut growth = 0usize;
    for (i, &v) in batch.vertex.iter().enumerate() {
        let around = star.get(v);
        for (&f, &side) in around.iter().zip(batch.sides_of(i)) {
            let at = level.faces.start[f as usize] as usize;
            let k = level.faces.get(f).iter().position(|&x| x == v).unwrap_or(0);
            code[at + k] = side as u8;
            growth += (side as u8 >= Side::Grow12 as u8) as usize;
        }
        match around.first() {
            Some(&f) => before[f as usize] = i as u32 + 1,
            None => last.push(i as u32),
        }
    }

    let inserted = batch.triangles.len() + batch.edges.iter().map(|&e| e as usize).sum::<usize>();
    let mut faces = Faces { start: Vec::with_capacity(level.faces.len() + inserted + 1), corners: Vec::new() };
    faces.corners.reserve(level.faces.corners.len() + growth + 3 * inserted);
    faces.start.push(0);
    let new_first: Vec<u32> = if origin.is_some() {
        let mut n = 0;
        batch
            .edges
            .iter()
            .enumerate()
            .map(|(i, &e)| {
                let first = n;
                n += batch.triangles_of(i).len() as u32 + e;
                first
            })
            .collect()
    } else {
        Vec::new()
    };
    let mut elements = Vec::new();
    let emit = |i: usize, faces: &mut Faces, elements: &mut Vec<u32>| {
        let v1 = renumber[batch.vertex[i] as usize];
        let v2 = v1 + 1;
        for t in batch.triangles_of(i) {
            let x = renumber[t.apex as usize];
            faces.corners.extend_from_slice(&if t.reversed { [v2, v1, x] } else { [v1, v2, x] });
            faces.start.push(faces.corners.len() as u32);
        }
        for _ in 0..batch.edges[i] {
            faces.push(&[v1, v2]);
        }
        if let Some(&first) = new_first.get(i) {
            let n = batch.triangles_of(i).len() as u32 + batch.edges[i];
            elements.extend((first..first + n).map(|e| e | NEW));
        }
    };
    for f in 0..level.faces.len() {
        if before[f] != 0 {
            emit(before[f] as usize - 1, &mut faces, &mut elements);
        }
        let (a, b) = (level.faces.start[f] as usize, level.faces.start[f + 1] as usize);
        let (corners, codes) = (&level.faces.corners[a..b], &code[a..b]);
        if let (&[x, y, z], &[i, j, k]) = (corners, codes)
            && i | j | k < 2
        {
            let (x, y, z) = (renumber[x as usize], renumber[y as usize], renumber[z as usize]);
            faces.corners.extend_from_slice(&[x + i as u32, y + j as u32, z + k as u32]);
        } else {
            for (&v, &code) in corners.iter().zip(codes) {
                let v = renumber[v as usize];
                match code {
                    0 | 1 => faces.corners.push(v + code as u32),
                    2 => faces.corners.extend_from_slice(&[v, v + 1]),
                    _ => faces.corners.extend_from_slice(&[v + 1, v]),
                }
            }
        }
        faces.start.push(faces.corners.len() as u32);
        if origin.is_some() {
            elements.push(f as u32);
        }
    }
    for i in last {
        emit(i as usize, &mut faces, &mut elements);
    }
    if let Some(origin) = origin.as_mut() {
        origin.element = elements;
        origin.parent = parent.clone();
    }
    (Level { positions, faces, shift: batch.shift }, parent)
}
