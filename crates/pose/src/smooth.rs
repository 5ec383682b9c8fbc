//! From measured poses to motion: a smoother whose bandwidth the data choose.
//!
//! Position and attitude are driven by white jerk. The spectral density of that jerk and a factor on the measurements'
//! covariances are those of greatest likelihood of the filter's innovations (Harvey 1989, section 3.4), found for
//! translation and rotation apart. For a steady rate of poses the smoother passes 1/(1 + (f/fc)⁶) of a position, with
//! (2π fc)⁶ = q/(r dt).

use crate::filter::{Innovations, Measured, Noise, Place, Series, State, innovations, predict, smoothed};
use crate::{Motion, MotionSample, PoseError, PoseSample};
use mavsight_geometry::attitude::{cross_matrix, matrix_of};
use mavsight_geometry::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use nalgebra::{SMatrix, Translation3};

/// Poses needed: three fix the start, and two noise parameters want more than a handful of innovations.
const NEEDED: usize = 10;

/// Standard deviations of what is unknown before the first pose, an order of magnitude beyond anything that flies in a
/// room: 10 m/s, 100 m/s²; 30 rad/s, 1000 rad/s².
const PRIOR_TRANSLATION: (f64, f64) = (10.0, 100.0);
const PRIOR_ROTATION: (f64, f64) = (30.0, 1000.0);

/// Steps of the coarse search for the bandwidth; the fine one halves the bracket until it is within a percent.
const COARSE_STEPS: usize = 16;

/// Smooths and differentiates the poses of one flight.
///
/// Instants without a pose are predicted only: their samples come with the covariance that this leaves. Times may be
/// unevenly spaced.
///
/// # Errors
/// [`PoseError::TooFewPoses`] under 10 poses; [`PoseError::TimeNotIncreasing`]; [`PoseError::BadPose`].
pub fn smooth(poses: &[PoseSample], gravity_m_s2: f64) -> Result<Motion, PoseError> {
    check(poses, gravity_m_s2)?;
    let origin_ns = poses[0].t_ns;
    let t_s: Vec<f64> = poses.iter().map(|p| (p.t_ns - origin_ns) as f64 * 1e-9).collect();
    let positions = poses.iter().map(|p| measured(p, 0, |pose| pose.translation.vector)).collect::<Vec<_>>();
    let attitudes = poses.iter().map(|p| measured(p, 3, |pose| pose.rotation)).collect::<Vec<_>>();
    let failed = PoseError::BadPose { index: 0, what: "the smoother's covariance" };
    let translation = solve(&t_s, &positions, PRIOR_TRANSLATION).ok_or(failed.clone())?;
    let rotation = solve(&t_s, &attitudes, PRIOR_ROTATION).ok_or(failed)?;
    let samples = poses
        .iter()
        .zip(translation.states.iter().zip(&rotation.states))
        .map(|(pose, (t, r))| sample(pose.t_ns, t, r, gravity_m_s2))
        .collect();
    Ok(Motion {
        samples,
        translation_bandwidth_hz: translation.bandwidth_hz,
        rotation_bandwidth_hz: rotation.bandwidth_hz,
        sample_interval_s: median(t_s.windows(2).map(|w| w[1] - w[0]).collect()),
    })
}

fn check(poses: &[PoseSample], gravity_m_s2: f64) -> Result<(), PoseError> {
    let measured = poses.iter().filter(|p| p.estimate.is_some()).count();
    if measured < NEEDED {
        return Err(PoseError::TooFewPoses { measured, samples: poses.len(), needed: NEEDED });
    }
    if !gravity_m_s2.is_finite() {
        return Err(PoseError::BadPose { index: 0, what: "gravity" });
    }
    for (index, pair) in poses.windows(2).enumerate() {
        if pair[1].t_ns <= pair[0].t_ns {
            let t_s = pair[1].t_ns as f64 * 1e-9;
            return Err(PoseError::TimeNotIncreasing { index: index + 1, t_s });
        }
    }
    for (index, estimate) in poses.iter().enumerate().filter_map(|(i, p)| Some((i, p.estimate.as_ref()?))) {
        let pose = &estimate.world_from_body;
        if !pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite()) {
            return Err(PoseError::BadPose { index, what: "the pose" });
        }
        let finite = estimate.covariance.iter().all(|x| x.is_finite());
        let blocks = [0, 3].map(|at| estimate.covariance.fixed_view::<3, 3>(at, at).into_owned().cholesky());
        if !finite || blocks.iter().any(Option::is_none) {
            return Err(PoseError::BadPose { index, what: "the covariance" });
        }
    }
    Ok(())
}

fn measured<P>(pose: &PoseSample, at: usize, place: impl Fn(&Isometry3<f64>) -> P) -> Option<Measured<P>> {
    pose.estimate.as_ref().map(|e| Measured {
        place: place(&e.world_from_body),
        covariance: e.covariance.fixed_view::<3, 3>(at, at).into_owned(),
    })
}

struct Solved<P> {
    states: Vec<State<P>>,
    bandwidth_hz: f64,
}

