//! Numbers for estimators: mostly such as a flight has, and some as no flight has them.

use crate::Mutator;
use nalgebra::{DMatrix, DMatrixView};

/// Bytes of which numbers are made, drawn anew.
pub(crate) fn drawn(mutator: &mut Mutator) -> Vec<u8> {
    let words = 8 + mutator.below(120);
    (0..words).flat_map(|_| mutator.next_u64().to_le_bytes()).collect()
}

/// Finite numbers that no measurement has.
const WILD: [f64; 16] = [
    0.0, -0.0, 1e-300, -1e-300, 5e-324, 1e-12, -1.0, 1.0, 1e6, -1e6, 1e30, 1e150, -1e150, 1e300, -1e300,
    1e308,
];

/// Numbers made of bytes, which are repeated where they end.
pub(crate) struct Numbers<'a> {
    bytes: &'a [u8],
    at: usize,
    /// One in so many is wild; none in half of all inputs, of which each is a flight that could be.
    wild: u64,
    before: f64,
}

impl<'a> Numbers<'a> {
    pub(crate) fn of(bytes: &'a [u8]) -> Self {
        let mut this = Self { bytes, at: 0, wild: 0, before: 0.0 };
        this.wild = [0, 0, 0, 400, 100, 30, 10, 3][this.below(8)];
        this
    }

    fn word(&mut self) -> u64 {
        let byte = |k: usize| self.bytes.get((self.at + k) % self.bytes.len().max(1)).copied().unwrap_or(0);
        let word = (0..8).fold(0, |word, k| word << 8 | u64::from(byte(k)));
        // Bytes that come again are others by their place.
        let word = (word ^ self.at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.at += 8;
        word >> 11
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.word() % count.max(1) as u64) as usize
    }

    /// True in one of so many cases.
    pub(crate) fn chance(&mut self, of: usize) -> bool {
        self.below(of) == 0
    }

    /// A number within a distance of another, or a wild one, or again the one before.
    pub(crate) fn near(&mut self, middle: f64, within: f64) -> f64 {
        let share = self.word() as f64 / (1_u64 << 53) as f64;
        let mut number = middle + within * (2.0 * share - 1.0);
        if self.wild > 0 && self.word().is_multiple_of(self.wild) {
            number = match self.below(WILD.len() + 2) {
                0 => self.before,
                1 => -number,
                k => WILD[k - 2],
            };
        }
        self.before = number;
        number
    }

    pub(crate) fn near3(&mut self, middle: [f64; 3], within: f64) -> nalgebra::Vector3<f64> {
        middle.map(|middle| self.near(middle, within)).into()
    }

    /// A standard deviation, above zero unless it is wild.
    pub(crate) fn std(&mut self, usual: f64) -> f64 {
        self.near(usual, 0.9 * usual)
    }
}

/// Asserts that a covariance is finite, symmetric and positive semi-definite to a share of its largest number.
pub(crate) fn assert_covariance<'a>(what: &str, covariance: impl Into<DMatrixView<'a, f64>>, share: f64) {
    let covariance: DMatrix<f64> = covariance.into().into_owned();
    assert!(covariance.iter().all(|x| x.is_finite()), "the covariance of {what} is not finite: {covariance}");
    // As correlations: units differ, and so do their sizes.
    let std = covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
    for (k, variance) in covariance.diagonal().iter().enumerate() {
        assert!(*variance >= 0.0, "variance {k} of {what} is {variance:e}");
    }
    let scaled = DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        let scale = std[i] * std[j];
        if scale > 0.0 { covariance[(i, j)] / std[i] / std[j] } else { 0.0 }
    });
    assert!(
        (&scaled - scaled.transpose()).amax() <= share,
        "the covariance of {what} is not symmetric: {covariance}"
    );
    let least = scaled.symmetric_eigenvalues().min();
    assert!(least >= -share, "the covariance of {what} is not positive, {least:e}: {covariance}");
}
