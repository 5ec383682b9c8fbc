//! One exact and two noisy columns, n = 1800: how far total least squares strays, and how far it says so.

use mavsight_identify::{Correlation, total_least_squares};
use mavsight_random::Random;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Errors of three columns, the second and third of the regressors and the output, correlated among each
/// other and from row to row by an autoregression.
struct Noise {
    lower: DMatrix<f64>,
    rho: f64,
    state: DVector<f64>,
}

impl Noise {
    fn new(covariance: &DMatrix<f64>, rho: f64, random: &mut Random) -> Self {
        let lower = Cholesky::new(covariance.clone()).expect("positive definite").unpack();
        let state = &lower * DVector::from_fn(3, |_, _| random.normal());
        Self { lower, rho, state }
    }

    fn next(&mut self, random: &mut Random) -> &DVector<f64> {
        let fresh = &self.lower * DVector::from_fn(3, |_, _| random.normal());
        self.state = &self.state * self.rho + fresh * (1.0 - self.rho * self.rho).sqrt();
        &self.state
    }
}

/// Predicted over achieved standard deviation of each value, and the mean errors in units of its standard
/// error.
pub(crate) fn ratios(
    runs: usize,
    rho: f64,
    errors: &DMatrix<f64>,
    how: Correlation,
) -> (DVector<f64>, DVector<f64>) {
    let (rows, truth) = (1800, DVector::from_vec(vec![0.5, 2.0, -1.0]));
    let full = errors.clone().insert_row(0, 0.0).insert_column(0, 0.0);
    let mut random = Random::new(11, 0);
    let (mut sum, mut squares, mut predicted) = (DVector::zeros(3), DVector::zeros(3), DVector::zeros(3));
    for _ in 0..runs {
        let mut noise = Noise::new(errors, rho, &mut random);
        let mut x = DMatrix::zeros(rows, 3);
        let mut y = DVector::zeros(rows);
        for i in 0..rows {
            let t = i as f64;
            let clean =
                [1.0, (0.05 * t).sin() + 0.4 * (0.31 * t).cos(), (0.013 * t * (1.0 + 2e-4 * t)).cos()];
            let e = noise.next(&mut random);
            for j in 0..3 {
                x[(i, j)] = clean[j] + if j > 0 { e[j - 1] } else { 0.0 };
                y[i] += truth[j] * clean[j];
            }
            y[i] += e[2];
        }
        let fit = total_least_squares(&x, &y, &full, how).expect("a fit");
        let error = &fit.values - &truth;
        squares += error.component_mul(&error);
        predicted += fit.covariance.diagonal();
        sum += error;
    }
    let spread = squares.map(|s: f64| (s / runs as f64).sqrt());
    let ratio = predicted.map(|p: f64| (p / runs as f64).sqrt()).component_div(&spread);
    (ratio, (sum / runs as f64).component_div(&spread) * (runs as f64).sqrt())
}

/// Errors that share a cause.
pub(crate) fn correlated_errors() -> DMatrix<f64> {
    DMatrix::from_row_slice(3, 3, &[0.09, 0.03, 0.04, 0.03, 0.04, -0.02, 0.04, -0.02, 0.16])
}

/// Errors of their own.
pub(crate) fn independent_errors() -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_vec(vec![0.09, 0.04, 0.16]))
}
