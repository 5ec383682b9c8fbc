//! Parameters by recursive least squares during the flight.

use crate::LiveError;
use crate::queue::{Queue, locked};
use crate::worker::Worker;
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::{
    Bandwidth, CoefficientTable, EquationFile, Options, Output, RecursiveLeastSquares, coefficients,
    independent_columns,
};
use mavsight_link::{Event, Parameter};
use mavsight_pose::{NORMAL_95, PoseSample, smooth};
use std::sync::{Arc, Mutex};

/// As much as is smoothed at a time: warm-up and, behind it, several times of an estimate.
const WINDOW_S: f64 = 16.0;
/// Rows of a window are used from this time after its beginning, except in the flight's first window:
/// states that follow rates are integrated from trim, and the error of that start decays within three time
/// constants of the slowest, such as a fly-bar.
const WARM_UP_S: f64 = 10.0;
/// Time from one estimate to the next: what a person can follow.
const EVERY_S: f64 = 1.0;
/// Poses that wait for an estimate at most: half a minute of 120 Hz.
const WAITING: usize = 4096;

/// Inputs that were recorded or commanded.
pub trait InputSource: Send {
    /// The inputs of a span, from the sample before it to its end; none if they are not known yet.
    fn span(&mut self, from_s: f64, to_s: f64) -> Option<InputSeries>;
}

/// Inputs of an earlier recording.
pub struct Recorded(pub InputSeries);

impl InputSource for Recorded {
    fn span(&mut self, from_s: f64, to_s: f64) -> Option<InputSeries> {
        (self.0.start_s() <= from_s && self.0.end_s() >= to_s).then(|| self.0.clone())
    }
}

/// Parameter estimation during the flight, on a thread of its own.
///
/// Once a second the last sixteen seconds of poses are smoothed, and outputs and regressors are formed by
/// [`coefficients`] as in a batch run. New rows far enough from both ends enter [`RecursiveLeastSquares`],
/// one for each half period of the low-pass's bandwidth, so that their errors are about white. All rows keep
/// their weight.
pub(crate) struct Parameters {
    worker: Worker<PoseSample>,
    latest: Arc<Mutex<Option<Event>>>,
}

impl Parameters {
    pub(crate) fn start(
        inputs: Box<dyn InputSource>,
        vehicle: Vehicle,
        equations: Option<EquationFile>,
        enough: f64,
    ) -> Result<Self, LiveError> {
        let latest = Arc::new(Mutex::new(None));
        let out = Arc::clone(&latest);
        let mut work = Work::new(inputs, vehicle, equations, enough);
        let run = move |sample: Option<PoseSample>| {
            if let Some(event) = sample.and_then(|sample| work.push(sample)) {
                *locked(&out) = Some(event);
            }
        };
        Ok(Self { worker: Worker::start("parameters", Queue::new(WAITING, false), true, run)?, latest })
    }

    /// Takes a pose; the oldest is dropped where the thread is behind.
    pub(crate) fn push(&self, sample: &PoseSample) {
        self.worker.queue.push(sample.clone());
    }

    pub(crate) fn latest(&self) -> Option<Event> {
        locked(&self.latest).take()
    }

    /// Ends, with the last estimate.
    pub(crate) fn finish(self) -> Option<Event> {
        self.worker.finish();
        self.latest()
    }
}

struct Fit {
    output: String,
    columns: Vec<String>,
    /// Standard deviations of the regressors' errors in the latest window.
    errors: Vec<f64>,
    /// Relative standard deviation of what the output is divided by: mass or inertia.
    scale_std: f64,
    /// Time from which the next row is used.
    next_s: f64,
    fit: RecursiveLeastSquares,
}

struct Work {
    inputs: Box<dyn InputSource>,
    vehicle: Vehicle,
    options: Options,
    enough: f64,
    window: Vec<PoseSample>,
    is_first: bool,
    /// Time of the pose at which an estimate was last tried.
    tried_s: Option<f64>,
    fits: Vec<Fit>,
}

fn seconds(sample: Option<&PoseSample>) -> f64 {
    sample.map_or(0.0, |s| s.t_ns as f64 * 1e-9)
}

impl Work {
    fn new(
        inputs: Box<dyn InputSource>,
        vehicle: Vehicle,
        equations: Option<EquationFile>,
        enough: f64,
    ) -> Self {
        Self {
            inputs,
            vehicle,
            options: Options { equations, bandwidth: Bandwidth::Smoother, ..Options::default() },
            enough,
            window: Vec::new(),
            is_first: true,
            tried_s: None,
            fits: Vec::new(),
        }
    }

