//! Multi-scale structural similarity of pictures (Wang, Simoncelli, Bovik 2003; constants and weights as published).
//!
//! Five scales of the luma, each half of the one before by the mean of two by two pixels. At each the product of contrast and structure,
//! `(2 σxy + C2) / (σx² + σy² + C2)`, and at the last one luminance too, `(2 μx μy + C1) / (μx² + μy² + C1)`; means over the windows that
//! lie inside the picture, a Gaussian of 11 by 11 pixels with σ 1.5. The score is the product of the means, each to the power of its weight; a
//! negative mean counts as 0. 1 says equal.

use crate::quality::picture::Picture;
use thiserror::Error;

/// The weights of the scales, from fine to coarse.
const WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];
/// Pixels of the window's side.
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = (0.01 * 255.0) * (0.01 * 255.0);
const C2: f64 = (0.03 * 255.0) * (0.03 * 255.0);
/// The shortest side of which five scales are left that hold a window.
pub const MIN_SIDE: u32 = ((WINDOW as u32 - 1) << 4) + 1;

/// Why two pictures cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SsimError {
    /// They are not of one size.
    #[error("pictures of {0} by {1} and of {2} by {3} pixels cannot be compared; make them of one size")]
    Sizes(u32, u32, u32, u32),
    /// Too small for five scales.
    #[error("pictures of {0} by {1} pixels are too small to be compared; each side takes at least {MIN_SIDE} pixels")]
    Small(u32, u32),
}

/// The MS-SSIM of two pictures, from their luma (Rec. 601).
///
/// # Errors
/// [`SsimError`] where the sizes differ or are too small.
pub fn ms_ssim(a: &Picture, b: &Picture) -> Result<f64, SsimError> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(SsimError::Sizes(a.width, a.height, b.width, b.height));
    }
    if a.width.min(a.height) < MIN_SIDE {
        return Err(SsimError::Small(a.width, a.height));
    }
    if a.rgb == b.rgb {
        return Ok(1.0);
    }
    let (mut x, mut y) = (Plane::luma(a), Plane::luma(b));
    let mut score = 1.0;
    for (scale, weight) in WEIGHTS.into_iter().enumerate() {
        if scale > 0 {
            (x, y) = (x.half(), y.half());
        }
        let [structure, whole] = means(&x, &y);
        let mean = if scale + 1 == WEIGHTS.len() { whole } else { structure };
        score *= mean.max(0.0).powf(weight);
    }
    Ok(score)
}

/// A picture of one channel.
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    fn luma(picture: &Picture) -> Self {
        let luma = |p: &[u8]| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]);
        let values = picture.rgb.chunks_exact(3).map(luma).collect();
        Plane { width: picture.width as usize, height: picture.height as usize, values }
    }

    /// The mean of two by two pixels; a last row or column without a partner counts twice.
    fn half(&self) -> Plane {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut values = Vec::with_capacity(width * height);
        for y in 0..height {
            let rows = [2 * y, (2 * y + 1).min(self.height - 1)].map(|r| &self.values[r * self.width..][..self.width]);
            values.extend((0..width).map(|x| {
                let (l, r) = (2 * x, (2 * x + 1).min(self.width - 1));
                0.25 * (rows[0][l] + rows[0][r] + rows[1][l] + rows[1][r])
            }));
        }
        Plane { width, height, values }
    }
}

