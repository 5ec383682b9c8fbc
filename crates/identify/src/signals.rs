//! The signals that a model may name, from motion and inputs.

use crate::IdentifyError;
use crate::lowpass::{lowpass_at, means_of_held, median, read};
use crate::model::{Measured, SIGNALS, factors};
use crate::noise::{Source, Term, Transfer};
use mavsight_flight::flapping::{self, Between};
use mavsight_flight::{HelicopterInput, InputSeries, Vehicle, force_per_speed2, thrust_n};
use mavsight_geometry::Vector3;
use mavsight_pose::{Motion, MotionSample, lowpass_like};

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
}

/// Which of the smoother's low-passes a signal has passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Passed {
    pub(crate) translation: bool,
    pub(crate) rotation: bool,
}

impl Passed {
    pub(crate) const TRANSLATION: Self = Self { translation: true, rotation: false };
    pub(crate) const ROTATION: Self = Self { translation: false, rotation: true };

    pub(crate) fn and(self, other: Self) -> Self {
        Self { translation: self.translation || other.translation, rotation: self.rotation || other.rotation }
    }

    /// What the measured side passes: a specific force is an acceleration and the weight, which the attitude
    /// tips.
    pub(crate) fn by_measured(measured: Measured) -> Self {
        if measured.axis().1 { Self::ROTATION } else { Self::TRANSLATION.and(Self::ROTATION) }
    }

    /// What a regressor has passed before anything is done to it.
    pub(crate) fn by_regressor(regressor: &str) -> Self {
        factors(regressor).fold(Self::default(), |passed, name| {
            passed.and(match Factor::of(name) {
                Factor::Velocity(_) => Self::TRANSLATION,
                Factor::Input => Self::default(),
                Factor::Rate(_) | Factor::Upper(_) | Factor::Lower(_) => Self::ROTATION,
            })
        })
    }
}

/// What a signal is: of the motion along or about a body axis, or of the inputs alone.
#[derive(Debug, Clone, Copy)]
enum Factor {
    Velocity(usize),
    Rate(usize),
    /// Flapping of the upper rotor: axis 1 longitudinal, 0 lateral.
    Upper(usize),
    Lower(usize),
    Input,
}

impl Factor {
    fn of(name: &str) -> Self {
        match name {
            "u" => Self::Velocity(0),
            "v" => Self::Velocity(1),
            "w" => Self::Velocity(2),
            "p" => Self::Rate(0),
            "q" => Self::Rate(1),
            "r" => Self::Rate(2),
            "beta_u" => Self::Upper(0),
            "alpha_u" => Self::Upper(1),
            "beta_l" => Self::Lower(0),
            "alpha_l" => Self::Lower(1),
            _ => Self::Input,
        }
    }
}

pub(crate) struct Flight<'a> {
    pub(crate) t_s: Vec<f64>,
    pub(crate) motion: &'a Motion,
    inputs: &'a InputSeries,
    vehicle: &'a Vehicle,
    helicopter: Vec<HelicopterInput>,
}

impl<'a> Flight<'a> {
    /// # Errors
    /// Inputs that do not cover the motion, or that have some columns of the helicopter and not all.
    pub(crate) fn new(
        motion: &'a Motion,
        inputs: &'a InputSeries,
        vehicle: &'a Vehicle,
    ) -> Result<Self, IdentifyError> {
        let t_s: Vec<f64> = motion.samples.iter().map(|s| s.t_ns as f64 * 1e-9).collect();
        for t_s in t_s.first().into_iter().chain(t_s.last()) {
            inputs.require(*t_s)?;
        }
        Ok(Self { t_s, motion, inputs, vehicle, helicopter: HelicopterInput::series(inputs)? })
    }

    fn of(&self, value: impl Fn(&MotionSample) -> f64) -> Vec<f64> {
        self.motion.samples.iter().map(value).collect()
    }

    fn of_inputs(&self, value: impl Fn(&HelicopterInput) -> f64) -> Vec<f64> {
        self.helicopter.iter().map(value).collect()
    }

