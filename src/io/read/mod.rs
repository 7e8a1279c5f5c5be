//! Reading: every mesh format in, one [`Mesh`] out.
//!
//! OBJ, PLY, STL, OFF, glTF and GLB, each also packed with gzip, Zstandard or xz. A file is taken into memory whole
//! and parsed in place; positions come out as `f64` exactly as the file has them (glTF: after the transforms of its
//! nodes). Attributes become [layers](crate::mesh::Layer) on corners, materials of all formats glTF material objects,
//! and images come along. What a file holds beside all that is left out, and a [`Warning`] names and counts it.
//!
//! Nothing is allocated that the size of the input does not justify, and no input makes a reader panic: it gets
//! a [`ReadError`] that says where, what is wrong and what to do.

mod appearance;
mod attribute;
mod budget;
mod build;
mod error;
mod foreign;
mod gltf;
pub(crate) mod mtl;
mod obj;
mod off;
mod pack;
mod ply;
mod stl;
mod survey;
mod text;
mod warning;
mod weld;

use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::io::beside::{Folder, open_regular};
use crate::io::memory::default_memory;
use crate::mesh::{LayerKind, Mesh};
use build::Budget;
use error::{Fail, printable};

pub(crate) use appearance::media_type;
pub use error::{Place, ReadError, ReadErrorKind};
pub(crate) use gltf::extensions_in;
pub(crate) use pack::Packing;
#[cfg(feature = "ingest")]
pub(crate) use survey::drawn_images;
pub use survey::{Survey, Values, survey, survey_head, survey_path};
pub(crate) use warning::counted;
pub use warning::{Layer, Warning};

/// The formats that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Polygon file format, ASCII or binary of either byte order.
    Ply,
    /// Stereolithography, ASCII or binary.
    Stl,
    /// Object file format of Geomview, ASCII.
    Off,
    /// glTF 2.0 as JSON with buffers beside it or inside.
    Gltf,
    /// glTF 2.0 in one binary file.
    Glb,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 6] = [Format::Obj, Format::Ply, Format::Stl, Format::Off, Format::Gltf, Format::Glb];

    /// Its extension, in lower case and without the dot; also its name on a command line.
    pub fn extension(self) -> &'static str {
        match self {
            Format::Obj => "obj",
            Format::Ply => "ply",
            Format::Stl => "stl",
            Format::Off => "off",
            Format::Gltf => "gltf",
            Format::Glb => "glb",
        }
    }

    /// The format with this extension or name, in any case, without a dot.
    pub fn from_extension(extension: &str) -> Option<Format> {
        Format::ALL.into_iter().find(|f| f.extension().eq_ignore_ascii_case(extension))
    }

    /// The format that the extension of a path names; a last `.gz`, `.zst` or `.xz` is looked through.
    ///
    /// # Errors
    /// The extension that is not known, empty when there is none.
    pub fn from_path(path: &Path) -> Result<Format, String> {
        let extension = |p: &Path| p.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
        let mut last = extension(path);
        if Packing::from_extension(&last).is_some() {
            last = path.file_stem().map(|stem| extension(Path::new(stem))).unwrap_or_default();
        }
        Format::from_extension(&last).ok_or(last)
    }
}

/// How to read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Join vertex records at equal positions. `None`: as the format needs it; STL, glTF, GLB and PLY with texture
    /// coordinates on vertices are welded, all others not.
    pub weld: Option<bool>,
    /// The most bytes of memory that the input and the mesh may take together; `None`: four fifths of what is free when
    /// reading begins.
    pub memory_limit: Option<u64>,
    /// What to leave out, without a warning.
    pub drop: DropSet,
    /// Whether a file without any vertex is a mesh; otherwise it is an error of the kind [`ReadErrorKind::Empty`].
    pub allow_empty: bool,
    /// What becomes of vertices with a coordinate that is NaN or infinite.
    pub invalid: Invalid,
    /// Files that the mesh refers to are found only in this folder; `None`: only in the folder of the mesh file. Names
    /// are relative to the latter in any case, where there is one.
    pub asset_root: Option<PathBuf>,
}

impl ReadOptions {
    /// The same with a limit of memory.
    fn limited(&self) -> ReadOptions {
        let memory_limit = Some(self.memory_limit.unwrap_or_else(default_memory));
        ReadOptions { memory_limit, ..self.clone() }
    }

    /// Where files are that the mesh refers to.
    fn folder(&self, base: Option<&Path>) -> Option<Folder> {
        let root = self.asset_root.as_deref();
        base.or(root).map(|base| Folder::new(base, root))
    }
}

