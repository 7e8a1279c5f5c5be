//! Adaptive densities of a residual in units of its expected deviation.
//!
//! An integer `k` with prediction `mu` and deviation `s` gets the mass of a piecewise constant density over
//! `(k − ½ − mu)/s .. (k + ½ − mu)/s`, plus one unit so that nothing is impossible; what lies further than four
//! deviations away escapes to an exponential-Golomb code. The density itself, 32 bins between −4 and 4 deviations and
//! two for the escapes, adapts to what was seen: it stands for the mixture of scaled Gaussians that a prototype measured
//! (`docs/lab/prototypes.md`), without exponentials and without logarithms.

use crate::format::coder::range::{Bit, Coder, MAX_TOTAL, exp_golomb};

const BINS: usize = 34;
/// The mass of all bins.
const ONE: i32 = 1 << 23;
/// Spreads are in 1/256 step.
pub const Q: i64 = 256;
/// The smallest spread: below it the rounding of the lattice is all there is.
pub const MIN_SPREAD: i64 = 72;

/// Cumulative masses of the bins of a Laplace-like density, of 2^23.
const START: [i32; BINS + 1] = {
    // Masses per bin from the middle outwards: eight of width 1/8, four of width 1/4, four of width 1/2, the escape.
    let side = [1960u16, 1800, 1640, 1480, 1330, 1190, 1060, 940, 1560, 1130, 800, 560, 600, 250, 90, 40, 14];
    let mut t = [0i32; BINS + 1];
    let mut sum = 0u32;
    let mut k = 0;
    while k < 17 {
        sum += 2 * side[k] as u32;
        k += 1;
    }
    let mut at = 0u32;
    let mut i = 0;
    while i < BINS {
        let m = if i < 17 { side[16 - i] } else { side[i - 17] };
        at += m as u32;
        t[i + 1] = (at as u64 * ONE as u64 / sum as u64) as i32;
        i += 1;
    }
    t[BINS] = ONE;
    t
};

/// An adaptive density and its escapes.
#[derive(Clone, Debug)]
pub struct Density {
    cum: [i32; BINS + 1],
    seen: u16,
    dither: u32,
    escape: [Bit; 64],
}

impl Default for Density {
    fn default() -> Self {
        Density { cum: START, seen: 0, dither: 0x9e37_79b9, escape: [Bit::default(); 64] }
    }
}

/// Which bin `t` (in 1/65536 spread, within ±4) falls into, counted from 1, and how far into it, of 256.
#[inline(always)]
fn bin(t: i64) -> (usize, i64) {
    let (m, back) = if t < 0 { (-t, true) } else { (t, false) };
    let m = m.min((4 << 16) - 1);
    let (i, f) = if m < 1 << 16 {
        (m >> 13, (m & 0x1fff) >> 5)
    } else if m < 2 << 16 {
        (8 + ((m - (1 << 16)) >> 14), (m & 0x3fff) >> 6)
    } else {
        (12 + ((m - (2 << 16)) >> 15), (m & 0x7fff) >> 7)
    };
    if back { (16 - i as usize, 256 - f) } else { (17 + i as usize, f) }
}

impl Density {
    #[inline(always)]
    fn below(&self, t: i64) -> i64 {
        let (b, f) = bin(t);
        let (lo, hi) = (self.cum[b] as i64, self.cum[b + 1] as i64);
        lo + ((hi - lo) * f >> 8)
    }

    /// Where, in 1/65536 spread, about `mass` lies below.
    #[inline]
    fn quantile(&self, mass: i64) -> i64 {
        let mass = mass.min(ONE as i64 - 1) as i32;
        let b = self.cum[1..BINS].iter().map(|&c| (c <= mass) as usize).sum::<usize>();
        let (lo, hi) = (self.cum[b] as i64, self.cum[b + 1] as i64);
        let f = ((mass as i64 - lo) << 8) / (hi - lo).max(1);
        let (i, f, back) = if b < 17 { (16 - b as i64, 256 - f, true) } else { (b as i64 - 17, f, false) };
        let t = if i < 8 {
            (i << 13) + (f << 5)
        } else if i < 12 {
            (1 << 16) + ((i - 8) << 14) + (f << 6)
        } else {
            (2 << 16) + ((i - 12) << 15) + (f << 7)
        };
        if back { -t } else { t }
    }

    #[inline]
    fn learn(&mut self, b: usize) {
        let rate = match self.seen {
            0..=11 => 5,
            12..=59 => 6,
            60..=179 => 7,
            180..=599 => 8,
            _ => 9,
        };
        self.seen = self.seen.saturating_add(1);
        for i in 1..BINS {
            let target = if i > b { ONE - 800 * (BINS - i) as i32 } else { 800 * i as i32 };
            self.cum[i] += (target - self.cum[i]) >> rate;
        }
    }

