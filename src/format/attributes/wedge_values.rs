//! The values of the wedges around the children of a split, and their numbers.

use super::scratch::{Fresh, Group, LayerScratch, Local, UNSETTLED};
use super::structure::Job;
use super::values::{Far, VALUE_LIMIT, Value, WIDTH, code_far, code_pair, code_reach, similar};
use crate::format::coder::InvalidStream;
use crate::format::coder::range::Coder;
use crate::format::complex::placement::sub;
use crate::format::complex::{MAX_WEDGES, NEW, NONE, WedgeBatch, first_of_middle, middle};
use std::sync::atomic::Ordering::Relaxed;

fn within(value: &Value) -> Result<(), InvalidStream> {
    if value.iter().any(|c| c.unsigned_abs() > VALUE_LIMIT as u32) {
        return Err(InvalidStream("a value out of range"));
    }
    Ok(())
}

impl<C: Coder> Job<'_, C> {
    pub(super) fn halfway(&self, a: Value, b: Value) -> Value {
        let mut m = [0; WIDTH];
        for c in 0..self.sight.wedges.width {
            m[c] = middle(a[c], b[c], self.bias);
        }
        m
    }

    /// The children's values of a pair around their middle `m`.
    fn pair(&mut self, w: u32, m: Value, a: Value, b: Value) -> (Value, Value) {
        let difference = std::array::from_fn(|c| a[c].wrapping_sub(b[c]));
        let d = code_pair(self.coder, self.values, self.sight, w, difference);
        let mut one = [0; WIDTH];
        for c in 0..self.sight.wedges.width {
            one[c] = first_of_middle(m[c], d[c], self.bias);
        }
        (one, std::array::from_fn(|c| one[c].wrapping_sub(d[c])))
    }

    /// Values and numbers of all wedges.
    pub(super) fn code_values(
        &mut self,
        s: &mut LayerScratch,
        out: &mut WedgeBatch,
        regular: bool,
    ) -> Result<(), InvalidStream> {
        let width = self.sight.wedges.width;
        if !C::DECODING {
            for local in &mut s.locals {
                local.value = self.value_of(local.key);
            }
        }
        for g in 0..s.groups.len() {
            let Group { w, last, count, .. } = s.groups[g];
            let own = self.own_value(w);
            let mut main = last;
            if !regular {
                for child in 0..2 {
                    if count[child] > 1 {
                        main[child] = self.main(s, last, count, child, own);
                    }
                }
            }
            let value = |s: &LayerScratch, local: u32| if local == NONE { own } else { s.locals[local as usize].value };
            let (a, b) = (value(s, main[0]), value(s, main[1]));
            match main {
                [NONE, NONE] => continue,
                [NONE, one] | [one, NONE] => {
                    s.locals[one as usize].id = w;
                    let v = s.locals[one as usize].value;
                    if regular || self.coder.bit(&mut self.structure.kept, v == own) {
                        s.locals[one as usize].value = own;
                    } else {
                        let v = code_far(self.coder, self.values, Far::Same, own, v);
                        within(&v)?;
                        s.locals[one as usize].value = v;
                        out.changed.push(w);
                        out.changed_values.extend_from_slice(&v[..width]);
                    }
                }
                [one, two] => {
                    let halfway = regular || {
                        let halfway = self.halfway(a, b) == own;
                        self.coder.bit(&mut self.structure.middle, halfway)
                    };
                    let (a, b) = if halfway {
                        self.pair(w, own, a, b)
                    } else {
                        let a = code_far(self.coder, self.values, Far::Same, own, a);
                        (a, code_far(self.coder, self.values, Far::Same, a, b))
                    };
                    within(&a)?;
                    within(&b)?;
                    s.locals[one as usize].value = a;
                    s.locals[one as usize].id = w;
                    out.changed.push(w);
                    out.changed_values.extend_from_slice(&a[..width]);
                    s.locals[two as usize].value = b;
                    s.locals[two as usize].id = self.fresh(out, &b)?;
                }
            }
            s.groups[g].main = main;
        }
        if !regular {
            // Further wedges out of a group lie near the main one of the same child; those of a chart that begins, beside each other.
            let mut begun = false;
            for i in 0..s.locals.len() {
                let Local { group, child, .. } = s.locals[i];
                let (from, guess) = if group == NONE {
                    (if begun { Far::Edge } else { Far::Last }, self.values.last)
                } else {
                    let main = s.groups[group as usize].main[child as usize];
                    if main == i as u32 {
                        continue;
                    }
                    (Far::Same, s.locals[main as usize].value)
                };
                begun = group == NONE && !begun;
                let v = code_far(self.coder, self.values, from, guess, s.locals[i].value);
                within(&v)?;
                s.locals[i].value = v;
                s.locals[i].id = self.fresh(out, &v)?;
            }
            for k in 0..s.fresh.len() {
                let Fresh { x, key, triangle, .. } = s.fresh[k];
                let v = self.value_of(key);
                let v = self.apex_value(s, x, triangle as usize, v);
                within(&v)?;
                s.fresh[k].id = self.fresh(out, &v)?;
            }
            // Numbers of new wedges are below `UNSETTLED`.
            for t in &mut s.inserted {
                if t[2] != NONE && t[2] & NEW != 0 && t[2] & UNSETTLED != 0 {
                    t[2] = s.fresh[(t[2] & !(NEW | UNSETTLED)) as usize].id;
                }
            }
        }
        if let Some(given) = self.given {
            s.locals.iter().for_each(|local| self.named.note(self.l, given, local.id, local.key));
            s.fresh.iter().for_each(|f| self.named.note(self.l, given, f.id, f.key));
        }
        Ok(())
    }

    /// A new value at the apex `x`: by the fit around the wedge that its triangle continues, else by the shape of the triangle.
    fn apex_value(&mut self, s: &LayerScratch, x: u32, t: usize, value: Value) -> Value {
        let level = self.view.level;
        let r = sub(level.positions[x as usize], self.sight.patch.at);
        let [one, two] = [s.inserted[t][0], s.inserted[t][1]].map(|local| s.locals[local as usize]);
        if one.group != NONE {
            let w = s.groups[one.group as usize].w;
            return code_reach(self.coder, self.values, self.sight, w, r, value);
        }
        // The children lie half their difference to either side.
        let e = self.sight.frame.delta.map(|c| -2 * c as i64);
        let f = std::array::from_fn(|k| 2 * r[k] - self.sight.frame.delta[k] as i64);
        let left = self.split.triangles.get(t).is_some_and(|t| !t.reversed);
        let width = self.sight.wedges.width;
        let mut guess = similar(e, f, one.value, two.value, width, left);
        if width == 2 {
            let other = similar(e, f, one.value, two.value, width, !left);
            let far = |g: Value| (0..2).map(|c| (value[c] as i64 - g[c] as i64).abs()).sum::<i64>();
            let mirrored = !C::DECODING && far(other) < far(guess);
            if self.coder.bit(&mut self.structure.mirrored, mirrored) {
                guess = other;
            }
        }
        code_far(self.coder, self.values, Far::Corner, guess, value)
    }

    /// Which of several wedges of a group is the main one of a child: for an encoder one that leaves the middle where it is.
    fn main(&mut self, s: &LayerScratch, last: [u32; 2], count: [u32; 2], child: usize, own: Value) -> u32 {
        let chain = |mut at: u32| {
            std::iter::from_fn(move || {
                let here = (at != NONE).then_some(at)?;
                at = s.locals[here as usize].before;
                Some(here)
            })
        };
        let mut index = 0;
        if !C::DECODING {
            let other = 1 - child;
            let good = |i: u32| {
                let v = s.locals[i as usize].value;
                if last[other] == NONE {
                    return v == own;
                }
                chain(last[other]).take(64).any(|j| {
                    let u = s.locals[j as usize].value;
                    self.halfway(if child == 0 { v } else { u }, if child == 0 { u } else { v }) == own
                })
            };
            index = chain(last[child]).position(good).unwrap_or(0) as u32;
        }
        if !self.coder.bit(&mut self.structure.main, index == 0) {
            index = 1 + self.coder.uniform(count[child] - 1, index.saturating_sub(1));
        }
        chain(last[child]).nth(index as usize).unwrap_or(last[child])
    }

    /// A new wedge.
    fn fresh(&self, out: &mut WedgeBatch, value: &Value) -> Result<u32, InvalidStream> {
        let width = self.sight.wedges.width;
        let number = out.fresh.len() / width;
        if number >= UNSETTLED as usize || self.sight.wedges.len() + number >= MAX_WEDGES {
            return Err(InvalidStream("more wedges than a layer can have"));
        }
        if let Some(left) = self.wedge_budget.get(self.l)
            && left.fetch_update(Relaxed, Relaxed, |r| r.checked_sub(1)).is_err()
        {
            return Err(InvalidStream("more wedges than the header announces"));
        }
        out.fresh.extend_from_slice(&value[..width]);
        Ok(NEW | number as u32)
    }
}
