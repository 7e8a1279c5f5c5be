//! Attributes of a level: for each layer the wedge at each corner and the value of each wedge, for each element a label.
//!
//! Caillaud et al. 2016, section 4.1, with wedges as structure: at the full level corners of a vertex share a wedge when
//! their values are equal; below it wedges are carried through collapses and splits, and may meet in value by accident. A wedge belongs to
//! one vertex. Wedges keep their numbers from level to level, and a batch appends the new ones, so that the values of a
//! level are a prefix of those of the next but for what the batch changes.
//!
//! A *label* says what holds for a whole element: its material and which layers it has values in. Labels never change.
//!
//! Invariants: a corner's wedge is [`NONE`] exactly where its element's label leaves the layer out.

use super::batch::{Batch, NEW, NONE, Side, WedgeBatch};
use super::level::Faces;
use super::refine::Refined;
use super::star::Star;
use crate::parallel;
use std::ops::Range;

/// The most wedges of a layer: the highest bit marks new ones.
pub const MAX_WEDGES: usize = NEW as usize - 1;

/// One layer of a level.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wedges {
    /// Components of a value.
    pub width: usize,
    /// The wedge of each corner, in the order of [`Faces::corners`].
    pub corner: Vec<u32>,
    /// The values, `width` integers for each wedge.
    pub values: Vec<i32>,
}

impl Wedges {
    /// Number of wedges.
    pub fn len(&self) -> usize {
        self.values.len() / self.width.max(1)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The value of wedge `w`.
    #[inline]
    pub fn value(&self, w: u32) -> &[i32] {
        &self.values[w as usize * self.width..(w as usize + 1) * self.width]
    }
}

/// All layers of a level, and its labels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// The layers.
    pub layers: Vec<Wedges>,
    /// The label of each element; empty where all have label 0.
    pub labels: Vec<u16>,
}

/// For each element of a level the entry of [`Batch::sides`] that speaks of it, plus one; 0 where none does.
pub fn touched(faces: &Faces, star: &Star, batch: &Batch) -> Vec<u32> {
    let mut of = vec![0u32; faces.len()];
    for (i, &v) in batch.vertex.iter().enumerate() {
        let first = batch.side_start[i] + 1;
        for (k, &f) in star.get(v).iter().enumerate() {
            of[f as usize] = first + k as u32;
        }
    }
    of
}

/// Elements that one task works on.
const RUN: usize = 1 << 14;

/// The attributes of the finer level. `touched` is that of the coarser level; `fine` has its origins.
pub fn refine_attributes(
    coarse: Attributes,
    faces: &Faces,
    touched: &[u32],
    batch: &Batch,
    fine: &Refined,
) -> Attributes {
    let coarse_vertices = fine.level.positions.len() - batch.len() - batch.new_vertices.len();
    let mut splits = vec![false; coarse_vertices];
    batch.vertex.iter().for_each(|&v| splits[v as usize] = true);
    let ground = Ground { faces, touched, splits: &splits };
    let layers = coarse
        .layers
        .into_iter()
        .zip(&batch.attributes.layers)
        .map(|(wedges, changes)| refine_layer(wedges, changes, ground, batch, fine))
        .collect();
    let labels = if coarse.labels.is_empty() && batch.attributes.labels.is_empty() {
        Vec::new()
    } else {
        let of = |list: &[u16], i: u32| list.get(i as usize).copied().unwrap_or(0);
        let label = |&e: &u32| {
            if e & NEW != 0 { of(&batch.attributes.labels, e & !NEW) } else { of(&coarse.labels, e) }
        };
        fine.element.iter().map(label).collect()
    };
    Attributes { layers, labels }
}

/// The coarser level as its layers see it.
#[derive(Clone, Copy)]
struct Ground<'a> {
    faces: &'a Faces,
    touched: &'a [u32],
    /// Whether a vertex splits.
    splits: &'a [bool],
}

fn refine_layer(coarse: Wedges, changes: &WedgeBatch, ground: Ground, batch: &Batch, fine: &Refined) -> Wedges {
    let Ground { faces, touched, splits } = ground;
    let base = coarse.len() as u32;
    let Wedges { width, corner: old, mut values } = coarse;
    values.extend_from_slice(&changes.fresh);
    for (&w, value) in changes.changed.iter().zip(changes.changed_values.chunks_exact(width.max(1))) {
        values[w as usize * width..][..width].copy_from_slice(value);
    }
    let name = |w: u32| if w != NONE && w & NEW != 0 { base + (w & !NEW) } else { w };
    let mut corner = vec![NONE; fine.level.faces.corners.len()];
    let ranges = parallel::ranges(fine.element.len(), RUN);
    let mut parts = Vec::with_capacity(ranges.len());
    let mut left = &mut corner[..];
    for range in ranges {
        let count = (fine.level.faces.start[range.end] - fine.level.faces.start[range.start]) as usize;
        let (part, rest) = left.split_at_mut(count);
        parts.push((range, part));
        left = rest;
    }
    let fill = |(range, out): (Range<usize>, &mut [u32])| {
        let first = fine.level.faces.start[range.start];
        for f in range {
            let names = fine.level.faces.get(f as u32);
            let out = &mut out[(fine.level.faces.start[f] - first) as usize..][..names.len()];
            let e = fine.element[f];
            if e & NEW != 0 {
                let [one, two, apex] = changes.inserted[(e & !NEW) as usize].map(name);
                // The first child has the smaller number.
                let (a, b) = if names[0] < names[1] { (one, two) } else { (two, one) };
                (out[0], out[1]) = (a, b);
                if let Some(last) = out.get_mut(2) {
                    *last = apex;
                }
                continue;
            }
            let own = &old[faces.start[e as usize] as usize..faces.start[e as usize + 1] as usize];
            let Some(entry) = touched[e as usize].checked_sub(1) else {
                match (own, &mut *out) {
                    (&[a, b, c], [x, y, z]) => (*x, *y, *z) = (a, b, c),
                    (own, out) => out.copy_from_slice(own),
                }
                continue;
            };
            let (coarse, side) = (faces.get(e), batch.sides[entry as usize]);
            let one = name(changes.star[entry as usize]);
            if matches!(side, Side::One | Side::Two) {
                for ((out, &x), &w) in out.iter_mut().zip(coarse).zip(own) {
                    *out = if splits[x as usize] { one } else { w };
                }
                continue;
            }
            let at = changes.grown.binary_search_by_key(&entry, |g| g.0);
            let two = name(at.map_or(NONE, |at| changes.grown[at].1));
            let pair = if side == Side::Grow21 { [two, one] } else { [one, two] };
            let mut k = 0;
            for (&x, &w) in coarse.iter().zip(own) {
                if splits[x as usize] {
                    out[k..k + 2].copy_from_slice(&pair);
                    k += 2;
                } else {
                    out[k] = w;
                    k += 1;
                }
            }
        }
    };
    parallel::map(parts, fill);
    Wedges { width, corner, values }
}

/// The value halfway between two, as vertices are placed: rounded by `bias`, 0 or 1.
#[inline]
pub fn middle(a: i32, b: i32, bias: i32) -> i32 {
    a.wrapping_add(b).wrapping_add(bias) >> 1
}

/// The first of the two values whose difference is `delta` and whose [`middle`] is `m`. Wraps, for hostile streams.
#[inline]
pub fn first_of_middle(m: i32, delta: i32, bias: i32) -> i32 {
    let sum = m.wrapping_mul(2).wrapping_sub(bias).wrapping_add(delta.wrapping_add(bias) & 1);
    sum.wrapping_add(delta) >> 1
}
