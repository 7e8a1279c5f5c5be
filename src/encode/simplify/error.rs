//! The error of a level: an upper bound of its distance to the input, kept per vertex.
//!
//! A point of a level lies on an element and is, within the largest bound of that element's vertices, at a point of the
//! input; and the other way round for the points of the input that lie nearest to that element. Three things move a level:
//! - precision that is deferred moves every vertex by less than half the diagonal of its cell;
//! - a collapse moves its patch by at most the bound of `metric::bound`; the merged vertex takes that plus the largest
//!   bound of the patch, so that every element of the patch after, which names it, is covered;
//! - an isolated vertex that leaves is told by the nearest vertex that stays.
//!
//! Displayed positions are meant: the middle of the cell. Polygons of more than three corners are what `metric::bound` says:
//! the triangles between their edges and the mean of their corners.

use super::nearest::Nearest;
use crate::encode::cost::{BoundScratch, Class, Gatherer, Patch, hausdorff_between, hausdorff_bound};
use crate::format::complex::{Coarsened, Level, NONE, Star};
use rayon::prelude::*;

/// Splits that one task bounds.
const CHUNK: usize = 512;

/// Bounds of the coarser level's vertices, in steps of the full level, from those of the finer level.
pub fn bound_errors(c: &Coarsened, fine: &Level, star: &Star, error: &[f32], anchor: [i32; 3]) -> Vec<f32> {
    let shift = c.level.shift as u32;
    let down = shift - fine.shift as u32;
    let half = ((1u32 << shift) - 1) as f32 / 2.0;
    let show = |p: [i32; 3]| -> [f32; 3] { std::array::from_fn(|k| ((p[k] << shift) - anchor[k]) as f32 + half) };
    // Half the diagonal between the middles of the cells before and after.
    let drop =
        if down > 0 { 3f32.sqrt() * ((1u32 << shift) - (1u32 << fine.shift)) as f32 / 2.0 * 1.000_001 } else { 0.0 };
    let shown: Vec<[f32; 3]> = fine.positions.iter().map(|p| show(p.map(|x| x >> down))).collect();
    // Coordinates that `f32` rounds: both patches may be off by a unit in the last place.
    let largest = shown.iter().flatten().fold(0f32, |m, x| m.max(x.abs()));
    let rounding = if largest < (1 << 22) as f32 { 0.0 } else { largest * f32::EPSILON * 4.0 };
    let mut out = vec![0f32; c.level.positions.len()];
    for (v, &w) in c.vertex.iter().enumerate() {
        if w != NONE {
            out[w as usize] = out[w as usize].max(error[v] + drop);
        }
    }
    let stands = out.iter().fold(0f32, |a, &b| a.max(b));
    let bounds: Vec<f32> = c
        .pairs
        .par_chunks(CHUNK)
        .enumerate()
        .map_init(
            <(Gatherer, Patch, BoundScratch, Pieces)>::default,
            |(gatherer, patch, scratch, pieces), (chunk, pairs)| {
                gatherer.forget();
                let around = |a, b| star.get(a).iter().chain(star.get(b)).map(|&f| fine.faces.get(f));
                let mut list = Vec::with_capacity(pairs.len());
                for (i, &[a, b]) in pairs.iter().enumerate() {
                    let v = c.batch.vertex[chunk * CHUNK + i];
                    let (pa, pb, pv) = (shown[a as usize], shown[b as usize], show(c.level.positions[v as usize]));
                    let to_v: [f64; 3] = std::array::from_fn(|k| pv[k] as f64 - (pa[k] as f64 + pb[k] as f64) / 2.0);
                    let worst = around(a, b).flatten().map(|&x| error[x as usize]).fold(0f32, f32::max);
                    // A bound far below what stands already need not be sharp, nor one that leaves half the way up to it.
                    let enough = (stands / 16.0).max((stands - worst - drop) / 2.0) as f64;
                    gatherer.read(&fine.faces, star, &shown, a, b, patch);
                    let moved = if patch.polygons {
                        pieces.bound([pa, pb, pv], || around(a, b), c, v, &shown, enough, scratch)
                    } else if patch.class == Class::Illegal {
                        let reach =
                            |p: [f32; 3]| (0..3).map(|k| (pv[k] - p[k]) as f64).map(|d| d * d).sum::<f64>().sqrt();
                        reach(pa).max(reach(pb)) * 1.000_001
                    } else {
                        hausdorff_bound(patch, to_v, enough, scratch)
                    };
                    list.push((worst + drop + moved as f32 + rounding) * 1.000_001);
                }
                list
            },
        )
        .collect::<Vec<_>>()
        .concat();
    for (&v, bound) in c.batch.vertex.iter().zip(bounds) {
        out[v as usize] = out[v as usize].max(bound);
    }
    occupancy_known(c, error, drop, &mut out);
    out
}

