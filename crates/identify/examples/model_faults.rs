//! What intervals say of flights whose model is wrong, or whose inputs are, beside the same flights without the fault.
//!
//! `cargo run --release -p mavsight-identify --example model_faults -- FLIGHTS [FAULT...]`: simulated flights of six seconds
//! of the coaxial helicopter of docs/shelf, poses good to 0.5 mm and 0.05 degrees at 30 Hz, inputs on the clock of the
//! poses. Each flight has manoeuvres of its own size, errors of its own and moments of inertia of its own, which differ
//! from those of the vehicle's file by as much as the file says; it is identified twice, with the fault and without. For each fault: how many intervals hold the truth, of all parameters and of those that the fault does not
//! touch; how many flights have a parameter that the fault moves by more than its standard deviation, and in how many of
//! these, and of those without fault, the model is said to lack something. Seeds are fixed.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion, Vector3};
use mavsight_identify::output_error::{
    FittedParameter, FlightFitOptions, FlightFits, InputClock, OutputErrorFit,
};
use mavsight_model::Model;
use mavsight_pose::{PoseEstimate, PoseSample};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Maneuver, Scenario, simulate, true_values};
use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;

const SHELF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/shelf/coaxial");
const MODEL: &str = include_str!("../../model/shelf/coaxial.toml");
/// Standard deviations of a pose: of each coordinate, and of a turn about each axis.
const POSITION_M: f64 = 5e-4;
const TURN_DEG: f64 = 0.05;
/// A parameter is not touched by a fault that moves its estimate by less than this share of its standard deviation,
/// root mean square over all flights: its intervals would then hold at least 92 % of what they should hold 95 %.
const UNTOUCHED: f64 = 0.5;
/// Of the moments of inertia in the vehicle's file, as shares of them.
const INERTIA_STD: f64 = 0.1;
const DURATION_S: f64 = 6.0;
const FRAME_RATE_HZ: f64 = 30.0;
const THREADS: usize = 2;

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// Drag of 0.1 N s/m along each axis, which the model lacks.
    Drag,
    /// Inputs that act 20 ms after they are recorded.
    Delay,
    /// A force of 10 % of the weight (root mean square along each axis, correlated over 0.1 s), for half a second.
    Gust,
    /// Moments of inertia 10 % too small in the vehicle's file, in all flights alike.
    Inertia,
    /// The swash-plate turned by 5 degrees.
    ServoAxis,
}

impl Fault {
    const ALL: [Self; 5] = [Self::Drag, Self::Delay, Self::Gust, Self::Inertia, Self::ServoAxis];

