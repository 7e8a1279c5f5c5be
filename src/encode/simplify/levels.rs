//! From the base back to the full level in the numbering that a decoder will have, coding every batch on the way.
//!
//! The numbering of a level follows from the base and the batches before it (children take consecutive places), so it is only known
//! top-down: this is why coding waits for the last collapse. It runs the decoder's own `refine`.

use super::history::{History, StoredBatch};
use crate::format::attributes::{AttributeSource, Keys, Scheme, SplitAttributes, Value, code_base_layers};
use crate::format::coder::range::{Coder, Encoder};
use crate::format::complex::{
    Attributes, Batch, Faces, Inserted, Level, NEW, NONE, Refined, Side, Split, Star, Wanted, Wedges, refine,
    refine_attributes, touched,
};
use crate::format::elements::{ElementsError, Origin, code_elements};
use crate::format::points::{canonical_order, code_points};
use crate::format::split::neighbourhood::LevelGeometry;
use crate::format::split::segment::{InvalidStream, Scratch, Source};
use crate::format::stream::{Account, State, Task, code_segment, join, segment_range, segments};
use crate::parallel;
use std::sync::atomic::AtomicU64;
use thiserror::Error;

/// A run of levels that share one coder grows by at least this much (in 1/12) before it ends: the more a chunk's
/// seven bytes of table and checksum weigh, the later.
fn growth(slots: usize) -> usize {
    if slots < 8_000 { 16 } else { 14 }
}
/// A run is not ended below this many vertices.
const SMALL: usize = 256;

/// A piece of the file: the levels it serves and its bytes.
#[derive(Clone, Debug)]
pub struct Piece {
    /// The first level it serves.
    pub first: u32,
    /// The last.
    pub last: u32,
    /// Which segment of how many, for one level; `None` for a run of small levels.
    pub segment: Option<(u32, u32)>,
    /// The bytes.
    pub payload: Vec<u8>,
}

/// Everything that goes into the file.
#[derive(Clone, Debug, Default)]
pub struct EncodedLevels {
    /// In streaming order.
    pub pieces: Vec<Piece>,
    /// Vertices, elements, corners, shift and error bound in steps, of each level, coarse to fine.
    pub levels: Vec<(u32, u32, u32, u8, f64)>,
    /// Bits by kind.
    pub account: Account,
    /// The number at the full level of each slot.
    pub number: Vec<u32>,
    /// Wedges of each layer at the full level.
    pub wedges: Vec<u32>,
}

/// Slots of the level at hand.
struct Slots<'a> {
    /// The slot of each wedge, layer by layer.
    wedge: Vec<Vec<u32>>,
    /// Width and the values of all slots at the finer level, layer by layer.
    values: Vec<(usize, Vec<i32>)>,
    /// The label of each element's slot.
    labels: &'a [u16],
    vertex: Vec<u32>,
    face: Vec<u32>,
    /// The vertex of the level that has a slot.
    of_slot: Vec<u32>,
    /// The split (plus one) of a slot in the batch at hand.
    split_of: Vec<u32>,
    low_bits: Vec<[u16; 3]>,
}

/// Wedges and the slots that a segment gave them, layer by layer, and how many new wedges it made in each.
type Named = (Vec<Vec<(u32, u32)>>, Vec<u32>);

/// A history that contradicts itself: a bug, not an input's fault.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum LevelsError {
    /// The base breaks its invariants.
    #[error("the base of the simplification: {0}")]
    Base(#[from] ElementsError),
    /// A batch does not fit its level.
    #[error("a batch of the simplification: {}", .0.0)]
    Stream(InvalidStream),
}

