//! A range coder with adaptive binary models, written once for both directions.
//!
//! Martin 1979 with a 64-bit range, renormalised by 32-bit words. A symbol's model is one function generic over
//! [`Coder`]: the [`Encoder`] is handed the value and returns it, the [`Decoder`] ignores what it is handed and returns
//! what the stream says, so the two directions cannot drift apart.
//!
//! Invariants: after each symbol `range ≥ 2^32`; totals are at most [`MAX_TOTAL`], so that no symbol of frequency ≥ 1 loses its
//! interval. The decoder reads zeros behind the end of its bytes and never fails on the way: [`Decoder::overrun`]
//! tells, at the end or before, whether the stream was too short.

use std::borrow::Cow;

/// The largest total of frequencies of one symbol.
pub const MAX_TOTAL: u32 = 1 << 28;

const RENORM: u64 = 1 << 32;

/// Reciprocals `65536 / (n + 1.6)` for the first updates of a model: it starts as an average and becomes a sliding window.
const RATE: [u16; 120] = {
    let mut t = [0u16; 120];
    let mut n = 0;
    while n < 120 {
        t[n] = (655_360 / (10 * n as u32 + 16)) as u16;
        n += 1;
    }
    t
};

/// An adaptive probability of one binary decision: the mean of a fast and a slow exponential average.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bit {
    fast: u16,
    slow: u16,
    seen: u8,
}

impl Default for Bit {
    fn default() -> Self {
        Bit::with(32768)
    }
}

impl Bit {
    /// A model that starts with the probability `p / 65536` for `true`; `p` in 64..=65472.
    pub const fn with(p: u16) -> Self {
        Bit { fast: p, slow: p, seen: 0 }
    }

    /// Probability of `true`, of 65536; within 16..=65520.
    #[inline(always)]
    pub fn p(self) -> u32 {
        ((self.fast as u32 + self.slow as u32) >> 1).clamp(16, 65520)
    }

    /// Move towards what was seen.
    #[inline(always)]
    pub fn update(&mut self, bit: bool) {
        let target = if bit { 65535i32 } else { 0 };
        let (f, s) = (self.fast as i32, self.slow as i32);
        if self.seen < 120 {
            let slow_rate = RATE[self.seen as usize] as i64;
            let fast_rate = slow_rate.max(65536 / 32);
            self.fast = (f + (((target - f) as i64 * fast_rate) >> 16) as i32) as u16;
            self.slow = (s + (((target - s) as i64 * slow_rate) >> 16) as i32) as u16;
            self.seen += 1;
        } else {
            self.fast = (f + ((target - f) >> 5)) as u16;
            self.slow = (s + ((target - s) >> 7)) as u16;
        }
    }
}

/// One direction of coding. Values handed to a decoder are ignored.
pub trait Coder {
    /// Whether this is a decoder.
    const DECODING: bool;

    /// One decision with an adaptive model.
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool;

    /// One of `freqs.len()` symbols with the given frequencies (each ≥ 1), which sum to `total` ≤ [`MAX_TOTAL`].
    fn symbol(&mut self, freqs: &[u32], total: u32, index: usize) -> usize;

    /// A number below `total`, all equally likely; `1 ≤ total ≤ MAX_TOTAL`.
    fn uniform(&mut self, total: u32, value: u32) -> u32;

    /// The low `bits` bits of a number, all equally likely; `bits ≤ 32`.
    #[inline]
    fn bypass(&mut self, bits: u32, value: u32) -> u32 {
        if bits > 16 {
            let high = self.uniform(1 << (bits - 16), value >> 16);
            high << 16 | self.uniform(1 << 16, value & 0xffff)
        } else {
            self.uniform(1 << bits, value & ((1u32 << bits) - 1))
        }
    }

    /// First half of a symbol of the caller's own making: a number below `total` ≤ [`MAX_TOTAL`] that lies inside the symbol's
    /// interval. Encoders return 0. [`Coder::update_interval`] has to follow.
    fn decode_frequency(&mut self, total: u32) -> u32;

    /// Second half: the symbol's interval `from .. from + width`, `width ≥ 1`.
    fn update_interval(&mut self, from: u32, width: u32);

    /// Bits written or read so far, for accounts of bits by kind; 0 where the direction does not keep account.
    fn bits(&self) -> f64 {
        0.0
    }

    /// Whether a decoder has gone on behind the end of its bytes further than an honest stream makes it.
    fn overrun(&self) -> bool {
        false
    }
}

/// Writes symbols.
#[derive(Clone, Debug)]
pub struct Encoder {
    out: Vec<u8>,
    low: u64,
    range: u64,
    unit: u64,
}