    fn name(self) -> &'static str {
        match self {
            Self::Drag => "drag",
            Self::Delay => "delay",
            Self::Gust => "gust",
            Self::Inertia => "inertia",
            Self::ServoAxis => "servo-axis",
        }
    }

    /// The aircraft that flies with this fault, where the one that flies without it is `sound`.
    fn aircraft(self, sound: &Vehicle) -> Result<Vehicle, Box<dyn Error>> {
        let mut out = sound.clone();
        match self {
            Self::Drag => {
                out.simulation.extend([("d_xy".to_owned(), 0.1), ("d_z".to_owned(), 0.1)]);
            }
            Self::Inertia => {
                out.simulation.extend(inertia(sound, [1.1; 3]));
            }
            Self::Gust => {
                let inputs = GUSTS.map(|(axis, column)| {
                    format!("gust_{axis} = {{ column = \"{column}\", unit = \"N\", min = -100, max = 100, trim = 0 }}\n")
                });
                let mut text = MODEL.replacen("[inputs]\n", &format!("[inputs]\n{}", inputs.concat()), 1);
                for (drag, axis) in [("d_xy*u", "x"), ("d_xy*v", "y"), ("d_z*w", "z")] {
                    text = text.replacen(&format!(" - {drag}"), &format!(" - {drag} + gust_{axis}"), 1);
                }
                out.model = Arc::new(Model::parse("coaxial with gusts", &text)?);
            }
            Self::Delay | Self::ServoAxis => {}
        }
        Ok(out)
    }

    /// What acts on the aircraft where these inputs are recorded.
    fn acting(
        self,
        recorded: &InputSeries,
        weight_n: f64,
        random: &mut Random,
    ) -> Result<InputSeries, Box<dyn Error>> {
        let times_s = recorded.times_s();
        let mut names = recorded.names().to_vec();
        let rows: Vec<Vec<f64>> = match self {
            Self::Drag | Self::Inertia => return Ok(recorded.clone()),
            Self::Delay => {
                let first = recorded.start_s();
                times_s
                    .iter()
                    .map(|t| recorded.at((t - 0.02).max(first)).map(<[f64]>::to_vec))
                    .collect::<Option<_>>()
            }
            Self::ServoAxis => {
                let place = |name: &str| names.iter().position(|n| n == name);
                let (lon, lat) =
                    place("delta_lon_rad").zip(place("delta_lat_rad")).ok_or("no swash-plate")?;
                let (sine, cosine) = 5_f64.to_radians().sin_cos();
                let turned = |k: usize| {
                    let mut row = recorded.row(k).to_vec();
                    let (a, b) = (row[lon], row[lat]);
                    (row[lon], row[lat]) = (cosine * a - sine * b, sine * a + cosine * b);
                    row
                };
                Some((0..times_s.len()).map(turned).collect())
            }
            Self::Gust => {
                names.splice(0..0, GUSTS.map(|(_, column)| column.to_owned()));
                let from_s = random.between(1.0, recorded.end_s() - 1.0);
                let mut force_n = [0.0; 3];
                let mut before_s = from_s;
                let mut row = |(k, t_s): (usize, &f64)| {
                    let blows = (from_s..from_s + 0.5).contains(t_s);
                    if blows {
                        let kept = (-(t_s - before_s) / 0.1).exp();
                        let fresh = 0.1 * weight_n * (1.0 - kept * kept).sqrt();
                        let begins = before_s == from_s;
                        for (force, normal) in force_n.iter_mut().zip(random.normals::<3>()) {
                            *force =
                                if begins { 0.1 * weight_n * normal } else { kept * *force + fresh * normal };
                        }
                        before_s = *t_s;
                    }
                    let gust = if blows { force_n } else { [0.0; 3] };
                    gust.iter().chain(recorded.row(k)).copied().collect()
                };
                Some(times_s.iter().enumerate().map(&mut row).collect())
            }
        }
        .ok_or("inputs outside the record")?;
        Ok(InputSeries::new(names, times_s.to_vec(), rows.concat())?)
    }
}

/// Moments of inertia that fly, as shares of those of the vehicle's file.
fn inertia(vehicle: &Vehicle, shares: [f64; 3]) -> [(String, f64); 3] {
    let [xx, yy, zz, ..] = vehicle.body().inertia_kg_m2;
    let [x, y, z] = shares;
    [("I_xx", x * xx), ("I_yy", y * yy), ("I_zz", z * zz)].map(|(name, value)| (name.to_owned(), value))
}

const GUSTS: [(&str, &str); 3] = [("x", "gust_x_n"), ("y", "gust_y_n"), ("z", "gust_z_n")];

/// The vehicle as its file has it, and the flight that it is asked for.
struct Campaign {
    vehicle: Vehicle,
    scenario: Scenario,
}

/// A flight identified, and the values of its parameters that flew.
struct Identified {
    fits: FlightFits,
    truth: BTreeMap<String, f64>,
}

impl Campaign {
    fn new() -> Result<Self, Box<dyn Error>> {
        let read = |file: &str| std::fs::read_to_string(format!("{SHELF}/{file}"));
        let mut vehicle: Vehicle = toml::from_str(&read("vehicle.toml")?)?;
        vehicle.inertia_std_kg_m2 = vehicle.inertia_kg_m2.map(|i| INERTIA_STD * i);
        Ok(Self { vehicle, scenario: toml::from_str(&read("scenario.toml")?)? })
    }