/// Code `history`, whose slots are below `slots`. `progress` hears the vertices of each level reached.
///
/// # Errors
/// [`LevelsError`] for a history that `simplify` does not make.
pub fn encode_levels(
    history: &History,
    slots: usize,
    scheme: &Scheme,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<EncodedLevels, LevelsError> {
    let mut out = EncodedLevels::default();
    let mut state = State::new(scheme);
    let mut coder = Encoder::new();

    // The base.
    let order = canonical_order(&history.base.positions);
    let mut level = Level {
        positions: order.iter().map(|&v| history.base.positions[v as usize]).collect(),
        faces: history.base.faces.clone(),
        shift: history.base.shift,
    };
    let mut renumber = vec![0u32; order.len()];
    for (new, &old) in order.iter().enumerate() {
        renumber[old as usize] = new as u32;
    }
    for v in &mut level.faces.corners {
        *v = renumber[*v as usize];
    }
    let count = level.positions.len();
    code_points(&mut coder, &mut level.positions, count);
    out.account.points += coder.bits();
    let start = coder.bits();
    let limit = level.faces.corners.len();
    let origins = code_elements(&mut coder, &level.positions, &mut level.faces, limit)?;
    out.account.splits.connectivity += coder.bits() - start;
    let start = coder.bits();
    let mut attributes = base_attributes(history, &origins, &level.faces);
    let names =
        code_base_layers(&mut coder, scheme, count, &level.faces, &mut attributes, &[]).map_err(LevelsError::Stream)?;
    out.account.splits.attributes += coder.bits() - start;
    let mut s = Slots {
        wedge: names,
        values: history.attributes.layers.iter().map(|l| (l.width, l.values.clone())).collect(),
        labels: &history.labels,
        vertex: order.iter().map(|&v| history.vertex_slot[v as usize]).collect(),
        face: origins.iter().map(|o| history.face_slot[o.element as usize]).collect(),
        of_slot: vec![NONE; slots],
        split_of: vec![0; slots],
        low_bits: vec![[0; 3]; if history.batches.iter().any(|b| !b.low_bits.is_empty()) { slots } else { 0 }],
    };
    let row = |level: &Level, error: f64| {
        (level.positions.len() as u32, level.faces.len() as u32, level.faces.corners.len() as u32, level.shift, error)
    };
    let coarsest = history.batches.last().map_or(0.0, |b| b.error);
    out.levels.push(row(&level, coarsest));

    let mut star = Star::with_next(level.positions.len(), &level.faces);
    let mut run = Some((coder, 0u32, level.positions.len()));
    let mut scratch = Scratch::default();
    for (b, stored) in history.batches.iter().enumerate().rev() {
        let fine_level = (history.batches.len() - b) as u32;
        let error = if b == 0 { 0.0 } else { history.batches[b - 1].error };
        let view = LevelGeometry::with(&level, &star, &attributes, scheme);
        let n = level.positions.len();
        let pieces = segments(n);
        if pieces > 1
            && let Some((coder, first, _)) = run.take()
        {
            // A base too large to share its chunk with a level.
            out.pieces.push(Piece { first, last: fine_level - 1, segment: None, payload: coder.finish() });
        }
        s.announce(stored, &level);
        let (more, room) = ((u64::MAX, u64::MAX), AtomicU64::new(u64::MAX));
        let task = |k: usize| {
            let r = segment_range(n, k, pieces);
            Task {
                view,
                range: (r.start, r.end),
                first: k == 0,
                more,
                room: &room,
                wedges: &[],
                shift: stored.shift,
                bias: stored.placement.bias,
            }
        };
        let mut swaps: Vec<(u32, bool)> = Vec::new();
        let mut new_vertex_order: Vec<u32> = Vec::new();
        let mut named: Vec<Named> = Vec::new();
        let batch;
        if pieces == 1 {
            let (coder, first, from) = run.get_or_insert_with(|| (Encoder::new(), fine_level, n));
            let mut reader = Reader::new(&s, stored, &view);
            let mut part = stored.head();
            code_segment(coder, &mut state, &mut scratch, &task(0), &mut reader, &mut part, &mut out.account)
                .map_err(LevelsError::Stream)?;
            (swaps, new_vertex_order) = (reader.swaps, reader.new_vertex_order);
            named.push((reader.named, fresh_wedges(&part, scheme)));
            batch = part;
            let fine = n + batch.len() + batch.new_vertices.len();
            // Bits that come back raw are for those who go on.
            let bits = b > 0 && history.batches[b - 1].shift < stored.shift;
            let end = b == 0 || (fine >= SMALL && (bits || fine * 12 >= *from * growth(slots))) || segments(fine) > 1;
            if end {
                let first = *first;
                let coder = std::mem::take(coder);
                run = None;
                out.pieces.push(Piece { first, last: fine_level, segment: None, payload: coder.finish() });
            }
        } else {
            let parts = parallel::map((0..pieces).collect(), |k| {
                let mut coder = Encoder::new();
                let mut state = state.clone();
                let mut reader = Reader::new(&s, stored, &view);
                let mut part = if k == 0 { stored.head() } else { Batch::default() };
                part.shift = stored.shift;
                let mut account = Account::default();
                let mut scratch = Scratch::default();
                code_segment(&mut coder, &mut state, &mut scratch, &task(k), &mut reader, &mut part, &mut account)?;
                let keep = (k == 0).then_some(state);
                Ok::<_, InvalidStream>((coder.finish(), keep, part, account, reader))
            });
            let mut batches = Vec::new();
            for (k, part) in parts.into_iter().enumerate() {
                let (payload, keep, part, account, reader) = part.map_err(LevelsError::Stream)?;
                out.pieces.push(Piece {
                    first: fine_level,
                    last: fine_level,
                    segment: Some((k as u32, pieces as u32)),
                    payload,
                });
                if let Some(keep) = keep {
                    state = keep;
                    new_vertex_order = reader.new_vertex_order;
                }
                out.account.points += account.points;
                out.account.splits.connectivity += account.splits.connectivity;
                out.account.splits.geometry += account.splits.geometry;
                out.account.splits.attributes += account.splits.attributes;
                swaps.extend(reader.swaps);
                named.push((reader.named, fresh_wedges(&part, scheme)));
                batches.push(part);
            }
            batch = join(batches, &level, &scheme.widths);
        }
        let touched = if scheme.is_empty() { Vec::new() } else { touched(&level.faces, &star, &batch) };
        let refined = refine(&level, star, &batch, stored.placement.bias, Wanted { star: b > 0, element: true });
        s.descend(stored, &batch, &refined, &swaps, &new_vertex_order);
        if !scheme.is_empty() {
            s.rename(&named);
            attributes = refine_attributes(attributes, &level.faces, &touched, &batch, &refined);
        }
        level = refined.level;
        star = if b > 0 { Star::fill(refined.star_start, &level.faces, true) } else { Star::default() };
        out.levels.push(row(&level, error));
        progress(level.positions.len() as u64);
    }
    if let Some((coder, first, _)) = run {
        out.pieces.push(Piece { first, last: history.batches.len() as u32, segment: None, payload: coder.finish() });
    }
    out.wedges = attributes.layers.iter().map(|l| l.len() as u32).collect();
    out.number = vec![NONE; slots];
    for (v, &slot) in s.vertex.iter().enumerate() {
        out.number[slot as usize] = v as u32;
    }
    Ok(out)
}

/// The attributes of the base in the order of its coded elements, wedges still by slots.
fn base_attributes(history: &History, origins: &[Origin], faces: &Faces) -> Attributes {
    let old = &history.base.faces;
    let corner = |layer: &Wedges| {
        let mut out = Vec::with_capacity(faces.corners.len());
        for o in origins {
            let own = &layer.corner[old.start[o.element as usize] as usize..old.start[o.element as usize + 1] as usize];
            out.extend((0..own.len()).map(|k| own[(o.rotation as usize + k) % own.len()]));
        }
        out
    };
    let a = &history.attributes;
    Attributes {
        layers: a
            .layers
            .iter()
            .map(|l| Wedges { width: l.width, corner: corner(l), values: l.values.clone() })
            .collect(),
        labels: if a.labels.is_empty() {
            Vec::new()
        } else {
            origins.iter().map(|o| a.labels[o.element as usize]).collect()
        },
    }
}

/// How many wedges a segment adds to each layer.
fn fresh_wedges(part: &Batch, scheme: &Scheme) -> Vec<u32> {
    part.attributes.layers.iter().zip(&scheme.widths).map(|(l, &w)| (l.fresh.len() / w.max(1)) as u32).collect()
}

impl StoredBatch {
    fn head(&self) -> Batch {
        Batch {
            alpha: self.placement.alpha,
            new_vertices: self.new_vertex_positions.clone(),
            shift: self.shift,
            ..Batch::default()
        }
    }
}

impl Slots<'_> {
    /// Note where the slots of the level are and which of them split.
    fn announce(&mut self, stored: &StoredBatch, level: &Level) {
        for v in 0..level.positions.len() {
            self.of_slot[self.vertex[v] as usize] = v as u32;
        }
        for (i, pair) in stored.pairs.iter().enumerate() {
            self.split_of[pair[0] as usize] = i as u32 + 1;
        }
        for &(slot, low) in &stored.low_bits {
            self.low_bits[slot as usize] = low;
        }
        for ((width, values), layer) in self.values.iter_mut().zip(&stored.layers) {
            for (&w, value) in layer.changed.iter().zip(layer.values.chunks_exact(*width)) {
                values[w as usize * *width..][..*width].copy_from_slice(value);
            }
        }
    }

    /// Give the wedges of the finer level their slots; `named` has a list for each segment, and how many wedges it adds.
    fn rename(&mut self, named: &[Named]) {
        for (l, names) in self.wedge.iter_mut().enumerate() {
            for (lists, fresh) in named {
                let base = names.len();
                names.resize(base + fresh.get(l).copied().unwrap_or(0) as usize, NONE);
                for &(w, slot) in lists.get(l).into_iter().flatten() {
                    let at = if w & NEW != 0 { base + (w & !NEW) as usize } else { w as usize };
                    names[at] = slot;
                }
            }
        }
    }

    /// Go to the finer level.
    fn descend(
        &mut self,
        stored: &StoredBatch,
        batch: &Batch,
        fine: &Refined,
        swaps: &[(u32, bool)],
        new_vertex_order: &[u32],
    ) {
        let parents = &fine.parent;
        let mut vertex = Vec::with_capacity(parents.len());
        let mut new_vertices = new_vertex_order.iter();
        let mut splits = swaps.iter();
        let mut v = 0;
        while v < parents.len() {
            let parent = parents[v];
            if parent == NONE {
                vertex.push(new_vertices.next().map_or(NONE, |&b| stored.new_vertices[b as usize]));
                v += 1;
            } else if parents.get(v + 1) == Some(&parent) {
                if let Some(&(i, swapped)) = splits.next() {
                    let [a, b] = stored.pairs[i as usize];
                    vertex.extend_from_slice(&if swapped { [b, a] } else { [a, b] });
                }
                v += 2;
            } else {
                vertex.push(self.vertex[parent as usize]);
                v += 1;
            }
        }
        // Inserted elements: match each with a stored one of the same kind.
        let mut new = Vec::with_capacity(batch.triangles.len());
        let mut used: Vec<bool> = Vec::new();
        for (k, &(i, swapped)) in swaps.iter().enumerate() {
            let i = i as usize;
            let list = &stored.triangles[stored.triangle_start[i] as usize..stored.triangle_start[i + 1] as usize];
            used.clear();
            used.resize(list.len(), false);
            for t in batch.triangles_of(k) {
                let apex = self.vertex[t.apex as usize];
                let found = (0..list.len())
                    .find(|&j| !used[j] && list[j].apex == apex && (list[j].reversed ^ swapped) == t.reversed);
                if let Some(j) = found {
                    used[j] = true;
                    new.push(list[j].slot);
                }
            }
            new.extend_from_slice(&stored.edges[stored.edge_start[i] as usize..stored.edge_start[i + 1] as usize]);
        }
        let face = fine
            .element
            .iter()
            .map(|&e| if e & NEW != 0 { new[(e & !NEW) as usize] } else { self.face[e as usize] })
            .collect();
        for pair in &stored.pairs {
            self.split_of[pair[0] as usize] = 0;
        }
        self.vertex = vertex;
        self.face = face;
    }
}

