//! A picture of an eighth of the size: first coefficients are means of blocks, so it takes no transform.

use super::frame::{Frame, Item, Parsed};
use super::{MAX_COEFFICIENT_BYTES, Unsupported, progressive, sequential};

/// The means of the blocks of a component.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Means {
    /// Blocks per row.
    pub width: usize,
    /// Rows of blocks.
    pub height: usize,
    /// A byte for each, rows from the top.
    pub samples: Vec<u8>,
}

/// What the first coefficients of a JPEG file say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Eighth {
    /// Pixels per row of the whole picture.
    pub width: usize,
    /// Its rows.
    pub height: usize,
    /// One component, grey; or three.
    pub planes: Vec<Means>,
    /// Whether three are red, green and blue, rather than luma, blue and red of JFIF.
    pub rgb: bool,
}

/// Read a JPEG file as far as an eighth of its size.
///
/// # Errors
/// [`Unsupported`] for a file that is not read, and for one of other components than grey or colour.
pub fn eighth(bytes: &[u8]) -> Result<Eighth, Unsupported> {
    let parsed = Parsed::new(bytes)?;
    let frame = Frame::new(&parsed, MAX_COEFFICIENT_BYTES)?;
    if !matches!(frame.components.len(), 1 | 3) {
        return Err(Unsupported("it is neither grey nor of three colours"));
    }
    if frame.blocks() as u64 > parsed.coded_bytes() as u64 * 4 {
        return Err(Unsupported("it is cut: there are fewer bytes than its blocks need"));
    }
    let blocks = match parsed.process {
        0xC2 => progressive::decode(&parsed, &frame)?,
        0xC0 | 0xC1 => sequential::decode(&parsed, &frame)?,
        _ => return Err(Unsupported("its coefficients are not read")),
    };
    let steps = first_steps(&parsed);
    let mut planes = Vec::with_capacity(frame.components.len());
    for c in 0..frame.components.len() {
        let table = parsed.frame.get(8 + 3 * c).and_then(|&t| steps.get(t as usize)).copied().flatten();
        let step = table.ok_or(Unsupported("it is damaged: a quantization table that it uses is missing"))?;
        let (width, height) = frame.size(c);
        let mut samples = vec![0; width * height];
        frame.each_block(c, |x, y, at| {
            if x < width && y < height {
                // The sum of 64 samples, less 128 each, over 8.
                let mean = (i32::from(blocks[at][0]) * step + 4 >> 3) + 128;
                samples[y * width + x] = mean.clamp(0, 255) as u8;
            }
        });
        planes.push(Means { width, height, samples });
    }
    let number = |at: usize| parsed.frame.get(at..at + 2).map_or(0, |b| (b[0] as usize) << 8 | b[1] as usize);
    Ok(Eighth { width: number(3), height: number(1), planes, rgb: parsed.is_rgb() })
}

/// The step of the first coefficient in each quantization table.
fn first_steps(parsed: &Parsed<'_>) -> [Option<i32>; 4] {
    let mut out = [None; 4];
    for item in &parsed.items {
        let &Item::Segment { marker: 0xDB, bytes } = item else { continue };
        let mut body = bytes.get(4..).unwrap_or_default();
        while let Some((&which, rest)) = body.split_first() {
            let (wide, slot) = (which >> 4 > 0, out.get_mut(which as usize & 15));
            let size = if wide { 128 } else { 64 };
            let (Some(table), Some(slot)) = (rest.get(..size), slot) else { break };
            *slot = Some(if wide { i32::from(table[0]) << 8 | i32::from(table[1]) } else { i32::from(table[0]) });
            body = &rest[size..];
        }
    }
    out
}
