//! The signals of an equation, from motion and inputs.

use crate::IdentifyError;
use crate::further::{Further, between};
use crate::lowpass::{lowpass_at, means_of_held, read};
use crate::model::Equations;
use crate::noise::{Source, Term, Transfer};
use crate::passed::Passed;
use mavsight_flight::response::{self, Between};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::Vector3;
use mavsight_model::Axis;
use mavsight_model::regression::{
    InputSignal, MotionSignal, RegressionEquation, Regressor, StateResponse, StateTerm,
};
use mavsight_pose::{Motion, MotionSample, lowpass_like, median};
use nalgebra::Matrix3;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Signal {
    pub(crate) values: Vec<f64>,
    pub(crate) terms: Vec<Term>,
}

impl Signal {
    pub(crate) fn multiply(&mut self, mut factor: Self) {
        scale_terms(&mut self.terms, &factor.values);
        scale_terms(&mut factor.terms, &self.values);
        self.terms.extend(factor.terms);
        self.values.iter_mut().zip(&factor.values).for_each(|(value, by)| *value *= by);
    }

    fn add(&mut self, other: Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(value, more)| *value += more);
        self.terms.extend(other.terms);
    }
}

/// A signal of the inputs, at their times.
struct Series {
    values: Vec<f64>,
    between: Between,
}

impl Series {
    fn moves(&self) -> bool {
        self.values.iter().any(|v| *v != self.values[0])
    }
}

/// What a signal is of, for messages.
#[derive(Clone, Copy)]
struct What<'a> {
    equation: &'a str,
    regressor: &'a str,
}

pub(crate) struct Flight<'a> {
    pub(crate) t_s: Vec<f64>,
    pub(crate) motion: &'a Motion,
    inputs: &'a InputSeries,
    vehicle: &'a Vehicle,
    equations: &'a Equations,
    further: Further,
}

impl<'a> Flight<'a> {
    /// # Errors
    /// Inputs that do not cover the motion, or without a column that the equations need.
    pub(crate) fn new(
        motion: &'a Motion,
        inputs: &'a InputSeries,
        vehicle: &'a Vehicle,
        equations: &'a Equations,
    ) -> Result<Self, IdentifyError> {
        let t_s: Vec<f64> = motion.samples.iter().map(|s| s.t_ns as f64 * 1e-9).collect();
        for t_s in t_s.first().into_iter().chain(t_s.last()) {
            inputs.require(*t_s)?;
        }
        let further = Further::new(inputs, equations)?;
        Ok(Self { t_s, motion, inputs, vehicle, equations, further })
    }

    /// What a regressor has passed before anything is done to it.
    pub(crate) fn passed_by(&self, regressor: &Regressor) -> Passed {
        Passed::by_regressor(regressor, &self.equations.regression.states)
    }

    /// Names of the inputs that drive a regressor.
    pub(crate) fn inputs_that_drive(&self, regressor: &Regressor) -> Vec<String> {
        let driving = self.equations.inputs_that_drive(regressor);
        driving.into_iter().map(|k| self.equations.inputs[k].name.clone()).collect()
    }

    fn of(&self, value: impl Fn(&MotionSample) -> f64) -> Vec<f64> {
        self.motion.samples.iter().map(value).collect()
    }