impl Default for Encoder {
    fn default() -> Self {
        Encoder { out: Vec::new(), low: 0, range: u64::MAX, unit: 0 }
    }
}

impl Encoder {
    /// An empty stream.
    pub fn new() -> Self {
        Self::default()
    }

    #[inline(always)]
    fn narrow(&mut self, offset: u64, width: u64) {
        let (low, carry) = self.low.overflowing_add(offset);
        self.low = low;
        if carry {
            carry_back(&mut self.out);
        }
        self.range = width;
        while self.range < RENORM {
            self.out.extend_from_slice(&((self.low >> 32) as u32).to_be_bytes());
            self.low <<= 32;
            self.range <<= 32;
        }
    }

    /// Write the last symbols out: at most eight bytes, mostly one or two.
    pub fn finish(mut self) -> Vec<u8> {
        for bytes in 1..=8u32 {
            let mask = if bytes == 8 { 0 } else { u64::MAX >> (8 * bytes) };
            let (sum, carry) = self.low.overflowing_add(mask);
            let value = sum & !mask;
            if value.wrapping_sub(self.low) < self.range {
                if carry {
                    carry_back(&mut self.out);
                }
                self.out.extend_from_slice(&value.to_be_bytes()[..bytes as usize]);
                break;
            }
        }
        self.out
    }
}

fn carry_back(out: &mut [u8]) {
    for byte in out.iter_mut().rev() {
        *byte = byte.wrapping_add(1);
        if *byte != 0 {
            break;
        }
    }
}

impl Coder for Encoder {
    const DECODING: bool = false;

    #[inline(always)]
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool {
        let bound = (self.range >> 16) * model.p() as u64;
        if bit {
            self.narrow(0, bound);
        } else {
            self.narrow(bound, self.range - bound);
        }
        model.update(bit);
        bit
    }

    #[inline]
    fn symbol(&mut self, freqs: &[u32], total: u32, index: usize) -> usize {
        let below: u64 = freqs[..index].iter().map(|&f| f as u64).sum();
        let unit = self.range / total as u64;
        self.narrow(unit * below, unit * freqs[index] as u64);
        index
    }

    #[inline]
    fn uniform(&mut self, total: u32, value: u32) -> u32 {
        let unit = self.range / total as u64;
        self.narrow(unit * value as u64, unit);
        value
    }

    #[inline]
    fn decode_frequency(&mut self, total: u32) -> u32 {
        self.unit = self.range / total as u64;
        0
    }

    #[inline]
    fn update_interval(&mut self, from: u32, width: u32) {
        self.narrow(self.unit * from as u64, self.unit * width as u64);
    }

    fn bits(&self) -> f64 {
        self.out.len() as f64 * 8.0 + 64.0 - (self.range as f64).log2()
    }
}

/// Reads symbols.
#[derive(Clone, Debug)]
pub struct Decoder<'a> {
    bytes: Cow<'a, [u8]>,
    at: usize,
    code: u64,
    range: u64,
    unit: u64,
}

impl<'a> Decoder<'a> {
    /// Read from `bytes`, which an [`Encoder`] has written.
    pub fn new(bytes: impl Into<Cow<'a, [u8]>>) -> Self {
        let mut d = Decoder { bytes: bytes.into(), at: 0, code: 0, range: u64::MAX, unit: 0 };
        d.code = (d.word() as u64) << 32 | d.word() as u64;
        d
    }

    #[inline(always)]
    fn word(&mut self) -> u32 {
        let word = match self.bytes.get(self.at..self.at + 4) {
            Some(b) => u32::from_be_bytes([b[0], b[1], b[2], b[3]]),
            None => {
                let mut b = [0u8; 4];
                for (k, byte) in b.iter_mut().enumerate() {
                    *byte = self.bytes.get(self.at + k).copied().unwrap_or(0);
                }
                u32::from_be_bytes(b)
            }
        };
        self.at += 4;
        word
    }

    #[inline(always)]
    fn narrow(&mut self, offset: u64, width: u64) {
        self.code = self.code.wrapping_sub(offset);
        self.range = width;
        while self.range < RENORM {
            self.code = self.code << 32 | self.word() as u64;
            // A width of 0 cannot come from an encoder; a hostile stream must not hang the reader.
            self.range = (self.range << 32).max(1 << 20);
        }
    }

    /// Whether the reader had to go on behind the end of its bytes further than an honest stream makes it.
    #[inline(always)]
    pub fn overrun(&self) -> bool {
        self.at > self.bytes.len() + 12
    }
}

