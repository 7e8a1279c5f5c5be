//! Images as textures: decoding PNG and JPEG, a pyramid of sizes, and values between texels.
//!
//! Texels are kept in linear light, 16 bits a channel. Each size of the pyramid is the mean of two by two texels of the one before, and a
//! value is blended within two neighbouring sizes and between them (trilinear), so that a picture changes gently with the size of
//! the triangles that the texture lies on.

use crate::image::signature::media_type;
use std::io::Cursor;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Pixels that an image may have; more would take over half a gigabyte as a texture.
const MOST_PIXELS: u64 = 1 << 26;

/// A decoded image: eight bits of red, green, blue and alpha each, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Four bytes per pixel.
    pub rgba: Vec<u8>,
}

/// Decode a PNG or JPEG file, told apart by their first bytes.
///
/// # Errors
/// One line on what is wrong: another format, a damaged file, too many pixels.
pub fn decode(bytes: &[u8]) -> Result<Pixels, String> {
    let line = |text: String| text.split_whitespace().collect::<Vec<&str>>().join(" ");
    match media_type(bytes) {
        _ if bytes.is_empty() => Err("the image was not there".into()),
        Some("image/png") => decode_png(bytes).map_err(|e| format!("not a sound PNG file: {}", line(e))),
        Some("image/jpeg") => decode_jpeg(bytes).map_err(|e| format!("not a sound JPEG file: {}", line(e))),
        _ => Err("neither PNG nor JPEG; other images are not drawn".into()),
    }
}

fn check_size(width: u64, height: u64) -> Result<(), String> {
    match width.checked_mul(height) {
        Some(1..=MOST_PIXELS) => Ok(()),
        _ => Err(format!("{width} by {height} pixels are not drawn; make it smaller")),
    }
}

fn decode_png(bytes: &[u8]) -> Result<Pixels, String> {
    // Rows and what is not pixels; those are taken below, once their number is known to be drawn.
    let limits = png::Limits { bytes: 1 << 24 };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_ignore_text_chunk(true);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let (width, height) = reader.info().size();
    check_size(u64::from(width), u64::from(height))?;
    let mut data = vec![0; reader.output_buffer_size().ok_or("too large")?];
    let frame = reader.next_frame(&mut data).map_err(|e| e.to_string())?;
    data.truncate(frame.buffer_size());
    let rgba = match frame.color_type {
        png::ColorType::Grayscale => data.iter().flat_map(|&g| [g, g, g, 255]).collect(),
        png::ColorType::GrayscaleAlpha => data.chunks_exact(2).flat_map(|p| [p[0], p[0], p[0], p[1]]).collect(),
        png::ColorType::Rgb => data.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect(),
        png::ColorType::Rgba => data,
        png::ColorType::Indexed => return Err("its palette is missing".into()),
    };
    whole(Pixels { width, height, rgba })
}

fn decode_jpeg(bytes: &[u8]) -> Result<Pixels, String> {
    let side = MOST_PIXELS as usize;
    let options =
        DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGBA).set_max_width(side).set_max_height(side);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("no size")?;
    check_size(width as u64, height as u64)?;
    let rgba = decoder.decode().map_err(|e| e.to_string())?;
    whole(Pixels { width: width as u32, height: height as u32, rgba })
}

fn whole(pixels: Pixels) -> Result<Pixels, String> {
    if pixels.rgba.len() == 4 * pixels.width as usize * pixels.height as usize {
        Ok(pixels)
    } else {
        Err("some of its pixels are missing".into())
    }
}

/// What lies beyond the edges of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrap {
    Repeat,
    Clamp,
    Mirror,
}

impl Wrap {
    /// By the number that OpenGL and glTF give it.
    pub(super) fn from_number(number: u64) -> Self {
        match number {
            33071 => Wrap::Clamp,
            33648 => Wrap::Mirror,
            _ => Wrap::Repeat,
        }
    }

    fn place(self, i: i64, n: i64) -> usize {
        (match self {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp => i.clamp(0, n - 1),
            Wrap::Mirror => {
                let j = i.rem_euclid(2 * n);
                j.min(2 * n - 1 - j)
            }
        }) as usize
    }
}

/// An image in all sizes.
pub(super) struct Texture {
    /// Each half of the one before, rounded down, to a single texel.
    pub(super) sizes: Vec<Size>,
}

/// An image in one of its sizes.
pub(super) struct Size {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Linear red, green, blue, and alpha, row by row.
    pub(super) texels: Vec<[u16; 4]>,
}

impl Texture {
    pub(super) fn new(pixels: &Pixels) -> Self {
        let linear: Vec<u16> = (0..=255u8).map(|c| (to_linear(f32::from(c) / 255.0) * 65535.0 + 0.5) as u16).collect();
        let texels = pixels
            .rgba
            .chunks_exact(4)
            .map(|p| [linear[p[0] as usize], linear[p[1] as usize], linear[p[2] as usize], u16::from(p[3]) * 257])
            .collect();
        let mut sizes = vec![Size { width: pixels.width as usize, height: pixels.height as usize, texels }];
        while let Some(next) = sizes.last().and_then(Size::half) {
            sizes.push(next);
        }
        Texture { sizes }
    }

