//! Why the frame of a `.lods` file is refused.

use super::kind::Kind;
use std::fmt;
use thiserror::Error;

/// What is wrong with a `.lods` file, or with what a writer was handed. Each displays as one line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ContainerError {
    /// The first bytes are not the magic number.
    #[error("not a .lods file: it does not begin with the magic number; check the name of the file")]
    NotALods,
    /// The magic number is there, but bytes were changed as if the file were text.
    #[error(
        "the .lods file was changed in transfer as if it were text (line ends or the eighth bit); transfer it again in binary mode"
    )]
    TextDamage,
    /// A version of the format that this decoder does not know.
    #[error("byte 8: .lods format version {found}, but this program reads version {supported}; use a newer program")]
    Version {
        /// The version of the file.
        found: u8,
        /// The version of this decoder.
        supported: u8,
    },
    /// A feature that a decoder must know to read the file.
    #[error("the file needs feature {bit}, which this program does not know; use a newer program")]
    RequiredFeature {
        /// The number of the bit, from 0.
        bit: u32,
    },
    /// A kind of chunk that a decoder must know to read the file.
    #[error("chunk {index} is of kind {kind}, which has to be understood and is not; use a newer program")]
    RequiredChunk {
        /// The chunk, from 0.
        index: usize,
        /// The number of its kind.
        kind: u8,
    },
    /// The front of the file fails its checksum.
    #[error(
        "the front of the file (bytes 0 to {length}) is damaged: checksum {computed:08x}, expected {stored:08x}; fetch the file again"
    )]
    HeaderDamaged {
        /// Bytes of the front before its checksum.
        length: u64,
        /// What the file says.
        stored: u32,
        /// What its bytes give.
        computed: u32,
    },
    /// A chunk fails its checksum.
    #[error(
        "chunk {index} ({kind}, {length} bytes from byte {offset}) is damaged: checksum {computed:08x}, expected {stored:08x}; fetch the file again"
    )]
    ChunkDamaged {
        /// The chunk, from 0.
        index: usize,
        /// Its kind.
        kind: Kind,
        /// Its first byte in the file.
        offset: u64,
        /// Its length in bytes.
        length: u64,
        /// What the file says.
        stored: u32,
        /// What its bytes give.
        computed: u32,
    },
    /// The file ends early.
    #[error("the file is cut: {have} bytes of {}{need}, {}", if *.exact { "" } else { "at least " }, WholeLevel(*.level))]
    Truncated {
        /// Bytes at hand.
        have: u64,
        /// Bytes that the whole file has.
        need: u64,
        /// Whether `need` is the length of the file, or only what is known so far because the front itself is cut.
        exact: bool,
        /// The finest level that is whole, `None` when not even level 0 is.
        level: Option<u32>,
    },
    /// The file goes on after its last chunk.
    #[error("the file goes on after its last byte: {have} bytes, the chunk table ends at {total}; cut it there")]
    TrailingBytes {
        /// Bytes at hand.
        have: u64,
        /// Bytes that the file should have.
        total: u64,
    },
    /// The header or a table contradicts itself, or a limit of the format.
    #[error("{place}: {what}; the file was made by a faulty encoder or to do harm")]
    Inconsistent {
        /// Where.
        place: Place,
        /// What is wrong.
        what: &'static str,
    },
    /// Decoding would take more memory than allowed.
    #[error(
        "decoding needs about {needed} bytes of memory, the limit is {limit}; raise the memory limit if you trust the file"
    )]
    MemoryLimit {
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
}

/// Where in the front of a file something contradicts itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// The fixed fields.
    Header,
    /// A row of the level table.
    Level(u32),
    /// A row of the chunk table.
    Chunk(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Header => write!(f, "header"),
            Place::Level(level) => write!(f, "level {level} of the level table"),
            Place::Chunk(index) => write!(f, "chunk {index} of the chunk table"),
        }
    }
}

struct WholeLevel(Option<u32>);

impl fmt::Display for WholeLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(level) => write!(f, "levels up to {level} are whole; fetch the rest of it"),
            None => write!(f, "no level is whole; fetch the rest of it"),
        }
    }
}

/// Shorthand for [`ContainerError::Inconsistent`].
pub(super) fn inconsistent<T>(place: Place, what: &'static str) -> Result<T, ContainerError> {
    Err(ContainerError::Inconsistent { place, what })
}
