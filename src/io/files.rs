//! Files as what they are: which paths mean one file, and which may be opened without waiting for somebody else.
//!
//! Invariants: nothing but a regular file is opened ([`open_regular`]), so that a pipe without a writer stops nobody and
//! a device is never read; two paths have one [`Identity`] exactly if what is written to one is read from the other.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Metadata};
use std::io;
use std::path::Path;
#[cfg(not(unix))]
use std::path::PathBuf;

/// What makes a file that is there the one that it is: device and inode on Unix, the canonical path elsewhere.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Identity(Inner);

#[cfg(unix)]
type Inner = (u64, u64);
#[cfg(not(unix))]
type Inner = PathBuf;

impl Identity {
    /// The identity of the file or folder at `path`, through links; `None` where nothing is there.
    pub fn of(path: &Path) -> Option<Self> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let meta = fs::metadata(path).ok()?;
            Some(Identity((meta.dev(), meta.ino())))
        }
        #[cfg(not(unix))]
        {
            fs::canonicalize(path).ok().map(Identity)
        }
    }
}

/// Where a file is or will be: equal for two paths that mean one file, also one that is still to be made.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Place {
    /// The file is there.
    There(Identity),
    /// It is not: its folder, and its name without regard to case, since some disks have none.
    New(Option<Identity>, OsString),
}

impl Place {
    /// The place that `path` means.
    pub fn of(path: &Path) -> Self {
        if let Some(identity) = Identity::of(path) {
            return Place::There(identity);
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = path.file_name().unwrap_or_default();
        Place::New(Identity::of(folder), name.to_str().map_or(name.to_os_string(), |n| n.to_lowercase().into()))
    }
}

/// Open a file for reading if it is a regular one.
///
/// # Errors
/// Those of the system; [`io::ErrorKind::IsADirectory`] for a folder, [`io::ErrorKind::InvalidInput`] with a line for
/// people for pipes, devices and sockets.
pub fn open_regular(path: &Path) -> io::Result<(File, Metadata)> {
    open_with(path, File::options().read(true))
}

/// The same with other options, as for writing.
///
/// # Errors
/// As [`open_regular`].
pub fn open_with(path: &Path, options: &mut fs::OpenOptions) -> io::Result<(File, Metadata)> {
    // To open a device may do something already.
    regular(&fs::metadata(path)?)?;
    #[cfg(unix)]
    {
        // Should it have become a pipe meanwhile.
        std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NONBLOCK);
    }
    let file = options.open(path)?;
    let meta = file.metadata()?;
    regular(&meta)?;
    Ok((file, meta))
}

/// All bytes of a regular file of the size that its folder says: files that are never at an end (some of `/proc`) are an
/// error, and so is one that grows meanwhile.
///
/// # Errors
/// As [`open_regular`]; [`io::ErrorKind::OutOfMemory`] where it does not fit.
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let (file, meta) = open_regular(path)?;
    let mut bytes = Vec::new();
    // One byte more, or the last read would double the buffer to find the end.
    bytes.try_reserve_exact(usize::try_from(meta.len()).unwrap_or(usize::MAX).saturating_add(1))?;
    io::Read::read_to_end(&mut io::Read::take(&file, meta.len().saturating_add(1)), &mut bytes)?;
    if bytes.len() as u64 > meta.len() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "it has more bytes than its size says"));
    }
    Ok(bytes)
}

/// # Errors
/// As [`open_regular`].
fn regular(meta: &Metadata) -> io::Result<()> {
    if meta.is_file() {
        return Ok(());
    }
    if meta.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    let what = format!("this is {}, not a regular file", kind_of(meta));
    Err(io::Error::new(io::ErrorKind::InvalidInput, what))
}

/// What it is that is no regular file, in words.
pub fn kind_of(meta: &Metadata) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let kind = meta.file_type();
        if kind.is_fifo() {
            return "a pipe";
        }
        if kind.is_socket() {
            return "a socket";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
    }
    if meta.is_dir() { "a folder" } else { "something else" }
}

/// Whether `path` names a file descriptor that the process has been given, as `<(…)` of a shell does: whoever gave it
/// holds its other end.
pub fn is_descriptor(path: &Path) -> bool {
    let under = ["/dev/fd", "/proc/self/fd"].iter().any(|folder| path.parent() == Some(Path::new(folder)));
    under || [OsStr::new("/dev/stdin"), OsStr::new("/dev/stdout")].contains(&path.as_os_str())
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn links_mean_the_file_that_they_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a"), b"abc").unwrap();
        fs::write(at("b"), b"abc").unwrap();
        std::os::unix::fs::symlink("a", at("soft")).unwrap();
        fs::hard_link(at("a"), at("hard")).unwrap();
        std::os::unix::fs::symlink(".", at("same")).unwrap();
        for alike in ["soft", "hard", "./a", "same/a"] {
            assert_eq!(Place::of(&at(alike)), Place::of(&at("a")), "{alike}");
        }
        assert_ne!(Place::of(&at("b")), Place::of(&at("a")));
        assert_eq!(Place::of(&at("same/New")), Place::of(&at("new")));
        assert_ne!(Place::of(&at("new")), Place::of(&at("other")));
        assert_eq!(read_regular(&at("soft")).unwrap(), b"abc");
    }

    #[test]
    fn nothing_but_a_regular_file_is_opened() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let said = |path: &Path| open_regular(path).unwrap_err().to_string();
        assert_eq!(said(&pipe), "this is a pipe, not a regular file");
        assert_eq!(said(Path::new("/dev/zero")), "this is a device, not a regular file");
        assert_eq!(open_regular(folder.path()).unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert_eq!(open_regular(&folder.path().join("gone")).unwrap_err().kind(), io::ErrorKind::NotFound);
        if Path::new("/proc/self/status").exists() {
            assert_eq!(
                read_regular(Path::new("/proc/self/status")).unwrap_err().to_string(),
                "it has more bytes than its size says"
            );
        }
    }
}
