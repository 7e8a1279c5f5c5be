//! Pixels into progressive files: colour, subsampling, cosine transform, quantization (T.81, annexes A.3 and K.1; JFIF).
//!
//! The one place where a picture loses something, and only where the user asks for it. Integers throughout: a file is the same on every
//! machine. Data of other kinds than colour ([`Sampling::Full`]) take the finer of the two usual tables for all components and no subsampling.

use super::frame::{Frame, Parsed};
use super::{END, MAX_COEFFICIENT_BYTES, Unsupported, progressive};

/// How the components of a picture are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// One component.
    Grey,
    /// Three, those of colour with half the samples across and down (4:2:0).
    Halved,
    /// Three, those of colour with all samples (4:4:4), as precise as the eye needs them.
    Sharp,
    /// Three, all with all samples and the same precision (4:4:4).
    Full,
}

/// Pixels of a picture, rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// Pixels per row.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// One byte per pixel for [`Sampling::Grey`], else three.
    pub samples: &'a [u8],
    /// The profile of its colours, if it has one.
    pub profile: Option<&'a [u8]>,
}

/// Place in a block, row by row, of each coefficient in the order of files.
const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21,
    28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54,
    47, 55, 62, 63,
];

/// The tables of K.1, for luma and for chroma, row by row.
const STEPS: [[u8; 64]; 2] = [
    [
        16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29,
        51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121,
        120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
    ],
    [
        17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99, 47, 66, 99, 99,
        99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
        99, 99, 99, 99, 99, 99, 99, 99,
    ],
];

/// A table for a quality of 1 to 100, in the order of files, as libjpeg scales it.
fn steps(which: usize, quality: u8) -> [u8; 64] {
    let quality = i32::from(quality.clamp(1, 100));
    let scale = if quality < 50 { 5000 / quality } else { 200 - 2 * quality };
    ZIGZAG.map(|at| ((i32::from(STEPS[which][at as usize]) * scale + 50) / 100).clamp(1, 255) as u8)
}

/// The progressive file of a picture, of a quality of 1 to 100.
///
/// # Errors
/// [`Unsupported`] where the picture has no pixels, not as many as it says, or too many.
pub fn jpeg(pixels: &Pixels<'_>, quality: u8, sampling: Sampling) -> Result<Vec<u8>, Unsupported> {
    let (width, height) = (pixels.width as usize, pixels.height as usize);
    let channels = if sampling == Sampling::Grey { 1 } else { 3 };
    if pixels.samples.len() != width * height * channels || pixels.samples.is_empty() {
        return Err(Unsupported("its pixels are not as many as it says"));
    }
    // A table for each component; those of colour have the coarser one where they are colour.
    let table = |c: usize| usize::from(c > 0 && matches!(sampling, Sampling::Halved | Sampling::Sharp));
    let tables = 0..=table(channels - 1);
    let mut out = vec![0xFF, 0xD8, 0xFF, 0xE0, 0, 16];
    out.extend_from_slice(b"JFIF\0\x01\x01\0\0\x01\0\x01\0\0");
    // A segment has 65,535 bytes at most, and a profile its number and that of all segments in each of its own.
    let parts: Vec<&[u8]> = pixels.profile.unwrap_or_default().chunks(65_519).collect();
    if let Ok(count) = u8::try_from(parts.len()) {
        for (k, part) in (1..=count).zip(parts) {
            out.extend_from_slice(&[0xFF, 0xE2]);
            out.extend_from_slice(&(part.len() as u16 + 16).to_be_bytes());
            out.extend_from_slice(b"ICC_PROFILE\0");
            out.extend_from_slice(&[k, count]);
            out.extend_from_slice(part);
        }
    }
    for which in tables {
        out.extend_from_slice(&[0xFF, 0xDB, 0, 67, which as u8]);
        out.extend_from_slice(&steps(which, quality));
    }
    let mut body = vec![8];
    body.extend_from_slice(&pixels.height.to_be_bytes());
    body.extend_from_slice(&pixels.width.to_be_bytes());
    body.push(channels as u8);
    for c in 0..channels {
        let halved = sampling == Sampling::Halved;
        body.extend_from_slice(&[c as u8 + 1, if halved && c == 0 { 0x22 } else { 0x11 }, table(c) as u8]);
    }
    out.extend_from_slice(&[0xFF, 0xC2]);
    out.extend_from_slice(&(body.len() as u16 + 2).to_be_bytes());
    out.extend_from_slice(&body);
    let parsed = Parsed { items: Vec::new(), trailer: &[], process: 0xC2, frame: &body };
    let frame = Frame::new(&parsed, MAX_COEFFICIENT_BYTES)?;
    let mut blocks = frame.empty();
    for c in 0..channels {
        let plane = plane(pixels, c, sampling);
        let steps = steps(table(c), quality);
        frame.each_block(c, |x, y, at| blocks[at] = block(&plane, x, y, &steps));
    }
    frame.take_filling(&mut blocks);
    progressive::encode(&frame, &blocks, false, &mut out);
    out.extend_from_slice(&END);
    Ok(out)
}