/// Finds the noise and smooths; samples before the first pose are predicted backwards from it.
fn solve<P: Place>(t_s: &[f64], all: &[Option<Measured<P>>], prior_std: (f64, f64)) -> Option<Solved<P>> {
    let first = all.iter().position(Option::is_some)?;
    let series = Series { t_s: &t_s[first..], measured: &all[first..], prior_std };
    let (noise, bandwidth_hz) = most_likely_noise(&series)?;
    let after = smoothed(&series, noise)?;
    let start = after[0];
    let mut states: Vec<State<P>> =
        (0..first).map(|k| predict(&start, t_s[k] - t_s[first], noise.intensity).0).collect();
    states.extend(after);
    Some(Solved { states, bandwidth_hz })
}

/// Intensity and variance factor of greatest likelihood.
///
/// For a given bandwidth, that is a given ratio of the two, the factor is the mean square of the normalised
/// innovations, so the search has one dimension: from one cycle in twice the flight to the Nyquist frequency.
fn most_likely_noise<P: Place>(series: &Series<'_, P>) -> Option<(Noise, f64)> {
    let times: Vec<f64> =
        series.t_s.iter().zip(series.measured).filter(|(_, m)| m.is_some()).map(|(t, _)| *t).collect();
    let duration_s = times.last()? - times.first()?;
    let interval_s = median(times.windows(2).map(|w| w[1] - w[0]).collect());
    let variance = median(series.measured.iter().flatten().map(|m| m.covariance.trace() / 3.0).collect());
    let intensity = |log_hz: f64| (2.0 * std::f64::consts::PI * log_hz.exp()).powi(6) * variance * interval_s;
    let run = |log_hz: f64| -> Option<Innovations> {
        innovations(series, Noise { intensity: intensity(log_hz), variance_factor: 1.0 })
    };
    let cost = |log_hz: f64| {
        run(log_hz).filter(|s| s.count > 0).map_or(f64::INFINITY, |s| {
            s.log_det + s.count as f64 * (s.chi_square / s.count as f64).max(f64::MIN_POSITIVE).ln()
        })
    };
    let (low, high) = ((0.5 / duration_s).ln(), (0.5 / interval_s).ln());
    let best = least(cost, low, high);
    let sums = run(best).filter(|s| s.count > 0)?;
    // A record without any scatter would claim no noise at all: the poses' own covariances bound it from below by 1e-4.
    let variance_factor = (sums.chi_square / sums.count as f64).max(1e-4);
    Some((Noise { intensity: intensity(best) * variance_factor, variance_factor }, best.exp()))
}

/// The least of a function of one variable: a grid, then golden sections of the bracket around its best point.
fn least(cost: impl Fn(f64) -> f64, low: f64, high: f64) -> f64 {
    let step = (high - low) / COARSE_STEPS as f64;
    let mut best = (low, f64::INFINITY);
    for k in 0..=COARSE_STEPS {
        let x = low + step * k as f64;
        let c = cost(x);
        if c < best.1 {
            best = (x, c);
        }
    }
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    let (mut a, mut b) = ((best.0 - step).max(low), (best.0 + step).min(high));
    let (mut x, mut y) = (b - golden * (b - a), a + golden * (b - a));
    let (mut at_x, mut at_y) = (cost(x), cost(y));
    while b - a > 0.01 {
        if at_x < at_y {
            (b, y, at_y) = (y, x, at_x);
            x = b - golden * (b - a);
            at_x = cost(x);
        } else {
            (a, x, at_x) = (x, y, at_y);
            y = a + golden * (b - a);
            at_y = cost(y);
        }
    }
    0.5 * (a + b)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Turns the two states into body quantities, with the covariance by the Jacobian of that.
fn sample(
    t_ns: i64,
    translation: &State<Vector3<f64>>,
    rotation: &State<UnitQuaternion<f64>>,
    gravity_m_s2: f64,
) -> MotionSample {
    let body_from_world = matrix_of(&rotation.place).transpose();
    let velocity = body_from_world * translation.rate;
    let force = body_from_world * (translation.acceleration + Vector3::z() * gravity_m_s2);
    let mut state = SMatrix::<f64, 18, 18>::zeros();
    state.fixed_view_mut::<9, 9>(0, 0).copy_from(&translation.covariance);
    state.fixed_view_mut::<9, 9>(9, 9).copy_from(&rotation.covariance);
    let mut jacobian = SMatrix::<f64, 18, 18>::zeros();
    let blocks: [(usize, usize, Matrix3<f64>); 8] = [
        (0, 0, Matrix3::identity()),
        (3, 9, Matrix3::identity()),
        (6, 3, body_from_world),
        (6, 9, cross_matrix(&velocity)),
        (9, 12, Matrix3::identity()),
        (12, 6, body_from_world),
        (12, 9, cross_matrix(&force)),
        (15, 15, Matrix3::identity()),
    ];
    for (row, column, block) in blocks {
        jacobian.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
    }
    let covariance = jacobian * state * jacobian.transpose();
    MotionSample {
        t_ns,
        world_from_body: Isometry3::from_parts(Translation3::from(translation.place), rotation.place),
        velocity_in_body_m_s: velocity,
        rates_rad_s: rotation.rate,
        specific_force_m_s2: force,
        angular_acceleration_rad_s2: rotation.acceleration,
        covariance: (covariance + covariance.transpose()) * 0.5,
    }
}

#[cfg(test)]
mod tests;
