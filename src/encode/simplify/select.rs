//! Which edges a batch collapses.
//!
//! Caillaud et al. 2016, section 4.3, with two corrections. The threshold is the mean over ordinary collapses that fold
//! nothing, or a few outliers would void it. And two edges go together only where no element touches both: merely keeping the
//! merged vertices apart would let two edges of one quad change each other's patch.
//!
//! The choice is the greedy independent set in order of (weight, hash, number of the edge). The hash comes from numbers
//! that the caller keeps for vertices from batch to batch, so that it neither follows the numbering (which would run
//! through the mesh in order where weights are equal) nor changes when levels are renumbered. Weights are integers and
//! the order is total: the result is the same for any number of threads.

use rayon::prelude::*;

use crate::encode::cost::{Class, EdgeList, Fixed};
use crate::format::complex::{Faces, Star};
use crate::random::{GOLDEN, mix};

/// Weights that one task scans.
const CHUNK: usize = 1 << 14;

/// A level whose edges are weighed.
#[derive(Clone, Copy, Debug)]
pub struct SelectInput<'a> {
    /// The elements.
    pub faces: &'a Faces,
    /// Their stars.
    pub star: &'a Star,
    /// The edges.
    pub edges: &'a EdgeList,
    /// One weight for each edge.
    pub weights: &'a [Fixed],
    /// For each vertex a number of its own that stays when levels are renumbered (a merged vertex keeps that of one child).
    pub slots: &'a [u32],
}

/// How greedy a batch is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SelectOptions {
    /// Threshold over the mean weight, in 1/256; 256 is the mean itself.
    pub factor: u32,
    /// While fewer edges than this are chosen, the threshold doubles, and then the next class is admitted. At least
    /// 1 counts. More than 1 keeps the last ordinary edges of a mesh from making a long tail of tiny batches.
    pub least: usize,
    /// Never choose more than this.
    pub most: usize,
}

impl Default for SelectOptions {
    fn default() -> Self {
        SelectOptions { factor: 256, least: 1, most: usize::MAX }
    }
}

/// The edges of the next batch, in the order in which they were chosen (best first). Empty only where no edge is legal.
pub fn select(input: SelectInput, options: &SelectOptions) -> Vec<u32> {
    let mut greedy = Greedy { input, most: options.most, blocked: vec![false; input.slots.len()], chosen: Vec::new() };
    for class in [Class::Ordinary, Class::Breaking, Class::Dangling] {
        let Some(mean) = mean(input.weights, class) else { continue };
        let largest = mean.largest;
        let mut threshold = ((u64::from(mean.value) * u64::from(options.factor)) >> 8).min(u64::from(largest)) as u32;
        greedy.admit(class, None, threshold);
        while greedy.chosen.len() < options.least.max(1) && threshold < largest {
            let next = threshold.saturating_mul(2).max(1).min(largest);
            greedy.admit(class, Some(threshold), next);
            threshold = next;
        }
        if greedy.chosen.len() >= options.least.max(1) {
            break;
        }
    }
    greedy.chosen
}

/// The mean of the values of a class and the largest of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Mean {
    value: u32,
    largest: u32,
}

/// The mean over a class, of those that fold nothing unless all fold; rounded down. `None` if the class is empty.
fn mean(weights: &[Fixed], class: Class) -> Option<Mean> {
    // (count, sum) of those that do not fold and of those that do, and the largest.
    let (plain, folding, largest) = weights
        .par_chunks(CHUNK)
        .map(|part| {
            let mut total = ((0u64, 0u64), (0u64, 0u64), 0u32);
            for w in part.iter().filter(|w| w.class() == class) {
                let t = if w.folds() { &mut total.1 } else { &mut total.0 };
                t.0 += 1;
                t.1 += u64::from(w.value());
                total.2 = total.2.max(w.value());
            }
            total
        })
        .reduce(
            || ((0, 0), (0, 0), 0),
            |x, y| ((x.0.0 + y.0.0, x.0.1 + y.0.1), (x.1.0 + y.1.0, x.1.1 + y.1.1), x.2.max(y.2)),
        );
    let (count, sum) = if plain.0 > 0 { plain } else { folding };
    let value = sum.checked_div(count)?;
    Some(Mean { value: value as u32, largest })
}

/// A hash of an edge from the lasting numbers of its ends, alike in either order.
pub(super) fn hash(a: u32, b: u32) -> u32 {
    let edge = u64::from(a.min(b)) << 32 | u64::from(a.max(b));
    mix(edge.wrapping_add(GOLDEN)) as u32
}

/// An independent set that grows.
struct Greedy<'a> {
    input: SelectInput<'a>,
    most: usize,
    /// Vertices that share an element with an end of a chosen edge.
    blocked: Vec<bool>,
    chosen: Vec<u32>,
}

impl Greedy<'_> {
    /// Go through the edges of a class with values in (`above`, `threshold`], from `None` on with those of value 0, too.
    ///
    /// In four steps by value, which changes nothing but spares sorting most of what the first choices block.
    fn admit(&mut self, class: Class, above: Option<u32>, threshold: u32) {
        let from = u64::from(above.unwrap_or(0));
        let span = u64::from(threshold).saturating_sub(from);
        let mut above = above;
        for step in 1..=4 {
            let upto = (from + span * step / 4) as u32;
            self.step(class, above, upto);
            above = Some(upto);
        }
    }

    fn step(&mut self, class: Class, above: Option<u32>, upto: u32) {
        if self.chosen.len() >= self.most || above == Some(upto) {
            return;
        }
        let SelectInput { edges, weights, slots, .. } = self.input;
        let blocked = &self.blocked;
        let mut candidates: Vec<(u64, u32)> = weights
            .par_chunks(CHUNK)
            .enumerate()
            .flat_map_iter(|(chunk, part)| {
                part.iter().zip((chunk * CHUNK) as u32..).filter_map(move |(w, e)| {
                    let value = w.value();
                    if w.class() != class || value > upto || above.is_some_and(|above| value <= above) {
                        return None;
                    }
                    let (a, b) = edges.ends(e);
                    if blocked[a as usize] | blocked[b as usize] {
                        return None;
                    }
                    Some((u64::from(value) << 32 | u64::from(hash(slots[a as usize], slots[b as usize])), e))
                })
            })
            .collect();
        candidates.par_sort_unstable();
        for (_, e) in candidates {
            if self.chosen.len() >= self.most {
                return;
            }
            let (a, b) = edges.ends(e);
            if self.blocked[a as usize] | self.blocked[b as usize] {
                continue;
            }
            self.chosen.push(e);
            for v in [a, b] {
                for &f in self.input.star.get(v) {
                    for &x in self.input.faces.get(f) {
                        self.blocked[x as usize] = true;
                    }
                }
            }
        }
    }
}
