//! Covariance of estimates whose errors have a known colour.

use nalgebra::{DMatrix, DVector};

/// The covariance of estimates, and the degrees of freedom of the level that scales it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Coloured {
    pub(crate) covariance: DMatrix<f64>,
    pub(crate) degrees: f64,
}

/// The covariance B Xᵀ R X B of x = B Xᵀ y for errors of y with the autocovariances `gamma` times a level
/// that the residuals show: their sum of squares over its expectation tr((I - P)R), P = X (XᵀX)⁻¹ Xᵀ.
///
/// `once` are further errors, each one direction that happens once, of variance one: R has their
/// products as well.
///
/// The residuals' level is distributed about as chi-square with tr((I - P)R)²/tr(((I - P)R)²) degrees of
/// freedom (Satterthwaite 1946). Where the colour is known this is far less uncertain than sums of products
/// of the scores, of which a record behind a low-pass holds few that are independent. `None` where gamma has
/// no variance.
pub(crate) fn coloured(
    columns: &DMatrix<f64>,
    bread: &DMatrix<f64>,
    residuals: &[f64],
    gamma: &[f64],
    once: &[DVector<f64>],
) -> Option<Coloured> {
    let (rows, count) = columns.shape();
    let variance = *gamma.first().filter(|g| **g > 0.0)?;
    let lags = gamma.len().min(rows);
    // R X, a convolution of each column.
    let mut spread = columns * variance;
    for l in 1..lags {
        for j in 0..count {
            for i in l..rows {
                spread[(i, j)] += gamma[l] * columns[(i - l, j)];
                spread[(i - l, j)] += gamma[l] * columns[(i, j)];
            }
        }
    }
    let mut own = vec![variance; rows];
    let mut squares: f64 = rows as f64 * variance.powi(2)
        + (1..lags).map(|l| 2.0 * (rows - l) as f64 * gamma[l].powi(2)).sum::<f64>();
    for (k, error) in once.iter().enumerate() {
        spread += error * columns.tr_mul(error).transpose();
        own.iter_mut().zip(error).for_each(|(own, e)| *own += e * e);
        let through = (0..lags).map(|l| {
            let sum: f64 = (l..rows).map(|i| error[i] * error[i - l]).sum();
            gamma[l] * sum * if l == 0 { 1.0 } else { 2.0 }
        });
        squares += 2.0 * through.sum::<f64>() + error.norm_squared().powi(2);
        squares += once[..k].iter().map(|other| 2.0 * error.dot(other).powi(2)).sum::<f64>();
    }
    let inverse = columns.tr_mul(columns).try_inverse()?;
    let middle = columns.tr_mul(&spread);
    let projected = &inverse * &middle;
    let trace = own.iter().sum::<f64>() - projected.trace();
    let trace_of_square =
        squares - 2.0 * (&inverse * spread.tr_mul(&spread)).trace() + (&projected * &projected).trace();
    if trace.is_nan() || trace <= 0.0 || trace_of_square.is_nan() || trace_of_square <= 0.0 {
        return None;
    }
    let level = residuals.iter().map(|r| r * r).sum::<f64>() / trace;
    let covariance = bread * middle * bread * level;
    let degrees = (trace * trace / trace_of_square).clamp(1.0, (rows - count).max(1) as f64);
    Some(Coloured { covariance, degrees })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal;
    use crate::{Correlation, least_squares};

    #[test]
    fn it_is_the_dense_formula() {
        let rows = 30;
        let x = DMatrix::from_fn(rows, 2, |i, j| if j == 0 { 1.0 } else { (0.3 * i as f64).sin() });
        let gamma: Vec<f64> = (0..8).map(|l| 2.0 * 0.6_f64.powi(l)).collect();
        let mut r = DMatrix::from_fn(rows, rows, |i, k| gamma.get(i.abs_diff(k)).copied().unwrap_or(0.0));
        let once = [0.1, 0.5].map(|rate| DVector::from_fn(rows, |i, _| 3.0 * (-rate * i as f64).exp()));
        once.iter().for_each(|e| r += e * e.transpose());
        let bread = (x.transpose() * &x).try_inverse().expect("regular");
        let rest = DMatrix::identity(rows, rows) - &x * &bread * x.transpose();
        let residuals: Vec<f64> = (0..rows).map(|i| (i as f64 * 1.7).cos()).collect();
        let m = &rest * &r;
        let level = residuals.iter().map(|v| v * v).sum::<f64>() / m.trace();
        let dense = &bread * x.transpose() * &r * &x * &bread * level;
        let got = coloured(&x, &bread, &residuals, &gamma, &once).expect("a covariance");
        assert!((&got.covariance - &dense).norm() < 1e-12 * dense.norm());
        let degrees = m.trace().powi(2) / (&m * &m).trace();
        assert!((got.degrees / degrees - 1.0).abs() < 1e-9, "{} is not {degrees}", got.degrees);
    }

    #[test]
    fn white_errors_have_the_usual_covariance() {
        let mut seed = 1;
        let x = DMatrix::from_fn(50, 2, |_, _| normal(&mut seed));
        let y = DVector::from_fn(50, |_, _| normal(&mut seed));
        let fit = least_squares(&x, &y, Correlation::White).expect("a fit");
        let bread = (x.transpose() * &x).try_inverse().expect("regular");
        let got = coloured(&x, &bread, fit.residuals.as_slice(), &[0.3], &[]).expect("a covariance");
        assert!((&got.covariance - &fit.white_covariance).norm() < 1e-12);
        assert!((got.degrees - 48.0).abs() < 1e-9);
        assert_eq!(coloured(&x, &bread, fit.residuals.as_slice(), &[0.0], &[]), None);
        assert_eq!(coloured(&x, &bread, fit.residuals.as_slice(), &[], &[]), None);
    }
}
