//! Previews: small pictures that stand in for an image until its first piece is there.
//!
//! An image shows nothing before its first piece, which of a JPEG is a tenth of its bytes, and of a PNG, kept exactly, all of them. A pyramid of small
//! pictures of it, a few hundredths of its bytes, does. They are JPEG, or PNG where there is alpha; colours are averaged as they are coded, those of
//! pixels with alpha by their alpha. A JPEG is not decoded for it: its first coefficients are the picture of an eighth of the size.
//! A PNG is read row by row. Metadata are left out: glTF takes no notice of profiles and orientations.
//!
//! Invariants: the image itself is not touched; an image that is small, damaged, interlaced or of another format gets none, which is no error.

use super::recompress::{MOST_BESIDE_PIXELS, colours, png_size as size_in_head};
use crate::image::jpeg::{Eighth, MOST_PIXELS, Means, Pixels, Sampling, Unsupported, eighth, jpeg};
use crate::image::signature::{is_jpeg, is_png};
use crate::mesh::Appearance;
use std::fmt;
use std::io::Cursor;
use std::str::FromStr;

/// Whether images get previews.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Previews {
    /// Those that are large enough.
    #[default]
    Auto,
    /// None does.
    None,
}

impl fmt::Display for Previews {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Previews::Auto => "auto",
            Previews::None => "none",
        })
    }
}

impl FromStr for Previews {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Previews::Auto),
            "none" => Ok(Previews::None),
            _ => Err(format!("{text:?} is not auto or none")),
        }
    }
}

/// Images of fewer bytes get no preview.
const LEAST_BYTES: usize = 16 << 10;

/// A preview has so many pixels on its longer side at least, or as many as the image.
const MIN_SIDE: usize = 32;

/// Each preview has so many times the bytes of the one before, at least: anything less can hardly be seen on the way.
const GROWTH: usize = 4;

/// The quality of previews as JPEG.
const QUALITY: u8 = 75;

/// The previews that an image may have.
struct Shape {
    /// By what the sides of the image are divided, fine before coarse.
    divisors: &'static [usize],
    /// The finest has at most this part of the bytes of the image; all together less than a third more.
    part: usize,
    /// Pixels on the longer side, at most.
    most: usize,
}

/// Of an image whose first piece comes soon.
const IN_PIECES: Shape = Shape { divisors: &[8, 16, 32, 64], part: 45, most: 128 };

/// Of an image that comes whole or not at all.
const IN_ONE: Shape = Shape { divisors: &[4, 8, 16, 32, 64], part: 23, most: 1024 };

/// Make previews of the images of an appearance that have none.
pub fn add_previews(appearance: &mut Appearance, previews: Previews) {
    if previews == Previews::None {
        return;
    }
    let colour = colours(appearance);
    for (number, image) in appearance.images.iter_mut().enumerate() {
        if image.previews.is_empty() && image.bytes.len() >= LEAST_BYTES {
            // What cannot be read has no preview; whoever shows the image will say why.
            image.previews = of(&image.bytes, colour.get(number) == Some(&true)).unwrap_or_default();
        }
    }
}

/// The previews of one image, coarse before fine.
fn of(file: &[u8], colour: bool) -> Result<Vec<Vec<u8>>, Unsupported> {
    if is_jpeg(file) {
        let eighth = eighth(file)?;
        return pyramid(&IN_PIECES, file.len(), [eighth.width, eighth.height], |size| {
            from_eighth(&eighth, size).file(colour)
        });
    }
    // The finest size from the file, others from it.
    let mut finest: Option<Small> = None;
    let size = png_size(file)?;
    pyramid(&IN_ONE, file.len(), size, |size| {
        if let Some(fine) = &finest {
            return fine.smaller(size).file(colour);
        }
        let fine = from_png(file, size)?;
        let made = fine.file(colour);
        finest = Some(fine);
        made
    })
}

/// Pictures of fewer and fewer pixels, as far as they are worth their bytes; coarse before fine.
fn pyramid(
    shape: &Shape,
    bytes: usize,
    [width, height]: [usize; 2],
    mut make: impl FnMut([usize; 2]) -> Result<Vec<u8>, Unsupported>,
) -> Result<Vec<Vec<u8>>, Unsupported> {
    let long = width.max(height).max(1);
    let mut room = bytes / shape.part;
    let mut out = Vec::new();
    for divisor in shape.divisors {
        let side = long / divisor;
        if side > shape.most || side < MIN_SIDE {
            continue;
        }
        let part = |n: usize| ((n * side + long / 2) / long).max(1);
        let file = make([part(width), part(height)])?;
        if file.len() <= room {
            room = file.len() / GROWTH;
            out.push(file);
        }
    }
    out.reverse();
    Ok(out)
}

