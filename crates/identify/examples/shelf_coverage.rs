//! How often 95 % intervals of output error hold the truth, over simulated flights of a model of the shelf.
//!
//! `cargo run --release -p mavsight-identify --example shelf_coverage -- quadrotor 200`: the name of a folder
//! of docs/shelf, the number of flights. With the word `search` after them each fit also searches the terms
//! that the model marks as candidates, none of which is missing.
//!
//! The aircraft flies once, at its truth; each fit sees this flight with white errors of its own, and starts
//! from values that are off by up to a tenth. Where the model has prior knowledge of a parameter
//! (`prior_std`), that of each fit is drawn: off the truth by a normal error of that standard deviation.
//! Truths drawn about one prior would say the same of intervals, but commands that are played back suit one
//! truth alone. Seeds are fixed.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion, Vector3};
use mavsight_identify::output_error::{
    FlightModel, Measurements, ModelParameter, OutputErrorFit, OutputErrorOptions, StateMeasurement,
    output_error, search_structure,
};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Scenario, simulate, true_values};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

const THREADS: usize = 2;
/// Fits start from values that are off by up to this share.
const START_SHARE: f64 = 0.1;
/// Length of the segments for a model with wide priors: with the quarter of a second of other models every
/// third fit of `coaxial-lag` does not converge, and says that shorter ones may help.
const SEGMENT_S: [(&str, f64); 1] = [("coaxial-lag", 0.1)];
const SHELF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/shelf");

/// Standard deviations of a pose: of each coordinate, and of a turn about each axis.
#[derive(Clone, Copy)]
struct Noise {
    position_m: f64,
    turn_deg: f64,
}

impl Noise {
    /// Cameras in a room; for what flies outside, satellite navigation with carrier phase and an attitude
    /// reference; for the longest flight, satellite navigation alone.
    fn of(name: &str) -> Self {
        let (position_m, turn_deg) = match name {
            "fixed-wing-longitudinal" | "fixed-wing-lateral" => (0.02, 0.3),
            "unstable-short-period" => (0.02, 0.05),
            "attas-lateral" => (0.02, 0.1),
            "hfb320" => (0.5, 0.1),
            _ => (5e-4, 0.05),
        };
        Self { position_m, turn_deg }
    }

    fn measured(self, states: &[FlightState], random: &mut Random) -> Measurements {
        let turn_rad = self.turn_deg.to_radians();
        let (p, t) = (self.position_m.powi(2), turn_rad.powi(2));
        let covariance = Matrix6::from_diagonal(&[p, p, p, t, t, t].into());
        let mut pose = |s: &FlightState| {
            let at = s.pose();
            let place = at.translation.vector + Vector3::from(random.normals()) * self.position_m;
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * turn_rad);
            let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
            StateMeasurement::of_pose((s.t_s * 1e9).round() as i64, pose, covariance)
        };
        Measurements::States(states.iter().map(&mut pose).collect())
    }
}

/// A model of the shelf on its flight.
struct Flown {
    noise: Noise,
    options: OutputErrorOptions,
    search: bool,
    inputs: InputSeries,
    states: Vec<FlightState>,
    model: FlightModel,
    /// Of each free parameter.
    truth: Vec<f64>,
}

impl Flown {
    fn new(name: &str, search: bool) -> Result<Self, Box<dyn Error>> {
        let folder = PathBuf::from(SHELF).join(name);
        let read = |file: &str| {
            let path = folder.join(file);
            std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))
        };
        let vehicle: Vehicle = toml::from_str(&read("vehicle.toml")?)?;
        let scenario: Scenario = toml::from_str(&read("scenario.toml")?)?;
        let commands = folder.join("inputs.csv");
        let inputs = if commands.is_file() { table(&commands)? } else { scenario.inputs(&vehicle)? };
        let states = simulate(&vehicle, &inputs, &scenario.start(&vehicle)?, &scenario.frame_times_s())?;
        let model = FlightModel::new(&vehicle, &inputs)?;
        let truth = true_values(&vehicle);
        let truth = model.free().iter().map(|p| truth[model.name(*p)]).collect();
        let mut options = OutputErrorOptions::default();
        SEGMENT_S.iter().filter(|s| s.0 == name).for_each(|s| options.segment_s = s.1);
        Ok(Self { noise: Noise::of(name), options, search, inputs, states, model, truth })
    }

    /// The model with the values that one fit starts from: what is known before the flight, where that is a
    /// prior.
    fn before(&self, random: &mut Random) -> Result<FlightModel, Box<dyn Error>> {
        let mut out = self.model.clone();
        for (parameter, true_value) in self.model.free().iter().zip(&self.truth) {
            let ModelParameter::Parameter(k) = *parameter else { continue };
            let p = &self.model.model().parameters[k];
            let value = loop {
                let value = match p.prior_std {
                    Some(std) => true_value + std * random.normal(),
                    None => {
                        self.model.value(*parameter) * random.between(1.0 - START_SHARE, 1.0 + START_SHARE)
                    }
                };
                if (p.min..=p.max).contains(&value) {
                    break value;
                }
            };
            out = out.with_value(&p.name, value)?;
        }
        Ok(out)
    }

    fn fit(&self, flight: usize) -> Result<Fitted, Box<dyn Error>> {
        let mut random = Random::new(33, flight as u64);
        let measured = self.noise.measured(&self.states, &mut random);
        let model = self.before(&mut random)?;
        let begin = Instant::now();
        let (fit, added) = if self.search {
            let search = search_structure(&model, &self.inputs, &measured, &self.options)?;
            (search.fit, search.added.iter().map(ToString::to_string).collect())
        } else {
            (output_error(&model, &self.inputs, &measured, &self.options)?, Vec::new())
        };
        Ok(Fitted { fit, seconds: begin.elapsed().as_secs_f64(), added })
    }
}