    /// A flight with a fault, identified; none for the flight without one.
    fn identified(&self, flight: usize, fault: Option<Fault>) -> Result<Identified, Box<dyn Error>> {
        let mut random = Random::new(34, flight as u64);
        let size = random.between(0.6, 1.1);
        let maneuver = self.scenario.maneuver.iter().map(|m| shortened(m.scaled(size))).collect();
        let scenario = Scenario {
            maneuver,
            duration_s: DURATION_S,
            frame_rate_hz: FRAME_RATE_HZ,
            ..self.scenario.clone()
        };
        let recorded = scenario.inputs(&self.vehicle)?;
        let mut sound = self.vehicle.clone();
        let shares = Random::new(36, flight as u64).normals().map(|normal| 1.0 + INERTIA_STD * normal);
        sound.simulation.extend(inertia(&sound, shares));
        let aircraft = fault.map_or(Ok(sound.clone()), |f| f.aircraft(&sound))?;
        let body = self.vehicle.body();
        // Errors of poses are the same with and without the fault.
        let mut of_fault = Random::new(35, flight as u64);
        let acting = match fault {
            Some(fault) => fault.acting(&recorded, body.mass_kg * body.gravity_m_s2, &mut of_fault)?,
            None => recorded.clone(),
        };
        let states = simulate(&aircraft, &acting, &scenario.start(&aircraft)?, &scenario.frame_times_s())?;
        let poses: Vec<PoseSample> = states.iter().map(|s| measured(s, &mut random)).collect();
        let options = FlightFitOptions { clock: InputClock::Known, ..FlightFitOptions::default() };
        let fits = FlightFits::of_flight(&self.vehicle, &recorded, &poses, None, &options)?;
        Ok(Identified { fits, truth: true_values(&aircraft) })
    }
}

/// The manoeuvre within the length of these flights.
fn shortened(maneuver: Maneuver) -> Maneuver {
    match maneuver {
        Maneuver::Multisine { channel, start_s, harmonics, amplitude, .. } => {
            Maneuver::Multisine { channel, start_s, length_s: DURATION_S - start_s, harmonics, amplitude }
        }
        other => other,
    }
}

fn measured(state: &FlightState, random: &mut Random) -> PoseSample {
    let turn_rad = TURN_DEG.to_radians();
    let (p, t) = (POSITION_M.powi(2), turn_rad.powi(2));
    let at = state.pose();
    let place = at.translation.vector + Vector3::from(random.normals()) * POSITION_M;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * turn_rad);
    let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
    let estimate = PoseEstimate::new(pose, &Matrix6::from_diagonal(&[p, p, p, t, t, t].into()));
    PoseSample { t_ns: (state.t_s * 1e9).round() as i64, estimate: Ok(estimate) }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let flights: usize = words.next().map_or(Ok(10), |w| w.parse())?;
    let only: Vec<String> = words.collect();
    let campaign = Campaign::new()?;
    let sound = all(&campaign, flights, None);
    let raised = sound.iter().flatten().filter(|f| is_raised(f)).count();
    let count = sound.iter().flatten().count();
    println!("without fault: {count} flights, said to lack something {raised}");
    for fault in
        Fault::ALL.into_iter().filter(|f| only.is_empty() || only.iter().any(|name| name == f.name()))
    {
        let faulty = all(&campaign, flights, Some(fault));
        let pairs: Vec<(&Identified, &Identified)> =
            sound.iter().zip(&faulty).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?))).collect();
        print_fault(fault, &pairs);
    }
    Ok(())
}