    /// Takes a pose; an estimate about once a second.
    fn push(&mut self, sample: PoseSample) -> Option<Event> {
        if self.window.is_empty() && sample.estimate.is_err() {
            return None;
        }
        self.window.push(sample);
        let (first_s, last_s) = (seconds(self.window.first()), seconds(self.window.last()));
        if last_s - self.tried_s.unwrap_or(first_s + EVERY_S) < EVERY_S || self.window.len() < 30 {
            return None;
        }
        self.tried_s = Some(last_s);
        let table = self.table(first_s, last_s);
        if let Some(table) = &table {
            self.take(table, first_s);
        }
        let event = table.map(|_| self.event(last_s));
        let keep_s = last_s - WINDOW_S;
        let gone = self.window.partition_point(|p| (p.t_ns as f64) * 1e-9 < keep_s);
        if gone > 0 {
            self.window.drain(..gone);
            self.is_first = false;
        }
        event
    }

    fn table(&mut self, first_s: f64, last_s: f64) -> Option<CoefficientTable> {
        let inputs = self.inputs.span(first_s, last_s)?;
        let motion = smooth(&self.window, self.vehicle.environment.gravity_m_s2).ok()?;
        coefficients(&motion, &inputs, &self.vehicle, &self.options).ok()
    }

    /// Adds the rows of a table that were not used yet.
    fn take(&mut self, table: &CoefficientTable, first_s: f64) {
        let from_s = if self.is_first { first_s } else { first_s + WARM_UP_S };
        for output in &table.outputs {
            let Some(fit) = fit_of(&mut self.fits, output) else { continue };
            let mut row = vec![0.0; output.columns.len()];
            for i in table.rows_in_window().into_iter().filter(|i| table.t_s[*i] > from_s) {
                if table.t_s[i] < fit.next_s {
                    continue;
                }
                fit.next_s = table.t_s[i] + 0.5 / output.bandwidth_hz;
                row.iter_mut().zip(&output.columns).for_each(|(to, c)| *to = c.values[i]);
                // A row that is not finite is skipped.
                let _ = fit.fit.update(&row, output.values[i]);
            }
        }
    }

    fn event(&self, t_s: f64) -> Event {
        let parameters: Vec<Parameter> = self.fits.iter().flat_map(|f| f.parameters(self.enough)).collect();
        let mut known = parameters.iter().filter(|p| p.value.is_some()).peekable();
        let enough = known.peek().is_some() && known.all(|p| p.enough);
        Event::Parameters { t_s, parameters, enough }
    }
}

impl Fit {
    /// Its parameters so far; one that the flight does not determine by itself has no value.
    fn parameters(&self, share: f64) -> Vec<Parameter> {
        let factor = self.fit.factor();
        // The errors of the columns over all rows.
        let rows = (self.fit.weight() / factor.nrows().max(1) as f64).sqrt();
        let noise: Vec<f64> = self.errors.iter().map(|std| std * rows).collect();
        let dependence = independent_columns(&factor, &noise);
        let estimate = self.fit.estimate_of(&dependence.independent);
        let parameter = |(column, name): (usize, &String)| {
            let at = dependence.independent.iter().position(|k| *k == column);
            let known = at.filter(|k| dependence.stands_alone(*k)).zip(estimate.as_ref());
            let value = known.map(|(k, (values, _))| values[k]);
            let half_width = known.map(|(k, (values, covariance))| {
                let noise = covariance[(k, k)].max(0.0).sqrt();
                NORMAL_95 * noise.hypot(values[k] * self.scale_std)
            });
            let enough = value.zip(half_width).is_some_and(|(v, h)| h <= share * v.abs());
            Parameter { name: format!("{},{name}", self.output), value, half_width, enough }
        };
        self.columns.iter().enumerate().map(parameter).collect()
    }
}

