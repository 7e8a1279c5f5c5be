//! STL, binary: triangles alone, in single precision. Polygons become fans around their first corner.

use std::io::Write;

use super::{Census, WriteErrorKind, WriteWarning, moved, single, triangles};
use crate::mesh::Mesh;
use crate::mesh::lattice::Lattice;

pub(super) fn write(
    out: &mut impl Write,
    mesh: &Mesh,
    lattice: Option<&Lattice>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let census = Census::of(mesh);
    let mut warnings: Vec<WriteWarning> = census.fanned().into_iter().collect();
    if census.edges > 0 {
        warnings.push(WriteWarning::EdgesLeftOut { count: census.edges });
    }
    if !census.isolated.is_empty() {
        warnings.push(WriteWarning::PointsLeftOut { count: census.isolated.len() as u64 });
    }
    for layer in &mesh.layers {
        warnings.push(WriteWarning::LayerLeftOut { layer: layer.name.clone(), count: layer.len() as u64 });
    }
    if !mesh.appearance.materials.is_empty() {
        warnings.push(WriteWarning::MaterialsSimplified { count: mesh.appearance.materials.len() as u64 });
    }
    let rounded = moved(mesh, lattice, tolerance(mesh), single);
    if rounded.farthest.is_infinite() {
        let largest = mesh.positions.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
        return Err(WriteErrorKind::Coordinate { largest });
    }
    if rounded.count > 0 {
        warnings.push(WriteWarning::Rounded { count: rounded.count, farthest: rounded.farthest });
    }
    let Ok(count) = u32::try_from(census.triangles) else {
        let (what, limit) = ("triangles", u64::from(u32::MAX));
        return Err(WriteErrorKind::TooLarge { what, count: census.triangles, limit });
    };
    let mut header = [0; 84];
    // Not `solid`, which readers take for text.
    header[..21].copy_from_slice(b"lodestream binary STL");
    header[80..].copy_from_slice(&count.to_le_bytes());
    out.write_all(&header)?;
    for triangle in triangles(mesh) {
        let p = triangle.map(|v| mesh.positions[v as usize]);
        let mut record = [0; 50];
        let numbers = [normal(&p)].into_iter().chain(p).flatten();
        for (bytes, x) in record.chunks_exact_mut(4).zip(numbers) {
            bytes.copy_from_slice(&(x as f32).to_le_bytes());
        }
        out.write_all(&record)?;
    }
    Ok(warnings)
}

/// Without a lattice, what a coordinate may lose unsaid: a part in four million of the longest side.
pub(super) fn tolerance(mesh: &Mesh) -> f64 {
    let side = mesh.bounds().map_or(0.0, |(lo, hi)| (0..3).map(|k| hi[k] - lo[k]).fold(0.0, f64::max));
    side / (1 << 22) as f64
}

/// The unit normal of a triangle, zero when it has none.
fn normal([a, b, c]: &[[f64; 3]; 3]) -> [f64; 3] {
    let (u, v): ([f64; 3], [f64; 3]) = (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
    let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { n.map(|x| x / length) } else { [0.0; 3] }
}
