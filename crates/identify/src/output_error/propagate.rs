//! Fixed-step Runge-Kutta integration of a state together with its sensitivities.

use super::model::{FlightModel, ModelParameter};
use mavsight_flight::{Coefficient, FLIGHT_STATES, InputSample, Linearisation, StateVector};
use nalgebra::{DMatrix, Quaternion, UnitQuaternion, Vector3};

/// Degrees of freedom of a state: position (world), turn (body), velocity (body), rates, flapping.
pub(crate) const TANGENT: usize = 16;
/// Degrees of freedom that a measurement may see: the same without flapping.
pub(crate) const SEEN: usize = 12;

/// Steps per flapping time constant, at least: the error of a step is then (1/5)⁵/120 of the transient.
const STEPS_PER_FLAP_TIME: f64 = 5.0;
/// Events nearer than this are one.
const SAME_TIME_S: f64 = 1e-9;

/// One step of constant inputs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) h_s: f64,
    /// Index of the input that holds.
    pub(crate) input: usize,
    /// The input changes to another at the end of the step.
    pub(crate) changes_to: Option<usize>,
    /// Instant that is measured at the end of the step.
    pub(crate) instant: Option<usize>,
}

/// What divides a flight into steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Raster<'a> {
    pub(crate) inputs: &'a [InputSample],
    pub(crate) times_s: &'a [f64],
    pub(crate) longest_s: f64,
}

impl Raster<'_> {
    /// Steps from one time to another that end at every change of the inputs and at every instant.
    ///
    /// `instants` are indices into the times of what lies in (from, to].
    pub(crate) fn steps(
        &self,
        (from_s, to_s): (f64, f64),
        model: &FlightModel,
        instants: std::ops::Range<usize>,
    ) -> Vec<Step> {
        let (inputs, times_s) = (self.inputs, self.times_s);
        let lag_s = model.input_lag_s;
        let time_s = |of| model.coefficients.get(of);
        let tau_s = time_s(Coefficient::TauLower).min(time_s(Coefficient::TauFlybar));
        let longest_s = self.longest_s.min(tau_s / STEPS_PER_FLAP_TIME);
        let mut input = inputs.partition_point(|s| s.t_s + lag_s <= from_s + SAME_TIME_S).max(1) - 1;
        let mut next_instant = instants.start;
        let mut out = Vec::new();
        let mut now_s = from_s;
        while now_s < to_s - SAME_TIME_S {
            let change_s = inputs.get(input + 1).map_or(f64::INFINITY, |s| s.t_s + lag_s);
            let instant_s = if next_instant < instants.end { times_s[next_instant] } else { f64::INFINITY };
            let end_s = change_s.min(instant_s).min(to_s);
            let count = ((end_s - now_s) / longest_s).ceil().max(1.0);
            for _ in 0..count as usize {
                out.push(Step { h_s: (end_s - now_s) / count, input, changes_to: None, instant: None });
            }
            if let Some(last) = out.last_mut() {
                if (change_s - end_s).abs() < SAME_TIME_S {
                    input += 1;
                    last.changes_to = Some(input);
                }
                if (instant_s - end_s).abs() < SAME_TIME_S {
                    last.instant = Some(next_instant);
                    next_instant += 1;
                }
            }
            now_s = end_s;
        }
        out
    }
}

/// A state and its derivative with respect to where it started (16 columns) and to the free parameters.
pub(crate) struct Propagator {
    pub(crate) y: StateVector,
    columns: usize,
    free: Vec<ModelParameter>,
    s: Vec<f64>,
    stage: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
}

/// Weights of the classical fourth-order method: node of the next stage, weight in the sum.
const STAGES: [(f64, f64); 4] = [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];

impl Propagator {
    pub(crate) fn new(free: &[ModelParameter]) -> Self {
        let columns = TANGENT + free.len();
        let zeros = || vec![0.0; FLIGHT_STATES * columns];
        Self {
            y: [0.0; FLIGHT_STATES],
            columns,
            free: free.to_vec(),
            s: zeros(),
            stage: zeros(),
            rate: zeros(),
            sum: zeros(),
        }
    }

    /// Begins again at a state.
    pub(crate) fn start(&mut self, y: &StateVector) {
        self.y = *y;
        self.s.fill(0.0);
        let n = self.columns;
        for k in 0..3 {
            self.s[k * n + k] = 1.0;
            self.s[(7 + k) * n + 6 + k] = 1.0;
            self.s[(10 + k) * n + 9 + k] = 1.0;
        }
        for k in 0..4 {
            self.s[(13 + k) * n + 12 + k] = 1.0;
        }
        let q = Quaternion::new(y[3], y[4], y[5], y[6]);
        for k in 0..3 {
            let d = q * Quaternion::from_imag(Vector3::ith(k, 0.5));
            for (row, value) in [d.w, d.i, d.j, d.k].into_iter().enumerate() {
                self.s[(3 + row) * n + 3 + k] = value;
            }
        }
    }

