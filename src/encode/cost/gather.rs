//! From a level to the flat patch of an edge: stars, fans of triangles, and what connectivity alone says of the class.

use super::weight::{Class, Patch, PatchTriangle, RingVertex};
use crate::format::complex::{Faces, Star};

/// No place in a list.
const NOWHERE: u16 = u16::MAX;
/// Stars with more corners than this are not weighed: an edge at such a hub is illegal until enough of its neighbours
/// have gone. A batch can take one edge of a hub, yet would have to weigh all of them anew, which is quadratic.
const MOST: usize = 8192;
/// Stars with more corners than this number their vertices through a hash table.
const FEW: usize = 64;

/// An element around the apex of a side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Element {
    /// Its fan owns `fans[from .. to]` of the side.
    pub(crate) from: u32,
    pub(crate) to: u32,
    /// Places of the corners after and before the apex.
    pub(crate) next: u16,
    pub(crate) previous: u16,
}

/// The star of one vertex, with its vertices numbered locally.
#[derive(Clone, Debug, Default)]
pub(crate) struct Side {
    /// Every other vertex of the star, once.
    pub(crate) vertices: Vec<u32>,
    pub(crate) positions: Vec<[f32; 3]>,
    /// How many faces have the edge from the apex to the vertex.
    pub(crate) faces: Vec<u32>,
    /// How many dangling edges are that edge.
    pub(crate) strings: Vec<u32>,
    pub(crate) elements: Vec<Element>,
    /// Fan triangles: places of the two other corners, in the orientation of the element.
    pub(crate) fans: Vec<[u16; 2]>,
    /// Vertices that some polygon holds in corners not next to the apex (a vertex may be near by another element).
    pub(crate) far: Vec<u16>,
    pub(crate) polygons: bool,
    /// Some face edge at the apex has exactly one face.
    pub(crate) border: bool,
    pub(crate) too_large: bool,
    /// Places plus one by hash of the vertex, open addressing; empty where the star is small.
    table: Vec<u16>,
}

impl Side {
    /// Read the star of `apex`.
    #[inline(always)]
    pub(crate) fn read(&mut self, faces: &Faces, star: &Star, positions: &[[f32; 3]], apex: u32) {
        self.vertices.clear();
        self.positions.clear();
        self.faces.clear();
        self.strings.clear();
        self.elements.clear();
        self.fans.clear();
        self.far.clear();
        self.polygons = false;
        self.table.clear();
        let corners: usize = star.get(apex).iter().map(|&f| faces.get(f).len()).sum();
        self.too_large = corners > MOST;
        if self.too_large {
            return;
        }
        if corners > FEW {
            self.table.resize((2 * corners).next_power_of_two(), 0);
        }
        for &f in star.get(apex) {
            let element = faces.get(f);
            let from = self.fans.len() as u32;
            let (next, previous);
            match *element {
                [x, y, z] => {
                    let (p, q) = if x == apex {
                        (y, z)
                    } else if y == apex {
                        (z, x)
                    } else {
                        (x, y)
                    };
                    next = self.place(positions, p);
                    previous = self.place(positions, q);
                    self.faces[next as usize] += 1;
                    self.faces[previous as usize] += 1;
                    self.fans.push([next, previous]);
                }
                [x, y] => {
                    next = self.place(positions, if x == apex { y } else { x });
                    previous = next;
                    self.strings[next as usize] += 1;
                    self.fans.push([next, next]);
                }
                _ => {
                    self.polygons = true;
                    let Some(at) = element.iter().position(|&x| x == apex) else { continue };
                    let mut others = element[at + 1..].iter().chain(&element[..at]);
                    let Some(&first) = others.next() else { continue };
                    next = self.place(positions, first);
                    let mut last = next;
                    for &x in others {
                        let place = self.place(positions, x);
                        if last != next {
                            self.far.push(last);
                        }
                        self.fans.push([last, place]);
                        last = place;
                    }
                    previous = last;
                    self.faces[next as usize] += 1;
                    self.faces[previous as usize] += 1;
                }
            }
            self.elements.push(Element { from, to: self.fans.len() as u32, next, previous });
        }
        self.border = self.faces.contains(&1);
    }

