//! Writing: a [`Mesh`] out as OBJ, PLY, STL or GLB.
//!
//! A polygon stays a polygon where the format has polygons. What a format cannot hold (dangling edges in STL) is
//! left out, and a [`WriteWarning`] counts it. Coordinates are written so that they read back to the same point of
//! the lattice where the format allows it. Materials and images of OBJ and PLY go into files beside the mesh.
//!
//! [`write_path`] writes to temporary files beside the target, syncs them and renames them, the mesh last: each file is
//! whole or untouched, and nothing is left behind on failure.

mod error;
mod glb;
mod mtl;
mod obj;
mod ply;
mod sidecars;
mod split;
mod stl;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::io::read::Format;
use crate::mesh::Mesh;
use crate::mesh::lattice::Lattice;
use sidecars::Sidecars;

pub use error::{WriteError, WriteErrorKind, WriteWarning};

/// How to write.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// The format; `None`: what the extension of the path names.
    pub format: Option<Format>,
}

/// Write a mesh to a file.
///
/// `lattice`: the lattice on which the positions lie, if there is one. With it a format may store less precise
/// numbers, as long as they read back to the same lattice points; without it numbers are kept exactly where the
/// format allows it. A path that names a device or a pipe is written in place.
///
/// # Errors
/// See [`WriteErrorKind`]. The target is as it was before, and no temporary file stays.
pub fn write_path(
    path: impl AsRef<Path>,
    mesh: &Mesh,
    lattice: Option<&Lattice>,
    options: &WriteOptions,
) -> Result<Vec<WriteWarning>, WriteError> {
    let path = path.as_ref();
    let fail = |kind| WriteError { name: path.display().to_string(), kind };
    write_file(path, mesh, lattice, options).map_err(fail)
}

/// Write a mesh to a stream such as standard output. The stream is flushed. Of OBJ and PLY it holds the mesh alone,
/// without the files of materials and images.
///
/// # Errors
/// See [`WriteErrorKind`]; errors call the target `output`.
pub fn write_to(
    mut out: impl Write,
    format: Format,
    mesh: &Mesh,
    lattice: Option<&Lattice>,
) -> Result<Vec<WriteWarning>, WriteError> {
    let fail = |kind| WriteError { name: "output".to_string(), kind };
    mesh.validate().map_err(|e| fail(e.into()))?;
    emit(&mut out, format, mesh, lattice, &mut Sidecars::default()).and_then(|w| flushed(&mut out, w)).map_err(fail)
}

/// What was written, and what belongs beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Written<'m> {
    /// What the format had to leave out or change.
    pub warnings: Vec<WriteWarning>,
    /// Names and bytes of the files of materials and images to write into the folder of the mesh, before the mesh gets its
    /// place there. The names are plain, unique and not those of files of another content.
    pub files: Vec<(String, Cow<'m, [u8]>)>,
}

/// Write a mesh to a stream that will become the file `target`, for callers that put files into their places on their own.
///
/// # Errors
/// See [`WriteErrorKind`]; errors call the target by its path.
pub fn write_with_files<'m>(
    mut out: impl Write,
    target: &Path,
    format: Format,
    mesh: &'m Mesh,
    lattice: Option<&Lattice>,
) -> Result<Written<'m>, WriteError> {
    let fail = |kind| WriteError { name: target.display().to_string(), kind };
    mesh.validate().map_err(|e| fail(e.into()))?;
    let mut beside = Sidecars::of(target);
    let warnings =
        emit(&mut out, format, mesh, lattice, &mut beside).and_then(|w| flushed(&mut out, w)).map_err(fail)?;
    Ok(Written { warnings, files: beside.files })
}

fn flushed(out: &mut impl Write, warnings: Vec<WriteWarning>) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    out.flush()?;
    Ok(warnings)
}

fn emit<'m>(
    out: &mut impl Write,
    format: Format,
    mesh: &'m Mesh,
    lattice: Option<&Lattice>,
    beside: &mut Sidecars<'m>,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    match format {
        Format::Obj => obj::write(out, mesh, beside),
        Format::Ply => ply::write(out, mesh, lattice, beside),
        Format::Stl => stl::write(out, mesh, lattice),
        Format::Glb => glb::write(out, mesh, lattice, beside),
        Format::Off | Format::Gltf => Err(unknown(format.extension())),
    }
}

fn unknown(extension: &str) -> WriteErrorKind {
    WriteErrorKind::UnknownExtension { extension: extension.to_string() }
}

