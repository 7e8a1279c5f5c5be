//! Eight lanes, in as many vectors as the machine needs for them.
//!
//! Written with explicit vectors (pulp), since the compiler takes loops over lanes apart before it looks for vectors in them. Nothing
//! is contracted or reordered, so the result is the same for every width, one lane included.

use pulp::Simd;
use std::ops::{Add, Mul, Sub};

/// Lanes of a block.
pub(super) const LANES: usize = 8;
pub(super) type Lane = [f32; LANES];
pub(super) type Lane3 = [Lane; 3];

/// One vector of numbers.
#[derive(Clone, Copy)]
pub(super) struct V<S: Simd>(pub S, pub S::f32s);

/// One vector of points.
pub(super) type V3<S> = [V<S>; 3];

impl<S: Simd> V<S> {
    /// Vectors that eight lanes take.
    pub const PARTS: usize = LANES / S::F32_LANES;

    #[inline(always)]
    pub fn all(simd: S, x: f32) -> Self {
        V(simd, simd.splat_f32s(x))
    }

    /// Vector `part` of the lanes.
    #[inline(always)]
    pub fn of(simd: S, lanes: &Lane, part: usize) -> Self {
        V(simd, S::as_simd_f32s(lanes).0[part])
    }

    #[inline(always)]
    pub fn put(self, lanes: &mut Lane, part: usize) {
        S::as_mut_simd_f32s(lanes).0[part] = self.1;
    }

    /// `yes` where `a < b`, else `no`.
    #[inline(always)]
    pub fn if_less(a: Self, b: Self, yes: Self, no: Self) -> Self {
        V(a.0, a.0.select_f32s(a.0.less_than_f32s(a.1, b.1), yes.1, no.1))
    }

    /// Whether some lane of `a` is less than that of `b`.
    #[inline(always)]
    pub fn any_less(a: Self, b: Self) -> bool {
        a.0.first_true_m32s(a.0.less_than_f32s(a.1, b.1)) < S::F32_LANES
    }

    #[inline(always)]
    pub fn smaller(self, other: Self) -> Self {
        V::if_less(self, other, self, other)
    }

    #[inline(always)]
    pub fn larger(self, other: Self) -> Self {
        V::if_less(other, self, self, other)
    }

    /// One over it, or 0 for 0.
    #[inline(always)]
    pub fn inverse(self) -> Self {
        let zero = V::all(self.0, 0.0);
        V::if_less(zero, self, self.reciprocal(), zero)
    }

    #[inline(always)]
    pub fn reciprocal(self) -> Self {
        V(self.0, self.0.div_f32s(self.0.splat_f32s(1.0), self.1))
    }

    /// Into 0 ..= 1.
    #[inline(always)]
    pub fn unit(self) -> Self {
        let (zero, one) = (V::all(self.0, 0.0), V::all(self.0, 1.0));
        self.larger(zero).smaller(one)
    }
}

impl<S: Simd> Add for V<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        V(self.0, self.0.add_f32s(self.1, other.1))
    }
}

impl<S: Simd> Sub for V<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        V(self.0, self.0.sub_f32s(self.1, other.1))
    }
}

impl<S: Simd> Mul for V<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        V(self.0, self.0.mul_f32s(self.1, other.1))
    }
}

#[inline(always)]
pub(super) fn of3<S: Simd>(simd: S, lanes: &Lane3, part: usize) -> V3<S> {
    [V::of(simd, &lanes[0], part), V::of(simd, &lanes[1], part), V::of(simd, &lanes[2], part)]
}

#[inline(always)]
pub(super) fn put3<S: Simd>(v: V3<S>, lanes: &mut Lane3, part: usize) {
    v[0].put(&mut lanes[0], part);
    v[1].put(&mut lanes[1], part);
    v[2].put(&mut lanes[2], part);
}

#[inline(always)]
pub(super) fn all3<S: Simd>(simd: S, x: [f32; 3]) -> V3<S> {
    // No closures: they are compiled for no vectors.
    [V::all(simd, x[0]), V::all(simd, x[1]), V::all(simd, x[2])]
}

#[inline(always)]
pub(super) fn vdot<S: Simd>(a: V3<S>, b: V3<S>) -> V<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(super) fn vcross<S: Simd>(a: V3<S>, b: V3<S>) -> V3<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(super) fn vsub<S: Simd>(a: V3<S>, b: V3<S>) -> V3<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn vscale<S: Simd>(a: V3<S>, s: V<S>) -> V3<S> {
    [a[0] * s, a[1] * s, a[2] * s]
}
