//! Images on their way into a file: JPEG without loss in pieces, each prefix of which is a picture.
//!
//! A baseline file becomes a progressive one: its coefficients are read, verified to come back, and coded anew in nine scans, coarse before
//! fine ([ITU-T T.81](https://www.w3.org/Graphics/JPEG/itu-t81.pdf), annexes F and G). All other segments stay, so do bytes behind the end. A file
//! that is progressive already is coded anew in these scans where that is smaller, and else cut as it is. Anything else stays in one piece, with a reason.
//!
//! This is written here, rather than bound to a C library, for three reasons: nothing below needs `unsafe`, hostile images are read by safe
//! code alone, and the decoder can turn a progressive file into the baseline file that it was, byte by byte, without C (`restore`).
//! No floating point and no transform: coefficients are only moved.
//!
//! Invariants: the pieces in their order are the whole file; the first of them, ended by [`END`], are a file too.

#[cfg(feature = "recompress")]
mod eighth;
mod entropy;
mod frame;
#[cfg(feature = "recompress")]
mod lossy;
mod progressive;
mod restore;
mod sequential;

#[cfg(feature = "recompress")]
pub use eighth::{Eighth, Means, eighth};
#[cfg(feature = "recompress")]
pub use lossy::{Pixels, Sampling, jpeg, loss_by_halving};
pub use restore::restore;

use self::frame::{Frame, Item, Parsed};
use crate::image::signature::is_png;
use std::borrow::Cow;
use std::io::Read;
use thiserror::Error;

/// The end marker of a JPEG file, which makes a file of its first pieces.
pub const END: [u8; 2] = [0xFF, 0xD9];

/// Bytes of coefficients that [`cut`] takes at most: 16384² pixels with halved chroma.
pub const MAX_COEFFICIENT_BYTES: u64 = 1 << 30;

/// Bytes of coefficients for each byte of a file, at most: a block of 64 coefficients takes two bits.
const MOST_COEFFICIENTS: u64 = 512;

/// Pieces have at least so many bytes, or the 64th part of the file: each costs some bytes of table.
const LEAST_PIECE: usize = 512;

/// What makes a file other than those that are understood. The message can be shown to a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct Unsupported(pub &'static str);

impl Unsupported {
    /// Another kind of image, or none.
    pub const NO_JPEG: Unsupported = Unsupported("it is no JPEG");
}

/// What was done with an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Treatment {
    /// It is one piece, as it was, for this reason.
    Kept(Unsupported),
    /// It was progressive and was cut at its scans, as it was.
    Cut,
    /// It was baseline and became progressive, with the same coefficients.
    Transcoded,
}

/// An image in pieces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pieces<'a> {
    /// The pieces; together they are the file. They borrow from an image that stays as it was.
    pub pieces: Vec<Cow<'a, [u8]>>,
    /// With [`Exactness::Bytes`], for a file that was transcoded: what `restore` needs to give the very bytes back.
    pub reconstruction: Option<Vec<u8>>,
    /// Bytes of memory that `restore` takes, 0 without a reconstruction.
    pub memory: u64,
    /// What was done.
    pub way: Treatment,
}

/// What has to come back of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exactness {
    /// The same coefficients, and so the same pixels; metadata too.
    #[default]
    Coefficients,
    /// The same bytes.
    Bytes,
}

/// Cut the file of an image, of any format, into pieces.
pub fn cut(bytes: &[u8], exactness: Exactness) -> Pieces<'_> {
    pieces(bytes, exactness).unwrap_or_else(|odd| Pieces {
        pieces: vec![Cow::Borrowed(bytes)],
        reconstruction: None,
        memory: 0,
        way: Treatment::Kept(odd),
    })
}

/// Pixels that an image may have of which a JPEG is made: their coefficients and the pixels themselves take some two gigabytes.
pub(crate) const MOST_PIXELS: u64 = 1 << 28;

/// Bytes of memory that work on an image takes beyond its file, as its first bytes tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Working {
    /// The coefficients that [`cut`] holds while it codes a JPEG anew.
    pub coefficients: u64,
    /// Pixels and coefficients of a PNG of which a JPEG is made.
    pub pixels: u64,
    /// The coefficients of that JPEG, which [`cut`] holds then.
    pub made: u64,
    /// How many pixels there are to be drawn, in all images together.
    pub texels: u64,
}

