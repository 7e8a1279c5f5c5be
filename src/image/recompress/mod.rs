//! Images of other formats as JPEG: much smaller, in pieces, and not exact.
//!
//! What an image is for decides how: normals, metalness, roughness, occlusion and whatever is not known keep all samples of all components at
//! the same precision. Colours get less precision than brightness, as the eye does, and half the samples across and down where that
//! loses next to nothing; colour that changes from pixel to pixel keeps them all. Grey is grey. What JPEG cannot say, alpha and 16 bits,
//! stays as it is, and so does what would not become smaller. Invariant: a JPEG is never touched; [`texture`](crate::image::jpeg) carries it exactly.

use std::fmt;
use std::io::Cursor;
use std::str::FromStr;

use serde_json::Value;

pub use crate::image::jpeg::Sampling;
use crate::image::jpeg::{Exactness, MOST_PIXELS, Pixels, Unsupported, jpeg, loss_by_halving};
use crate::image::signature::{is_jpeg, is_png};
use crate::mesh::{Appearance, Image};

/// What becomes of images that are no JPEG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Textures {
    /// They stay as they are, byte by byte.
    Keep,
    /// They become JPEG of a quality at which nobody sees the difference, [`COLOUR`] or [`DATA`], where that can say what they say.
    #[default]
    Fine,
    /// They become JPEG of this quality, 1 to 100, where that can say what they say.
    Jpeg(u8),
}

/// The quality of colours, or of grey, by [`Textures::Fine`]: an MS-SSIM above 0.997 on all real ones.
pub const COLOUR: u8 = 92;
/// The quality of normals and other data by [`Textures::Fine`]: 41 dB or more on all real ones.
pub const DATA: u8 = 95;

/// Colours whose components lose more than this by halving, in 256ths of a squared step, keep all samples: it is about what
/// quantization costs a picture at a quality of 92, and far between photographs (up to 2.3 steps) and fabric or flat paint (from 3.8).
const MOST_LOST: u64 = 3 << 8;

impl Textures {
    /// The quality of an image of colours, or of one of data; `None` where images stay as they are.
    fn quality(self, colour: bool) -> Option<u8> {
        match self {
            Textures::Keep => None,
            Textures::Fine => Some(if colour { COLOUR } else { DATA }),
            Textures::Jpeg(quality) => Some(quality),
        }
    }
}

impl Textures {
    /// What applies where nobody chose: [`Textures::Fine`], but where the very bytes of images are asked for, [`Textures::Keep`].
    pub fn beside(images: Exactness) -> Self {
        match images {
            Exactness::Bytes => Textures::Keep,
            Exactness::Coefficients => Textures::Fine,
        }
    }
}

impl fmt::Display for Textures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Textures::Keep => write!(f, "keep"),
            Textures::Fine => write!(f, "jpeg"),
            Textures::Jpeg(quality) => write!(f, "jpeg:{quality}"),
        }
    }
}

impl FromStr for Textures {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "keep" => return Ok(Textures::Keep),
            "jpeg" => return Ok(Textures::Fine),
            _ => {}
        }
        let quality = text.strip_prefix("jpeg:").and_then(|q| q.parse::<u8>().ok()).filter(|q| (1..=100).contains(q));
        quality
            .map(Textures::Jpeg)
            .ok_or_else(|| format!("{text:?} is not keep, jpeg, or jpeg:QUALITY from 1 to 100, as in jpeg:90"))
    }
}

/// What became of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recompressed {
    /// The number of the image.
    pub image: usize,
    /// Its name, or `image` and its number where it has none.
    pub name: String,
    /// Bytes of its file before.
    pub from: u64,
    /// Bytes of its file now.
    pub to: u64,
    /// How it is sampled as a JPEG, or why it stayed as it is.
    pub outcome: Result<Sampling, Unsupported>,
}

