//! The elements around each vertex, as a compressed sparse row structure built by counting sort.

use super::level::Faces;
use crate::par;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Fewer elements than this are not worth a second task.
const SMALL: usize = 1 << 12;

/// For each vertex the elements that name it, in increasing order of element.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Star {
    /// Vertex `v` owns `faces[start[v] .. start[v + 1]]`.
    pub start: Vec<u32>,
    /// Element numbers.
    pub faces: Vec<u32>,
    /// If asked for: beside each element the corner that follows the vertex in it, or the vertex itself in an element of more than
    /// [`BIG`] corners. Who looks around every vertex need not go to the elements.
    pub next: Vec<u32>,
}

/// Elements of more corners are looked at closely only where a vertex splits.
pub const BIG: usize = 64;

impl Star {
    /// Build the stars of `vertices` vertices. Linear in the number of corners.
    pub fn build(vertices: usize, faces: &Faces) -> Self {
        Star::fill(Star::count(vertices, faces), faces, false)
    }

    /// The same with what follows in each element.
    pub fn with_next(vertices: usize, faces: &Faces) -> Self {
        Star::fill(Star::count(vertices, faces), faces, true)
    }

    fn count(vertices: usize, faces: &Faces) -> Vec<u32> {
        let mut start = vec![0u32; vertices + 1];
        for &v in &faces.corners {
            start[v as usize + 1] += 1;
        }
        for v in 1..start.len() {
            start[v] += start[v - 1];
        }
        start
    }

    /// Build the stars whose beginnings, and end, are known.
    ///
    /// One task goes forwards from the first element and fills stars from their beginnings, the other backwards from the last and
    /// fills them from their ends, so neither need know what the other does.
    pub fn fill(start: Vec<u32>, faces: &Faces, with_next: bool) -> Self {
        let zeros = |n| -> Vec<AtomicU32> { std::iter::repeat_with(AtomicU32::default).take(n).collect() };
        let list = zeros(faces.corners.len());
        let next = zeros(if with_next { list.len() } else { 0 });
        let put = |at: u32, f: u32, corners: &[u32], i: usize| {
            list[at as usize].store(f, Relaxed);
            if with_next {
                let follows = if corners.len() > BIG {
                    i
                } else if i + 1 == corners.len() {
                    0
                } else {
                    i + 1
                };
                next[at as usize].store(corners[follows], Relaxed);
            }
        };
        let half = if faces.len() < SMALL { 0 } else { faces.len() as u32 / 2 };
        let forwards = || {
            let mut begin = if half > 0 { start.clone() } else { Vec::new() };
            for f in 0..half {
                let corners = faces.get(f);
                for (i, &v) in corners.iter().enumerate() {
                    let at = &mut begin[v as usize];
                    put(*at, f, corners, i);
                    *at += 1;
                }
            }
        };
        let backwards = || {
            let mut end = start[1..].to_vec();
            for f in (half..faces.len() as u32).rev() {
                let corners = faces.get(f);
                for (i, &v) in corners.iter().enumerate() {
                    let at = &mut end[v as usize];
                    *at -= 1;
                    put(*at, f, corners, i);
                }
            }
        };
        par::join(forwards, backwards);
        let plain = |list: Vec<AtomicU32>| list.into_iter().map(AtomicU32::into_inner).collect();
        Star { start, faces: plain(list), next: plain(next) }
    }

    /// The elements around `v`.
    #[inline]
    pub fn get(&self, v: u32) -> &[u32] {
        &self.faces[self.start[v as usize] as usize..self.start[v as usize + 1] as usize]
    }

    /// What follows `v` in each of them; nothing where that was not asked for.
    #[inline]
    pub fn next(&self, v: u32) -> &[u32] {
        self.next.get(self.start[v as usize] as usize..self.start[v as usize + 1] as usize).unwrap_or(&[])
    }
}
