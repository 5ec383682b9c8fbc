//! Regression over a band of frequencies.

use crate::robust_covariance::Correlation;
use crate::{IdentifyError, LeastSquares, least_squares};
use nalgebra::{Complex, DMatrix, DVector};
use std::f64::consts::PI;

/// What each of `rows` samples at steps of `dt_s` weighs in the finite Fourier transforms
/// ∫ x(t) exp(-2πi f t) dt, counted from the first sample, at some frequencies: real parts, then imaginary,
/// by samples.
///
/// Exact for the straight lines between samples (Filon's rule of first order; Press et al. 2007, section
/// 13.9), where a plain sum would be in error by the sampling (Morelli 1997).
fn sample_weights(frequencies_hz: &[f64], rows: usize, dt_s: f64) -> DMatrix<f64> {
    let count = frequencies_hz.len();
    let mut out = DMatrix::zeros(2 * count, rows);
    for (k, f_hz) in frequencies_hz.iter().enumerate().filter(|_| rows > 1) {
        let angle = 2.0 * PI * f_hz * dt_s;
        let half = half_hat(angle);
        for i in 0..rows {
            let turn = Complex::from_polar(dt_s, -angle * i as f64);
            let weight = turn
                * match i {
                    0 => half,
                    _ if i + 1 == rows => half.conj(),
                    _ => half + half.conj(),
                };
            (out[(k, i)], out[(count + k, i)]) = (weight.re, weight.im);
        }
    }
    out
}

/// ∫ of the right half of the hat function times exp(-iθx).
fn half_hat(theta: f64) -> Complex<f64> {
    let t2 = theta * theta;
    if theta.abs() < 1e-2 {
        let imaginary = theta * (1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0);
        return Complex::new(0.5 - t2 / 24.0 + t2 * t2 / 720.0, -imaginary);
    }
    Complex::new(1.0 - theta.cos(), theta.sin() - theta) / t2
}

/// A band and the frequencies in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// From.
    pub low_hz: f64,
    /// To.
    pub high_hz: f64,
}

impl Band {
    /// Frequencies one cycle in the record apart, between which a record of that length has no more
    /// information: their transforms have errors that are independent (Brillinger 1981, theorem 4.4.1).
    pub fn frequencies_hz(&self, length_s: f64) -> Vec<f64> {
        let count = ((self.high_hz - self.low_hz) * length_s + 1e-9).floor();
        if !(count.is_finite() && count >= 0.0 && self.low_hz >= 0.0) {
            return Vec::new();
        }
        (0..=count as usize).map(|k| self.low_hz + k as f64 / length_s).collect()
    }

    /// [`sample_weights`] at the band's frequencies.
    ///
    /// # Errors
    /// [`IdentifyError::BadBand`] where it has no frequency, or ends beyond half the sampling rate.
    pub(crate) fn weights(&self, rows: usize, dt_s: f64) -> Result<DMatrix<f64>, IdentifyError> {
        let nyquist_hz = 0.5 / dt_s;
        let bad = IdentifyError::BadBand { low_hz: self.low_hz, high_hz: self.high_hz, nyquist_hz };
        if self.high_hz.is_nan() || self.high_hz > nyquist_hz {
            return Err(bad);
        }
        let frequencies_hz = self.frequencies_hz(rows as f64 * dt_s);
        if frequencies_hz.is_empty() {
            return Err(bad);
        }
        Ok(sample_weights(&frequencies_hz, rows, dt_s))
    }
}

