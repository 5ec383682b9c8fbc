//! Covariances of errors, one for each time.

use nalgebra::DMatrix;

/// One covariance of the same signals at each time, in single precision: seven digits of a variance, and a
/// quarter of the bytes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorRows {
    signals: usize,
    /// Lower triangles by rows.
    triangles: Vec<f32>,
}

impl ErrorRows {
    /// So many covariances of so many signals, all zero.
    pub(crate) fn zeros(signals: usize, rows: usize) -> Self {
        Self { signals, triangles: vec![0.0; rows * signals * (signals + 1) / 2] }
    }

    fn place(&self, row: usize, i: usize, j: usize) -> usize {
        let (low, high) = (i.min(j), i.max(j));
        row * self.signals * (self.signals + 1) / 2 + high * (high + 1) / 2 + low
    }

    /// Number of times.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len() / (self.signals * (self.signals + 1) / 2).max(1)
    }

    /// One element of the covariance at a time.
    pub fn at(&self, row: usize, i: usize, j: usize) -> f64 {
        f64::from(self.triangles[self.place(row, i, j)])
    }

    /// Sets an element, and the one across the diagonal.
    pub(crate) fn set(&mut self, row: usize, (i, j): (usize, usize), value: f64) {
        let place = self.place(row, i, j);
        self.triangles[place] = value as f32;
    }

    /// The covariance of some of the signals at a time.
    pub fn block(&self, row: usize, signals: &[usize]) -> DMatrix<f64> {
        DMatrix::from_fn(signals.len(), signals.len(), |i, j| self.at(row, signals[i], signals[j]))
    }

    pub(crate) fn of_signals(&self, kept: &[usize]) -> Self {
        let mut out = Self::zeros(kept.len(), self.len());
        for row in 0..self.len() {
            for i in 0..kept.len() {
                (0..=i).for_each(|j| out.set(row, (i, j), self.at(row, kept[i], kept[j])));
            }
        }
        out
    }
}
