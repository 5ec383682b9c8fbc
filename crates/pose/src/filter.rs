//! Kalman filter and Rauch-Tung-Striebel smoother for a point or an attitude driven by white jerk.
//!
//! The error state is (δx, δv, δa) in threes; for an attitude δx is a turn about body axes, R exp(δx), and v and a are
//! body rates and their derivatives.

use mavsight_geometry::attitude::{matrix_of, right_jacobian};
use mavsight_geometry::{Matrix3, UnitQuaternion, Vector3};
use nalgebra::{SMatrix, SVector};

pub(crate) type Matrix9 = SMatrix<f64, 9, 9>;
type Vector9 = SVector<f64, 9>;

/// Where something is: a position or an attitude.
pub(crate) trait Place: Copy {
    /// This place after a small displacement.
    fn plus(&self, by: &Vector3<f64>) -> Self;
    /// The displacement that leads from `from` to this place.
    fn minus(&self, from: &Self) -> Vector3<f64>;
    /// Derivatives of the displaced place's error with respect to this place's error and to the displacement.
    fn jacobians(by: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>);
}

impl Place for Vector3<f64> {
    fn plus(&self, by: &Vector3<f64>) -> Self {
        self + by
    }
    fn minus(&self, from: &Self) -> Vector3<f64> {
        self - from
    }
    fn jacobians(_: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
        (Matrix3::identity(), Matrix3::identity())
    }
}

impl Place for UnitQuaternion<f64> {
    fn plus(&self, by: &Vector3<f64>) -> Self {
        self * UnitQuaternion::from_scaled_axis(*by)
    }
    fn minus(&self, from: &Self) -> Vector3<f64> {
        (from.inverse() * self).scaled_axis()
    }
    fn jacobians(by: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
        (matrix_of(&UnitQuaternion::from_scaled_axis(-by)), right_jacobian(by))
    }
}

/// A place, its rate and the rate of that, with their covariance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State<P> {
    pub(crate) place: P,
    pub(crate) rate: Vector3<f64>,
    pub(crate) acceleration: Vector3<f64>,
    pub(crate) covariance: Matrix9,
}

/// A measured place.
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

/// Process noise (spectral density of the jerk) and the factor on the measurements' covariances.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    pub(crate) intensity: f64,
    pub(crate) variance_factor: f64,
}

/// Sums over the innovations once the state is determined.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Innovations {
    /// Coordinates.
    pub(crate) count: usize,
    /// Σ log det S.
    pub(crate) log_det: f64,
    /// Σ yᵀ S⁻¹ y.
    pub(crate) chi_square: f64,
}

/// Measurements that the diffuse start uses up: place, rate and acceleration.
const DIFFUSE: usize = 3;

/// The state `dt_s` later (earlier, if negative) and the transition of the error.
pub(crate) fn predict<P: Place>(state: &State<P>, dt_s: f64, intensity: f64) -> (State<P>, Matrix9) {
    let by = state.rate * dt_s + state.acceleration * (0.5 * dt_s * dt_s);
    let (keep, turn) = P::jacobians(&by);
    let mut f = Matrix9::identity();
    f.fixed_view_mut::<3, 3>(0, 0).copy_from(&keep);
    f.fixed_view_mut::<3, 3>(0, 3).copy_from(&(turn * dt_s));
    f.fixed_view_mut::<3, 3>(0, 6).copy_from(&(turn * (0.5 * dt_s * dt_s)));
    f.fixed_view_mut::<3, 3>(3, 6).copy_from(&(Matrix3::identity() * dt_s));
    let mut covariance = f * state.covariance * f.transpose();
    add_white_jerk(&mut covariance, dt_s, intensity);
    let next = State {
        place: state.place.plus(&by),
        rate: state.rate + state.acceleration * dt_s,
        acceleration: state.acceleration,
        covariance,
    };
    (next, f)
}

/// The integral of white jerk over an interval (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.3).
fn add_white_jerk(covariance: &mut Matrix9, dt_s: f64, intensity: f64) {
    let (s, sign) = (dt_s.abs(), dt_s.signum());
    let blocks = [
        (0, 0, s.powi(5) / 20.0),
        (0, 3, sign * s.powi(4) / 8.0),
        (0, 6, s.powi(3) / 6.0),
        (3, 3, s.powi(3) / 3.0),
        (3, 6, sign * s * s / 2.0),
        (6, 6, s),
    ];
    for (row, column, value) in blocks {
        for k in 0..3 {
            covariance[(row + k, column + k)] += intensity * value;
            if row != column {
                covariance[(column + k, row + k)] += intensity * value;
            }
        }
    }
}

/// Takes a measurement in (Joseph's form); the innovation and its covariance come back.
fn update<P: Place>(
    state: &mut State<P>,
    seen: &Measured<P>,
    factor: f64,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let noise = seen.covariance * factor;
    let innovation = seen.place.minus(&state.place);
    let s: Matrix3<f64> = state.covariance.fixed_view::<3, 3>(0, 0) + noise;
    let inverse = s.cholesky()?.inverse();
    let gain: SMatrix<f64, 9, 3> = state.covariance.fixed_view::<9, 3>(0, 0) * inverse;
    let mut keep = Matrix9::identity();
    let shrunk = keep.fixed_view::<9, 3>(0, 0) - gain;
    keep.fixed_view_mut::<9, 3>(0, 0).copy_from(&shrunk);
    let covariance = keep * state.covariance * keep.transpose() + gain * noise * gain.transpose();
    correct(state, &(gain * innovation));
    state.covariance = (covariance + covariance.transpose()) * 0.5;
    Some((innovation, s))
}

