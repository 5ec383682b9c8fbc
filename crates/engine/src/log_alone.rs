//! Parameters from a log without poses.

use crate::{EngineError, Flight};
use mavsight_flight::{FlightError, InputSeries, SensorSeries};
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, InputClock};
use mavsight_pipeline::{PipelineError, Progress, Stage};
use mavsight_session::RunResults;

/// A fit steps from sample to sample and holds a kilobyte for each: faster sensors, and inputs, are taken as means over this
/// time T. A lag of time constant τ then counts as longer by (T/τ)²/24, which is one part in a hundred of 20 ms.
const MEANS_S: f64 = 0.01;

/// Identifies the parameters of a flight's model from the sensors of a log alone, by output error, over a part of the log.
/// Samples and inputs that are nearer to each other than 10 ms count as their means; a note says so.
///
/// # Errors
/// A model, a setting or a vehicle that is wrong; a log without inputs and sensors in that part.
pub fn identify_from_log(
    results: &mut RunResults,
    within_s: Option<(f64, f64)>,
    flight: &Flight<'_>,
    progress: &dyn Progress,
) -> Result<(), EngineError> {
    let (Some(inputs), Some(sensors)) = (flight.inputs, flight.sensors) else {
        results.notes.push("No parameters: the log has to give inputs and sensors of the model.".to_owned());
        return Ok(());
    };
    progress.begin(Stage::Identify, None);
    let (from_s, to_s) = within_s.unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
    let is_within = |t_ns: i64| (from_s..=to_s).contains(&(t_ns as f64 * 1e-9));
    let failed = |e: FlightError| EngineError::from(e);
    let sensors = mean_sensors(&sensors.within(is_within)).map_err(failed)?;
    let inputs = mean_inputs(inputs).map_err(failed)?;
    let covered = |t_ns: i64| {
        let t_s = t_ns as f64 * 1e-9;
        t_s >= inputs.start_s() && t_s <= inputs.end_s()
    };
    let sensors = sensors.within(covered);
    if sensors.times_ns().is_empty() {
        results.notes.push("No parameters: inputs and sensors have no time in common.".to_owned());
        return Ok(());
    }
    results
        .notes
        .push(format!("Samples and inputs nearer than {:.0} ms count as their means.", 1e3 * MEANS_S));
    let options = FlightFitOptions {
        clock: InputClock::Known,
        held_out_s: flight.options.fit.held_out_s,
        fits: flight.options.motion_fits,
        search: false,
        sensors: Some(&sensors),
    };
    let fits = FlightFits::of_log(flight.vehicle, &inputs, &sensors, &options);
    results.output_error = fits.map_err(PipelineError::from)?;
    results.notes.extend(results.output_error.refusals.iter().cloned());
    Ok(())
}

/// Means of rows that are nearer to each other than [`MEANS_S`], at the mean of their times; of numbers alone.
fn mean_sensors(sensors: &SensorSeries) -> Result<SensorSeries, FlightError> {
    let (mut times_ns, mut values) = (Vec::new(), Vec::new());
    let bin = |k: &usize| (sensors.times_ns()[*k] as f64 * 1e-9 / MEANS_S).floor() as i64;
    let rows: Vec<usize> = (0..sensors.times_ns().len()).collect();
    for own in rows.chunk_by(|a, b| bin(a) == bin(b)) {
        let first_ns = sensors.times_ns()[own[0]];
        let since_ns: i64 = own.iter().map(|k| sensors.times_ns()[*k] - first_ns).sum();
        times_ns.push(first_ns + since_ns / own.len() as i64);
        for column in 0..sensors.columns().len() {
            let numbers = own.iter().map(|k| sensors.row(*k)[column]).filter(|v| v.is_finite());
            let (count, sum) = numbers.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
            values.push(sum / count);
        }
    }
    SensorSeries::new(sensors.columns().to_vec(), times_ns, values)
}

/// Inputs that hold their means over [`MEANS_S`], where rows are nearer to each other than that.
fn mean_inputs(inputs: &InputSeries) -> Result<InputSeries, FlightError> {
    let times_s = inputs.times_s();
    let rows = times_s.len();
    let span_s = inputs.end_s() - inputs.start_s();
    if span_s / rows as f64 > 0.5 * MEANS_S {
        return Ok(inputs.clone());
    }
    let count = (span_s / MEANS_S).floor() as usize;
    let (mut at, mut times, mut values) = (0, Vec::with_capacity(count), Vec::new());
    for bin in 0..count {
        let from_s = inputs.start_s() + bin as f64 * MEANS_S;
        let to_s = from_s + MEANS_S;
        let mut mean = vec![0.0; inputs.names().len()];
        let mut now_s = from_s;
        while now_s < to_s {
            while at + 1 < rows && times_s[at + 1] <= now_s {
                at += 1;
            }
            let next_s = times_s.get(at + 1).map_or(to_s, |t| t.min(to_s));
            let share = (next_s - now_s) / MEANS_S;
            mean.iter_mut().zip(inputs.row(at)).for_each(|(m, v)| *m += share * v);
            now_s = next_s;
        }
        times.push(from_s);
        values.extend(mean);
    }
    InputSeries::new(inputs.names().to_vec(), times, values)
}
