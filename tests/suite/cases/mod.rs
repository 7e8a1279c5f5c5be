//! Kinds of files that real programs write and that went wrong once: each kind with the value that is right.
#![cfg(feature = "formats")]

mod colours;
mod compressed;
mod counts;
mod named_files;
mod spellings;
mod strictness;

use std::path::{Path, PathBuf};

use lodestream::io::read::{Format, ReadError, ReadMesh, ReadOptions, read_bytes, read_path};
use lodestream::mesh::{Layer, LayerKind};

/// The path of a file in `tests/cases`.
fn case_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cases").join(name)
}

/// A file of `tests/cases`.
fn case(name: &str) -> Vec<u8> {
    std::fs::read(case_path(name)).unwrap()
}

/// Read from memory, as it comes.
fn read(bytes: impl AsRef<[u8]>, format: Format) -> Result<ReadMesh, ReadError> {
    read_bytes(bytes.as_ref(), format, None, &ReadOptions::default())
}

/// Read a file.
fn read_file(path: &Path) -> ReadMesh {
    read_path(path, &ReadOptions::default()).unwrap()
}

/// The warnings as text.
fn warnings(m: &ReadMesh) -> Vec<String> {
    m.warnings.iter().map(ToString::to_string).collect()
}

/// The faces as lists.
fn faces(m: &ReadMesh) -> Vec<Vec<u32>> {
    m.mesh.faces().map(<[u32]>::to_vec).collect()
}

/// The first layer of a kind.
fn layer(m: &ReadMesh, kind: LayerKind) -> &Layer {
    m.mesh.layers.iter().find(|l| l.kind == kind).unwrap()
}

/// The value at the first corner of vertex `v`.
fn at_vertex(m: &ReadMesh, kind: LayerKind, v: u32) -> Vec<f64> {
    let corner = m.mesh.corners.iter().position(|&c| c == v).unwrap();
    let layer = layer(m, kind);
    layer.value(layer.corners[corner]).to_vec()
}
