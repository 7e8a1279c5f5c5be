//! The elements around each vertex, as a compressed sparse row structure built by counting sort.

use super::level::Faces;
use crate::parallel;

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
    /// Two tasks go through all elements, each for half of the vertices.
    pub fn fill(start: Vec<u32>, faces: &Faces, with_next: bool) -> Self {
        let (vertices, count) = (start.len() - 1, faces.corners.len());
        let mut list = vec![0; count];
        let mut next = vec![0; if with_next { count } else { 0 }];
        let half = if faces.len() < SMALL { 0 } else { vertices / 2 };
        let cut = start[half] as usize;
        let (list_one, list_two) = list.split_at_mut(cut);
        let (next_one, next_two) = next.split_at_mut(if with_next { cut } else { 0 });
        let fill = |from: usize, to: usize, list: &mut [u32], next: &mut [u32]| {
            let mut at: Vec<u32> = start[from..to].iter().map(|&s| s - start[from]).collect();
            let mut put = |f: u32, v: u32, follows: u32| {
                if let Some(at) = at.get_mut((v as usize).wrapping_sub(from)) {
                    list[*at as usize] = f;
                    if with_next {
                        next[*at as usize] = follows;
                    }
                    *at += 1;
                }
            };
            for f in 0..faces.len() as u32 {
                match faces.get(f) {
                    &[a, b, c] => {
                        put(f, a, b);
                        put(f, b, c);
                        put(f, c, a);
                    }
                    corners if corners.len() > BIG => corners.iter().for_each(|&v| put(f, v, v)),
                    corners => {
                        let follows = corners.iter().skip(1).chain(corners.first());
                        corners.iter().zip(follows).for_each(|(&v, &next)| put(f, v, next));
                    }
                }
            }
        };
        parallel::join(
            || {
                if half > 0 {
                    fill(0, half, list_one, next_one)
                }
            },
            || fill(half, vertices, list_two, next_two),
        );
        Star { start, faces: list, next }
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
