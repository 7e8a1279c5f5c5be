//! What can be wrong with an input, as kinds that a caller can match and as one clear line for people:
//! which file, where in it, what is wrong, what to do.

use std::fmt;

use thiserror::Error;

use super::foreign;
use super::warning::counted;

/// Where in a file something is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, from 1.
    Line(u64),
    /// An offset from the start of a binary file (after unpacking), in bytes from 0.
    Byte(u64),
    /// An item of a glTF document, such as `accessors[3]`.
    Item(String),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(byte) => write!(f, "byte {byte}"),
            Place::Item(item) => f.write_str(item),
        }
    }
}

/// A mesh file that could not be read.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadError {
    /// The path, or a name such as `standard input`.
    pub name: String,
    /// Where in the file, when that is known.
    pub place: Option<Place>,
    /// What is wrong.
    pub kind: ReadErrorKind,
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        if let Some(place) = &self.place {
            write!(f, ", {place}")?;
        }
        write!(f, ": {}", self.kind)
    }
}

impl std::error::Error for ReadError {}

/// What is wrong with an input.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ReadErrorKind {
    /// No file at that path.
    #[error("there is no such file; check the path")]
    NotFound,
    /// The path names a folder.
    #[error("this is a folder; name a mesh file")]
    Directory,
    /// The operating system refuses.
    #[error("no permission to read it; check the owner and mode of the file")]
    Permission,
    /// Any other failure of the operating system.
    #[error("cannot be read: {0}")]
    Io(String),
    /// The extension names no format.
    #[error("{}", unknown_extension(extension))]
    UnknownExtension {
        /// The extension without its dot, one of packed files taken off; may be empty.
        extension: String,
    },
    /// The first bytes are not those of the format.
    #[error("this is not {format}: {found} stands where {expected} belongs; check the file or name its true format")]
    WrongMagic {
        /// The format that was expected.
        format: &'static str,
        /// What was expected.
        expected: &'static str,
        /// What stands there instead, made printable.
        found: String,
    },
    /// Packed data that does not unpack.
    #[error("the packed data is damaged: {0}; fetch the file again")]
    Packed(String),
    /// What is no regular file: it might never end, or never begin.
    #[error(
        "this is no regular file (a pipe or a device); name a file, or pass the data on standard input, as in `- --format ply`"
    )]
    NotRegular,
    /// The file ends too early.
    #[error("the file ends inside {what}{}; it was cut, fetch it again", missing.map_or(String::new(), |m| format!(" ({} missing)", counted(m, "byte", "bytes"))))]
    Truncated {
        /// What the reader was in.
        what: String,
        /// How many bytes are missing, when that is known.
        missing: Option<u64>,
    },
    /// A sound file, or none at all, without a single vertex.
    #[error("there is no vertex in it; fetch or export the file again, or allow empty meshes (--allow-empty)")]
    Empty,
    /// A face, edge or point names a vertex that is not there.
    #[error(
        "{what} names vertex {index}, but the file has {}, numbered from {first}; mend the index or add the vertex",
        counted(*vertices, "vertex", "vertices")
    )]
    IndexOutOfRange {
        /// `"a face"`, `"an edge"`, …
        what: &'static str,
        /// The number as the file has it.
        index: i64,
        /// How many vertices there are (for a relative index: so far).
        vertices: u64,
        /// The number of the first vertex in this format: 0 or 1.
        first: u8,
    },
    /// A coordinate that is NaN or infinite.
    #[error(
        "vertex {vertex} (counted from 0) has a coordinate that is not a finite number ({value}); mend or remove the vertex, or drop all such (--invalid drop)"
    )]
    NotFinite {
        /// The vertex in the order of the file, from 0.
        vertex: u64,
        /// The coordinate.
        value: f64,
    },
    /// A count in a header that the rest of the file has no room for.
    #[error(
        "{count} {what} are announced, but the {bytes} bytes that follow cannot hold them; the count is wrong or the file was cut"
    )]
    Count {
        /// What is counted.
        what: String,
        /// The announced count.
        count: u64,
        /// The bytes that are there.
        bytes: u64,
    },
    /// More vertices, faces or corners than 32-bit numbers hold.
    #[error("more than {limit} {what}; cut the mesh into tiles")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many there may be.
        limit: u64,
    },
    /// More memory than allowed, or than there is.
    #[error("reading it needs at least {needed} bytes of memory, {}; raise the limit or cut the mesh into tiles", limit.map_or("more than there are".to_string(), |l| format!("the limit is {l}")))]
    Memory {
        /// Bytes needed so far.
        needed: u64,
        /// Bytes allowed; `None` when the system had no more.
        limit: Option<u64>,
    },
    /// Anything that does not follow the format.
    #[error("{0}")]
    Syntax(String),
    /// A part of the format that is not supported.
    #[error("{what} is not supported; {advice}")]
    Unsupported {
        /// The thing.
        what: String,
        /// What to do instead.
        advice: &'static str,
    },
    /// A glTF extension without which the file has no meaning, and which is not supported.
    #[error(
        "the file requires the glTF extension {0}, which is not supported; export it without that extension, or try to unpack it with `gltf-transform copy IN.glb OUT.glb`"
    )]
    Extension(String),
    /// An image file that is too large to be one.
    #[error(
        "the image file {name:?} has {bytes} bytes, more than the {limit} that an image may have; check the reference or leave images out"
    )]
    ImageSize {
        /// The reference as the file has it.
        name: String,
        /// Its size.
        bytes: u64,
        /// How large it may be.
        limit: u64,
    },
    /// A file that a glTF file refers to.
    #[error("the buffer file {uri:?} {problem}")]
    Buffer {
        /// The reference as the file has it.
        uri: String,
        /// What is wrong and what to do.
        problem: String,
    },
}

fn unknown_extension(extension: &str) -> String {
    if let Some((what, to_do)) = foreign::advice(extension) {
        return format!("the extension .{extension} stands for {what}; {to_do}");
    }
    let what = match extension {
        "" => "a file without extension".to_string(),
        extension => format!("the extension .{extension}"),
    };
    format!(
        "{what} is not a known mesh format; known are .obj .ply .stl .off .gltf .glb, each also with .gz, .zst or .xz. Rename the file or name its format"
    )
}

/// An error before the name of the file is attached.
#[derive(Debug)]
pub(super) struct Fail {
    pub place: Option<Place>,
    pub kind: ReadErrorKind,
}

impl Fail {
    pub fn named(self, name: &str) -> ReadError {
        ReadError { name: name.to_string(), place: self.place, kind: self.kind }
    }
}

impl From<ReadErrorKind> for Fail {
    fn from(kind: ReadErrorKind) -> Self {
        Fail { place: None, kind }
    }
}

/// Attach a place to a kind.
pub(super) trait At<T> {
    fn at(self, place: impl FnOnce() -> Place) -> Result<T, Fail>;
}

impl<T> At<T> for Result<T, ReadErrorKind> {
    #[inline]
    fn at(self, place: impl FnOnce() -> Place) -> Result<T, Fail> {
        self.map_err(|kind| Fail { place: Some(place()), kind })
    }
}

/// The first bytes of a file for an error message: printable, short.
pub(super) fn printable(bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return "nothing (the file is empty)".to_string();
    }
    let head = &bytes[..bytes.len().min(12)];
    let line = head.split(|&b| b == b'\n' || b == b'\r').next().unwrap_or(head);
    format!("\"{}\"", line.escape_ascii())
}
