//! Output files that appear whole or not at all: written beside their place under another name, then renamed. That name goes away
//! with whatever ends the program early, an error or Ctrl-C.

use anyhow::{Context, Result, bail};
use lodestream::io::read::Format;
use lodestream::io::write::{self, WriteError, WriteWarning};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::Lattice;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};

/// The temporary files there are. Whoever makes, renames or removes one holds the lock meanwhile, so that none escapes
/// [`remove_all`].
static TEMPORARY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn temporary_files() -> MutexGuard<'static, Vec<PathBuf>> {
    TEMPORARY.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// Remove all temporary files, and let no new one be made and none be renamed until the process is gone. For the moment
/// before a signal ends it.
pub fn remove_all() -> MutexGuard<'static, Vec<PathBuf>> {
    let files = temporary_files();
    for file in files.iter() {
        // Best effort: there is nobody left to do better.
        let _ = fs::remove_file(file);
    }
    files
}

/// A file on its way. Dropped before [`commit`](Output::commit) it leaves nothing behind.
pub struct Output {
    target: PathBuf,
    /// The target as the user wrote it.
    shown: String,
    /// Where the bytes go until then; `None` writes in place (a device or pipe, which a rename would replace).
    temporary: Option<PathBuf>,
    /// Files of materials and images that get their places first.
    beside: Vec<Output>,
}

impl Output {
    /// Prepare to write `path`, and see now, before any work, that it can be written.
    pub fn create(path: &Path) -> Result<Self> {
        let shown = path.display().to_string();
        if path.as_os_str().is_empty() || path.as_os_str() == "-" {
            bail!("the output has to be a file; name it with -o");
        }
        // A link's target is replaced, not the link.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        match fs::metadata(&target) {
            Ok(meta) if meta.is_dir() => bail!("{shown}: this is a folder; name a file in it"),
            Ok(meta) if !meta.is_file() => return Ok(Output { target, shown, temporary: None, beside: Vec::new() }),
            _ => {}
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("{shown}: the folder {} is not there; make it first", folder.display());
        }
        let Some(file_name) = target.file_name().map(|n| n.to_string_lossy().into_owned()) else {
            bail!("{shown}: this is no name for a file");
        };
        let mut files = temporary_files();
        // Only a new file will do: never one, or a link, of others.
        for attempt in 0..100 {
            let temporary = folder.join(format!(".lodestream-{}-{attempt}-{file_name}", std::process::id()));
            match File::create_new(&temporary) {
                Ok(_) => {
                    files.push(temporary.clone());
                    return Ok(Output { target, shown, temporary: Some(temporary), beside: Vec::new() });
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) if e.kind() == io::ErrorKind::PermissionDenied => {
                    bail!("{shown}: no permission to write there; choose another folder or change its mode")
                }
                Err(e) => return Err(e).with_context(|| format!("{shown}: cannot be written")),
            }
        }
        bail!("{shown}: cannot be written: the folder is full of temporary files .lodestream-*; remove them")
    }

    /// The file that takes the bytes until [`commit`](Output::commit).
    fn open(&self) -> io::Result<BufWriter<File>> {
        let path = self.temporary.as_deref().unwrap_or(&self.target);
        Ok(BufWriter::with_capacity(1 << 16, File::options().write(true).open(path)?))
    }

    /// Write all of it with one function.
    pub fn write(&self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
        let write = || {
            let mut out = self.open()?;
            fill(&mut out)?;
            out.flush()
        };
        write().with_context(|| format!("{}: cannot be written", self.shown))
    }

    /// Write a mesh in the format of the name's extension, and what belongs beside it; see [`write::write_with_files`].
    pub fn write_mesh(&mut self, mesh: &Mesh, lattice: Option<&Lattice>) -> Result<Vec<WriteWarning>> {
        let named = |error: WriteError| WriteError { name: self.shown.clone(), ..error };
        let extension = Path::new(&self.shown).extension().map(|e| e.to_string_lossy().into_owned());
        let Some(format) = extension.as_deref().and_then(Format::from_extension) else {
            bail!("{}: the extension names no format that can be written", self.shown);
        };
        let out = self.open().map_err(|e| WriteError { name: self.shown.clone(), kind: e.into() })?;
        if self.temporary.is_none() {
            return Ok(write::write_to(out, format, mesh, lattice).map_err(named)?);
        }
        let written = write::write_with_files(out, &self.target, format, mesh, lattice).map_err(named)?;
        let folder = self.target.parent().unwrap_or(Path::new(""));
        for (name, bytes) in &written.files {
            let file = Output::create(&folder.join(name))?;
            file.write(|out| out.write_all(bytes))?;
            self.beside.push(file);
        }
        Ok(written.warnings)
    }

    /// Put the file in its place, once its bytes are on the disk; before it what belongs beside it.
    pub fn commit(mut self) -> Result<()> {
        let mut new: Vec<PathBuf> = Vec::new();
        let placed = std::mem::take(&mut self.beside).into_iter().try_for_each(|file| {
            let path = Some(file.target.clone()).filter(|path| !path.exists());
            file.place()?;
            new.extend(path);
            Ok(())
        });
        let placed = placed.and_then(|()| self.place());
        if placed.is_err() {
            // There is an error to report already.
            new.iter().for_each(|path| drop(fs::remove_file(path)));
        }
        placed
    }

    fn place(mut self) -> Result<()> {
        let Some(temporary) = self.temporary.take() else { return Ok(()) };
        let mut files = temporary_files();
        let place = || {
            File::options().write(true).open(&temporary)?.sync_all()?;
            fs::rename(&temporary, &self.target)
        };
        let placed = place().with_context(|| format!("{}: cannot be written", self.shown));
        if placed.is_err() {
            // There is an error to report already.
            let _ = fs::remove_file(&temporary);
        }
        files.retain(|file| *file != temporary);
        placed
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Some(temporary) = self.temporary.take() {
            let mut files = temporary_files();
            // Best effort: there is an error to report already.
            let _ = fs::remove_file(&temporary);
            files.retain(|file| *file != temporary);
        }
    }
}
