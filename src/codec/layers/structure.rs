//! Which wedges the corners around the children of a split get.

use super::super::patch::{Patch, View};
use super::super::range::{Bit, Coder};
use super::super::segment::{Nonsense, Source};
use super::values::{Frame, Value, ValueModels, WIDTH};
use super::{AttributeModels, Dress, Keys, LabelModels, Spoke};
use crate::complex::{AttributeBatch, BIG, NEW, NONE, Side, Split, WedgeBatch, Wedges};
use std::sync::atomic::AtomicU64;

/// Adaptive models of the structure of one layer.
#[derive(Clone, Debug)]
pub struct StructureModels {
    pub(super) regular: [Bit; 16],
    pub(super) choice: [Bit; 8],
    pub(super) linked: [Bit; 4],
    pub(super) inside: [Bit; 4],
    pub(super) mirrored: Bit,
    pub(super) apex: [Bit; 4],
    pub(super) same: [Bit; 4],
    pub(super) new: [Bit; 2],
    pub(super) main: Bit,
    pub(super) middle: Bit,
    pub(super) kept: Bit,
}

impl Default for StructureModels {
    fn default() -> Self {
        StructureModels {
            regular: [Bit::with(60000); 16],
            choice: [Bit::default(); 8],
            linked: [Bit::default(); 4],
            inside: [Bit::default(); 4],
            mirrored: Bit::default(),
            apex: [Bit::with(50000); 4],
            same: [Bit::with(50000); 4],
            new: [Bit::default(); 2],
            main: Bit::with(50000),
            middle: Bit::with(60000),
            kept: Bit::with(60000),
        }
    }
}

/// The corners of one wedge around the vertex that splits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Group {
    /// The wedge.
    pub(super) w: u32,
    /// The last and the number of the wedges that each child has of it.
    pub(super) last: [u32; 2],
    pub(super) count: [u32; 2],
    /// Which of them is the main one.
    pub(super) main: [u32; 2],
}

impl Group {
    fn of(w: u32) -> Self {
        Group { w, last: [NONE; 2], count: [0; 2], main: [NONE; 2] }
    }
}

/// A wedge of a child.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Local {
    pub(super) key: u32,
    /// Its group, or [`NONE`].
    pub(super) group: u32,
    pub(super) child: u8,
    /// The one before it in its group, or [`NONE`].
    pub(super) before: u32,
    /// Its number: of the coarser level, or `NEW | i`.
    pub(super) id: u32,
    pub(super) value: Value,
}

/// A place where a triangle may continue: an element with the apex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    group: u32,
    /// The wedge at the apex.
    apex: u32,
    side: Side,
}

/// A new wedge at the apex of a triangle that appears.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Fresh {
    /// The apex.
    pub(super) x: u32,
    pub(super) key: u32,
    /// Its name, [`UNSETTLED`] until it has a number.
    pub(super) id: u32,
    /// The first triangle that has it.
    pub(super) triangle: u32,
}

/// Marks the name of a new wedge at an apex that has no number yet, together with [`NEW`].
pub(super) const UNSETTLED: u32 = 1 << 30;

/// Buffers reused from split to split.
#[derive(Clone, Debug, Default)]
pub struct AttributeScratch {
    dress: Dress,
    spokes: Vec<Spoke>,
    /// Neighbour, spoke, corner of the neighbour, in order; for splits with many triangles.
    index: Vec<(u32, u32, u32)>,
    layer: LayerScratch,
}

#[derive(Clone, Debug, Default)]
pub(super) struct LayerScratch {
    pub(super) groups: Vec<Group>,
    pub(super) locals: Vec<Local>,
    /// For each spoke its group, or [`NONE`] without a value.
    pub(super) group_of: Vec<u32>,
    /// For each element of the star, in order of spokes, the wedges of the children.
    pub(super) star: Vec<[u32; 2]>,
    pub(super) inserted: Vec<[u32; 3]>,
    places: Vec<Place>,
    /// New wedges at apexes.
    pub(super) fresh: Vec<Fresh>,
    pub(super) ids: Vec<u32>,
    /// The spokes beside an element that appears, and their corners at its apex.
    pub(super) adjacent: Vec<(u32, u32)>,
    /// The places of the first elements that appear, one list behind the other, and the end of each.
    listed: Vec<Place>,
    ends: Vec<u32>,
}