/// Answers a coder's questions out of the history.
struct Reader<'a> {
    slots: &'a Slots<'a>,
    stored: &'a StoredBatch,
    view: &'a LevelGeometry<'a>,
    asked: u32,
    /// The stored split behind each coded one, and whether its children changed places.
    swaps: Vec<(u32, bool)>,
    swap_of: Vec<(u32, bool)>,
    new_vertex_order: Vec<u32>,
    used: Vec<bool>,
    /// Wedges and their slots at the finer level, layer by layer.
    named: Vec<Vec<(u32, u32)>>,
}

impl<'a> Reader<'a> {
    fn new(slots: &'a Slots<'a>, stored: &'a StoredBatch, view: &'a LevelGeometry<'a>) -> Self {
        Reader {
            slots,
            stored,
            view,
            asked: 0,
            swaps: Vec::new(),
            swap_of: Vec::new(),
            new_vertex_order: Vec::new(),
            used: Vec::new(),
            named: vec![Vec::new(); view.scheme.widths.len()],
        }
    }
}

impl AttributeSource for Reader<'_> {
    fn quantize_attributes(
        &mut self,
        view: &LevelGeometry,
        v: u32,
        split: &Split,
        quantize_attributes: &mut SplitAttributes,
    ) {
        let Some(&(i, swapped)) = self.swaps.last() else { return };
        let (i, s) = (i as usize, self.stored);
        let star = view.star.get(v);
        quantize_attributes.layers.resize_with(s.layers.len(), Keys::default);
        for (l, (layer, keys)) in s.layers.iter().zip(&mut quantize_attributes.layers).enumerate() {
            let wedges = &view.attributes.layers[l];
            let changed = &layer.star[layer.star_start[i] as usize..layer.star_start[i + 1] as usize];
            keys.star.clear();
            for (&f, &side) in star.iter().zip(&split.sides) {
                let slot = self.slots.face[f as usize];
                let told = changed.iter().position(|e| e[0] == slot);
                keys.star.push(match (told, side) {
                    (Some(k), Side::Grow12 | Side::Grow21) => {
                        let (one, two) = (changed[k][1], changed[k + 1][1]);
                        if swapped { [two, one] } else { [one, two] }
                    }
                    (Some(k), _) => [changed[k][1]; 2],
                    (None, _) => {
                        let faces = &view.level.faces;
                        let at = faces.get(f).iter().position(|&x| x == v).unwrap_or(0);
                        let w = wedges.corner[faces.start[f as usize] as usize + at];
                        [if w == NONE { NONE } else { self.slots.wedge[l][w as usize] }; 2]
                    }
                });
            }
            keys.inserted.clear();
        }
        quantize_attributes.labels.clear();
        let first = s.triangle_start[i] as usize;
        let list = &s.triangles[first..s.triangle_start[i + 1] as usize];
        let label = |slot: u32| self.slots.labels.get(slot as usize).copied().unwrap_or(0);
        self.used.clear();
        self.used.resize(list.len(), false);
        for t in &split.triangles {
            let apex = self.slots.vertex[t.apex as usize];
            let found = (0..list.len())
                .find(|&j| !self.used[j] && list[j].apex == apex && (list[j].reversed ^ swapped) == t.reversed);
            let Some(j) = found else { continue };
            self.used[j] = true;
            quantize_attributes.labels.push(label(list[j].slot));
            for (layer, keys) in s.layers.iter().zip(&mut quantize_attributes.layers) {
                let [one, two, apex] = layer.triangles[first + j];
                keys.inserted.push(if swapped { [two, one, apex] } else { [one, two, apex] });
            }
        }
        for e in s.edge_start[i] as usize..s.edge_start[i + 1] as usize {
            quantize_attributes.labels.push(label(s.edges[e]));
            for (layer, keys) in s.layers.iter().zip(&mut quantize_attributes.layers) {
                let [one, two] = layer.edges[e];
                keys.inserted.push(if swapped { [two, one, NONE] } else { [one, two, NONE] });
            }
        }
    }

    fn key(&self, layer: usize, w: u32) -> u32 {
        self.slots.wedge[layer].get(w as usize).copied().unwrap_or(NONE)
    }

    fn value(&self, layer: usize, key: u32) -> Value {
        let (width, values) = &self.slots.values[layer];
        let mut out = Value::default();
        if let Some(value) = values.get(key as usize * width..(key as usize + 1) * width) {
            out[..*width].copy_from_slice(value);
        }
        out
    }

    fn named(&mut self, layer: usize, w: u32, key: u32) {
        if w & NEW != 0 || self.slots.wedge[layer][w as usize] != key {
            self.named[layer].push((w, key));
        }
    }
}

