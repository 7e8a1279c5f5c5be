//! Texture coordinates: how far those of one mesh are from another's at the same places, and how much they stretch a texture.

use super::distance::{Sampled, diagonal, foot};
use super::surface::Surface;
use crate::mesh::{Layer, LayerKind, Mesh, NO_VALUE};
use crate::parallel;
use glam::DVec3;

/// Samples that one task looks up.
const BLOCK: usize = 4096;

/// The error of texture coordinates, in their own units (1 is the side of the image).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UvError {
    /// Root mean square over the surface.
    pub rms: f64,
    /// Root mean square of the best 99 hundredths: a seam that lies elsewhere makes few but large errors.
    pub rms_99: f64,
    /// The largest.
    pub max: f64,
    /// Samples with texture coordinates on both sides.
    pub samples: usize,
}

/// How a layer of texture coordinates stretches a texture over the surface (Sander et al. 2001), 1 at best: relative to the one factor
/// that gives texture and surface the same area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stretch {
    /// Root mean square over the surface and all directions.
    pub l2: f64,
    /// The largest anywhere.
    pub max: f64,
    /// Share of the surface whose texture coordinates enclose no area; left out of the others.
    pub flat: f64,
}

/// Layer `index` among those of texture coordinates.
pub fn layer(mesh: &Mesh, index: usize) -> Option<&Layer> {
    mesh.layers.iter().filter(|l| l.kind == LayerKind::Uv && l.width >= 2).nth(index)
}

/// The texture coordinates at the corners of a triangle of the surface.
fn corners(mesh: &Mesh, layer: &Layer, surface: &Surface, triangle: u32) -> Option<[[f64; 2]; 3]> {
    let origin = surface.origin(triangle);
    if origin.face == NO_VALUE {
        return None;
    }
    let first = mesh.face_start[origin.face as usize] as usize;
    let n = mesh.face_start[origin.face as usize + 1] as usize - first;
    let value = |corner: usize| {
        let value = layer.corners.get(first + corner % n).copied().filter(|&v| v != NO_VALUE)?;
        let v = layer.value(value);
        Some([v[0], v[1]])
    };
    match n {
        2 => Some([value(0)?, value(1)?, value(1)?]),
        3 => Some([value(0)?, value(1)?, value(2)?]),
        _ => {
            let mut mean = [0.0; 2];
            for corner in 0..n {
                let v = value(corner)?;
                (0..2).for_each(|k| mean[k] += v[k] / n as f64);
            }
            Some([value(origin.corner as usize)?, value(origin.corner as usize + 1)?, mean])
        }
    }
}

fn blend(c: [[f64; 2]; 3], w: [f64; 3]) -> [f64; 2] {
    [0, 1].map(|k| w[0] * c[0][k] + w[1] * c[1][k] + w[2] * c[2][k])
}

/// The error of layer `index` of `b` against that of `a`, over samples of `a`; `None` where either has no such layer.
///
/// Each sample is compared with the nearest point of `b`. Beside a seam two points are about as near: of those no farther than twice the
/// nearest one (and a millionth of the diagonal) the one whose coordinates fit best counts.
pub fn uv_error(a: &Sampled<'_>, b: &Sampled<'_>, index: usize, samples: usize) -> Option<UvError> {
    let (layer_a, layer_b) = (layer(a.mesh(), index)?, layer(b.mesh(), index)?);
    let slack = 1e-6 * diagonal(a.mesh());
    let blocks = parallel::map(parallel::ranges(samples, BLOCK), |block| {
        let (mut squares, mut hint) = (Vec::new(), 0);
        a.on_faces(block, samples, |triangle, w, x| {
            let Some(own) = corners(a.mesh(), layer_a, &a.surface, triangle) else { return };
            let own = blend(own, w);
            let Some(nearest) = b.surface.nearest(x.to_array(), hint) else { return };
            hint = nearest.triangle;
            let mut best = f64::INFINITY;
            let reach = 2.0 * nearest.distance2.sqrt() + slack;
            b.surface.within(x.to_array(), reach * reach, |candidate| {
                let Some(other) = corners(b.mesh(), layer_b, &b.surface, candidate) else { return };
                let other = blend(other, foot(&b.surface, candidate, x));
                best = best.min((own[0] - other[0]).powi(2) + (own[1] - other[1]).powi(2));
            });
            if best.is_finite() {
                squares.push(best);
            }
        });
        squares
    });
    let mut squares = blocks.concat();
    squares.sort_unstable_by(f64::total_cmp);
    let rms = |s: &[f64]| (s.iter().sum::<f64>() / s.len().max(1) as f64).sqrt();
    Some(UvError {
        rms: rms(&squares),
        rms_99: rms(&squares[..squares.len() - squares.len() / 100]),
        max: squares.last().map_or(0.0, |s| s.sqrt()),
        samples: squares.len(),
    })
}

