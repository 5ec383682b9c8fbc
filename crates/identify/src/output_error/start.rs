//! States to start from, drawn out of the poses by local polynomials.

use super::fitter::{Begin, LONGEST_STEP_S, Recorded};
use super::model::{Equations, FlightModel};
use super::propagate::{Raster, SHORTEST_TIME_CONSTANT_S, fastest, longest_step_s};
use crate::IdentifyError;
use mavsight_flight::InputSeries;
use mavsight_geometry::{Isometry3, Matrix3, Vector3, world_from_level};
use mavsight_model::{Evaluation, RIGID_STATES};
use nalgebra::{DMatrix, DVector, Matrix3x6, Vector6};

/// Poses within this of an instant give its velocity, rates and accelerations: nine at 30 Hz.
const WINDOW_S: f64 = 0.135;

/// Of increasing times those at which segments of a length begin, the last not shorter than half of it; a
/// length that is not positive makes one segment. One begins wherever the motion does.
pub(crate) fn segment_starts(
    times_s: &[f64],
    segment_s: f64,
    begins_anew: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let segment_s = if segment_s > 0.0 { segment_s } else { f64::INFINITY };
    let (last_s, mut next_s) = (times_s[times_s.len() - 1], times_s[0]);
    let mut out = Vec::new();
    for (k, t_s) in times_s.iter().enumerate() {
        let is_due = *t_s >= next_s - 1e-9 && (k == 0 || last_s - t_s >= 0.5 * segment_s);
        if is_due || begins_anew(k) {
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
    let begins_anew = |k: usize| measurements.begins_anew(poses[k].0);
    let local = locals(&t_s, &poses, begins_anew);
    let recording = Recording { inputs, lag_s: model.input_lag_s, t_s: &t_s };
    let states = states(model, &recording, &poses, &local);
    let nodes = segment_starts(&t_s, segment_s, begins_anew);
    let nodes = nodes.into_iter().map(|k| (poses[k].0, states[k].clone())).collect();
    let moving = |k: usize| {
        let input = inputs.index_at(t_s[k] - model.input_lag_s)?;
        Some(Moving { input: inputs.row(input), state: &states[k], local: &local[k] })
    };
    let rows: Vec<Moving<'_>> = (0..poses.len()).filter_map(moving).collect();
    Ok(Begin { model: rough(model, &rows), nodes })
}

/// Inputs and state at an instant, with the state's accelerations.
struct Moving<'a> {
    input: &'a [f64],
    state: &'a [f64],
    local: &'a Local,
}

/// Parameters in which the accelerations are linear and that are nearest to those measured, by least squares
/// with a weak pull towards the values given; all others keep their values. Good for a start alone: the
/// polynomials flatten what is fast.
fn rough(model: &FlightModel, rows: &[Moving<'_>]) -> FlightModel {
    let equations = Equations::new(model);
    let n = equations.places.len();
    let mut normal = DMatrix::<f64>::zeros(n, n);
    let mut right = DVector::<f64>::zeros(n);
    let mut evaluation = equations.dynamics.with(&equations.values(model));
    let mut predicted = vec![0.0; equations.dynamics.states()];
    for Moving { input, state, local } in rows {
        evaluation.set_inputs(input);
        evaluation.linearise(state, &mut predicted);
        let mut by = DMatrix::zeros(n, predicted.len());
        let linear = evaluation.by_parameter().filter(|s| equations.is_linear[equations.places[s.column]]);
        linear.for_each(|slope| by[(slope.column, slope.row)] = slope.value);
        for (row, measured) in (7..13).zip(local.velocity_rate.iter().chain(&local.rate_rate)) {
            let by = by.column(row);
            normal.ger(1.0, &by, &by, 1.0);
            right.axpy(measured - predicted[row], &by, 1.0);
        }
    }
    for k in 0..n {
        normal[(k, k)] = normal[(k, k)] * (1.0 + PULL) + f64::MIN_POSITIVE.sqrt();
    }
    let mut out = model.clone();
    let step = normal.cholesky().map(|c| c.solve(&right)).filter(|s| s.iter().all(|v| v.is_finite()));
    for (place, d) in equations.places.iter().zip(step.iter().flatten()) {
        let parameter = model.free()[*place];
        out.set(parameter, model.value(parameter) + d);
    }
    if out.is_physical() { out } else { model.clone() }
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

/// Of each pose, from those of its own piece of the motion alone.
fn locals(t_s: &[f64], poses: &[(usize, Isometry3<f64>)], begins_anew: impl Fn(usize) -> bool) -> Vec<Local> {
    let mut edges = vec![0];
    edges.extend((1..poses.len()).filter(|k| begins_anew(*k)));
    edges.push(poses.len());
    let piece = |w: &[usize]| {
        let (t_s, poses) = (&t_s[w[0]..w[1]], &poses[w[0]..w[1]]);
        (0..poses.len()).map(|k| Local::at(k, t_s, poses)).collect::<Vec<_>>()
    };
    edges.windows(2).flat_map(piece).collect()
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

/// Recorded inputs and the times at which poses are known.
struct Recording<'a> {
    inputs: &'a InputSeries,
    lag_s: f64,
    t_s: &'a [f64],
}

/// States at the times: pose, velocity and rates as measured, further states as the model carries them along
/// that motion, which is straight between the times.
fn states(
    model: &FlightModel,
    recording: &Recording<'_>,
    poses: &[(usize, Isometry3<f64>)],
    local: &[Local],
) -> Vec<Vec<f64>> {
    let rigid = |k: usize| -> Vec<f64> {
        let pose = &poses[k].1;
        let q = world_from_level().inverse() * pose.rotation;
        let (p, v, w) = (pose.translation.vector, local[k].velocity_in_body, local[k].rates);
        vec![p.x, p.y, p.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, w.x, w.y, w.z]
    };
    let equations = Equations::new(model);
    let mut evaluation = equations.dynamics.with(&equations.values(model));
    let Recording { inputs, lag_s, t_s } = *recording;
    let raster = Raster { inputs, lag_s, times_s: t_s, longest_s: LONGEST_STEP_S[0] };
    let first = inputs.row(raster.input_at(t_s[0]));
    let mut further = model.model().initial(model.values(), first);
    let mut out: Vec<Vec<f64>> = Vec::with_capacity(t_s.len());
    out.push([rigid(0), further.clone()].concat());
    evaluation.set_inputs(first);
    for k in 1..t_s.len() {
        let (from, mut to) = (rigid(k - 1), rigid(k));
        let opposite = from[3..7].iter().zip(&to[3..7]).map(|(a, b)| a * b).sum::<f64>() < 0.0;
        if opposite {
            to[3..7].iter_mut().for_each(|q| *q = -*q);
        }
        let follows_s = longest_step_s(fastest(&mut evaluation, &out[k - 1]));
        let longest_s = LONGEST_STEP_S[0].min(follows_s).max(SHORTEST_TIME_CONSTANT_S);
        let mut now_s = t_s[k - 1];
        for step in (Raster { longest_s, ..raster }).steps(t_s[k - 1], t_s[k], k..k + 1) {
            evaluation.set_inputs(inputs.row(step.input));
            let share = |s: f64| (now_s + s * step.h_s - t_s[k - 1]) / (t_s[k] - t_s[k - 1]);
            let motion = Along { from: &from, to: &to, begin: share(0.0), end: share(1.0), h_s: step.h_s };
            further = carried(&mut evaluation, &motion, &further);
            now_s += step.h_s;
        }
        out.push([rigid(k), further.clone()].concat());
    }
    out
}

/// A part of the straight way from one rigid state to another.
struct Along<'a> {
    from: &'a [f64],
    to: &'a [f64],
    begin: f64,
    end: f64,
    h_s: f64,
}

/// Further states after a step of the classical Runge-Kutta method along a known motion.
fn carried(evaluation: &mut Evaluation<'_>, along: &Along<'_>, further: &[f64]) -> Vec<f64> {
    let mut rate = |share: f64, further: &[f64]| -> Vec<f64> {
        let at = along.begin + share * (along.end - along.begin);
        let mut y: Vec<f64> = along.from.iter().zip(along.to).map(|(a, b)| a + at * (b - a)).collect();
        y.extend(further);
        let mut out = vec![0.0; y.len()];
        evaluation.rates(&y, &mut out);
        out.split_off(RIGID_STATES)
    };
    let plus =
        |k: &[f64], h_s: f64| -> Vec<f64> { further.iter().zip(k).map(|(x, k)| x + h_s * k).collect() };
    let h_s = along.h_s;
    let k1 = rate(0.0, further);
    let k2 = rate(0.5, &plus(&k1, 0.5 * h_s));
    let k3 = rate(0.5, &plus(&k2, 0.5 * h_s));
    let k4 = rate(1.0, &plus(&k3, h_s));
    let sum = |k: usize| h_s / 6.0 * (k1[k] + 2.0 * (k2[k] + k3[k]) + k4[k]);
    further.iter().enumerate().map(|(k, x)| x + sum(k)).collect()
}
