//! Outputs that appear whole or not at all, and the debris of runs that were killed.
//!
//! A local output is written under another name in [`STAGING`] of the destination's folder, synced, renamed, and its folder
//! synced. The writer holds a lock (`flock`) on the file for as long as it is there. So whoever gets the lock of a file in
//! that folder knows that its writer is gone, and removes it: a run cleans up after those before it and cannot harm one
//! beside it, nor can process numbers that come again mislead it. Nothing is removed there but regular files of names that
//! this program gives, and a link in the place of that folder is an error: files of others are none of ours. An object in a store appears when its upload is complete.

use super::error::{Failure, FailureKind};
use super::location::{Object, STAGING};
use super::stamp::Stamp;
use crate::format::container::{FileIndex, Parsed};
use crate::io::files::{self, Place, open_regular, open_with};
use std::collections::HashSet;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The files on their way in this process, for the moment before a signal ends it. Whoever makes, renames or removes one
/// holds the lock meanwhile, so that none escapes [`abandon`].
static ON_THE_WAY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The staging folders of this process, made or not, for the same moment.
static STAGINGS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// The temporary folders of this process, for the same moment.
static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn on_the_way() -> MutexGuard<'static, Vec<PathBuf>> {
    ON_THE_WAY.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Remove all files on their way, and let none be put in its place until the process is gone: for the moment before a
/// signal ends it. A process that is killed without that leaves debris, which the next run removes.
pub fn abandon() -> MutexGuard<'static, Vec<PathBuf>> {
    let files = on_the_way();
    for file in files.iter() {
        // Best effort: there is nobody left to do better.
        let _ = fs::remove_file(file);
    }
    for folder in STAGINGS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        // Fails while files of another run are in it, which is right.
        let _ = fs::remove_dir(folder);
    }
    for folder in FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        let _ = fs::remove_dir_all(folder);
    }
    files
}

/// A temporary folder that goes when it is dropped, and when a signal ends the program.
pub(super) struct TempFolder(tempfile::TempDir);

