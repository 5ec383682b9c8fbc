//! The shelf's coaxial helicopter, whose poses may be those of a point beside its centre of gravity.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Isometry3, Vector3, world_from_body};
use mavsight_simulator::{FlightState, InitialState, simulate};

const COLUMNS: [&str; 4] = ["motor_upper", "motor_lower", "servo_roll", "servo_pitch"];

fn vehicle() -> Vehicle {
    toml::from_str(include_str!("../../../docs/shelf/coaxial-lag/vehicle.toml")).expect("a vehicle")
}

fn pose(state: &FlightState) -> Isometry3<f64> {
    world_from_body(state.position_in_world_m, state.attitude)
}

/// Two flights that begin in one motion, each described by another point of the body: the point goes where the body carries
/// it, and the body turns alike.
#[test]
fn a_point_beside_the_centre_of_gravity_goes_where_the_body_carries_it() {
    let arm_m = Vector3::new(0.03, 0.156, -0.05);
    let times_s: Vec<f64> = (0..=20).map(|k| 0.05 * f64::from(k)).collect();
    let row =
        |t_s: &f64| [0.52 + 0.02 * (7.0 * t_s).sin(), 0.55, 0.3 * (9.0 * t_s).cos(), 0.4 * (5.0 * t_s).sin()];
    let values = times_s.iter().flat_map(row).collect();
    let inputs =
        InputSeries::new(COLUMNS.map(str::to_owned).to_vec(), times_s.clone(), values).expect("inputs");
    let centred = vehicle();
    let mut beside = vehicle();
    beside.parameters.extend(["x_o", "y_o", "z_o"].map(str::to_owned).into_iter().zip(arm_m.iter().copied()));
    let mut start = InitialState::at_rest(&centred, inputs.row(0));
    start.rates_rad_s = Vector3::new(0.8, -0.6, 1.5);
    start.velocity_in_body_m_s = Vector3::new(0.4, 0.2, -0.1);
    let mut moved = start.clone();
    moved.position_in_world_m =
        (world_from_body(start.position_in_world_m, start.attitude) * nalgebra::Point3::from(arm_m)).coords;
    moved.velocity_in_body_m_s += start.rates_rad_s.cross(&arm_m);
    let at_centre = simulate(&centred, &inputs, &start, &times_s).expect("a flight");
    let at_point = simulate(&beside, &inputs, &moved, &times_s).expect("a flight");
    for (centre, point) in at_centre.iter().zip(&at_point) {
        let carried = pose(centre) * Isometry3::new(arm_m, Vector3::zeros());
        let apart = carried.inverse() * pose(point);
        let (off_m, turned_rad) = (apart.translation.vector.norm(), apart.rotation.angle());
        assert!(off_m < 1e-7 && turned_rad < 1e-7, "{} s: {off_m} m, {turned_rad} rad", centre.t_s);
    }
    let last = (pose(&at_centre[0]).inverse() * pose(&at_centre[20])).rotation.angle();
    assert!(last > 0.3, "the body turned by {last} rad");
}
