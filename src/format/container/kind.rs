//! The kinds of chunks.

use std::fmt;

/// Kinds from here on may be skipped by a decoder that does not know them; those below have to be understood.
pub const FIRST_OPTIONAL_KIND: u8 = 128;

/// The optional kind that says what a file was made from: checksums of its source and of the settings.
pub const KIND_SOURCE: u8 = 128;

/// The optional kind that holds a [`Preview`](super::Preview).
pub const KIND_PREVIEW: u8 = 129;

/// What a chunk holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// Level 0 and the levels that are coded together with it (number 0).
    Base,
    /// A run of consecutive levels that share one chunk (number 1).
    Levels,
    /// One segment of the batch that leads to a level, or to a run of levels (number 2).
    Segment,
    /// The elements that repeat a vertex, at the full level (number 3).
    Degenerate,
    /// Values of degenerate faces and of isolated vertices, at the full level (number 4).
    ExtraAttributes,
    /// Materials, textures, samplers, names of images (number 5).
    Appearance,
    /// A piece of an image; segments count its pieces (number 6).
    Image,
    /// What gives the very bytes of an image back (number 7).
    Reconstruction,
    /// A small picture that stands in for an image until its first piece is there (number 129, which may be skipped).
    Preview,
    /// A kind that this decoder does not know. It may skip those from [`FIRST_OPTIONAL_KIND`] on, and has to refuse a file
    /// with any other.
    Other(u8),
}

impl Kind {
    /// The number of the kind in the file.
    pub fn number(self) -> u8 {
        match self {
            Kind::Base => 0,
            Kind::Levels => 1,
            Kind::Segment => 2,
            Kind::Degenerate => 3,
            Kind::ExtraAttributes => 4,
            Kind::Appearance => 5,
            Kind::Image => 6,
            Kind::Reconstruction => 7,
            Kind::Preview => KIND_PREVIEW,
            Kind::Other(number) => number,
        }
    }

    /// The kind with the given number.
    pub fn from_number(number: u8) -> Self {
        match number {
            0 => Kind::Base,
            1 => Kind::Levels,
            2 => Kind::Segment,
            3 => Kind::Degenerate,
            4 => Kind::ExtraAttributes,
            5 => Kind::Appearance,
            6 => Kind::Image,
            7 => Kind::Reconstruction,
            KIND_PREVIEW => Kind::Preview,
            number => Kind::Other(number),
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Kind::Base => write!(f, "base"),
            Kind::Levels => write!(f, "levels"),
            Kind::Segment => write!(f, "segment"),
            Kind::Degenerate => write!(f, "degenerate"),
            Kind::ExtraAttributes => write!(f, "extra attributes"),
            Kind::Appearance => write!(f, "appearance"),
            Kind::Image => write!(f, "image"),
            Kind::Reconstruction => write!(f, "reconstruction"),
            Kind::Preview => write!(f, "preview"),
            Kind::Other(KIND_SOURCE) => write!(f, "source"),
            Kind::Other(number) => write!(f, "kind {number}"),
        }
    }
}
