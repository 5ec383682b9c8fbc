//! Sums of products of scores that are correlated over some rows.

use mavsight_geometry::svd::jacobi_svd;
use nalgebra::DMatrix;

/// How the errors of one row go with those of others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Correlation {
    /// Not at all, and all rows alike.
    White,
    /// Over up to so many rows; rows may differ in variance.
    Rows(usize),
    /// Over as many rows as the scores' own correlation asks for (Andrews 1991, equations 6.2 and 6.4), after
    /// a first-order vector autoregression has taken most of it out (Andrews & Monahan 1992): Bartlett
    /// weights alone would leave the sum of slowly fading correlations too small.
    Automatic,
}

impl Correlation {
    /// n times the long-run covariance of the rows of `scores`: the middle of a sandwich.
    pub(crate) fn sum(self, scores: &DMatrix<f64>) -> DMatrix<f64> {
        match self {
            Self::White => sandwich(scores, 0),
            Self::Rows(lag) => sandwich(scores, lag),
            Self::Automatic => recoloured(scores).unwrap_or_else(|| sandwich(scores, automatic_lag(scores))),
        }
    }
}

/// The long-run sum of what a first-order vector autoregression leaves, given back its colour; none where
/// scores are dependent. Singular values of the autoregression are bounded by 0.97 (Andrews & Monahan 1992,
/// section 3).
fn recoloured(scores: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (rows, count) = scores.shape();
    if rows < 4 * (count + 1) {
        return None;
    }
    let sizes: Vec<f64> = scores.column_iter().map(|c| c.norm()).collect();
    if !sizes.iter().all(|s| *s > 0.0) {
        return None;
    }
    let scaled = DMatrix::from_fn(rows, count, |i, j| scores[(i, j)] / sizes[j]);
    let (before, after) = (scaled.rows(0, rows - 1), scaled.rows(1, rows - 1));
    let gram = before.tr_mul(&before);
    let mut forward = gram.cholesky()?.solve(&before.tr_mul(&after));
    let svd = jacobi_svd(&forward);
    if svd.singular_values[0] > 0.97 {
        let bounded = svd.singular_values.map(|s| s.min(0.97));
        forward = &svd.u * DMatrix::from_diagonal(&bounded) * svd.v.transpose();
    }
    let left = after - before * &forward;
    let sum = sandwich(&left, automatic_lag(&left));
    let back = (DMatrix::identity(count, count) - forward).try_inverse()?;
    let sum = back.tr_mul(&sum) * back;
    let grown = rows as f64 / (rows - 1) as f64;
    Some(DMatrix::from_fn(count, count, |i, j| sum[(i, j)] * sizes[i] * sizes[j] * grown))
}

/// Σ_l w_l Σ_i ψ_i ψ_{i+l}ᵀ with Bartlett weights w_l = 1 - |l|/(lag + 1), of rows ψ_i (Newey & West 1987).
/// Positive semidefinite.
pub(crate) fn bartlett_sum(scores: &DMatrix<f64>, lag: usize) -> DMatrix<f64> {
    let rows = scores.nrows();
    let mut sum = scores.tr_mul(scores);
    for l in 1..=lag.min(rows.saturating_sub(1)) {
        let weight = 1.0 - l as f64 / (lag + 1) as f64;
        let product = scores.rows(0, rows - l).tr_mul(&scores.rows(l, rows - l));
        sum += (&product + product.transpose()) * weight;
    }
    sum
}

/// [`bartlett_sum`] with the factor n/(n - p) for the fitted parameters.
fn sandwich(scores: &DMatrix<f64>, lag: usize) -> DMatrix<f64> {
    let (rows, count) = scores.shape();
    bartlett_sum(scores, lag) * (rows as f64 / (rows - count).max(1) as f64)
}

