//! Logistic mixing of several adaptive predictions of one decision, in integers.
//!
//! Each context has a [`Slot`], a probability of 22 bits with a counted learning rate. The predictions are taken to the
//! logistic domain (`stretch`, 8 fractional bits, within ±2047), summed with the weights of a small set that the caller
//! selects, and taken back (`squash`). After the decision the weights move along the gradient of the coding cost
//! (Mahoney 2005, the PAQ family). A slot that has seen nothing says 1/2 and so does not vote.

use crate::format::coder::range::Coder;

/// Number of predictions that are mixed.
pub(super) const INPUTS: usize = 8;

/// `65536 / (1 + exp(-x / 256))` for x = -2048, -1920, … 2048.
const SQUASH: [i32; 33] = [
    22, 36, 60, 98, 162, 267, 439, 720, 1179, 1921, 3108, 4971, 7812, 11955, 17625, 24743, 32768, 40793, 47911, 53581,
    57724, 60565, 62428, 63615, 64357, 64816, 65097, 65269, 65374, 65438, 65476, 65500, 65514,
];

/// Logistic domain to probability of 65536, piecewise linear, within 22..=65514.
const fn squash(x: i32) -> i32 {
    let x = if x < -2047 {
        -2047
    } else if x > 2047 {
        2047
    } else {
        x
    };
    let at = (x + 2048) as usize;
    let (cell, part) = (at >> 7, (at & 127) as i32);
    (SQUASH[cell] * (128 - part) + SQUASH[cell + 1] * part) >> 7
}

/// The inverse of [`squash`] for the probabilities `16 * k`: the least `x` with `squash(x) >= 16 * k + 8`.
const STRETCH: [i16; 4096] = {
    let mut t = [2047i16; 4096];
    let mut x = -2047;
    let mut k = 0;
    while k < 4096 {
        while x < 2047 && squash(x) < 16 * k as i32 + 8 {
            x += 1;
        }
        t[k] = x as i16;
        k += 1;
    }
    t
};

/// Learning rates `65536 / (n + 1.9)` by number of decisions seen.
const RATES: [u16; 256] = {
    let mut t = [0u16; 256];
    let mut n = 0;
    while n < 256 {
        t[n] = (655_360 / (10 * n as u32 + 19)) as u16;
        n += 1;
    }
    t
};

/// Decisions after which a slot's average becomes a sliding window.
const WINDOW: u32 = 80;

/// A probability of 22 bits above a counter of 10 bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot(u32);

impl Default for Slot {
    fn default() -> Self {
        Slot(1 << 31)
    }
}

impl Slot {
    #[inline(always)]
    fn stretched(self) -> i32 {
        STRETCH[(self.0 >> 20) as usize] as i32
    }

    #[inline(always)]
    fn update(&mut self, bit: bool) {
        let n = self.0 & 1023;
        let p = (self.0 >> 10) as i64;
        let target = if bit { (1 << 22) - 1 } else { 0 };
        let p = p + (((target - p) * RATES[n as usize] as i64) >> 16);
        self.0 = (p as u32) << 10 | if n < WINDOW { n + 1 } else { n };
    }
}

/// The most decisions that count of those before a refresh.
const FRESH: u32 = 30;

/// One set of weights, of 65536.
#[derive(Clone, Copy, Debug)]
struct Weights {
    w: [i32; INPUTS],
    seen: u32,
}

/// Several tables of slots, one per input, and the sets of weights.
#[derive(Clone, Debug)]
pub(super) struct Mixer {
    tables: [Vec<Slot>; INPUTS],
    weights: Vec<Weights>,
}

impl Mixer {
    /// Tables of the given sizes and `sets` sets of weights.
    pub(super) fn new(sizes: [usize; INPUTS], sets: usize) -> Self {
        let w = [65536 * 3 / 10; INPUTS];
        Mixer { tables: sizes.map(|n| vec![Slot::default(); n]), weights: vec![Weights { w, seen: 0 }; sets] }
    }

    /// Whether a context of table `k` has seen more than a few decisions.
    pub(super) fn told(&self, k: usize, context: usize) -> bool {
        self.tables[k][context].0 & 1023 > 2
    }

    /// Let all slots learn fast again, as what comes next differs from what was.
    pub(super) fn refresh(&mut self) {
        for slot in self.tables.iter_mut().flatten() {
            slot.0 = slot.0 & !1023 | (slot.0 & 1023).min(FRESH);
        }
    }

    /// Code one decision under `contexts` (one per table) with the weights `set`.
    #[inline]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, contexts: [usize; INPUTS], set: usize, bit: bool) -> bool {
        let x: [i32; INPUTS] = std::array::from_fn(|k| self.tables[k][contexts[k]].stretched());
        let weights = &mut self.weights[set];
        let mut dot = 0i64;
        for (&x, &w) in x.iter().zip(&weights.w) {
            dot += x as i64 * w as i64;
        }
        let p = squash((dot >> 16).clamp(-2047, 2047) as i32);
        let bit = coder.symbol(&[p as u32, 65536 - p as u32], 65536, !bit as usize) == 0;
        let error = if bit { 65536 - p } else { -p } as i64;
        let rate = if weights.seen < 256 { 30 - (weights.seen >> 4) as i64 } else { 22 };
        weights.seen = weights.seen.saturating_add(1);
        for (w, &x) in weights.w.iter_mut().zip(&x) {
            *w = (*w as i64 + ((x as i64 * error * rate + (1 << 19)) >> 20)).clamp(-(1 << 20), 1 << 20) as i32;
        }
        for (table, &context) in self.tables.iter_mut().zip(&contexts) {
            table[context].update(bit);
        }
        bit
    }
}