impl Source for Reader<'_> {
    fn split(&mut self, v: u32, split: &mut Split) -> Option<[i32; 3]> {
        let i = self.slots.split_of[self.slots.vertex[v as usize] as usize].checked_sub(1)?;
        self.asked = i;
        let (i, s) = (i as usize, self.stored);
        let star = self.view.star.get(v);
        split.reset(star.len());
        for &(slot, side) in &s.sides[s.side_start[i] as usize..s.side_start[i + 1] as usize] {
            if let Some(k) = star.iter().position(|&f| self.slots.face[f as usize] == slot) {
                split.sides[k] = side;
            }
        }
        for t in &s.triangles[s.triangle_start[i] as usize..s.triangle_start[i + 1] as usize] {
            split.triangles.push(Inserted { apex: self.slots.of_slot[t.apex as usize], reversed: t.reversed });
        }
        split.edges = s.edge_start[i + 1] - s.edge_start[i];
        debug_assert!(split.sides.iter().all(|s| matches!(s, Side::One | Side::Two | Side::Grow12 | Side::Grow21)));
        Some(s.delta[i])
    }

    fn settled(&mut self, _: &Split, swapped: bool) {
        self.swaps.push((self.asked, swapped));
    }

    fn new_vertices(&mut self, _: &[[i32; 3]]) {
        self.new_vertex_order = canonical_order(&self.stored.new_vertex_positions);
    }

    fn low_bits(&mut self, v: u32, child: u32) -> [u16; 3] {
        let slot = self.slots.vertex[v as usize];
        let slot = match self.slots.split_of[slot as usize].checked_sub(1) {
            None => slot,
            Some(i) => {
                if self.swap_of.is_empty() {
                    self.swap_of = self.swaps.clone();
                    self.swap_of.sort_unstable();
                }
                let swapped = self.swap_of.binary_search_by_key(&i, |s| s.0).is_ok_and(|k| self.swap_of[k].1);
                self.stored.pairs[i as usize][(child == 1) as usize ^ swapped as usize]
            }
        };
        self.slots.low_bits[slot as usize]
    }

    fn new_vertex_low_bits(&mut self, new_vertex: u32) -> [u16; 3] {
        self.slots.low_bits[self.stored.new_vertices[self.new_vertex_order[new_vertex as usize] as usize] as usize]
    }
}
