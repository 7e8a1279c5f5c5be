//! What a collapse does to seams: the part `w_t` of an edge's weight. CPU twin of the shader `seam_displacement`.
//!
//! Caillaud et al. 2016, section 4.2: `w = w_gc + w_t`, `w_t` being the largest displacement of corners that cannot be matched, in the units of space.
//! A wedge of one end that no wedge of the other meets in an element with both keeps its value while its vertex moves to the midpoint: what
//! it shows moves by half the length of the edge. The same goes for several wedges that become one (a dart). Where all wedges are matched and
//! the edge lies on a seam itself, the seam is a polyline that loses a vertex, as a border does: the ends are measured
//! against the polyline after. An edge between smooth places has no such part.
//!
//! Texture coordinates and labels (materials) count. Normals and colours do not: their seams are creases and
//! patterns that shape and texture tell already, and flat-shaded meshes, all seams, would be weighed by length alone.

use super::edges::EdgeList;
use super::fixed::{Fixed, Scale};
use super::weight::Class;
use crate::format::complex::{Attributes, Faces, NONE, Star};
use rayon::prelude::*;

/// All that the seam part of a weight depends on, flat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeamPatch {
    /// `(b − a) / 2`: relative to the midpoint, `a` lies at `−half` and `b` at `half`.
    pub half: [f32; 3],
    /// Whether some wedge is not matched, or several become one.
    pub torn: bool,
    /// Whether the edge lies on a seam.
    pub on_seam: bool,
    /// Where the seams at the ends go on, relative to the midpoint.
    pub ring: Vec<[f32; 3]>,
}

/// The displacement of seams by a collapse, in lattice steps.
pub fn seam_displacement(patch: &SeamPatch) -> f32 {
    let length = |v: [f32; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if patch.torn {
        return length(patch.half);
    }
    if !patch.on_seam || patch.ring.is_empty() {
        return 0.0;
    }
    let mut worst = 0f32;
    for end in [patch.half.map(|c| -c), patch.half] {
        // To the nearest of the segments from the midpoint, which is 0.
        let nearest = patch.ring.iter().map(|&p| {
            let pp = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
            let ep = end[0] * p[0] + end[1] * p[1] + end[2] * p[2];
            let t = if pp > 0.0 { (ep / pp).clamp(0.0, 1.0) } else { 0.0 };
            length([end[0] - t * p[0], end[1] - t * p[1], end[2] - t * p[2]])
        });
        worst = worst.max(nearest.fold(f32::INFINITY, f32::min));
    }
    worst
}

/// A level as the seams see it.
#[derive(Clone, Copy, Debug)]
pub struct SeamInput<'a> {
    /// The elements.
    pub faces: &'a Faces,
    /// Their stars.
    pub star: &'a Star,
    /// One position for each vertex, as weights read them.
    pub positions: &'a [[f32; 3]],
    /// Its wedges and labels.
    pub attributes: &'a Attributes,
    /// The layers whose seams count.
    pub layers: &'a [usize],
}

/// Reads the seam patches of edges; keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct SeamReader {
    /// Wedges of `a`, then of `b`, with the root of each.
    nodes: Vec<(u32, usize)>,
    joins: Vec<[u32; 2]>,
    /// Neighbours of an end and the wedge of the end beside them.
    beside: Vec<(u32, u32)>,
}

impl SeamInput<'_> {
    /// What stands for the wedge at corner `k` of element `f`: in a layer, or the label.
    #[inline]
    fn wedge(&self, layer: Option<usize>, f: u32, corner: usize) -> u32 {
        match layer {
            Some(l) => self.attributes.layers[l].corner[corner],
            None => self.attributes.labels[f as usize] as u32,
        }
    }

    fn columns(&self) -> impl Iterator<Item = Option<usize>> + '_ {
        let labels = (!self.attributes.labels.is_empty()).then_some(None);
        self.layers.iter().map(|&l| Some(l)).chain(labels)
    }

    /// Whether more than one wedge, or label, is at a vertex.
    fn is_seam(&self, v: u32) -> bool {
        self.columns().any(|layer| {
            let mut first = None;
            self.star.get(v).iter().any(|&f| {
                let w = self.wedge(layer, f, self.corner(f, v));
                *first.get_or_insert(w) != w
            })
        })
    }

    #[inline]
    fn corner(&self, f: u32, v: u32) -> usize {
        self.faces.start[f as usize] as usize + self.faces.get(f).iter().position(|&x| x == v).unwrap_or(0)
    }
}

