//! What can go wrong in writing, and what a format had to leave out.

use std::fmt;
use std::io;

use thiserror::Error;

use crate::io::read::counted;
use crate::mesh::MeshError;

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
    /// A folder has the name of a file that goes beside the mesh.
    #[error("{name}, which goes beside it, is a folder; write elsewhere")]
    Taken {
        /// The name.
        name: String,
    },
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
    /// A layer for which the format has no place.
    LayerLeftOut {
        /// Its name.
        layer: String,
        /// How many values it has.
        count: u64,
    },
    /// Values at dangling edges, where the format has them at faces only.
    EdgeValuesLeftOut {
        /// The layer.
        layer: String,
        /// How many edges.
        count: u64,
    },
    /// Values at isolated vertices, where the format has them at faces only.
    PointValuesLeftOut {
        /// The layer.
        layer: String,
        /// How many vertices.
        count: u64,
    },
    /// The alpha of colours.
    AlphaLeftOut {
        /// The layer.
        layer: String,
        /// How many colours are not opaque.
        count: u64,
    },
    /// Vertices repeated because the format has one value for each.
    Repeated {
        /// How many vertices there are more.
        count: u64,
    },
    /// Vertices without a value, where the format needs one: it is 0.
    Filled {
        /// The layer.
        layer: String,
        /// How many vertices.
        count: u64,
    },
    /// Numbers that single precision does not hold.
    ValuesRounded {
        /// The layer.
        layer: String,
        /// How many values.
        count: u64,
    },
    /// Materials that say more than the format can.
    MaterialsSimplified {
        /// How many.
        count: u64,
    },
    /// Materials and images that go into files of their own, for which there is no place beside a stream or a device.
    FilesLeftOut {
        /// How many files.
        count: u64,
    },
    /// Images whose bytes are not known: the file refers to them by name.
    ImagesMissing {
        /// How many.
        count: u64,
    },
    /// Images in a coding that readers of the format need not know.
    ForeignImages {
        /// How many.
        count: u64,
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
            WriteWarning::LayerLeftOut { layer, count } => {
                let values = counted(*count, "value", "values");
                write!(f, "`{layer}` left out ({values}): the format has no place for it")
            }
            WriteWarning::EdgeValuesLeftOut { layer, count } => {
                let edges = counted(*count, "dangling edge", "dangling edges");
                write!(f, "`{layer}` left out at {edges}: the format has it at faces only")
            }
            WriteWarning::PointValuesLeftOut { layer, count } => {
                let points = counted(*count, "isolated vertex", "isolated vertices");
                write!(f, "`{layer}` left out at {points}: the format has it at faces only")
            }
            WriteWarning::AlphaLeftOut { layer, count } => {
                let values = counted(*count, "value", "values");
                write!(f, "alpha of {values} of `{layer}` left out: the format has none")
            }
            WriteWarning::Repeated { count } => {
                let vertices = counted(*count, "vertex", "vertices");
                write!(f, "{vertices} repeated: the format has one value of an attribute for each")
            }
            WriteWarning::Filled { layer, count } => {
                let vertices = counted(*count, "vertex", "vertices");
                write!(f, "{vertices} without a value of `{layer}` written with 0: the format needs one")
            }
            WriteWarning::ValuesRounded { layer, count } => {
                let values = counted(*count, "value", "values");
                write!(f, "{values} of `{layer}` rounded to the single precision of the format")
            }
            WriteWarning::MaterialsSimplified { count } => {
                let materials = counted(*count, "material", "materials");
                write!(f, "{materials} simplified: the format does not hold all that glTF says; GLB does")
            }
            WriteWarning::FilesLeftOut { count } => {
                let files = counted(*count, "file", "files");
                write!(f, "{files} of materials and images left out: write the mesh to a path, or as GLB")
            }
            WriteWarning::ImagesMissing { count } => {
                let images = counted(*count, "image is", "images are");
                write!(f, "{images} referred to by name only: the bytes are not known")
            }
            WriteWarning::ForeignImages { count } => {
                let images = counted(*count, "image", "images");
                write!(f, "{images} neither PNG nor JPEG nor WebP: viewers of glTF may not show them")
            }
        }
    }
}