/// The triangles of a patch with polygons before and after, relative to the merged vertex.
#[derive(Default)]
struct Pieces {
    before: Vec<[V; 3]>,
    after: Vec<[V; 3]>,
    corners: Vec<V>,
}

type V = [f64; 3];

fn distance(a: V, b: V) -> f64 {
    (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>().sqrt()
}

/// Append the triangles of the element with these corners. Returns the mean of the corners.
fn append(corners: &[V], to: &mut Vec<[V; 3]>) -> V {
    let n = corners.len();
    let mean: V = std::array::from_fn(|k| corners.iter().map(|p| p[k]).sum::<f64>() / n.max(1) as f64);
    match *corners {
        [p, q] => to.push([p, q, q]),
        [p, q, r] => to.push([p, q, r]),
        _ => to.extend((0..n).map(|i| [mean, corners[i], corners[(i + 1) % n]])),
    }
    mean
}

impl Pieces {
    /// The bound for the elements `around` the ends at `pa` and `pb` of a collapse to the vertex `v` of the coarser level, at `pv`.
    #[allow(clippy::too_many_arguments)] // called from one place
    fn bound<'a, I: Iterator<Item = &'a [u32]>>(
        &mut self,
        [pa, pb, pv]: [[f32; 3]; 3],
        around: impl Fn() -> I,
        c: &Coarsened,
        v: u32,
        shown: &[[f32; 3]],
        enough: f64,
        scratch: &mut BoundScratch,
    ) -> f64 {
        let Pieces { before, after, corners } = self;
        before.clear();
        after.clear();
        let at = |p: [f32; 3]| -> V { std::array::from_fn(|k| p[k] as f64 - pv[k] as f64) };
        // Where every point is carried along with its corners, and the mean of a polygon with its mean.
        let mut motion = distance(at(pa), [0.0; 3]).max(distance(at(pb), [0.0; 3]));
        for element in around() {
            corners.clear();
            corners.extend(element.iter().map(|&x| at(shown[x as usize])));
            let mean = append(corners, before);
            // The same element after: its ends have become `v`, which it names once.
            let mut merged = false;
            corners.clear();
            for &x in element {
                if c.vertex[x as usize] != v {
                    corners.push(at(shown[x as usize]));
                } else if !std::mem::replace(&mut merged, true) {
                    corners.push([0.0; 3]);
                }
            }
            if corners.len() < 2 {
                continue;
            }
            let mean_after = append(corners, after);
            if element.len() > 3 {
                motion = motion.max(distance(mean, mean_after));
            }
        }
        hausdorff_between(before, after, motion, enough, scratch)
    }
}

/// Points that left: the nearest vertex that stays takes their bound and its distance.
fn occupancy_known(c: &Coarsened, error: &[f32], drop: f32, out: &mut [f32]) {
    if c.new_vertices.is_empty() || out.is_empty() {
        return;
    }
    let shift = c.level.shift as u32;
    let tree = Nearest::new(&c.level.positions);
    let nearest: Vec<Option<(i64, u32)>> = c.batch.new_vertices.par_iter().map(|&p| tree.of(p)).collect();
    for (&old, nearest) in c.new_vertices.iter().zip(nearest) {
        if let Some((d, v)) = nearest {
            let distance = (d as f64).sqrt() * (1u64 << shift) as f64;
            let bound = &mut out[v as usize];
            *bound = bound.max((distance as f32 + error[old as usize] + drop) * 1.000_001);
        }
    }
}
