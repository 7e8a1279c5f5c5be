//! What the front of a file says about the whole: lattice, bounds, counts, and one row per level.

use super::attributes::AttributeHeader;
use super::error::{ContainerError, Place, inconsistent};
use super::number::MAX_COUNT;
use crate::mesh::lattice::{COORDINATE_LIMIT, Lattice};

/// The most levels of a file, so that a hostile front cannot make a reader fill its memory with rows.
pub const MAX_LEVELS: usize = 1 << 16;

/// The largest shift of a level.
pub const MAX_SHIFT: u8 = 24;

/// The header and the level table of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Features that a decoder must know, one bit each; see [`KNOWN_REQUIRED`](super::KNOWN_REQUIRED).
    pub required: u64,
    /// Features that a decoder may ignore, one bit each.
    pub optional: u64,
    /// The lattice of the full level.
    pub lattice: Lattice,
    /// The bits on the longest side when the lattice was chosen so, 1 to 21.
    pub position_bits: Option<u8>,
    /// The lower and the upper corner of the box around all vertices of the full level, in lattice coordinates;
    /// `None` exactly when there are no vertices.
    pub bounds: Option<[[i32; 3]; 2]>,
    /// Connected components of the full level; an isolated vertex is one.
    pub components: u32,
    /// Elements that repeat a vertex. They travel aside and belong to the mesh at its full level, but not to the level table.
    pub degenerate: DegenerateCounts,
    /// One row per level, coarse to fine; at least one. The last is the full level.
    pub levels: Vec<LevelInfo>,
    /// Layers, labels, materials.
    pub attributes: AttributeHeader,
}

/// How many elements travel aside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DegenerateCounts {
    /// Elements that repeat a vertex.
    pub elements: u32,
    /// Their corners.
    pub corners: u32,
}

/// A row of the level table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelInfo {
    /// Vertices, isolated ones included; never fewer than the level before.
    pub vertices: u32,
    /// Elements of the complex (polygons and dangling edges); never fewer than the level before.
    pub elements: u32,
    /// Corners of the elements; never fewer than the level before.
    pub corners: u32,
    /// Low bits of the coordinates not known at this level, at most [`MAX_SHIFT`]; never more than the level before,
    /// 0 at the full level.
    pub shift: u8,
    /// An upper bound of the distance to the input.
    pub error: ErrorBound,
}

impl Header {
    /// The number of the full level.
    pub fn full_level(&self) -> u32 {
        self.levels.len().saturating_sub(1) as u32
    }

    /// The row of the full level.
    pub fn full(&self) -> LevelInfo {
        self.levels.last().copied().unwrap_or_default()
    }

    /// Vertices of the mesh.
    pub fn vertices(&self) -> u32 {
        self.full().vertices
    }

    /// Elements of the mesh, those that travel aside included.
    pub fn elements(&self) -> u32 {
        self.full().elements.saturating_add(self.degenerate.elements)
    }

    /// Corners of the mesh, those that travel aside included.
    pub fn corners(&self) -> u32 {
        self.full().corners.saturating_add(self.degenerate.corners)
    }

    /// An upper bound of the distance between a level and the input, in the units of the model; infinite where none is
    /// known, `None` beyond the full level.
    pub fn error(&self, level: u32) -> Option<f64> {
        Some(self.levels.get(level as usize)?.error.distance(self.lattice.step))
    }

    /// The finest level of at most `vertices` vertices, `None` when level 0 has more.
    pub fn finest_of(&self, vertices: u32) -> Option<u32> {
        (self.levels.partition_point(|row| row.vertices <= vertices) as u32).checked_sub(1)
    }

    /// The coarsest level that is surely no farther than `distance`, in the units of the model, from the input; `None` when
    /// not even the full level is.
    pub fn coarsest_within(&self, distance: f64) -> Option<u32> {
        let within = |row: &LevelInfo| row.error.distance(self.lattice.step) <= distance;
        Some(self.levels.iter().position(within)? as u32)
    }

