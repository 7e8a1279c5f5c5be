//! The weight of an edge: what its collapse to the midpoint costs. CPU twin of the shader `edge_weight`.
//!
//! Caillaud et al. 2016, section 4.2, with the order of classes that its text means: ordinary collapses, then those that
//! break the complex, then those of dangling edges. The diagonals of the paper's formulas only keep the classes apart;
//! here the class does that, and [`Weight::total`] adds them where a single number is wanted.
//!
//! **What is measured.** The patch before the collapse is every element at `a` or `b`, the patch after is the same with
//! both moved to the midpoint `v`. Polygons count as fans of triangles from `a` where they hold `a`, else from `b`
//! (the smaller end is `a`), and from `v` afterwards; a dangling edge counts as a segment. The value is the
//! largest distance from any of these sample points to the whole of the other patch, exactly:
//! - `a` and `b` to the patch after (`v` lies on the patch before: it is the middle of an edge of it);
//! - the places where a spoke of the patch before and a spoke of the patch after cross, seen along the mean normal: the
//!   point on each to the other patch. Where both patches project injectively, the difference of heights is largest
//!   at one of these places or at an end, so the value misses the true Hausdorff distance only by the slant;
//! - where the patch does not project injectively along its mean normal: the middle of every spoke, both ways;
//! - at borders and dangling edges (edges of exactly one element): `a` and `b` to the border after, `v` to the border before, or a border in
//!   a flat region would erode for free.
//!
//! A ring of more than [`MAX_RING`] vertices is not sampled: half the length of the edge, which no distance exceeds,
//! is the value.
//!
//! **Penalty.** Where a surviving face turns its vector area by more than 90 degrees, or becomes a sliver (area
//! below 1/200 of its longest edge squared, four times as thin as before), the length of the edge is added. As the distance is never
//! more than half of that, such a collapse waits for all like it that fold nothing, yet is not banned.
//!
//! The tests compare the value with dense sampling in `f64`.

pub(crate) use super::kernel::edge_weight_by;
pub use super::kernel::{Scratch, edge_weight, triangle_distance2};

/// The largest ring that is sampled; above it the cost of sampling, quadratic in the ring, would rule the whole job.
pub const MAX_RING: usize = 256;

/// The classes of collapses, in the order in which they are admitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Class {
    /// Surface stays surface.
    Ordinary = 1,
    /// The collapse leaves a dangling edge where a triangle was, or breaks the link condition: a vertex is a
    /// neighbour of both ends without a triangle between, or an inner edge joins two borders.
    Breaking = 2,
    /// The edge belongs to no face.
    Dangling = 3,
    /// A face holds both ends in other than consecutive corners, or an end is locked.
    Illegal = 255,
}

/// The weight of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// Its class.
    pub class: Class,
    /// In lattice steps, never negative. [`Class::Ordinary`]: distance plus penalty; [`Class::Breaking`]: √(area lost);
    /// [`Class::Dangling`]: length; [`Class::Illegal`]: 0.
    pub value: f32,
    /// Whether the value holds the penalty for a face that turns over.
    pub folds: bool,
}

impl Weight {
    /// The weight of an edge that must not be collapsed.
    pub const ILLEGAL: Weight = Weight { class: Class::Illegal, value: 0.0, folds: false };

    /// The weight as one number, ordered across classes for a bounding box of this diagonal; infinite if illegal.
    pub fn total(&self, diagonal: f64) -> f64 {
        let value = f64::from(self.value);
        match self.class {
            Class::Ordinary => value,
            Class::Breaking => diagonal + value,
            Class::Dangling => 2.0 * diagonal + value,
            Class::Illegal => f64::INFINITY,
        }
    }
}

/// A vertex of the ring of an edge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RingVertex {
    /// Relative to the midpoint `v`.
    pub at: [f32; 3],
    /// A triangle or dangling edge of the patch joins it to `a`: by an edge of the level or by a diagonal of a fan.
    pub spoke_a: bool,
    /// The same for `b`.
    pub spoke_b: bool,
    /// The edge to `a` has exactly one element.
    pub border_a: bool,
    /// The edge to `b` has exactly one element.
    pub border_b: bool,
    /// The edge to `v` will have exactly one element.
    pub border_after: bool,
}

/// A triangle of the fans of a patch: an apex, which is `a` or `b` before and `v` after, and two ring vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PatchTriangle {
    /// Ring vertex after the apex.
    pub p: u16,
    /// Ring vertex before the apex. Equal to `p` for a dangling edge.
    pub q: u16,
    /// Whether the apex before the collapse is `b`.
    pub at_b: bool,
    /// Whether it belongs to the same element as the triangle before it in the list.
    pub continues: bool,
}

/// All that the weight of one edge depends on, flat. Every index is below `ring.len()`.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Found by connectivity alone.
    pub class: Class,
    /// `(b − a) / 2`: relative to the midpoint `v`, `a` lies at `−half` and `b` at `half`.
    pub half: [f32; 3],
    /// The other vertices of the elements around `a` and `b`, each once.
    pub ring: Vec<RingVertex>,
    /// Triangles with one moving corner: they survive the collapse.
    pub triangles: Vec<PatchTriangle>,
    /// Third corners `x` of the triangles that vanish, and whether they run `(b, a, x)` instead of `(a, b, x)`.
    pub vanishing: Vec<(u16, bool)>,
    /// Whether some element has more than three corners.
    pub polygons: bool,
    /// Whether some `border_*` of the ring is set.
    pub borders: bool,
    /// The edge `{a, b}` has exactly one element.
    pub border_ab: bool,
}

impl Default for Patch {
    fn default() -> Self {
        Patch {
            class: Class::Illegal,
            half: [0.0; 3],
            ring: Vec::new(),
            triangles: Vec::new(),
            vanishing: Vec::new(),
            polygons: false,
            borders: false,
            border_ab: false,
        }
    }
}
