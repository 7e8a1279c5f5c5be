//! Weights as integers: the last floating-point number of the encoder's decisions ends here.
//!
//! Layout of a [`Fixed`], most significant bit first, so that integers order as weights do:
//! ```text
//! 31 30 | 29 ........ 1 | 0
//! class | value, 29 bits| folds
//! ```
//! Class 0 is ordinary, 1 breaks the complex, 2 collapses a dangling edge, 3 is illegal (the whole word is then
//! `u32::MAX`). The unit of the value is `diagonal · 2^-27`: an ordinary value is at most 1.5 times the length of an
//! edge (see `weight`), an edge is at most the diagonal long, and √(area lost) is cut off at four diagonals, so nothing
//! overflows and 2^32 edges sum exactly in a `u64`.

use super::weight::{Class, Weight};

/// Bits of a value.
const VALUE_BITS: u32 = 29;
/// Largest value.
const VALUE_MAX: u32 = (1 << VALUE_BITS) - 1;

/// From lengths to the integer unit of weights, chosen once per mesh from the diagonal of its bounding box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Units per lattice step.
    units: f64,
}

impl Scale {
    /// For a mesh whose bounding box has this diagonal, in lattice steps. A diagonal that is not a positive number
    /// (one point, or nothing) counts as one step.
    pub fn new(diagonal: f64) -> Self {
        let diagonal = if diagonal.is_finite() && diagonal > 0.0 { diagonal } else { 1.0 };
        Scale { units: f64::from(1u32 << (VALUE_BITS - 2)) / diagonal }
    }

    /// The integer form of a weight: the value rounded to nearest, at most the largest that fits.
    #[inline]
    pub fn fixed(&self, weight: Weight) -> Fixed {
        let class = match weight.class {
            Class::Ordinary => 0,
            Class::Breaking => 1,
            Class::Dangling => 2,
            Class::Illegal => return Fixed::ILLEGAL,
        };
        let value = ((f64::from(weight.value) * self.units + 0.5) as u32).min(VALUE_MAX);
        Fixed(class << (VALUE_BITS + 1) | value << 1 | u32::from(weight.folds))
    }

    /// The length that an integer value stands for, in lattice steps.
    pub fn length(&self, value: u32) -> f64 {
        f64::from(value) / self.units
    }
}

/// A weight as an integer that orders first by class, then by value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fixed(u32);

impl Fixed {
    /// The weight of an edge that must not be collapsed.
    pub const ILLEGAL: Fixed = Fixed(u32::MAX);

    /// Its class.
    #[inline]
    pub fn class(self) -> Class {
        match self.0 >> (VALUE_BITS + 1) {
            0 => Class::Ordinary,
            1 => Class::Breaking,
            2 => Class::Dangling,
            _ => Class::Illegal,
        }
    }

    /// The weight with `extra` lattice steps added; more than none leaves it out of means, as a fold does.
    #[inline]
    pub fn raised(self, scale: &Scale, extra: f32) -> Fixed {
        let extra = (f64::from(extra) * scale.units + 0.5) as u32;
        if extra == 0 || self == Fixed::ILLEGAL {
            return self;
        }
        let value = self.value().saturating_add(extra).min(VALUE_MAX);
        Fixed(self.0 & !(VALUE_MAX << 1) | value << 1 | 1)
    }

    /// Its value within the class, in units of the [`Scale`], below 2^29.
    #[inline]
    pub fn value(self) -> u32 {
        self.0 >> 1 & VALUE_MAX
    }

    /// Whether the value holds the penalty for a face that turns over.
    #[inline]
    pub fn folds(self) -> bool {
        self.0 & 1 == 1
    }

    /// The whole word: orders by class, then value, then folding.
    #[inline]
    pub fn bits(self) -> u32 {
        self.0
    }
}