    /// Where the table holds `x`, or would.
    fn slot(&self, x: u32) -> usize {
        let mask = self.table.len() - 1;
        let mut slot = (x.wrapping_mul(0x9e37_79b1) >> 7) as usize & mask;
        while let Some(at) = (self.table[slot] as usize).checked_sub(1)
            && self.vertices[at] != x
        {
            slot = (slot + 1) & mask;
        }
        slot
    }

    /// The place of a vertex, if the star has it.
    #[inline(always)]
    fn find(&self, x: u32) -> Option<u16> {
        if self.table.is_empty() {
            return self.vertices.iter().position(|&y| y == x).map(|at| at as u16);
        }
        self.table[self.slot(x)].checked_sub(1)
    }

    /// The local number of a vertex of the star, given to it here if it has none.
    #[inline(always)]
    fn place(&mut self, positions: &[[f32; 3]], x: u32) -> u16 {
        if let Some(at) = self.find(x) {
            return at;
        }
        if !self.table.is_empty() {
            let slot = self.slot(x);
            self.table[slot] = self.vertices.len() as u16 + 1;
        }
        self.vertices.push(x);
        self.positions.push(positions[x as usize]);
        self.faces.push(0);
        self.strings.push(0);
        (self.vertices.len() - 1) as u16
    }
}

/// Stars that are kept: a vertex is read once as larger end and taken from here for its other edges.
const KEPT: usize = 256;

/// Makes patches of edges; keeps the stars it read last, so go through edges in their order.
#[derive(Clone, Debug)]
pub struct Gatherer {
    a: Option<u32>,
    side_a: Side,
    /// Stars of larger ends, each in the slot that its low bits say.
    kept: Vec<(Option<u32>, Side)>,
    /// From places in a side to places in the ring.
    map_a: Vec<u16>,
    map_b: Vec<u16>,
    /// For each ring vertex: elements with its edge to `a`, to `b`, and triangles `(a, b, x)`.
    counts: Vec<[u32; 3]>,
}

impl Default for Gatherer {
    fn default() -> Self {
        Gatherer {
            a: None,
            side_a: Side::default(),
            kept: vec![(None, Side::default()); KEPT],
            map_a: Vec::new(),
            map_b: Vec::new(),
            counts: Vec::new(),
        }
    }
}

impl Gatherer {
    /// Nothing read yet.
    pub fn new() -> Self {
        Gatherer::default()
    }

    /// Read the patch of the edge `{a, b}` of a level into `patch`. `positions` are in lattice steps relative to some
    /// integer anchor; the patch subtracts its own. All reads between two calls of [`forget`](Self::forget) must be of one level.
    ///
    /// Gives a patch of [`Class::Illegal`] with nothing else set where the two share no edge, or an element holds
    /// both in other than consecutive corners.
    #[inline(always)]
    pub fn read(&mut self, faces: &Faces, star: &Star, positions: &[[f32; 3]], a: u32, b: u32, patch: &mut Patch) {
        patch.class = Class::Illegal;
        patch.ring.clear();
        patch.triangles.clear();
        patch.vanishing.clear();
        patch.borders = false;
        if self.a != Some(a) {
            let (of, side) = &mut self.kept[a as usize % KEPT];
            if *of == Some(a) {
                std::mem::swap(&mut self.side_a, side);
                *of = None;
            } else {
                self.side_a.read(faces, star, positions, a);
            }
            self.a = Some(a);
        }
        let Some(b_in_a) = self.side_a.find(b) else { return };
        let (ab_faces, ab_strings) = (self.side_a.faces[b_in_a as usize], self.side_a.strings[b_in_a as usize]);
        if self.side_a.too_large || ab_faces + ab_strings == 0 || self.side_a.far.contains(&b_in_a) {
            return;
        }
        let (of, side_b) = &mut self.kept[b as usize % KEPT];
        if *of != Some(b) {
            side_b.read(faces, star, positions, b);
            *of = Some(b);
        }
        if side_b.too_large {
            return;
        }
        patch.polygons = self.side_a.polygons | side_b.polygons;

        let (pa, pb) = (positions[a as usize], positions[b as usize]);
        let half = [0.5 * (pb[0] - pa[0]), 0.5 * (pb[1] - pa[1]), 0.5 * (pb[2] - pa[2])];
        patch.half = half;
        self.join(a, b, pa, half, patch);
        self.fans(a, b, b_in_a, patch);
        patch.border_ab = ab_faces + ab_strings == 1;
        patch.class = self.classify(b, ab_faces, patch);
    }

