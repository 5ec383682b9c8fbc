//! Ordinary least squares by Householder QR of scaled columns.

use crate::IdentifyError;
use crate::orthogonal::Factored;
use crate::robust_covariance::Correlation;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A least-squares fit.
#[derive(Debug, Clone, PartialEq)]
pub struct LeastSquares {
    /// One value a column.
    pub values: DVector<f64>,
    /// Covariance, for residuals correlated as asked for.
    pub covariance: DMatrix<f64>,
    /// Covariance were the residuals white: σ²(XᵀX)⁻¹.
    pub white_covariance: DMatrix<f64>,
    /// (XᵀX)⁻¹.
    pub inverse_gram: DMatrix<f64>,
    /// Output less fit.
    pub residuals: DVector<f64>,
}

/// Fits `output` by the columns of `regressors`, all taken as exact.
///
/// Householder QR of scaled columns, refined with residuals in twice the working precision (Björck 1967). The
/// covariance of correlated residuals is White's sandwich with Bartlett weights (Newey & West 1987): behind a
/// smoother they are coloured, and σ²(XᵀX)⁻¹ would be too small (Morelli & Klein 1997). Zero rows still allow
/// for unequal variance. Valid where errors of the regressors are small against their variation.
///
/// # Errors
/// Fewer rows than columns, numbers that are not finite, or columns of deficient rank
/// ([`crate::independent_columns`] finds them beforehand).
pub fn least_squares(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    correlation: Correlation,
) -> Result<LeastSquares, IdentifyError> {
    let (rows, count) = regressors.shape();
    check(regressors, output)?;
    let factored = Factored::new(regressors)?;
    let (values, residuals) = factored.solve(output)?;
    let inverse_gram = factored.inverse_gram()?;
    let degrees = (rows - count).max(1) as f64;
    let white_covariance = &inverse_gram * (residuals.norm_squared() / degrees);
    let covariance = match correlation {
        Correlation::White => white_covariance.clone(),
        _ => {
            let scores = DMatrix::from_fn(rows, count, |i, j| regressors[(i, j)] * residuals[i]);
            &inverse_gram * correlation.sum(&scores) * &inverse_gram
        }
    };
    Ok(LeastSquares { values, covariance, white_covariance, inverse_gram, residuals })
}

/// Fits rows whose outputs have errors of the given standard deviations (Aitken 1935), each row divided by
/// its own.
///
/// Values and covariance are those of the rows as given; residuals those of the divided ones.
///
/// # Errors
/// The errors of [`least_squares`]; standard deviations that are not positive and finite.
pub fn weighted_least_squares(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    output_std: &[f64],
    correlation: Correlation,
) -> Result<LeastSquares, IdentifyError> {
    check(regressors, output)?;
    let rows = regressors.nrows();
    if output_std.len() != rows || output_std.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(IdentifyError::BadColumn { what: "positive standard deviations".to_owned(), rows });
    }
    let x = DMatrix::from_fn(rows, regressors.ncols(), |i, j| regressors[(i, j)] / output_std[i]);
    let y = DVector::from_fn(rows, |i, _| output[i] / output_std[i]);
    least_squares(&x, &y, correlation)
}

pub(crate) fn check(regressors: &DMatrix<f64>, output: &DVector<f64>) -> Result<(), IdentifyError> {
    let (rows, count) = regressors.shape();
    if output.len() != rows || !output.iter().all(|v| v.is_finite()) {
        return Err(IdentifyError::BadColumn { what: "output".to_owned(), rows });
    }
    if let Some(j) = (0..count).find(|j| !regressors.column(*j).iter().all(|v| v.is_finite())) {
        return Err(IdentifyError::BadColumn { what: format!("regressor {}", j + 1), rows });
    }
    if rows <= count {
        return Err(IdentifyError::TooFewInstants { found: rows, parameters: count });
    }
    Ok(())
}

/// The 97.5 % quantile of Student's t with the given degrees of freedom; at least one and at most a million,
/// beyond which it is that of the normal distribution.
pub fn student_quantile_975(degrees: usize) -> f64 {
    StudentsT::new(0.0, 1.0, degrees.clamp(1, 1_000_000) as f64).map_or(f64::NAN, |t| t.inverse_cdf(0.975))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_table() {
        for (degrees, t) in
            [(1, 12.706), (3, 3.182), (5, 2.571), (10, 2.228), (30, 2.042), (1000, 1.962), (1 << 40, 1.960)]
        {
            assert!(
                (student_quantile_975(degrees) - t).abs() < 0.000_51,
                "{degrees}: {}",
                student_quantile_975(degrees)
            );
        }
    }

    #[test]
    fn press_is_what_leaving_out_gives() {
        let rows = 12;
        let x = DMatrix::from_fn(rows, 2, |i, j| if j == 0 { 1.0 } else { (i as f64).powf(1.3) });
        let y = DVector::from_fn(rows, |i, _| 2.0 + 0.3 * i as f64 + ((i * 5 % 7) as f64 - 3.0) * 0.2);
        let mut slow = 0.0;
        for left in 0..rows {
            let fit =
                least_squares(&x.clone().remove_row(left), &y.clone().remove_row(left), Correlation::White)
                    .expect("a fit");
            slow += (y[left] - (x.row(left) * &fit.values)[0]).powi(2);
        }
        let press = crate::press(&x, &y, 1).expect("a sum");
        assert!((press / slow - 1.0).abs() < 1e-10, "{press} {slow}");
    }

    #[test]
    fn bad_columns_are_refused() {
        let x = DMatrix::from_element(3, 2, f64::NAN);
        let y = DVector::zeros(3);
        assert!(matches!(least_squares(&x, &y, Correlation::White), Err(IdentifyError::BadColumn { .. })));
        let x = DMatrix::from_element(2, 2, 1.0);
        assert!(matches!(
            least_squares(&x, &DVector::zeros(2), Correlation::White),
            Err(IdentifyError::TooFewInstants { .. })
        ));
    }
}
