//! Output files that appear whole or not at all: written beside their place under another name, then renamed. That name goes away
//! with whatever ends the program early, an error or Ctrl-C.
//!
//! Invariants: no output replaces an input of its command, or another output of it ([`Outputs`]); nothing is replaced that is
//! protected against writing; what is no regular file is written to only where that cannot block or do harm.

use crate::shared;
use anyhow::{Context, Result, bail};
use lodestream::ingest;
use lodestream::io::files::{self, Identity, Place};
use lodestream::io::read::Format;
use lodestream::io::write::{self, WriteError, WriteWarning};
use lodestream::mesh::Mesh;
use lodestream::mesh::lattice::Lattice;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

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

/// The outputs of one command, which know its inputs.
pub struct Outputs {
    inputs: Arc<Inputs>,
    places: Vec<(Place, String)>,
}

/// What a command reads.
pub struct Inputs {
    files: Vec<(PathBuf, Option<Format>)>,
    /// The files themselves, by their names for people.
    identities: Vec<(Identity, String)>,
    /// What the files name: libraries, images, buffers. Looked for only where an output is about to replace something.
    named: OnceLock<Vec<Identity>>,
    /// The folder in which they lie, where it is not that of an input.
    root: Option<PathBuf>,
}

impl Inputs {
    /// Refuse to write to `path`, where that is one of the inputs or what they name.
    fn check(&self, path: &Path, shown: &str) -> Result<()> {
        let Some(identity) = Identity::of(path) else { return Ok(()) };
        if let Some((_, input)) = self.identities.iter().find(|(i, _)| *i == identity) {
            let same = if input == shown { "an input".to_string() } else { format!("the input {input}") };
            bail!("{shown}: this is {same} of the command, which writing would destroy; choose another name");
        }
        let named = || {
            let of = |(path, format): &(PathBuf, _)| ingest::named_files(path, *format, self.root.as_deref());
            self.files.iter().flat_map(of).filter_map(|file| Identity::of(&file)).collect()
        };
        if self.named.get_or_init(named).contains(&identity) {
            bail!("{shown}: an input of the command names this file, which writing would destroy; choose another name");
        }
        Ok(())
    }
}

impl Outputs {
    /// The outputs of a command that reads these files, each of the format that is said or that its name tells; `-` stands
    /// for standard input.
    pub fn of<'a>(inputs: impl IntoIterator<Item = (&'a Path, Option<Format>)>) -> Self {
        Self::with_assets(inputs, None)
    }

    /// The same where the files that inputs name lie in the folder `root`.
    pub fn with_assets<'a>(inputs: impl IntoIterator<Item = (&'a Path, Option<Format>)>, root: Option<&Path>) -> Self {
        let files: Vec<(PathBuf, Option<Format>)> = inputs.into_iter().map(|(p, f)| (p.to_path_buf(), f)).collect();
        let identity = |path: &PathBuf| {
            // A file that the shell has opened is known by that.
            let path = if shared::is_dash(path) { Path::new("/dev/stdin") } else { path };
            fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
            Identity::of(path)
        };
        let identities = files.iter().filter_map(|(path, _)| Some((identity(path)?, shared::name(path)))).collect();
        let files = files.into_iter().filter(|(path, _)| !shared::is_dash(path)).collect();
        let root = root.map(Path::to_path_buf);
        let inputs = Arc::new(Inputs { files, identities, named: OnceLock::new(), root });
        Outputs { inputs, places: Vec::new() }
    }

    /// Prepare to write `path`, and see now, before any work, that it can be written.
    pub fn create(&mut self, path: &Path) -> Result<Output> {
        let shown = path.display().to_string();
        let place = Place::of(path);
        if is_file_or_new(path) {
            if let Some((_, other)) = self.places.iter().find(|(p, _)| *p == place) {
                bail!("{shown}: this is the output {other} too; give each a name of its own");
            }
            self.places.push((place, shown));
        }
        Output::create(path, self.inputs.clone())
    }

    /// Standard output as an output.
    pub fn standard(&self) -> Result<Output> {
        self.inputs.check(Path::new("/dev/stdout"), "standard output")?;
        Ok(Output {
            target: PathBuf::from("-"),
            shown: "standard output".to_string(),
            temporary: None,
            beside: Vec::new(),
            inputs: self.inputs.clone(),
        })
    }
}

/// Whether something may be replaced or made at `path`; devices are only written to.
fn is_file_or_new(path: &Path) -> bool {
    fs::metadata(path).map_or(true, |meta| meta.is_file())
}

