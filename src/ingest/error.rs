//! What can go wrong with one file, which costs only that file, and with a run as a whole.

use serde::Serialize;
use std::fmt;
use std::io;
use thiserror::Error;

/// Why a file was not done, in the kinds that the final table counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum FailureKind {
    /// The source is not there.
    Missing,
    /// The system or the store refuses to read it.
    Permission,
    /// Its name cannot be used, or two sources would have one output.
    Name,
    /// The bytes are not a mesh: damaged, cut, unsupported, of another format.
    Input,
    /// It needs more memory than the run may take.
    Memory,
    /// The mesh does not fit the lattice or the format.
    Encode,
    /// The output does not decode to the source.
    Verify,
    /// The output cannot be written.
    Write,
    /// An object store failed, for reading or writing, after all retries.
    Store,
    /// A panic or an inconsistency: a defect of this program.
    Bug,
}

impl FailureKind {
    /// The word for it in tables and reports.
    pub fn name(self) -> &'static str {
        match self {
            FailureKind::Missing => "missing",
            FailureKind::Permission => "permission",
            FailureKind::Name => "name",
            FailureKind::Input => "input",
            FailureKind::Memory => "memory",
            FailureKind::Encode => "encode",
            FailureKind::Verify => "verify",
            FailureKind::Write => "write",
            FailureKind::Store => "store",
            FailureKind::Bug => "bug",
        }
    }
}

impl fmt::Display for FailureKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why a file was not done: one line that names the file and, where known, the line or byte.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{message}")]
pub struct Failure {
    /// Its kind.
    pub kind: FailureKind,
    /// The line for people.
    pub message: String,
}

impl Failure {
    /// A failure of that kind; line breaks in the message become spaces.
    pub fn new(kind: FailureKind, message: impl Into<String>) -> Self {
        let message: String = message.into();
        let message = message.split_whitespace().collect::<Vec<_>>().join(" ");
        Failure { kind, message }
    }

    /// A local file that cannot be read.
    pub(super) fn reading(name: &str, error: &io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => {
                Self::new(FailureKind::Missing, format!("{name}: there is no such file; check the path"))
            }
            io::ErrorKind::PermissionDenied => Self::new(
                FailureKind::Permission,
                format!("{name}: no permission to read it; check the owner and mode of the file"),
            ),
            io::ErrorKind::IsADirectory => {
                Self::new(FailureKind::Input, format!("{name}: this is a folder; name a mesh file"))
            }
            _ => Self::new(FailureKind::Input, format!("{name}: cannot be read: {error}")),
        }
    }

    /// A local output that cannot be written.
    pub(super) fn writing(name: &str, error: &io::Error) -> Self {
        let advice = match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "; make room and run again with --resume",
            io::ErrorKind::PermissionDenied => "; check the owner and mode of its folder",
            _ => "",
        };
        Self::new(FailureKind::Write, format!("{name}: cannot be written: {error}{advice}"))
    }
}

/// Why a run did not start, or ended without its account.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IngestError {
    /// The plan makes no sense as it stands; nothing was started.
    #[error("{0}")]
    Usage(String),
    /// The manifest has errors, one line each with the line number; nothing was started.
    #[error("{}", .0.join("; "))]
    Manifest(Vec<String>),
    /// A source, the destination or the report cannot be used at all.
    #[error("{0}")]
    Setup(String),
}