impl fmt::Display for Recompressed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Recompressed { name, from, to, outcome, .. } = self;
        match outcome {
            Ok(Sampling::Grey) => write!(f, "{name}: a grey JPEG now, not exact: {to} bytes from {from}"),
            Ok(Sampling::Halved) => {
                write!(f, "{name}: a JPEG of colour (4:2:0) now, not exact: {to} bytes from {from}")
            }
            Ok(Sampling::Sharp) => {
                write!(f, "{name}: a JPEG of colour (4:4:4) now, not exact: {to} bytes from {from}")
            }
            Ok(Sampling::Full) => write!(f, "{name}: a JPEG of data (4:4:4) now, not exact: {to} bytes from {from}"),
            Err(odd) => write!(f, "{name}: kept as it is: {odd}"),
        }
    }
}

/// Make JPEG of the images that are none, as `textures` says. Returns what became of those, in their order; images that are JPEG already, and
/// those that were not there, are not among them.
pub fn recompress(appearance: &mut Appearance, textures: Textures) -> Vec<Recompressed> {
    let colour = colours(appearance);
    let mut out = Vec::new();
    for (number, image) in appearance.images.iter_mut().enumerate() {
        let colour = colour.get(number) == Some(&true);
        let Some(quality) = textures.quality(colour) else { continue };
        if image.bytes.is_empty() || is_jpeg(&image.bytes) {
            continue;
        }
        let name = if image.name.is_empty() { format!("image {number}") } else { image.name.clone() };
        let from = image.bytes.len() as u64;
        let outcome = recompress_one(image, quality, colour);
        out.push(Recompressed { image: number, name, from, to: image.bytes.len() as u64, outcome });
    }
    out
}

fn recompress_one(image: &mut Image, quality: u8, colour: bool) -> Result<Sampling, Unsupported> {
    let picture = read(&image.bytes)?;
    let Picture { width, height, channels, ref samples, ref profile } = picture;
    let sampling = match (channels, colour) {
        (1, _) => Sampling::Grey,
        (_, false) => Sampling::Full,
        (_, true) if loss_by_halving(width as usize, samples) > MOST_LOST => Sampling::Sharp,
        (_, true) => Sampling::Halved,
    };
    let file = jpeg(&Pixels { width, height, samples, profile: profile.as_deref() }, quality, sampling)?;
    if file.len() >= image.bytes.len() {
        return Err(Unsupported("it would not become smaller"));
    }
    (image.bytes, image.mime) = (file, "image/jpeg".to_string());
    Ok(sampling)
}

/// For each image whether it is a texture of colours, and of nothing else.
pub(super) fn colours(appearance: &Appearance) -> Vec<bool> {
    // Of each image whether it is used for colours, and for other things.
    let mut uses = vec![[false; 2]; appearance.images.len()];
    let textures: Vec<Value> =
        appearance.textures.iter().map(|t| serde_json::from_str(t).unwrap_or_default()).collect();
    let mut use_texture = |number: u64, other: bool| {
        let Some(texture) = usize::try_from(number).ok().and_then(|n| textures.get(n)) else { return };
        let extensions = texture["extensions"].as_object().into_iter().flat_map(|e| e.values());
        for source in std::iter::once(texture).chain(extensions).filter_map(|t| t["source"].as_u64()) {
            if let Some(uses) = usize::try_from(source).ok().and_then(|s| uses.get_mut(s)) {
                uses[usize::from(other)] = true;
            }
        }
    };
    for material in &appearance.materials {
        let mut open: Vec<Value> = vec![serde_json::from_str(material).unwrap_or_default()];
        while let Some(value) = open.pop() {
            let Value::Object(members) = value else { continue };
            for (key, member) in members {
                if let (Some(number), true) = (member["index"].as_u64(), key.ends_with("Texture")) {
                    let colour = ["baseColorTexture", "emissiveTexture"].contains(&key.as_str())
                        || key.ends_with("ColorTexture")
                        || key == "diffuseTexture";
                    use_texture(number, !colour);
                }
                open.push(member);
            }
        }
    }
    uses.into_iter().map(|u| u == [true, false]).collect()
}

/// Decoded pixels: one or three bytes each.
struct Picture {
    width: u16,
    height: u16,
    channels: usize,
    samples: Vec<u8>,
    profile: Option<Vec<u8>>,
}

