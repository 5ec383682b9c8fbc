//! States to start from, drawn out of the poses by local polynomials.

use super::fitter::{Begin, Recorded};
use super::model::{FlightModel, ModelParameter};
use crate::IdentifyError;
use mavsight_flight::flapping::{Between, first_order_response, interpolate};
use mavsight_flight::{Coefficient as C, HelicopterInput, StateVector};
use mavsight_geometry::{Isometry3, Matrix3, Vector3, world_from_level};
use nalgebra::{DMatrix, DVector, Matrix3x6, Vector6};

/// Poses within this of an instant give its velocity, rates and accelerations: nine at 30 Hz.
const WINDOW_S: f64 = 0.135;

/// Of increasing times those at which segments of a length begin, the last not shorter than half of it; a
/// length that is not positive makes one segment.
pub(crate) fn segment_starts(times_s: &[f64], segment_s: f64) -> Vec<usize> {
    let segment_s = if segment_s > 0.0 { segment_s } else { f64::INFINITY };
    let (last_s, mut next_s) = (times_s[times_s.len() - 1], times_s[0]);
    let mut out = Vec::new();
    for (k, t_s) in times_s.iter().enumerate() {
        if *t_s >= next_s - 1e-9 && (k == 0 || last_s - t_s >= 0.5 * segment_s) {
            next_s = t_s + segment_s;
            out.push(k);
        }
    }
    out
}

/// The model with rough values of its free parameters, and the states at which segments begin, the first at
/// the first instant with a pose.
pub(crate) fn begin(
    model: &FlightModel,
    recorded: Recorded<'_>,
    segment_s: f64,
) -> Result<Begin, IdentifyError> {
    let Recorded { inputs, measurements } = recorded;
    let times_s = measurements.times_s();
    let poses = measurements.poses();
    if poses.len() < 4 {
        return Err(IdentifyError::NoStart(poses.len()));
    }
    let t_s: Vec<f64> = poses.iter().map(|(i, _)| times_s[*i]).collect();
    let local: Vec<Local> = (0..poses.len()).map(|k| Local::at(k, &t_s, &poses)).collect();
    let series = HelicopterInput::series(inputs)?;
    let flap = flapping(model, &series, &t_s, &local);
    let state = |k: usize| -> StateVector {
        let pose = &poses[k].1;
        let q = world_from_level().inverse() * pose.rotation;
        let (p, v, w, f) = (pose.translation.vector, local[k].velocity_in_body, local[k].rates, flap[k]);
        [p.x, p.y, p.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, w.x, w.y, w.z, f[0], f[1], f[2], f[3]]
    };
    let nodes = segment_starts(&t_s, segment_s).into_iter().map(|k| (poses[k].0, state(k))).collect();
    let moving = |k: usize| {
        let input = HelicopterInput::require(&series, inputs, t_s[k] - model.input_lag_s).ok()?;
        Some(Moving { input, state: state(k), local: &local[k] })
    };
    let rows: Vec<Moving<'_>> = (0..poses.len()).filter_map(moving).collect();
    Ok(Begin { model: rough(model, &rows), nodes })
}

/// Inputs and state at an instant, with the state's accelerations.
struct Moving<'a> {
    input: HelicopterInput,
    state: StateVector,
    local: &'a Local,
}

