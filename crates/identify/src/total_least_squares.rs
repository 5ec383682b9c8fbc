//! Total least squares with exact columns.

use crate::IdentifyError;
use crate::least_squares::check;
use crate::robust_covariance::sandwich;
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::{DMatrix, DVector};

/// A total least-squares fit.
#[derive(Debug, Clone, PartialEq)]
pub struct TotalLeastSquares {
    /// One value a column.
    pub values: DVector<f64>,
    /// Covariance after Fuller (1987, section 2.2), with scores correlated over up to `lag` rows.
    pub covariance: DMatrix<f64>,
    /// Output less fit at the measured regressors.
    pub residuals: DVector<f64>,
}

/// Fits `output` by `regressors` of which each column and the output carry independent errors in the ratio of the
/// given standard deviations; a column whose entry is zero is exact.
///
/// Exact columns are taken out by QR, the rest is solved by the smallest singular vector of what remains (Golub,
/// Hoffman & Stewart 1987; Van Huffel & Vandewalle 1991, algorithm 3.2). Consistent where least squares is biased by
/// errors in the regressors; the ratio must be right, the level is estimated. With no noisy column it is least squares.
///
/// # Errors
/// The same as [`crate::least_squares`], and [`IdentifyError::NonGeneric`] where no solution exists.
pub fn total_least_squares(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    column_std: &[f64],
    output_std: f64,
    lag: usize,
) -> Result<TotalLeastSquares, IdentifyError> {
    check(regressors, output)?;
    let count = regressors.ncols();
    if column_std.len() != count
        || output_std.is_nan()
        || output_std <= 0.0
        || column_std.iter().any(|s| s.is_nan() || *s < 0.0)
    {
        return Err(IdentifyError::BadColumn { what: "standard deviations".to_owned(), rows: count });
    }
    let exact: Vec<usize> = (0..count).filter(|j| column_std[*j] == 0.0).collect();
    let noisy: Vec<usize> = (0..count).filter(|j| column_std[*j] > 0.0).collect();
    if noisy.is_empty() {
        let fit = crate::least_squares(regressors, output, lag)?;
        return Ok(TotalLeastSquares {
            values: fit.values,
            covariance: fit.covariance,
            residuals: fit.residuals,
        });
    }
    let (values, level) = solve(regressors, output, (&exact, &noisy), column_std, output_std)?;
    let residuals = output - regressors * &values;
    let covariance = covariance(regressors, &values, &residuals, (column_std, level), lag)?;
    Ok(TotalLeastSquares { values, covariance, residuals })
}

/// Values, and the variance of an error whose given standard deviation is one.
fn solve(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    (exact, noisy): (&[usize], &[usize]),
    column_std: &[f64],
    output_std: f64,
) -> Result<(DVector<f64>, f64), IdentifyError> {
    let rows = regressors.nrows();
    let (k, m) = (exact.len(), noisy.len());
    let mut all = DMatrix::zeros(rows, k + m + 1);
    let mut scales = vec![1.0; k + m + 1];
    for (position, j) in exact.iter().enumerate() {
        scales[position] = regressors.column(*j).norm();
        all.set_column(position, &(regressors.column(*j) / scales[position]));
    }
    for (position, j) in noisy.iter().enumerate() {
        scales[k + position] = column_std[*j];
        all.set_column(k + position, &(regressors.column(*j) / column_std[*j]));
    }
    scales[k + m] = output_std;
    all.set_column(k + m, &(output / output_std));
    let r = all.qr().r();
    let svd = jacobi_svd(&r.view((k, k), (m + 1, m + 1)).into_owned());
    let smallest = svd.v.column(m);
    if smallest[m].abs() < 1e-10 {
        return Err(IdentifyError::NonGeneric { part: smallest[m].abs() });
    }
    let noisy_scaled = smallest.rows(0, m) / -smallest[m];
    let mut scaled = DVector::zeros(k + m);
    scaled.rows_mut(k, m).copy_from(&noisy_scaled);
    if k > 0 {
        let right = r.view((0, k + m), (k, 1)) - r.view((0, k), (k, m)) * &noisy_scaled;
        let exact_scaled =
            r.view((0, 0), (k, k)).solve_upper_triangular(&right).ok_or(IdentifyError::RankZero)?;
        scaled.rows_mut(0, k).copy_from(&exact_scaled);
    }
    let mut values = DVector::zeros(k + m);
    for (position, j) in exact.iter().chain(noisy).enumerate() {
        values[*j] = scaled[position] * output_std / scales[position];
    }
    let level = svd.singular_values[m].powi(2) / (rows - k - m).max(1) as f64;
    Ok((values, level))
}