/// The samples of a component.
struct Plane {
    width: usize,
    height: usize,
    samples: Vec<u8>,
}

/// Luma, blue or red of a pixel by JFIF, without the middle that is added to the last two; in fractions of 2^16.
fn component(p: &[u8], c: usize) -> i32 {
    // Each row sums to 2^16 or to 0.
    let [r, g, b] = [[19595, 38470, 7471], [-11058, -21710, 32768], [32768, -27439, -5329]][c];
    r * i32::from(p[0]) + g * i32::from(p[1]) + b * i32::from(p[2])
}

/// What blue and red of JFIF lose where four pixels share one sample: the mean square of their differences, in 256ths of a squared step of 8 bits.
/// `samples` has three bytes per pixel, rows from the top; what has no partner at the edges is left out.
pub fn loss_by_halving(width: usize, samples: &[u8]) -> u64 {
    let (mut sum, mut count) = (0u64, 0u64);
    for rows in samples.chunks_exact((6 * width).max(1)) {
        let (upper, lower) = rows.split_at(3 * width);
        let mut here = 0u64;
        for (a, b) in upper.chunks_exact(6).zip(lower.chunks_exact(6)) {
            for c in 1..3 {
                // Eight bits of fraction are enough; with the four of the sum a difference has ten.
                let four = [&a[..3], &a[3..], &b[..3], &b[3..]].map(|p| component(p, c) >> 8);
                let all: i32 = four.iter().sum();
                here += four.iter().map(|v| u64::from((4 * v - all).unsigned_abs())).map(|d| d * d).sum::<u64>();
                count += 4;
            }
        }
        sum += here >> 12;
    }
    sum / count.max(1)
}

/// Component `c` of a picture: the only one, or luma, blue and red of JFIF.
fn plane(pixels: &Pixels<'_>, c: usize, sampling: Sampling) -> Plane {
    let (width, height) = (pixels.width as usize, pixels.height as usize);
    if sampling == Sampling::Grey {
        return Plane { width, height, samples: pixels.samples.to_vec() };
    }
    let middle = if c == 0 { 0 } else { 128 };
    let one = |p: &[u8]| component(p, c);
    let byte = |sum: i32, bits: u32| ((sum + (1 << (bits - 1)) >> bits) + middle).clamp(0, 255) as u8;
    if sampling != Sampling::Halved || c == 0 {
        let samples = pixels.samples.chunks_exact(3).map(|p| byte(one(p), 16)).collect();
        return Plane { width, height, samples };
    }
    let (across, down) = (width.div_ceil(2), height.div_ceil(2));
    let mut samples = Vec::with_capacity(across * down);
    for y in 0..down {
        for x in 0..across {
            let at = |dx: usize, dy: usize| {
                let (x, y) = ((2 * x + dx).min(width - 1), (2 * y + dy).min(height - 1));
                one(&pixels.samples[3 * (y * width + x)..][..3])
            };
            samples.push(byte(at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1), 18));
        }
    }
    Plane { width: across, height: down, samples }
}

/// The coefficients of the block in column `x` and row `y`; the last samples of a plane go on beyond its edges.
fn block(plane: &Plane, x: usize, y: usize, steps: &[u8; 64]) -> [i16; 64] {
    let samples: [[i32; 8]; 8] = std::array::from_fn(|j| {
        let row = (8 * y + j).min(plane.height - 1) * plane.width;
        std::array::from_fn(|i| i32::from(plane.samples[row + (8 * x + i).min(plane.width - 1)]) - 128)
    });
    // Rows, then columns. Four bits of fraction stay in between, so that sums have at most 29 bits.
    let rows = samples.map(|row| transform(row).map(|sum| sum + (1 << 9) >> 10));
    let columns: [[i32; 8]; 8] = std::array::from_fn(|i| transform(std::array::from_fn(|j| rows[j][i])));
    std::array::from_fn(|k| {
        let at = ZIGZAG[k] as usize;
        let (value, step) = (columns[at % 8][at / 8], i32::from(steps[k]) << 18);
        let size = ((value.abs() + step / 2) / step).min(1023) as i16;
        if value < 0 { -size } else { size }
    })
}

/// A cosine transform of eight samples, times 2^14.
fn transform(samples: [i32; 8]) -> [i32; 8] {
    /// Half of the cosine of `k` sixteenths of a half turn, times 2^14.
    const HALF: [i32; 9] = [8192, 8035, 7568, 6811, 5793, 4551, 3135, 1598, 0];
    const BASIS: [[i32; 8]; 8] = {
        let mut basis = [[HALF[4]; 8]; 8];
        let mut u = 1;
        while u < 8 {
            let mut x = 0;
            while x < 8 {
                let k = (2 * x + 1) * u % 32;
                let k = if k > 16 { 32 - k } else { k };
                basis[u][x] = if k > 8 { -HALF[16 - k] } else { HALF[k] };
                x += 1;
            }
            u += 1;
        }
        basis
    };
    BASIS.map(|row| row.iter().zip(&samples).map(|(a, b)| a * b).sum())
}