impl Coder for Decoder<'_> {
    const DECODING: bool = true;

    #[inline(always)]
    fn overrun(&self) -> bool {
        Decoder::overrun(self)
    }

    #[inline(always)]
    fn bit(&mut self, model: &mut Bit, _: bool) -> bool {
        let bound = (self.range >> 16) * model.p() as u64;
        let bit = self.code < bound;
        if bit {
            self.narrow(0, bound);
        } else {
            self.narrow(bound, self.range - bound);
        }
        model.update(bit);
        bit
    }

    #[inline]
    fn symbol(&mut self, freqs: &[u32], total: u32, _: usize) -> usize {
        let unit = self.range / total as u64;
        let target = (self.code / unit).min(total as u64 - 1);
        let mut below = 0u64;
        let mut index = 0;
        while index + 1 < freqs.len() && below + freqs[index] as u64 <= target {
            below += freqs[index] as u64;
            index += 1;
        }
        self.narrow(unit * below, unit * freqs[index] as u64);
        index
    }

    #[inline]
    fn uniform(&mut self, total: u32, _: u32) -> u32 {
        let unit = self.range / total as u64;
        let value = (self.code / unit).min(total as u64 - 1);
        self.narrow(unit * value, unit);
        value as u32
    }

    #[inline]
    fn decode_frequency(&mut self, total: u32) -> u32 {
        self.unit = self.range / total as u64;
        (self.code / self.unit).min(total as u64 - 1) as u32
    }

    #[inline]
    fn update_interval(&mut self, from: u32, width: u32) {
        self.narrow(self.unit * from as u64, self.unit * width as u64);
    }
}

/// A number ≥ 0 as an exponential-Golomb code with modelled prefix: `log2(value + 1)` in unary through `models`, the
/// rest raw but for its first bit. `models` wants 64 entries.
pub fn exp_golomb<C: Coder>(coder: &mut C, models: &mut [Bit; 64], value: u32) -> u32 {
    let v = value as u64 + 1;
    let length = if C::DECODING { 0 } else { 63 - v.leading_zeros() };
    let mut n = 0u32;
    while n < 32 && coder.bit(&mut models[n as usize], n < length) {
        n += 1;
    }
    if n == 0 {
        return 0;
    }
    let top = coder.bit(&mut models[32 + n.min(31) as usize], v >> (n - 1) & 1 == 1) as u64;
    let rest = if n > 1 { coder.bypass(n - 1, (v & ((1 << (n - 1)) - 1)) as u32) as u64 } else { 0 };
    ((1u64 << n | top << (n - 1) | rest) - 1).min(u32::MAX as u64) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn drive<C: Coder>(coder: &mut C, script: &[(u8, u32, u32)]) -> Vec<u32> {
        let mut bits = [Bit::default(); 4];
        let mut lengths = [Bit::default(); 64];
        script
            .iter()
            .map(|&(kind, a, b)| match kind % 5 {
                0 => coder.bit(&mut bits[(a % 4) as usize], b % 7 == 0) as u32,
                1 => {
                    let total = a % MAX_TOTAL + 1;
                    coder.uniform(total, b % total)
                }
                2 => coder.bypass(a % 33, if a % 33 == 32 { b } else { b & ((1u64 << (a % 33)) - 1) as u32 }),
                3 => exp_golomb(coder, &mut lengths, b >> (a % 32)),
                _ => {
                    let freqs = [1, a % 1000 + 1, 5, 1 << 20];
                    coder.symbol(&freqs, freqs.iter().sum(), (b % 4) as usize) as u32
                }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn what_goes_in_comes_out(script in prop::collection::vec((any::<u8>(), any::<u32>(), any::<u32>()), 0..600)) {
            let mut e = Encoder::new();
            let written = drive(&mut e, &script);
            let bits = e.bits();
            let bytes = e.finish();
            prop_assert!(bytes.len() as f64 * 8.0 <= bits + 72.0);
            let mut d = Decoder::new(&bytes);
            prop_assert_eq!(drive(&mut d, &script), written);
            prop_assert!(!d.overrun());
        }

        #[test]
        fn any_bytes_decode_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..64), script in prop::collection::vec((any::<u8>(), any::<u32>(), any::<u32>()), 0..300)) {
            drive(&mut Decoder::new(&bytes), &script);
        }
    }

    #[test]
    fn a_biased_bit_costs_its_entropy() {
        let mut e = Encoder::new();
        let mut m = Bit::default();
        for k in 0..80_000u32 {
            e.bit(&mut m, k.wrapping_mul(2_654_435_761) >> 16 & 15 == 0);
        }
        let bits = e.finish().len() as f64 * 8.0 / 80_000.0;
        assert!((0.337..0.36).contains(&bits), "entropy 0.337, coded {bits}");
    }
}
