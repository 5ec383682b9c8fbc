//! How often 95 % intervals of output error hold the truth, over simulated flights with a multisine.
//!
//! `cargo run --release -p mavsight-identify --example coverage -- poses 200`; the first word is `poses`,
//! `image` (exact cameras and markers), `nuisances` (markers off by 0.5 mm, their centres by 0.1 px through
//! each flight), `coloured` (exact cameras and markers, but half of the variance of each centre lasts about
//! half a second) or `path` (half of it is a function of where the marker is in the image, which changes
//! within some ten pixels).
//!
//! For all but `poses`, total least squares of equation error gets the same observations, by way of poses and
//! the smoother: the last column is the error of this fit over its error, where both have the parameter.

#[allow(dead_code)]
#[path = "../tests/flights/aircraft.rs"]
mod aircraft;

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{
    Camera, ControlPoint, ImageSize, Intrinsics, Isometry3, Matrix2, Matrix6, UnitQuaternion, Vector2,
    Vector3, world_from_body,
};
use mavsight_identify::output_error::{
    FittedParameter, FlightModel, ImageMeasurements, Measurements, ModelParameter, OutputErrorFit,
    OutputErrorOptions, StateMeasurement, output_error,
};
use mavsight_identify::{
    Bandwidth, EquationFile, Estimator, FitOptions, Options, coefficients, identify_with,
};
use mavsight_pose::{
    BodyMarker, CameraControl, MarkerObservation, PoseEstimator, PoseSample, Rig, calibrate, smooth,
};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Maneuver, Scenario, simulate, true_values};
use nalgebra::Point3;
use std::time::Instant;

const POSITION_STD_M: f64 = 5e-4;
const TURN_STD_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;
const PIXEL_STD_PX: f64 = 0.1;
/// Waves a channel of an error that changes with the place in the image, and the longest and shortest.
const WAVES: usize = 6;
const WAVELENGTHS_PX: [f64; 2] = [200.0, 20.0];
const COLOUR_TIME_S: f64 = 0.5;

fn normal3(random: &mut Random) -> Vector3<f64> {
    Vector3::new(random.normal(), random.normal(), random.normal())
}

fn scenario() -> Scenario {
    let sine = |channel: &str, amplitude, harmonics: [u32; 4]| Maneuver::Multisine {
        channel: channel.to_owned(),
        start_s: 0.5,
        length_s: 9.5,
        harmonics: harmonics.to_vec(),
        amplitude,
    };
    Scenario {
        maneuver: vec![
            sine("delta_lon", 2.5, [3, 7, 11, 15]),
            sine("delta_lat", 2.5, [4, 8, 12, 16]),
            sine("omega_u", 1.0, [5, 9, 13, 17]),
            sine("omega_l", 1.0, [6, 10, 14, 18]),
        ],
        ..Scenario::paper()
    }
}

fn rig() -> Result<Rig, Box<dyn std::error::Error>> {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
    let side = |i: u32, bit: u32| if (i >> bit) & 1 == 1 { 1.5 } else { -1.5 };
    let mut controls = Vec::new();
    for centre in [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]] {
        let camera = Camera::looking_at(Vector3::from(centre), Vector3::new(0.0, 0.0, 1.5), k, size);
        let mut points = Vec::new();
        for i in 0..8 {
            let point_in_world_m = Vector3::new(side(i, 0), side(i, 1), side(i, 2) + 1.5);
            let pixel = camera.project(&point_in_world_m)?.pixel;
            let pixel_cov_px2 = Matrix2::identity() * 0.01;
            points.push(ControlPoint { name: String::new(), point_in_world_m, pixel, pixel_cov_px2 });
        }
        controls.push(CameraControl::exact("camera".to_owned(), size, points, vec![0.0; 8]));
    }
    Ok(calibrate(&controls)?)
}

fn poses(states: &[FlightState], random: &mut Random) -> Measurements {
    let (p, t) = (POSITION_STD_M.powi(2), TURN_STD_RAD.powi(2));
    let covariance = Matrix6::from_diagonal(&nalgebra::Vector6::new(p, p, p, t, t, t));
    let measured = |s: &FlightState, random: &mut Random| {
        let at = world_from_body(s.position_in_world_m, s.attitude);
        let place = at.translation.vector + normal3(random) * POSITION_STD_M;
        let turn = UnitQuaternion::from_scaled_axis(normal3(random) * TURN_STD_RAD);
        let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
        let t_ns = (s.t_s * 1e9).round() as i64;
        StateMeasurement::of_pose(t_ns, pose, covariance)
    };
    Measurements::States(states.iter().map(|s| measured(s, random)).collect())
}

/// Sums of waves over the image, one for each axis of each marker in each camera, of unit variance.
struct Waves(Vec<[(Vector2<f64>, f64); WAVES]>);