    /// Forget the star of the last edge: the level has changed.
    pub fn forget(&mut self) {
        self.a = None;
        self.kept.iter_mut().for_each(|(of, _)| *of = None);
    }

    /// Unite the vertices of both sides into the ring, relative to the midpoint.
    #[inline(always)]
    fn join(&mut self, a: u32, b: u32, pa: [f32; 3], half: [f32; 3], patch: &mut Patch) {
        self.map_a.clear();
        self.map_b.clear();
        self.counts.clear();
        let at = |p: [f32; 3]| RingVertex {
            at: [p[0] - pa[0] - half[0], p[1] - pa[1] - half[1], p[2] - pa[2] - half[2]],
            ..RingVertex::default()
        };
        let side = &self.side_a;
        for (i, &x) in side.vertices.iter().enumerate() {
            if x == b {
                self.map_a.push(NOWHERE);
                continue;
            }
            self.map_a.push(patch.ring.len() as u16);
            patch.ring.push(at(side.positions[i]));
            self.counts.push([side.faces[i] + side.strings[i], 0, 0]);
        }
        let other = &self.kept[b as usize % KEPT].1;
        for (i, &x) in other.vertices.iter().enumerate() {
            if x == a {
                self.map_b.push(NOWHERE);
                continue;
            }
            let count = other.faces[i] + other.strings[i];
            if let Some(known) = side.find(x) {
                let place = self.map_a[known as usize];
                self.map_b.push(place);
                self.counts[place as usize][1] = count;
                continue;
            }
            self.map_b.push(patch.ring.len() as u16);
            patch.ring.push(at(other.positions[i]));
            self.counts.push([0, count, 0]);
        }
    }

    /// List the triangles of the patch: all fans at `a`, and the fans at `b` of the elements without `a`.
    #[inline(always)]
    fn fans(&mut self, a: u32, b: u32, b_in_a: u16, patch: &mut Patch) {
        let side = &self.side_a;
        for e in &side.elements {
            let fans = &side.fans[e.from as usize..e.to as usize];
            let mut continues = false;
            for &[p, q] in fans {
                if p == b_in_a || q == b_in_a {
                    if p != q {
                        let x = self.map_a[if p == b_in_a { q } else { p } as usize];
                        patch.vanishing.push((x, q == b_in_a));
                        let r = &mut patch.ring[x as usize];
                        (r.spoke_a, r.spoke_b) = (true, true);
                        if fans.len() == 1 {
                            self.counts[x as usize][2] += 1;
                        }
                    }
                    continue;
                }
                let (p, q) = (self.map_a[p as usize], self.map_a[q as usize]);
                patch.ring[p as usize].spoke_a = true;
                patch.ring[q as usize].spoke_a = true;
                patch.triangles.push(PatchTriangle { p, q, at_b: false, continues });
                continues = true;
            }
        }
        let side = &self.kept[b as usize % KEPT].1;
        let a_in_b = side.find(a).unwrap_or(NOWHERE);
        for e in &side.elements {
            // An element with both ends has them in consecutive corners, or the edge is illegal.
            if e.next == a_in_b || e.previous == a_in_b {
                continue;
            }
            let mut continues = false;
            for &[p, q] in &side.fans[e.from as usize..e.to as usize] {
                let (p, q) = (self.map_b[p as usize], self.map_b[q as usize]);
                patch.ring[p as usize].spoke_b = true;
                patch.ring[q as usize].spoke_b = true;
                patch.triangles.push(PatchTriangle { p, q, at_b: true, continues });
                continues = true;
            }
        }
    }