/// Stars with more elements than this are not looked at: their edges count as torn.
const MOST: usize = 1024;

impl SeamReader {
    /// Read the patch of edge `(a, b)`.
    pub fn read(&mut self, input: &SeamInput, a: u32, b: u32, patch: &mut SeamPatch) {
        let (pa, pb) = (input.positions[a as usize], input.positions[b as usize]);
        patch.half = std::array::from_fn(|k| (pb[k] - pa[k]) * 0.5);
        let middle: [f32; 3] = std::array::from_fn(|k| (pa[k] + pb[k]) * 0.5);
        (patch.torn, patch.on_seam) = (false, false);
        patch.ring.clear();
        if input.star.get(a).len() + input.star.get(b).len() > MOST {
            patch.torn = true;
            return;
        }
        for layer in input.columns() {
            self.nodes.clear();
            self.joins.clear();
            for (v, other) in [(a, b), (b, a)] {
                let from = self.nodes.len();
                self.beside.clear();
                for &f in input.star.get(v) {
                    let names = input.faces.get(f);
                    let at = names.iter().position(|&x| x == v).unwrap_or(0);
                    let first = input.faces.start[f as usize] as usize;
                    let w = input.wedge(layer, f, first + at);
                    if w == NONE {
                        continue;
                    }
                    if !self.nodes[from..].iter().any(|n| n.0 == w) {
                        self.nodes.push((w, self.nodes.len()));
                    }
                    let n = names.len();
                    self.beside.push((names[if at + 1 == n { 0 } else { at + 1 }], w));
                    self.beside.push((names[if at == 0 { n - 1 } else { at - 1 }], w));
                    if v == a
                        && let Some(k) = names.iter().position(|&x| x == other)
                    {
                        self.joins.push([w, input.wedge(layer, f, first + k)]);
                    }
                }
                // Where a seam goes on: a neighbour with two wedges of this end beside it.
                self.beside.sort_unstable();
                self.beside.dedup();
                for pair in self.beside.windows(2) {
                    if pair[0].0 == pair[1].0 {
                        if pair[0].0 == other {
                            patch.on_seam = true;
                        } else {
                            let p = input.positions[pair[0].0 as usize];
                            patch.ring.push(std::array::from_fn(|k| p[k] - middle[k]));
                        }
                    }
                }
                if v == a {
                    // What follows is numbered apart.
                    self.nodes.push((NONE, usize::MAX));
                }
            }
            patch.torn |= self.is_torn();
        }
    }

    /// Whether the wedges of both ends do anything but meet in pairs.
    fn is_torn(&mut self) -> bool {
        let Some(wall) = self.nodes.iter().position(|n| n.0 == NONE) else { return false };
        if wall == 0 || wall + 1 == self.nodes.len() {
            return false;
        }
        self.joins.sort_unstable();
        self.joins.dedup();
        // As many pairs as wedges on either side, and no wedge in two of them.
        let (ends, pairs) = ([wall, self.nodes.len() - wall - 1], self.joins.len());
        if ends != [pairs, pairs] {
            return true;
        }
        let twice = |side: usize| (1..pairs).any(|i| self.joins[..i].iter().any(|j| j[side] == self.joins[i][side]));
        twice(0) || twice(1)
    }
}

