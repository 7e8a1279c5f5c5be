//! The lattice: how coordinates become integers and integers become coordinates.
//!
//! `q = floor((p − origin) / step + 0.5)` in `f64`, decoded as `origin + q·step`; one step for all three axes.
//!
//! The box that sets it is that of all vertices, unless vertices that no element uses make it more than
//! [`PROPORTION`] times as large as that of the surface: then it is the surface's. So a stray vertex costs the surface one
//! bit at most, and is kept where ±[`COORDINATE_LIMIT`] steps reach it, which is 4096 times the surface's box at 12 bits.
//! Beyond that it is refused rather than kept in an escape of its own: such a vertex is a mistake of another program
//! nearly always, and whoever means it has it in a file without elements, where all vertices count.

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

/// How many times as large as the box of what elements use that of all vertices may be, and still sets the lattice.
pub const PROPORTION: f64 = 2.0;

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
    /// A step or an origin beyond which coordinates are infinite.
    #[error(
        "a lattice of step {step} reaches coordinates that are infinite; choose a smaller step or an origin nearer to 0"
    )]
    Infinite {
        /// The step.
        step: f64,
    },
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
    /// Vertices that no element uses, too many steps away from the surface.
    #[error(
        "vertex {vertex}, which no element uses, lies {steps:.0} lattice steps from the mesh{}; at most {COORDINATE_LIMIT} fit. Leave such vertices out with --isolated drop, or choose a larger step",
        if *others > 0 { format!(", and {others} more such") } else { String::new() }
    )]
    Isolated {
        /// The first of them, from 0.
        vertex: usize,
        /// How many others there are.
        others: usize,
        /// The distance of the first along one axis in steps.
        steps: f64,
    },
}

/// Whether some element names each of `vertices` vertices.
pub fn used_vertices(vertices: usize, corners: &[u32]) -> Vec<bool> {
    let mut used = vec![false; vertices];
    corners.iter().for_each(|&v| used[v as usize] = true);
    used
}

/// The box around points; a box at the origin without any.
fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> [[f64; 3]; 2] {
    let mut points = points.copied();
    let first = points.next().unwrap_or([0.0; 3]);
    points.fold([first; 2], |[lo, hi], p| {
        [std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k]))]
    })
}

/// The longest side of a box.
fn longest([lo, hi]: [[f64; 3]; 2]) -> f64 {
    (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f64::max)
}

impl Lattice {
    /// The lattice for the points `positions`.
    ///
    /// # Errors
    /// [`LatticeError::Bits`] or [`LatticeError::Step`] when the choice itself is out of range.
    pub fn choose(quantization: Quantization, positions: &[[f64; 3]]) -> Result<Self, LatticeError> {
        Self::around(quantization, bounds(positions.iter()))
    }

    /// The lattice for the vertices of a mesh, whose elements have these `corners`; isolated vertices that are out of all
    /// proportion do not count.
    ///
    /// # Errors
    /// As [`Lattice::choose`].
    pub fn of_mesh(quantization: Quantization, positions: &[[f64; 3]], corners: &[u32]) -> Result<Self, LatticeError> {
        let all = bounds(positions.iter());
        let used = used_vertices(positions.len(), corners);
        let surface = bounds(positions.iter().zip(&used).filter(|(_, used)| **used).map(|(p, _)| p));
        let strays = longest(surface) > 0.0 && longest(all) > PROPORTION * longest(surface);
        Self::around(quantization, if strays { surface } else { all })
    }

    fn around(quantization: Quantization, bounds: [[f64; 3]; 2]) -> Result<Self, LatticeError> {
        let lattice = Self::unchecked(quantization, bounds)?;
        if !lattice.is_finite() {
            return Err(LatticeError::Infinite { step: lattice.step });
        }
        Ok(lattice)
    }

    /// Whether all points that a decoder may name have finite coordinates.
    pub fn is_finite(&self) -> bool {
        let reach = 4.0 * f64::from(COORDINATE_LIMIT) * self.step;
        self.origin.iter().all(|c| (c.abs() + reach).is_finite())
    }