/// Coefficients that are nearest to the accelerations, by least squares with a weak pull towards those given;
/// flapping times, linkages and the lag keep their values. Good for a start alone: the polynomials flatten
/// what is fast.
fn rough(model: &FlightModel, rows: &[Moving<'_>]) -> FlightModel {
    let linear = |p: &ModelParameter| match p {
        ModelParameter::Coefficient(C::TauLower | C::TauFlybar | C::SwashplateGain | C::FlybarGain)
        | ModelParameter::InputLag => None,
        ModelParameter::Coefficient(c) => Some(*c),
    };
    let linear: Vec<C> = model.free().iter().filter_map(linear).collect();
    let n = linear.len();
    let mut normal = DMatrix::<f64>::zeros(n, n);
    let mut right = DVector::<f64>::zeros(n);
    for Moving { input, state, local } in rows {
        let at = model.airframe.linearise(&model.coefficients, input, state);
        let predicted = model.airframe.derivative(&model.coefficients, input, state);
        for (row, measured) in (7..13).zip(local.velocity_rate.iter().chain(&local.rate_rate)) {
            let by = DVector::from_fn(n, |k, _| at.by_coefficient[row][linear[k] as usize]);
            normal.ger(1.0, &by, &by, 1.0);
            right.axpy(measured - predicted[row], &by, 1.0);
        }
    }
    for k in 0..n {
        normal[(k, k)] = normal[(k, k)] * (1.0 + PULL) + f64::MIN_POSITIVE.sqrt();
    }
    let mut out = model.clone();
    let step = normal.cholesky().map(|c| c.solve(&right)).filter(|s| s.iter().all(|v| v.is_finite()));
    for (c, d) in linear.iter().zip(step.iter().flatten()) {
        out.coefficients.set(*c, model.coefficients.get(*c) + d);
    }
    out
}

/// Share of the information on each coefficient that pulls it to where it was: enough to part columns that
/// are alike.
const PULL: f64 = 1e-3;

/// What a local polynomial says of an instant, in body axes.
struct Local {
    velocity_in_body: Vector3<f64>,
    rates: Vector3<f64>,
    velocity_rate: Vector3<f64>,
    rate_rate: Vector3<f64>,
}

impl Local {
    fn at(k: usize, t_s: &[f64], poses: &[(usize, Isometry3<f64>)]) -> Self {
        let back = poses[k].1.inverse();
        let (mut a, mut b) = (k, k);
        while b - a < 4 || t_s[b] - t_s[k] < WINDOW_S || t_s[k] - t_s[a] < WINDOW_S {
            let can_left = a > 0 && (t_s[k] - t_s[a - 1] <= WINDOW_S || b - a < 4);
            let can_right = b + 1 < poses.len() && (t_s[b + 1] - t_s[k] <= WINDOW_S || b - a < 4);
            if !can_left && !can_right {
                break;
            }
            a -= usize::from(can_left);
            b += usize::from(can_right);
        }
        // Least squares of c0 + c1 τ + c2 τ² for place and turn.
        let (mut normal, mut right) = (Matrix3::zeros(), Matrix3x6::zeros());
        for i in a..=b {
            let tau = t_s[i] - t_s[k];
            let powers = Vector3::new(1.0, tau, tau * tau);
            let moved = back * poses[i].1;
            let (place, turn) = (moved.translation.vector, moved.rotation.scaled_axis());
            normal += powers * powers.transpose();
            right += powers * Vector6::new(place.x, place.y, place.z, turn.x, turn.y, turn.z).transpose();
        }
        let fitted = normal.try_inverse().unwrap_or_else(Matrix3::zeros) * right;
        let part = |power: usize, first: usize| fitted.fixed_view::<1, 3>(power, first).transpose();
        let (velocity_in_body, rates) = (part(1, 0), part(1, 3));
        // Local polynomials give the acceleration in axes that do not turn.
        let velocity_rate = part(2, 0) * 2.0 - rates.cross(&velocity_in_body);
        Self { velocity_in_body, rates, velocity_rate, rate_rate: part(2, 3) * 2.0 }
    }
}

/// alpha_l, beta_l, alpha_f, beta_f at the times, from rest.
fn flapping(model: &FlightModel, samples: &[HelicopterInput], t_s: &[f64], local: &[Local]) -> Vec<[f64; 4]> {
    let [tau_l, tau_f, kb] =
        [C::TauLower, C::TauFlybar, C::SwashplateGain].map(|c| model.coefficients.get(c));
    let input_t_s: Vec<f64> = samples.iter().map(|s| s.t_s + model.input_lag_s).collect();
    let swash = |delta: fn(&HelicopterInput) -> f64| -> Vec<f64> {
        let held: Vec<f64> = samples.iter().map(|s| kb * delta(s)).collect();
        let forcing: Vec<f64> = held.iter().map(|h| h / tau_l).collect();
        let response = first_order_response(&input_t_s, &forcing, Between::Hold, tau_l, held[0]);
        t_s.iter().map(|t| interpolate(&input_t_s, &response, *t).unwrap_or(held[held.len() - 1])).collect()
    };
    let rate = |axis: usize, tau_s: f64| {
        let forcing: Vec<f64> = local.iter().map(|l| -l.rates[axis]).collect();
        first_order_response(t_s, &forcing, Between::Line, tau_s, 0.0)
    };
    let (lon, lat) = (swash(|s| s.delta_lon_rad), swash(|s| s.delta_lat_rad));
    let (lower_q, lower_p) = (rate(1, tau_l), rate(0, tau_l));
    let (flybar_q, flybar_p) = (rate(1, tau_f), rate(0, tau_f));
    (0..t_s.len()).map(|k| [lon[k] + lower_q[k], lat[k] + lower_p[k], flybar_q[k], flybar_p[k]]).collect()
}
