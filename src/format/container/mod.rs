//! The `.lods` file around the chunks: what stands where, and that every byte is what was written.
//!
//! The front of a file (magic number, version, header, level table, chunk table) is small and tells a client all it needs to
//! plan; the payloads of the chunks follow in streaming order, so that any prefix that ends behind a level's last chunk holds
//! that level. `docs/format/container.md` is the normative text.
//!
//! Invariants: every byte of a file is covered by exactly one CRC-32 (the front's or a chunk's); nothing follows the last
//! chunk; no allocation goes by what a file claims before [`FileIndex::check_memory`] was asked, beyond the tables, which are
//! bounded by the bytes at hand and [`MAX_LEVELS`]. A reader never panics, whatever the bytes.
//!
//! [`write()`] makes a file. [`FileIndex::parse`] and [`FileIndex::payload`] read one that lies in memory, [`Reader`] one that arrives
//! in pieces.

mod attributes;
mod chunk;
mod error;
mod header;
mod index;
mod kind;
mod number;
mod preview;
mod reader;
mod table;
#[cfg(test)]
mod tests;

pub use attributes::{AttributeHeader, Label, LayerHeader, MAX_LABELS, MAX_NAME};
pub use chunk::{Chunk, ChunkInfo};
pub use error::{ContainerError, Place};
pub use header::{DegenerateCounts, ErrorBound, Header, LevelInfo, MAX_LEVELS, MAX_SHIFT};
#[cfg(all(feature = "encode", feature = "quality"))]
pub(crate) use index::front_of;
#[cfg(feature = "encode")]
pub(crate) use index::write_borrowed;
pub use index::{FileIndex, Parsed, with_chunk, write, write_front};
pub use kind::{FIRST_OPTIONAL_KIND, KIND_PREVIEW, KIND_SOURCE, Kind};
pub use number::MAX_COUNT;
pub use preview::Preview;
pub use reader::{Event, Reader};

/// The first bytes of every file: a byte that is no ASCII, the name, and line ends that a transfer as text would change.
pub const MAGIC: [u8; 8] = *b"\x8cLODS\r\n\n";

/// The version of the format that is written, and the only one that is read.
pub const VERSION: u8 = 1;

/// The bits of [`Header::required`] that this decoder knows.
pub const KNOWN_REQUIRED: u64 = 0;

/// The most bytes between the length of the front and its checksum.
pub const MAX_BODY: u64 = 1 << 26;

/// Bytes of memory that decoding takes for each vertex of the finest level asked for, that of the level before it included.
pub const MEMORY_PER_VERTEX: u64 = 64;

/// Bytes of memory that decoding takes, while it lasts, for each vertex that a level has more than the level before.
pub const MEMORY_PER_NEW_VERTEX: u64 = 184;

/// Bytes of memory that decoding takes for each element of the finest level asked for.
pub const MEMORY_PER_ELEMENT: u64 = 8;

/// Bytes of memory that decoding takes for each corner of the finest level asked for.
pub const MEMORY_PER_CORNER: u64 = 12;

/// Bytes of memory that decoding takes for each corner of the finest level asked for and each layer of attributes, that of the level before
/// it and of the batch included.
pub const MEMORY_PER_LAYER_CORNER: u64 = 14;

/// Bytes of memory that decoding takes for each layer and each corner aside or vertex, where a file has lone values: any vertex may have one.
pub const MEMORY_PER_EXTRA_VALUE: u64 = 20;

/// Bytes of memory that decoding takes for each component of each wedge.
pub const MEMORY_PER_WEDGE_COMPONENT: u64 = 8;
