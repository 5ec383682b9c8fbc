//! Flights to be identified.

use crate::output_error::StateMeasurement;
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion, Vector3, world_from_body};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Maneuver, Scenario, simulate};

pub(crate) fn normal3(random: &mut Random) -> Vector3<f64> {
    Vector3::new(random.normal(), random.normal(), random.normal())
}

/// A multisine on both swash-plate axes and both rotor speeds: odd harmonics each to their own.
pub(crate) fn multisine(duration_s: f64) -> Scenario {
    let sine = |channel: &str, amplitude, harmonics: [u32; 4]| Maneuver::Multisine {
        channel: channel.to_owned(),
        start_s: 0.5,
        length_s: duration_s - 0.5,
        harmonics: harmonics.to_vec(),
        amplitude,
    };
    Scenario {
        duration_s,
        maneuver: vec![
            sine("delta_lon", 2.5, [3, 7, 11, 15]),
            sine("delta_lat", 2.5, [4, 8, 12, 16]),
            sine("omega_u", 1.0, [5, 9, 13, 17]),
            sine("omega_l", 1.0, [6, 10, 14, 18]),
        ],
        ..Scenario::paper()
    }
}

pub(crate) fn flown(vehicle: &Vehicle, scenario: &Scenario) -> (InputSeries, Vec<FlightState>) {
    let inputs = scenario.inputs(vehicle).expect("inputs");
    let start = scenario.start(vehicle).expect("a start");
    let states = simulate(vehicle, &inputs, &start, &scenario.frame_times_s()).expect("a flight");
    (inputs, states)
}

pub(crate) const POSITION_STD_M: f64 = 5e-4;
pub(crate) const TURN_STD_RAD: f64 = 0.05 * std::f64::consts::PI / 180.0;

pub(crate) fn pose_covariance() -> Matrix6<f64> {
    let (p, t) = (POSITION_STD_M.powi(2), TURN_STD_RAD.powi(2));
    Matrix6::from_diagonal(&nalgebra::Vector6::new(p, p, p, t, t, t))
}

pub(crate) fn pose(state: &FlightState) -> Isometry3<f64> {
    world_from_body(state.position_in_world_m, state.attitude)
}

/// Poses with white noise of the given multiple of 0.5 mm and 0.05°.
pub(crate) fn noisy_poses(states: &[FlightState], times: f64, random: &mut Random) -> Vec<StateMeasurement> {
    states
        .iter()
        .map(|s| {
            let at = pose(s);
            let place = at.translation.vector + normal3(random) * (POSITION_STD_M * times);
            let turn = UnitQuaternion::from_scaled_axis(normal3(random) * (TURN_STD_RAD * times));
            let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
            StateMeasurement::of_pose((s.t_s * 1e9).round() as i64, pose, pose_covariance())
        })
        .collect()
}

/// Adds errors that last so long, of the given multiple of 0.5 mm and 0.05°.
pub(crate) fn add_slow_errors(
    samples: &mut [StateMeasurement],
    time_s: f64,
    times: f64,
    random: &mut Random,
) {
    let mut slow = (normal3(random), normal3(random));
    let mut before_s = None;
    for sample in samples {
        let interval_s = sample.t_s() - before_s.replace(sample.t_s()).unwrap_or(sample.t_s());
        let kept = f64::exp(-interval_s / time_s);
        let fresh = (1.0 - kept * kept).sqrt();
        let next = |e: Vector3<f64>, random: &mut Random| e * kept + normal3(random) * fresh;
        slow = (next(slow.0, random), next(slow.1, random));
        let pose = &mut sample.pose.as_mut().expect("a pose").0;
        pose.translation.vector += slow.0 * (times * POSITION_STD_M);
        pose.rotation *= UnitQuaternion::from_scaled_axis(slow.1 * (times * TURN_STD_RAD));
    }
}