    /// Check what a header may say.
    pub(super) fn validate(&self) -> Result<(), ContainerError> {
        let header = |what| inconsistent(Place::Header, what);
        if !(self.lattice.step.is_finite() && self.lattice.step > 0.0) {
            return header("the lattice step is not a positive finite number");
        }
        if !self.lattice.origin.iter().all(|c| c.is_finite()) {
            return header("the lattice origin is not finite");
        }
        if !self.lattice.is_finite() {
            return header("coordinates of the lattice that are infinite");
        }
        if self.position_bits.is_some_and(|b| !(1..=21).contains(&b)) {
            return header("position bits outside 1 to 21");
        }
        if self.levels.is_empty() {
            return header("no levels");
        }
        if self.levels.len() > MAX_LEVELS {
            return header("too many levels");
        }
        let full = self.full();
        match self.bounds {
            None if full.vertices != 0 => return header("vertices without bounds"),
            Some(_) if full.vertices == 0 => return header("bounds without vertices"),
            Some([lo, hi]) => {
                for k in 0..3 {
                    if lo[k] > hi[k] || lo[k] < -COORDINATE_LIMIT || hi[k] > COORDINATE_LIMIT {
                        return header("bounds turned round or beyond the coordinate limit");
                    }
                }
            }
            None => {}
        }
        if self.components > full.vertices {
            return header("more components than vertices");
        }
        if full.shift != 0 {
            return header("the full level has a shift");
        }
        let mut before = LevelInfo { shift: MAX_SHIFT, ..LevelInfo::default() };
        for (l, &row) in self.levels.iter().enumerate() {
            let level = |what| inconsistent(Place::Level(l as u32), what);
            if row.vertices > MAX_COUNT || row.elements > MAX_COUNT || row.corners > MAX_COUNT {
                return level("a count beyond 2^32 - 2");
            }
            if row.vertices < before.vertices || row.elements < before.elements || row.corners < before.corners {
                return level("fewer vertices, elements or corners than the level before");
            }
            if row.shift > before.shift {
                return level("a larger shift than the level before");
            }
            if !degrees_fit(row.elements, row.corners) {
                return level("fewer than two corners for each element");
            }
            if row.elements > 0 && row.vertices < 2 {
                return level("elements without vertices");
            }
            before = row;
        }
        let DegenerateCounts { elements, corners } = self.degenerate;
        if !degrees_fit(elements, corners) {
            return header("fewer than two corners for each degenerate face");
        }
        if elements > 0 && full.vertices == 0 {
            return header("degenerate faces without vertices");
        }
        let fits = |a: u32, b: u32| a.checked_add(b).is_some_and(|sum| sum <= MAX_COUNT);
        if !fits(full.elements, elements) || !fits(full.corners, corners) {
            return header("a count beyond 2^32 - 2");
        }
        self.attributes.validate(full.elements, full.corners)
    }
}

/// Whether every element can have two corners, and no corner is without one.
fn degrees_fit(elements: u32, corners: u32) -> bool {
    corners as u64 >= 2 * elements as u64 && (elements > 0 || corners == 0)
}

/// An upper bound of a distance on a logarithmic scale in units of the lattice step: 0, or `2^((code − 129) / 16)` steps.
///
/// Codes go from 0 (no error at all) over 1 (a 256th of a step) and 129 (one step) to 1022 (2^55.8 steps); 1023 says that no
/// bound is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct ErrorBound(u16);

/// `2^(i / 16)`.
const OCTAVE: [f64; 16] = [
    1.0,
    1.0442737824274138,
    1.0905077326652577,
    1.1387886347566916,
    1.189207115002721,
    1.241857812073484,
    1.2968395546510096,
    1.3542555469368927,
    std::f64::consts::SQRT_2,
    1.4768261459394993,
    1.5422108254079407,
    1.6104903319492543,
    1.681792830507429,
    1.7562521603732995,
    1.8340080864093424,
    1.9152065613971474,
];

impl ErrorBound {
    /// No error at all.
    pub const EXACT: ErrorBound = ErrorBound(0);
    /// No bound is known.
    pub const UNKNOWN: ErrorBound = ErrorBound(1023);
    /// What quantization alone costs: the half diagonal of a lattice cell, 0.866 steps, as the next bound of the scale (0.878).
    pub const QUANTIZATION: ErrorBound = ErrorBound(126);

    /// The bound with the given code, `None` above 1023.
    pub fn from_code(code: u16) -> Option<Self> {
        (code <= 1023).then_some(ErrorBound(code))
    }

    /// The code, 0 to 1023.
    pub fn code(self) -> u16 {
        self.0
    }

    /// The smallest bound whose [`distance`](Self::distance) is at least `distance`; a distance and a step in the same
    /// units. Not a number counts as infinite.
    pub fn covering(distance: f64, step: f64) -> Self {
        let (mut lo, mut hi) = (0u16, 1023u16);
        while lo < hi {
            let middle = (lo + hi) / 2;
            if ErrorBound(middle).distance(step) >= distance {
                hi = middle;
            } else {
                lo = middle + 1;
            }
        }
        ErrorBound(lo)
    }

    /// The bound in lattice steps; infinite for [`UNKNOWN`](Self::UNKNOWN).
    pub fn steps(self) -> f64 {
        match self.0 {
            0 => 0.0,
            1023.. => f64::INFINITY,
            code => {
                let sixteenths = code as u64 - 1;
                let power = f64::from_bits((1023 - 8 + sixteenths / 16) << 52);
                OCTAVE[(sixteenths % 16) as usize] * power
            }
        }
    }

    /// The bound in the units of `step`.
    pub fn distance(self, step: f64) -> f64 {
        if self.0 == 0 { 0.0 } else { self.steps() * step }
    }
}