/// The Gaussian along one axis, of sum 1.
fn window() -> [f32; WINDOW] {
    let raw: [f64; WINDOW] = std::array::from_fn(|i| {
        let d = i as f64 - (WINDOW / 2) as f64;
        (-d * d / (2.0 * SIGMA * SIGMA)).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|w| (w / sum) as f32)
}

/// Means of contrast times structure, and of that times luminance, over all windows.
fn means(x: &Plane, y: &Plane) -> [f64; 2] {
    let kernel = window();
    let (width, height) = (x.width - WINDOW + 1, x.height - WINDOW + 1);
    // Five maps: both pictures, their squares, their product; about a middle grey, which the variances do not see, to spare digits.
    const GREY: f32 = 128.0;
    let mut rows: Vec<[Vec<f32>; 5]> = Vec::with_capacity(WINDOW);
    let mut sums = [0.0f64; 2];
    let mut raw: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; x.width]);
    for row in 0..x.height {
        let (a, b) = (&x.values[row * x.width..][..x.width], &y.values[row * x.width..][..x.width]);
        for i in 0..x.width {
            let (p, q) = (a[i] - GREY, b[i] - GREY);
            raw[0][i] = p;
            raw[1][i] = q;
            raw[2][i] = p * p;
            raw[3][i] = q * q;
            raw[4][i] = p * q;
        }
        // The oldest row makes room.
        let mut blurred = if rows.len() == WINDOW { rows.remove(0) } else { std::array::from_fn(|_| vec![0.0; width]) };
        for (out, raw) in blurred.iter_mut().zip(&raw) {
            out.fill(0.0);
            for (k, w) in kernel.iter().enumerate() {
                for (o, v) in out.iter_mut().zip(&raw[k..]) {
                    *o += w * v;
                }
            }
        }
        rows.push(blurred);
        if rows.len() < WINDOW {
            continue;
        }
        let mut maps: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; width]);
        for (row, w) in rows.iter().zip(&kernel) {
            for (map, row) in maps.iter_mut().zip(row) {
                for (m, v) in map.iter_mut().zip(row) {
                    *m += w * v;
                }
            }
        }
        let [first, others @ ..] = &maps;
        for (i, &m) in first.iter().enumerate() {
            let m = f64::from(m);
            let [n, mm, nn, mn] = others.each_ref().map(|map| f64::from(map[i]));
            let structure = (2.0 * (mn - m * n) + C2) / ((mm - m * m) + (nn - n * n) + C2);
            let (m, n) = (m + f64::from(GREY), n + f64::from(GREY));
            let luminance = (2.0 * m * n + C1) / (m * m + n * n + C1);
            sums[0] += structure;
            sums[1] += structure * luminance;
        }
    }
    sums.map(|s| s / (width * height) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grey pictures by rules that any language can repeat.
    fn picture(width: u32, height: u32, f: impl Fn(u32, u32) -> u32) -> Picture {
        let mut p = Picture::new(width, height, [0; 3]);
        for y in 0..height {
            for x in 0..width {
                let v = f(x, y).min(255) as u8;
                p.rgb[3 * (y * width + x) as usize..][..3].fill(v);
            }
        }
        p
    }

    fn noise(x: u32, y: u32) -> u32 {
        let h = (x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663)).wrapping_mul(2_654_435_761);
        h >> 24
    }

    fn base(x: u32, y: u32) -> u32 {
        (x * x / 97 + y * 3 + (x / 16 + y / 16) % 2 * 60) % 256
    }

    #[test]
    fn equal_and_unequal() {
        let a = picture(176, 180, base);
        assert_eq!(ms_ssim(&a, &a), Ok(1.0));
        let b = picture(176, 180, |x, y| 255 - base(x, y));
        assert_eq!(ms_ssim(&a, &b), Ok(0.0));
        assert_eq!(ms_ssim(&a, &picture(180, 176, base)), Err(SsimError::Sizes(176, 180, 180, 176)));
        let small = picture(160, 200, base);
        assert_eq!(ms_ssim(&small, &small), Err(SsimError::Small(160, 200)));
        assert_eq!(MIN_SIDE, 161);
    }

    /// Values of an implementation of others (pytorch-msssim 1.0.0, `data_range=255`) for the same pictures.
    #[test]
    fn as_others_compute_it() {
        let cases: [(u32, u32, [f64; 5]); 3] = [
            (176, 176, [0.922_122_977, 0.827_646_957, 0.915_692_623, 0.972_160_942, 0.017_848_507]),
            (320, 192, [0.925_454_313, 0.802_300_159, 0.915_493_818, 0.944_184_463, 0.017_306_626]),
            (512, 512, [0.930_589_414, 0.770_913_485, 0.915_162_196, 0.908_255_214, 0.021_879_087]),
        ];
        for (width, height, expected) in cases {
            let a = picture(width, height, base);
            let others = [
                picture(width, height, |x, y| base(x, y) * 3 / 4 + noise(x, y) / 4),
                picture(width, height, |x, y| base(x + 2, y)),
                picture(width, height, |x, y| base(x, y) * 2 / 3),
                picture(width, height, |x, y| base(x / 4 * 4, y)),
                picture(width, height, noise),
            ];
            for (other, expected) in others.iter().zip(expected) {
                let score = ms_ssim(&a, other).unwrap();
                assert!((score - expected).abs() < 1e-5, "{width} by {height}: {score} {expected}");
            }
        }
    }
}
