//! Twelve flights whose inputs were logged as every tenth of what moved each millisecond, with the log of a gyroscope made
//! for each: what the clock accounts for, and what the sampling does.
//!
//! `cargo run --release -p mavsight-engine --example sampled_inputs -- FOLDER`: the folder has `vehicle.toml` and, for flights
//! 11 to 22, `poses-N.csv` and `inputs-N.csv`. The rates of a flight are those of the equations of motion, with the drag that
//! the flight model lacks and with inputs as late as they were, along the poses; the gyroscope shows them at 400 Hz with bias
//! and noise of a consumer sensor, turned by 30° in the body, by a clock that began long before and gains 80 ppm, which the
//! inputs have too.

use mavsight_engine::{Flight, identify_from_poses};
use mavsight_flight::{InputSeries, Interpolation, Vehicle};
use mavsight_geometry::{EulerAngles, UnitQuaternion, Vector3, world_from_level};
use mavsight_identify::Clocks;
use mavsight_identify::output_error::{
    FlightModel, InitialStates, Measurements, MotionFits, OutputErrorOptions, StateMeasurement, output_error,
};
use mavsight_pipeline::{IdentifyOptions, NoProgress};
use mavsight_pose::{Motion, PoseSample};
use mavsight_random::Random;
use mavsight_session::logs::{LogGyroscope, LogInput, LogSection, read_log_inputs, unit_by_model};
use mavsight_session::{FlightTable, RunResults, load_vehicle, read_flight_table};
use mavsight_simulator::{FlightState, InitialState, Simulator};
use nalgebra::{DMatrix, DVector};
use std::error::Error;
use std::path::Path;

const OFFSET_S: f64 = 812.345;
const DRIFT: f64 = 8e-5;
const GYROSCOPE_S: f64 = 0.0025;
const BIAS_RAD_S: [f64; 3] = [0.01, -0.02, 0.005];
const NOISE_RAD_S: f64 = 2e-3;
/// A part of a flight that is flown from a state of its own: short against the time in which errors of the model grow.
const PART_S: f64 = 2.0;
/// The inputs that moved the aircraft held for so long: they were half of that later than a line through their samples.
const HELD_S: f64 = 0.001;
/// Terms that the twelve flights have and the model leaves out.
const LACKING: [&str; 2] = ["d_xy", "d_z"];

/// Time, s, and rates, rad/s.
type TimedRates = (f64, Vector3<f64>);

fn log_s(t_s: f64) -> f64 {
    OFFSET_S + t_s * (1.0 + DRIFT)
}

fn inputs(
    path: &Path,
    vehicle: &Vehicle,
    interpolation: Interpolation,
) -> Result<InputSeries, Box<dyn Error>> {
    let input = vehicle.input_columns().into_iter().map(|name| LogInput {
        column: name.to_owned(),
        field: name.to_owned(),
        interpolation,
        ..LogInput::default()
    });
    let section = LogSection { file: path.to_owned(), input: input.collect(), ..LogSection::default() };
    Ok(read_log_inputs(&section, &unit_by_model(&vehicle.model))?.value)
}

/// The vehicle with values of its model's parameters, the terms that it lacks among them, as the poses have them.
fn fitted(vehicle: &Vehicle, inputs: &InputSeries, poses: &[PoseSample]) -> Result<Vehicle, Box<dyn Error>> {
    let model = FlightModel::new(vehicle, inputs)?;
    let own = model.free().iter().map(|p| model.name(*p).to_owned());
    let names: Vec<String> = own.chain(LACKING.map(str::to_owned)).collect();
    let model = model.with_free(&names.iter().map(String::as_str).collect::<Vec<_>>())?;
    let measured = Measurements::States(StateMeasurement::of_poses(poses.iter()));
    let options = OutputErrorOptions { initial: InitialStates::Free, ..OutputErrorOptions::default() };
    let fit = output_error(&model, inputs, &measured, &options)?;
    let mut out = vehicle.clone();
    out.simulation.clear();
    out.parameters.extend(fit.parameters.iter().map(|p| (p.name.clone(), p.value)));
    Ok(out)
}

/// A part of a flight by the equations, from the state with which it comes nearest to the poses (Gauss-Newton, derivatives
/// by differences).
struct Part<'a> {
    simulator: &'a Simulator,
    inputs: &'a InputSeries,
    poses: &'a [PoseSample],
}

/// Steps for differences, and the usual size of a further state, which is known to no more.
const STEP: f64 = 1e-6;
const FURTHER: f64 = 0.2;

