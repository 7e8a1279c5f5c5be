//! Cameras.

use super::vector::unit;
use crate::mesh::Mesh;
use glam::{DVec3, dvec3};

/// A camera: where it looks from, and what fits into the picture. Orthographic unless [`perspective`](View::perspective) says otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Rows: to the right, up, towards the eye; orthonormal.
    pub(super) axes: [DVec3; 3],
    /// In the middle of the picture.
    pub(super) centre: DVec3,
    /// Half of the shorter side of the picture, in the units of the mesh, at the depth of the centre.
    pub(super) radius: f64,
    /// Half of the diagonal of the mesh.
    reach: f64,
    /// Half of the mesh's extent in depth; `None` where the sphere around it is what fits.
    depth: Option<f64>,
    /// From the centre to the eye, `None` for an eye that is infinitely far.
    pub(super) distance: Option<f64>,
}

impl View {
    /// From straight ahead (along −z), slightly from above and the right.
    pub fn front(mesh: &Mesh) -> Self {
        View::from_angles(mesh, -0.45, 0.35)
    }

    /// Turned about the upright y axis by `yaw`, then lifted by `pitch` (radians), with `mesh` filling nine tenths of the picture.
    pub fn from_angles(mesh: &Mesh, yaw: f64, pitch: f64) -> Self {
        let ((sy, cy), (sp, cp)) = (yaw.sin_cos(), pitch.sin_cos());
        View::fitted(mesh, [dvec3(cy, 0.0, sy), dvec3(sp * sy, cp, -sp * cy), dvec3(-cp * sy, sp, cp * cy)])
    }

    /// The same camera for a mesh whose z axis is upright, as in most scans.
    pub fn z_up(mesh: &Mesh, yaw: f64, pitch: f64) -> Self {
        let turned = View::from_angles(&Mesh::default(), yaw, pitch);
        View::fitted(mesh, turned.axes.map(|a| dvec3(a.x, -a.z, a.y)))
    }

    /// From `direction` (any length but 0), y upright, or z where that is nearly the direction; the sphere around the bounding box of
    /// `mesh` fills the picture.
    pub fn around(mesh: &Mesh, direction: [f64; 3]) -> Self {
        let towards = unit(direction.into());
        let up = if towards.y.abs() > 0.99 { DVec3::Z } else { DVec3::Y };
        let right = unit(up.cross(towards));
        let mut view = View::fitted(mesh, [right, towards.cross(right), towards]);
        if let Some((lo, hi)) = mesh.bounds() {
            view.centre = 0.5 * DVec3::from(lo) + 0.5 * DVec3::from(hi);
        }
        view.radius = view.reach;
        view.depth = None;
        view
    }

    /// The same view from an eye so near that the sphere around the mesh fills `degrees` (1 to 120) of its field.
    pub fn perspective(mut self, degrees: f64) -> Self {
        let half = 0.5 * degrees.clamp(1.0, 120.0).to_radians();
        let distance = self.reach / half.sin();
        self.radius *= match self.depth {
            // What is as near as the nearest point looks larger by so much.
            Some(depth) => distance / (distance - depth.min(0.9 * distance)),
            // Seen from near by, the sphere's outline is larger than its great circle.
            None => distance * half.tan() / self.reach,
        };
        self.distance = Some(distance);
        self
    }

    fn fitted(mesh: &Mesh, axes: [DVec3; 3]) -> Self {
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &p in &mesh.positions {
            let turned = DVec3::from_array(axes.map(|axis| axis.dot(p.into())));
            (lo, hi) = (lo.min(turned), hi.max(turned));
        }
        let middle = if mesh.positions.is_empty() { DVec3::ZERO } else { 0.5 * (lo + hi) };
        let centre = axes[0] * middle.x + axes[1] * middle.y + axes[2] * middle.z;
        let size = |length: f64| if length > 0.0 && length.is_finite() { length } else { 1.0 };
        let radius = size(0.5 * (hi.x - lo.x).max(hi.y - lo.y) / 0.9);
        let reach = mesh.bounds().map_or(1.0, |(lo, hi)| size((0.5 * (DVec3::from(hi) - DVec3::from(lo))).length()));
        let depth = Some(if lo.z <= hi.z { 0.5 * (hi.z - lo.z) } else { 0.0 });
        View { axes, centre, radius, reach, depth, distance: None }
    }

    /// Where `p` is seen: right and up in half sides of the picture, depth growing towards the eye, and how much nearer than the
    /// centre it is (1 for all in an orthographic view). `None` behind the eye, or close before it.
    pub(super) fn project(&self, p: [f64; 3]) -> Option<([f64; 2], f64, f64)> {
        let d = DVec3::from(p) - self.centre;
        let [x, y, z] = self.axes.map(|axis| axis.dot(d) / self.radius);
        let Some(distance) = self.distance else { return Some(([x, y], z, 1.0)) };
        let distance = distance / self.radius;
        let left = distance - z;
        if left < 1e-3 * distance {
            return None;
        }
        let near = distance / left;
        Some(([x * near, y * near], near, near))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn the_mesh_fits_from_every_side() {
        let mut mesh = samples::asteroid(5, 3);
        mesh.positions.iter_mut().for_each(|p| *p = [4.0 * p[0] + 1e5, p[1], p[2] - 3.0]);
        for direction in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1e-9], [1.0, -2.0, 3.0]] {
            let boxed = View::from_angles(&mesh, direction[0], direction[1] / 2.0);
            let sphere = View::around(&mesh, direction);
            for view in [sphere, sphere.perspective(40.0), boxed, boxed.perspective(40.0), boxed.perspective(90.0)] {
                for a in 0..3 {
                    for b in 0..3 {
                        let expected = if a == b { 1.0 } else { 0.0 };
                        assert!((view.axes[a].dot(view.axes[b]) - expected).abs() < 1e-12);
                    }
                }
                for &p in &mesh.positions {
                    let ([x, y], _, near) = view.project(p).unwrap();
                    assert!(x.abs() <= 1.0 && y.abs() <= 1.0 && near > 0.0, "{x} {y}");
                }
            }
        }
    }

    #[test]
    fn nearer_is_deeper_and_larger() {
        let mesh = samples::sphere(3, 0.0, 0);
        let flat = View::around(&mesh, [0.0, 0.0, 1.0]);
        let deep = flat.perspective(60.0);
        for view in [flat, deep] {
            let [far, near] = [-0.5, 0.5].map(|z| view.project([0.1, 0.2, z]).unwrap());
            assert!(near.1 > far.1);
            assert!(if view == flat { near.0 == far.0 } else { near.0[0] > far.0[0] });
        }
        assert!(deep.project([0.0, 0.0, 1e3]).is_none());
    }
}
