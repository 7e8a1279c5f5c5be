//! Numbers of the tables, by models of their own.

use super::error::{ContainerError, Place, inconsistent};
use crate::format::coder::range::{Bit, Coder};

/// The largest count of vertices, elements or corners: 32-bit numbers hold them and one value beyond.
pub const MAX_COUNT: u32 = u32::MAX - 1;

/// Models of a number ≥ 0 of any size: a flag for zero, the position of its highest bit as a binary tree, the next bit.
pub(super) struct Number {
    zero: Bit,
    length: [Bit; 64],
    top: [Bit; 64],
}

impl Number {
    pub(super) fn new() -> Self {
        Number { zero: Bit::default(), length: [Bit::default(); 64], top: [Bit::default(); 64] }
    }

    pub(super) fn code<C: Coder>(&mut self, c: &mut C, value: u64) -> u64 {
        if c.bit(&mut self.zero, value == 0) {
            return 0;
        }
        let length = 63 - value.max(1).leading_zeros();
        let mut node = 1usize;
        for k in (0..6).rev() {
            node = node << 1 | c.bit(&mut self.length[node], length >> k & 1 == 1) as usize;
        }
        let n = node as u32 - 64;
        if n == 0 {
            return 1;
        }
        let top = c.bit(&mut self.top[n as usize], value >> (n - 1) & 1 == 1) as u64;
        1 << n | top << (n - 1) | raw(c, n - 1, value)
    }
}

/// The low `bits` ≤ 64 bits of a value, all equally likely, from high to low in pieces of 32.
pub(super) fn raw<C: Coder>(c: &mut C, bits: u32, value: u64) -> u64 {
    let value = if bits < 64 { value & ((1 << bits) - 1) } else { value };
    let high = if bits > 32 { (c.bypass(bits - 32, (value >> 32) as u32) as u64) << 32 } else { 0 };
    high | c.bypass(bits.min(32), value as u32) as u64
}

/// A finite number by its bits: how many of its sixteen hexadecimal digits are left without the zeros at the end, then those.
pub(super) fn float<C: Coder>(c: &mut C, value: f64) -> f64 {
    let bits = value.to_bits();
    let digits = c.uniform(17, 16 - (bits.trailing_zeros() / 4).min(16));
    let drop = 64 - 4 * digits;
    if digits == 0 {
        return 0.0;
    }
    f64::from_bits(raw(c, 64 - drop, bits >> drop) << drop)
}

/// A count, if it is not beyond [`MAX_COUNT`].
pub(super) fn count(value: u64) -> Result<u32, ContainerError> {
    match u32::try_from(value) {
        Ok(v) if v <= MAX_COUNT => Ok(v),
        _ => inconsistent(Place::Header, "a count beyond 2^32 - 2"),
    }
}