fn write_file(
    path: &Path,
    mesh: &Mesh,
    lattice: Option<&Lattice>,
    options: &WriteOptions,
) -> Result<Vec<WriteWarning>, WriteErrorKind> {
    let extension = path.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
    let format = match options.format {
        Some(format) => format,
        None => Format::from_extension(&extension).ok_or_else(|| unknown(&extension))?,
    };
    if matches!(format, Format::Off | Format::Gltf) {
        return Err(unknown(format.extension()));
    }
    mesh.validate()?;
    let target = match fs::metadata(path) {
        Ok(meta) if meta.is_dir() => return Err(WriteErrorKind::Directory),
        // A device or a pipe must not be renamed over.
        Ok(meta) if !meta.is_file() => {
            let mut out = BufWriter::new(File::options().write(true).open(path)?);
            let warnings = emit(&mut out, format, mesh, lattice, &mut Sidecars::default())?;
            return flushed(&mut out, warnings);
        }
        // Through a link to the file it names, which would else be replaced by a file of its own.
        Ok(_) => fs::canonicalize(path)?,
        Err(_) => path.to_path_buf(),
    };
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    if !folder.is_dir() {
        return Err(WriteErrorKind::NoFolder { folder: folder.display().to_string() });
    }
    // Dropped on any error, and with it the file.
    let temporary = new_file(&folder)?;
    let mut out = BufWriter::with_capacity(1 << 16, temporary);
    let mut beside = Sidecars::of(&target);
    let warnings = emit(&mut out, format, mesh, lattice, &mut beside)?;
    let temporary = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    temporary.as_file().sync_all()?;
    let mut others = Vec::with_capacity(beside.files.len());
    for (name, bytes) in &beside.files {
        let path = folder.join(name);
        // A folder of that name is found out now rather than in the middle of renaming.
        if path.is_dir() {
            return Err(WriteErrorKind::Taken { name: name.clone() });
        }
        let mut file = new_file(&folder)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        others.push((file, path));
    }
    // The mesh comes last: when it is there, all that it names is there.
    let mut new: Vec<PathBuf> = Vec::new();
    let renamed = others.into_iter().chain([(temporary, target)]).try_for_each(|(file, path)| {
        let was = path.exists();
        file.persist(&path).map_err(|e| e.error)?;
        if !was {
            new.push(path);
        }
        Ok::<(), io::Error>(())
    });
    if renamed.is_err() {
        // There is an error to report already.
        new.iter().for_each(|path| drop(fs::remove_file(path)));
    }
    renamed?;
    Ok(warnings)
}

fn new_file(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lodestream-").suffix(".part");
    // Temporary files are private by default; this one will be the user's, under the usual mask.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

/// What writers need to know of a mesh: which vertices no element names, and how many elements are edges.
struct Census {
    /// Vertices that no element names.
    isolated: Vec<u32>,
    /// Elements of degree 2.
    edges: u64,
    /// Elements of degree 3 and more.
    faces: u64,
    /// Elements of degree 4 and more.
    polygons: u64,
    /// Triangles after cutting all polygons into fans.
    triangles: u64,
}

impl Census {
    fn of(mesh: &Mesh) -> Census {
        let mut used = vec![false; mesh.vertex_count()];
        let mut census = Census { isolated: Vec::new(), edges: 0, faces: 0, polygons: 0, triangles: 0 };
        for face in mesh.faces() {
            for &v in face {
                used[v as usize] = true;
            }
            if face.len() == 2 {
                census.edges += 1;
            } else {
                census.faces += 1;
                census.polygons += u64::from(face.len() > 3);
                census.triangles += face.len() as u64 - 2;
            }
        }
        census.isolated = (0..).zip(&used).filter(|(_, used)| !**used).map(|(v, _)| v).collect();
        census
    }

    /// The warning for polygons that become triangles.
    fn fanned(&self) -> Option<WriteWarning> {
        (self.polygons > 0).then_some(WriteWarning::Triangulated { polygons: self.polygons })
    }
}

/// The triangles of a mesh: polygons as fans around their first corner, edges left out.
fn triangles(mesh: &Mesh) -> impl Iterator<Item = [u32; 3]> + '_ {
    mesh.faces().flat_map(|f| f[1..].windows(2).map(|w| [f[0], w[0], w[1]]))
}

/// How many vertices do not read back to where they belong when stored as `stored` says.
///
/// With a lattice: to another lattice point. Without: to a place farther off than `tolerance`.
fn moved(mesh: &Mesh, lattice: Option<&Lattice>, tolerance: f64, stored: impl Fn(&[f64; 3]) -> [f64; 3]) -> Moved {
    let mut out = Moved { count: 0, farthest: 0.0 };
    for p in &mesh.positions {
        let s = stored(p);
        let off = (0..3).map(|k| (s[k] - p[k]).abs()).fold(0.0, f64::max);
        let held = match lattice {
            Some(l) => (0..3).all(|k| {
                let q = |x: f64| ((x - l.origin[k]) / l.step + 0.5).floor();
                q(s[k]) == q(p[k])
            }),
            None => off <= tolerance,
        };
        // A coordinate beyond f32 is infinite and held by nothing.
        if !held || !off.is_finite() {
            out.count += 1;
            out.farthest = out.farthest.max(off);
        }
    }
    out
}

struct Moved {
    count: u64,
    /// The largest change of a coordinate among them.
    farthest: f64,
}

/// The position in single precision.
fn single(p: &[f64; 3]) -> [f64; 3] {
    p.map(|x| f64::from(x as f32))
}