    fn unchecked(quantization: Quantization, bounds: [[f64; 3]; 2]) -> Result<Self, LatticeError> {
        let [lo, _] = bounds;
        match quantization {
            Quantization::Bits(b) => {
                if !(1..=21).contains(&b) {
                    return Err(LatticeError::Bits(b));
                }
                let side = longest(bounds);
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
            out.push(self.nearest(p).map_err(|steps| LatticeError::OutOfRange { vertex, steps })?);
        }
        Ok(out)
    }

    /// The same for the vertices of a mesh, whose elements have these `corners`.
    ///
    /// # Errors
    /// [`LatticeError::OutOfRange`] for a vertex that an element uses, [`LatticeError::Isolated`] where only others do not fit.
    pub fn quantize_mesh(&self, positions: &[[f64; 3]], corners: &[u32]) -> Result<Vec<[i32; 3]>, LatticeError> {
        self.quantize(positions).map_err(|first| {
            let used = used_vertices(positions.len(), corners);
            let far = || (0..positions.len()).filter_map(|v| Some((v, self.nearest(&positions[v]).err()?)));
            if let Some((vertex, steps)) = far().find(|&(v, _)| used[v] || corners.is_empty()) {
                return LatticeError::OutOfRange { vertex, steps };
            }
            let others = far().count().saturating_sub(1);
            match first {
                LatticeError::OutOfRange { vertex, steps } => LatticeError::Isolated { vertex, others, steps },
                other => other,
            }
        })
    }

    /// The lattice point nearest to `p`; where it is out of range, the steps along the first axis where it is.
    fn nearest(&self, p: &[f64; 3]) -> Result<[i32; 3], f64> {
        let mut q = [0i32; 3];
        for k in 0..3 {
            let steps = ((p[k] - self.origin[k]) / self.step + 0.5).floor();
            if steps.is_nan() || steps.abs() > f64::from(COORDINATE_LIMIT) {
                return Err(steps);
            }
            q[k] = steps as i32;
        }
        Ok(q)
    }

    /// How far the farthest of `positions` is from its lattice point in `quantized`.
    pub fn largest_shift(&self, positions: &[[f64; 3]], quantized: &[[i32; 3]]) -> f64 {
        let squared = |(p, &q): (&[f64; 3], &[i32; 3])| {
            let at = self.point(q);
            (0..3).map(|k| (at[k] - p[k]) * (at[k] - p[k])).sum::<f64>()
        };
        positions.iter().zip(quantized).map(squared).fold(0.0, f64::max).sqrt()
    }

    /// The coordinates of a lattice point.
    #[inline]
    pub fn point(&self, q: [i32; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.origin[k] + q[k] as f64 * self.step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of side 1 far from the origin, and vertices that no element uses.
    fn square(strays: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let corner = |x: f64, y: f64| [512_000.0 + x, 5_403_000.0 + y, 250.0];
        let mut positions = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        positions.extend_from_slice(strays);
        positions
    }

    const CORNERS: [u32; 4] = [0, 1, 2, 3];

    #[test]
    fn what_no_element_uses_sets_no_range_beyond_proportion() {
        let bits = Quantization::Bits(12);
        let of = |strays: &[[f64; 3]]| Lattice::of_mesh(bits, &square(strays), &CORNERS).unwrap();
        let surface = Lattice::choose(bits, &square(&[])).unwrap();
        assert_eq!(of(&[]), surface);
        // Near ones count as ever.
        let near = [[512_001.9, 5_403_000.0, 250.0]];
        assert_eq!(of(&near), Lattice::choose(bits, &square(&near)).unwrap());
        // Those beyond do not, and are kept where they can be.
        let beyond = [[512_003.0, 5_403_000.0, 250.0]];
        assert_eq!(of(&beyond), surface);
        let quantized = surface.quantize_mesh(&square(&beyond), &CORNERS).unwrap();
        assert_eq!(quantized[4], [3 * 4095, 0, 0]);
        // Points without elements are all alike.
        let all = square(&[[0.0; 3]]);
        assert_eq!(Lattice::of_mesh(bits, &all, &[]).unwrap(), Lattice::choose(bits, &all).unwrap());
    }

    #[test]
    fn strays_out_of_reach_are_named() {
        let positions = square(&[[0.0; 3], [512_000.5, 5_403_000.0, 250.0], [0.0; 3]]);
        let lattice = Lattice::of_mesh(Quantization::Bits(12), &positions, &CORNERS).unwrap();
        let error = lattice.quantize_mesh(&positions, &CORNERS).unwrap_err();
        assert_eq!(
            error.to_string(),
            "vertex 4, which no element uses, lies -2096640000 lattice steps from the mesh, and 1 more such; at most \
             16777216 fit. Leave such vertices out with --isolated drop, or choose a larger step"
        );
        // One that an element uses is an error of another kind.
        let error = lattice.quantize_mesh(&positions, &[0, 1, 2, 6]).unwrap_err();
        assert!(matches!(error, LatticeError::OutOfRange { vertex: 6, .. }), "{error}");
    }

    #[test]
    fn no_coordinate_is_infinite() {
        let step = |step, origin| Lattice::choose(Quantization::Step { step, origin }, &[[0.0; 3]]);
        assert!(step(1e300, None).is_ok());
        assert_eq!(step(1e308, None), Err(LatticeError::Infinite { step: 1e308 }));
        assert_eq!(step(1e300, Some([0.0, -1.797e308, 0.0])), Err(LatticeError::Infinite { step: 1e300 }));
    }

    #[test]
    fn the_largest_shift_is_measured() {
        let lattice = Lattice { origin: [0.0; 3], step: 1.0 };
        let positions = [[0.25, 0.0, 0.0], [3.0, 4.5, 0.0]];
        let quantized = lattice.quantize(&positions).unwrap();
        assert_eq!(lattice.largest_shift(&positions, &quantized), 0.5);
    }
}
