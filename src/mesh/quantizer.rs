//! Attribute values to integers and back.
//!
//! Linear for texture coordinates, colours and scalars: `q = floor((x − origin) / step + 0.5)`, decoded as `origin + q · step`, one step for all
//! components. Octahedral for directions (Meyer et al. 2010, *On floating-point normal vectors*): the unit sphere unfolded into a square of `2^bits` by
//! `2^bits` points; a zero vector, which scanners write where they know no normal, is `(−1, −1)` beside the square. A tangent has the sign of its
//! bitangent as a third number, 0 or 1.

use crate::mesh::{LayerKind, MAX_WIDTH};
use thiserror::Error;

/// Components of a value, at most.
pub const WIDTH: usize = MAX_WIDTH as usize;

/// Values stay within ± this.
pub const LIMIT: f64 = (1 << 25) as f64;

/// How the values of a layer become integers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Quantizer {
    /// Multiples of `step` from `origin`.
    Linear {
        /// The value of 0, component by component.
        origin: [f64; WIDTH],
        /// The distance between neighbours.
        step: f64,
    },
    /// Directions, `bits` for each of two numbers.
    Octahedral {
        /// 2 to 16.
        bits: u8,
    },
}

/// What the user asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Precision {
    /// The longest side of the box around all values has this many bits, 1 to 24.
    Bits(u8),
    /// Neighbours are this far apart.
    Step(f64),
}

/// Why values cannot be quantized.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum QuantizerError {
    /// More or fewer bits than there can be.
    #[error("{bits} bits for layer {layer}: {least} to {most} are possible")]
    Bits {
        /// The layer.
        layer: String,
        /// What was asked for.
        bits: u8,
        /// The least possible.
        least: u8,
        /// The most possible.
        most: u8,
    },
    /// A step that is no step.
    #[error("the step {step} of layer {layer} is not a positive finite number")]
    Step {
        /// The layer.
        layer: String,
        /// What was asked for.
        step: f64,
    },
    /// The values do not fit.
    #[error(
        "layer {layer}: {value} is more than 2^25 steps of {step} from the smallest value; ask for fewer bits or a larger step"
    )]
    Range {
        /// The layer.
        layer: String,
        /// A value that does not fit.
        value: f64,
        /// The step.
        step: f64,
    },
}

impl Quantizer {
    /// A quantizer for the `values` (of `width` numbers each) of layer `layer`. `whole` says that they are integers, which stay exact where
    /// the range allows it.
    ///
    /// # Errors
    /// [`QuantizerError`] for a precision that is not possible.
    pub fn choose(
        layer: &str,
        kind: LayerKind,
        width: usize,
        values: &[f64],
        precision: Precision,
        whole: bool,
    ) -> Result<Self, QuantizerError> {
        let name = || layer.to_string();
        if matches!(kind, LayerKind::Normal | LayerKind::Tangent) {
            return match precision {
                Precision::Bits(bits @ 2..=16) => Ok(Quantizer::Octahedral { bits }),
                Precision::Bits(bits) => Err(QuantizerError::Bits { layer: name(), bits, least: 2, most: 16 }),
                Precision::Step(step) => Err(QuantizerError::Step { layer: name(), step }),
            };
        }
        let mut lo = [f64::INFINITY; WIDTH];
        let mut hi = [f64::NEG_INFINITY; WIDTH];
        for value in values.chunks_exact(width.max(1)) {
            for (c, &x) in value.iter().enumerate() {
                lo[c] = lo[c].min(x);
                hi[c] = hi[c].max(x);
            }
        }
        let side = (0..width).map(|c| hi[c] - lo[c]).fold(0.0, f64::max);
        let mut origin: [f64; WIDTH] = std::array::from_fn(|c| if lo[c].is_finite() { lo[c] } else { 0.0 });
        let step = match precision {
            Precision::Step(step) if step.is_finite() && step > 0.0 => {
                origin = [0.0; WIDTH];
                step
            }
            Precision::Step(step) => return Err(QuantizerError::Step { layer: name(), step }),
            Precision::Bits(bits) if !(1..=24).contains(&bits) => {
                return Err(QuantizerError::Bits { layer: name(), bits, least: 1, most: 24 });
            }
            // Colours are fractions of full intensity, whatever range they use.
            Precision::Bits(bits) if kind == LayerKind::Color => {
                origin = [0.0; WIDTH];
                1.0 / ((1u64 << bits) - 1) as f64
            }
            Precision::Bits(_) if whole && side < (1 << 24) as f64 => 1.0,
            Precision::Bits(bits) if side > 0.0 => side / ((1u64 << bits) - 1) as f64,
            Precision::Bits(_) => 1.0,
        };
        let quantizer = Quantizer::Linear { origin, step };
        values.chunks(width.max(1)).try_for_each(|value| quantizer.check(layer, value))?;
        Ok(quantizer)
    }