/// What becomes of vertices with a coordinate that is NaN or infinite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Invalid {
    /// The first is an error.
    #[default]
    Error,
    /// They are left out, and with them the faces that use them; a warning counts both.
    Drop,
}

/// What a reader leaves out because its caller asks for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DropSet {
    /// Normals.
    pub normals: bool,
    /// Colours.
    pub colors: bool,
    /// Texture coordinates.
    pub uvs: bool,
    /// Tangents.
    pub tangents: bool,
    /// All other attributes.
    pub scalars: bool,
    /// Materials, and with them textures and images.
    pub materials: bool,
    /// The bytes of images; their names stay.
    pub images: bool,
}

impl DropSet {
    /// Nothing is left out.
    pub const NONE: DropSet = DropSet {
        normals: false,
        colors: false,
        uvs: false,
        tangents: false,
        scalars: false,
        materials: false,
        images: false,
    };
    /// Only geometry and connectivity stay.
    pub const ALL: DropSet = DropSet {
        normals: true,
        colors: true,
        uvs: true,
        tangents: true,
        scalars: true,
        materials: true,
        images: true,
    };

    /// Whether layers of this kind are left out.
    pub fn kind(&self, kind: LayerKind) -> bool {
        match kind {
            LayerKind::Uv => self.uvs,
            LayerKind::Normal => self.normals,
            LayerKind::Tangent => self.tangents,
            LayerKind::Color => self.colors,
            LayerKind::Scalar => self.scalars,
        }
    }
}

/// What a file held.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadMesh {
    /// The mesh; it is valid (see [`Mesh::validate`]).
    pub mesh: Mesh,
    /// For each vertex record of the file, in its order, the vertex of the mesh. Records are: the vertices of OBJ,
    /// PLY and OFF; the corners of STL; for glTF the positions of each mesh of each node (and instance), depth first.
    /// [`NO_VALUE`](crate::mesh::NO_VALUE) for one that was left out ([`Invalid::Drop`]).
    pub map: Vec<u32>,
    /// What was left out or read otherwise.
    pub warnings: Vec<Warning>,
}

/// Read a mesh file; its extension names the format, and `.gz` behind it is unpacked.
///
/// # Errors
/// See [`ReadErrorKind`].
pub fn read_path(path: impl AsRef<Path>, options: &ReadOptions) -> Result<ReadMesh, ReadError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let fail = |kind| ReadError { name: name.clone(), place: None, kind };
    let io_fail = |e: &io::Error| fail(io_kind(e));
    // A missing file or a folder is the likelier mistake, so it is looked for before the extension.
    let meta = std::fs::metadata(path).map_err(|e| io_fail(&e))?;
    if meta.is_dir() {
        return Err(fail(ReadErrorKind::Directory));
    }
    let format = Format::from_path(path).map_err(|extension| fail(ReadErrorKind::UnknownExtension { extension }))?;
    let options = &options.limited();
    let (file, size) = open_regular(path).map_err(|e| match e.kind() {
        io::ErrorKind::InvalidInput => fail(ReadErrorKind::NotRegular),
        _ => io_fail(&e),
    })?;
    let bytes = slurp(file, size, options).map_err(|e| e.named(&name))?;
    check_packing(path, &bytes, &name)?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    parse_owned(bytes, format, Some(folder), options).map_err(|e| e.named(&name))
}

/// Whether a file that is packed by its name is so by its bytes; errors call it `name`.
pub(crate) fn check_packing(path: &Path, bytes: &[u8], name: &str) -> Result<(), ReadError> {
    let extension = path.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
    match Packing::from_extension(&extension) {
        Some(packing) if !bytes.is_empty() && Packing::of(bytes) != Some(packing) => {
            let ((format, expected), found) = (packing.name(), printable(bytes));
            let kind = ReadErrorKind::WrongMagic { format, expected, found };
            Err(ReadError { name: name.to_string(), place: None, kind })
        }
        _ => Ok(()),
    }
}

/// Read a mesh from a stream such as standard input, which `name` stands for in errors. Packed data are recognized.
///
/// `base_dir`: the folder of the files that the mesh refers to. Without it buffers of glTF outside the document are an
/// error, images and MTL files a warning.
///
/// # Errors
/// See [`ReadErrorKind`].
pub fn read_from(
    reader: impl Read,
    name: &str,
    format: Format,
    base_dir: Option<&Path>,
    options: &ReadOptions,
) -> Result<ReadMesh, ReadError> {
    let options = &options.limited();
    let read = || parse_owned(slurp(reader, 0, options)?, format, base_dir, options);
    read().map_err(|e| e.named(name))
}

