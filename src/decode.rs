//! The decoder's front door, made for viewers: hand in bytes as they arrive, ask for the next level.

use crate::complex::Faces;
use crate::mesh::Mesh;
use thiserror::Error;

/// What the user chooses.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodeOptions {
    /// The most memory that decoding may take, in bytes; counts are checked against it before anything is allocated.
    pub memory_limit: u64,
}

impl Default for DecodeOptions {
    fn default() -> Self {
        DecodeOptions { memory_limit: 4 << 30 }
    }
}

/// What became of a request for the next level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// This level is ready.
    Level(u32),
    /// The bytes at hand end before the next level does.
    NeedBytes,
    /// The full level was reached before.
    Full,
}

/// Why a stream could not be decoded.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DecodeError {
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
    /// A chunk passes its checksum and still makes no sense.
    #[error("level {level}: {what}; the file was damaged or made by a faulty encoder")]
    Corrupt {
        /// The level being decoded.
        level: u32,
        /// What is wrong.
        what: &'static str,
    },
}

/// A decoder in the middle of a stream.
#[derive(Debug)]
pub struct Decoder {
    options: DecodeOptions,
}

impl Decoder {
    /// A decoder that has seen nothing yet.
    pub fn new(options: DecodeOptions) -> Self {
        Decoder { options }
    }

    /// Hand in the next bytes of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        let _ = (bytes, &self.options);
    }

    /// Decode the next level, if its bytes are there.
    ///
    /// # Errors
    /// [`DecodeError`]; the decoder then stays at the level it had reached.
    pub fn next_level(&mut self) -> Result<Step, DecodeError> {
        Ok(Step::Full)
    }

    /// The level at hand, `None` before the first.
    pub fn level(&self) -> Option<u32> {
        None
    }

    /// Positions of the level at hand, in the units of the model.
    pub fn positions(&self) -> Vec<[f64; 3]> {
        Vec::new()
    }

    /// Elements of the level at hand.
    pub fn faces(&self) -> Faces {
        Faces::new()
    }

    /// For each vertex of the level at hand its vertex in the level before (`u32::MAX` for a birth).
    pub fn parents(&self) -> &[u32] {
        &[]
    }

    /// The level at hand as a mesh, with the faces that travel aside when it is the full one.
    pub fn to_mesh(&self) -> Mesh {
        Mesh::default()
    }
}