/// Equation error over a band of frequencies: complex least squares of the output's transform by those of the
/// regressors (Klein 1978; Morelli & Klein 2016, section 7.4), of rows at equal steps.
///
/// What is outside the band, such as drift below and noise above, does not enter. A constant column leaks
/// little into a band away from zero: leave it out, or accept a wide interval. Covariance from the residuals
/// in the band, whose spectrum must be about flat; residuals are those of the real parts, then of the
/// imaginary.
///
/// # Errors
/// [`IdentifyError::BadBand`]; those of [`crate::least_squares`], where rows are two a frequency.
pub fn frequency_domain(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    dt_s: f64,
    band: Band,
) -> Result<LeastSquares, IdentifyError> {
    crate::least_squares::check(regressors, output)?;
    let weights = band.weights(output.len(), dt_s)?;
    least_squares(&(&weights * regressors), &(weights * output), Correlation::White)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    #[test]
    fn straight_lines_are_transformed_as_the_closed_form_says() {
        let (dt, n) = (0.1, 41);
        let length = dt * (n - 1) as f64;
        let line = DVector::from_fn(n, |k, _| 0.7 - 0.3 * dt * k as f64);
        for f in [1e-6, 0.01, 0.3, 1.7, 4.9] {
            let w = 2.0 * PI * f;
            let parts = sample_weights(&[f], n, dt) * &line;
            let (real, imaginary) = (parts[0], parts[1]);
            // ∫ (a + b t) e^{-iwt} dt by parts, as sums of sines and cosines.
            let (a, b) = (0.7, -0.3);
            let (c, s) = ((w * length).cos(), (w * length).sin());
            let end = a + b * length;
            let real_exact = end * s / w + b * (c - 1.0) / (w * w);
            let imaginary_exact = (end * c - a) / w - b * s / (w * w);
            // At 1e-6 Hz the closed form itself cancels.
            let tolerance = if f < 1e-3 { 1e-3 } else { 1e-12 };
            assert!((real - real_exact).abs() < tolerance, "{f}: {real} is not {real_exact}");
            assert!(
                (imaginary - imaginary_exact).abs() < tolerance,
                "{f}: {imaginary} is not {imaginary_exact}"
            );
        }
        let area = sample_weights(&[0.0], n, dt) * &line;
        assert!((area[0] - (0.7 * length - 0.15 * length * length)).abs() < 1e-12 && area[1] == 0.0);
    }

    #[test]
    fn weights_are_continuous_where_the_series_ends() {
        assert!((half_hat(0.009_999_999) - half_hat(0.010_000_001)).norm() < 1e-9);
    }

    #[test]
    fn what_is_outside_the_band_does_not_matter() {
        let (dt, n) = (1.0 / 30.0, 300);
        let time = |i: usize| i as f64 * dt;
        let x = DMatrix::from_fn(n, 2, |i, j| {
            if j == 0 { (2.0 * PI * 0.7 * time(i)).sin() } else { (2.0 * PI * 1.3 * time(i)).cos() }
        });
        // A disturbance at 6 Hz, a multiple of 1/(n dt), which in time would sit on the residuals.
        let y =
            DVector::from_fn(n, |i, _| 2.0 * x[(i, 0)] - x[(i, 1)] + 5.0 * (2.0 * PI * 6.0 * time(i)).sin());
        let fit = frequency_domain(&x, &y, dt, Band { low_hz: 0.2, high_hz: 2.0 }).expect("a fit");
        assert!((fit.values[0] - 2.0).abs() < 0.1 && (fit.values[1] + 1.0).abs() < 0.1, "{}", fit.values);
        let clean = DVector::from_fn(n, |i, _| 2.0 * x[(i, 0)] - x[(i, 1)]);
        let fit = frequency_domain(&x, &clean, dt, Band { low_hz: 0.2, high_hz: 2.0 }).expect("a fit");
        assert!((fit.values[0] - 2.0).abs() < 1e-12 && (fit.values[1] + 1.0).abs() < 1e-12);
    }

    #[test]
    fn knows_its_spread_in_coloured_noise() {
        let (dt, n, runs) = (1.0 / 30.0, 600, 400);
        let mut random = Random::new(21, 0);
        let x = DMatrix::from_fn(n, 2, |i, j| {
            let t = i as f64 * dt;
            (1..8)
                .map(|h| (2.0 * PI * 0.2 * f64::from(h) * t + f64::from(h * h) * (j as f64 + 0.4)).sin())
                .sum()
        });
        let (mut squares, mut predicted) = (0.0, 0.0);
        for _ in 0..runs {
            let mut state = 0.0;
            let y = DVector::from_fn(n, |i, _| {
                state = 0.8 * state + random.normal();
                2.0 * x[(i, 0)] - x[(i, 1)] + state
            });
            let fit = frequency_domain(&x, &y, dt, Band { low_hz: 0.1, high_hz: 1.6 }).expect("a fit");
            squares += (fit.values[0] - 2.0).powi(2);
            predicted += fit.covariance[(0, 0)];
        }
        let ratio: f64 = (predicted / squares).sqrt();
        assert!((0.85..1.15).contains(&ratio), "predicted over achieved standard deviation {ratio}");
    }

    #[test]
    fn a_band_that_is_none_is_refused() {
        let x = DMatrix::from_fn(100, 1, |i, _| (i as f64).sin());
        let y = x.column(0).into_owned();
        for (low_hz, high_hz) in
            [(2.0, 1.0), (-1.0, 1.0), (0.1, 40.0), (0.0, 1e300), (0.1, f64::NAN), (f64::NAN, 1.0)]
        {
            let refused = frequency_domain(&x, &y, 1.0 / 30.0, Band { low_hz, high_hz });
            assert!(matches!(refused, Err(IdentifyError::BadBand { .. })), "{low_hz} {high_hz}: {refused:?}");
        }
    }
}
