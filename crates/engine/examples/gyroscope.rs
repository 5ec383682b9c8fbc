//! What the gyroscope of a log adds to the motion of a film.
//!
//! `cargo run --release -p mavsight-engine --example gyroscope -- SESSION [SEEDS]`: films of the scenario of the paper, such as
//! paper-flight. Its truth is simulated anew, and measured by a consumer gyroscope at 400 Hz whose clock is 1.7 s early and 80 ppm
//! fast, turned by 30 degrees in the body, with other noise for each seed. A second time all poses of a second are taken away.

#![allow(clippy::unwrap_used)]

use mavsight_engine::{calibrate, track};
use mavsight_flight::Vehicle;
use mavsight_geometry::{UnitQuaternion, Vector3};
use mavsight_inertial::{GyroscopeSeries, align_log};
use mavsight_pipeline::{NoProgress, Tracked, motion_of};
use mavsight_pose::{Motion, PoseError};
use mavsight_random::Random;
use mavsight_session::Session;
use mavsight_simulator::{FlightState, Scenario, simulate};
use std::path::PathBuf;

const LOG_HZ: f64 = 400.0;
const OFFSET_S: f64 = -1.7;
const DRIFT: f64 = 8e-5;
/// 0.01 deg/s/√Hz, as consumer gyroscopes have.
const RATE_STD_RAD_S: f64 = 0.01 * 0.017_453_3 * 14.1;
const BIAS_RAD_S: [f64; 3] = [0.012, -0.008, 0.02];
const SCALE: [f64; 3] = [0.008, -0.012, 0.005];
/// The aircraft hovers before the film begins.
const BEFORE_S: f64 = 5.0;
const GAP_NS: i64 = 1_000_000_000;

/// The flight at times from its beginning.
fn flown(vehicle: &Vehicle, times_s: &[f64]) -> Vec<FlightState> {
    let scenario = Scenario::paper();
    let start = scenario.start(vehicle).unwrap();
    simulate(vehicle, &scenario.inputs(vehicle).unwrap(), &start, times_s).unwrap()
}

/// What the gyroscope logs of rates at times by the clock of the poses.
fn logged(rates: &[(f64, Vector3<f64>)], seed: u64) -> GyroscopeSeries {
    let mut random = Random::new(41, seed);
    let axis = Vector3::new(1.0, 2.0, -1.5).normalize();
    let body_from_sensor = UnitQuaternion::from_scaled_axis(axis * 30_f64.to_radians());
    let (bias, gains) = (Vector3::from(BIAS_RAD_S), Vector3::from(SCALE).add_scalar(1.0));
    let measured = rates.iter().map(|(_, rate)| {
        let of_sensor = (body_from_sensor.inverse() * rate / (1.0 + DRIFT)).component_div(&gains);
        of_sensor + bias + Vector3::from(random.normals()) * RATE_STD_RAD_S
    });
    let measured = measured.collect();
    let times_ns = rates.iter().map(|(t_s, _)| (1e9 * (t_s * (1.0 + DRIFT) + OFFSET_S)).round() as i64);
    GyroscopeSeries::new(times_ns.collect(), measured).unwrap()
}

/// Root mean square errors of attitude (rad) and rates (rad/s), and the shares of 95 % intervals that hold the truth.
struct Score {
    rms: [f64; 2],
    held: [f64; 2],
}

impl Score {
    /// Of several flights of the same length together.
    fn of_all(scores: &[Score]) -> Self {
        let mean = |of: &dyn Fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
        let rms = [0, 1].map(|q| mean(&|s| s.rms[q].powi(2)).sqrt());
        Self { rms, held: [0, 1].map(|q| mean(&|s| s.held[q])) }
    }
}

/// Errors of attitude (rad) and rates (rad/s) at an instant, and their standard deviations.
struct Errors {
    t_ns: i64,
    off: [Vector3<f64>; 2],
    std: [Vector3<f64>; 2],
}

fn errors(motion: &Motion, vehicle: &Vehicle) -> Vec<Errors> {
    let times_s: Vec<f64> = motion.samples.iter().map(|s| s.t_ns as f64 * 1e-9).collect();
    let truth = flown(vehicle, &times_s);
    let error = |(s, state): (&mavsight_pose::MotionSample, &FlightState)| {
        let turn = (state.pose().rotation.inverse() * s.world_from_body.rotation).scaled_axis();
        let std = [1, 3].map(|k| s.covariance.quantity(k).diagonal().map(f64::sqrt));
        Errors { t_ns: s.t_ns, off: [turn, s.rates_rad_s - state.rates_rad_s], std }
    };
    motion.samples.iter().zip(&truth).map(error).collect()
}