/// A small picture.
struct Small {
    size: [usize; 2],
    /// 1 grey, 3 colours, each and alpha.
    channels: usize,
    samples: Vec<u8>,
}

impl Small {
    fn has_alpha(&self) -> bool {
        self.channels.is_multiple_of(2)
    }

    fn smaller(&self, size: [usize; 2]) -> Small {
        let mut boxes = Boxes::new(self.size, size, self.channels);
        self.samples.chunks_exact(self.size[0] * self.channels).for_each(|row| boxes.row(row));
        Small { size, channels: self.channels, samples: boxes.out }
    }

    /// As a file.
    fn file(&self, colour: bool) -> Result<Vec<u8>, Unsupported> {
        const WRONG: Unsupported = Unsupported("its preview cannot be written");
        let [width, height] = self.size;
        let [Ok(width), Ok(height)] = [u16::try_from(width), u16::try_from(height)] else { return Err(WRONG) };
        if self.has_alpha() {
            let mut out = Vec::new();
            let mut encoder = png::Encoder::new(&mut out, width.into(), height.into());
            encoder.set_color(if self.channels == 2 { png::ColorType::GrayscaleAlpha } else { png::ColorType::Rgba });
            encoder.set_depth(png::BitDepth::Eight);
            let mut writer = encoder.write_header().map_err(|_| WRONG)?;
            writer.write_image_data(&self.samples).map_err(|_| WRONG)?;
            writer.finish().map_err(|_| WRONG)?;
            return Ok(out);
        }
        let grey = self.channels == 1 || self.samples.chunks_exact(3).all(|p| p[0] == p[1] && p[1] == p[2]);
        let first: Vec<u8>;
        let (samples, sampling) = match (grey, colour) {
            (true, _) => {
                first = self.samples.iter().copied().step_by(self.channels).collect();
                (&first, Sampling::Grey)
            }
            (_, true) => (&self.samples, Sampling::Halved),
            (_, false) => (&self.samples, Sampling::Full),
        };
        jpeg(&Pixels { width, height, samples, profile: None }, QUALITY, sampling)
    }
}

/// Means of boxes of pixels, which come row by row.
struct Boxes {
    from: [usize; 2],
    to: [usize; 2],
    channels: usize,
    /// Rows that have come.
    rows: usize,
    /// For each pixel of the row that is being made the sums of its channels, colours times alpha where there is alpha.
    sums: Vec<u64>,
    out: Vec<u8>,
}

impl Boxes {
    /// From a picture of `from` pixels to one of `to`, no more on either side.
    fn new(from: [usize; 2], to: [usize; 2], channels: usize) -> Self {
        let to = [0, 1].map(|k| to[k].clamp(1, from[k].max(1)));
        let out = Vec::with_capacity(to[0] * to[1] * channels);
        Boxes { from, to, channels, rows: 0, sums: vec![0; to[0] * channels], out }
    }

    /// Where the box of a pixel begins, across or down.
    fn start(&self, axis: usize, pixel: usize) -> usize {
        pixel * self.from[axis] / self.to[axis]
    }

    fn row(&mut self, row: &[u8]) {
        let n = self.channels;
        let alpha = n.is_multiple_of(2);
        for pixel in 0..self.to[0] {
            let range = self.start(0, pixel) * n..self.start(0, pixel + 1) * n;
            let sums = &mut self.sums[pixel * n..][..n];
            for p in row.get(range).unwrap_or_default().chunks_exact(n) {
                let weight = if alpha { u64::from(p[n - 1]) } else { 1 };
                let colours = n - usize::from(alpha);
                for (sum, &c) in sums.iter_mut().zip(&p[..colours]) {
                    *sum += u64::from(c) * weight;
                }
                if alpha {
                    sums[n - 1] += weight;
                }
            }
        }
        self.rows += 1;
        let (made, width) = (self.out.len() / (self.to[0] * n), self.to[0]);
        let (top, bottom) = (self.start(1, made), self.start(1, made + 1));
        if made >= self.to[1] || self.rows < bottom {
            return;
        }
        // No colour where nothing is seen of it.
        let mean = |sum: u64, of: u64| (sum + of / 2).checked_div(of).unwrap_or(0).min(255) as u8;
        for pixel in 0..width {
            let count = ((self.start(0, pixel + 1) - self.start(0, pixel)) * (bottom - top)) as u64;
            let sums = &self.sums[pixel * n..][..n];
            if alpha {
                self.out.extend(sums[..n - 1].iter().map(|&sum| mean(sum, sums[n - 1])));
                self.out.push(mean(sums[n - 1], count));
            } else {
                self.out.extend(sums.iter().map(|&sum| mean(sum, count)));
            }
        }
        self.sums.fill(0);
    }
}

