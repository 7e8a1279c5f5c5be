//! Materials, textures, samplers and names of images: strings, byte by byte in the context of the byte before.
//!
//! Records of one kind resemble each other; with some kilobytes of JSON in a file, what a context of two bytes would gain is not worth its
//! learning. The bytes of images are chunks of their own.

use crate::format::coder::InvalidStream;
use crate::format::coder::range::{Bit, Coder, exp_golomb};
use crate::mesh::{Appearance, Image};

/// The most bytes of all strings together.
pub const MAX_TEXT: u64 = 1 << 26;

/// The most strings.
pub const MAX_TEXTS: u64 = 1 << 20;

/// Bytes of memory that a string takes, while lists grow, and each of its bytes: a stream of zeros is very many of them.
const MEMORY_PER_TEXT: u64 = 3 * size_of::<Image>() as u64;
const MEMORY_PER_BYTE: u64 = 3;

/// Why materials cannot be coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppearanceError {
    /// A stream that contradicts itself, or more text than a file holds.
    InvalidStream(InvalidStream),
    /// They take more memory than a decoder may use.
    Memory {
        /// Bytes needed, at least.
        needed: u64,
    },
}

impl From<InvalidStream> for AppearanceError {
    fn from(nonsense: InvalidStream) -> Self {
        AppearanceError::InvalidStream(nonsense)
    }
}

struct Models {
    count: [Bit; 64],
    length: [Bit; 64],
    /// For each byte before, a binary tree over the next.
    byte: Vec<Bit>,
    before: usize,
    /// Strings and bytes so far, and the memory they may take.
    texts: u64,
    bytes: u64,
    limit: u64,
}

impl Models {
    fn text<C: Coder>(&mut self, coder: &mut C, text: &str) -> Result<String, AppearanceError> {
        let bytes = text.as_bytes();
        let length = exp_golomb(coder, &mut self.length, u32::try_from(bytes.len()).unwrap_or(u32::MAX));
        self.texts += 1;
        self.bytes += length as u64;
        if self.bytes > MAX_TEXT || self.texts > MAX_TEXTS {
            return Err(InvalidStream("more than 64 MiB, or 2^20 records, of materials").into());
        }
        let needed = self.memory();
        if needed > self.limit {
            return Err(AppearanceError::Memory { needed });
        }
        let mut out = Vec::new();
        for i in 0..length as usize {
            let byte = bytes.get(i).copied().unwrap_or(0);
            let mut node = 1usize;
            for k in (0..8).rev() {
                let bit = coder.bit(&mut self.byte[self.before << 8 | node], byte >> k & 1 == 1);
                node = node << 1 | bit as usize;
            }
            out.push(node as u8);
            self.before = node & 255;
            if coder.overrun() {
                return Err(InvalidStream("a text that ends too early").into());
            }
        }
        String::from_utf8(out).map_err(|_| InvalidStream("a text that is not UTF-8").into())
    }

    fn memory(&self) -> u64 {
        self.texts * MEMORY_PER_TEXT + self.bytes * MEMORY_PER_BYTE
    }

    fn list<C: Coder>(&mut self, coder: &mut C, list: &[String]) -> Result<Vec<String>, AppearanceError> {
        let count = exp_golomb(coder, &mut self.count, list.len() as u32);
        let mut out = Vec::new();
        for i in 0..count as usize {
            out.push(self.text(coder, list.get(i).map_or("", |s| s))?);
            if coder.overrun() {
                return Err(InvalidStream("records that end too early").into());
            }
        }
        Ok(out)
    }
}

/// Code `appearance` but for the bytes of its images, in at most `limit` bytes of memory. A decoder comes with an empty one. Returns the memory
/// taken too.
///
/// # Errors
/// [`AppearanceError`] from a stream that contradicts itself, for more text than a file holds, or beyond the limit.
pub fn code_appearance<C: Coder>(
    coder: &mut C,
    appearance: &Appearance,
    limit: u64,
) -> Result<(Appearance, u64), AppearanceError> {
    let mut m = Models {
        count: [Bit::default(); 64],
        length: [Bit::default(); 64],
        byte: vec![Bit::default(); 1 << 16],
        before: 0,
        texts: 0,
        bytes: 0,
        limit,
    };
    let materials = m.list(coder, &appearance.materials)?;
    let textures = m.list(coder, &appearance.textures)?;
    let samplers = m.list(coder, &appearance.samplers)?;
    let count = exp_golomb(coder, &mut m.count, appearance.images.len() as u32);
    let mut images = Vec::new();
    for i in 0..count as usize {
        let (name, mime) = appearance.images.get(i).map_or(("", ""), |i| (&i.name, &i.mime));
        let (name, mime) = (m.text(coder, name)?, m.text(coder, mime)?);
        images.push(Image { name, mime, bytes: Vec::new(), previews: Vec::new() });
        if coder.overrun() {
            return Err(InvalidStream("records that end too early").into());
        }
    }
    let memory = m.memory();
    Ok((Appearance { materials, textures, samplers, images }, memory))
}