    /// Code the integer `value`, expected near `mu` (in 1/256) with the spread `spread` (in 1/256).
    pub fn code<C: Coder>(&mut self, coder: &mut C, mu: i64, spread: i64, value: i32) -> i32 {
        let mut s = spread.max(MIN_SPREAD);
        let mut mu = mu;
        // Wide spreads: the low bits are noise.
        let mut low = 0u32;
        while s > 1024 * Q {
            s >>= 1;
            mu >>= 1;
            low += 1;
        }
        let k = (value >> low) as i64;
        let inverse = (1i64 << 40) / s;
        let scaled = |k: i64| ((2 * k - 1) * (Q / 2) - mu) * inverse >> 24;
        let first = (mu - 4 * s + Q / 2 + Q - 1).div_euclid(Q);
        let end = (mu + 4 * s + Q / 2).div_euclid(Q);
        let at = |d: &Self, k: i64| d.below(scaled(k)) + (k - first);
        let total = ONE as i64 + (end - first);
        debug_assert!(first < end && total <= MAX_TOTAL as i64);
        let (head, tail) = (at(self, first), at(self, end));
        // 0: below, 1: inside, 2: above.
        let out;
        if C::DECODING {
            let target = coder.decode_frequency(total as u32) as i64;
            if target < head {
                coder.update_interval(0, head as u32);
                let g = exp_golomb(coder, &mut self.escape, 0) as i64;
                self.learn(0);
                out = first - 1 - g;
            } else if target >= tail {
                coder.update_interval(tail as u32, (total - tail) as u32);
                let g = exp_golomb(coder, &mut self.escape, 0) as i64;
                self.learn(BINS - 1);
                out = end + g;
            } else {
                // Nearly everywhere the inverse of the density names the cell, or one beside it.
                let mut k = ((self.quantile(target) * s >> 16) + mu + Q / 2).div_euclid(Q).clamp(first, end - 1);
                let mut below = at(self, k);
                let mut above = at(self, k + 1);
                while below > target {
                    k -= 1;
                    (above, below) = (below, at(self, k));
                }
                while above <= target {
                    k += 1;
                    (below, above) = (above, at(self, k + 1));
                }
                coder.update_interval(below as u32, (above - below) as u32);
                self.seen_at(k, mu, inverse);
                out = k;
            }
        } else {
            coder.decode_frequency(total as u32);
            if k < first {
                coder.update_interval(0, head as u32);
                exp_golomb(coder, &mut self.escape, (first - 1 - k) as u32);
                self.learn(0);
            } else if k >= end {
                coder.update_interval(tail as u32, (total - tail) as u32);
                exp_golomb(coder, &mut self.escape, (k - end) as u32);
                self.learn(BINS - 1);
            } else {
                let (a, b) = (at(self, k), at(self, k + 1));
                coder.update_interval(a as u32, (b - a) as u32);
                self.seen_at(k, mu, inverse);
            }
            out = k;
        }
        let out = out.clamp(-(1 << 30), 1 << 30) as i32;
        if low > 0 {
            let rest = coder.bypass(low, value as u32 & ((1 << low) - 1));
            out.wrapping_shl(low) | rest as i32
        } else {
            out
        }
    }

    /// Learn a value somewhere in its cell: a cell may be wider than many bins.
    #[inline]
    fn seen_at(&mut self, k: i64, mu: i64, inverse: i64) {
        self.dither = self.dither.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let inside = (self.dither >> 24) as i64 - Q / 2;
        let t = (k * Q + inside - mu) * inverse >> 24;
        self.learn(bin(t.clamp(-(4 << 16) + 1, (4 << 16) - 1)).0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::coder::range::{Decoder, Encoder};
    use proptest::prelude::*;

    #[test]
    fn bins_cover_the_line_in_order() {
        let d = Density::default();
        let mut last = d.below(-(4 << 16));
        assert_eq!(bin(-(4 << 16) + 1).0, 1);
        assert_eq!(bin((4 << 16) - 1).0, 32);
        for t in (-(4 << 16)..4 << 16).step_by(37) {
            let f = d.below(t);
            assert!(f >= last, "{t}");
            last = f;
        }
    }

    proptest! {
        #[test]
        fn residuals_come_back(list in prop::collection::vec((-1_000_000i64..1_000_000, 0i64..60_000_000, -40_000_000i32..40_000_000, 0..30u32), 0..300)) {
            let mut e = Encoder::new();
            let mut d = Density::default();
            let mut values = Vec::new();
            for &(mu, s, v, shrink) in &list {
                values.push(d.code(&mut e, mu, s, v >> shrink));
            }
            let bytes = e.finish();
            let mut r = Decoder::new(&bytes);
            let mut d = Density::default();
            for (&(mu, s, v, shrink), &value) in list.iter().zip(&values) {
                prop_assert_eq!(value, v >> shrink);
                prop_assert_eq!(d.code(&mut r, mu, s, 0), value);
            }
            prop_assert!(!r.overrun());
        }
    }

    #[test]
    fn a_gaussian_costs_about_its_entropy() {
        let mut e = Encoder::new();
        let mut d = Density::default();
        let mut x = 1u64;
        let n = 20_000;
        for _ in 0..n {
            let mut g = 0.0;
            for _ in 0..12 {
                x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                g += (x >> 40) as f64 / (1u64 << 24) as f64;
            }
            let v = ((g - 6.0) * 5.0 + 0.3).round() as i32;
            d.code(&mut e, 77, 5 * Q, v);
        }
        let bits = e.finish().len() as f64 * 8.0 / n as f64;
        let entropy = (5.0 * (2.0 * std::f64::consts::PI * std::f64::consts::E).sqrt()).log2();
        assert!(bits < entropy + 0.03, "{bits} against {entropy}");
    }
}