    /// The variance at each row of a source's errors that change: by the smoother's variance of its rate, of
    /// which white errors behind H = 1/(1 + (f/fc)⁶) have (2π fc)²/2 times their own. Systematic errors, such
    /// as a camera's, are no part of it, nor is what the smoother errs where the aircraft is moved more than on average: inputs
    /// have passed the same low-pass ([`mavsight_pose::MotionCovariance::noise_variance`]).
    pub(crate) fn variances(&self, source: Source) -> Vec<f64> {
        let (coordinate, hz) = match source {
            Source::Position(axis) => (axis, self.motion.translation_bandwidth_hz),
            Source::Turn(axis) => (3 + axis, self.motion.rotation_bandwidth_hz),
        };
        let per_rate = 2.0 / (2.0 * std::f64::consts::PI * hz).powi(2);
        let variances = self.of(|s| per_rate * s.covariance.noise_variance(coordinate));
        variances.into_iter().map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 }).collect()
    }

    /// Intervals between times over which the motion cannot be read.
    pub(crate) fn gaps_s(&self) -> impl Iterator<Item = (f64, f64)> {
        let longest_s = self.motion.longest_step_s();
        self.t_s.windows(2).filter(move |w| w[1] - w[0] > longest_s).map(|w| (w[0], w[1]))
    }

    /// The standard deviation of a source's errors at the first time, without systematic errors: those are
    /// what the variances of all times have beyond [`Flight::variances`]. That of a position is the mean of
    /// all axes.
    pub(crate) fn start_std(&self, source: Source) -> f64 {
        let all = match source {
            Source::Turn(axis) => self.of(|s| s.covariance.variance(3 + axis)),
            Source::Position(_) => self.of(|s| (0..3).map(|k| s.covariance.variance(k)).sum::<f64>() / 3.0),
        };
        let beyond = all.iter().zip(self.variances(source)).map(|(all, own)| all - own);
        (all[0] - median(beyond.collect()).map_or(0.0, |own| own.max(0.0))).max(0.0).sqrt()
    }

    /// Standard deviation over value of what a measured force or moment is multiplied by.
    pub(crate) fn scale_std(&self, measured: Axis) -> f64 {
        self.vehicle.relative_std(measured)
    }

    /// What is measured, newtons or newton metres.
    pub(crate) fn measured(&self, measured: Axis, passed: Passed) -> Signal {
        match measured {
            Axis::Moment(axis) => self.moment(axis, passed),
            Axis::Force(axis) => self.force(axis, passed),
        }
    }

    fn moment(&self, axis: usize, passed: Passed) -> Signal {
        let ([xx, yy, zz], [xy, xz, yz]) =
            (self.vehicle.inertia_kg_m2, self.vehicle.products_of_inertia_kg_m2);
        let inertia = Matrix3::new(xx, -xy, -xz, -xy, yy, -yz, -xz, -yz, zz);
        let values = self.of(|s| {
            let gyroscopic = s.rates_rad_s.cross(&(inertia * s.rates_rad_s));
            (inertia * s.angular_acceleration_rad_s2 + gyroscopic)[axis]
        });
        let mut out =
            self.moved(values, Source::Turn(axis), Transfer::Derivative(2), inertia[(axis, axis)], passed);
        for other in (0..3).filter(|k| *k != axis && inertia[(axis, *k)] != 0.0) {
            let gains = vec![inertia[(axis, other)]; self.t_s.len()];
            out.terms.push(term(Source::Turn(other), Transfer::Derivative(2), gains));
        }
        out
    }

    /// A signal of the motion alone, with the one way in which errors reach it.
    fn moved(
        &self,
        values: Vec<f64>,
        source: Source,
        transfer: Transfer,
        gain: f64,
        passed: Passed,
    ) -> Signal {
        let own = match source {
            Source::Position(_) => Passed::TRANSLATION,
            Source::Turn(_) => Passed::ROTATION,
        };
        let terms = vec![term(source, transfer, vec![gain; self.t_s.len()])];
        Signal { values: self.pass_rest(values, own, passed), terms }
    }

    /// The force is the sum of the acceleration, which has passed the smoother's low-pass of translation, and
    /// the weight's part along the axis, which has passed that of rotation: both pass both.
    fn force(&self, axis: usize, passed: Passed) -> Signal {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        let weight_n = self.vehicle.mass_kg * self.vehicle.environment.gravity_m_s2;
        let mass_kg = self.vehicle.mass_kg;
        let held = self.of(|s| weight_n * (s.world_from_body.rotation.inverse() * Vector3::z())[axis]);
        let force = |k: usize, sign: f64| self.of(|s| sign * mass_kg * s.specific_force_m_s2[k]);
        let moved = force(axis, 1.0).iter().zip(&held).map(|(f, h)| f - h).collect();
        let moved = self.pass_rest(moved, Passed::TRANSLATION, passed);
        let held = self.pass_rest(held, Passed::ROTATION, passed);
        // A turn δ of the attitude turns the force f by f × δ.
        let terms = vec![
            term(Source::Position(axis), Transfer::Derivative(2), vec![mass_kg; self.t_s.len()]),
            term(Source::Turn(last), Transfer::Derivative(0), force(next, 1.0)),
            term(Source::Turn(next), Transfer::Derivative(0), force(last, -1.0)),
        ];
        Signal { values: moved.iter().zip(&held).map(|(a, b)| a + b).collect(), terms }
    }

    /// A regressor that has passed what it must, and no more.
    ///
    /// Inputs are multiplied before they pass. Other factors of a product pass by themselves: exact where one
    /// of them hardly moves.
    pub(crate) fn regressor(
        &self,
        equation: &str,
        regressor: &Regressor,
        passed: Passed,
    ) -> Result<Signal, IdentifyError> {
        let what = What { equation, regressor: &regressor.name };
        let mut product = Signal { values: vec![1.0; self.t_s.len()], terms: Vec::new() };
        for motion in &regressor.motion {
            product.multiply(self.motion_signal(what, motion, passed)?);
        }
        let series = regressor.inputs.iter().map(|signal| self.series(what, signal));
        let values = self.onto_frames(&series.collect::<Result<Vec<_>, _>>()?, passed)?;
        product.multiply(Signal { values, terms: Vec::new() });
        Ok(product)
    }

    /// A sum of constants times velocity, rates and states, and of a signal of the inputs.
    fn motion_signal(
        &self,
        what: What<'_>,
        motion: &MotionSignal,
        passed: Passed,
    ) -> Result<Signal, IdentifyError> {
        let mut out = Signal { values: vec![0.0; self.t_s.len()], terms: Vec::new() };
        for (axis, factor) in motion.velocity.into_iter().enumerate().filter(|(_, f)| *f != 0.0) {
            let values = self.of(|s| factor * s.velocity_in_body_m_s[axis]);
            let (source, transfer) = (Source::Position(axis), Transfer::Derivative(1));
            out.add(self.moved(values, source, transfer, factor, passed));
        }
        for (axis, factor) in motion.rates.into_iter().enumerate().filter(|(_, f)| *f != 0.0) {
            let values = self.of(|s| factor * s.rates_rad_s[axis]);
            let (source, transfer) = (Source::Turn(axis), Transfer::Derivative(1));
            out.add(self.moved(values, source, transfer, factor, passed));
        }
        for StateTerm { state, factor } in &motion.states {
            let Some(response) = self.equations.regression.states.iter().find(|s| s.state == *state) else {
                continue;
            };
            out.add(self.driven_by_motion(response, *factor, passed)?);
            let driven = self.further.series(*state).iter().map(|x| factor * x).collect();
            let values = self.onto_frames(&[Series { values: driven, between: Between::Line }], passed)?;
            out.add(Signal { values, terms: Vec::new() });
        }
        if let Some(inputs) = &motion.inputs {
            let values = self.onto_frames(&[self.series(what, inputs)?], passed)?;
            out.add(Signal { values, terms: Vec::new() });
        }
        Ok(out)
    }

    /// What of a state the motion drives, times a factor.
    fn driven_by_motion(
        &self,
        state: &StateResponse,
        factor: f64,
        passed: Passed,
    ) -> Result<Signal, IdentifyError> {
        if let Some((from_s, to_s)) = self.gaps_s().next() {
            return Err(IdentifyError::GapInMotion { state: state.name.clone(), from_s, to_s });
        }
        let mut out = Signal { values: vec![0.0; self.t_s.len()], terms: Vec::new() };
        let gravity_m_s2 = self.vehicle.environment.gravity_m_s2;
        for axis in 0..3 {
            let (by_velocity, by_rate) = (factor * state.velocity[axis], factor * state.rates[axis]);
            if by_velocity != 0.0 {
                let velocity = self.of(|s| s.velocity_in_body_m_s[axis]);
                let slope = self.of(|s| {
                    let up_in_body = s.world_from_body.rotation.inverse() * Vector3::z();
                    let turning = s.rates_rad_s.cross(&s.velocity_in_body_m_s);
                    (s.specific_force_m_s2 - up_in_body * gravity_m_s2 - turning)[axis]
                });
                out.add(self.response(state, Source::Position(axis), by_velocity, [velocity, slope], passed));
            }
            if by_rate != 0.0 {
                let rate = self.of(|s| s.rates_rad_s[axis]);
                let slope = self.of(|s| s.angular_acceleration_rad_s2[axis]);
                out.add(self.response(state, Source::Turn(axis), by_rate, [rate, slope], passed));
            }
        }
        Ok(out)
    }

    /// The response of a state to a signal, of which there are values and slopes, with a gain.
    fn response(
        &self,
        state: &StateResponse,
        source: Source,
        gain: f64,
        [values, slopes]: [Vec<f64>; 2],
        passed: Passed,
    ) -> Signal {
        let time_s = state.time_s;
        // The response to minus the signal.
        let response = response::from_rate(&self.t_s, &values, &slopes, time_s);
        let values = response.into_iter().map(|x| -gain * x).collect();
        self.moved(values, source, Transfer::Washout { time_s }, gain, passed)
    }

    /// A signal of the inputs, at their times.
    fn series(&self, what: What<'_>, signal: &InputSignal) -> Result<Series, IdentifyError> {
        let values = self.further.values(signal);
        if let Some(k) = values.iter().position(|v| !v.is_finite()) {
            return Err(IdentifyError::SignalNotFinite {
                equation: what.equation.to_owned(),
                regressor: what.regressor.to_owned(),
                t_s: self.inputs.times_s()[k],
                value: values[k],
            });
        }
        Ok(Series { values, between: between(signal) })
    }

    /// What an equation is divided by, at each time, low-passed as what is measured is.
    pub(crate) fn scale(
        &self,
        equation: &RegressionEquation,
        passed: Passed,
    ) -> Result<Vec<f64>, IdentifyError> {
        /// Of the largest: what a low-pass leaves of nothing.
        const LEAST: f64 = 1e-6;
        let what = What { equation: &equation.name, regressor: "scale" };
        let scale = self.onto_frames(&[self.series(what, &equation.scale)?], passed)?;
        let largest = scale.iter().fold(0.0_f64, |all, s| all.max(s.abs()));
        match scale.iter().position(|s| *s <= LEAST * largest) {
            Some(k) => Err(IdentifyError::ScaleNotPositive {
                equation: equation.name.clone(),
                t_s: self.t_s[k],
                value: scale[k],
            }),
            None => Ok(scale),
        }
    }

    pub(crate) fn bandwidths_hz(&self, passed: Passed) -> impl Iterator<Item = f64> {
        let translation = passed.translation.then_some(self.motion.translation_bandwidth_hz);
        translation.into_iter().chain(passed.rotation.then_some(self.motion.rotation_bandwidth_hz))
    }

    /// Passes the low-passes of `passed` that are not in `own`.
    fn pass_rest(&self, values: Vec<f64>, own: Passed, passed: Passed) -> Vec<f64> {
        let rest = Passed {
            translation: passed.translation && !own.translation,
            rotation: passed.rotation && !own.rotation,
        };
        self.bandwidths_hz(rest).fold(values, |values, hz| lowpass_at(&self.t_s, &values, hz))
    }

    /// The product of series on the inputs' times, low-passed on a regular grid of their mean interval and
    /// read off at the frames; of a series that holds a grid point gets the mean over the interval around it.
    fn onto_frames(&self, all: &[Series], passed: Passed) -> Result<Vec<f64>, IdentifyError> {
        let (moving, constant): (Vec<&Series>, Vec<&Series>) = all.iter().partition(|s| s.moves());
        let constant: f64 = constant.iter().map(|s| s.values.first().copied().unwrap_or(0.0)).product();
        if moving.is_empty() {
            return Ok(vec![constant; self.t_s.len()]);
        }
        let times_s = self.inputs.times_s();
        let (start_s, end_s) = (self.inputs.start_s(), self.inputs.end_s());
        let step_s = (end_s - start_s) / (times_s.len() - 1) as f64;
        let grid_s: Vec<f64> = (0..times_s.len()).map(|k| start_s + step_s * k as f64).collect();
        let mut regular = vec![constant; grid_s.len()];
        for series in moving {
            let own = match series.between {
                Between::Hold => means_of_held(times_s, &series.values, &grid_s, step_s),
                Between::Line => read(times_s, &series.values, &grid_s)?,
            };
            regular.iter_mut().zip(&own).for_each(|(product, value)| *product *= value);
        }
        let smooth = self.bandwidths_hz(passed).fold(regular, |values, hz| lowpass_like(&values, step_s, hz));
        read(&grid_s, &smooth, &self.t_s)
    }
}

fn term(source: Source, transfer: Transfer, gains: Vec<f64>) -> Term {
    Term { source, transfer, gains }
}

pub(crate) fn scale_terms(terms: &mut [Term], by: &[f64]) {
    for term in terms {
        for (gain, by) in term.gains.iter_mut().zip(by) {
            *gain *= by;
        }
    }
}
