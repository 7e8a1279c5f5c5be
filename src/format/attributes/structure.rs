//! Which wedges the corners around the children of a split get.

use super::given::{GivenLayer, Keys, Named};
use super::scratch::{Group, LayerScratch, push_local};
use super::values::{LayerNeighbourhood, Value, ValueModels, WIDTH};
use crate::format::coder::InvalidStream;
use crate::format::coder::range::{Bit, Coder};
use crate::format::complex::{NONE, Side, Split, WedgeBatch};
use crate::format::split::neighbourhood::LevelGeometry;
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

/// Elements that appear whose places are kept.
const KEPT: usize = 4;
/// Elements around an apex whose wedges are considered, new wedges at apexes too, and elements beside one that appears.
pub(super) const NEAR: usize = 64;

/// A split may say that very much appears: behind its end a stream is all zeros, no reason to go on with it.
pub(super) fn ends_early<C: Coder>(coder: &C) -> Result<(), InvalidStream> {
    if coder.overrun() { Err(InvalidStream("a segment that ends too early")) } else { Ok(()) }
}

/// Lists for an element that appears the spokes beside it, and their corners at its apex.
pub(super) type Beside<'a> = dyn Fn(usize, &mut Vec<(u32, u32)>) + 'a;

/// One layer of one split.
pub(super) struct Job<'a, C> {
    pub(super) coder: &'a mut C,
    pub(super) structure: &'a mut StructureModels,
    pub(super) values: &'a mut ValueModels,
    pub(super) view: &'a LevelGeometry<'a>,
    pub(super) sight: &'a LayerNeighbourhood<'a>,
    pub(super) l: usize,
    pub(super) split: &'a Split,
    pub(super) bias: i32,
    pub(super) keys: &'a Keys,
    /// What an encoder knows of the layer.
    pub(super) given: Option<&'a GivenLayer<'a>>,
    pub(super) named: &'a mut Named,
    /// Wedges that each layer may still gain; empty for an encoder.
    pub(super) wedge_budget: &'a [AtomicU64],
}

/// The key of a corner that an encoder has not been told; never asked for in earnest.
pub(super) const UNKNOWN: u32 = NONE;

impl<C: Coder> Job<'_, C> {
    pub(super) fn side(&self, k: usize) -> Side {
        self.split.sides[self.sight.spokes[k].place as usize]
    }

    pub(super) fn key(&self, k: usize) -> [u32; 2] {
        self.keys.star.get(self.sight.spokes[k].place as usize).copied().unwrap_or([UNKNOWN; 2])
    }

    pub(super) fn inserted_key(&self, t: usize) -> [u32; 3] {
        self.keys.inserted.get(t).copied().unwrap_or([UNKNOWN; 3])
    }

    /// The encoder's key of wedge `w` of the coarser level.
    pub(super) fn key_of(&self, w: u32) -> u32 {
        self.given.map_or(UNKNOWN, |layer| layer.key(w))
    }

    /// The encoder's value at the finer level of the wedge with this key; a decoder has yet to read it.
    pub(super) fn value_of(&self, key: u32) -> Value {
        self.given.map_or([0; WIDTH], |layer| layer.value(key))
    }

    pub(super) fn own_value(&self, w: u32) -> Value {
        // Nearly always two components: no copy of a length to be found out.
        if let &[a, b] = self.sight.wedges.value(w) {
            return [a, b, 0, 0];
        }
        let mut out = [0; WIDTH];
        out[..self.sight.wedges.width].copy_from_slice(self.sight.wedges.value(w));
        out
    }

    /// The corners that a side gives to the children: first child, second child.
    pub(super) fn children(side: Side) -> [bool; 2] {
        match side {
            Side::One => [true, false],
            Side::Two => [false, true],
            Side::Grow12 | Side::Grow21 => [true, true],
        }
    }

    #[allow(clippy::too_many_arguments)]
    pub(super) fn run(
        &mut self,
        s: &mut LayerScratch,
        out: &mut WedgeBatch,
        elements: usize,
        inserted: usize,
        has: &dyn Fn(usize) -> bool,
        beside: &Beside,
    ) -> Result<(), InvalidStream> {
        let n = self.sight.spokes.len();
        // Groups, in order of their wedges' numbers.
        s.group_of.clear();
        s.group_of.extend(self.sight.spokes.iter().map(|k| self.sight.wedges.corner[k.own as usize]));
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
            self.corners(s, out, inserted, torn, has, beside)?;
        }

        // The record, in the order of the star.
        let first = out.star.len();
        out.star.resize(first + elements, NONE);
        let id = |s: &LayerScratch, local: u32| if local == NONE { NONE } else { s.locals[local as usize].id };
        let grown = out.grown.len();
        for (k, spoke) in self.sight.spokes.iter().enumerate() {
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
    fn corners(
        &mut self,
        s: &mut LayerScratch,
        out: &mut WedgeBatch,
        inserted: usize,
        torn: usize,
        has: &dyn Fn(usize) -> bool,
        beside: &Beside,
    ) -> Result<(), InvalidStream> {
        let n = self.sight.spokes.len();
        let triangles = self.split.triangles.len();
        let crowd = if s.groups.len() < 2 {
            s.groups.len()
        } else if s.groups.len() < n {
            2
        } else {
            3
        };
        let context = crowd * 4 + torn.min(3);
        let regular = !C::DECODING && self.is_regular(s, inserted, has, beside);
        let regular = self.coder.bit(&mut self.structure.regular[context], regular);
        for g in &mut s.groups {
            *g = Group::of(g.w);
        }
        s.locals.clear();
        // Most splits: no seams, few triangles, of which all continue the only element there is to continue.
        let few = inserted == triangles && inserted == s.listed.len() && inserted <= KEPT && torn == 0;
        if regular && few && s.groups.len() == 1 && !s.group_of.contains(&NONE) {
            self.plain(s, inserted);
            return self.code_values(s, out, true);
        }
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
            let wanted = self.wanted(s, keys, edge);
            let count = s.places.len();
            if regular && count == 0 {
                return Err(InvalidStream("an element that continues nothing in a regular split"));
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
                s.inserted[t][2] = self.apex(s, t, x, keys[2], place, regular)?;
            }
        }
        self.code_values(s, out, regular)
    }

    /// The corners of a regular split without seams, of which all elements have values: a wedge for each child.
    fn plain(&mut self, s: &mut LayerScratch, inserted: usize) {
        let mut of = [NONE; 2];
        let mut local = |s: &mut LayerScratch, child: usize, key: u32| {
            if of[child] == NONE {
                of[child] = push_local(s, 0, child, key);
            }
            of[child]
        };
        for t in 0..self.sight.spokes.len() {
            let keys = self.key(t);
            let children = Self::children(self.side(t));
            for child in 0..2 {
                if children[child] {
                    s.star[t][child] = local(s, child, if children[0] { keys[child] } else { keys[0] });
                }
            }
        }
        for t in 0..inserted {
            let keys = self.inserted_key(t);
            let [one, two] = [0, 1].map(|child| local(s, child, keys[child]));
            s.inserted[t] = [one, two, s.listed[t].apex];
        }
    }
}