impl Waves {
    fn new(channels: usize, random: &mut Random) -> Self {
        let wave = |k: usize, random: &mut Random| {
            let [longest, shortest] = WAVELENGTHS_PX;
            let length_px = longest * (shortest / longest).powf(k as f64 / (WAVES - 1) as f64);
            let direction = Vector2::new(random.normal(), random.normal()).normalize();
            (direction * (std::f64::consts::TAU / length_px), random.normal() * 10.0)
        };
        Self((0..channels).map(|_| std::array::from_fn(|k| wave(k, random))).collect())
    }

    fn at(&self, channel: usize, pixel: &Vector2<f64>) -> f64 {
        let sum: f64 = self.0[channel].iter().map(|(k, phase)| (k.dot(pixel) + phase).sin()).sum();
        sum * (2.0 / WAVES as f64).sqrt()
    }
}

/// All observations of a flight.
fn observations(
    states: &[FlightState],
    (rig, markers): (&Rig, &[BodyMarker]),
    kind: &str,
    random: &mut Random,
) -> Result<Vec<MarkerObservation>, Box<dyn std::error::Error>> {
    let share = if kind == "nuisances" { 1.0 } else { 0.0 };
    let half = matches!(kind, "coloured" | "path");
    let level = if half { 0.5f64.sqrt() * PIXEL_STD_PX } else { PIXEL_STD_PX };
    let normal2 = |random: &mut Random| Vector2::new(random.normal(), random.normal());
    let channels = rig.cameras.len() * markers.len();
    let mut slow: Vec<Vector2<f64>> = (0..channels).map(|_| normal2(random) * level).collect();
    let waves = Waves::new(2 * channels, random);
    let mut before_s = states[0].t_s;
    let off: Vec<Vector3<f64>> = markers.iter().map(|_| normal3(random) * (5e-4 * share)).collect();
    let bias: Vec<Vector2<f64>> =
        (0..channels).map(|_| Vector2::new(random.normal(), random.normal()) * (0.1 * share)).collect();
    let mut seen = Vec::new();
    for s in states {
        let pose = world_from_body(s.position_in_world_m, s.attitude);
        let kept = (-(s.t_s - before_s) / COLOUR_TIME_S).exp();
        before_s = s.t_s;
        for e in &mut slow {
            *e = *e * kept + normal2(random) * (level * (1.0 - kept * kept).sqrt());
        }
        for (camera, c) in rig.cameras.iter().enumerate() {
            for (marker, m) in markers.iter().enumerate() {
                let centre = (pose * Point3::from(m.marker_in_body_m + off[marker])).coords;
                let exact = c.camera.project_ball(&centre, m.radius_m)?.pixel;
                let k = camera * markers.len() + marker;
                let systematic = match kind {
                    "coloured" => slow[k],
                    "path" => Vector2::new(waves.at(2 * k, &exact), waves.at(2 * k + 1, &exact)) * level,
                    _ => bias[k],
                };
                let pixel = exact + normal2(random) * level + systematic;
                let covariance_px2 = Matrix2::identity() * PIXEL_STD_PX.powi(2);
                let t_ns = (s.t_s * 1e9).round() as i64;
                seen.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
            }
        }
    }
    Ok(seen)
}

fn image(
    seen: &[MarkerObservation],
    (rig, markers): (&Rig, &[BodyMarker]),
    kind: &str,
) -> Result<Measurements, Box<dyn std::error::Error>> {
    let mut images = ImageMeasurements::new(rig, markers, seen)?;
    if kind == "nuisances" {
        images = images.with_marker_positions(5e-4).with_marker_biases(0.1);
    }
    Ok(Measurements::Image(images))
}

/// What equation error by total least squares finds in the same observations, by the names of output error.
fn by_equations(
    seen: &[MarkerObservation],
    (rig, markers): (&Rig, &[BodyMarker]),
    (vehicle, inputs): (&Vehicle, &InputSeries),
) -> Result<Vec<(String, f64)>, Box<dyn std::error::Error>> {
    let estimator = PoseEstimator::new(rig, markers);
    let mut poses = Vec::new();
    let mut previous = None;
    for own in seen.chunk_by(|a, b| a.t_ns == b.t_ns) {
        let estimate = estimator.estimate(own[0].t_ns, own, previous.as_ref());
        previous = estimate.as_ref().ok().map(|e| e.world_from_body).or(previous);
        poses.push(PoseSample { t_ns: own[0].t_ns, estimate });
    }
    let motion = smooth(&poses, vehicle.environment.gravity_m_s2)?;
    let options = Options {
        equations: Some(EquationFile::parse("products.toml", aircraft::PRODUCTS)?),
        bandwidth: Bandwidth::Automatic,
        ..Options::default()
    };
    let table = coefficients(&motion, inputs, vehicle, &options)?;
    let choice = FitOptions { estimators: vec![Estimator::TotalLeastSquares], ..FitOptions::default() };
    let found = identify_with(&table, &choice)?;
    let mut out = Vec::new();
    for fit in &found.fits {
        for p in &fit.parameters {
            // kappa_u*alpha_u is called alpha_u there, kappa_u alone u.
            let name = p.name.rsplit('*').next().unwrap_or(&p.name).replace("kappa_", "");
            out.extend(p.value.map(|value| (format!("{},{name}", fit.output), value)));
        }
    }
    Ok(out)
}