impl Part<'_> {
    fn moved(start: &InitialState, by: &[f64]) -> InitialState {
        let mut out = start.clone();
        (0..3).for_each(|k| out.position_in_world_m[k] += by[k]);
        out.attitude.phi_rad += by[3];
        out.attitude.theta_rad += by[4];
        out.attitude.psi_rad += by[5];
        (0..3).for_each(|k| out.velocity_in_body_m_s[k] += by[6 + k]);
        (0..3).for_each(|k| out.rates_rad_s[k] += by[9 + k]);
        out.further.iter_mut().zip(&by[12..]).for_each(|(x, by)| *x += by);
        out
    }

    /// Differences from the poses over their standard deviations, and further states over their usual size.
    fn residuals(&self, start: &InitialState) -> Result<DVector<f64>, Box<dyn Error>> {
        let times_s: Vec<f64> = self.poses.iter().map(|p| p.t_ns as f64 * 1e-9).collect();
        let mut out: Vec<f64> = start.further.iter().map(|x| -x / FURTHER).collect();
        for (state, pose) in self.simulator.fly(self.inputs, start, &times_s)?.iter().zip(self.poses) {
            let Ok(measured) = &pose.estimate else { continue };
            let (at, std) = (state.pose(), measured.covariance().diagonal().map(f64::sqrt));
            let off = measured.world_from_body.translation.vector - at.translation.vector;
            let turn = (at.rotation.inverse() * measured.world_from_body.rotation).scaled_axis();
            out.extend(off.iter().chain(turn.iter()).zip(std.iter()).map(|(off, std)| off / std));
        }
        Ok(DVector::from_vec(out))
    }

    /// Its states at the times of the gyroscope, and the root mean square of the differences from the poses.
    fn flown(
        &self,
        mut start: InitialState,
        times_s: &[f64],
    ) -> Result<(Vec<FlightState>, f64), Box<dyn Error>> {
        let count = 12 + start.further.len();
        let mut rms = 0.0;
        for _ in 0..4 {
            let at = self.residuals(&start)?;
            let column = |k: usize| {
                let mut by = vec![0.0; count];
                by[k] = STEP;
                Ok::<_, Box<dyn Error>>((&at - self.residuals(&Self::moved(&start, &by))?) / STEP)
            };
            let by = DMatrix::from_columns(&(0..count).map(column).collect::<Result<Vec<_>, _>>()?);
            let normal = by.tr_mul(&by).cholesky().ok_or("a state that the poses do not show")?;
            start = Self::moved(&start, normal.solve(&by.tr_mul(&at)).as_slice());
            rms = (at.norm_squared() / at.len() as f64).sqrt();
        }
        let begin_s = self.poses[0].t_ns as f64 * 1e-9;
        let all_s: Vec<f64> = std::iter::once(begin_s).chain(times_s.iter().copied()).collect();
        Ok((self.simulator.fly(self.inputs, &start, &all_s)?.split_off(1), rms))
    }
}

/// Rates of a flight at the times of the gyroscope, and how far its parts are from the poses, over their standard deviations.
fn rates(
    vehicle: &Vehicle,
    inputs: &InputSeries,
    motion: &Motion,
    poses: &[PoseSample],
) -> Result<(Vec<TimedRates>, f64), Box<dyn Error>> {
    let simulator = Simulator::new(vehicle)?;
    let seconds = |p: &PoseSample| p.t_ns as f64 * 1e-9;
    let (mut out, mut worst) = (Vec::new(), 0.0_f64);
    let length = (PART_S * 30.0) as usize;
    let parts = poses.len() / length;
    for part in 0..parts {
        let (from, to) =
            (part * length, if part + 1 == parts { poses.len() - 1 } else { (part + 1) * length });
        let own = &poses[from..=to];
        let (begin_s, end_s) = (seconds(&own[0]), seconds(&own[own.len() - 1]));
        let sample = motion.samples.iter().find(|s| s.t_ns == own[0].t_ns).ok_or("no motion")?;
        let further = inputs.require(begin_s).map(|row| vehicle.model.initial(&vehicle.values(), row))?;
        let start = InitialState {
            position_in_world_m: sample.world_from_body.translation.vector,
            attitude: EulerAngles::from_level_from_body(
                &(world_from_level().inverse() * sample.world_from_body.rotation),
            ),
            velocity_in_body_m_s: sample.velocity_in_body_m_s,
            rates_rad_s: sample.rates_rad_s,
            further,
        };
        let first = (begin_s / GYROSCOPE_S).floor() as usize + 1;
        let times_s: Vec<f64> =
            (first..).map(|k| k as f64 * GYROSCOPE_S).take_while(|t_s| *t_s <= end_s).collect();
        let (states, rms) = Part { simulator: &simulator, inputs, poses: own }.flown(start, &times_s)?;
        out.extend(states.iter().map(|s| (s.t_s, s.rates_rad_s)));
        worst = worst.max(rms);
    }
    Ok((out, worst))
}

