//! The decoder's front door, made for viewers: hand in bytes as they arrive, ask for the next level.
//!
//! Integer arithmetic alone decides what comes out; only [`Decoder::positions`] and [`Decoder::to_mesh`] turn integers into
//! coordinates. Counts are checked against the memory limit before anything is allocated by them, and the work that a file asks
//! for against its length.
//!
//! Invariant: after an error everything that can be asked is as it was at the last level that was reached.

mod buffers;
mod images;
mod mesh;
mod open;

pub use buffers::{BufferError, Group, PositionTransform, RenderLevel};
pub use images::MissingImages;

use self::open::Open;
use crate::format::coder::InvalidStream;
use crate::format::complex::{Attributes, Faces, Level};
use crate::format::container::{ChunkInfo, ContainerError, FileIndex, Reader};
use crate::mesh::{Appearance, Mesh};
use std::sync::Arc;
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
    /// The container is damaged, of another version, or asks for more memory than allowed.
    #[error(transparent)]
    Container(#[from] ContainerError),
    /// A chunk passes its checksum and still makes no sense.
    #[error("level {level}: {what}; the file was made by a faulty or hostile encoder")]
    Corrupt {
        /// The level being decoded.
        level: u32,
        /// What is wrong.
        what: &'static str,
    },
}

/// A decoder in the middle of a stream.
///
/// ```
/// # use lodestream::format::decoder::{DecodeOptions, Decoder, Step};
/// # fn show(_: &[[f64; 3]], _: &lodestream::format::complex::Faces) {}
/// # fn main() -> Result<(), lodestream::format::decoder::DecodeError> {
/// # let pieces: Vec<Vec<u8>> = Vec::new();
/// let mut decoder = Decoder::new(DecodeOptions::default());
/// for bytes in pieces {
///     decoder.push(&bytes);
///     while let Step::Level(_) = decoder.next_level()? {
///         show(&decoder.positions(), decoder.faces());
///     }
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Decoder {
    options: DecodeOptions,
    reader: Reader,
    /// What is known since the file's index is.
    open: Option<Box<Open>>,
    /// The level at hand before the first.
    nothing: Level,
    failed: Option<DecodeError>,
}

impl Decoder {
    /// A decoder that has seen nothing yet.
    pub fn new(options: DecodeOptions) -> Self {
        let nothing = Level { positions: Vec::new(), faces: Faces::new(), shift: 0 };
        Decoder { reader: Reader::within(options.memory_limit), options, open: None, nothing, failed: None }
    }

    /// Hand in the next bytes of the file.
    pub fn push(&mut self, bytes: &[u8]) {
        self.reader.push(bytes);
    }