/// One fit, and the seconds that it took.
struct Fitted {
    fit: OutputErrorFit,
    seconds: f64,
    /// Terms that a search has added.
    added: Vec<String>,
}

/// A table of recorded inputs: `t_s`, then the columns.
fn table(path: &Path) -> Result<InputSeries, Box<dyn Error>> {
    let text = std::fs::read_to_string(path)?;
    let mut lines = text.lines();
    let names = lines.next().ok_or("an empty table")?.split(',').skip(1).map(str::to_owned);
    let (mut times_s, mut values) = (Vec::new(), Vec::new());
    for line in lines {
        let mut cells = line.split(',').map(str::parse::<f64>);
        times_s.push(cells.next().ok_or("an empty line")??);
        values.extend(cells.collect::<Result<Vec<f64>, _>>()?);
    }
    Ok(InputSeries::new(names.collect::<Vec<String>>(), times_s, values)?)
}

/// One parameter over all fits.
#[derive(Clone, Default)]
struct Tally {
    held: usize,
    identifiable: usize,
    /// Sums of the error over its stated standard deviation, of its square, of the standard deviation.
    normalised: f64,
    squares: f64,
    std: f64,
}

/// What the fits of one thread found.
struct Share {
    tallies: Vec<Tally>,
    seconds: Vec<f64>,
    failures: Vec<String>,
    added: Vec<String>,
}

/// Every second flight, or as many threads as there are, from one on.
fn share(flown: &Flown, first: usize, flights: usize) -> Share {
    let tallies = vec![Tally::default(); flown.truth.len()];
    let mut out = Share { tallies, seconds: Vec::new(), failures: Vec::new(), added: Vec::new() };
    for flight in (first..flights).step_by(THREADS) {
        match flown.fit(flight) {
            Err(error) => out.failures.push(format!("flight {flight}: {error}")),
            Ok(Fitted { fit, seconds, added }) => {
                out.seconds.push(seconds);
                out.added.extend(added.iter().map(|term| format!("flight {flight}: {term}")));
                for ((tally, p), true_value) in out.tallies.iter_mut().zip(&fit.parameters).zip(&flown.truth)
                {
                    let normalised = (p.value - true_value) / p.std;
                    tally.held += usize::from((p.ci_low..=p.ci_high).contains(true_value));
                    tally.identifiable += usize::from(p.identifiable);
                    tally.normalised += normalised;
                    tally.squares += normalised * normalised;
                    tally.std += p.std;
                }
            }
        }
    }
    out
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let name = words.next().ok_or("give the name of a folder of docs/shelf")?;
    let flights: usize = words.next().map_or(Ok(20), |w| w.parse())?;
    let flown = Flown::new(&name, words.next().is_some_and(|w| w == "search"))?;
    let shares: Vec<Share> = std::thread::scope(|scope| {
        let own: Vec<_> = (0..THREADS)
            .map(|k| {
                scope.spawn({
                    let flown = &flown;
                    move || share(flown, k, flights)
                })
            })
            .collect();
        own.into_iter().flat_map(|thread| thread.join()).collect()
    });
    let mut seconds: Vec<f64> = shares.iter().flat_map(|s| s.seconds.iter().copied()).collect();
    seconds.sort_by(f64::total_cmp);
    let failures: Vec<&String> = shares.iter().flat_map(|s| &s.failures).collect();
    failures.iter().for_each(|failure| println!("{failure}"));
    shares.iter().flat_map(|s| &s.added).for_each(|term| println!("{term}"));
    let Noise { position_m, turn_deg } = flown.noise;
    println!(
        "{name}: {} poses, {} mm, {turn_deg} deg; {} of {flights} fits, {} failed, {:.2} s each (median), {:.2} s at most",
        flown.states.len(),
        1e3 * position_m,
        seconds.len(),
        failures.len(),
        seconds.get(seconds.len() / 2).copied().unwrap_or_default(),
        seconds.last().copied().unwrap_or_default()
    );
    print_table(&flown, &shares, seconds.len() as f64);
    Ok(())
}

/// A line for each parameter: the share of intervals that hold the truth, the mean and the root mean square
/// of the error over the stated standard deviation, that standard deviation, the truth, and the share of fits
/// that call it determined.
fn print_table(flown: &Flown, shares: &[Share], fits: f64) {
    println!(
        "{:16} {:>7} {:>9} {:>8} {:>12} {:>12} {:>11}",
        "parameter", "held", "mean/std", "rms/std", "std", "truth", "determined"
    );
    for (k, parameter) in flown.model.free().iter().enumerate() {
        let sum = |of: fn(&Tally) -> f64| shares.iter().map(|s| of(&s.tallies[k])).sum::<f64>() / fits;
        println!(
            "{:16} {:6.1}% {:9.3} {:8.3} {:12.3e} {:12.4e} {:10.0}%",
            flown.model.name(*parameter),
            100.0 * sum(|t| t.held as f64),
            sum(|t| t.normalised),
            sum(|t| t.squares).sqrt(),
            sum(|t| t.std),
            flown.truth[k],
            100.0 * sum(|t| t.identifiable as f64)
        );
    }
}