impl Working {
    /// Of an image of `bytes` bytes that `input` begins with. Reads as far as the dimensions.
    pub fn of(input: &mut impl Read, bytes: u64) -> Self {
        let (mut start, mut input) = (Vec::new(), input.take(bytes));
        // What cannot be read tells nothing; the reader of the image will say why.
        let _ = (&mut input).take(26).read_to_end(&mut start);
        let start = &start[..];
        let word =
            |at: usize| start.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |w| u32::from_be_bytes(*w) as u64);
        if is_png(start) {
            let (width, height) = (word(16), word(20));
            if start.get(12..16) != Some(b"IHDR") || width.max(height) > 65_535 || width * height > MOST_PIXELS {
                // Nobody makes pixels of it.
                return Working::default();
            }
            // The rows of a file of so many bytes are not longer.
            let texels = (width * height).min(bytes.saturating_mul(8 * 1100));
            if start.get(24) == Some(&16) {
                return Working { texels, ..Working::default() };
            }
            // In halves of a byte per pixel: the pixels, one component, and the coefficients. Those of colour are half as many where it is halved,
            // which only its pixels tell: between both.
            let (samples, coefficients) = match start.get(25) {
                Some(0) => (2, 4),
                Some(4) => (4, 4),
                Some(6) => (8, 9),
                _ => (6, 9),
            };
            let halves = |n: u64| texels.saturating_mul(n) / 2;
            return Working {
                coefficients: 0,
                pixels: halves(samples + 2 + coefficients),
                made: halves(coefficients),
                texels,
            };
        }
        let [coefficients, texels] = coefficients_and_pixels(&mut start.chain(input)).unwrap_or_default();
        let coefficients = coefficients.min(bytes.saturating_mul(MOST_COEFFICIENTS));
        // One component has two bytes of coefficients for each pixel.
        Working { coefficients, texels: texels.min(coefficients / 2), ..Working::default() }
    }

    /// Of an image that no picture shows.
    #[must_use]
    pub fn unseen(self) -> Self {
        Working { texels: 0, ..self }
    }

    /// Of both, one worked on after the other and drawn together.
    #[must_use]
    pub fn and(self, other: Working) -> Self {
        Working {
            coefficients: self.coefficients.max(other.coefficients),
            pixels: self.pixels.max(other.pixels),
            made: self.made.max(other.made),
            texels: self.texels.saturating_add(other.texels),
        }
    }
}

/// Bytes of the coefficients that [`cut`] holds while it codes a file anew, of which `input` gives the beginning, and its pixels; `None` for
/// one that it does not code anew. Reads as far as the frame.
fn coefficients_and_pixels(input: &mut impl Read) -> Option<[u64; 2]> {
    let mut start = [0; 2];
    input.read_exact(&mut start).ok()?;
    if start != [0xFF, 0xD8] {
        return None;
    }
    loop {
        let mut head = [0; 4];
        input.read_exact(&mut head).ok()?;
        while head[..2] == [0xFF; 2] {
            // Bytes that fill up stand before markers.
            head.copy_within(1.., 0);
            input.read_exact(&mut head[3..]).ok()?;
        }
        let &[0xFF, process, ref length @ ..] = &head else { return None };
        let length = u16::from_be_bytes(*length).checked_sub(2)? as u64;
        match process {
            0xC0..=0xC2 => {
                let mut frame = Vec::new();
                input.take(length).read_to_end(&mut frame).ok()?;
                let parsed = Parsed { items: Vec::new(), trailer: &[], process, frame: &frame };
                let size = |at: usize| Some(u64::from(u16::from_be_bytes(*frame.get(at..)?.first_chunk()?)));
                let pixels = size(1)? * size(3)?;
                return Frame::new(&parsed, MAX_COEFFICIENT_BYTES).ok().map(|frame| [frame.bytes(), pixels]);
            }
            0xC4 | 0xDB | 0xDD | 0xE0..=0xEF | 0xFE => {
                std::io::copy(&mut input.take(length), &mut std::io::sink()).ok()?;
            }
            _ => return None,
        }
    }
}

fn pieces(bytes: &[u8], exactness: Exactness) -> Result<Pieces<'_>, Unsupported> {
    let parsed = Parsed::new(bytes)?;
    match parsed.process {
        0xC0..=0xC2 => {
            let (file, reconstruction) = match (parsed.process, exactness) {
                // Progressive already: other scans are worth the trouble where they are smaller.
                (0xC2, Exactness::Coefficients) => match transcode(bytes, &parsed, exactness) {
                    Ok(other) if other.0.len() < bytes.len() => other,
                    _ => return Ok(as_it_is(bytes, &parsed)),
                },
                (0xC2, Exactness::Bytes) => return Ok(as_it_is(bytes, &parsed)),
                _ => transcode(bytes, &parsed, exactness)?,
            };
            let again = Parsed::new(&file)?;
            let memory = match reconstruction {
                Some(_) => {
                    Frame::new(&again, MAX_COEFFICIENT_BYTES)?.bytes() + file.len() as u64 + 2 * bytes.len() as u64
                }
                None => 0,
            };
            let pieces = split(&file, &again).map(|piece| Cow::Owned(piece.to_vec())).collect();
            Ok(Pieces { pieces, reconstruction, memory, way: Treatment::Transcoded })
        }
        0xC9..=0xCF => Err(Unsupported("it is arithmetic-coded")),
        _ => Err(Unsupported("it is a lossless or hierarchical JPEG")),
    }
}

/// A progressive file cut at its own scans.
fn as_it_is<'a>(bytes: &'a [u8], parsed: &Parsed<'_>) -> Pieces<'a> {
    let pieces = split(bytes, parsed).map(Cow::Borrowed).collect();
    Pieces { pieces, reconstruction: None, memory: 0, way: Treatment::Cut }
}

