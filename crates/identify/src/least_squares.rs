//! Ordinary least squares by Householder QR of scaled columns.

use crate::IdentifyError;
use crate::robust_covariance::sandwich;
use nalgebra::{DMatrix, DVector};

/// A least-squares fit.
#[derive(Debug, Clone, PartialEq)]
pub struct LeastSquares {
    /// One value a column.
    pub values: DVector<f64>,
    /// Covariance, for residuals that are correlated over up to `lag` rows.
    pub covariance: DMatrix<f64>,
    /// Covariance were the residuals white: σ²(XᵀX)⁻¹.
    pub white_covariance: DMatrix<f64>,
    /// Output less fit.
    pub residuals: DVector<f64>,
    /// Sum of squares of the prediction error of each row when it is left out (Allen 1974); for white residuals.
    pub press: f64,
}

/// Fits `output` by the columns of `regressors`, all taken as exact.
///
/// The covariance is White's sandwich with Bartlett weights over `lag` rows (Newey & West 1987): residuals behind a
/// smoother are coloured, and σ²(XᵀX)⁻¹ would be too small (Morelli & Klein 1997). `lag` 0 still allows for unequal
/// variance. Valid where errors of the regressors are small beside what they vary by.
///
/// # Errors
/// Fewer rows than columns, numbers that are not finite, or columns of deficient rank
/// ([`crate::independent_columns`] finds them beforehand).
pub fn least_squares(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    lag: usize,
) -> Result<LeastSquares, IdentifyError> {
    let (rows, count) = regressors.shape();
    check(regressors, output)?;
    let scales: Vec<f64> = regressors.column_iter().map(|c| c.norm()).collect();
    if scales.contains(&0.0) {
        return Err(IdentifyError::RankZero);
    }
    let mut scaled = regressors.clone();
    for (mut column, scale) in scaled.column_iter_mut().zip(&scales) {
        column /= *scale;
    }
    let qr = scaled.qr();
    let (q, r) = (qr.q(), qr.r());
    let solve =
        |b: &DVector<f64>| r.solve_upper_triangular(&(q.transpose() * b)).ok_or(IdentifyError::RankZero);
    let fit = |x: &DVector<f64>| -> DVector<f64> { &q * (&r * x) };
    let mut x = solve(output)?;
    // One step of refinement takes the rounding of the first solution out.
    x += solve(&(output - fit(&x)))?;
    let residuals = output - fit(&x);
    let r_inverse =
        r.solve_upper_triangular(&DMatrix::identity(count, count)).ok_or(IdentifyError::RankZero)?;
    let unscale = DMatrix::from_diagonal(&DVector::from_iterator(count, scales.iter().map(|s| 1.0 / s)));
    let bread = &unscale * &r_inverse;
    let degrees = (rows - count).max(1) as f64;
    let white_covariance = &bread * bread.transpose() * (residuals.norm_squared() / degrees);
    let scores = DMatrix::from_fn(rows, count, |i, j| q[(i, j)] * residuals[i]);
    let covariance = &bread * sandwich(&scores, lag) * bread.transpose();
    let press = (0..rows)
        .map(|i| {
            let leverage = q.row(i).norm_squared();
            (residuals[i] / (1.0 - leverage).max(1e-12)).powi(2)
        })
        .sum();
    let values = &unscale * x;
    Ok(LeastSquares { values, covariance, white_covariance, residuals, press })
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

/// The 97.5 % quantile of Student's t with the given degrees of freedom, by the Cornish-Fisher expansion
/// (Abramowitz & Stegun 26.7.5): within 0.01 from 4 degrees on; fewer from the table.
pub fn student_quantile_975(degrees: usize) -> f64 {
    match degrees {
        0 | 1 => 12.706,
        2 => 4.303,
        3 => 3.182,
        _ => {
            let (z, n) = (1.959_963_984_540_054_f64, degrees as f64);
            let g1 = (z.powi(3) + z) / 4.0;
            let g2 = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
            let g3 = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
            z + g1 / n + g2 / n.powi(2) + g3 / n.powi(3)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// NIST, Statistical Reference Datasets, Norris (y, x), with its certified answer.
    const NORRIS: [(f64, f64); 36] = [
        (0.1, 0.2),
        (338.8, 337.4),
        (118.1, 118.2),
        (888.0, 884.6),
        (9.2, 10.1),
        (228.1, 226.5),
        (668.5, 666.3),
        (998.5, 996.3),
        (449.1, 448.6),
        (778.9, 777.0),
        (559.2, 558.2),
        (0.3, 0.4),
        (0.1, 0.6),
        (778.1, 775.5),
        (668.8, 666.9),
        (339.3, 338.0),
        (448.9, 447.5),
        (10.8, 11.6),
        (557.7, 556.0),
        (228.3, 228.1),
        (998.0, 995.8),
        (888.8, 887.6),
        (119.6, 120.2),
        (0.3, 0.3),
        (0.6, 0.3),
        (557.6, 556.8),
        (339.3, 339.1),
        (888.0, 887.2),
        (998.5, 999.0),
        (778.9, 779.0),
        (10.2, 11.1),
        (117.6, 118.3),
        (228.9, 229.2),
        (668.4, 669.1),
        (449.2, 448.9),
        (0.2, 0.5),
    ];

    #[test]
    fn norris_agrees_with_the_certified_answer() {
        let x = DMatrix::from_fn(36, 2, |i, j| if j == 0 { 1.0 } else { NORRIS[i].1 });
        let y = DVector::from_iterator(36, NORRIS.iter().map(|r| r.0));
        let fit = least_squares(&x, &y, 0).expect("a fit");
        let std = |j: usize| fit.white_covariance[(j, j)].sqrt();
        for (got, certified) in [
            (fit.values[0], -0.262_323_073_774_029),
            (fit.values[1], 1.002_116_818_020_45),
            (std(0), 0.232_818_234_301_152),
            (std(1), 0.429_796_848_199_937e-3),
        ] {
            assert!(((got - certified) / certified).abs() < 1e-11, "{got} is not {certified}");
        }
    }

    #[test]
    fn quantiles_are_those_of_the_table() {
        for (degrees, t) in [(5, 2.571), (10, 2.228), (30, 2.042), (1000, 1.962)] {
            assert!(
                (student_quantile_975(degrees) - t).abs() < 0.006,
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
                least_squares(&x.clone().remove_row(left), &y.clone().remove_row(left), 0).expect("a fit");
            slow += (y[left] - (x.row(left) * &fit.values)[0]).powi(2);
        }
        let press = least_squares(&x, &y, 0).expect("a fit").press;
        assert!((press / slow - 1.0).abs() < 1e-10, "{press} {slow}");
    }

    #[test]
    fn bad_columns_are_refused() {
        let x = DMatrix::from_element(3, 2, f64::NAN);
        let y = DVector::zeros(3);
        assert!(matches!(least_squares(&x, &y, 0), Err(IdentifyError::BadColumn { .. })));
        let x = DMatrix::from_element(2, 2, 1.0);
        assert!(matches!(
            least_squares(&x, &DVector::zeros(2), 0),
            Err(IdentifyError::TooFewInstants { .. })
        ));
    }
}
