//! Which wedge of several a corner continues: places that a triangle may continue, wedges of a child, wedges at an apex; and whether an
//! encoder's split needs none of it to be told.

use super::scratch::{Fresh, Group, LayerScratch, Local, Place, UNSETTLED, push_local};
use super::structure::{Beside, Job, NEAR, UNKNOWN};
use crate::format::coder::InvalidStream;
use crate::format::coder::range::Coder;
use crate::format::complex::{BIG, NEW, NONE};

/// Wedges of a group that a child has which are considered beside the last.
const BACK: u32 = 64;

impl<C: Coder> Job<'_, C> {
    /// The places of element `t`, as they were listed or anew.
    pub(super) fn recall(&self, s: &mut LayerScratch, t: usize, beside: &Beside) {
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
    pub(super) fn look(&self, s: &mut LayerScratch) {
        s.places.clear();
        for &(k, corner) in &s.adjacent {
            let group = s.group_of[k as usize];
            if group == NONE {
                continue;
            }
            let apex = self.sight.wedges.corner[corner as usize];
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
    pub(super) fn wanted(&self, s: &LayerScratch, keys: [u32; 3], edge: bool) -> Option<usize> {
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
        let apex = |p: &Place| edge || self.key_of(p.apex) == keys[2];
        // Rather one whose apex continues too.
        s.places.iter().position(|p| fits(p) && apex(p)).or_else(|| s.places.iter().position(fits))
    }

    /// The group that one of the corners of an inserted element at the children is known to belong to.
    pub(super) fn inside(&self, s: &LayerScratch, keys: [u32; 3]) -> Option<u32> {
        if C::DECODING {
            return None;
        }
        let known = |local: &&Local| local.group != NONE && local.key == keys[local.child as usize];
        // Any will do, and so will none: a hub need not be searched through for each of its triangles.
        s.locals.iter().take(1 << 12).find(known).map(|local| local.group)
    }

    /// The one wedge that a child has of a group.
    pub(super) fn only(&self, s: &mut LayerScratch, group: u32, child: usize, key: u32) -> u32 {
        match s.groups[group as usize].last[child] {
            NONE => push_local(s, group, child, key),
            local => local,
        }
    }

    /// One of the wedges that a child has of a group, or a further one.
    pub(super) fn told(&mut self, s: &mut LayerScratch, group: u32, child: usize, key: u32) -> u32 {
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
    pub(super) fn apex(
        &mut self,
        s: &mut LayerScratch,
        t: usize,
        x: u32,
        key: u32,
        place: Option<Place>,
        regular: bool,
    ) -> Result<u32, InvalidStream> {
        let given = self.given;
        let key_of = |w: u32| given.map_or(UNKNOWN, |layer| layer.key(w));
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
                let w = self.sight.wedges.corner[faces.start[f as usize] as usize + at];
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
                return Err(InvalidStream("a wedge of an apex that has none"));
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
    pub(super) fn is_regular(
        &self,
        s: &mut LayerScratch,
        inserted: usize,
        has: &dyn Fn(usize) -> bool,
        beside: &Beside,
    ) -> bool {
        let fits = |s: &mut LayerScratch, group: u32, child: usize, key: u32| {
            let local = self.only(s, group, child, key);
            s.locals[local as usize].key == key
        };
        for k in 0..self.sight.spokes.len() {
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
            let Some(chosen) = self.wanted(s, keys, edge) else { return false };
            let p = s.places[chosen];
            if !edge && self.key_of(p.apex) != keys[2] {
                return false;
            }
            if !(fits(s, p.group, 0, keys[0]) && fits(s, p.group, 1, keys[1])) {
                return false;
            }
        }
        s.groups.iter().all(|g| {
            let own = self.own_value(g.w);
            let value = |local: u32| self.value_of(s.locals[local as usize].key);
            match g.last {
                [NONE, NONE] => true,
                [NONE, one] | [one, NONE] => value(one) == own,
                [one, two] => self.halfway(value(one), value(two)) == own,
            }
        })
    }
}