/// Add the displacement of seams to the weights of ordinary edges. `weights` are those of `edges`, without it; what is raised is left out of
/// means, as folds are.
pub fn add_seams(input: &SeamInput, edges: &EdgeList, scale: &Scale, weights: &mut [Fixed]) {
    let n = edges.vertices();
    if input.columns().next().is_none() || n == 0 {
        return;
    }
    let seam: Vec<bool> = (0..n as u32).into_par_iter().with_min_len(1 << 12).map(|v| input.is_seam(v)).collect();
    if !seam.contains(&true) {
        return;
    }
    let mut tasks = Vec::new();
    let mut rest = weights;
    for from in (0..n).step_by(1 << 11) {
        let to = (from + (1 << 11)).min(n);
        let count = edges.from(to as u32 - 1).end - edges.from(from as u32).start;
        let (part, later) = rest.split_at_mut(count);
        tasks.push((from as u32..to as u32, part));
        rest = later;
    }
    tasks.into_par_iter().for_each_init(<(SeamReader, SeamPatch)>::default, |(reader, patch), (vertices, part)| {
        let mut part = part.iter_mut();
        for a in vertices {
            for &b in edges.larger(a) {
                let Some(w) = part.next() else { return };
                if w.class() == Class::Ordinary && (seam[a as usize] || seam[b as usize]) {
                    reader.read(input, a, b, patch);
                    *w = w.raised(scale, seam_displacement(patch));
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::complex::Wedges;

    /// A grid of 5 by 4 vertices in quads, the middle column of which is a seam between two charts.
    fn grid() -> (Faces, Vec<[f32; 3]>, Attributes) {
        let mut faces = Faces::new();
        let mut corner = Vec::new();
        for y in 0..3 {
            for x in 0..4u32 {
                let v = y * 5 + x;
                faces.push(&[v, v + 1, v + 6, v + 5]);
                // One wedge a vertex and chart.
                let chart = 20 * u32::from(x >= 2);
                corner.extend([v, v + 1, v + 6, v + 5].map(|v| v + chart));
            }
        }
        let positions = (0..20).map(|v| [(v % 5) as f32, (v / 5) as f32, 0.0]).collect();
        let layer = Wedges { width: 1, corner, values: vec![0; 40] };
        (faces, positions, Attributes { layers: vec![layer], labels: Vec::new() })
    }

    fn of(a: u32, b: u32, bend: f32) -> (SeamPatch, f32) {
        let (faces, mut positions, attributes) = grid();
        positions[7][0] += bend;
        let star = Star::build(20, &faces);
        let input =
            SeamInput { faces: &faces, star: &star, positions: &positions, attributes: &attributes, layers: &[0] };
        let mut patch = SeamPatch::default();
        SeamReader::default().read(&input, a, b, &mut patch);
        let d = seam_displacement(&patch);
        (patch, d)
    }

    #[test]
    fn what_crosses_a_seam_is_torn_and_what_follows_it_is_not() {
        // Off the seam.
        assert_eq!(of(5, 6, 0.0).1, 0.0);
        // From the left chart onto the seam: the right chart's corner stays behind.
        let (patch, d) = of(6, 7, 0.0);
        assert!(patch.torn);
        assert_eq!(d, 0.5);
        // Along a straight seam.
        let (patch, d) = of(7, 12, 0.0);
        assert!(!patch.torn && patch.on_seam);
        assert_eq!(d, 0.0);
        // Along one with a bend.
        let d = of(7, 12, 0.5).1;
        assert!(d > 0.2 && d < 0.5, "{d}");
    }

    #[test]
    fn a_dart_is_torn_at_its_tip() {
        let (faces, positions, mut attributes) = grid();
        // The seam ends at vertex 7: there, both charts have one wedge.
        for w in &mut attributes.layers[0].corner {
            if *w == 27 {
                *w = 7;
            }
        }
        let star = Star::build(20, &faces);
        let input =
            SeamInput { faces: &faces, star: &star, positions: &positions, attributes: &attributes, layers: &[0] };
        let mut patch = SeamPatch::default();
        SeamReader::default().read(&input, 2, 7, &mut patch);
        assert!(patch.torn);
    }

    #[test]
    fn materials_count_as_seams() {
        let (faces, positions, mut attributes) = grid();
        attributes.labels = (0..12).map(|f| u16::from(f % 4 >= 2)).collect();
        attributes.layers.clear();
        let star = Star::build(20, &faces);
        let input =
            SeamInput { faces: &faces, star: &star, positions: &positions, attributes: &attributes, layers: &[] };
        let mut patch = SeamPatch::default();
        SeamReader::default().read(&input, 6, 7, &mut patch);
        assert!(patch.torn);
        SeamReader::default().read(&input, 7, 12, &mut patch);
        assert!(!patch.torn && patch.on_seam);
    }
}