fn scored(motion: &Motion, vehicle: &Vehicle) -> Score {
    let all = errors(motion, vehicle);
    let count = 3.0 * all.len() as f64;
    let mean = |of: &dyn Fn(&Vector3<f64>, &Vector3<f64>) -> f64| {
        [0, 1].map(|q| all.iter().map(|e| of(&e.off[q], &e.std[q])).sum::<f64>() / count)
    };
    let rms = mean(&|error, _| error.norm_squared()).map(f64::sqrt);
    let held = mean(&|error, std| error.iter().zip(std).map(|(e, s)| f64::from(e.abs() <= 1.96 * s)).sum());
    Score { rms, held }
}

/// Attitude off at the end of a second without poses (rad), and its standard deviation; none where it is not known.
fn after_a_gap(
    tracked: &Tracked,
    gyroscope: &GyroscopeSeries,
    vehicle: &Vehicle,
    from_ns: i64,
) -> Option<(f64, f64)> {
    let mut tracked = tracked.clone();
    let inside = |t_ns: i64| (from_ns..from_ns + GAP_NS).contains(&t_ns);
    tracked
        .poses
        .iter_mut()
        .filter(|p| inside(p.t_ns))
        .for_each(|p| p.estimate = Err(PoseError::NotMeasured));
    let rates = align_log(&tracked.poses, gyroscope).unwrap().body_rates(gyroscope).unwrap();
    let motion = motion_of(&tracked, Some(&rates), vehicle, &NoProgress).unwrap();
    let last = errors(&motion, vehicle).into_iter().rfind(|e| inside(e.t_ns))?;
    (from_ns + GAP_NS - last.t_ns < 50_000_000).then(|| (last.off[0].norm(), last.std[0].norm()))
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let path = PathBuf::from(arguments.next().expect("a session"));
    let seeds: u64 = arguments.next().and_then(|w| w.parse().ok()).unwrap_or(10);
    let session = Session::load(&path).unwrap();
    let rig = calibrate(&session, &NoProgress).unwrap();
    let tracked = track(&session, rig, &NoProgress).unwrap().tracked;
    let vehicle = &session.vehicle;
    let alone = scored(&motion_of(&tracked, None, vehicle, &NoProgress).unwrap(), vehicle);
    let (from_ns, to_ns) = (tracked.poses[0].t_ns, tracked.poses[tracked.poses.len() - 1].t_ns);
    let from_s = from_ns as f64 * 1e-9;
    let count = ((to_ns - from_ns) as f64 * 1e-9 * LOG_HZ) as usize;
    let times_s: Vec<f64> = (0..count).map(|k| from_s + k as f64 / LOG_HZ).collect();
    let hover =
        (0..(BEFORE_S * LOG_HZ) as usize).map(|k| (from_s - BEFORE_S + k as f64 / LOG_HZ, Vector3::zeros()));
    let flown = flown(vehicle, &times_s);
    let rates: Vec<_> = hover.chain(flown.iter().map(|s| (s.t_s, s.rates_rad_s))).collect();
    let line = |name: &str, score: &Score, over: &[f64; 2]| {
        println!(
            "{name:<10} attitude {:.4} deg ({:.3}), rates {:.3} deg/s ({:.2}); 95 % intervals hold {:.1} and {:.1} %",
            score.rms[0].to_degrees(),
            score.rms[0] / over[0],
            score.rms[1].to_degrees(),
            score.rms[1] / over[1],
            100.0 * score.held[0],
            100.0 * score.held[1]
        );
    };
    line("film alone", &alone, &alone.rms);
    let mut scores = Vec::new();
    for seed in 0..seeds {
        let gyroscope = logged(&rates, seed);
        let alignment = align_log(&tracked.poses, &gyroscope).unwrap();
        let body_rates = alignment.body_rates(&gyroscope).unwrap();
        match motion_of(&tracked, Some(&body_rates), vehicle, &NoProgress) {
            Ok(motion) => {
                let score = scored(&motion, vehicle);
                line(&format!("seed {seed}"), &score, &alone.rms);
                scores.push(score);
            }
            Err(why) => println!("seed {seed}: {why}"),
        }
        let gap_ns = from_ns + (1.0e9 + 0.7e9 * seed as f64) as i64;
        match after_a_gap(&tracked, &gyroscope, vehicle, gap_ns) {
            Some((off, std)) => println!(
                "           after 1 s without balls from {:.1} s: {:.3} deg off, stated {:.3} deg",
                gap_ns as f64 * 1e-9,
                off.to_degrees(),
                std.to_degrees()
            ),
            None => {
                println!("           not known after 1 s without balls from {:.1} s", gap_ns as f64 * 1e-9)
            }
        }
    }
    line("all seeds", &Score::of_all(&scores), &alone.rms);
}
