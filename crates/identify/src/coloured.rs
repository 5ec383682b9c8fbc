//! Covariance of estimates whose errors have a known colour.

use crate::output_error::chi_square_tail;
use nalgebra::{DMatrix, DVector};

/// Chance that residuals are called smaller than the errors of the poses which are not.
const LEVEL: f64 = 0.01;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Coloured {
    pub(crate) covariance: DMatrix<f64>,
    pub(crate) degrees: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ResidualErrors {
    /// Their autocovariances at lags 0, 1, ..., up to a factor.
    pub(crate) gamma: Vec<f64>,
    /// Further errors, each one direction that happens once, of variance one.
    pub(crate) once: Vec<DVector<f64>>,
}

impl ResidualErrors {
    /// R X with R the covariance of the errors.
    pub(crate) fn spread(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let rows = columns.nrows();
        let mut out = columns * self.gamma.first().copied().unwrap_or(0.0);
        for (l, gamma) in self.gamma.iter().enumerate().take(rows).skip(1) {
            let pairs = rows - l;
            out.rows_mut(l, pairs).zip_apply(&columns.rows(0, pairs), |o, c| *o += gamma * c);
            out.rows_mut(0, pairs).zip_apply(&columns.rows(l, pairs), |o, c| *o += gamma * c);
        }
        for error in &self.once {
            out += error * columns.tr_mul(error).transpose();
        }
        out
    }

    /// tr R² of so many rows, and tr R.
    fn traces(&self, rows: usize) -> (f64, f64) {
        let (mut squares, mut sum) = (0.0, rows as f64 * self.gamma.first().copied().unwrap_or(0.0));
        for (l, gamma) in self.gamma.iter().enumerate().take(rows) {
            let twice = if l == 0 { 1.0 } else { 2.0 };
            squares += twice * (rows - l) as f64 * gamma * gamma;
            let through = |e: &DVector<f64>| e.rows(0, rows - l).dot(&e.rows(l, rows - l));
            squares += 2.0 * twice * gamma * self.once.iter().map(through).sum::<f64>();
        }
        for (k, error) in self.once.iter().enumerate() {
            sum += error.norm_squared();
            squares += error.norm_squared().powi(2);
            squares += self.once[..k].iter().map(|other| 2.0 * error.dot(other).powi(2)).sum::<f64>();
        }
        (squares, sum)
    }
}

/// The covariance B Xᵀ R X B of x = B Xᵀ y for errors of y of the covariance R times a level that the
/// residuals show: their sum of squares over its expectation tr((I - P)R), P = X (XᵀX)⁻¹ Xᵀ.
///
/// The residuals' level is distributed about as chi-square with tr((I - P)R)²/tr(((I - P)R)²) degrees of
/// freedom (Satterthwaite 1946). Where the colour is known this is far less uncertain than sums of products
/// of the scores, of which a record behind a low-pass holds few that are independent. The level is one where residuals are
/// smaller than chance leaves errors of the covariance R ([`believed`]). `None` where gamma has no variance.
pub(crate) fn coloured(
    columns: &DMatrix<f64>,
    bread: &DMatrix<f64>,
    residuals: &DVector<f64>,
    errors: &ResidualErrors,
) -> Option<Coloured> {
    let (rows, count) = columns.shape();
    errors.gamma.first().filter(|g| **g > 0.0)?;
    let spread = errors.spread(columns);
    let (squares, sum) = errors.traces(rows);
    let inverse = columns.tr_mul(columns).try_inverse()?;
    let middle = columns.tr_mul(&spread);
    let projected = &inverse * &middle;
    let trace = sum - projected.trace();
    let trace_of_square =
        squares - 2.0 * (&inverse * spread.tr_mul(&spread)).trace() + (&projected * &projected).trace();
    if trace.is_nan() || trace <= 0.0 || trace_of_square.is_nan() || trace_of_square <= 0.0 {
        return None;
    }
    let degrees = (trace * trace / trace_of_square).clamp(1.0, (rows - count).max(1) as f64);
    let covariance = bread * middle * bread * believed(residuals.norm_squared() / trace, degrees);
    Some(Coloured { covariance, degrees })
}

/// A level of the errors that residuals show, if chance may leave it, by the chi-square of its degrees of freedom; else one,
/// the level that the smoother has found from all poses. Columns that fit the errors as well leave residuals of nothing.
pub(crate) fn believed(level: f64, degrees: f64) -> f64 {
    let chance = 1.0 - chi_square_tail(degrees * level, degrees.round().max(1.0) as usize);
    if chance < LEVEL { level.max(1.0) } else { level }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Correlation, least_squares};
    use mavsight_random::Random;

    #[test]
    fn it_is_the_dense_formula() {
        let rows = 30;
        let x = DMatrix::from_fn(rows, 2, |i, j| if j == 0 { 1.0 } else { (0.3 * i as f64).sin() });
        let gamma: Vec<f64> = (0..8).map(|l| 2.0 * 0.6_f64.powi(l)).collect();
        let mut r = DMatrix::from_fn(rows, rows, |i, k| gamma.get(i.abs_diff(k)).copied().unwrap_or(0.0));
        let once = [0.1, 0.5].map(|rate| DVector::from_fn(rows, |i, _| 3.0 * (-rate * i as f64).exp()));
        let errors = ResidualErrors { gamma: gamma.clone(), once: once.to_vec() };
        once.iter().for_each(|e| r += e * e.transpose());
        let bread = (x.transpose() * &x).try_inverse().expect("regular");
        let rest = DMatrix::identity(rows, rows) - &x * &bread * x.transpose();
        let residuals = DVector::from_fn(rows, |i, _| (i as f64 * 1.7).cos());
        let m = &rest * &r;
        let level = residuals.norm_squared() / m.trace();
        let dense = &bread * x.transpose() * &r * &x * &bread * level;
        let got = coloured(&x, &bread, &residuals, &errors).expect("a covariance");
        assert!((&got.covariance - &dense).norm() < 1e-12 * dense.norm());
        let degrees = m.trace().powi(2) / (&m * &m).trace();
        assert!((got.degrees / degrees - 1.0).abs() < 1e-9, "{} is not {degrees}", got.degrees);
    }

    /// Residuals of nothing gave a standard deviation of nothing.
    #[test]
    fn residuals_that_vanish_do_not_make_an_estimate_exact() {
        let (rows, gamma) = (40, (0..40).map(|l| (-0.5 * (f64::from(l) / 12.0).powi(2)).exp()));
        let errors = ResidualErrors { gamma: gamma.collect(), once: Vec::new() };
        let x = DMatrix::from_fn(rows, 3, |i, j| (i as f64 / 40.0).powi(j as i32));
        let bread = (x.transpose() * &x).try_inverse().expect("regular");
        let of = |level: f64| {
            let residuals = DVector::from_element(rows, level);
            coloured(&x, &bread, &residuals, &errors).expect("a covariance").covariance
        };
        let exact = &bread * x.tr_mul(&errors.spread(&x)) * &bread;
        for level in [0.0, 1e-9] {
            assert!((of(level) - &exact).norm() < 1e-12 * exact.norm());
        }
        assert!(of(1.0)[(0, 0)] > 10.0 * exact[(0, 0)]);
        // A level that chance leaves, at seven degrees of freedom, stands.
        assert_eq!((believed(0.31, 6.9), believed(0.1, 6.9), believed(3.0, 6.9)), (0.31, 1.0, 3.0));
    }

    #[test]
    fn white_errors_have_the_usual_covariance() {
        let mut random = Random::new(1, 0);
        let x = DMatrix::from_fn(50, 2, |_, _| random.normal());
        let y = DVector::from_fn(50, |_, _| random.normal());
        let fit = least_squares(&x, &y, Correlation::White).expect("a fit");
        let bread = (x.transpose() * &x).try_inverse().expect("regular");
        let of = |gamma: &[f64]| {
            coloured(&x, &bread, &fit.residuals, &ResidualErrors { gamma: gamma.to_vec(), once: Vec::new() })
        };
        let got = of(&[0.3]).expect("a covariance");
        assert!((&got.covariance - &fit.white_covariance).norm() < 1e-12);
        assert!((got.degrees - 48.0).abs() < 1e-9);
        assert_eq!(of(&[0.0]), None);
        assert_eq!(of(&[]), None);
    }
}