/// Bytes that the library may take for what is not pixels, such as a colour profile, which in a JPEG has 16 MB at most.
pub(crate) const MOST_BESIDE_PIXELS: usize = 32 << 20;

/// The width and height in the head of a PNG.
pub(crate) fn png_size(bytes: &[u8]) -> Option<[u32; 2]> {
    let head = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(4..16)?.strip_prefix(b"IHDR")?;
    let word = |at: usize| head.get(at..)?.first_chunk().map(|w| u32::from_be_bytes(*w));
    Some([word(0)?, word(4)?])
}

/// Whether a PNG has a colour profile before its pixels.
fn has_profile(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((length, kind)) = rest.first_chunk().zip(rest.get(4..8)) {
        if kind == b"iCCP" || kind == b"IDAT" {
            return kind == b"iCCP";
        }
        rest = rest.get(u32::from_be_bytes(*length) as usize + 12..).unwrap_or_default();
    }
    false
}

fn read(bytes: &[u8]) -> Result<Picture, Unsupported> {
    const DAMAGED: Unsupported = Unsupported("it is damaged");
    if !is_png(bytes) {
        return Err(Unsupported("it is neither PNG nor JPEG"));
    }
    // What its size alone rules out is not unpacked; a profile that no JPEG could hold is damage.
    if png_size(bytes).is_some_and(|[width, height]| u64::from(width) * u64::from(height) > MOST_PIXELS) {
        return Err(Unsupported("it has more than 268,435,456 pixels"));
    }
    let limits = png::Limits { bytes: MOST_BESIDE_PIXELS };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| match e {
        png::DecodingError::LimitsExceeded => Unsupported("its colour profile or other metadata are too large"),
        _ => DAMAGED,
    })?;
    let info = reader.info();
    if info.bit_depth == png::BitDepth::Sixteen {
        return Err(Unsupported("it has 16 bits per sample"));
    }
    if info.animation_control.is_some() {
        return Err(Unsupported("it is animated"));
    }
    let profile = info.icc_profile.as_ref().map(|p| p.to_vec());
    // The library passes over a profile that it cannot read; what colours mean would be lost with it.
    if profile.is_none() && has_profile(bytes) {
        return Err(Unsupported("its colour profile is damaged or too large"));
    }
    let (width, height) = info.size();
    let (Ok(width), Ok(height)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(Unsupported("it has more than 65,535 pixels across or down"));
    };
    // Deflate makes a thousand bytes of one at most: what a head promises beyond that is not there.
    if info.raw_row_length() as u64 * info.height as u64 > bytes.len() as u64 * 1100 {
        return Err(DAMAGED);
    }
    let mut samples = vec![0; reader.output_buffer_size().ok_or(DAMAGED)?];
    let frame = reader.next_frame(&mut samples).map_err(|_| DAMAGED)?;
    samples.truncate(frame.buffer_size());
    let (channels, alpha) = match frame.color_type {
        png::ColorType::Grayscale => (1, false),
        png::ColorType::GrayscaleAlpha => (2, true),
        png::ColorType::Rgb => (3, false),
        png::ColorType::Rgba => (4, true),
        png::ColorType::Indexed => return Err(DAMAGED),
    };
    if samples.len() != width as usize * height as usize * channels {
        return Err(DAMAGED);
    }
    if alpha && samples.chunks_exact(channels).any(|p| p[channels - 1] != 255) {
        return Err(Unsupported("it has alpha"));
    }
    // In place: only what differs in all pixels stays.
    let plain = channels - usize::from(alpha);
    let grey = plain == 1 || samples.chunks_exact(channels).all(|p| p[0] == p[1] && p[1] == p[2]);
    let kept = if grey { 1 } else { 3 };
    if kept < channels {
        let count = samples.len() / channels;
        for k in 0..count {
            samples.copy_within(channels * k..channels * k + kept, kept * k);
        }
        samples.truncate(kept * count);
    }
    Ok(Picture { width, height, channels: kept, samples, profile })
}

#[cfg(test)]
mod tests;
