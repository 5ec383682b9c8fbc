//! Fixed-step Runge-Kutta integration of a state together with its sensitivities.

use super::model::{FlightModel, ModelParameter};
use mavsight_flight::{Coefficient, FLIGHT_STATES, HelicopterInput, Linearisation, StateVector};
use nalgebra::{DMatrix, Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::ops::Range;

/// Degrees of freedom of a state: position (world), turn (body), velocity (body), rates, flapping.
pub(crate) const TANGENT: usize = 16;
/// Degrees of freedom that a measurement sees: those of the pose.
pub(crate) const SEEN: usize = 6;

/// Steps per flapping time constant, at least: the error of a step is then (1/5)⁵/120 of the transient.
const STEPS_PER_FLAP_TIME: f64 = 5.0;
const SAME_TIME_S: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) h_s: f64,
    pub(crate) input: usize,
    /// The input changes to another at the end of the step.
    pub(crate) changes_to: Option<usize>,
    /// Instant that is measured at the end of the step.
    pub(crate) instant: Option<usize>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Raster<'a> {
    pub(crate) inputs: &'a [HelicopterInput],
    pub(crate) times_s: &'a [f64],
    pub(crate) longest_s: f64,
}

impl Raster<'_> {
    /// Steps from one time to another that end at every change of the inputs and at every instant.
    ///
    /// `instants` are indices into the times of what lies in (from, to].
    pub(crate) fn steps(
        &self,
        from_s: f64,
        to_s: f64,
        model: &FlightModel,
        instants: Range<usize>,
    ) -> Vec<Step> {
        let (inputs, lag_s) = (self.inputs, model.input_lag_s);
        let [tau_l, tau_f] =
            [Coefficient::TauLower, Coefficient::TauFlybar].map(|c| model.coefficients.get(c));
        let longest_s = self.longest_s.min(tau_l.min(tau_f) / STEPS_PER_FLAP_TIME);
        let mut input = inputs.partition_point(|s| s.t_s + lag_s <= from_s + SAME_TIME_S).max(1) - 1;
        let mut ahead = instants.peekable();
        let mut out = Vec::new();
        let mut now_s = from_s;
        while now_s < to_s - SAME_TIME_S {
            let change_s = inputs.get(input + 1).map_or(f64::INFINITY, |s| s.t_s + lag_s);
            let instant_s = ahead.peek().map_or(f64::INFINITY, |k| self.times_s[*k]);
            let end_s = change_s.min(instant_s).min(to_s);
            let count = ((end_s - now_s) / longest_s).ceil().max(1.0);
            let step = Step { h_s: (end_s - now_s) / count, input, changes_to: None, instant: None };
            out.extend(std::iter::repeat_n(step, count as usize - 1));
            let changes = (change_s - end_s).abs() < SAME_TIME_S;
            input += usize::from(changes);
            let is_instant = (instant_s - end_s).abs() < SAME_TIME_S;
            out.push(Step {
                changes_to: changes.then_some(input),
                instant: ahead.next_if(|_| is_instant),
                ..step
            });
            now_s = end_s;
        }
        out
    }
}

/// A state and its derivative with respect to where it started (16) and to the free parameters.
pub(crate) struct Propagator {
    pub(crate) y: StateVector,
    free: Vec<ModelParameter>,
    /// A column for each state.
    by: DMatrix<f64>,
}

/// Weights of the classical fourth-order method: node of the next stage, weight in the sum.
const STAGES: [(f64, f64); 4] = [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];

impl Propagator {
    pub(crate) fn new(free: &[ModelParameter], y: &StateVector) -> Self {
        let mut by = DMatrix::zeros(TANGENT + free.len(), FLIGHT_STATES);
        (0..3).for_each(|k| by[(k, k)] = 1.0);
        (6..TANGENT).for_each(|k| by[(k, k + 1)] = 1.0);
        let q = Quaternion::new(y[3], y[4], y[5], y[6]);
        for k in 0..3 {
            let d = q * Quaternion::from_imag(Vector3::ith(k, 0.5));
            by.fixed_view_mut::<1, 4>(3 + k, 3).copy_from_slice(&[d.w, d.i, d.j, d.k]);
        }
        Self { y: *y, free: free.to_vec(), by }
    }