/// The stretch of layer `index` of texture coordinates; `None` where there is none, or no area.
pub fn stretch(mesh: &Sampled<'_>, index: usize) -> Option<Stretch> {
    let layer = layer(mesh.mesh(), index)?;
    let (mut sum, mut most, mut area, mut flat, mut uv_area) = (0.0, 0.0f64, 0.0, 0.0, 0.0);
    for i in 0..mesh.surface.len() as u32 {
        let Some([u, v, w]) = corners(mesh.mesh(), layer, &mesh.surface, i) else { continue };
        let [p, q, r] = mesh.surface.triangle(i).map(DVec3::from);
        let (e, f) = (q - p, r - p);
        let own = 0.5 * e.cross(f).length();
        let (s, t) = ([v[0] - u[0], v[1] - u[1]], [w[0] - u[0], w[1] - u[1]]);
        let twice = s[0] * t[1] - s[1] * t[0];
        if own == 0.0 || twice.abs() < 1e-18 {
            flat += own;
            continue;
        }
        // How the surface moves along u and along v.
        let along_u = (e * t[1] - f * s[1]) / twice;
        let along_v = (f * s[0] - e * t[0]) / twice;
        let (a, b, c) = (along_u.dot(along_u), along_u.dot(along_v), along_v.dot(along_v));
        sum += 0.5 * (a + c) * own;
        most = most.max(0.5 * (a + c + ((a - c).powi(2) + 4.0 * b * b).sqrt()));
        area += own;
        uv_area += 0.5 * twice.abs();
    }
    if area == 0.0 {
        return None;
    }
    let scale = uv_area / area;
    Some(Stretch { l2: (sum / area * scale).sqrt(), max: (most * scale).sqrt(), flat: flat / (area + flat) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Stored;

    /// A square sheet of quads with a layer of texture coordinates.
    fn sheet(parts: u32, uv: impl Fn([f64; 2]) -> [f64; 2]) -> Mesh {
        let n = parts + 1;
        let at = |i: u32| [f64::from(i % n) / f64::from(parts), f64::from(i / n) / f64::from(parts)];
        let mut mesh = Mesh { positions: (0..n * n).map(|i| [at(i)[0], at(i)[1], 0.0]).collect(), ..Mesh::default() };
        for i in (0..parts * n).filter(|i| i % n < parts) {
            mesh.push_face(&[i, i + 1, i + n + 1, i + n]);
        }
        let values = (0..n * n).flat_map(|i| uv(at(i))).collect();
        let layer = Layer::per_vertex("uv", LayerKind::Uv, 2, Stored::F32, values, &mesh.corners, (n * n) as usize);
        mesh.layers.push(layer);
        mesh.validate().unwrap();
        mesh
    }

    #[test]
    fn errors_are_those_that_were_made() {
        let a = sheet(5, |p| p);
        let moved = sheet(3, |p| [p[0] + 0.03, p[1] - 0.04]);
        let (a, moved) = (Sampled::new(&a), Sampled::new(&moved));
        let error = uv_error(&a, &moved, 0, 2000).unwrap();
        assert!((error.rms - 0.05).abs() < 1e-9 && (error.max - 0.05).abs() < 1e-9, "{error:?}");
        assert_eq!(error.samples, 2000);
        assert!(uv_error(&a, &a, 0, 2000).unwrap().max < 1e-12);
        assert_eq!(uv_error(&a, &moved, 1, 100), None);
        // u² is not linear on the faces of either.
        let curved = sheet(4, |p| [p[0] * p[0], p[1]]);
        let fine = sheet(40, |p| [p[0] * p[0], p[1]]);
        let error = uv_error(&Sampled::new(&fine), &Sampled::new(&curved), 0, 4000).unwrap();
        // A chord over a quarter is off by at most (1/8)²; the root mean square is that times √(8/15).
        assert!(
            (error.max - 1.0 / 64.0).abs() < 5e-4 && (error.rms - (8f64 / 15.0).sqrt() / 64.0).abs() < 3e-4,
            "{error:?}"
        );
    }

    #[test]
    fn beside_a_seam_the_fitting_side_counts() {
        // Left and right half with texture coordinates far from each other, by corners.
        let mut a = sheet(4, |p| p);
        let count = a.layers[0].len() as u32;
        let layer = &mut a.layers[0];
        let shifted: Vec<f64> = layer.values.chunks(2).flat_map(|v| [v[0] + 10.0, v[1]]).collect();
        layer.values.extend(shifted);
        for corner in 0..a.corners.len() {
            if corner / 4 % 4 >= 2 {
                layer.corners[corner] += count;
            }
        }
        a.validate().unwrap();
        let mut b = a.clone();
        b.positions.iter_mut().for_each(|p| p[2] = 1e-3);
        let error = uv_error(&Sampled::new(&a), &Sampled::new(&b), 0, 5000).unwrap();
        assert!(error.max < 1e-3, "{error:?}");
    }

    #[test]
    fn stretch_is_one_where_shapes_are_kept() {
        let one = stretch(&Sampled::new(&sheet(4, |p| [0.3 * p[1], 0.3 * p[0]])), 0).unwrap();
        assert!((one.l2 - 1.0).abs() < 1e-12 && (one.max - 1.0).abs() < 1e-12 && one.flat == 0.0, "{one:?}");
        // Twice as wide in the texture: √2 and 1/√2 of what equal areas would be.
        let wide = stretch(&Sampled::new(&sheet(4, |p| [2.0 * p[0], p[1]])), 0).unwrap();
        assert!((wide.max - 2f64.sqrt()).abs() < 1e-12, "{wide:?}");
        assert!((wide.l2 - (0.5 * (2.0 + 0.5f64)).sqrt()).abs() < 1e-12, "{wide:?}");
        assert_eq!(stretch(&Sampled::new(&sheet(2, |p| [p[0], 0.0])), 0), None);
    }
}
