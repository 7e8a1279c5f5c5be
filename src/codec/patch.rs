//! The geometry around a vertex that may split, in integers: mean edge, normal, flatness, ring vectors.
//!
//! Lengths are in 1/256 step, unit vectors have length 2^14. Coordinates of a valid level stay within ±2^26, and at most
//! 64 elements are looked at, so that no sum leaves `i64`.

use super::around::{Around, BIG};
use crate::complex::placement::{cross, dot, root, sub, unit};
use crate::complex::{Faces, Level, Star};

/// Elements looked at for geometry.
const LOOK: usize = 64;
/// Elements whose neighbours' elements are counted.
const CROWD: usize = 16;

/// What a segment knows of the coarser level: all of it.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The level.
    pub level: &'a Level,
    /// Its stars.
    pub star: &'a Star,
    /// Its mean edge length (root mean square), in 1/256 step, at least 1.
    pub mean_edge: i64,
}

impl<'a> View<'a> {
    /// Look at a level.
    pub fn new(level: &'a Level, star: &'a Star) -> Self {
        View { level, star, mean_edge: mean_edge(&level.positions, &level.faces) }
    }
}

/// Length of a vector in 1/256 step; the vector within ±2^27.
#[inline(always)]
pub fn length(v: [i64; 3]) -> i64 {
    (root((dot(v, v) as u64) << 8) << 4) as i64
}

/// The root mean square length of (a fixed sample of) the edges of a level, in 1/256 step, at least 1.
pub fn mean_edge(positions: &[[i32; 3]], faces: &Faces) -> i64 {
    let stride = faces.len() / 4096 + 1;
    let (mut sum, mut n) = (0u128, 0u128);
    for f in (0..faces.len()).step_by(stride) {
        let c = faces.get(f as u32);
        let d = sub(positions[c[0] as usize], positions[c[1] as usize]);
        sum += dot(d, d) as u128;
        n += 1;
    }
    let mean = (sum / n.max(1)).min(1 << 55) as u64;
    ((root(mean << 8) << 4) as i64).max(1)
}

/// A vertex and what lies around it. Reused from vertex to vertex.
#[derive(Clone, Debug, Default)]
pub struct Patch {
    /// Its elements.
    pub around: Around,
    /// The vertex itself.
    pub vertex: u32,
    /// How many elements it has.
    pub elements: usize,
    /// The mean number of elements at its neighbours, in 1/4.
    pub crowd: usize,
    /// Where it lies.
    pub at: [i32; 3],
    /// Unit normal, 0 where there is none.
    pub normal: [i64; 3],
    /// Root mean square length of its edges, at least 1.
    pub mean: i64,
    /// Mean distance of its neighbours from its tangent plane.
    pub height: i64,
    /// Ring vectors in the order of `around.ring`; filled by [`Patch::order`].
    pub ring: Vec<[i64; 3]>,
}

impl Patch {
    /// Look around `v`: how many elements it has, how long its edges are, how many elements its neighbours have.
    ///
    /// Of elements of more than [`BIG`] corners the neighbour counts as `v` itself: finding a corner takes as long as there
    /// are corners, and every vertex is surveyed.
    #[inline]
    pub fn survey(&mut self, view: &View, v: u32) {
        let p = &view.level.positions[..];
        let (at, star) = (p[v as usize], view.star.get(v));
        let (mut square, mut crowd) = (0i64, 0u32);
        for (k, &f) in star[..star.len().min(LOOK)].iter().enumerate() {
            let c = view.level.faces.get(f);
            let next = if let &[x, y, z] = c {
                if x == v {
                    y
                } else if y == v {
                    z
                } else {
                    x
                }
            } else if c.len() > BIG {
                v
            } else {
                let i = c.iter().position(|&x| x == v).unwrap_or(0);
                c[if i + 1 == c.len() { 0 } else { i + 1 }]
            };
            let d = sub(p[next as usize], at);
            // Squares of 54 bits, 64 of them at most, with 4 bits dropped.
            square += (dot(d, d) + 15) >> 4;
            if k < CROWD {
                crowd += view.star.start[next as usize + 1] - view.star.start[next as usize];
            }
        }
        self.vertex = v;
        self.at = at;
        self.elements = star.len();
        self.crowd = crowd as usize * 4 / star.len().clamp(1, CROWD);
        // The mean square times 2^12 has its root in 1/64 step.
        let square = square as u64 / star.len().clamp(1, LOOK) as u64;
        self.mean =
            if square < 1 << 46 { (root(square << 16) << 2) as i64 } else { (root(square) << 10) as i64 }.max(1);
    }

    /// Look closer: order the elements, list the ring, find the normal and the height.
    pub fn order(&mut self, view: &View) {
        let p = &view.level.positions[..];
        self.around.gather(&view.level.faces, view.star, self.vertex);
        self.around.order();
        let mut area = [0i64; 3];
        for s in self.around.spokes[..self.around.spokes.len().min(LOOK)].iter() {
            // A dangling edge has no area: next × next.
            let x = cross(sub(p[s.next as usize], self.at), sub(p[s.prev as usize], self.at));
            for k in 0..3 {
                area[k] += x[k];
            }
        }
        self.normal = unit(area);
        self.ring.clear();
        self.ring.extend(self.around.ring.iter().map(|&r| sub(p[r as usize], self.at)));
        let n = self.ring.len().clamp(1, LOOK);
        self.height = self.ring.iter().take(LOOK).map(|&r| dot(r, self.normal).abs() >> 6).sum::<i64>() / n as i64;
    }

    /// Flatness in classes: 0 is flattest; each class is twice as high over the mean edge.
    #[inline]
    pub fn flatness(&self) -> usize {
        let ratio = (self.height << 8) / self.mean;
        // 1/64, 1/32, … of the edge.
        (64 - ((ratio >> 2) as u64).leading_zeros() as usize).min(6)
    }
}