    /// What connectivity says of the class; marks borders in the ring on the way.
    #[inline(always)]
    fn classify(&self, b: u32, ab_faces: u32, patch: &mut Patch) -> Class {
        if ab_faces == 0 {
            return Class::Dangling;
        }
        let mut breaks = ab_faces > 1 && self.side_a.border && self.kept[b as usize % KEPT].1.border;
        for (r, &[at_a, at_b, triangles]) in patch.ring.iter_mut().zip(&self.counts) {
            // A triangle (a, b, x) is counted at both ends and leaves both.
            let after = at_a + at_b - 2 * triangles;
            if triangles > 0 {
                breaks |= after == 0;
            } else {
                breaks |= at_a > 0 && at_b > 0;
            }
            (r.border_a, r.border_b, r.border_after) = (at_a == 1, at_b == 1, after == 1);
            patch.borders |= r.border_a | r.border_b | r.border_after;
        }
        if breaks { Class::Breaking } else { Class::Ordinary }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch_of(positions: usize, elements: &[&[u32]], a: u32, b: u32) -> Patch {
        let mut faces = Faces::new();
        for e in elements {
            faces.push(e);
        }
        let star = Star::build(positions, &faces);
        let points: Vec<[f32; 3]> = (0..positions).map(|i| [i as f32, (i * i) as f32, 0.5]).collect();
        let mut patch = Patch::default();
        Gatherer::new().read(&faces, &star, &points, a, b, &mut patch);
        patch
    }

    #[test]
    fn a_lone_triangle_leaves_a_dangling_edge() {
        assert_eq!(patch_of(3, &[&[0, 1, 2]], 0, 1).class, Class::Breaking);
        // The same triangle twice: neither keeps the edge to the apex.
        assert_eq!(patch_of(3, &[&[0, 1, 2], &[2, 1, 0]], 0, 1).class, Class::Breaking);
        // A dangling edge beside it holds the edge.
        assert_eq!(patch_of(3, &[&[0, 1, 2], &[0, 2]], 0, 1).class, Class::Ordinary);
    }

    #[test]
    fn a_polygon_is_ordinary_along_its_side_and_illegal_across() {
        assert_eq!(patch_of(4, &[&[0, 1, 2, 3]], 0, 1).class, Class::Ordinary);
        assert_eq!(patch_of(4, &[&[0, 1, 2, 3]], 0, 2).class, Class::Illegal);
        // An edge elsewhere does not make it legal.
        assert_eq!(patch_of(5, &[&[0, 1, 2, 3], &[0, 2, 4]], 0, 2).class, Class::Illegal);
        assert_eq!(patch_of(5, &[&[0, 1, 2, 3]], 0, 4).class, Class::Illegal);
    }

    #[test]
    fn dangling_edges_and_the_link_condition() {
        assert_eq!(patch_of(3, &[&[0, 1], &[1, 2]], 0, 1).class, Class::Dangling);
        // A hole of three edges would close.
        let ring: &[&[u32]] = &[&[0, 1, 3], &[1, 2, 4], &[2, 0, 5]];
        assert_eq!(patch_of(6, ring, 0, 1).class, Class::Breaking);
        // An inner edge between two borders: a strip of four triangles would be pinched.
        let strip: &[&[u32]] = &[&[0, 1, 2], &[2, 1, 3], &[2, 3, 4], &[4, 3, 5]];
        assert_eq!(patch_of(6, strip, 2, 3).class, Class::Breaking);
        assert_eq!(patch_of(6, strip, 2, 4).class, Class::Ordinary);
    }
}
