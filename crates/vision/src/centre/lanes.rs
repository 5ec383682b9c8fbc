//! Arithmetic on as many numbers at once as a processor's vector unit holds.
//!
//! Products and sums are rounded one by one (never fused), so that every processor gives the same numbers.

use pulp::Simd;
use std::ops::{Add, Div, Mul, Sub};

/// Numbers that are kept and worked on together, a multiple of what any vector unit holds.
pub(super) const GROUP: usize = 4;

/// As many numbers as a vector unit holds: 1, 2 or 4.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd> {
    simd: S,
    values: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// Parts of a group.
    pub(super) const PARTS: usize = GROUP / S::F64_LANES;

    #[inline(always)]
    pub(super) fn splat(simd: S, value: f64) -> Self {
        Self { simd, values: simd.splat_f64s(value) }
    }

    /// A part of a slice that is some groups long.
    #[inline(always)]
    pub(super) fn load(simd: S, from: &[f64], part: usize) -> Self {
        Self { simd, values: S::as_simd_f64s(from).0[part] }
    }

    #[inline(always)]
    pub(super) fn store(self, into: &mut [f64], part: usize) {
        S::as_mut_simd_f64s(into).0[part] = self.values;
    }

    /// Columns of a group of numbers as rows; only where a vector unit holds a whole group.
    #[inline(always)]
    pub(super) fn transposed(simd: S, columns: [Self; GROUP]) -> [Self; GROUP] {
        debug_assert_eq!(S::F64_LANES, GROUP);
        let [a, b, c, d] = columns;
        let [a, b, c, d] = simd.deinterleave_shfl_f64s([a.values, b.values, c.values, d.values]);
        [
            Self { simd, values: a },
            Self { simd, values: b },
            Self { simd, values: c },
            Self { simd, values: d },
        ]
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self { values: self.simd.sqrt_f64s(self.values), ..self }
    }

    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        Self { values: self.simd.max_f64s(self.values, other.values), ..self }
    }

    #[inline(always)]
    pub(super) fn min(self, other: Self) -> Self {
        Self { values: self.simd.min_f64s(self.values, other.values), ..self }
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self { values: self.simd.abs_f64s(self.values), ..self }
    }

    /// `yes` where this is below `limit`, else `no`.
    #[inline(always)]
    pub(super) fn where_below(self, limit: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.less_than_f64s(self.values, limit.values);
        Self { values: self.simd.select_f64s(mask, yes.values, no.values), ..self }
    }
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

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

#[cfg(test)]
mod tests {
    use super::*;

    struct Transposed<'a>(&'a [[f64; GROUP]; GROUP]);

    impl pulp::WithSimd for Transposed<'_> {
        type Output = Option<[[f64; GROUP]; GROUP]>;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            if S::F64_LANES != GROUP {
                return None;
            }
            let rows = Lanes::transposed(simd, self.0.each_ref().map(|column| Lanes::load(simd, column, 0)));
            let mut out = [[0.0; GROUP]; GROUP];
            for (out, row) in out.iter_mut().zip(rows) {
                row.store(out, 0);
            }
            Some(out)
        }
    }

    #[test]
    fn columns_become_rows() {
        let columns: [[f64; GROUP]; GROUP] =
            std::array::from_fn(|j| std::array::from_fn(|i| (10 * i + j) as f64));
        let want = std::array::from_fn(|i| std::array::from_fn(|j| (10 * i + j) as f64));
        match pulp::Arch::new().dispatch(Transposed(&columns)) {
            Some(rows) => assert_eq!(rows, want),
            None => eprintln!("skipped: no vector unit of {GROUP} numbers here"),
        }
    }
}