    /// The variance at each row of a source's errors that change: by the smoother's variance of its rate, of
    /// which white errors behind H = 1/(1 + (f/fc)⁶) have (2π fc)²/2 times their own. Systematic errors, such
    /// as a camera's, are no part of it.
    pub(crate) fn variances(&self, source: Source) -> Vec<f64> {
        let (place, hz) = match source {
            Source::Position(axis) => (6 + axis, self.motion.translation_bandwidth_hz),
            Source::Turn(axis) => (9 + axis, self.motion.rotation_bandwidth_hz),
        };
        let per_rate = 2.0 / (2.0 * std::f64::consts::PI * hz).powi(2);
        let variances = self.of(|s| per_rate * s.covariance.variance(place));
        variances.into_iter().map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 }).collect()
    }

    /// Intervals between times over which the motion cannot be read.
    pub(crate) fn gaps_s(&self) -> impl Iterator<Item = (f64, f64)> {
        let longest_s = self.motion.longest_step_s();
        self.t_s.windows(2).filter(move |w| w[1] - w[0] > longest_s).map(|w| (w[0], w[1]))
    }

    /// The standard deviation of the turn about a body axis at the first time, without systematic errors:
    /// those are what the variances of all times have beyond [`Flight::variance`].
    pub(crate) fn start_turn_std_rad(&self, axis: usize) -> f64 {
        let turns = self.of(|s| s.covariance.variance(3 + axis));
        let beyond = turns.iter().zip(self.variances(Source::Turn(axis))).map(|(all, own)| all - own);
        (turns[0] - median(beyond.collect()).max(0.0)).max(0.0).sqrt()
    }

    /// What is measured, newtons or newton metres.
    pub(crate) fn measured(&self, measured: Measured, passed: Passed) -> Signal {
        let (axis, is_moment) = measured.axis();
        if is_moment { self.moment(axis, passed) } else { self.force(axis, passed) }
    }

    fn moment(&self, axis: usize, passed: Passed) -> Signal {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        let inertia = self.vehicle.inertia_kg_m2;
        let values = self.of(|s| {
            inertia[axis] * s.angular_acceleration_rad_s2[axis]
                + (inertia[last] - inertia[next]) * s.rates_rad_s[next] * s.rates_rad_s[last]
        });
        self.moved(values, Source::Turn(axis), Transfer::Derivative(2), inertia[axis], passed)
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
    pub(crate) fn regressor(&self, regressor: &str, passed: Passed) -> Result<Signal, IdentifyError> {
        let mut series = vec![1.0; self.helicopter.len()];
        let mut product = Signal { values: vec![1.0; self.t_s.len()], terms: Vec::new() };
        for name in factors(regressor) {
            if let Some(factor) = self.signal(Factor::of(name), passed)? {
                product.multiply(factor);
                continue;
            }
            let input = self.input(name).ok_or_else(|| IdentifyError::UnknownSignal {
                output: "of the model".to_owned(),
                signal: name.to_owned(),
                known: SIGNALS.map(|(name, _)| name).join(", "),
            })?;
            series.iter_mut().zip(&input).for_each(|(s, v)| *s *= v);
        }
        let values = self.onto_frames(&series, Between::Hold, passed)?;
        product.multiply(Signal { values, terms: Vec::new() });
        Ok(product)
    }

    /// A signal that the motion has a part in; none for inputs.
    fn signal(&self, factor: Factor, passed: Passed) -> Result<Option<Signal>, IdentifyError> {
        let rotor = &self.vehicle.rotor;
        Ok(Some(match factor {
            Factor::Input => return Ok(None),
            Factor::Velocity(axis) => {
                let values = self.of(|s| s.velocity_in_body_m_s[axis]);
                self.moved(values, Source::Position(axis), Transfer::Derivative(1), 1.0, passed)
            }
            Factor::Rate(axis) => {
                let values = self.of(|s| s.rates_rad_s[axis]);
                self.moved(values, Source::Turn(axis), Transfer::Derivative(1), 1.0, passed)
            }
            Factor::Upper(axis) => {
                let (time_s, gain) = (rotor.flap_time_flybar_s, rotor.flybar_gain);
                let values = self.flapping_from_rate(axis, time_s)?.iter().map(|a| gain * a).collect();
                self.moved(values, Source::Turn(axis), Transfer::Washout { time_s }, -gain, passed)
            }
            // What the swash-plate drives, and what the rate drives.
            Factor::Lower(axis) => {
                let time_s = rotor.flap_time_lower_s;
                let (longitudinal, lateral) = flapping::lower_from_swashplate(&self.helicopter, rotor);
                let driven = if axis == 1 { longitudinal } else { lateral };
                let driven = self.onto_frames(&driven, Between::Line, passed)?;
                let rate = self.flapping_from_rate(axis, time_s)?;
                let mut out =
                    self.moved(rate, Source::Turn(axis), Transfer::Washout { time_s }, -1.0, passed);
                out.values.iter_mut().zip(&driven).for_each(|(value, driven)| *value += driven);
                out
            }
        }))
    }

    /// A signal of the inputs alone, at their times.
    fn input(&self, name: &str) -> Option<Vec<f64>> {
        let ratio = |omega_rad_s: f64, s: &HelicopterInput| {
            let mean_rad_s = 0.5 * (s.omega_u_rad_s + s.omega_l_rad_s);
            if mean_rad_s == 0.0 { 0.0 } else { (omega_rad_s / mean_rad_s).powi(2) }
        };
        Some(match name {
            "1" => vec![1.0; self.helicopter.len()],
            "delta_lon" => self.of_inputs(|s| s.delta_lon_rad),
            "delta_lat" => self.of_inputs(|s| s.delta_lat_rad),
            "T_u" => self.of_inputs(|s| thrust_n(self.vehicle, s).upper_n),
            "T_l" => self.of_inputs(|s| thrust_n(self.vehicle, s).lower_n),
            "omega_u" => self.of_inputs(|s| s.omega_u_rad_s),
            "omega_l" => self.of_inputs(|s| s.omega_l_rad_s),
            "kappa_u" => self.of_inputs(|s| ratio(s.omega_u_rad_s, s)),
            "kappa_l" => self.of_inputs(|s| ratio(s.omega_l_rad_s, s)),
            "kappa_d" => self.of_inputs(|s| ratio(s.omega_l_rad_s, s) - ratio(s.omega_u_rad_s, s)),
            _ => self.inputs.column(name)?,
        })
    }

    fn flapping_from_rate(&self, axis: usize, time_s: f64) -> Result<Vec<f64>, IdentifyError> {
        if let Some((from_s, to_s)) = self.gaps_s().next() {
            return Err(IdentifyError::GapInMotion { from_s, to_s });
        }
        let rate = self.of(|s| s.rates_rad_s[axis]);
        let acceleration = self.of(|s| s.angular_acceleration_rad_s2[axis]);
        Ok(flapping::from_rate(&self.t_s, &rate, &acceleration, time_s))
    }

    /// ½ρπR⁴ω² for a force, ½ρπR⁵ω² for a moment, at each time, with the square low-passed as the force is.
    pub(crate) fn rotor_scale(&self, is_moment: bool, passed: Passed) -> Result<Vec<f64>, IdentifyError> {
        let radius_m = self.vehicle.rotor.radius_m;
        let per_square = force_per_speed2(self.vehicle) * if is_moment { radius_m } else { 1.0 };
        let square = self.of_inputs(|s| (0.5 * (s.omega_u_rad_s + s.omega_l_rad_s)).powi(2));
        let square = self.onto_frames(&square, Between::Hold, passed)?;
        if let Some(k) = square.iter().position(|s| *s < 1.0) {
            let omega_rad_s = square[k].max(0.0).sqrt();
            return Err(IdentifyError::RotorsStopped { t_s: self.t_s[k], omega_rad_s });
        }
        Ok(square.iter().map(|s| per_square * s).collect())
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

    /// A series on the inputs' times, low-passed on a regular grid of their mean interval and read off at the
    /// frames; of a series that holds a grid point gets the mean over the interval around it.
    fn onto_frames(
        &self,
        series: &[f64],
        between: Between,
        passed: Passed,
    ) -> Result<Vec<f64>, IdentifyError> {
        let first = series.first().copied().unwrap_or(0.0);
        if series.iter().all(|v| *v == first) {
            return Ok(vec![first; self.t_s.len()]);
        }
        let times_s = self.inputs.times_s();
        let (start_s, end_s) = (self.inputs.start_s(), self.inputs.end_s());
        let step_s = (end_s - start_s) / (times_s.len() - 1) as f64;
        let grid_s: Vec<f64> = (0..times_s.len()).map(|k| start_s + step_s * k as f64).collect();
        let regular = match between {
            Between::Hold => means_of_held(times_s, series, &grid_s, step_s),
            Between::Line => read(times_s, series, &grid_s)?,
        };
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
