//! Output files that appear whole or not at all: written beside their place under another name, then renamed.

use anyhow::{Context, Result, bail};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file on its way. Dropped before [`commit`](Output::commit) it leaves nothing behind.
pub struct Output {
    target: PathBuf,
    /// Where the bytes go until then; `None` writes in place (a device or pipe, which a rename would replace).
    temporary: Option<PathBuf>,
    committed: bool,
}

impl Output {
    /// See now, before any work, that `path` can be written.
    pub fn check(path: &Path) -> Result<()> {
        Self::create(path).map(drop)
    }

    /// Prepare to write `path`, and see now, before any work, that it can be written.
    pub fn create(path: &Path) -> Result<Self> {
        let shown = path.display();
        if path.as_os_str().is_empty() || path.as_os_str() == "-" {
            bail!("the output has to be a file; name it with -o");
        }
        // A link's target is replaced, not the link.
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        match fs::metadata(&target) {
            Ok(meta) if meta.is_dir() => bail!("{shown}: this is a folder; name a file in it"),
            Ok(meta) if !meta.is_file() => return Ok(Output { target, temporary: None, committed: false }),
            _ => {}
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("{shown}: the folder {} is not there; make it first", folder.display());
        }
        let Some(file_name) = target.file_name().map(|n| n.to_string_lossy().into_owned()) else {
            bail!("{shown}: this is no name for a file");
        };
        // The extension stays last, for writers that go by it. Only a new file will do: never one, or a link, of others.
        for attempt in 0..100 {
            let temporary = folder.join(format!(".lodestream-{}-{attempt}-{file_name}", std::process::id()));
            match File::create_new(&temporary) {
                Ok(_) => return Ok(Output { target, temporary: Some(temporary), committed: false }),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e).with_context(|| format!("{shown}: cannot be written")),
            }
        }
        bail!("{shown}: cannot be written: the folder is full of temporary files .lodestream-*; remove them")
    }

    /// Where to write until [`commit`](Output::commit).
    pub fn path(&self) -> &Path {
        self.temporary.as_deref().unwrap_or(&self.target)
    }

    /// Write all of it with one function.
    pub fn write(&self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
        let write = || {
            let mut out = BufWriter::with_capacity(1 << 16, File::options().write(true).open(self.path())?);
            fill(&mut out)?;
            out.flush()
        };
        write().with_context(|| format!("{}: cannot be written", self.target.display()))
    }

    /// Put the file in its place.
    pub fn commit(mut self) -> Result<()> {
        if let Some(temporary) = &self.temporary {
            fs::rename(temporary, &self.target)
                .with_context(|| format!("{}: cannot be written", self.target.display()))?;
        }
        self.committed = true;
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let (false, Some(temporary)) = (self.committed, &self.temporary) {
            // Best effort: there is an error to report already.
            let _ = fs::remove_file(temporary);
        }
    }
}
