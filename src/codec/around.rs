//! The elements around a vertex in an order that both directions find: fans, loci, neighbours.
//!
//! Core paper section 5.3, and the fans of `design.md`. A star is a *fan* when its elements have degree ≥ 3, every neighbour lies on at most
//! two of them, they agree in orientation and form one cycle (closed) or one path (open). Everything else is *general*.
//!
//! Around a fan, element `i` runs from edge `i` (its next corner after `v`) to edge `i + 1` (its previous corner).

use crate::complex::{Faces, Star};

/// Larger fans are coded as general stars: ordering a star costs the square of its size.
pub const MAX_FAN: usize = 48;

/// The shape of a star.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shape {
    /// A cycle of elements: as many edges as elements.
    Closed,
    /// A path of elements: one edge more.
    Open,
    /// Anything else, the empty star included.
    #[default]
    General,
}

/// An element around the vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spoke {
    /// Its place in the star.
    pub place: u32,
    /// Its degree.
    pub degree: u32,
    /// The corner after the vertex.
    pub next: u32,
    /// The corner before it; equal to `next` for a dangling edge.
    pub prev: u32,
}

/// The star of one vertex, ordered. Reused from vertex to vertex.
#[derive(Clone, Debug, Default)]
pub struct Around {
    /// Its shape.
    pub shape: Shape,
    /// Its elements: in fan order, or in the order of the star.
    pub spokes: Vec<Spoke>,
    /// The neighbours by edge: in fan order, or in increasing order.
    pub ring: Vec<u32>,
}

impl Around {
    /// Gather the star of `v` without ordering it.
    #[inline]
    pub fn gather(&mut self, faces: &Faces, star: &Star, v: u32) {
        self.spokes.clear();
        for (place, &f) in star.get(v).iter().enumerate() {
            let c = faces.get(f);
            let n = c.len();
            let (next, prev) = if n == 3 {
                if c[0] == v {
                    (c[1], c[2])
                } else if c[1] == v {
                    (c[2], c[0])
                } else {
                    (c[0], c[1])
                }
            } else {
                let at = c.iter().position(|&x| x == v).unwrap_or(0);
                (c[if at + 1 == n { 0 } else { at + 1 }], c[if at == 0 { n - 1 } else { at - 1 }])
            };
            self.spokes.push(Spoke { place: place as u32, degree: n as u32, next, prev });
        }
    }

    /// Order what [`gather`](Self::gather) found: finds the shape, the fan order and the ring.
    pub fn order(&mut self) {
        self.ring.clear();
        if self.order_fan() {
            return;
        }
        self.shape = Shape::General;
        self.spokes.sort_unstable_by_key(|s| s.place);
        self.ring.clear();
        for s in &self.spokes {
            self.ring.push(s.next);
            self.ring.push(s.prev);
        }
        self.ring.sort_unstable();
        self.ring.dedup();
    }

    fn order_fan(&mut self) -> bool {
        let s = &mut self.spokes[..];
        let n = s.len();
        if n == 0 || n > MAX_FAN || s.iter().any(|x| x.degree < 3) {
            return false;
        }
        // A path starts where no other element ends.
        let mut starts = 0;
        let mut first = 0;
        for i in 0..n {
            let mut ends = 0;
            for j in 0..n {
                ends += (s[j].prev == s[i].next) as u32;
                if j != i && s[j].next == s[i].next {
                    return false;
                }
            }
            if ends > 1 {
                return false;
            }
            if ends == 0 {
                starts += 1;
                first = i;
            }
        }
        if starts > 1 {
            return false;
        }
        s.swap(0, first);
        if starts == 0 {
            // A cycle starts at its first element in the star; `first` is 0 here.
            let lowest = (0..n).min_by_key(|&i| s[i].place).unwrap_or(0);
            s.swap(0, lowest);
        }
        for i in 1..n {
            let Some(j) = (i..n).find(|&j| s[j].next == s[i - 1].prev) else {
                return false;
            };
            s.swap(i, j);
        }
        let closed = s[n - 1].prev == s[0].next;
        if closed != (starts == 0) {
            return false;
        }
        self.shape = if closed { Shape::Closed } else { Shape::Open };
        self.ring.extend(s.iter().map(|x| x.next));
        if !closed {
            let last = s[n - 1].prev;
            if self.ring.contains(&last) {
                return false;
            }
            self.ring.push(last);
        }
        true
    }
}