fn fit_of<'a>(fits: &'a mut Vec<Fit>, output: &Output) -> Option<&'a mut Fit> {
    let same = |f: &Fit| f.output == output.name && f.columns.len() == output.columns.len();
    if !fits.iter().any(same) {
        let fit = RecursiveLeastSquares::new(output.columns.len(), 1.0).ok()?;
        let columns = output.columns.iter().map(|c| c.name.clone()).collect();
        let (output, next_s) = (output.name.clone(), f64::NEG_INFINITY);
        fits.push(Fit { output, columns, errors: Vec::new(), scale_std: 0.0, next_s, fit });
    }
    let fit = fits.iter_mut().find(|f| same(f))?;
    fit.errors = output.columns.iter().map(|c| c.std).collect();
    fit.scale_std = output.scale_std;
    Some(fit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Matrix6, Vector3, world_from_body};
    use mavsight_identify::{Estimator, FitOptions, identify_with};
    use mavsight_pose::PoseEstimate;
    use mavsight_simulator::{Maneuver, Scenario, simulate};

    /// Poses of a simulated flight, a tenth of a millimetre and of a milliradian off.
    fn flight() -> (Vec<PoseSample>, InputSeries) {
        let doublet = |start_s: f64| Maneuver::Doublet {
            channel: "delta_lon".to_owned(),
            start_s,
            pulse_s: 0.4,
            amplitude: -4.0,
        };
        let scenario = Scenario {
            duration_s: 12.0,
            maneuver: vec![doublet(2.0), doublet(5.0), doublet(8.0)],
            ..Scenario::paper()
        };
        let inputs = scenario.inputs(&Vehicle::paper()).unwrap();
        let start = scenario.start(&Vehicle::paper()).unwrap();
        let states = simulate(&Vehicle::paper(), &inputs, &start, &scenario.frame_times_s()).unwrap();
        let mut random = mavsight_random::Random::new(3, 0);
        let mut noise = || 1e-4 * random.normal();
        let sample = |s: &mavsight_simulator::FlightState| {
            let mut pose = world_from_body(s.position_in_world_m, s.attitude);
            pose.translation.vector += Vector3::new(noise(), noise(), noise());
            let turn = Vector3::new(noise(), noise(), noise());
            pose.rotation *= mavsight_geometry::UnitQuaternion::from_scaled_axis(turn);
            let estimate = PoseEstimate::new(pose, &(Matrix6::identity() * 1e-8));
            PoseSample { t_ns: (s.t_s * 1e9).round() as i64, estimate: Ok(estimate) }
        };
        (states.iter().map(sample).collect(), inputs)
    }

    /// A mass that is known to a tenth is in every interval, however well the rows agree.
    #[test]
    fn the_uncertainty_of_the_mass_is_in_the_intervals() {
        let mut fit = RecursiveLeastSquares::new(1, 1.0).unwrap();
        for k in 1..100 {
            fit.update(&[f64::from(k)], 3.0 * f64::from(k)).unwrap();
        }
        let (output, columns) = ("C_X".to_owned(), vec!["T_u".to_owned()]);
        let fit = Fit { output, columns, errors: vec![0.0], scale_std: 0.1, next_s: 0.0, fit };
        let found = fit.parameters(0.5);
        let half_width = found[0].half_width.unwrap();
        assert!((half_width - NORMAL_95 * 0.3).abs() < 1e-6, "{half_width}");
    }

    /// The last estimate is that of a batch run's least squares, intervals shrink, and an undetermined
    /// parameter has none.
    #[test]
    fn it_converges_to_the_estimate_of_a_batch_run() {
        let (poses, inputs) = flight();
        let vehicle = Vehicle::paper();
        let options = || Options { bandwidth: Bandwidth::Smoother, ..Options::default() };
        let mut work = Work::new(Box::new(Recorded(inputs.clone())), vehicle.clone(), None, 0.05);
        let events: Vec<Event> = poses.iter().filter_map(|p| work.push(p.clone())).collect();
        let half_widths = |event: &Event, name: &str| -> Option<(f64, f64)> {
            let Event::Parameters { parameters, .. } = event else { return None };
            let p = parameters.iter().find(|p| p.name == name)?;
            p.value.zip(p.half_width)
        };
        assert!((6..=12).contains(&events.len()), "{} estimates", events.len());
        let motion = smooth(&poses, vehicle.environment.gravity_m_s2).unwrap();
        let table = coefficients(&motion, &inputs, &vehicle, &options()).unwrap();
        let fit = FitOptions { estimators: vec![Estimator::LeastSquares], ..FitOptions::default() };
        let batch = identify_with(&table, &fit).unwrap();
        let mut compared = 0;
        for fit in &batch.fits {
            for p in fit.parameters.iter().filter(|p| p.identifiable) {
                let name = format!("{},{}", fit.output, p.name);
                let (Some(value), Some(std)) = (p.value, p.std) else { continue };
                let Some((live, half_width)) = events.last().and_then(|e| half_widths(e, &name)) else {
                    continue;
                };
                println!("{name}: {live} ± {half_width}, batch {value} ± {}", 1.96 * std);
                let apart = (live - value).abs();
                assert!(apart < 2.0 * half_width + 4.0 * std, "{name}: {live} against {value}");
                compared += 1;
            }
        }
        assert!(compared >= 3, "{compared} compared");
        let widths: Vec<f64> =
            events.iter().filter_map(|e| half_widths(e, "C_m,alpha_l")).map(|w| w.1).collect();
        assert!(widths.last() < widths.first(), "{widths:?}");
        let Some(Event::Parameters { parameters, .. }) = events.last() else { panic!("no estimate") };
        // Rotors at one speed: their thrusts cannot be distinguished from the constant.
        assert!(parameters.iter().any(|p| p.name == "C_Z,T_u" && p.value.is_none()));
    }
}