    /// One step: the classical Runge-Kutta method for the state, and its exact derivative.
    pub(crate) fn step(&mut self, model: &FlightModel, inputs: &[HelicopterInput], step: &Step) {
        let input = &inputs[step.input];
        let (airframe, c) = (&model.airframe, &model.coefficients);
        let (mut y_stage, mut y_sum) = (self.y, self.y);
        let (mut stage, mut sum) = (self.by.clone(), self.by.clone());
        let mut rate = DMatrix::zeros(stage.nrows(), FLIGHT_STATES);
        for (node, weight) in STAGES {
            let k = airframe.derivative(c, input, &y_stage);
            self.variational(&airframe.linearise(c, input, &y_stage), &stage, &mut rate);
            for i in 0..FLIGHT_STATES {
                y_sum[i] += step.h_s * weight * k[i];
                y_stage[i] = self.y[i] + step.h_s * node * k[i];
            }
            let stages = stage.as_mut_slice().iter_mut().zip(self.by.as_slice());
            let sums = sum.as_mut_slice().iter_mut().zip(rate.as_slice());
            for ((stage, by), (sum, rate)) in stages.zip(sums) {
                *sum += step.h_s * weight * rate;
                *stage = by + step.h_s * node * rate;
            }
        }
        (self.y, self.by) = (y_sum, sum);
        let lag = self.free.iter().position(|p| *p == ModelParameter::InputLag);
        if let (Some(next), Some(lag)) = (step.changes_to, lag) {
            // A later change leaves the old rates for longer in place of the new.
            let [old, new] = [input, &inputs[next]].map(|input| airframe.derivative(c, input, &self.y));
            for i in 0..FLIGHT_STATES {
                self.by[(TANGENT + lag, i)] += old[i] - new[i];
            }
        }
    }

    /// rate = A stage + B.
    fn variational(&self, linear: &Linearisation, stage: &DMatrix<f64>, rate: &mut DMatrix<f64>) {
        for (i, mut out) in rate.column_iter_mut().enumerate() {
            let out = out.as_mut_slice();
            out.fill(0.0);
            for (position, parameter) in self.free.iter().enumerate() {
                if let ModelParameter::Coefficient(which) = parameter {
                    out[TANGENT + position] = linear.by_coefficient[i][*which as usize];
                }
            }
            for &j in Linearisation::COLUMNS[i] {
                let factor = linear.by_state[i][j];
                out.iter_mut()
                    .zip(stage.column(j).as_slice())
                    .for_each(|(out, stage)| *out += factor * stage);
            }
        }
    }

    /// Derivative of the state's degrees of freedom, a column each, by the start's and the free parameters.
    pub(crate) fn tangent(&self) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.by.nrows(), TANGENT);
        out.columns_mut(0, 3).copy_from(&self.by.columns(0, 3));
        out.columns_mut(6, 10).copy_from(&self.by.columns(7, 10));
        let (w, u) = (self.y[3], Vector3::new(self.y[4], self.y[5], self.y[6]));
        let by_imaginary = Matrix3::identity() * w + u.cross_matrix();
        let turn = self.by.column(3) * -u.transpose() + self.by.columns(4, 3) * by_imaginary;
        out.columns_mut(3, 3).copy_from(&(turn * (2.0 / (w * w + u.norm_squared()))));
        out
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.y.iter().chain(&self.by).all(|v| v.is_finite())
    }
}

pub(crate) fn attitude(y: &StateVector) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(y[3], y[4], y[5], y[6]))
}

pub(crate) fn moved(y: &StateVector, d: &[f64]) -> StateVector {
    let q = attitude(y) * UnitQuaternion::from_scaled_axis(Vector3::new(d[3], d[4], d[5]));
    std::array::from_fn(|k| match k {
        0..=2 => y[k] + d[k],
        3..=6 => [q.w, q.i, q.j, q.k][k - 3],
        _ => y[k] + d[k - 1],
    })
}

/// The degrees of freedom that lead from one state to another.
pub(crate) fn difference(to: &StateVector, from: &StateVector) -> [f64; TANGENT] {
    let turn = (attitude(from).inverse() * attitude(to)).scaled_axis();
    std::array::from_fn(|k| match k {
        0..=2 => to[k] - from[k],
        3..=5 => turn[k - 3],
        _ => to[k + 1] - from[k + 1],
    })
}
