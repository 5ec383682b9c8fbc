//! The likelihood of the noise of a chain, by its innovations (Harvey 1989, section 3.4).

use crate::smoother::integrator::{
    CHAIN, CORRELATED, Integrator, JerkNoise, Place, add_process_noise, start_covariance,
};
use mavsight_geometry::{Matrix3, Vector3};
use nalgebra::SMatrix;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured<P> {
    pub(crate) place: P,
    pub(crate) covariance: Matrix3<f64>,
}

/// Times and what was measured then; the first entry is measured.
pub(crate) struct Series<'a, P> {
    pub(crate) t_s: &'a [f64],
    pub(crate) measured: &'a [Option<Measured<P>>],
    /// Standard deviations of rate and acceleration before anything is known.
    pub(crate) prior_std: (f64, f64),
}

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Innovations {
    /// Coordinates.
    pub(crate) count: usize,
    /// Σ log det S.
    pub(crate) log_det: f64,
    /// Σ yᵀ S⁻¹ y.
    pub(crate) chi_square: f64,
    /// Σ wᵀ w' over neighbours, w the whitened innovations.
    pub(crate) neighbours: f64,
}

impl Innovations {
    /// Correlation of an innovation with the one before.
    pub(crate) fn correlation(&self) -> f64 {
        if self.chi_square > 0.0 { self.neighbours / self.chi_square } else { 0.0 }
    }
}

/// Measurements that the diffuse start uses up: place, rate and acceleration.
const DIFFUSE: usize = 3;

/// The innovations of a whole series; `None` where the arithmetic fails.
pub(crate) fn innovations<P: Place>(series: &Series<'_, P>, noise: &JerkNoise) -> Option<Innovations> {
    // Without a correlated part the three coordinates of it would only cost time.
    if noise.correlated == Matrix3::zeros() {
        run::<P, CORRELATED>(series, noise)
    } else {
        run::<P, CHAIN>(series, noise)
    }
}

/// The filter with an error state of `N`: all of it, or all but the correlated part.
fn run<P: Place, const N: usize>(series: &Series<'_, P>, noise: &JerkNoise) -> Option<Innovations> {
    let first = (*series.measured.first()?)?;
    let mut chain = Integrator::at(first.place);
    let start = start_covariance(&(first.covariance * noise.variance_factor), noise, series.prior_std);
    let mut covariance: SMatrix<f64, N, N> = start.fixed_view::<N, N>(0, 0).into_owned();
    let mut sums = Innovations::default();
    let (mut seen_count, mut before) = (1, None);
    for k in 1..series.t_s.len() {
        let dt_s = series.t_s[k] - series.t_s[k - 1];
        let (predicted, transition) = chain.predicted(dt_s, noise);
        chain = predicted;
        transition.forward(covariance.as_mut_slice(), N, 0);
        covariance.transpose_mut();
        transition.forward(covariance.as_mut_slice(), N, 0);
        add_process_noise(covariance.as_mut_slice(), N, 0, dt_s, noise);
        let Some(seen) = &series.measured[k] else { continue };
        let y = chain.innovation(&seen.place);
        let mut seen_rows: SMatrix<f64, 3, N> = covariance.fixed_rows::<3>(0).into_owned();
        if N > CORRELATED {
            seen_rows += covariance.fixed_rows::<3>(CORRELATED);
        }
        let mut s = seen_rows.fixed_columns::<3>(0) + seen.covariance * noise.variance_factor;
        if N > CORRELATED {
            s += seen_rows.fixed_columns::<3>(CORRELATED);
        }
        let factor = s.cholesky()?;
        let gain: SMatrix<f64, N, 3> = factor.solve(&seen_rows).transpose();
        let taken = gain * seen_rows;
        covariance += gain * s * gain.transpose() - taken - taken.transpose();
        covariance = (covariance + covariance.transpose()) * 0.5;
        let mut by = [0.0; CHAIN];
        by[..N].copy_from_slice((gain * y).as_slice());
        chain.correct(&by);
        seen_count += 1;
        if seen_count > DIFFUSE {
            let white = factor.l().solve_lower_triangular(&y)?;
            sums.count += 3;
            sums.log_det += 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
            sums.chi_square += white.norm_squared();
            sums.neighbours += before.map_or(0.0, |b: Vector3<f64>| b.dot(&white));
            before = Some(white);
        }
    }
    Some(sums).filter(|s| s.log_det.is_finite() && s.chi_square.is_finite())
}
