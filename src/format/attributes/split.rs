//! The attributes of one split: labels of the elements that appear, then its layers one after the other.

use super::given::{GivenSplit, Keys, Named, SplitAttributes};
use super::models::{AttributeModels, LabelModels};
use super::scratch::LayerScratch;
use super::structure::{Job, NEAR, ends_early};
use super::values::{ElementCorners, Frame, LayerNeighbourhood};
use crate::format::coder::InvalidStream;
use crate::format::coder::range::Coder;
use crate::format::complex::{AttributeBatch, Split};
use crate::format::split::fan::Shape;
use crate::format::split::neighbourhood::{LevelGeometry, Neighbourhood};
use std::sync::atomic::AtomicU64;

/// Buffers reused from split to split.
#[derive(Clone, Debug, Default)]
pub struct AttributeScratch {
    known: SplitAttributes,
    used: Vec<bool>,
    spokes: Vec<ElementCorners>,
    /// Neighbour, spoke, corner of the neighbour, in order; for splits with many triangles.
    index: Vec<(u32, u32, u32)>,
    layer: LayerScratch,
}

/// Triangles from which on neighbours are looked up in an index.
const MANY: usize = 8;

/// The split whose attributes are coded.
#[derive(Clone, Copy)]
pub struct SplitTask<'a> {
    /// The coarser level.
    pub view: &'a LevelGeometry<'a>,
    /// The vertex that splits, and what lies around it.
    pub patch: &'a Neighbourhood,
    /// How it splits, in canonical form.
    pub split: &'a Split,
    /// `v1 − v2`.
    pub delta: [i32; 3],
    /// The rounding of midpoints, 0 or 1.
    pub bias: i32,
    /// For a decoder, how many wedges each layer may still gain in all segments of the batch; an encoder's is empty.
    pub wedge_budget: &'a [AtomicU64],
    /// What an encoder knows of it.
    pub given: Option<GivenSplit<'a>>,
}

/// Code the attributes of a split, appending to `out` and, for an encoder, to `named`.
///
/// # Errors
/// [`InvalidStream`] from a decoder whose stream contradicts the header or itself.
pub fn code_attributes<C: Coder>(
    coder: &mut C,
    models: &mut AttributeModels,
    scratch: &mut AttributeScratch,
    task: &SplitTask,
    named: &mut Named,
    out: &mut AttributeBatch,
) -> Result<(), InvalidStream> {
    let SplitTask { view, patch, split, delta, bias, wedge_budget, given } = *task;
    let scheme = view.scheme;
    let AttributeScratch { known, used, spokes, index, layer: rest } = scratch;
    if let Some(given) = given {
        given.arrange(split, used, known);
    }
    let faces = &view.level.faces;
    let star = view.star.get(patch.vertex);
    spokes.clear();
    spokes.extend(patch.around.spokes.iter().map(|s| {
        let f = star[s.place as usize];
        let (start, end) = (faces.start[f as usize], faces.start[f as usize + 1]);
        let v = patch.vertex;
        let at = match faces.get(f) {
            // Which corner it is cannot be guessed.
            &[_, b, c] => (b == v) as u32 + 2 * (c == v) as u32,
            corners => corners.iter().position(|&x| x == v).unwrap_or(0) as u32,
        };
        let own = start + at;
        let next = if own + 1 == end { start } else { own + 1 };
        let prev = if at == 0 { end - 1 } else { own - 1 };
        ElementCorners { place: s.place, own, next, prev }
    }));
    let many = split.triangles.len() > MANY;
    if many {
        index.clear();
        for (k, s) in spokes.iter().enumerate() {
            index.push((faces.corners[s.next as usize], k as u32, s.next));
            if s.prev != s.next {
                index.push((faces.corners[s.prev as usize], k as u32, s.prev));
            }
        }
        index.sort_unstable();
    }
    // The spokes beside each element that appears, and their corners at its apex.
    let beside = |t: usize, adjacent: &mut Vec<(u32, u32)>| {
        adjacent.clear();
        let Some(triangle) = split.triangles.get(t) else {
            adjacent.extend(spokes.first().map(|s| (0, s.own)));
            return;
        };
        let x = triangle.apex;
        let around = &patch.around;
        if around.shape != Shape::General {
            // Element `k` of a fan runs from edge `k` to edge `k + 1`.
            let Some(k) = around.ring.iter().position(|&y| y == x) else { return };
            let n = spokes.len();
            let before = if k > 0 { Some(k - 1) } else { (around.shape == Shape::Closed).then_some(n - 1) };
            let before = before.map(|b| (b as u32, spokes[b].prev));
            let behind = spokes.get(k).map(|s| (k as u32, s.next));
            // In order of elements.
            let (one, two) = if k > 0 { (before, behind) } else { (behind, before) };
            adjacent.extend(one.into_iter().chain(two));
        } else if many {
            let from = index.partition_point(|e| e.0 < x);
            adjacent.extend(index[from..].iter().take_while(|e| e.0 == x).take(NEAR).map(|e| (e.1, e.2)));
        } else {
            let at = |(k, s): (usize, &ElementCorners)| {
                let corner = [s.next, s.prev].into_iter().find(|&c| faces.corners[c as usize] == x)?;
                Some((k as u32, corner))
            };
            adjacent.extend(spokes.iter().enumerate().filter_map(at).take(NEAR));
        }
    };
    let inserted = split.triangles.len() + split.edges as usize;
    let labels = out.labels.len();
    if scheme.presence.len() > 1 {
        let mut last = 0u16;
        for t in 0..inserted {
            ends_early(coder)?;
            beside(t, &mut rest.adjacent);
            let adjacent = &rest.adjacent;
            let label = |k: u32| {
                let place = spokes[k as usize].place;
                view.attributes.labels.get(star[place as usize] as usize).copied().unwrap_or(0)
            };
            let first = adjacent.first().map_or(last, |a| label(a.0));
            let second = adjacent.iter().map(|a| label(a.0)).find(|&l| l != first);
            let context = if adjacent.is_empty() { 2 } else { second.is_some() as usize };
            let wanted = known.labels.get(t).copied().unwrap_or(0);
            last = code_label(coder, &mut models.labels, context, first, second, scheme.presence.len(), wanted);
            out.labels.push(last);
        }
    }
    let frame = Frame::new(patch, delta);
    let bias = bias & 1;
    for (l, (wedges, (structure, values))) in view.attributes.layers.iter().zip(&mut models.layers).enumerate() {
        let none = Keys::default();
        let keys = known.layers.get(l).filter(|_| !C::DECODING).unwrap_or(&none);
        let sight = &LayerNeighbourhood {
            positions: &view.level.positions,
            names: &faces.corners,
            wedges,
            patch,
            frame: &frame,
            spokes,
        };
        let given = given.and_then(|g| g.attributes.layers.get(l));
        let named = &mut *named;
        let mut job = Job { coder, structure, values, view, sight, l, split, bias, keys, given, named, wedge_budget };
        let has = |t: usize| scheme.has(out.labels.get(labels + t).copied().unwrap_or(0), l);
        job.run(rest, &mut out.layers[l], star.len(), inserted, &has, &beside)?;
    }
    Ok(())
}

fn code_label<C: Coder>(
    coder: &mut C,
    m: &mut LabelModels,
    context: usize,
    first: u16,
    second: Option<u16>,
    labels: usize,
    wanted: u16,
) -> u16 {
    if coder.bit(&mut m.same[context], wanted == first) {
        return first;
    }
    if let Some(second) = second
        && coder.bit(&mut m.second, wanted == second)
    {
        return second;
    }
    coder.uniform(labels as u32, wanted as u32) as u16
}