/// A picture of the given size from the first coefficients of a JPEG.
fn from_eighth(eighth: &Eighth, size: [usize; 2]) -> Small {
    let planes: Vec<([usize; 2], Vec<u8>)> = eighth
        .planes
        .iter()
        .map(|Means { width, height, samples }| {
            let mut boxes = Boxes::new([*width, *height], size, 1);
            samples.chunks_exact(*width).for_each(|row| boxes.row(row));
            (boxes.to, boxes.out)
        })
        .collect();
    let mut samples = Vec::with_capacity(size[0] * size[1] * planes.len());
    for y in 0..size[1] {
        for x in 0..size[0] {
            // A component of fewer samples repeats them.
            let mut values = planes.iter().map(|([w, h], means)| means[y * h / size[1] * w + x * w / size[0]]);
            let pixel = [values.next(), values.next(), values.next()].map(Option::unwrap_or_default);
            match planes.len() {
                1 => samples.push(pixel[0]),
                _ if eighth.rgb => samples.extend(pixel),
                _ => samples.extend(to_rgb(pixel)),
            }
        }
    }
    Small { size, channels: planes.len(), samples }
}

/// Red, green and blue of luma, blue and red of JFIF.
fn to_rgb([y, b, r]: [u8; 3]) -> [u8; 3] {
    // Fractions of 2^16.
    let (y, b, r) = ((i32::from(y) << 16) + (1 << 15), i32::from(b) - 128, i32::from(r) - 128);
    [y + 91_881 * r, y - 22_554 * b - 46_802 * r, y + 116_130 * b].map(|c| (c >> 16).clamp(0, 255) as u8)
}

const NO_PNG: Unsupported = Unsupported("it is neither a PNG nor a JPEG that is read");

/// A PNG file about to be read in rows of eight bits a sample, if it is not interlaced and no larger than its bytes allow.
fn open(file: &[u8]) -> Result<png::Reader<Cursor<&[u8]>>, Unsupported> {
    if !is_png(file) {
        return Err(NO_PNG);
    }
    // So many pixels take a minute, and nobody makes pixels of them later.
    if size_in_head(file).is_none_or(|[width, height]| u64::from(width) * u64::from(height) > MOST_PIXELS) {
        return Err(NO_PNG);
    }
    let limits = png::Limits { bytes: MOST_BESIDE_PIXELS };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(file), limits);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_ignore_text_chunk(true);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let reader = decoder.read_info().map_err(|_| NO_PNG)?;
    let info = reader.info();
    // Deflate makes a thousand bytes of one at most: what a head promises beyond that is not there.
    let promised = (info.raw_row_length() as u64).saturating_mul(info.height.into());
    if info.interlaced || info.animation_control.is_some() || promised > file.len() as u64 * 1100 {
        return Err(NO_PNG);
    }
    Ok(reader)
}

fn png_size(file: &[u8]) -> Result<[usize; 2], Unsupported> {
    let reader = open(file)?;
    let (width, height) = reader.info().size();
    Ok([width as usize, height as usize])
}

/// A picture of the given size from the pixels of a PNG; without its alpha where nothing is transparent.
fn from_png(file: &[u8], size: [usize; 2]) -> Result<Small, Unsupported> {
    let mut reader = open(file)?;
    let (width, height) = reader.info().size();
    let channels = match reader.output_color_type().0 {
        png::ColorType::Grayscale => 1,
        png::ColorType::GrayscaleAlpha => 2,
        png::ColorType::Rgb => 3,
        png::ColorType::Rgba => 4,
        png::ColorType::Indexed => return Err(NO_PNG),
    };
    let mut boxes = Boxes::new([width as usize, height as usize], size, channels);
    let mut opaque = true;
    while let Some(row) = reader.next_row().map_err(|_| NO_PNG)? {
        boxes.row(row.data());
        opaque &= channels % 2 == 1 || row.data().chunks_exact(channels).all(|p| p[channels - 1] == 255);
    }
    let mut small = Small { size, channels, samples: boxes.out };
    if small.samples.len() != size[0] * size[1] * channels {
        return Err(NO_PNG);
    }
    if opaque && small.has_alpha() {
        small.channels -= 1;
        small.samples = small.samples.chunks_exact(channels).flat_map(|p| &p[..channels - 1]).copied().collect();
    }
    Ok(small)
}

#[cfg(test)]
mod tests;