/// M⁻¹ (Σ ψψᵀ) M⁻¹ with M = AᵀA - nΣ_aa and ψ_i = a_i v_i + Σ_aa x less its mean, which is zero at the solution.
fn covariance(
    regressors: &DMatrix<f64>,
    values: &DVector<f64>,
    residuals: &DVector<f64>,
    (column_std, level): (&[f64], f64),
    lag: usize,
) -> Result<DMatrix<f64>, IdentifyError> {
    let (rows, count) = regressors.shape();
    let errors = DVector::from_iterator(count, column_std.iter().map(|s| s * s * level));
    let mut m = regressors.transpose() * regressors;
    for j in 0..count {
        m[(j, j)] -= rows as f64 * errors[j];
    }
    let scales: Vec<f64> = regressors.column_iter().map(|c| c.norm()).collect();
    let scaled = DMatrix::from_fn(count, count, |i, j| m[(i, j)] / (scales[i] * scales[j]));
    let inverse = scaled.try_inverse().ok_or(IdentifyError::RankZero)?;
    let inverse = DMatrix::from_fn(count, count, |i, j| inverse[(i, j)] / (scales[i] * scales[j]));
    // v = e_y - e_aᵀx, so E[a v] = -Σ_aa x: the score is centred by it, whose part common to all rows may be estimated.
    let shift = errors.component_mul(values);
    let mut scores = DMatrix::from_fn(rows, count, |i, j| regressors[(i, j)] * residuals[i] + shift[j]);
    for mut column in scores.column_iter_mut() {
        let mean = column.mean();
        column.add_scalar_mut(-mean);
    }
    Ok(&inverse * sandwich(&scores, lag) * &inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn slicots_example_gives_its_printed_answer() {
        // SLICOT, example of MB02MD: M = 6, N = 3, L = 1, total least squares in all columns.
        #[rustfmt::skip]
        let c = DMatrix::from_row_slice(6, 4, &[
            0.80010, 0.39985, 0.60005, 0.89999,
            0.29996, 0.69990, 0.39997, 0.82997,
            0.49994, 0.60003, 0.20012, 0.79011,
            0.90013, 0.20016, 0.79995, 0.85002,
            0.39998, 0.80006, 0.49985, 0.99016,
            0.20002, 0.90007, 0.70009, 1.02994,
        ]);
        let fit =
            total_least_squares(&c.columns(0, 3).into_owned(), &c.column(3).into_owned(), &[1.0; 3], 1.0, 0)
                .expect("a fit");
        for (got, printed) in fit.values.iter().zip([0.5003, 0.8003, 0.2995]) {
            assert!((got - printed).abs() < 5e-5, "{got} is not {printed}");
        }
    }

    fn normal(state: &mut u64) -> f64 {
        let mut uniform = || {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((*state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        };
        (-2.0 * uniform().ln()).sqrt() * (2.0 * std::f64::consts::PI * uniform()).cos()
    }

    #[test]
    fn is_consistent_and_knows_its_spread_where_least_squares_is_biased() {
        let (mut seed, truth, runs, rows) = (1_u64, [0.5, 2.0], 200, 400);
        let (mut sum, mut squares, mut predicted, mut plain) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..runs {
            let clean: Vec<f64> = (0..rows).map(|i| (0.05 * f64::from(i)).sin()).collect();
            let x = DMatrix::from_fn(rows as usize, 2, |i, j| {
                if j == 0 { 1.0 } else { clean[i] + 0.3 * normal(&mut seed) }
            });
            let y = DVector::from_fn(rows as usize, |i, _| {
                truth[0] + truth[1] * clean[i] + 0.3 * normal(&mut seed)
            });
            let fit = total_least_squares(&x, &y, &[0.0, 0.3], 0.3, 0).expect("a fit");
            sum += fit.values[1];
            squares += (fit.values[1] - truth[1]).powi(2);
            predicted += fit.covariance[(1, 1)];
            plain += crate::least_squares(&x, &y, 0).expect("a fit").values[1];
        }
        let n = f64::from(runs);
        assert!((sum / n - 2.0).abs() < 0.02, "mean {}", sum / n);
        assert!((plain / n - 2.0).abs() > 0.2, "least squares should be biased: {}", plain / n);
        let ratio = (predicted / squares).sqrt();
        assert!((0.88..1.14).contains(&ratio), "predicted over achieved standard deviation {ratio}");
    }

    proptest! {
        #[test]
        fn exact_columns_alone_are_least_squares(seed in 1_u64..u64::MAX) {
            let mut state = seed;
            let x = DMatrix::from_fn(30, 3, |_, j| if j == 0 { 1.0 } else { normal(&mut state) });
            let y = DVector::from_fn(30, |_, _| normal(&mut state));
            let plain = crate::least_squares(&x, &y, 2).expect("a fit");
            let total = total_least_squares(&x, &y, &[0.0; 3], 1.0, 2).expect("a fit");
            prop_assert!((plain.values - &total.values).norm() < 1e-12);
            // Errors that shrink to nothing lead there too.
            let near = total_least_squares(&x, &y, &[0.0, 1e-7, 1e-7], 1.0, 2).expect("a fit");
            prop_assert!((near.values - total.values).norm() < 1e-6);
        }
    }
}
