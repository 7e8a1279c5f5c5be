//! Outputs that appear whole or not at all, and the debris of runs that were killed.
//!
//! A local output is written under another name in [`STAGING`] of the destination's folder, synced, renamed, and its folder
//! synced. The writer holds a lock (`flock`) on the file for as long as it is there. So whoever gets the lock of a file in
//! that folder knows that its writer is gone, and removes it: a run cleans up after those before it and cannot harm one
//! beside it, nor can process numbers that come again mislead it. An object in a store appears when its upload is complete.

use super::error::Failure;
use super::location::Object;
use super::stamp::Stamp;
use crate::format::container::{FileIndex, Parsed};
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The folder for files on their way, inside the destination.
pub(super) const STAGING: &str = ".lodestream-staging";

/// The files on their way in this process, for the moment before a signal ends it.
static ON_THE_WAY: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

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
        let _ = file.parent().map(fs::remove_dir);
    }
    files
}

/// A folder of files on their way.
pub(super) struct Staging {
    folder: PathBuf,
    next: AtomicU64,
}

/// A file on its way: locked, and removed when dropped before [`Staged::commit`].
pub(super) struct Staged {
    path: PathBuf,
    pub file: File,
    done: bool,
}

impl Staging {
    /// The staging folder inside `parent`, cleared of what killed runs left. It is made when it is needed.
    pub fn new(parent: &Path) -> Self {
        let staging = Staging { folder: parent.join(STAGING), next: AtomicU64::new(0) };
        staging.clear();
        staging
    }

    /// Remove files whose writers are gone, and the folder if it is empty then.
    pub fn clear(&self) {
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        for entry in entries.flatten() {
            let path = entry.path();
            // Only regular files that can be locked are debris of ours; a failure here must not stop a run.
            if let Ok(file) = File::options().write(true).open(&path)
                && file.try_lock().is_ok()
            {
                let _ = fs::remove_file(&path);
            }
        }
        let _ = fs::remove_dir(&self.folder);
    }

    /// A new file, locked.
    pub fn create(&self) -> io::Result<Staged> {
        for _ in 0..1000 {
            let n = self.next.fetch_add(1, Ordering::Relaxed);
            let path = self.folder.join(format!("{}-{n}.part", std::process::id()));
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
                Ok(()) => on_the_way().push(path.clone()),
                // Somebody takes it for debris at this moment.
                Err(TryLockError::WouldBlock) => continue,
                // A file system without locks: nothing is taken for debris there either.
                Err(TryLockError::Error(_)) => return Ok(Staged { path, file, done: false }),
            }
            // Between making and locking it, another run may have removed it as debris.
            if same_file(&file, &path) {
                return Ok(Staged { path, file, done: false });
            }
            on_the_way().retain(|p| *p != path);
        }
        Err(io::Error::other("the staging folder keeps changing"))
    }
}

impl std::ops::Drop for Staging {
    fn drop(&mut self) {
        // Fails while anything is in it, which is right.
        let _ = fs::remove_dir(&self.folder);
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

impl Staged {
    /// Put the file in its place: synced, renamed, the folder synced.
    pub fn commit(mut self, target: &Path) -> io::Result<()> {
        self.file.flush()?;
        self.file.sync_all()?;
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
            // Best effort: there is an error to report already.
            let _ = fs::remove_file(&self.path);
            on_the_way().retain(|p| *p != self.path);
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
                staged.commit(path)
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
            let Ok(mut file) = File::open(path) else { return Ok(None) };
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
        let staging = Staging::new(folder.path());
        let held = staging.create().unwrap();
        fs::write(folder.path().join(STAGING).join("123-4.part"), b"left by a killed run").unwrap();
        let other = Staging::new(folder.path());
        let left: Vec<_> = fs::read_dir(folder.path().join(STAGING)).unwrap().flatten().map(|e| e.path()).collect();
        assert_eq!(left, std::slice::from_ref(&held.path));
        held.commit(&folder.path().join("a/b/out.lods")).unwrap();
        other.create().unwrap();
        drop((staging, other));
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
        assert_eq!(names, ["a"], "the staging folder goes with the last run");
    }
}
