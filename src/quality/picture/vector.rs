//! Directions.

use glam::DVec3;

/// `v` of length 1; z where there is no direction. Divides, and so differs from `glam` in the last bit: pictures decide on orders of chunks.
pub(super) fn unit(v: DVec3) -> DVec3 {
    let length = v.length();
    if length > 0.0 && length.is_finite() { v / length } else { DVec3::Z }
}
