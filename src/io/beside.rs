//! Where the files are that a mesh file names: material libraries, images, buffers.
//!
//! One rule for all of them. A name is followed as it stands, relative to the folder of the mesh file; then with `\`
//! read as `/`; then by the last part of its path alone, since programs write the absolute paths of the machines they
//! ran on; then with percent signs decoded, and without regard to case. What is found counts only if it is a regular
//! file whose real path, all links followed, lies in the folder of the mesh file or in the root that the caller names:
//! a mesh from elsewhere must neither carry away files of the machine nor stop a run at a pipe.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use super::{files, name};

/// The folder of a mesh file, and what may be found from there.
pub(crate) struct Folder {
    base: PathBuf,
    /// All links followed; `None` where it is not there.
    root: Option<PathBuf>,
    /// The folders listed for this mesh: each once, however many names are not found.
    listed: RefCell<BTreeMap<PathBuf, Arc<Names>>>,
}

impl Folder {
    /// `root`: what may be found lies in it; without one, in `base`.
    pub fn new(base: &Path, root: Option<&Path>) -> Self {
        let root = fs::canonicalize(root.unwrap_or(base)).ok();
        Folder { base: base.to_path_buf(), root, listed: RefCell::default() }
    }

    /// The real path of the file that a mesh means by a name.
    pub fn find(&self, name: &str) -> Option<PathBuf> {
        if name.is_empty() || name.contains('\0') {
            return None;
        }
        let plain = percent_decode(name).filter(|plain| plain != name);
        self.as_spelled(name).or_else(|| self.as_spelled(&plain?))
    }

    fn as_spelled(&self, name: &str) -> Option<PathBuf> {
        let slashes = name.replace('\\', "/");
        let last = slashes.rsplit('/').next().unwrap_or_default();
        let candidates = [name, &slashes, last].map(|name| self.base.join(name::to_os(name)));
        candidates.iter().find_map(|path| self.inside(path)).or_else(|| {
            candidates[1..].iter().find_map(|path| {
                let folder = fs::canonicalize(path.parent()?).ok().filter(|folder| self.contains(folder))?;
                let names = self.names(&folder)?;
                let alike = names.get(&path.file_name()?.to_string_lossy().to_lowercase())?;
                alike.iter().find_map(|name| self.inside(&folder.join(name)))
            })
        })
    }

    fn contains(&self, real: &Path) -> bool {
        self.root.as_ref().is_some_and(|root| real.starts_with(root))
    }

    /// The real path of a regular file in the root.
    fn inside(&self, path: &Path) -> Option<PathBuf> {
        let regular = fs::metadata(path).is_ok_and(|meta| meta.is_file());
        let real = regular.then(|| fs::canonicalize(path).ok()).flatten()?;
        self.contains(&real).then_some(real)
    }

    fn names(&self, folder: &Path) -> Option<Arc<Names>> {
        if let Some(names) = self.listed.borrow().get(folder) {
            return Some(names.clone());
        }
        let names = list(folder)?;
        self.listed.borrow_mut().insert(folder.to_path_buf(), names.clone());
        Some(names)
    }
}

/// Names in a folder by their spelling in small letters, each list sorted.
type Names = BTreeMap<String, Vec<OsString>>;

/// A folder as it was.
struct Listing {
    folder: PathBuf,
    changed: SystemTime,
    names: Arc<Names>,
}

/// The folders listed last. Thousands of meshes of one folder may each name a file that is not there.
static LISTINGS: Mutex<Vec<Listing>> = Mutex::new(Vec::new());

/// How many folders are remembered.
const REMEMBERED: usize = 8;

/// The clock of a file system may stand still for so long.
const TICK: Duration = Duration::from_secs(2);

fn list(folder: &Path) -> Option<Arc<Names>> {
    let changed = fs::metadata(folder).and_then(|meta| meta.modified()).ok()?;
    // What panicked elsewhere has left a list of folders that is as good as before.
    let lock = || LISTINGS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = lock().iter().find(|l| l.folder == folder && l.changed == changed) {
        return Some(known.names.clone());
    }
    let mut names = Names::new();
    for entry in fs::read_dir(folder).ok()?.filter_map(Result::ok) {
        let name = entry.file_name();
        names.entry(name.to_string_lossy().to_lowercase()).or_default().push(name);
    }
    names.values_mut().for_each(|alike| alike.sort());
    let names = Arc::new(names);
    // A folder that has changed just now may change again without showing it.
    if SystemTime::now().duration_since(changed).is_ok_and(|age| age > TICK) {
        let mut listings = lock();
        listings.retain(|l| l.folder != folder);
        if listings.len() >= REMEMBERED {
            listings.remove(0);
        }
        listings.push(Listing { folder: folder.to_path_buf(), changed, names: names.clone() });
    }
    Some(names)
}

/// Open a file for reading that is a regular one: a pipe would wait for a writer, a device might never end.
///
/// # Errors
/// Those of the system; `InvalidInput` for what is no regular file.
pub(crate) fn open_regular(path: &Path) -> io::Result<(File, u64)> {
    files::open_regular(path).map(|(file, meta)| (file, meta.len()))
}

/// The bytes of a regular file, no more than it has when it is opened.
///
/// # Errors
/// Those of [`open_regular`] and of reading.
pub(crate) fn read_regular(path: &Path, out: &mut Vec<u8>) -> io::Result<()> {
    let (file, size) = open_regular(path)?;
    file.take(size).read_to_end(out).map(|_| ())
}

/// A reference as a path.
pub(crate) fn percent_decode(uri: &str) -> Option<String> {
    let mut out = Vec::with_capacity(uri.len());
    let mut bytes = uri.bytes();
    while let Some(byte) = bytes.next() {
        out.push(if byte == b'%' {
            let digit = |b: u8| char::from(b).to_digit(16);
            let (high, low) = (digit(bytes.next()?)?, digit(bytes.next()?)?);
            (16 * high + low) as u8
        } else {
            byte
        });
    }
    String::from_utf8(out).ok().filter(|s| !s.contains('\0'))
}
