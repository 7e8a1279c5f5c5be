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
}

impl Star {
    /// Build the stars of `vertices` vertices. Linear in the number of corners.
    pub fn build(vertices: usize, faces: &Faces) -> Self {
        let mut start = vec![0u32; vertices + 1];
        for &v in &faces.corners {
            start[v as usize + 1] += 1;
        }
        for v in 1..start.len() {
            start[v] += start[v - 1];
        }
        Star::fill(start, faces)
    }

    /// Build the stars whose beginnings, and end, are known.
    ///
    /// One task goes forwards from the first element and fills stars from their beginnings, the other backwards from the last and
    /// fills them from their ends, so neither need know what the other does.
    pub(super) fn fill(start: Vec<u32>, faces: &Faces) -> Self {
        let list: Vec<AtomicU32> = std::iter::repeat_with(AtomicU32::default).take(faces.corners.len()).collect();
        let half = if faces.len() < SMALL { 0 } else { faces.len() as u32 / 2 };
        let forwards = || {
            let mut next = if half > 0 { start.clone() } else { Vec::new() };
            for f in 0..half {
                for &v in faces.get(f) {
                    let at = &mut next[v as usize];
                    list[*at as usize].store(f, Relaxed);
                    *at += 1;
                }
            }
        };
        let backwards = || {
            let mut end = start[1..].to_vec();
            for f in (half..faces.len() as u32).rev() {
                for &v in faces.get(f) {
                    let at = &mut end[v as usize];
                    *at -= 1;
                    list[*at as usize].store(f, Relaxed);
                }
            }
        };
        par::join(forwards, backwards);
        Star { start, faces: list.into_iter().map(AtomicU32::into_inner).collect() }
    }

    /// The elements around `v`.
    #[inline]
    pub fn get(&self, v: u32) -> &[u32] {
        &self.faces[self.start[v as usize] as usize..self.start[v as usize + 1] as usize]
    }
}