fn gyroscope(rates: &[TimedRates], seed: u64) -> LogGyroscope {
    let mut random = Random::new(seed, 0);
    let sensor_from_body = UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -0.1, 0.45)).inverse();
    let mut shown = |(_, rates): &TimedRates| {
        sensor_from_body * rates + Vector3::from(BIAS_RAD_S) + Vector3::from(random.normals()) * NOISE_RAD_S
    };
    LogGyroscope {
        source: "made for it".to_owned(),
        times_ns: rates.iter().map(|(t_s, _)| (log_s(*t_s) * 1e9).round() as i64).collect(),
        rates_rad_s: rates.iter().map(&mut shown).collect(),
    }
}

fn identified(
    vehicle: &Vehicle,
    inputs: &InputSeries,
    gyroscope: Option<&LogGyroscope>,
    poses: &[PoseSample],
) -> Result<RunResults, Box<dyn Error>> {
    let motion_fits = MotionFits { output_error: true, filter_error: false };
    let options = IdentifyOptions { motion_fits, ..IdentifyOptions::default() };
    let flight = Flight {
        name: "sampled inputs",
        vehicle,
        inputs: Some(inputs),
        sensors: None,
        gyroscope,
        log_sensors: None,
        options,
    };
    let mut results = RunResults { poses: poses.to_vec(), ..RunResults::default() };
    identify_from_poses(&mut results, &flight, &NoProgress)?;
    Ok(results)
}

/// The lag of the inputs against their clock and its standard deviation, ms: by what equation error has moved them, and what
/// output error has found of the rest.
fn lag_ms(results: &RunResults) -> String {
    let moved_s = results.clocks.as_ref().map_or(0.0, Clocks::correction_s);
    let fit = results.output_error.poses.as_ref();
    let lag = fit.and_then(|fit| fit.parameter("input_lag_s"));
    lag.map_or("not determined".to_owned(), |p| {
        format!("{:+.2} ± {:.2}", 1e3 * (moved_s + p.value), 1e3 * p.std)
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give the folder of the flights")?;
    let folder = Path::new(&folder);
    let vehicle = load_vehicle(&folder.join("vehicle.toml"))?;
    println!(
        "         flown parts from        clock by the gyroscope, error of   lag of the inputs on that clock, ms"
    );
    println!(
        "flight   the poses, over std     offset, ms      drift, ppm         held            samples of lines"
    );
    for number in 11..=22 {
        let table = read_flight_table(&folder.join(format!("poses-{number}.csv")), &[])?;
        let FlightTable::Poses(mut poses) = table else { return Err("a table of motion".into()) };
        let path = folder.join(format!("inputs-{number}.csv"));
        let [held, lines] =
            [Interpolation::Hold, Interpolation::Linear].map(|how| inputs(&path, &vehicle, how));
        let (held, lines) = (held?, lines?);
        let moved = lines.at_times(|t_s| t_s + 0.5 * HELD_S)?;
        poses.retain(|pose| (moved.start_s()..=held.end_s()).contains(&(pose.t_ns as f64 * 1e-9)));
        let known = fitted(&vehicle, &moved, &poses)?;
        let motion = identified(&vehicle, &moved, None, &poses)?.motion.ok_or("no motion")?;
        let (rates, rms) = rates(&known, &moved, &motion, &poses)?;
        let gyroscope = gyroscope(&rates, number);
        let [held, lines] = [held, lines].map(|inputs| inputs.at_times(log_s));
        let [held, lines] =
            [held?, lines?].map(|inputs| identified(&vehicle, &inputs, Some(&gyroscope), &poses));
        let (held, lines) = (held?, lines?);
        let log = held.log.as_ref().ok_or("no clock")?;
        let (offset_ms, std_ms) =
            (1e3 * (log.log_s(log.at_s) - log_s(log.at_s)), 1e3 * log.offset_std_s(log.at_s));
        let (drift, drift_std) = (1e6 * (log.drift - DRIFT), 1e6 * log.covariance[(1, 1)].sqrt());
        println!(
            "{number:<8} {rms:<23.2} {offset_ms:+.2} ± {std_ms:.2}    {drift:+4.0} ± {drift_std:<4.0}        {}    {}",
            lag_ms(&held),
            lag_ms(&lines)
        );
    }
    Ok(())
}
