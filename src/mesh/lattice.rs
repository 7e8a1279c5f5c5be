//! The lattice: how coordinates become integers and integers become coordinates.
//!
//! `q = floor((p − origin) / step + 0.5)` in `f64`, decoded as `origin + q·step`; one step for all three axes.

use thiserror::Error;

/// How the lattice is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantization {
    /// `b` bits on the longest side of the bounding box, 1 to 21: `step = side / (2^b − 1)`.
    Bits(u8),
    /// An absolute step in the units of the mesh, with an optional fixed origin (default: the lower corner of the bounding box).
    Step {
        /// Distance between lattice planes, > 0.
        step: f64,
        /// A point of the lattice, so that separately encoded tiles share borders bit for bit.
        origin: Option<[f64; 3]>,
    },
}

/// A lattice in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// The point with the coordinates (0, 0, 0).
    pub origin: [f64; 3],
    /// Distance between neighbouring lattice planes, finite and > 0.
    pub step: f64,
}

/// Lattice coordinates stay within ±`COORDINATE_LIMIT`, so that differences and sums of a ring fit into `i32` and
/// products into `i64`.
pub const COORDINATE_LIMIT: i32 = 1 << 24;

/// Why a lattice cannot hold a mesh.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum LatticeError {
    /// Bits outside 1..=21.
    #[error("{0} position bits: choose 1 to 21")]
    Bits(u8),
    /// A step that is not a positive finite number.
    #[error("a lattice step of {0}: it has to be a positive finite number")]
    Step(f64),
    /// A coordinate too many steps away from the origin.
    #[error(
        "vertex {vertex} lies {steps:.0} lattice steps from the origin; at most {COORDINATE_LIMIT} fit. Choose a larger step or an origin nearer to the mesh"
    )]
    OutOfRange {
        /// The vertex, from 0.
        vertex: usize,
        /// Its distance along one axis in steps.
        steps: f64,
    },
}

impl Lattice {
    /// The lattice for the points `positions`.
    ///
    /// # Errors
    /// [`LatticeError::Bits`] or [`LatticeError::Step`] when the choice itself is out of range.
    pub fn choose(quantization: Quantization, positions: &[[f64; 3]]) -> Result<Self, LatticeError> {
        let mut lo = positions.first().copied().unwrap_or([0.0; 3]);
        let mut hi = lo;
        for p in positions {
            for k in 0..3 {
                lo[k] = lo[k].min(p[k]);
                hi[k] = hi[k].max(p[k]);
            }
        }
        match quantization {
            Quantization::Bits(b) => {
                if !(1..=21).contains(&b) {
                    return Err(LatticeError::Bits(b));
                }
                let side = (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f64::max);
                let step = side / ((1u64 << b) - 1) as f64;
                let step = if step > 0.0 && step.is_finite() { step } else { 1.0 };
                Ok(Lattice { origin: lo, step })
            }
            Quantization::Step { step, origin } => {
                if !(step > 0.0 && step.is_finite()) {
                    return Err(LatticeError::Step(step));
                }
                Ok(Lattice { origin: origin.unwrap_or(lo), step })
            }
        }
    }

    /// The lattice point nearest to each position.
    ///
    /// # Errors
    /// [`LatticeError::OutOfRange`] names the first vertex beyond [`COORDINATE_LIMIT`] steps.
    pub fn quantize(&self, positions: &[[f64; 3]]) -> Result<Vec<[i32; 3]>, LatticeError> {
        let mut out = Vec::with_capacity(positions.len());
        for (vertex, p) in positions.iter().enumerate() {
            let mut q = [0i32; 3];
            for k in 0..3 {
                let steps = ((p[k] - self.origin[k]) / self.step + 0.5).floor();
                if steps.is_nan() || steps.abs() > f64::from(COORDINATE_LIMIT) {
                    return Err(LatticeError::OutOfRange { vertex, steps });
                }
                q[k] = steps as i32;
            }
            out.push(q);
        }
        Ok(out)
    }

    /// The coordinates of a lattice point.
    #[inline]
    pub fn point(&self, q: [i32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.origin[k] + q[k] as f64 * self.step)
    }
}