/// Triangles from which on neighbours are looked up in an index.
const MANY: usize = 8;
/// Elements that appear whose places are kept.
const KEPT: usize = 4;
/// Elements around an apex whose wedges are considered, new wedges at apexes too, and elements beside one that appears.
const NEAR: usize = 64;
/// Wedges of a group that a child has which are considered beside the last.
const BACK: u32 = 64;

/// Code the attributes of the split of `patch.vertex`, appending to `out`. `room` is, for a decoder, how many wedges each layer may still gain
/// in all segments of the batch; an encoder's is empty.
#[allow(clippy::too_many_arguments)]
pub fn code_attributes<C: Coder, S: Source>(
    coder: &mut C,
    models: &mut AttributeModels,
    scratch: &mut AttributeScratch,
    view: &View,
    patch: &Patch,
    split: &Split,
    delta: [i32; 3],
    bias: i32,
    room: &[AtomicU64],
    source: &mut S,
    out: &mut AttributeBatch,
) -> Result<(), Nonsense> {
    let scheme = view.scheme;
    let AttributeScratch { dress, spokes, index, layer: rest } = scratch;
    if !C::DECODING {
        source.dress(view, patch.vertex, split, dress);
    }
    let faces = &view.level.faces;
    let star = view.star.get(patch.vertex);
    spokes.clear();
    spokes.extend(patch.around.spokes.iter().map(|s| {
        let f = star[s.place as usize];
        let (start, end) = (faces.start[f as usize], faces.start[f as usize + 1]);
        let c = faces.get(f);
        let own = start + c.iter().position(|&x| x == patch.vertex).unwrap_or(0) as u32;
        let next = if own + 1 == end { start } else { own + 1 };
        let prev = if own == start { end - 1 } else { own - 1 };
        Spoke { place: s.place, own, next, prev }
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
        if many {
            let from = index.partition_point(|e| e.0 < x);
            adjacent.extend(index[from..].iter().take_while(|e| e.0 == x).take(NEAR).map(|e| (e.1, e.2)));
        } else {
            let at = |(k, s): (usize, &Spoke)| {
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
            let wanted = dress.labels.get(t).copied().unwrap_or(0);
            last = code_label(coder, &mut models.labels, context, first, second, scheme.presence.len(), wanted);
            out.labels.push(last);
        }
    }
    let frame = Frame::new(patch, delta);
    let bias = bias & 1;
    for (l, (wedges, (structure, values))) in view.attributes.layers.iter().zip(&mut models.layers).enumerate() {
        let none = Keys::default();
        let keys = dress.layers.get(l).filter(|_| !C::DECODING).unwrap_or(&none);
        let mut job =
            Job { coder, structure, values, view, wedges, l, patch, split, frame: &frame, bias, spokes, keys, room };
        let has = |t: usize| scheme.has(out.labels.get(labels + t).copied().unwrap_or(0), l);
        job.run(rest, source, &mut out.layers[l], star.len(), inserted, &has, &beside)?;
    }
    Ok(())
}

/// A split may say that very much appears: behind its end a stream is all zeros, no reason to go on with it.
fn ends_early<C: Coder>(coder: &C) -> Result<(), Nonsense> {
    if coder.overrun() { Err(Nonsense("a segment that ends too early")) } else { Ok(()) }
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

/// Lists for an element that appears the spokes beside it, and their corners at its apex.
type Beside<'a> = dyn Fn(usize, &mut Vec<(u32, u32)>) + 'a;

/// One layer of one split.
pub(super) struct Job<'a, C> {
    pub(super) coder: &'a mut C,
    pub(super) structure: &'a mut StructureModels,
    pub(super) values: &'a mut ValueModels,
    pub(super) view: &'a View<'a>,
    pub(super) wedges: &'a Wedges,
    pub(super) l: usize,
    pub(super) patch: &'a Patch,
    pub(super) split: &'a Split,
    pub(super) frame: &'a Frame,
    pub(super) bias: i32,
    pub(super) spokes: &'a [Spoke],
    pub(super) keys: &'a Keys,
    pub(super) room: &'a [AtomicU64],
}

/// The key of a corner that an encoder has not been told; never asked for in earnest.
const UNKNOWN: u32 = NONE;

impl<C: Coder> Job<'_, C> {
    fn side(&self, k: usize) -> Side {
        self.split.sides[self.spokes[k].place as usize]
    }

    fn key(&self, k: usize) -> [u32; 2] {
        self.keys.star.get(self.spokes[k].place as usize).copied().unwrap_or([UNKNOWN; 2])
    }

    fn inserted_key(&self, t: usize) -> [u32; 3] {
        self.keys.inserted.get(t).copied().unwrap_or([UNKNOWN; 3])
    }

    pub(super) fn own_value(&self, w: u32) -> Value {
        let mut out = [0; WIDTH];
        out[..self.wedges.width].copy_from_slice(self.wedges.value(w));
        out
    }

    /// The corners that a side gives to the children: first child, second child.
    fn children(side: Side) -> [bool; 2] {
        match side {
            Side::One => [true, false],
            Side::Two => [false, true],
            Side::Grow12 | Side::Grow21 => [true, true],
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn run<S: Source>(
        &mut self,
        s: &mut LayerScratch,
        source: &mut S,
        out: &mut WedgeBatch,
        elements: usize,
        inserted: usize,
        has: &dyn Fn(usize) -> bool,
        beside: &Beside,
    ) -> Result<(), Nonsense> {
        let n = self.spokes.len();
        // Groups, in order of their wedges' numbers.
        s.group_of.clear();
        s.group_of.extend(self.spokes.iter().map(|k| self.wedges.corner[k.own as usize]));
        s.groups.clear();
        s.locals.clear();
        s.fresh.clear();
        match s.group_of.first().copied() {
            Some(w) if w != NONE && s.group_of.iter().all(|&x| x == w) => {
                s.groups.push(Group::of(w));
                s.group_of.fill(0);
            }
            _ => {
                s.ids.clear();
                s.ids.extend(s.group_of.iter().copied().filter(|&w| w != NONE));
                s.ids.sort_unstable();
                s.ids.dedup();
                s.groups.extend(s.ids.iter().map(|&w| Group::of(w)));
                for w in &mut s.group_of {
                    if *w != NONE {
                        *w = s.ids.binary_search(w).unwrap_or(0) as u32;
                    }
                }
            }
        }
        // How many triangles have a choice.
        let mut torn = 0;
        let mut any = false;
        let triangles = self.split.triangles.len();
        s.listed.clear();
        s.ends.clear();
        for t in 0..inserted {
            if has(t) {
                any = true;
                // All dangling edges have the same choice.
                if t <= triangles {
                    beside(t, &mut s.adjacent);
                    self.look(s);
                    torn += (s.places.len() != 1) as usize;
                    if t < KEPT {
                        s.listed.extend_from_slice(&s.places);
                    }
                }
            }
            if t < KEPT {
                s.ends.push(s.listed.len() as u32);
            }
        }
        s.star.clear();
        s.star.resize(n, [NONE; 2]);
        s.inserted.clear();
        s.inserted.resize(inserted, [NONE; 3]);
        if !s.groups.is_empty() || any {
            self.corners(s, source, out, inserted, torn, has, beside)?;
        }

        // The record, in the order of the star.
        let first = out.star.len();
        out.star.resize(first + elements, NONE);
        let id = |s: &LayerScratch, local: u32| if local == NONE { NONE } else { s.locals[local as usize].id };
        let grown = out.grown.len();
        for (k, spoke) in self.spokes.iter().enumerate() {
            let [one, two] = s.star[k];
            let at = first + spoke.place as usize;
            match Self::children(self.side(k)) {
                [true, true] => {
                    out.star[at] = id(s, one);
                    out.grown.push((at as u32, id(s, two)));
                }
                [true, false] => out.star[at] = id(s, one),
                _ => out.star[at] = id(s, two),
            }
        }
        out.grown[grown..].sort_unstable();
        for t in &s.inserted {
            out.inserted.push([id(s, t[0]), id(s, t[1]), t[2]]);
        }
        Ok(())
    }

    /// The wedges of the corners, some of which have values; `torn` elements that appear have a choice what to continue.
    #[allow(clippy::too_many_arguments)]
    fn corners<S: Source>(
        &mut self,
        s: &mut LayerScratch,
        source: &mut S,
        out: &mut WedgeBatch,
        inserted: usize,
        torn: usize,
        has: &dyn Fn(usize) -> bool,
        beside: &Beside,
    ) -> Result<(), Nonsense> {
        let n = self.spokes.len();
        let triangles = self.split.triangles.len();
        let crowd = if s.groups.len() < 2 {
            s.groups.len()
        } else if s.groups.len() < n {
            2
        } else {
            3
        };
        let context = crowd * 4 + torn.min(3);
        let regular = !C::DECODING && self.is_regular(s, source, inserted, has, beside);
        let regular = self.coder.bit(&mut self.structure.regular[context], regular);
        for g in &mut s.groups {
            *g = Group::of(g.w);
        }
        s.locals.clear();
        for t in 0..n {
            let g = s.group_of[t];
            if g == NONE {
                continue;
            }
            let keys = self.key(t);
            let children = Self::children(self.side(t));
            for child in 0..2 {
                if children[child] {
                    // An element of one child has its key in the first place.
                    let key = if children[0] { keys[child] } else { keys[0] };
                    s.star[t][child] = if regular { self.only(s, g, child, key) } else { self.told(s, g, child, key) };
                }
            }
        }
        let mut last = [NONE; 3];
        for t in 0..inserted {
            if !has(t) {
                continue;
            }
            let edge = t >= triangles;
            ends_early(self.coder)?;
            self.recall(s, t, beside);
            let keys = self.inserted_key(t);
            let wanted = self.wanted(s, source, keys, edge);
            let count = s.places.len();
            if regular && count == 0 {
                return Err(Nonsense("an element that continues nothing in a regular split"));
            }
            let mut linked = count > 0;
            if !regular && count > 0 {
                linked = self.coder.bit(&mut self.structure.linked[count.min(3)], wanted.is_some());
            }
            let mut chosen = 0;
            if linked && count > 1 {
                // Nearly always two: the sides of a seam.
                let to = wanted.unwrap_or(0);
                while chosen + 1 < count {
                    let first = matches!(s.places[chosen].side, Side::One) as usize;
                    if self.coder.bit(&mut self.structure.choice[first + 2 * chosen.min(3)], to == chosen) {
                        break;
                    }
                    chosen += 1;
                }
            }
            let place = if linked { s.places.get(chosen).copied() } else { None };
            // A triangle between two seams continues a wedge that no neighbour of its own has.
            let mut link = place.map(|p| p.group);
            if link.is_none() && !regular && !s.groups.is_empty() {
                let inside = self.inside(s, keys);
                let context = s.groups.len().min(4) - 1;
                if self.coder.bit(&mut self.structure.inside[context], inside.is_some()) {
                    link = Some(self.coder.uniform(s.groups.len() as u32, inside.unwrap_or(0)));
                }
            }
            for child in 0..2 {
                s.inserted[t][child] = match link {
                    Some(g) if regular => self.only(s, g, child, keys[child]),
                    Some(g) => self.told(s, g, child, keys[child]),
                    None => {
                        // Mostly a triangle that stood alone; else the one before it had the same.
                        let known = last[child] != NONE;
                        let same = known && s.locals[last[child] as usize].key == keys[child];
                        if known && self.coder.bit(&mut self.structure.new[0], same) {
                            last[child]
                        } else {
                            push_local(s, NONE, child, keys[child])
                        }
                    }
                };
            }
            if link.is_none() {
                last[..2].copy_from_slice(&s.inserted[t][..2]);
            }
            if !edge {
                let x = self.split.triangles[t].apex;
                s.inserted[t][2] = self.apex(s, source, t, x, keys[2], place, regular)?;
            }
        }
        self.settle(s, source, out, regular)
    }

    /// The places of element `t`, as they were listed or anew.
    fn recall(&self, s: &mut LayerScratch, t: usize, beside: &Beside) {
        if t < s.ends.len().min(self.split.triangles.len()) {
            let from = if t == 0 { 0 } else { s.ends[t - 1] as usize };
            s.places.clear();
            s.places.extend_from_slice(&s.listed[from..s.ends[t] as usize]);
        } else {
            beside(t, &mut s.adjacent);
            self.look(s);
        }
    }

    /// List the places that what `s.adjacent` is beside may continue.
    fn look(&self, s: &mut LayerScratch) {
        s.places.clear();
        for &(k, corner) in &s.adjacent {
            let group = s.group_of[k as usize];
            if group == NONE {
                continue;
            }
            let apex = self.wedges.corner[corner as usize];
            if !s.places.iter().any(|p| p.group == group && p.apex == apex) {
                s.places.push(Place { group, apex, side: self.side(k as usize) });
            }
            // What a hub's triangle may continue need not be listed in full.
            if s.places.len() >= 16 {
                break;
            }
        }
    }

    /// Which place an inserted element continues, for an encoder: by the groups that its corners are known to belong to.
    fn wanted<S: Source>(&self, s: &LayerScratch, source: &S, keys: [u32; 3], edge: bool) -> Option<usize> {
        if C::DECODING {
            return None;
        }
        let fits = |p: &Place| {
            let g = &s.groups[p.group as usize];
            let has = |child: usize| {
                let mut at = g.last[child];
                let mut steps = 0;
                while at != NONE && steps <= BACK {
                    let local = &s.locals[at as usize];
                    if local.key == keys[child] {
                        return true;
                    }
                    at = local.before;
                    steps += 1;
                }
                false
            };
            has(0) || has(1)
        };
        let apex = |p: &Place| edge || source.key(self.l, p.apex) == keys[2];
        // Rather one whose apex continues too.
        s.places.iter().position(|p| fits(p) && apex(p)).or_else(|| s.places.iter().position(fits))
    }

    /// The group that one of the corners of an inserted element at the children is known to belong to.
    fn inside(&self, s: &LayerScratch, keys: [u32; 3]) -> Option<u32> {
        if C::DECODING {
            return None;
        }
        let known = |local: &&Local| local.group != NONE && local.key == keys[local.child as usize];
        // Any will do, and so will none: a hub need not be searched through for each of its triangles.
        s.locals.iter().take(1 << 12).find(known).map(|local| local.group)
    }

    /// The one wedge that a child has of a group.
    fn only(&self, s: &mut LayerScratch, group: u32, child: usize, key: u32) -> u32 {
        match s.groups[group as usize].last[child] {
            NONE => push_local(s, group, child, key),
            local => local,
        }
    }

    /// One of the wedges that a child has of a group, or a further one.
    fn told(&mut self, s: &mut LayerScratch, group: u32, child: usize, key: u32) -> u32 {
        let Group { last, count, .. } = s.groups[group as usize];
        let (last, count) = (last[child], count[child]);
        if last == NONE {
            return push_local(s, group, child, key);
        }
        if self.coder.bit(&mut self.structure.same[(count.min(2) - 1) as usize], s.locals[last as usize].key == key) {
            return last;
        }
        // How many back. What lies too far back counts as new.
        let choices = (count - 1).min(BACK);
        let mut back = 0;
        if !C::DECODING {
            let mut at = s.locals[last as usize].before;
            while back < choices && s.locals[at as usize].key != key {
                at = s.locals[at as usize].before;
                back += 1;
            }
        }
        if choices == 0 || self.coder.bit(&mut self.structure.new[1], back == choices) {
            return push_local(s, group, child, key);
        }
        let back = self.coder.uniform(choices, back.min(choices - 1));
        let mut at = s.locals[last as usize].before;
        for _ in 0..back {
            at = s.locals[at as usize].before;
        }
        at
    }

    /// The wedge at the apex: that of the place continued, another one of the apex, or a new one.
    #[allow(clippy::too_many_arguments)]
    fn apex<S: Source>(
        &mut self,
        s: &mut LayerScratch,
        source: &S,
        t: usize,
        x: u32,
        key: u32,
        place: Option<Place>,
        regular: bool,
    ) -> Result<u32, Nonsense> {
        let key_of = |w: u32| if C::DECODING { UNKNOWN } else { source.key(self.l, w) };
        if let Some(p) = place
            && (regular || self.coder.bit(&mut self.structure.apex[0], key_of(p.apex) == key))
        {
            return Ok(p.apex);
        }
        // Wedges of the apex, and those that this split gave it. Of a hub not all: what is not found counts as new.
        let list = |s: &mut LayerScratch| {
            s.ids.clear();
            let faces = &self.view.level.faces;
            for &f in self.view.star.get(x).iter().take(NEAR) {
                let corners = faces.get(f);
                // Looking through large elements from every apex would cost the square of their size.
                if corners.len() > BIG {
                    continue;
                }
                let at = corners.iter().position(|&y| y == x).unwrap_or(0);
                let w = self.wedges.corner[faces.start[f as usize] as usize + at];
                if w != NONE {
                    s.ids.push(w);
                }
            }
            s.ids.sort_unstable();
            s.ids.dedup();
            let old = s.ids.len();
            let newest = s.fresh.len().saturating_sub(NEAR);
            s.ids.extend(s.fresh[newest..].iter().filter(|f| f.x == x).map(|f| f.id));
            old
        };
        let mut found = None;
        if !C::DECODING {
            let old = list(s);
            let fresh = |id: u32| s.fresh.get((id & !(NEW | UNSETTLED)) as usize).map_or(UNKNOWN, |f| f.key);
            found = (0..s.ids.len()).find(|&i| (if i < old { key_of(s.ids[i]) } else { fresh(s.ids[i]) }) == key);
        }
        if self.coder.bit(&mut self.structure.apex[1 + place.is_some() as usize], found.is_some()) {
            if C::DECODING {
                list(s);
            }
            if s.ids.is_empty() {
                return Err(Nonsense("a wedge of an apex that has none"));
            }
            let i = self.coder.uniform(s.ids.len() as u32, found.unwrap_or(0) as u32);
            return Ok(s.ids[i as usize]);
        }
        // Numbered when the wedges of the children are.
        let id = NEW | UNSETTLED | s.fresh.len() as u32;
        s.fresh.push(Fresh { x, key, id, triangle: t as u32 });
        Ok(id)
    }

    /// Whether an encoder's split is regular: told by building what a decoder would build.
    fn is_regular<S: Source>(
        &self,
        s: &mut LayerScratch,
        source: &S,
        inserted: usize,
        has: &dyn Fn(usize) -> bool,
        beside: &Beside,
    ) -> bool {
        let fits = |s: &mut LayerScratch, group: u32, child: usize, key: u32| {
            let local = self.only(s, group, child, key);
            s.locals[local as usize].key == key
        };
        for k in 0..self.spokes.len() {
            let g = s.group_of[k];
            if g == NONE {
                continue;
            }
            let keys = self.key(k);
            let children = Self::children(self.side(k));
            for child in 0..2 {
                let key = if children[0] { keys[child] } else { keys[0] };
                if children[child] && !fits(s, g, child, key) {
                    return false;
                }
            }
        }
        for t in 0..inserted {
            if !has(t) {
                continue;
            }
            let edge = t >= self.split.triangles.len();
            self.recall(s, t, beside);
            let keys = self.inserted_key(t);
            let Some(chosen) = self.wanted(s, source, keys, edge) else { return false };
            let p = s.places[chosen];
            if !edge && source.key(self.l, p.apex) != keys[2] {
                return false;
            }
            if !(fits(s, p.group, 0, keys[0]) && fits(s, p.group, 1, keys[1])) {
                return false;
            }
        }
        s.groups.iter().all(|g| {
            let own = self.own_value(g.w);
            let value = |local: u32| source.value(self.l, s.locals[local as usize].key);
            match g.last {
                [NONE, NONE] => true,
                [NONE, one] | [one, NONE] => value(one) == own,
                [one, two] => self.halfway(value(one), value(two)) == own,
            }
        })
    }
}

fn push_local(s: &mut LayerScratch, group: u32, child: usize, key: u32) -> u32 {
    let at = s.locals.len() as u32;
    let mut local = Local { key, group, child: child as u8, before: NONE, ..Local::default() };
    if group != NONE {
        let g = &mut s.groups[group as usize];
        local.before = g.last[child];
        g.last[child] = at;
        g.count[child] += 1;
    }
    s.locals.push(local);
    at
}
