//! Value noise on an integer hash, and sines by polynomial (the platform's own differ in the last bit).

use crate::random::{GOLDEN, mix};

/// The hash of a lattice point, in `-1.0..1.0`.
fn lattice_value(p: [i64; 3], seed: u64) -> f64 {
    let h = p.iter().fold(seed, |h, &c| mix(h ^ (c as u64).wrapping_mul(GOLDEN)));
    (h >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Value noise with smooth interpolation, in `-1.0..1.0`, features of size 1.
pub fn noise(p: [f64; 3], seed: u64) -> f64 {
    let cell: [i64; 3] = std::array::from_fn(|k| p[k].floor() as i64);
    let t: [f64; 3] = std::array::from_fn(|k| {
        let x = p[k] - p[k].floor();
        x * x * (3.0 - 2.0 * x)
    });
    let mut sum = 0.0;
    for corner in 0..8 {
        let bit = |k: usize| (corner >> k) & 1;
        let weight: f64 = (0..3).map(|k| if bit(k) == 1 { t[k] } else { 1.0 - t[k] }).product();
        if weight > 0.0 {
            sum += weight * lattice_value(std::array::from_fn(|k| cell[k] + bit(k) as i64), seed);
        }
    }
    sum
}

/// Noise of `octaves` frequencies, each twice as fine and half as strong as the one before.
pub fn fractal(p: [f64; 3], octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut weight, mut scale) = (0.0, 1.0, 1.0);
    for octave in 0..octaves {
        sum += weight * noise(p.map(|c| c * scale), seed.wrapping_add(u64::from(octave)));
        weight *= 0.5;
        scale *= 2.0;
    }
    sum
}

/// Cosine and sine of `i / n` of a full turn.
pub fn turn(i: u32, n: u32) -> (f64, f64) {
    // By quarter turns, then by Taylor's series on at most half a right angle: exact to the last bit or so.
    let eighths = 8 * u64::from(i % n.max(1));
    let quarter = (eighths + u64::from(n)) / (2 * u64::from(n.max(1)));
    let x = (eighths as f64 / f64::from(n.max(1)) - 2.0 * quarter as f64) * std::f64::consts::FRAC_PI_4;
    let (mut cos, mut sin, mut term) = (0.0, 0.0, 1.0);
    for k in 0..20 {
        let sign = if k % 4 < 2 { 1.0 } else { -1.0 };
        if k % 2 == 0 {
            cos += sign * term;
        } else {
            sin += sign * term;
        }
        term *= x / f64::from(k + 1);
    }
    match quarter % 4 {
        0 => (cos, sin),
        1 => (-sin, cos),
        2 => (-cos, -sin),
        _ => (sin, -cos),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn turns_lie_on_the_circle() {
        for n in [1u32, 3, 7, 12, 100] {
            for i in 0..n {
                let (c, s) = turn(i, n);
                let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
                assert!((c - angle.cos()).abs() < 1e-14 && (s - angle.sin()).abs() < 1e-14, "{i}/{n}");
            }
        }
    }

    #[test]
    fn noise_is_bounded_and_continuous() {
        let mut random = Random::new(1);
        for _ in 0..1000 {
            let p = random.point().map(|c| 10.0 * c);
            let (a, b) = (noise(p, 3), noise(p.map(|c| c + 1e-7), 3));
            assert!(a.abs() <= 1.0 && (a - b).abs() < 1e-5);
        }
    }
}