    /// Header and tables of the file, `None` until their bytes are there.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn index(&mut self) -> Result<Option<Arc<FileIndex>>, DecodeError> {
        Ok(self.reader.index()?)
    }

    /// Say that no more bytes will come.
    ///
    /// # Errors
    /// [`ContainerError::Truncated`] when the file goes on behind what was handed in.
    pub fn finish(&mut self) -> Result<(), DecodeError> {
        Ok(self.reader.finish()?)
    }

    /// Decode the next level, if its bytes are there.
    ///
    /// # Errors
    /// [`DecodeError`]; the decoder then stays at the level it had reached, and says the same again.
    pub fn next_level(&mut self) -> Result<Step, DecodeError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        let step = self.step();
        if let Err(error) = &step {
            self.failed = Some(error.clone());
        }
        step
    }

    fn step(&mut self) -> Result<Step, DecodeError> {
        if self.open.is_none() {
            let Some(index) = self.reader.index()? else { return Ok(Step::NeedBytes) };
            self.open = Some(Box::new(Open::new(index, self.options.memory_limit)?));
        }
        match &mut self.open {
            Some(open) => open.step(&mut self.reader),
            None => Ok(Step::NeedBytes),
        }
    }

    /// The level at hand, `None` before the first.
    pub fn level(&self) -> Option<u32> {
        self.open.as_ref().and_then(|open| open.at)
    }

    /// Positions of the level at hand, in the units of the model. Where low bits are not known yet, a vertex lies
    /// in the middle of its cell.
    pub fn positions(&self) -> Vec<[f64; 3]> {
        self.open.as_ref().map_or(Vec::new(), |open| open.positions())
    }

    /// Lattice coordinates of the level at hand, in steps of `2^shift`, and its elements.
    pub fn complex(&self) -> &Level {
        self.open.as_ref().map_or(&self.nothing, |open| &open.state.level)
    }

    /// Elements of the level at hand, without degenerate faces, which belong to the full level.
    pub fn faces(&self) -> &Faces {
        &self.complex().faces
    }

    /// Faces that repeat a vertex; they belong to the full level.
    pub fn degenerate(&self) -> Option<&Faces> {
        self.open.as_ref().and_then(|open| open.degenerate.as_ref())
    }

    /// For each vertex of the level at hand its vertex in the level before ([`crate::format::complex::NONE`] for a new vertex).
    /// The children of a split stand side by side.
    pub fn parents(&self) -> &[u32] {
        self.open.as_ref().map_or(&[], |open| &open.state.parents)
    }

    /// The level at hand as a mesh, with the degenerate faces when it is the full one.
    pub fn to_mesh(&self) -> Mesh {
        self.open.as_ref().map_or_else(Mesh::default, |open| open.to_mesh())
    }

    /// Hand in the payload of a chunk of materials, or of a preview, piece or reconstruction of an image, that was fetched
    /// apart, its checksum verified ([`FileIndex::payload`], [`FileIndex::check_chunk`]); other kinds, and what is there
    /// already, are passed over. Pieces of an image come in their order, those of different images in any, and nothing before
    /// the file's index.
    ///
    /// # Errors
    /// [`DecodeError::Corrupt`] for materials that make no sense, and for a piece of an image that comes before
    /// them, or before the pieces that it follows.
    pub fn offer(&mut self, info: ChunkInfo, payload: Vec<u8>) -> Result<(), DecodeError> {
        if self.open.is_none()
            && let Some(index) = self.reader.index()?
        {
            self.open = Some(Box::new(Open::new(index, self.options.memory_limit)?));
        }
        let Some(open) = &mut self.open else {
            return Err(corrupt(0, "materials or images before the file's index"));
        };
        open.take_picture(open.at.unwrap_or(0), info, payload)
    }

    /// Labels and wedges of the level at hand, in the order of its elements and corners.
    pub fn attributes(&self) -> &Attributes {
        static NONE: Attributes = Attributes { layers: Vec::new(), labels: Vec::new() };
        self.open.as_ref().map_or(&NONE, |open| &open.state.attributes)
    }

    /// Materials, textures and images, as far as they have arrived: an image of which some pieces are here is a whole file of
    /// less detail, one of which none is here is its finest preview, with the media type of that, or empty.
    pub fn appearance(&self) -> Option<&Appearance> {
        self.open.as_ref().and_then(|open| open.images.appearance.as_ref())
    }

    /// How many images there are, and of how many of them nothing, and not all, has arrived.
    pub fn missing_images(&self) -> MissingImages {
        self.open.as_ref().map_or_else(MissingImages::default, |open| open.missing_images())
    }
}

fn corrupt(level: u32, what: &'static str) -> DecodeError {
    DecodeError::Corrupt { level, what }
}

/// What [`InvalidStream`] means at a level.
fn at_level(level: u32) -> impl Fn(InvalidStream) -> DecodeError {
    move |InvalidStream(what)| corrupt(level, what)
}

/// Decode a whole file in memory, to the full level with all its images. Memory up to [`DecodeOptions::default`]'s limit may be taken; a
/// [`Decoder`] takes another limit, gives levels one after the other, and reads what is cut.
///
/// # Errors
/// [`DecodeError`], for a file that is cut too.
pub fn decode(bytes: &[u8]) -> Result<Mesh, DecodeError> {
    let mut decoder = Decoder::new(DecodeOptions::default());
    decoder.push(bytes);
    while let Step::Level(_) = decoder.next_level()? {}
    decoder.finish()?;
    Ok(decoder.to_mesh())
}