fn correct<P: Place>(state: &mut State<P>, by: &Vector9) {
    state.place = state.place.plus(&by.fixed_rows::<3>(0).into_owned());
    state.rate += by.fixed_rows::<3>(3);
    state.acceleration += by.fixed_rows::<3>(6);
}

fn start<P: Place>(series: &Series<'_, P>, factor: f64) -> Option<State<P>> {
    let first = (*series.measured.first()?)?;
    let mut covariance = Matrix9::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(first.covariance * factor));
    for k in 0..3 {
        covariance[(3 + k, 3 + k)] = series.prior_std.0.powi(2) * factor;
        covariance[(6 + k, 6 + k)] = series.prior_std.1.powi(2) * factor;
    }
    Some(State { place: first.place, rate: Vector3::zeros(), acceleration: Vector3::zeros(), covariance })
}

/// Share of the whole record's information that the smoother's start carries: little enough not to count, enough
/// that the backward pass does not cancel a diffuse covariance digit by digit.
const START_SHARE: f64 = 1e-4;

/// The state at the first time as the whole record, filtered backwards, gives it, with a covariance that makes it
/// next to worthless. It is also where the first steps of an attitude are linearised.
fn informed_start<P: Place>(series: &Series<'_, P>, noise: Noise) -> Option<State<P>> {
    let last = series.measured.iter().rposition(Option::is_some)?;
    let t_s: Vec<f64> = series.t_s[..=last].iter().rev().copied().collect();
    let measured: Vec<_> = series.measured[..=last].iter().rev().copied().collect();
    let backwards = Series { t_s: &t_s, measured: &measured, prior_std: series.prior_std };
    let mut at_first = None;
    forward(&backwards, noise, start(&backwards, noise.variance_factor)?, |state, _| {
        at_first = Some(*state)
    })?;
    at_first.map(|state| State { covariance: state.covariance / START_SHARE, ..state })
}

/// Runs the filter from the state just after the first measurement; `visit` gets the filtered state, and the prediction and transition that led to it.
fn forward<P: Place>(
    series: &Series<'_, P>,
    noise: Noise,
    mut state: State<P>,
    mut visit: impl FnMut(&State<P>, Option<(&State<P>, &Matrix9)>),
) -> Option<Innovations> {
    visit(&state, None);
    let mut sums = Innovations::default();
    let mut seen_count = 1;
    for k in 1..series.t_s.len() {
        let (predicted, transition) = predict(&state, series.t_s[k] - series.t_s[k - 1], noise.intensity);
        state = predicted;
        if let Some(seen) = &series.measured[k] {
            let (y, s) = update(&mut state, seen, noise.variance_factor)?;
            seen_count += 1;
            if seen_count > DIFFUSE {
                let factor = s.cholesky()?;
                sums.count += 3;
                sums.log_det += 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
                sums.chi_square += y.dot(&factor.solve(&y));
            }
        }
        visit(&state, Some((&predicted, &transition)));
    }
    Some(sums)
}

/// The innovations of a whole series; `None` where the arithmetic fails.
pub(crate) fn innovations<P: Place>(series: &Series<'_, P>, noise: Noise) -> Option<Innovations> {
    let start = start(series, noise.variance_factor)?;
    forward(series, noise, start, |_, _| {}).filter(|s| s.log_det.is_finite() && s.chi_square.is_finite())
}

/// Smoothed states of a whole series (Rauch, Tung & Striebel 1965); `None` where the arithmetic fails.
pub(crate) fn smoothed<P: Place>(series: &Series<'_, P>, noise: Noise) -> Option<Vec<State<P>>> {
    let mut filtered: Vec<State<P>> = Vec::with_capacity(series.t_s.len());
    let mut predictions: Vec<(State<P>, Matrix9)> = Vec::with_capacity(series.t_s.len());
    let mut start = informed_start(series, noise)?;
    update(&mut start, &(*series.measured.first()?)?, noise.variance_factor)?;
    forward(series, noise, start, |state, prediction| {
        filtered.push(*state);
        if let Some((predicted, transition)) = prediction {
            predictions.push((*predicted, *transition));
        }
    })?;
    let mut out = filtered;
    for k in (0..out.len().saturating_sub(1)).rev() {
        let (predicted, transition) = &predictions[k];
        let next = out[k + 1];
        let gain = inverse_of(&predicted.covariance)?;
        let gain = out[k].covariance * transition.transpose() * gain;
        let mut difference = Vector9::zeros();
        difference.fixed_rows_mut::<3>(0).copy_from(&next.place.minus(&predicted.place));
        difference.fixed_rows_mut::<3>(3).copy_from(&(next.rate - predicted.rate));
        difference.fixed_rows_mut::<3>(6).copy_from(&(next.acceleration - predicted.acceleration));
        correct(&mut out[k], &(gain * difference));
        let covariance =
            out[k].covariance + gain * (next.covariance - predicted.covariance) * gain.transpose();
        out[k].covariance = (covariance + covariance.transpose()) * 0.5;
    }
    let sound = out.iter().all(|s| s.covariance.diagonal().iter().all(|v| v.is_finite() && *v > 0.0));
    sound.then_some(out)
}

/// Inverse of a covariance whose diagonal spans many decades: scaled to correlations first.
fn inverse_of(covariance: &Matrix9) -> Option<Matrix9> {
    let scale = covariance.diagonal().map(|v| v.sqrt().recip());
    let unit = Matrix9::from_fn(|i, j| covariance[(i, j)] * scale[i] * scale[j]);
    let inverse = unit.cholesky()?.inverse();
    Some(Matrix9::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]))
}
