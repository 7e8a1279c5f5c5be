//! The elements around a vertex in an order that both directions find: fans, loci, neighbours.
//!
//! Core paper section 5.3, and the fans of `docs/design/codec.md`. A star is a *fan* when its elements have degree ≥ 3,
//! every neighbour lies on at most two of them, they agree in orientation and form one cycle (closed) or one path
//! (open). Everything else is *general*.
//!
//! Around a fan, element `i` runs from edge `i` (its next corner after `v`) to edge `i + 1` (its previous corner).

use crate::format::complex::{Faces, Star};

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
pub struct StarElement {
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
pub struct OrderedStar {
    /// Its shape.
    pub shape: Shape,
    /// Its elements: in fan order, or in the order of the star.
    pub spokes: Vec<StarElement>,
    /// The neighbours by edge: in fan order, or in increasing order.
    pub ring: Vec<u32>,
}

impl OrderedStar {
    /// Gather the star of `v` without ordering it.
    pub fn gather(&mut self, faces: &Faces, star: &Star, v: u32) {
        self.spokes.clear();
        self.spokes.extend(star.get(v).iter().enumerate().map(|(place, &f)| {
            let c = faces.get(f);
            let (next, prev) = if c.len() == 3 {
                // Which corner is `v` is anyone's guess, so no branch should depend on it.
                let (second, third) = ((c[1] == v) as usize, (c[2] == v) as usize);
                (c[1 + second - third], c[(2 - 2 * second) - third])
            } else {
                let n = c.len();
                let at = c.iter().position(|&x| x == v).unwrap_or(0);
                (c[if at + 1 == n { 0 } else { at + 1 }], c[if at == 0 { n - 1 } else { at - 1 }])
            };
            StarElement { place: place as u32, degree: c.len() as u32, next, prev }
        }));
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
        // Forwards from the first element of the star, then backwards from it: what is left over belongs to another fan.
        let mut done = 1;
        while done < n {
            let end = s[done - 1].prev;
            let Some(j) = s[done..].iter().position(|x| x.next == end) else { break };
            s.swap(done, done + j);
            done += 1;
        }
        let closed = done == n && s[n - 1].prev == s[0].next;
        if done < n {
            let mut first = s[0].next;
            let mut from = n;
            while from > done {
                let Some(j) = s[done..from].iter().position(|x| x.prev == first) else { return false };
                from -= 1;
                s.swap(from, done + j);
                first = s[from].next;
            }
            s.rotate_right(n - done);
        }
        self.ring.extend(s.iter().map(|x| x.next));
        if !closed {
            self.ring.push(s[n - 1].prev);
        }
        // No neighbour twice.
        if (1..self.ring.len()).any(|i| self.ring[..i].contains(&self.ring[i])) {
            return false;
        }
        self.shape = if closed { Shape::Closed } else { Shape::Open };
        true
    }
}
