//! Systematic errors, by as few directions as matter.

use mavsight_geometry::Matrix6;
use nalgebra::{DMatrix, Matrix6xX};

/// What the directions of error do to the poses of a flight, summed: their Gram matrix, each coordinate
/// in its standard deviations.
#[derive(Default)]
pub(crate) struct Gram(DMatrix<f64>);

impl Gram {
    /// Adds a pose with what each direction does to it; of directions beyond its columns it knows nothing.
    pub(crate) fn add(&mut self, effects: &Matrix6xX<f64>, covariance: &Matrix6<f64>) {
        let mut scaled = effects.clone();
        for (k, mut row) in scaled.row_iter_mut().enumerate() {
            row /= covariance[(k, k)].max(f64::MIN_POSITIVE).sqrt();
        }
        let known = effects.ncols();
        if known > self.0.ncols() {
            let sum = std::mem::take(&mut self.0);
            self.0 = sum.resize(known, known, 0.0);
        }
        let mut own = self.0.view_mut((0, 0), (known, known));
        own += scaled.tr_mul(&scaled);
    }

    /// The combinations of directions, as columns, that matter most, without those that add less than the
    /// `negligible` part of the variance: principal components (Pearson 1901).
    pub(crate) fn principal(self, negligible: f64) -> DMatrix<f64> {
        let columns = self.0.nrows();
        if columns == 0 {
            return self.0;
        }
        let eigen = self.0.symmetric_eigen();
        let mut order: Vec<usize> = (0..columns).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let (total, mut kept) = (eigen.eigenvalues.sum(), 0.0);
        let needed = order.iter().take_while(|k| {
            let more = kept < (1.0 - negligible) * total;
            kept += eigen.eigenvalues[**k];
            more
        });
        let directions: Vec<_> = needed.map(|k| eigen.eigenvectors.column(*k).into_owned()).collect();
        DMatrix::from_fn(columns, directions.len(), |i, j| directions[j][i])
    }
}
