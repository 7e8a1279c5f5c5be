//! The geometry around a vertex that may split, in integers: mean edge, normal, flatness, ring vectors.
//!
//! Lengths are in 1/256 step, unit vectors have length 2^14. Coordinates of a valid level stay within ±2^26, and at most
//! 64 elements are looked at, so that no sum leaves `i64`.

use crate::format::complex::placement::{cross, dot, root, sub, unit};
use crate::format::complex::{Attributes, Faces, Level, Scheme, Star};
use crate::format::split::fan::OrderedStar;

/// Elements looked at for geometry.
const LOOK: usize = 64;
/// Elements whose neighbours' elements are counted.
const CROWD: usize = 16;

/// Bounds of the classes of lengths of the edges around a vertex, in 1/32 of the level's mean.
const BOUNDS: [u128; 9] = [16, 21, 25, 29, 33, 38, 44, 52, 64];

/// What a segment knows of the coarser level: all of it.
#[derive(Clone, Copy, Debug)]
pub struct LevelGeometry<'a> {
    /// The level.
    pub level: &'a Level,
    /// Its stars, with what follows in each element.
    pub star: &'a Star,
    /// For each number of edges the sum of squares from which on they count as so long: every vertex is surveyed, so that
    /// nothing should be divided there, and no root be taken.
    limits: [[u64; BOUNDS.len()]; LOOK + 1],
    /// Its attributes.
    pub attributes: &'a Attributes,
    /// What holds for those of the file.
    pub scheme: &'a Scheme,
}

static BARE: Attributes = Attributes { layers: Vec::new(), labels: Vec::new() };
static NO_LAYERS: Scheme = Scheme { widths: Vec::new(), presence: Vec::new() };

impl<'a> LevelGeometry<'a> {
    /// Look at a level without attributes.
    pub fn new(level: &'a Level, star: &'a Star) -> Self {
        LevelGeometry::with(level, star, &BARE, &NO_LAYERS)
    }

    /// Look at a level with attributes.
    pub fn with(level: &'a Level, star: &'a Star, attributes: &'a Attributes, scheme: &'a Scheme) -> Self {
        let mean = mean_edge(&level.positions, &level.faces) as u128;
        // Square of the bound, in 1/2^26 square step; 2^63 steps at most.
        let limit = |n: usize, b: u128| (n as u128 * (b * mean) * (b * mean)).div_ceil(1 << 26) as u64;
        LevelGeometry { level, star, limits: std::array::from_fn(|n| BOUNDS.map(|b| limit(n, b))), attributes, scheme }
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
pub struct Neighbourhood {
    /// Its elements.
    pub around: OrderedStar,
    /// The vertex itself.
    pub vertex: u32,
    /// How many elements it has.
    pub elements: usize,
    /// How many elements its neighbours have, summed over its first [`CROWD`] elements.
    crowd: usize,
    /// Sum of the squares of its edges.
    square: u64,
    /// Where it lies.
    pub at: [i32; 3],
    /// Unit normal, 0 where there is none.
    pub normal: [i64; 3],
    /// Root mean square length of its edges, at least 1; filled by [`Neighbourhood::order`].
    pub mean: i64,
    /// Mean distance of its neighbours from its tangent plane.
    pub height: i64,
    /// Ring vectors in the order of `around.ring`; filled by [`Neighbourhood::order`].
    pub ring: Vec<[i64; 3]>,
}

impl Neighbourhood {
    /// Look around `v`: how many elements it has, how long its edges are, how many elements its neighbours have.
    ///
    /// Of elements of more than [`BIG`](crate::format::complex::BIG) corners the neighbour counts as `v` itself: finding a corner takes as long as there
    /// are corners, and every vertex is surveyed.
    #[inline]
    pub fn survey(&mut self, view: &LevelGeometry, v: u32) {
        let p = &view.level.positions[..];
        let (at, star) = (p[v as usize], view.star.get(v));
        let (mut square, mut crowd) = (0i64, 0u32);
        let nexts = view.star.next(v);
        for (k, &next) in nexts[..nexts.len().min(LOOK)].iter().enumerate() {
            let d = sub(p[next as usize], at);
            // Squares of 56 bits, 64 of them at most.
            square += dot(d, d);
            if k < CROWD {
                crowd += view.star.start[next as usize + 1] - view.star.start[next as usize];
            }
        }
        self.vertex = v;
        self.at = at;
        self.elements = star.len();
        self.crowd = crowd as usize;
        self.square = square as u64;
    }

    /// How long the edges are over the mean of the level, in ten classes.
    #[inline]
    pub fn long(&self, view: &LevelGeometry) -> usize {
        view.limits[self.elements.min(LOOK)].iter().map(|&limit| (self.square >= limit) as usize).sum()
    }

    /// How many elements the neighbours have, in four classes: 21/4, 24/4 and 26/4 begin the next.
    #[inline]
    pub fn near(&self) -> usize {
        let n = self.elements.min(CROWD);
        [21, 24, 26].into_iter().map(|bound| (4 * self.crowd >= bound * n) as usize).sum()
    }

    /// Look closer: order the elements, list the ring, find the normal and the height.
    pub fn order(&mut self, view: &LevelGeometry) {
        let p = &view.level.positions[..];
        self.around.gather(&view.level.faces, view.star, self.vertex);
        let square = self.square / self.elements.clamp(1, LOOK) as u64;
        self.mean = if square < 1 << 40 { root(square << 16) } else { root(square << 8) << 4 }.max(1) as i64;
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