impl TempFolder {
    pub fn new() -> io::Result<Self> {
        let mut folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir()?;
        folders.push(folder.path().to_path_buf());
        Ok(TempFolder(folder))
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

impl std::ops::Drop for TempFolder {
    fn drop(&mut self) {
        FOLDERS.lock().unwrap_or_else(PoisonError::into_inner).retain(|folder| folder != self.0.path());
    }
}

/// See before any work whether `target` may be made or replaced: not if it is one of `reserved`, which are named beside;
/// not if it is protected, a folder, a pipe or a device.
pub(super) fn may_write(target: &Object, reserved: &[(Place, &str)]) -> Result<(), Failure> {
    let Object::Local(path) = target else { return Ok(()) };
    let name = target.name();
    let place = Place::of(path);
    if let Some((_, what)) = reserved.iter().find(|(other, _)| *other == place) {
        let what = format!("{name}: this output is {what}, which writing would destroy; choose another name");
        return Err(Failure::new(FailureKind::Name, what));
    }
    let Ok(meta) = fs::metadata(path) else { return Ok(()) };
    let wrong = |what: String| Err(Failure::new(FailureKind::Write, format!("{name}: {what}")));
    if !meta.is_file() {
        return wrong(format!("there is {} of that name; choose another", files::kind_of(&meta)));
    }
    if meta.permissions().readonly() {
        return wrong("this file is write-protected; choose another name or change its mode".to_string());
    }
    Ok(())
}

/// A folder of files on their way.
pub(super) struct Staging {
    folder: PathBuf,
    next: AtomicU64,
    /// The outputs that this run has put in their places.
    written: Mutex<HashSet<PathBuf>>,
}

/// A file on its way: locked, and removed when dropped before [`Staged::commit`].
pub(super) struct Staged {
    path: PathBuf,
    pub file: File,
    done: bool,
}

impl Staging {
    /// The staging folder inside `parent`, cleared of what killed runs left. It is made when it is needed.
    ///
    /// # Errors
    /// Where a link or a file has the name of the staging folder.
    pub fn new(parent: &Path) -> io::Result<Self> {
        let staging = Staging { folder: parent.join(STAGING), next: AtomicU64::new(0), written: Mutex::default() };
        staging.is_ours()?;
        STAGINGS.lock().unwrap_or_else(PoisonError::into_inner).push(staging.folder.clone());
        staging.clear();
        Ok(staging)
    }

    /// What lies behind a link belongs to others.
    fn is_ours(&self) -> io::Result<()> {
        match fs::symlink_metadata(&self.folder) {
            Ok(meta) if !meta.is_dir() => {
                let what = if meta.is_symlink() { "a link" } else { files::kind_of(&meta) };
                let folder = self.folder.display();
                Err(io::Error::other(format!("{folder} is {what}, not a folder of this program; remove it")))
            }
            _ => Ok(()),
        }
    }

    /// Remove files of ours whose writers are gone, and the folder if it is empty then.
    pub fn clear(&self) {
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        for entry in entries.flatten() {
            // A type of its own: a link to a file is no file.
            if !is_own_name(&entry.file_name()) || !entry.file_type().is_ok_and(|t| t.is_file()) {
                continue;
            }
            let path = entry.path();
            // Only files that can be locked are debris; a failure here must not stop a run.
            if let Ok((file, _)) = open_with(&path, File::options().write(true))
                && file.try_lock().is_ok()
            {
                let _ = fs::remove_file(&path);
            }
        }
        let _ = fs::remove_dir(&self.folder);
    }

    /// A new file, locked.
    pub fn create(&self) -> io::Result<Staged> {
        // Held until the file is in the list: a signal finds all that there are.
        let mut files = on_the_way();
        for _ in 0..1000 {
            let n = self.next.fetch_add(1, Ordering::Relaxed);
            let path = self.folder.join(format!("{}-{n}.part", std::process::id()));
            self.is_ours()?;
            let file = match File::options().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => file,
                Err(e) if e.kind() == io::ErrorKind::NotFound => match fs::create_dir(&self.folder) {
                    Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(e),
                    _ => continue,
                },
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(e) => return Err(e),
            };
            match file.try_lock() {
                // Between making and locking it, another run may have removed it as debris.
                Ok(()) if !same_file(&file, &path) => continue,
                // Somebody takes it for debris at this moment.
                Err(TryLockError::WouldBlock) => continue,
                // On a file system without locks nothing is taken for debris either.
                Ok(()) | Err(TryLockError::Error(_)) => {
                    files.push(path.clone());
                    return Ok(Staged { path, file, done: false });
                }
            }
        }
        Err(io::Error::other("the staging folder keeps changing"))
    }
}

impl std::ops::Drop for Staging {
    fn drop(&mut self) {
        // Fails while anything is in it, which is right.
        let _ = fs::remove_dir(&self.folder);
        let mut folders = STAGINGS.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = folders.iter().position(|folder| *folder == self.folder) {
            folders.swap_remove(at);
        }
    }
}

#[cfg(unix)]
fn same_file(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

#[cfg(not(unix))]
fn same_file(_: &File, path: &Path) -> bool {
    path.exists()
}

/// Whether a file in the staging folder has a name that [`Staging::create`] gives.
fn is_own_name(name: &std::ffi::OsStr) -> bool {
    let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let parts = name.to_str().and_then(|name| name.strip_suffix(".part")?.split_once('-'));
    parts.is_some_and(|(process, n)| number(process) && number(n))
}

impl Staged {
    /// Put the file in its place: synced, renamed, the folder synced.
    pub fn commit(self, target: &Path) -> io::Result<()> {
        self.place(target, &Mutex::default())
    }

    /// The same for one of many outputs, none of which may take the place of another.
    fn place(mut self, target: &Path, written: &Mutex<HashSet<PathBuf>>) -> io::Result<()> {
        self.file.flush()?;
        self.file.sync_all()?;
        let mut written = written.lock().unwrap_or_else(PoisonError::into_inner);
        // Names that differ may mean one file: through links, or on disks that do not know upper from lower case.
        // By their real paths: another run may replace a file meanwhile, and the system gives its number to the next.
        if fs::canonicalize(target).is_ok_and(|there| written.contains(&there)) {
            return Err(io::Error::other(
                "it is the output of another source of this run too; name outputs in a manifest",
            ));
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut files = on_the_way();
        match fs::rename(&self.path, target) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                fs::create_dir_all(folder)?;
                fs::rename(&self.path, target)?;
            }
            other => other?,
        }
        self.done = true;
        files.retain(|p| *p != self.path);
        drop(files);
        written.extend(fs::canonicalize(target));
        drop(written);
        // A file system that cannot sync folders has done what it can.
        if let Ok(folder) = File::open(folder) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

impl std::ops::Drop for Staged {
    fn drop(&mut self) {
        if !self.done {
            let mut files = on_the_way();
            // Best effort: there is an error to report already.
            let _ = fs::remove_file(&self.path);
            files.retain(|p| *p != self.path);
        }
    }
}

/// Write a whole output.
pub(super) fn write(target: &Object, staging: Option<&Staging>, bytes: Vec<u8>) -> Result<(), Failure> {
    match (target, staging) {
        (Object::Local(path), Some(staging)) => {
            let work = || {
                let mut staged = staging.create()?;
                staged.file.write_all(&bytes)?;
                staged.place(path, &staging.written)
            };
            work().map_err(|e| Failure::writing(&target.name(), &e))
        }
        (Object::Local(_), None) => Err(Failure::writing(&target.name(), &io::Error::other("no staging folder"))),
        (Object::Stored(store, key), _) => store.put(key, bytes),
    }
}

/// The stamp of an output that is there and whole; `None` for anything else, which is then made anew.
pub(super) fn stamp_of(target: &Object) -> Result<Option<Stamp>, Failure> {
    match target {
        Object::Local(path) => {
            let Ok((mut file, _)) = open_regular(path) else { return Ok(None) };
            let Ok(size) = file.seek(SeekFrom::End(0)) else { return Ok(None) };
            find_stamp(size, |from, to| {
                let mut bytes = Vec::new();
                let read =
                    file.seek(SeekFrom::Start(from)).and_then(|_| (&file).take(to - from).read_to_end(&mut bytes));
                Ok(read.ok().map(|_| bytes))
            })
        }
        Object::Stored(store, key) => {
            let Some(meta) = store.head(key)? else { return Ok(None) };
            find_stamp(meta.size, |from, to| store.range(key, &meta, from..to).map(Some))
        }
    }
}

/// Find the stamp of a file of `size` bytes, of which `read` gives ranges.
fn find_stamp(
    size: u64,
    mut read: impl FnMut(u64, u64) -> Result<Option<Vec<u8>>, Failure>,
) -> Result<Option<Stamp>, Failure> {
    let mut need = 4096.min(size);
    let front = loop {
        let Some(bytes) = read(0, need)? else { return Ok(None) };
        match FileIndex::parse(&bytes) {
            Ok(Parsed::Ready(front)) => break front,
            Ok(Parsed::NeedBytes(more)) if more > need && more <= size => need = more,
            _ => return Ok(None),
        }
    };
    if front.check_length(size).is_err() {
        return Ok(None);
    }
    let Some((index, place)) = Stamp::place(&front) else { return Ok(None) };
    let Some(payload) = read(place.start, place.end)? else { return Ok(None) };
    let sound = front.chunks().get(index).is_some_and(|c| c.checksum == crc32fast::hash(&payload));
    Ok(if sound { Stamp::from_payload(&payload) } else { None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debris_goes_and_files_in_use_stay() {
        let folder = tempfile::tempdir().unwrap();
        let staging = Staging::new(folder.path()).unwrap();
        let held = staging.create().unwrap();
        fs::write(folder.path().join(STAGING).join("123-4.part"), b"left by a killed run").unwrap();
        let other = Staging::new(folder.path()).unwrap();
        let left: Vec<_> = fs::read_dir(folder.path().join(STAGING)).unwrap().flatten().map(|e| e.path()).collect();
        assert_eq!(left, std::slice::from_ref(&held.path));
        held.commit(&folder.path().join("a/b/out.lods")).unwrap();
        other.create().unwrap();
        drop((staging, other));
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
        assert_eq!(names, ["a"], "the staging folder goes with the last run");
    }

    #[test]
    fn names_of_others_are_not_ours() {
        for own in ["1-0.part", "40123-17.part"] {
            assert!(is_own_name(own.as_ref()), "{own}");
        }
        for other in ["report.json", "a-1.part", "1-.part", "-1.part", "1-2", "1-2-3.part", ".part", "1-2.part.obj"] {
            assert!(!is_own_name(other.as_ref()), "{other}");
        }
    }

    #[test]
    fn staging_is_seen_through_links_and_case() {
        let folder = tempfile::tempdir().unwrap();
        let staging = folder.path().join(STAGING);
        fs::create_dir(&staging).unwrap();
        use crate::ingest::location::is_staged;
        assert!(is_staged(&staging.join("x")) && is_staged(&staging) && is_staged(Path::new(".LODESTREAM-staging/x")));
        assert!(!is_staged(&folder.path().join("x")));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&staging, folder.path().join("link")).unwrap();
            assert!(is_staged(&folder.path().join("link")) && is_staged(&folder.path().join("link/x")));
            fs::write(staging.join("kept.obj"), b"").unwrap();
            let error = Staging::new(&folder.path().join("link")).map(drop);
            error.unwrap();
            fs::remove_dir_all(&staging).unwrap();
            fs::create_dir(folder.path().join("theirs")).unwrap();
            fs::write(folder.path().join("theirs/1-2.part"), b"").unwrap();
            std::os::unix::fs::symlink("theirs", &staging).unwrap();
            let error = Staging::new(folder.path()).map(drop).unwrap_err().to_string();
            assert!(
                error.ends_with(".lodestream-staging is a link, not a folder of this program; remove it"),
                "{error}"
            );
            assert!(folder.path().join("theirs/1-2.part").exists());
        }
    }
}