    /// See that a value of the layer `layer` is within the range of the integers.
    ///
    /// # Errors
    /// [`QuantizerError::Range`] where it is not.
    pub fn check(&self, layer: &str, value: &[f64]) -> Result<(), QuantizerError> {
        let Quantizer::Linear { origin, step } = *self else { return Ok(()) };
        for (&x, origin) in value.iter().zip(origin) {
            let far = ((x - origin) / step).abs();
            if far.is_nan() || far >= LIMIT {
                return Err(QuantizerError::Range { layer: layer.to_string(), value: x, step });
            }
        }
        Ok(())
    }

    /// Numbers that a quantized value of a layer of this kind and width has.
    pub fn width(&self, kind: LayerKind, width: usize) -> usize {
        match (self, kind) {
            (Quantizer::Linear { .. }, _) => width,
            (Quantizer::Octahedral { .. }, LayerKind::Tangent) => 3,
            (Quantizer::Octahedral { .. }, _) => 2,
        }
    }

    /// The integers of a value.
    pub fn quantize(&self, kind: LayerKind, value: &[f64]) -> [i32; WIDTH] {
        let mut out = [0; WIDTH];
        match *self {
            Quantizer::Linear { origin, step } => {
                for (c, &x) in value.iter().enumerate().take(WIDTH) {
                    out[c] = ((x - origin[c]) / step + 0.5).floor().clamp(-LIMIT, LIMIT) as i32;
                }
            }
            Quantizer::Octahedral { bits } => {
                let at = |c: usize| value.get(c).copied().unwrap_or(0.0);
                [out[0], out[1]] = octahedral([at(0), at(1), at(2)], bits);
                if kind == LayerKind::Tangent {
                    out[2] = (at(3) >= 0.0) as i32;
                }
            }
        }
        out
    }

    /// The value of integers; `out` has as many numbers as a value of the layer.
    pub fn restore(&self, kind: LayerKind, value: &[i32], out: &mut [f64]) {
        match *self {
            Quantizer::Linear { origin, step } => {
                for (c, (x, &q)) in out.iter_mut().zip(value).enumerate() {
                    *x = origin[c.min(WIDTH - 1)] + q as f64 * step;
                }
            }
            Quantizer::Octahedral { bits } => {
                let at = |c: usize| value.get(c).copied().unwrap_or(0);
                let n = direction([at(0), at(1)], bits);
                for (x, n) in out.iter_mut().zip(n) {
                    *x = n;
                }
                if let (LayerKind::Tangent, Some(sign)) = (kind, out.get_mut(3)) {
                    *sign = if at(2) > 0 { 1.0 } else { -1.0 };
                }
            }
        }
    }
}

fn octahedral(n: [f64; 3], bits: u8) -> [i32; 2] {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return [-1, -1];
    }
    let [mut x, mut y, z] = n.map(|c| c / sum);
    if z < 0.0 {
        let fold = |a: f64, b: f64| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
        (x, y) = (fold(x, y), fold(y, x));
    }
    let top = (1i32 << bits) - 1;
    let [mut x, mut y] = [x, y].map(|c| ((c * 0.5 + 0.5) * top as f64 + 0.5).floor().clamp(0.0, top as f64) as i32);
    // A direction on the rim has two places: the lower one is meant.
    if x == 0 || x == top {
        y = y.min(top - y);
    }
    if y == 0 || y == top {
        x = x.min(top - x);
    }
    [x, y]
}

