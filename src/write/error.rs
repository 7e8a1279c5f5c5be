//! What can go wrong in writing, and what a format had to leave out.

use std::fmt;
use std::io;

use thiserror::Error;

use crate::mesh::MeshError;
use crate::read::counted;

/// A mesh that could not be written.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{name}: {kind}")]
pub struct WriteError {
    /// The path, or `output`.
    pub name: String,
    /// What is wrong.
    pub kind: WriteErrorKind,
}

/// Why a mesh could not be written.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum WriteErrorKind {
    /// The extension names no format that can be written.
    #[error(
        "cannot write {}; write .obj, .ply, .stl or .glb",
        if extension.is_empty() { "a file without extension".to_string() } else { format!(".{extension} files") }
    )]
    UnknownExtension {
        /// The extension without its dot; may be empty.
        extension: String,
    },
    /// The folder of the target is missing.
    #[error("the folder {folder} does not exist; create it first")]
    NoFolder {
        /// The folder.
        folder: String,
    },
    /// The target is a folder.
    #[error("this is a folder; name a file in it")]
    Directory,
    /// The operating system refuses.
    #[error("no permission to write there; choose another folder or change its mode")]
    Permission,
    /// No space is left.
    #[error("the disk is full; make room or write elsewhere")]
    DiskFull,
    /// Any other failure of the operating system.
    #[error("cannot be written: {0}")]
    Io(String),
    /// The mesh does not hold its invariants.
    #[error("the mesh is not valid: {0}")]
    Mesh(#[from] MeshError),
    /// More than the format can count.
    #[error("{count} {what} are more than the format holds ({limit}); write PLY instead")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many.
        count: u64,
        /// How many there may be.
        limit: u64,
    },
    /// A coordinate that single precision cannot hold.
    #[error("coordinates reach {largest:e}, beyond the single precision of the format; write PLY or OBJ instead")]
    Coordinate {
        /// The largest coordinate, without sign.
        largest: f64,
    },
}

impl From<io::Error> for WriteErrorKind {
    fn from(e: io::Error) -> Self {
        match e.kind() {
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => WriteErrorKind::Permission,
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => WriteErrorKind::DiskFull,
            io::ErrorKind::IsADirectory => WriteErrorKind::Directory,
            _ => WriteErrorKind::Io(e.to_string()),
        }
    }
}

/// What a format had to leave out or change.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum WriteWarning {
    /// Dangling edges left out.
    EdgesLeftOut {
        /// How many.
        count: u64,
    },
    /// Isolated vertices left out.
    PointsLeftOut {
        /// How many.
        count: u64,
    },
    /// Polygons cut into triangles.
    Triangulated {
        /// How many polygons of more than three corners.
        polygons: u64,
    },
    /// Vertices that single precision moves, to another lattice point if there is a lattice.
    Rounded {
        /// How many.
        count: u64,
        /// The largest change of a coordinate, in the units of the mesh.
        farthest: f64,
    },
}

impl fmt::Display for WriteWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            WriteWarning::EdgesLeftOut { count } => {
                write!(
                    f,
                    "{} left out: the format has only triangles",
                    counted(*count, "dangling edge", "dangling edges")
                )
            }
            WriteWarning::PointsLeftOut { count } => {
                let points = counted(*count, "isolated vertex", "isolated vertices");
                write!(f, "{points} left out: the format has only triangles")
            }
            WriteWarning::Triangulated { polygons } => {
                let polygons = counted(*polygons, "polygon", "polygons");
                write!(f, "{polygons} cut into triangles: the format has no polygons")
            }
            WriteWarning::Rounded { count, farthest } => {
                let vertices = counted(*count, "vertex", "vertices");
                write!(
                    f,
                    "{vertices} moved by up to {farthest:.1e} in the single precision of the format; PLY and OBJ keep them"
                )
            }
        }
    }
}