/// The lag of least mean square error for Bartlett weights, 1.1447 (α n)^(1/3), with α from first-order
/// autoregressions of the scores' columns (Andrews 1991). Coefficients are bounded by 0.97, as there; the lag
/// by a third of the rows.
fn automatic_lag(scores: &DMatrix<f64>) -> usize {
    let rows = scores.nrows();
    let (mut above, mut below) = (0.0, 0.0);
    for column in scores.column_iter() {
        let mean = column.mean();
        let (mut now, mut next) = (0.0, 0.0);
        for i in 1..rows {
            now += (column[i - 1] - mean).powi(2);
            next += (column[i - 1] - mean) * (column[i] - mean);
        }
        if now > 0.0 {
            // Scores are scaled to innovations of variance one, so that no column's unit outweighs another's.
            let rho = (next / now).clamp(-0.97, 0.97);
            above += 4.0 * rho.powi(2) / ((1.0 - rho).powi(6) * (1.0 + rho).powi(2));
            below += 1.0 / (1.0 - rho).powi(4);
        }
    }
    if below == 0.0 {
        return 0;
    }
    let width = 1.1447 * (above / below * rows as f64).cbrt();
    (width.ceil() as usize).saturating_sub(1).min(rows / 3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;
    use nalgebra::DVector;

    #[test]
    fn follows_the_definition_term_by_term() {
        let scores = DMatrix::from_fn(20, 2, |i, j| ((i * (j + 3)) % 7) as f64 - 3.0);
        let mut slow = DMatrix::zeros(2, 2);
        for i in 0..20_usize {
            for k in 0..20_usize {
                let apart = i.abs_diff(k);
                if apart <= 3 {
                    slow += scores.row(i).transpose() * scores.row(k) * (1.0 - apart as f64 / 4.0);
                }
            }
        }
        assert!((sandwich(&scores, 3) - slow * (20.0 / 18.0)).norm() < 1e-9);
    }

    #[test]
    fn the_lag_of_an_autoregression_is_that_of_the_closed_form() {
        let (mut random, rows, rho) = (Random::new(5, 0), 20_000, 0.8);
        let mut state = 0.0;
        let scores = DMatrix::from_fn(rows, 1, |_, _| {
            state = rho * state + random.normal();
            state
        });
        // 4ρ²/(1 - ρ²)² with ρ = 0.8 is 19.75.
        let wanted = 1.1447 * (19.75 * rows as f64).cbrt();
        let got = automatic_lag(&scores) as f64;
        assert!((got / wanted - 1.0).abs() < 0.05, "{got} is not {wanted}");
        let white = DMatrix::from_fn(rows, 1, |_, _| random.normal());
        assert!(automatic_lag(&white) < 4);
        assert_eq!(automatic_lag(&DMatrix::zeros(10, 2)), 0);
    }

    #[test]
    fn the_long_run_variance_of_an_autoregression_is_that_of_the_closed_form() {
        // Innovations of covariance I under ψ_t = A ψ_{t-1} + ε have (I - A)⁻¹ (I - A)⁻ᵀ.
        let (mut random, rows) = (Random::new(9, 0), 40_000);
        let a = DMatrix::from_row_slice(2, 2, &[0.7, 0.2, -0.1, 0.5]);
        let mut scores = DMatrix::zeros(rows, 2);
        let mut state = DVector::zeros(2);
        for i in 0..rows {
            state = &a * state + DVector::from_fn(2, |_, _| random.normal());
            scores.set_row(i, &state.transpose());
        }
        let root = (DMatrix::identity(2, 2) - a).try_inverse().expect("regular");
        let wanted = &root * root.transpose();
        let got = Correlation::Automatic.sum(&scores) / rows as f64;
        assert!((&got - &wanted).norm() < 0.05 * wanted.norm(), "{got} is not {wanted}");
        assert_eq!(Correlation::Rows(3).sum(&scores), sandwich(&scores, 3));
        // Scores that are all zero have no spread.
        assert_eq!(Correlation::Automatic.sum(&DMatrix::zeros(30, 2)), DMatrix::zeros(2, 2));
    }
}