/// All flights, in their order; none for one that could not be identified.
fn all(campaign: &Campaign, flights: usize, fault: Option<Fault>) -> Vec<Option<Identified>> {
    let one = |flight: usize| {
        campaign
            .identified(flight, fault)
            .inspect_err(|why| println!("flight {flight}, {fault:?}: {why}"))
            .ok()
    };
    let share = |first: usize| (first..flights).step_by(THREADS).map(one).collect::<Vec<_>>();
    let mut shares: Vec<_> = std::thread::scope(|scope| {
        let own: Vec<_> = (0..THREADS).map(|k| scope.spawn(move || share(k))).collect();
        own.into_iter().filter_map(|thread| thread.join().ok()).map(Vec::into_iter).collect()
    });
    (0..flights).map(|flight| shares[flight % THREADS].next().flatten()).collect()
}

/// Whether the fits say so: output error is refused, or the model is said to lack something.
fn is_raised(Identified { fits, .. }: &Identified) -> bool {
    fits.poses.is_none() || fits.adequacy.lacks_something()
}

/// The estimate of a parameter.
fn estimate<'a>(fit: Option<&'a OutputErrorFit>, name: &str) -> Option<&'a FittedParameter> {
    fit?.parameter(name)
}

/// Whether the interval of a parameter holds what flew.
fn holds(fit: Option<&OutputErrorFit>, name: &str, of: &Identified) -> Option<bool> {
    let p = estimate(fit, name)?;
    Some((p.ci_low..=p.ci_high).contains(&of.truth[name]))
}

fn print_fault(fault: Fault, pairs: &[(&Identified, &Identified)]) {
    println!("{}: {} flights", fault.name(), pairs.len());
    let Some(names) = pairs.iter().find_map(|(sound, _)| sound.fits.poses.as_ref()) else { return };
    let mut moved = vec![0.0; pairs.len()];
    println!("{:14} {:>9} {:>8} {:>8} {:>8} {:>8}", "parameter", "moved", "oe", "fe", "oe sound", "fe sound");
    for name in names.parameters.iter().map(|p| p.name.as_str()) {
        let shift = |(sound, faulty): &(&Identified, &Identified)| {
            let (a, b) =
                (estimate(sound.fits.poses.as_ref(), name)?, estimate(faulty.fits.poses.as_ref(), name)?);
            Some((b.value - a.value) / b.std)
        };
        let shifts: Vec<Option<f64>> = pairs.iter().map(shift).collect();
        for (most, shift) in moved.iter_mut().zip(&shifts) {
            // A refused fit has no parameter that is moved by less.
            *most = shift.map_or(f64::INFINITY, f64::abs).max(*most);
        }
        let rms = (shifts.iter().flatten().map(|s| s * s).sum::<f64>() / pairs.len() as f64).sqrt();
        let held = |of: &dyn Fn(&(&Identified, &Identified)) -> Option<bool>| {
            let held: Vec<bool> = pairs.iter().filter_map(of).collect();
            100.0 * held.iter().filter(|held| **held).count() as f64 / held.len() as f64
        };
        println!(
            "{name:14} {rms:9.2} {:7.1}% {:7.1}% {:7.1}% {:7.1}%{}",
            held(&|(_, faulty)| holds(faulty.fits.poses.as_ref(), name, faulty)),
            held(&|(_, faulty)| holds(faulty.fits.filter.as_ref(), name, faulty)),
            held(&|(sound, _)| holds(sound.fits.poses.as_ref(), name, sound)),
            held(&|(sound, _)| holds(sound.fits.filter.as_ref(), name, sound)),
            if rms < UNTOUCHED { "  not touched" } else { "" }
        );
    }
    let biased: Vec<usize> = (0..pairs.len()).filter(|k| moved[*k] > 1.0).collect();
    let raised = biased.iter().filter(|k| is_raised(pairs[**k].1)).count();
    println!(
        "moved by more than a standard deviation in {} flights, of which {raised} are said to lack something; output error is \
         refused in {}",
        biased.len(),
        pairs.iter().filter(|(_, faulty)| faulty.fits.poses.is_none()).count()
    );
}
