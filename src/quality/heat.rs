//! Distances as colours: a PLY file of a mesh with its distance to another at each vertex.

use crate::mesh::Mesh;
use std::io::{self, Write};

/// Eight steps of the map "viridis" (Smith and van der Walt, public domain), from near to far.
const STEPS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// The colour of a number between 0 (dark) and 1 (yellow); what lies outside is cut off.
pub fn colour(at: f64) -> [u8; 3] {
    let at = if at.is_nan() { 0.0 } else { at.clamp(0.0, 1.0) } * (STEPS.len() - 1) as f64;
    let i = (at as usize).min(STEPS.len() - 2);
    let t = at - i as f64;
    std::array::from_fn(|k| (f64::from(STEPS[i][k]) * (1.0 - t) + f64::from(STEPS[i + 1][k]) * t + 0.5) as u8)
}

/// Write a binary PLY file of `mesh` with a colour and the property `quality` (the distance) at each vertex; `most` is the distance
/// that is yellow. Dangling edges go into the element `edge`.
///
/// # Errors
/// What `out` reports.
pub fn write_ply(out: &mut dyn Write, mesh: &Mesh, distances: &[f64], most: f64) -> io::Result<()> {
    let edges = mesh.faces().filter(|f| f.len() == 2).count();
    let faces = mesh.face_count() - edges;
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment distance at each vertex; the last colour is {most}\n\
         element vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty double quality\n\
         element face {faces}\nproperty list uint uint vertex_indices\n",
        mesh.vertex_count()
    )?;
    if edges > 0 {
        write!(out, "element edge {edges}\nproperty uint vertex1\nproperty uint vertex2\n")?;
    }
    writeln!(out, "end_header")?;
    for (p, &distance) in mesh.positions.iter().zip(distances) {
        p.iter().try_for_each(|c| out.write_all(&c.to_le_bytes()))?;
        out.write_all(&colour(if most > 0.0 { distance / most } else { 0.0 }))?;
        out.write_all(&distance.to_le_bytes())?;
    }
    for face in mesh.faces().filter(|f| f.len() > 2) {
        out.write_all(&(face.len() as u32).to_le_bytes())?;
        face.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
    }
    for edge in mesh.faces().filter(|f| f.len() == 2) {
        edge.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;

    #[test]
    fn colours_run_from_dark_to_yellow() {
        assert_eq!(colour(-1.0), STEPS[0]);
        assert_eq!(colour(f64::NAN), STEPS[0]);
        assert_eq!(colour(2.0), STEPS[8]);
        assert_eq!(colour(0.5), STEPS[4]);
    }

    #[cfg(feature = "formats")]
    #[test]
    fn the_file_is_the_mesh() {
        let mesh = samples::crumbs(30, 1);
        let distances: Vec<f64> = (0..mesh.vertex_count()).map(|v| v as f64).collect();
        let mut bytes = Vec::new();
        write_ply(&mut bytes, &mesh, &distances, 30.0).unwrap();
        let options = crate::io::read::ReadOptions { weld: Some(false), ..Default::default() };
        let back = crate::io::read::read_bytes(&bytes, crate::io::read::Format::Ply, None, &options).unwrap().mesh;
        assert_eq!(back.positions, mesh.positions);
        assert_eq!(back.face_count(), mesh.face_count());
    }
}
