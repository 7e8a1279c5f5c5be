//! PLY, binary, little endian: `vertex`, `face`, and `edge` for dangling edges.
//!
//! Coordinates are `float` where all of them read back to the same lattice point (without a lattice: to the same
//! number), else `double`.

use std::io::Write;

use super::{Census, WriteErrorKind, WriteWarning, moved, single};
use crate::lattice::Lattice;
use crate::mesh::Mesh;

pub(super) fn write(
    out: &mut impl Write,
    mesh: &Mesh,
    lattice: Option<&Lattice>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let census = Census::of(mesh);
    let short = moved(mesh, lattice, 0.0, single).count == 0;
    let real = if short { "float" } else { "double" };
    let wide = mesh.faces().any(|f| f.len() > 255);
    let count = if wide { "uint" } else { "uchar" };
    // Most programs know `int` alone; `uint` only where it is needed.
    let index = if mesh.vertex_count() > i32::MAX as usize { "uint" } else { "int" };
    write!(out, "ply\nformat binary_little_endian 1.0\ncomment lodestream\nelement vertex {}\n", mesh.vertex_count())?;
    write!(out, "property {real} x\nproperty {real} y\nproperty {real} z\n")?;
    write!(out, "element face {}\nproperty list {count} {index} vertex_indices\n", census.faces)?;
    if census.edges > 0 {
        write!(out, "element edge {}\nproperty {index} vertex1\nproperty {index} vertex2\n", census.edges)?;
    }
    out.write_all(b"end_header\n")?;

    for p in &mesh.positions {
        let mut record = [0; 24];
        let size = if short { 4 } else { 8 };
        for (bytes, &x) in record.chunks_exact_mut(size).zip(p) {
            if short {
                bytes.copy_from_slice(&(x as f32).to_le_bytes());
            } else {
                bytes.copy_from_slice(&x.to_le_bytes());
            }
        }
        out.write_all(&record[..3 * size])?;
    }
    let mut record = Vec::with_capacity(64);
    for face in mesh.faces().filter(|f| f.len() > 2) {
        record.clear();
        let degree = face.len() as u32;
        record.extend_from_slice(&degree.to_le_bytes()[..if wide { 4 } else { 1 }]);
        for v in face {
            record.extend_from_slice(&v.to_le_bytes());
        }
        out.write_all(&record)?;
    }
    for edge in mesh.faces().filter(|f| f.len() == 2) {
        for v in edge {
            out.write_all(&v.to_le_bytes())?;
        }
    }
    Ok(Vec::new())
}