/// Read a mesh from memory. Packed data are recognized. Errors call the input `input`.
///
/// `base_dir`: the folder of the files that the mesh refers to. Without it buffers of glTF outside the document are an
/// error, images and MTL files a warning.
///
/// # Errors
/// See [`ReadErrorKind`].
pub fn read_bytes(
    bytes: &[u8],
    format: Format,
    base_dir: Option<&Path>,
    options: &ReadOptions,
) -> Result<ReadMesh, ReadError> {
    let options = &options.limited();
    let read = || match Packing::of(bytes) {
        Some(packing) => parse(&unpack(packing, bytes, options)?, format, base_dir, options),
        None => parse(bytes, format, base_dir, options),
    };
    read().map_err(|e: Fail| e.named("input"))
}

/// The comment by which a PLY file says that its vertices repeat for their attributes, so that they are welded again.
pub(crate) const REPEATED: &str = "vertices repeat for their attributes";

/// The comment by which a PLY file says that vertices at one position are different ones, so that they stay apart.
pub(crate) const DISTINCT: &str = "vertices do not repeat";

/// The mark of the material that a GLB needs for faces without one.
pub(crate) const NO_MATERIAL: &str = "no material";

fn parse_owned(
    mut bytes: Vec<u8>,
    format: Format,
    base_dir: Option<&Path>,
    options: &ReadOptions,
) -> Result<ReadMesh, Fail> {
    if let Some(packing) = Packing::of(&bytes) {
        bytes = unpack(packing, &bytes, options)?;
    }
    parse(&bytes, format, base_dir, options)
}

fn parse(bytes: &[u8], format: Format, base_dir: Option<&Path>, options: &ReadOptions) -> Result<ReadMesh, Fail> {
    // An OBJ of nothing is a mesh of nothing, where that is allowed.
    if bytes.trim_ascii().is_empty() && !(options.allow_empty && format == Format::Obj) {
        return Err(ReadErrorKind::Empty.into());
    }
    let folder = options.folder(base_dir);
    let folder = folder.as_ref();
    match format {
        Format::Obj => obj::read(bytes, folder, options),
        Format::Ply => ply::read(bytes, folder, options),
        Format::Stl => stl::read(bytes, options),
        Format::Off => off::read(bytes, options),
        Format::Gltf | Format::Glb => gltf::read(bytes, folder, options),
    }
}

/// All bytes of a reader, within the memory limit. `size`: a guess.
fn slurp(reader: impl Read, size: u64, options: &ReadOptions) -> Result<Vec<u8>, Fail> {
    let mut bytes = Vec::new();
    let mut budget = Budget::new(0, options.memory_limit);
    // A directory entry may lie, but it lies about a file that is there: still no more than the limit allows.
    budget.reserve(&mut bytes, usize::try_from(size.saturating_add(1)).unwrap_or(usize::MAX))?;
    let limit = options.memory_limit.unwrap_or(u64::MAX - 1);
    reader.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| io_kind(&e))?;
    if bytes.len() as u64 > limit {
        return Err(ReadErrorKind::Memory { needed: bytes.len() as u64, limit: options.memory_limit }.into());
    }
    Ok(bytes)
}

/// Unpack packed data.
fn unpack(packing: Packing, bytes: &[u8], options: &ReadOptions) -> Result<Vec<u8>, Fail> {
    let held = bytes.len() as u64;
    let limit = options.memory_limit.map(|l| l.saturating_sub(held));
    let within = ReadOptions { memory_limit: limit, ..options.clone() };
    slurp(packing.reader(bytes), 0, &within).map_err(|fail| {
        let kind = match fail.kind {
            ReadErrorKind::Io(message) => ReadErrorKind::Packed(message),
            ReadErrorKind::Memory { needed, .. } => {
                ReadErrorKind::Memory { needed: needed + held, limit: options.memory_limit }
            }
            kind => kind,
        };
        kind.into()
    })
}

fn io_kind(e: &io::Error) -> ReadErrorKind {
    match e.kind() {
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => ReadErrorKind::NotFound,
        io::ErrorKind::IsADirectory => ReadErrorKind::Directory,
        io::ErrorKind::PermissionDenied => ReadErrorKind::Permission,
        _ => ReadErrorKind::Io(e.to_string()),
    }
}
