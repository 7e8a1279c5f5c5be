//! OBJ: `v`, `f` of any degree, `l` for dangling edges, `p` for isolated vertices.
//!
//! Numbers are the shortest decimals that read back to the same `f64`, so to the same lattice point.

use std::io::Write;

use super::{Census, WriteErrorKind, WriteWarning};
use crate::mesh::Mesh;

pub(super) fn write(out: &mut impl Write, mesh: &Mesh) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let census = Census::of(mesh);
    let mut line = Vec::with_capacity(128);
    let mut float = zmij::Buffer::new();
    for p in &mesh.positions {
        line.clear();
        line.push(b'v');
        for &x in p {
            line.push(b' ');
            let text = float.format_finite(x);
            line.extend_from_slice(text.strip_suffix(".0").unwrap_or(text).as_bytes());
        }
        line.push(b'\n');
        out.write_all(&line)?;
    }
    for face in mesh.faces() {
        line.clear();
        line.push(if face.len() == 2 { b'l' } else { b'f' });
        for &v in face {
            // A line of very many corners is passed on in parts.
            if line.len() > 4096 {
                out.write_all(&line)?;
                line.clear();
            }
            number(&mut line, v);
        }
        line.push(b'\n');
        out.write_all(&line)?;
    }
    for &v in &census.isolated {
        line.clear();
        line.push(b'p');
        number(&mut line, v);
        line.push(b'\n');
        out.write_all(&line)?;
    }
    Ok(Vec::new())
}

/// A blank and the number of vertex `v`, from 1.
fn number(line: &mut Vec<u8>, v: u32) {
    let mut digits = [0; 11];
    let (mut at, mut rest) = (digits.len(), u64::from(v) + 1);
    while rest > 0 {
        at -= 1;
        digits[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    line.push(b' ');
    line.extend_from_slice(&digits[at..]);
}
