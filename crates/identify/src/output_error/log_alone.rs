//! Output error and filter error on a log alone: sensors of the aircraft without a camera.

use super::flight::{Estimate, FlightFitOptions, FlightFits, InputClock, fitted_with_clock};
use super::measure::{LeftOut, Measurements, StateMeasurement};
use super::model::{Equations, FlightModel};
use super::shooting::LONGEST_GAP_S;
use super::{InitialStates, OutputErrorFit, filter_error, output_error};
use crate::IdentifyError;
use mavsight_flight::{InputSeries, SensorSeries, Vehicle};
use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion, Vector3, world_from_level};
use mavsight_model::{RIGID_STATES, Unit};
use nalgebra::{DMatrix, DVector};

/// Guessed poses follow each other by this.
const GUESSED_NS: i64 = 50_000_000;
/// Inputs act within this of when they were logged: the dead time of buses, motor controllers and filters of sensors is some
/// hundredths of a second.
const LONGEST_LAG_S: f64 = 0.1;
/// Rates that sensors show less than this of are not shown.
const SHOWN: f64 = 1e-6;

impl FlightFits {
    /// Fits the default model of a vehicle, with its sensors, to samples of these alone, by output error and by filter error
    /// as the options say.
    ///
    /// Sensors of rates and specific force show neither where the aircraft is nor where its nose points, and what they show
    /// does not depend on it: each piece of the flight, parted by gaps of more than two seconds, begins level at the origin,
    /// and a fit starts from the turns that add up from there by those of the model's sensors that show rates. Inputs and
    /// sensors are of one clock. The further states begin anywhere.
    ///
    /// The lag with which inputs act is free too, unless the options say that it is known; a log that does not determine it is
    /// fitted without. Samples of the first and the last tenth of a second of the inputs are then left out, for which inputs
    /// that act late or early are not known.
    ///
    /// # Errors
    /// A vehicle that is not valid; sensors that are not those of the model; inputs that do not begin before the samples; a
    /// refusal of the fit becomes a sentence.
    pub fn of_log(
        vehicle: &Vehicle,
        inputs: &InputSeries,
        sensors: &SensorSeries,
        options: &FlightFitOptions<'_>,
    ) -> Result<Self, IdentifyError> {
        let margin_s = if options.clock == InputClock::Known { 0.0 } else { LONGEST_LAG_S };
        let has_inputs = |t_ns: i64| {
            let t_s = t_ns as f64 * 1e-9;
            t_s >= inputs.start_s() + margin_s && t_s <= inputs.end_s() - margin_s
        };
        let sensors = sensors.of(&vehicle.model)?.within(|t_ns| !options.holds_out(t_ns) && has_inputs(t_ns));
        let model = FlightModel::with_outputs(vehicle, inputs)?;
        let states = guessed(&model, &model.inputs_of(inputs)?, &sensors)?;
        // They are where segments begin to be fitted from, and no measurements.
        let left_out = LeftOut(vec![true; states.len()]);
        let measured = Measurements::Part(Box::new(Measurements::States(states)), left_out)
            .with_sensors(&vehicle.model, &sensors)?;
        let defaults = options.of_fit(InitialStates::Free);
        let mut out = Self { held: model.held(), ..Self::default() };
        let estimates: [(&str, bool, Estimate, &mut Option<OutputErrorFit>); 2] = [
            ("output error", options.fits.output_error, output_error, &mut out.poses),
            ("filter error", options.fits.filter_error, filter_error, &mut out.filter),
        ];
        for (what, is_wanted, estimate, fit) in estimates {
            if is_wanted {
                let fitted = |model: &FlightModel| estimate(model, inputs, &measured, &defaults);
                *fit = fitted_with_clock(&model, options.clock, fitted)
                    .map_err(|why| out.refusals.push(format!("No {what} from the log: {why}")))
                    .ok();
            }
        }
        Ok(out)
    }
}

/// Poses that start level at the origin and turn as the sensors show.
fn guessed(
    model: &FlightModel,
    inputs: &InputSeries,
    sensors: &SensorSeries,
) -> Result<Vec<StateMeasurement>, IdentifyError> {
    let mut out: Vec<StateMeasurement> = Vec::new();
    let Some(first_ns) = sensors.times_ns().first() else { return Ok(out) };
    let shown = ShownRates::of(model, inputs.require(*first_ns as f64 * 1e-9)?);
    let (mut attitude, mut before_ns, mut due_ns) = (UnitQuaternion::identity(), *first_ns, *first_ns);
    for (k, t_ns) in sensors.times_ns().iter().enumerate() {
        let span_s = (t_ns - before_ns) as f64 * 1e-9;
        if span_s > LONGEST_GAP_S {
            attitude = UnitQuaternion::identity();
        } else {
            attitude *= UnitQuaternion::from_scaled_axis(shown.rates(sensors.row(k)) * span_s);
        }
        before_ns = *t_ns;
        if *t_ns >= due_ns {
            due_ns = t_ns + GUESSED_NS;
            let pose = Isometry3::from_parts(Vector3::zeros().into(), world_from_level() * attitude);
            out.push(StateMeasurement::of_pose(*t_ns, pose, Matrix6::identity()));
        }
    }
    Ok(out)
}

/// How rates follow from what sensors of rates show, by least squares; about axes that none shows there are none.
struct ShownRates {
    still: DVector<f64>,
    rates: DMatrix<f64>,
}

impl ShownRates {
    fn of(model: &FlightModel, inputs: &[f64]) -> Self {
        let sensors = &model.model().sensors;
        let equations = Equations::with_sensors(model);
        let mut evaluation = equations.dynamics.with(&equations.values(model));
        evaluation.set_inputs(inputs);
        let further = model.model().initial(model.values(), inputs);
        let rate = Unit::parse("rad/s").ok();
        let mut sensed = |axis: Option<usize>| {
            let mut state = vec![0.0; RIGID_STATES];
            state[3] = 1.0;
            if let Some(axis) = axis {
                state[10 + axis] = 1.0;
            }
            state.extend(&further);
            let mut values = vec![0.0; sensors.len()];
            let mut rates = vec![0.0; state.len()];
            evaluation.rates(&state, &mut rates);
            evaluation.sense(&state, &mut values);
            let of_rates = values.iter().zip(sensors).map(|(v, s)| if s.unit == rate { *v } else { 0.0 });
            DVector::from_iterator(sensors.len(), of_rates)
        };
        let still = sensed(None);
        let columns: Vec<DVector<f64>> = (0..3).map(|axis| sensed(Some(axis)) - &still).collect();
        let by_rate = DMatrix::from_columns(&columns);
        let rates = by_rate.pseudo_inverse(SHOWN).unwrap_or_else(|_| DMatrix::zeros(3, sensors.len()));
        Self { still, rates }
    }

    /// About the body's axes; zero where a sample is missing.
    fn rates(&self, sample: &[f64]) -> Vector3<f64> {
        let change =
            DVector::from_iterator(sample.len(), sample.iter().zip(&self.still).map(|(s, at)| s - at));
        let rates = &self.rates * change.map(|x| if x.is_finite() { x } else { 0.0 });
        Vector3::new(rates[0], rates[1], rates[2])
    }
}