    /// One step: the classical Runge-Kutta method for the state, and its exact derivative.
    pub(crate) fn step(&mut self, model: &FlightModel, inputs: &[InputSample], step: &Step) {
        let input = &inputs[step.input];
        let (airframe, c) = (&model.airframe, &model.coefficients);
        let mut y_stage = self.y;
        let mut y_sum = self.y;
        self.stage.copy_from_slice(&self.s);
        self.sum.copy_from_slice(&self.s);
        for (node, weight) in STAGES {
            let k = airframe.derivative(c, input, &y_stage);
            self.variational(&airframe.linearise(c, input, &y_stage));
            for i in 0..FLIGHT_STATES {
                y_sum[i] += step.h_s * weight * k[i];
                y_stage[i] = self.y[i] + step.h_s * node * k[i];
            }
            axpy(&mut self.sum, step.h_s * weight, &self.rate);
            if node > 0.0 {
                self.stage.copy_from_slice(&self.s);
                axpy(&mut self.stage, step.h_s * node, &self.rate);
            }
        }
        self.y = y_sum;
        std::mem::swap(&mut self.s, &mut self.sum);
        if let (Some(next), Some(lag)) =
            (step.changes_to, self.free.iter().position(|p| *p == ModelParameter::InputLag))
        {
            // A later change leaves the old rates for longer in place of the new.
            let (old, new) =
                (airframe.derivative(c, input, &self.y), airframe.derivative(c, &inputs[next], &self.y));
            for i in 0..FLIGHT_STATES {
                self.s[i * self.columns + TANGENT + lag] += old[i] - new[i];
            }
        }
    }

    /// rate = A stage + B.
    fn variational(&mut self, linear: &Linearisation) {
        let n = self.columns;
        for i in 0..FLIGHT_STATES {
            let row = &mut self.rate[i * n..(i + 1) * n];
            row.fill(0.0);
            for (position, parameter) in self.free.iter().enumerate() {
                if let ModelParameter::Coefficient(which) = parameter {
                    row[TANGENT + position] = linear.by_coefficient[i][*which as usize];
                }
            }
            for &j in Linearisation::COLUMNS[i] {
                axpy(row, linear.by_state[i][j], &self.stage[j * n..(j + 1) * n]);
            }
        }
    }

    /// Derivative of the state's degrees of freedom, a column each, by the start's and the free parameters.
    pub(crate) fn tangent(&self) -> DMatrix<f64> {
        let n = self.columns;
        let mut out = DMatrix::zeros(n, TANGENT);
        out.columns_mut(0, 3).copy_from_slice(&self.s[..3 * n]);
        out.columns_mut(6, 10).copy_from_slice(&self.s[7 * n..]);
        let (w, u) = (self.y[3], Vector3::new(self.y[4], self.y[5], self.y[6]));
        let scale = 2.0 / (w * w + u.norm_squared());
        for k in 0..n {
            let d = Vector3::new(self.s[4 * n + k], self.s[5 * n + k], self.s[6 * n + k]);
            let turn = (d * w - u * self.s[3 * n + k] - u.cross(&d)) * scale;
            out.fixed_view_mut::<1, 3>(k, 3).copy_from(&turn.transpose());
        }
        out
    }

    /// Whether nothing has run away.
    pub(crate) fn is_finite(&self) -> bool {
        self.y.iter().chain(&self.s).all(|v| v.is_finite())
    }
}

fn axpy(out: &mut [f64], factor: f64, x: &[f64]) {
    for (o, v) in out.iter_mut().zip(x) {
        *o += factor * v;
    }
}

pub(crate) fn attitude(y: &StateVector) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(y[3], y[4], y[5], y[6]))
}

/// A state moved by its degrees of freedom.
pub(crate) fn moved(y: &StateVector, d: &[f64]) -> StateVector {
    let q = attitude(y) * UnitQuaternion::from_scaled_axis(Vector3::new(d[3], d[4], d[5]));
    let mut out = *y;
    for k in 0..3 {
        out[k] += d[k];
    }
    (out[3], out[4], out[5], out[6]) = (q.w, q.i, q.j, q.k);
    for k in 6..TANGENT {
        out[k + 1] += d[k];
    }
    out
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
