//! Materials, textures, samplers and names of images: strings, byte by byte in the context of the byte before.
//!
//! Records of one kind resemble each other; with some kilobytes of JSON in a file, what a context of two bytes would gain is not worth its
//! learning. The bytes of images are chunks of their own.

use super::range::{Bit, Coder, golomb};
use super::segment::Nonsense;
use crate::mesh::{Appearance, Image};

/// The longest string, in bytes.
pub const MAX_TEXT: u32 = 1 << 26;

struct Models {
    count: [Bit; 64],
    length: [Bit; 64],
    /// For each byte before, a binary tree over the next.
    byte: Vec<Bit>,
    before: usize,
}

impl Models {
    fn text<C: Coder>(&mut self, coder: &mut C, text: &str) -> Result<String, Nonsense> {
        let bytes = text.as_bytes();
        let length = golomb(coder, &mut self.length, bytes.len() as u32);
        if length > MAX_TEXT {
            return Err(Nonsense("a text of more than 64 MiB"));
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
                return Err(Nonsense("a text that ends too early"));
            }
        }
        String::from_utf8(out).map_err(|_| Nonsense("a text that is not UTF-8"))
    }

    fn list<C: Coder>(&mut self, coder: &mut C, list: &[String]) -> Result<Vec<String>, Nonsense> {
        let count = golomb(coder, &mut self.count, list.len() as u32);
        let mut out = Vec::new();
        for i in 0..count as usize {
            out.push(self.text(coder, list.get(i).map_or("", |s| s))?);
            if coder.overrun() {
                return Err(Nonsense("records that end too early"));
            }
        }
        Ok(out)
    }
}

/// Code `appearance` but for the bytes of its images. A decoder comes with an empty one.
///
/// # Errors
/// [`Nonsense`] from a stream that contradicts itself, or for more than 2^32 records.
pub fn code_appearance<C: Coder>(coder: &mut C, appearance: &Appearance) -> Result<Appearance, Nonsense> {
    let mut m = Models {
        count: [Bit::default(); 64],
        length: [Bit::default(); 64],
        byte: vec![Bit::default(); 1 << 16],
        before: 0,
    };
    let materials = m.list(coder, &appearance.materials)?;
    let textures = m.list(coder, &appearance.textures)?;
    let samplers = m.list(coder, &appearance.samplers)?;
    let count = golomb(coder, &mut m.count, appearance.images.len() as u32);
    let mut images = Vec::new();
    for i in 0..count as usize {
        let (name, mime) = appearance.images.get(i).map_or(("", ""), |i| (&i.name, &i.mime));
        let (name, mime) = (m.text(coder, name)?, m.text(coder, mime)?);
        images.push(Image { name, mime, bytes: Vec::new() });
        if coder.overrun() {
            return Err(Nonsense("records that end too early"));
        }
    }
    Ok(Appearance { materials, textures, samplers, images })
}
