//! A level: integer positions and elements in flat arrays.
//!
//! Invariants: every element has degree ≥ 2 and names each vertex at most once (elements that repeat a vertex travel
//! aside, see `container`); degree 2 is a dangling edge; equal elements may occur several times.

/// Elements (polygons of any degree ≥ 3, dangling edges of degree 2) as a compressed sparse row structure.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Faces {
    /// Element `f` owns `corners[start[f] .. start[f + 1]]`; never empty: begins with 0.
    pub start: Vec<u32>,
    /// The vertex of each corner, in the orientation of its element.
    pub corners: Vec<u32>,
}

impl Faces {
    /// No elements.
    pub fn new() -> Self {
        Faces { start: vec![0], corners: Vec::new() }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The corners of element `f`.
    #[inline]
    pub fn get(&self, f: u32) -> &[u32] {
        &self.corners[self.start[f as usize] as usize..self.start[f as usize + 1] as usize]
    }

    /// Append an element.
    pub fn push(&mut self, corners: &[u32]) {
        self.corners.extend_from_slice(corners);
        self.start.push(self.corners.len() as u32);
    }

    /// The elements in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u32]> + '_ {
        (0..self.len() as u32).map(|f| self.get(f))
    }
}

/// One level of detail.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Level {
    /// Lattice coordinates, in steps of `2^shift` of the file's lattice.
    pub positions: Vec<[i32; 3]>,
    /// The elements.
    pub faces: Faces,
    /// How many low bits of each coordinate are not known at this level (deferred precision), 0 at the full level.
    pub shift: u8,
}