    /// Texels of the full size.
    pub(super) fn texels(&self) -> f64 {
        self.sizes[0].texels.len() as f64
    }

    /// The colour and alpha at `u`, `v` (downwards), in linear light; `level` 0 is the full size, 1 half of it.
    pub(super) fn sample(&self, u: f32, v: f32, level: f32, wrap: [Wrap; 2]) -> [f32; 4] {
        let level = level.clamp(0.0, (self.sizes.len() - 1) as f32);
        let fine = level as usize;
        let t = level - fine as f32;
        let a = self.sizes[fine].sample(u, v, wrap);
        if t == 0.0 {
            return a;
        }
        let b = self.sizes[fine + 1].sample(u, v, wrap);
        std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
    }
}

impl Size {
    fn half(&self) -> Option<Size> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            let rows = [2 * y, (2 * y + 1).min(self.height - 1)];
            for x in 0..width {
                let columns = [2 * x, (2 * x + 1).min(self.width - 1)];
                let four =
                    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(c, r)| self.texels[rows[r] * self.width + columns[c]]);
                texels.push(std::array::from_fn(|k| {
                    ((four.iter().map(|t| u32::from(t[k])).sum::<u32>() + 2) / 4) as u16
                }));
            }
        }
        Some(Size { width, height, texels })
    }

    fn sample(&self, u: f32, v: f32, wrap: [Wrap; 2]) -> [f32; 4] {
        let (x, y) = (u * self.width as f32 - 0.5, v * self.height as f32 - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        let columns = [0, 1].map(|i| wrap[0].place(left as i64 + i, self.width as i64));
        let rows = [0, 1].map(|i| wrap[1].place(top as i64 + i, self.height as i64));
        let at = |c: usize, r: usize| self.texels[rows[r] * self.width + columns[c]].map(f32::from);
        let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
        std::array::from_fn(|k| {
            let (upper, lower) = (a[k] + s * (b[k] - a[k]), c[k] + s * (d[k] - c[k]));
            (upper + t * (lower - upper)) / 65535.0
        })
    }
}

/// sRGB, 0 to 1, into linear light.
pub(super) fn to_linear(c: f32) -> f32 {
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Linear light, 0 to 1, into sRGB.
pub(super) fn to_srgb(c: f32) -> f32 {
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkers(n: u32) -> Pixels {
        let rgba = (0..n * n).flat_map(|i| if (i + i / n) & 1 == 0 { [255; 4] } else { [0, 0, 0, 255] }).collect();
        Pixels { width: n, height: n, rgba }
    }

    #[test]
    fn values_between_texels_and_sizes() {
        let texture = Texture::new(&checkers(8));
        let wrap = [Wrap::Repeat; 2];
        assert_eq!(texture.sizes.len(), 4);
        // In the middle of a texel its own value; between four of them, and in every smaller size, the mean.
        assert_eq!(texture.sample(0.5 / 8.0, 0.5 / 8.0, 0.0, wrap)[0], 1.0);
        assert_eq!(texture.sample(1.5 / 8.0, 0.5 / 8.0, 0.0, wrap)[0], 0.0);
        for (u, v, level) in [(0.25, 0.5, 0.0), (0.3, 0.7, 1.0), (0.1, 0.9, 9.0)] {
            assert!((texture.sample(u, v, level, wrap)[0] - 0.5).abs() < 1e-4);
        }
        assert!((texture.sample(0.5 / 8.0, 0.5 / 8.0, 0.5, wrap)[0] - 0.75).abs() < 1e-4);
    }

    #[test]
    fn edges_repeat_stay_or_turn_round() {
        assert_eq!([-1, 0, 3, 4, 5, 9].map(|i| Wrap::Repeat.place(i, 4)), [3, 0, 3, 0, 1, 1]);
        assert_eq!([-1, 0, 3, 4, 5, 9].map(|i| Wrap::Clamp.place(i, 4)), [0, 0, 3, 3, 3, 3]);
        assert_eq!([-1, 0, 3, 4, 5, 9].map(|i| Wrap::Mirror.place(i, 4)), [0, 0, 3, 3, 2, 1]);
        assert_eq!((Wrap::from_number(33071), Wrap::from_number(0)), (Wrap::Clamp, Wrap::Repeat));
    }

    #[test]
    fn images_are_decoded_or_say_why_not() {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&[0x80, 0, 0xff, 0xff]).unwrap();
        assert_eq!(decode(&bytes).unwrap().rgba, [128, 128, 128, 255, 255, 255, 255, 255]);
        for (bytes, says) in [
            (&bytes[..20], "not a sound PNG file"),
            (&[0xff, 0xd8, 0xff, 0xe0][..], "not a sound JPEG file"),
            (b"GIF89a", "neither PNG nor JPEG"),
            (b"", "the image was not there"),
        ] {
            let error = decode(bytes).unwrap_err();
            assert!(error.starts_with(says) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn srgb_there_and_back() {
        for c in 0..=255u8 {
            let back = to_srgb(to_linear(f32::from(c) / 255.0)) * 255.0;
            assert!((back - f32::from(c)).abs() < 1e-3);
        }
    }
}