/// The progressive file in our scans with the coefficients of another one, and with [`Exactness::Bytes`] the reconstruction that leads back.
fn transcode(
    bytes: &[u8],
    parsed: &Parsed<'_>,
    exactness: Exactness,
) -> Result<(Vec<u8>, Option<Vec<u8>>), Unsupported> {
    let frame = Frame::new(parsed, MAX_COEFFICIENT_BYTES)?;
    // A block takes two bits at least: dimensions prove nothing.
    if frame.blocks() as u64 > parsed.coded_bytes() as u64 * 4 {
        return Err(Unsupported("it is cut: there are fewer bytes than its blocks need"));
    }
    let mut coefficients = match parsed.process {
        0xC2 => progressive::decode(parsed, &frame)?,
        _ => sequential::decode(parsed, &frame)?,
    };
    let filling = frame.take_filling(&mut coefficients);
    let mut out = vec![0xFF, 0xD8];
    for item in &parsed.items {
        match *item {
            Item::Segment { marker: 0xC0..=0xC2, bytes } => {
                out.extend_from_slice(&[0xFF, 0xC2]);
                out.extend_from_slice(&bytes[2..]);
            }
            Item::Segment { marker, bytes } if frame::stays(marker) => out.extend_from_slice(bytes),
            // Tables and restarts belong to the scans that were.
            Item::Segment { .. } | Item::Scan { .. } => {}
        }
    }
    progressive::encode(&frame, &coefficients, parsed.is_rgb(), &mut out);
    out.extend_from_slice(&END);
    out.extend_from_slice(parsed.trailer);
    // What is promised is looked at: a file of ours that read otherwise would be a loss that nobody saw. A digest is kept instead of the
    // coefficients, which take many times the memory of their file.
    let before = digest(&coefficients);
    drop(coefficients);
    let reconstruction = match exactness {
        Exactness::Coefficients => {
            let again = Parsed::new(&out)?;
            if digest(&progressive::decode(&again, &Frame::new(&again, MAX_COEFFICIENT_BYTES)?)?) != before {
                return Err(Unsupported("its coefficients do not come back"));
            }
            None
        }
        // The same bytes prove the same coefficients.
        Exactness::Bytes => {
            let reconstruction = restore::reconstruction(parsed, &filling);
            if restore(&out, &reconstruction, MAX_COEFFICIENT_BYTES)? != bytes {
                return Err(Unsupported("its very bytes would not come back from a progressive file"));
            }
            Some(reconstruction)
        }
    };
    Ok((out, reconstruction))
}

/// A number that tells coefficients from others.
fn digest(blocks: &frame::Blocks) -> u64 {
    let mut hasher = std::hash::DefaultHasher::new();
    std::hash::Hash::hash(blocks, &mut hasher);
    std::hash::Hasher::finish(&hasher)
}

/// Whether two files are the same image: the same bytes, or the same coefficients and segments in JPEG files that are coded in different ways.
pub fn same_picture(a: &[u8], b: &[u8]) -> bool {
    a == b || matches!((contents(a), contents(b)), (Ok(a), Ok(b)) if a == b)
}

/// All of a file but the way in which its coefficients are coded: segments that stay, coefficients, what follows the end.
type Contents = (Vec<Vec<u8>>, frame::Blocks, Vec<u8>);

fn contents(bytes: &[u8]) -> Result<Contents, Unsupported> {
    let parsed = Parsed::new(bytes)?;
    let frame = Frame::new(&parsed, MAX_COEFFICIENT_BYTES)?;
    let mut blocks = match parsed.process {
        0xC2 => progressive::decode(&parsed, &frame)?,
        0xC0 | 0xC1 if frame.blocks() as u64 <= parsed.coded_bytes() as u64 * 4 => sequential::decode(&parsed, &frame)?,
        _ => return Err(Unsupported("its coefficients are not read")),
    };
    frame.take_filling(&mut blocks);
    let segments = parsed.items.iter().filter_map(|i| match *i {
        Item::Segment { marker, bytes } if frame::stays(marker) => Some(bytes[2..].to_vec()),
        _ => None,
    });
    Ok((segments.collect(), blocks, parsed.trailer.to_vec()))
}

/// Cut a file behind its scans; small pieces are joined.
fn split<'a>(file: &'a [u8], parsed: &Parsed<'_>) -> impl Iterator<Item = &'a [u8]> {
    let least = LEAST_PIECE.max(file.len() / 64);
    let mut ends = Vec::new();
    for item in &parsed.items {
        if let Item::Scan { end, .. } = *item
            && end - ends.last().unwrap_or(&0) >= least
            && file.len() - end >= least
        {
            ends.push(end);
        }
    }
    ends.push(file.len());
    let mut from = 0;
    ends.into_iter().map(move |end| &file[std::mem::replace(&mut from, end)..end])
}

#[cfg(test)]
mod tests;
