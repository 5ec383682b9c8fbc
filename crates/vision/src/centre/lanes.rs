//! Arithmetic on as many numbers at once as a processor's vector unit holds.
//!
//! Samples of eight bits and their derivatives are held in single precision: its rounding, 6e-8 of a number,
//! is 2e-5 of a level.
//!
//! Products and sums are rounded one by one, and together only in [`Lanes::mul_add`], so that every processor
//! gives the same numbers.

use pulp::Simd;
use std::ops::{Add, Div, Mul, Sub};

/// Numbers that are kept and worked on together, a multiple of what any vector unit holds.
pub(super) const GROUP: usize = 8;

/// As many numbers as a vector unit holds: 1, 4 or 8.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd> {
    simd: S,
    values: S::f32s,
}

impl<S: Simd> Lanes<S> {
    /// Parts of a group.
    pub(super) const PARTS: usize = GROUP / S::F32_LANES;

    #[inline(always)]
    pub(super) fn splat(simd: S, value: impl Into<f64>) -> Self {
        Self { simd, values: simd.splat_f32s(value.into() as f32) }
    }

    /// A part of a slice that is some groups long.
    #[inline(always)]
    pub(super) fn load(simd: S, from: &[f32], part: usize) -> Self {
        Self { simd, values: S::as_simd_f32s(from).0[part] }
    }

    #[inline(always)]
    pub(super) fn store(self, into: &mut [f32], part: usize) {
        S::as_mut_simd_f32s(into).0[part] = self.values;
    }

    /// This times a factor and a number more, rounded once.
    #[inline(always)]
    pub(super) fn mul_add(self, factor: Self, more: Self) -> Self {
        Self { values: self.simd.mul_add_f32s(self.values, factor.values, more.values), ..self }
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self { values: self.simd.sqrt_f32s(self.values), ..self }
    }

    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        Self { values: self.simd.max_f32s(self.values, other.values), ..self }
    }

    #[inline(always)]
    pub(super) fn min(self, other: Self) -> Self {
        Self { values: self.simd.min_f32s(self.values, other.values), ..self }
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self { values: self.simd.abs_f32s(self.values), ..self }
    }

    /// `yes` where this is below `limit`, else `no`.
    #[inline(always)]
    pub(super) fn where_below(self, limit: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.less_than_f32s(self.values, limit.values);
        Self { values: self.simd.select_f32s(mask, yes.values, no.values), ..self }
    }
}

/// Sum of a group of numbers, in one order on all processors: of those half a group apart first.
#[inline(always)]
pub(super) fn total(mut group: [f32; GROUP]) -> f32 {
    let mut half = GROUP / 2;
    while half > 0 {
        for k in 0..half {
            group[k] += group[k + half];
        }
        half /= 2;
    }
    group[0]
}

macro_rules! operator {
    ($trait:ident, $name:ident, $vector:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { values: self.simd.$vector(self.values, other.values), ..self }
            }
        }
    };
}

operator!(Add, add, add_f32s);
operator!(Sub, sub, sub_f32s);
operator!(Mul, mul, mul_f32s);
operator!(Div, div, div_f32s);
