//! Fixed-step Runge-Kutta integration of a state together with its sensitivities.

use super::model::Equations;
use mavsight_flight::InputSeries;
use mavsight_model::{Evaluation, Fastest};
use nalgebra::{DMatrix, Matrix3, Matrix3x4, Quaternion, RowVector4, UnitQuaternion, Vector3};
use std::ops::Range;

/// Degrees of freedom that a measurement sees: those of the pose.
pub(crate) const SEEN: usize = 6;

/// Steps per time constant, at least: the error of a step is then (1/5)⁵/120 of the transient.
const STEPS_PER_TIME_CONSTANT: f64 = 5.0;
/// What follows faster cannot be flown in the time that a user waits.
pub(crate) const SHORTEST_TIME_CONSTANT_S: f64 = 1e-4;
/// Times this near to each other are one that was rounded: measurements have theirs in nanoseconds.
const ROUNDING_S: f64 = 1e-9;

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
    pub(crate) inputs: &'a InputSeries,
    pub(crate) lag_s: f64,
    pub(crate) times_s: &'a [f64],
    pub(crate) longest_s: f64,
}

impl Raster<'_> {
    /// The row of the inputs that acts from a time on.
    pub(crate) fn input_at(&self, t_s: f64) -> usize {
        let rows_s = self.inputs.times_s();
        rows_s.partition_point(|row_s| self.ahead_s(*row_s, t_s) <= ROUNDING_S).max(1) - 1
    }

    /// By how much a row of the inputs acts after a time: the times are subtracted first, as times of day are so large that
    /// a lag that is added to one is rounded, and a fit would find no slope along it.
    fn ahead_s(&self, row_s: f64, t_s: f64) -> f64 {
        (row_s - t_s) + self.lag_s
    }

    /// Steps from one time to another that end at every change of the inputs and at every instant.
    ///
    /// `instants` are indices into the times of what lies in (from, to].
    pub(crate) fn steps(&self, from_s: f64, to_s: f64, instants: Range<usize>) -> Vec<Step> {
        let mut input = self.input_at(from_s);
        let mut ahead = instants.peekable();
        let mut out = Vec::new();
        let length_s = to_s - from_s;
        let mut now_s = 0.0;
        while now_s < length_s - ROUNDING_S {
            let next = self.inputs.times_s().get(input + 1);
            let change_s = next.map_or(f64::INFINITY, |row_s| self.ahead_s(*row_s, from_s));
            let instant_s = ahead.peek().map_or(f64::INFINITY, |k| self.times_s[*k] - from_s);
            let end_s = change_s.min(instant_s).min(length_s);
            let count = ((end_s - now_s) / self.longest_s).ceil().max(1.0);
            let step = Step { h_s: (end_s - now_s) / count, input, changes_to: None, instant: None };
            out.extend(std::iter::repeat_n(step, count as usize - 1));
            let changes = (change_s - end_s).abs() < ROUNDING_S;
            input += usize::from(changes);
            let is_instant = (instant_s - end_s).abs() < ROUNDING_S;
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

/// The state of the shortest time constant at a state: that of the largest derivative of a state's rate by
/// the state itself.
pub(crate) fn fastest(evaluation: &mut Evaluation<'_>, y: &[f64]) -> Fastest {
    evaluation.linearise(y, &mut vec![0.0; y.len()]);
    let own = evaluation.by_state().filter(|slope| slope.row == slope.column);
    own.map(|slope| Fastest { state: slope.row, time_s: slope.value.abs().recip() })
        .min_by(|a, b| a.time_s.total_cmp(&b.time_s))
        .unwrap_or(Fastest { state: 0, time_s: f64::INFINITY })
}

/// The longest step that follows a motion.
pub(crate) fn longest_step_s(fastest: Fastest) -> f64 {
    fastest.time_s / STEPS_PER_TIME_CONSTANT
}

/// A state and its derivative with respect to where it started and to the free parameters.
pub(crate) struct Propagator<'a> {
    pub(crate) y: Vec<f64>,
    equations: &'a Equations,
    /// A column for each state; rows: the start's degrees of freedom, free parameters.
    by: DMatrix<f64>,
    work: Work,
}

/// Room for the stages of a step.
struct Work {
    stage: DMatrix<f64>,
    sum: DMatrix<f64>,
    rate: DMatrix<f64>,
}

/// Weights of the classical fourth-order method: node of the next stage, weight in the sum.
const STAGES: [(f64, f64); 4] = [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];

impl<'a> Propagator<'a> {
    pub(crate) fn new(equations: &'a Equations, y: &[f64]) -> Self {
        let tangent = equations.tangent();
        let mut by = DMatrix::zeros(tangent + equations.is_linear.len(), y.len());
        (0..3).for_each(|k| by[(k, k)] = 1.0);
        (6..tangent).for_each(|k| by[(k, k + 1)] = 1.0);
        by.fixed_view_mut::<3, 4>(3, 3).copy_from(&by_turn(y));
        let work = Work { stage: by.clone(), sum: by.clone(), rate: by.clone() };
        Self { y: y.to_vec(), equations, by, work }
    }

    /// One step: the classical Runge-Kutta method for the state, and its exact derivative. The evaluation has
    /// the inputs of the step, and afterwards those of the next.
    pub(crate) fn step(&mut self, evaluation: &mut Evaluation<'_>, inputs: &InputSeries, step: &Step) {
        let (mut y_stage, mut y_sum, mut k) = (self.y.clone(), self.y.clone(), self.y.clone());
        let Work { stage, sum, rate } = &mut self.work;
        stage.copy_from(&self.by);
        sum.copy_from(&self.by);
        for (node, weight) in STAGES {
            evaluation.linearise(&y_stage, &mut k);
            variational(self.equations, evaluation, stage, rate);
            for i in 0..k.len() {
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
        self.y = y_sum;
        std::mem::swap(&mut self.by, sum);
        let Some(next) = step.changes_to else { return };
        let mut old = k;
        if self.equations.lag.is_some() {
            evaluation.rates(&self.y, &mut old);
        }
        evaluation.set_inputs(inputs.row(next));
        if let Some(lag) = self.equations.lag {
            // A later change leaves the old rates for longer in place of the new.
            let mut new = old.clone();
            evaluation.rates(&self.y, &mut new);
            let row = self.equations.tangent() + lag;
            (0..old.len()).for_each(|i| self.by[(row, i)] += old[i] - new[i]);
        }
    }

    /// Derivative of the state's degrees of freedom, a column each, by the start's and the free parameters.
    pub(crate) fn tangent(&self) -> DMatrix<f64> {
        let tangent = self.equations.tangent();
        let mut out = DMatrix::zeros(self.by.nrows(), tangent);
        out.columns_mut(0, 3).copy_from(&self.by.columns(0, 3));
        out.columns_mut(6, tangent - 6).copy_from(&self.by.columns(7, tangent - 6));
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

/// rate = A stage + B.
fn variational(
    equations: &Equations,
    evaluation: &Evaluation<'_>,
    stage: &DMatrix<f64>,
    rate: &mut DMatrix<f64>,
) {
    rate.fill(0.0);
    let tangent = equations.tangent();
    for slope in evaluation.by_parameter() {
        rate[(tangent + equations.places[slope.column], slope.row)] = slope.value;
    }
    let rows = stage.nrows();
    for slope in evaluation.by_state() {
        let from = &stage.as_slice()[slope.column * rows..(slope.column + 1) * rows];
        let out = &mut rate.as_mut_slice()[slope.row * rows..(slope.row + 1) * rows];
        out.iter_mut().zip(from).for_each(|(out, stage)| *out += slope.value * stage);
    }
}

/// Derivative of the attitude's four numbers by a small turn about the body's axes: a row for each axis.
pub(crate) fn by_turn(y: &[f64]) -> Matrix3x4<f64> {
    let q = Quaternion::new(y[3], y[4], y[5], y[6]);
    let rows = [0, 1, 2].map(|k| {
        let d = q * Quaternion::from_imag(Vector3::ith(k, 0.5));
        RowVector4::new(d.w, d.i, d.j, d.k)
    });
    Matrix3x4::from_rows(&rows)
}

pub(crate) fn attitude(y: &[f64]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(y[3], y[4], y[5], y[6]))
}

pub(crate) fn moved(y: &[f64], d: &[f64]) -> Vec<f64> {
    let q = attitude(y) * UnitQuaternion::from_scaled_axis(Vector3::new(d[3], d[4], d[5]));
    let mut out: Vec<f64> = (0..y.len()).map(|k| y[k] + if k < 3 { d[k] } else { d[k.max(1) - 1] }).collect();
    out[3..7].copy_from_slice(&[q.w, q.i, q.j, q.k]);
    out
}

/// The degrees of freedom that lead from one state to another.
pub(crate) fn difference(to: &[f64], from: &[f64]) -> Vec<f64> {
    let turn = (attitude(from).inverse() * attitude(to)).scaled_axis();
    let one = |k: usize| match k {
        0..=2 => to[k] - from[k],
        3..=5 => turn[k - 3],
        _ => to[k + 1] - from[k + 1],
    };
    (0..to.len() - 1).map(one).collect()
}