/// A file on its way. Dropped before [`commit`](Output::commit) it leaves nothing behind.
pub struct Output {
    target: PathBuf,
    /// The target as the user wrote it.
    shown: String,
    /// Where the bytes go until then; `None` writes in place (standard output, or a device, which a rename would replace).
    temporary: Option<PathBuf>,
    /// Files of materials and images that get their places first.
    beside: Vec<Output>,
    inputs: Arc<Inputs>,
}

impl Output {
    fn create(path: &Path, inputs: Arc<Inputs>) -> Result<Self> {
        let shown = path.display().to_string();
        if path.as_os_str().is_empty() || shared::is_dash(path) {
            bail!("the output has to be a file; name it with -o");
        }
        // A link's target is replaced, not the link.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        match fs::metadata(&target) {
            Ok(meta) if meta.is_dir() => bail!("{shown}: this is a folder; name a file in it"),
            Ok(meta) if !meta.is_file() => {
                if !files::is_descriptor(path) && !is_plain_device(&meta) {
                    let what = files::kind_of(&meta);
                    bail!(
                        "{shown}: this is {what}, not a regular file; choose another name, or -o - where a pipe is meant"
                    )
                }
                let target = if files::is_descriptor(path) { path.to_path_buf() } else { target };
                return Ok(Output { target, shown, temporary: None, beside: Vec::new(), inputs });
            }
            Ok(meta) => {
                inputs.check(&target, &shown)?;
                if meta.permissions().readonly() || is_forbidden(&target) {
                    bail!("{shown}: this file is write-protected; choose another name or change its mode")
                }
            }
            Err(_) => {}
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("{shown}: the folder {} is not there; make it first", folder.display());
        }
        let Some(name) = target.file_name() else {
            bail!("{shown}: this is no name for a file");
        };
        // The temporary name is short, whatever the other: that one is tried by itself.
        if let Err(e) = fs::symlink_metadata(folder.join(name))
            && e.kind() != io::ErrorKind::NotFound
        {
            return Err(e).with_context(|| format!("{shown}: cannot be written"));
        }
        let mut files = temporary_files();
        // Only a new file will do: never one, or a link, of others.
        for attempt in 0..100 {
            let temporary = folder.join(format!(".lodestream-{}-{attempt}.part", std::process::id()));
            match File::create_new(&temporary) {
                Ok(_) => {
                    files.push(temporary.clone());
                    return Ok(Output { target, shown, temporary: Some(temporary), beside: Vec::new(), inputs });
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
    fn open(&self) -> io::Result<Box<dyn Write>> {
        if self.temporary.is_none() && shared::is_dash(&self.target) {
            return Ok(Box::new(BufWriter::with_capacity(1 << 16, io::stdout().lock())));
        }
        let path = self.temporary.as_deref().unwrap_or(&self.target);
        Ok(Box::new(BufWriter::with_capacity(1 << 16, File::options().write(true).open(path)?)))
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

    /// Write a mesh, and what belongs beside it; see [`write::write_with_files`].
    pub fn write_mesh(&mut self, format: Format, mesh: &Mesh, lattice: Option<&Lattice>) -> Result<Vec<WriteWarning>> {
        let named = |error: WriteError| WriteError { name: self.shown.clone(), ..error };
        let out = self.open().map_err(|e| WriteError { name: self.shown.clone(), kind: e.into() })?;
        if self.temporary.is_none() {
            return Ok(write::write_to(out, format, mesh, lattice).map_err(named)?);
        }
        let written = write::write_with_files(out, &self.target, format, mesh, lattice).map_err(named)?;
        let folder = self.target.parent().unwrap_or(Path::new(""));
        for (name, bytes) in &written.files {
            let path = folder.join(name);
            // What is there already needs no writing, and may be protected against it.
            if path.is_file() && fs::read(&path).is_ok_and(|there| there == **bytes) {
                continue;
            }
            let file = Output::create(&path, self.inputs.clone())?;
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

/// A device that takes bytes one after another, as `/dev/null` does; a disk is none.
fn is_plain_device(meta: &fs::Metadata) -> bool {
    #[cfg(unix)]
    {
        std::os::unix::fs::FileTypeExt::is_char_device(&meta.file_type())
    }
    #[cfg(not(unix))]
    {
        let _ = meta;
        false
    }
}

/// Whether the system lets nobody like us write to the file.
fn is_forbidden(target: &Path) -> bool {
    files::open_with(target, File::options().write(true)).is_err_and(|e| e.kind() == io::ErrorKind::PermissionDenied)
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
