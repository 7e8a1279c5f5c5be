//! The elements around each vertex, as a compressed sparse row structure built by counting sort.

use super::level::Faces;

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
        let mut start = vec![0u32; vertices + 2];
        for &v in &faces.corners {
            start[v as usize + 2] += 1;
        }
        for v in 2..start.len() {
            start[v] += start[v - 1];
        }
        let mut list = vec![0u32; faces.corners.len()];
        for f in 0..faces.len() as u32 {
            for &v in faces.get(f) {
                let at = &mut start[v as usize + 1];
                list[*at as usize] = f;
                *at += 1;
            }
        }
        start.pop();
        Star { start, faces: list }
    }

    /// The elements around `v`.
    #[inline]
    pub fn get(&self, v: u32) -> &[u32] {
        &self.faces[self.start[v as usize] as usize..self.start[v as usize + 1] as usize]
    }
}