fn direction(q: [i32; 2], bits: u8) -> [f64; 3] {
    let top = (1i32 << bits) - 1;
    if q[0] < 0 && q[1] < 0 {
        return [0.0; 3];
    }
    let [x, y] = q.map(|c| c.clamp(0, top) as f64 / top as f64 * 2.0 - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = |a: f64, b: f64| if z < 0.0 { (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 } } else { a };
    let v = [fold(x, y), fold(y, x), z];
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|c| c / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn directions_come_back_near_and_stay(n in prop::array::uniform3(-1.0f64..1.0), bits in 6u8..=16) {
            prop_assume!(n.iter().any(|c| c.abs() > 1e-3));
            let q = Quantizer::Octahedral { bits };
            let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            let first = q.quantize(LayerKind::Normal, &n);
            let mut back = [0.0; 3];
            q.restore(LayerKind::Normal, &first[..2], &mut back);
            let dot = (0..3).map(|k| back[k] * n[k] / length).sum::<f64>();
            prop_assert!(dot > 1.0 - 16.0 / (1u64 << (2 * bits)) as f64, "{dot}");
            prop_assert_eq!(octahedral(back, bits).map(|c| c.min(1 << 20)), [first[0], first[1]]);
        }

        #[test]
        fn values_come_back_within_half_a_step(values in prop::collection::vec(-1e4f64..1e4, 2..40), bits in 1u8..=24) {
            let values = &values[..values.len() / 2 * 2];
            let q = Quantizer::choose("uv", LayerKind::Uv, 2, values, Precision::Bits(bits), false).unwrap();
            let Quantizer::Linear { step, .. } = q else { unreachable!() };
            for v in values.chunks_exact(2) {
                let mut back = [0.0; 2];
                q.restore(LayerKind::Uv, &q.quantize(LayerKind::Uv, v)[..2], &mut back);
                prop_assert!((0..2).all(|c| (back[c] - v[c]).abs() <= step * 0.500_001));
            }
        }
    }

    #[test]
    fn bytes_of_colour_and_whole_numbers_are_exact() {
        let values: Vec<f64> = (0..=255).map(|i| i as f64 / 255.0).collect();
        let q = Quantizer::choose("color", LayerKind::Color, 1, &values, Precision::Bits(8), true).unwrap();
        for (i, v) in values.iter().enumerate() {
            assert_eq!(q.quantize(LayerKind::Color, &[*v])[0], i as i32);
        }
        let values = [-7.0, 65_000.0, 3.0];
        let q = Quantizer::choose("id", LayerKind::Scalar, 1, &values, Precision::Bits(8), true).unwrap();
        let mut back = [0.0];
        q.restore(LayerKind::Scalar, &q.quantize(LayerKind::Scalar, &[65_000.0])[..1], &mut back);
        assert_eq!(back, [65_000.0]);
    }

    #[test]
    fn no_normal_stays_no_normal_and_errors_name_the_layer() {
        let q = Quantizer::Octahedral { bits: 10 };
        let mut back = [1.0; 3];
        q.restore(LayerKind::Normal, &q.quantize(LayerKind::Normal, &[0.0; 3])[..2], &mut back);
        assert_eq!(back, [0.0; 3]);
        let error = Quantizer::choose("uv", LayerKind::Uv, 2, &[0.0, 1.0], Precision::Bits(30), false).unwrap_err();
        assert_eq!(error.to_string(), "30 bits for layer uv: 1 to 24 are possible");
        let error = Quantizer::choose("uv", LayerKind::Uv, 2, &[0.0, 1.0], Precision::Step(1e-9), false).unwrap_err();
        assert_eq!(
            error.to_string(),
            "layer uv: 1 is more than 2^25 steps of 0.000000001 from the smallest value; ask for fewer bits or a larger step"
        );
    }
}