#[derive(Clone, Default)]
struct Tally {
    held: usize,
    /// Sum of errors over their claimed standard deviations.
    normalised: f64,
    squares: f64,
    variance: f64,
    bound: f64,
    /// Squares of the errors of equation error, and of this fit in the same flights.
    by_equations: (f64, f64),
}

impl Tally {
    fn add(&mut self, p: &FittedParameter, true_value: f64, by_equations: Option<f64>) {
        self.held += usize::from(p.ci_low <= true_value && true_value <= p.ci_high);
        self.normalised += (p.value - true_value) / p.std;
        self.squares += (p.value - true_value).powi(2);
        self.variance += p.std.powi(2);
        self.bound += p.bound_std.powi(2);
        if let Some(value) = by_equations {
            self.by_equations.0 += (value - true_value).powi(2);
            self.by_equations.1 += (p.value - true_value).powi(2);
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let kind = words.next().unwrap_or_else(|| "poses".to_owned());
    let flights: usize = words.next().map_or(Ok(20), |w| w.parse())?;
    let vehicle = Vehicle::paper();
    let scenario = scenario();
    let inputs: InputSeries = scenario.inputs(&vehicle)?;
    let states = simulate(&vehicle, &inputs, &scenario.start(&vehicle)?, &scenario.frame_times_s())?;
    let truth = true_values(&vehicle);
    let rig = rig()?;
    let markers: Vec<BodyMarker> = vehicle
        .marker
        .iter()
        .map(|m| BodyMarker {
            name: m.name.clone(),
            marker_in_body_m: Vector3::from(m.position_m),
            radius_m: 0.5 * m.diameter_m,
        })
        .collect();
    let model = FlightModel::new(&vehicle, &inputs)?;
    let mut tallies = vec![Tally::default(); model.free().len()];
    let (mut seconds, mut iterations, mut coloured, mut failed) = (Vec::new(), 0, 0, 0);
    let mut factor = 0.0;
    for flight in 0..flights {
        let mut random = Random::new(1, flight as u64);
        let mut other = Vec::new();
        let measured = if kind == "poses" {
            poses(&states, &mut random)
        } else {
            let seen = observations(&states, (&rig, &markers), &kind, &mut random)?;
            other = by_equations(&seen, (&rig, &markers), (&vehicle, &inputs))?;
            image(&seen, (&rig, &markers), &kind)?
        };
        let begin = Instant::now();
        let fit: OutputErrorFit =
            match output_error(&model, &inputs, &measured, &OutputErrorOptions::default()) {
                Ok(fit) => fit,
                Err(error) => {
                    println!("flight {flight}: {error}");
                    failed += 1;
                    continue;
                }
            };
        seconds.push(begin.elapsed().as_secs_f64());
        iterations += fit.iterations;
        coloured += usize::from(fit.correlated_instants > 0);
        factor += fit.variance_factors.iter().map(|f| f.1).sum::<f64>() / fit.variance_factors.len() as f64;
        for (tally, p) in tallies.iter_mut().zip(&fit.parameters) {
            let true_value = match p.parameter {
                ModelParameter::Parameter(_) => truth[&p.name],
                ModelParameter::InputLag => 0.0,
            };
            let by_equations = other.iter().find(|(name, _)| *name == p.name).map(|(_, value)| *value);
            tally.add(p, true_value, by_equations);
        }
    }
    let n = (flights - failed) as f64;
    seconds.sort_by(f64::total_cmp);
    println!(
        "{kind}: {n} flights, {:.3} s (median) and {:.1} iterations each, {coloured} taken as coloured, {failed} failed, mean factor {:.4}",
        seconds.get(seconds.len() / 2).copied().unwrap_or_default(),
        iterations as f64 / n,
        factor / n
    );
    print_table(&tallies, &model, n);
    Ok(())
}

/// A line for each parameter.
fn print_table(tallies: &[Tally], model: &FlightModel, n: f64) {
    println!(
        "{:14} {:>8} {:>10} {:>12} {:>14} {:>16}",
        "parameter", "held", "mean/std", "error/bound", "predicted/got", "error/tls error"
    );
    for (tally, parameter) in tallies.iter().zip(model.free()) {
        println!(
            "{:14} {:7.1}% {:10.3} {:12.3} {:14.3} {:>16}",
            model.name(*parameter),
            100.0 * tally.held as f64 / n,
            tally.normalised / n,
            (tally.squares / tally.bound).sqrt(),
            (tally.variance / tally.squares).sqrt(),
            match tally.by_equations {
                (0.0, _) => String::new(),
                (theirs, ours) => format!("{:.3}", (ours / theirs).sqrt()),
            }
        );
    }
}
