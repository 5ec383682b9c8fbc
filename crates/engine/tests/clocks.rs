//! Inputs whose clock is not the poses'.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_engine::{Flight, identify_from_poses};
use mavsight_flight::{InputSeries, Vehicle, VehicleFile};
use mavsight_geometry::{Matrix6, UnitQuaternion, Vector3};
use mavsight_identify::Clocks;
use mavsight_identify::output_error::MotionFits;
use mavsight_model::SHELF;
use mavsight_pipeline::{IdentifyOptions, NoProgress};
use mavsight_pose::{PoseEstimate, PoseSample};
use mavsight_random::Random;
use mavsight_session::RunResults;
use mavsight_simulator::{Maneuver, Scenario, simulate};

/// Poses of a flight whose inputs do not repeat, and the inputs.
fn flown(vehicle: &Vehicle) -> (Vec<PoseSample>, InputSeries) {
    let sine = |channel: &str, harmonics: [u32; 4]| Maneuver::Multisine {
        channel: channel.to_owned(),
        start_s: 0.0,
        length_s: 10.0,
        harmonics: harmonics.to_vec(),
        amplitude: 2.0,
    };
    let maneuver = vec![sine("delta_lon", [3, 7, 11, 15]), sine("delta_lat", [4, 8, 12, 16])];
    let scenario = Scenario { maneuver, ..Scenario::paper() };
    let inputs = scenario.inputs(vehicle).unwrap();
    let start = scenario.start(vehicle).unwrap();
    let (mut random, std) = (Random::new(62, 0), 5e-4);
    let covariance = Matrix6::from_diagonal_element(std * std);
    let filmed = simulate(vehicle, &inputs, &start, &scenario.frame_times_s()).unwrap();
    let poses = filmed.iter().map(|s| {
        let mut pose = s.pose();
        pose.translation.vector += Vector3::from(random.normals()) * std;
        pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * std);
        PoseSample { t_ns: (s.t_s * 1e9).round() as i64, estimate: Ok(PoseEstimate::new(pose, &covariance)) }
    });
    (poses.collect(), inputs)
}

fn identified(
    vehicle: &Vehicle,
    poses: &[PoseSample],
    inputs: &InputSeries,
    lag_s: Option<f64>,
) -> RunResults {
    let motion_fits = MotionFits { output_error: true, filter_error: false };
    let flight = Flight {
        name: "clocks",
        vehicle,
        inputs: Some(inputs),
        sensors: None,
        gyroscope: None,
        log_sensors: None,
        options: IdentifyOptions { motion_fits, lag_s, ..IdentifyOptions::default() },
    };
    let mut results = RunResults { poses: poses.to_vec(), ..RunResults::default() };
    identify_from_poses(&mut results, &flight, &NoProgress).unwrap();
    results
}

/// A time constant by output error, in its standard deviations from the truth.
fn time_constant_error(results: &RunResults) -> f64 {
    let fit = results.output_error.poses.as_ref().unwrap();
    let found = fit.parameter("tau_l").unwrap();
    println!("tau_l {} ± {}", found.value, found.std);
    (found.value - 0.05).abs() / found.std
}

#[test]
fn a_known_lag_moves_the_inputs_of_a_model_without_equations() {
    let coaxial = SHELF.iter().find(|(name, _)| *name == "coaxial").unwrap().1;
    let without_equations = coaxial.split("[[equation]]").next().unwrap().to_owned();
    let mut file = VehicleFile::from(Vehicle::paper());
    file.model = Some("motion.toml".to_owned());
    file.simulation.clear();
    let vehicle = file.vehicle(|_| Ok(without_equations.clone())).unwrap();
    let (poses, inputs) = flown(&vehicle);
    let early = inputs.at_times(|t_s| t_s - 0.3).unwrap();
    let results = identified(&vehicle, &poses, &early, Some(0.3));
    assert!(time_constant_error(&results) < 4.0);
}

#[test]
fn clocks_seconds_apart_are_found() {
    let vehicle = Vehicle::paper();
    let (poses, inputs) = flown(&vehicle);
    for apart_s in [0.8, -2.4] {
        let stamped = inputs.at_times(|t_s| t_s - apart_s).unwrap();
        let results = identified(&vehicle, &poses, &stamped, None);
        let Some(Clocks::Lag(lag)) = results.clocks else { panic!("{:?}", results.clocks) };
        println!("{apart_s} s: {lag:?}");
        assert!((lag.lag_s - apart_s).abs() < 4.0 * lag.std_s && lag.std_s < 0.02, "{apart_s}: {lag:?}");
        assert!(results.notes.iter().any(|n| n.starts_with("The clocks differ")), "{:?}", results.notes);
        assert!(time_constant_error(&results) < 4.0);
    }
}
