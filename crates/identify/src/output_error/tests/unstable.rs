use super::support::{flown, multisine, noisy_poses};
use crate::output_error::{
    FlightModel, Measurements, OutputErrorFit, OutputErrorOptions, StateMeasurement, output_error,
};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Isometry3, UnitQuaternion};
use mavsight_pose::{PoseEstimate, PoseSample};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Scenario, simulate, true_values};
use nalgebra::{DVector, Matrix6xX};

/// Rotors below the centre of gravity: the fly-bar, which keeps the upper disc level, drives every tilt
/// further.
fn unstable() -> Vehicle {
    let mut vehicle = Vehicle::paper();
    // C_m,alpha_u = 2 C_Tu h_u/R for a hub 6 cm below the centre of gravity.
    let arm = 2.0 * vehicle.parameters["C_Tu"] * -0.06 / vehicle.parameters["R"];
    vehicle.simulation.insert("C_m_alpha_u".to_owned(), arm);
    vehicle
}

/// A flight that a pilot, who sees tilt and turn, keeps in the air; his swash-plate is recorded.
fn piloted(vehicle: &Vehicle, scenario: &Scenario, roll_rad: f64) -> (InputSeries, Vec<FlightState>) {
    let (plan, _) = flown(&Vehicle::paper(), scenario);
    let mut at = scenario.start(vehicle).expect("a start");
    at.attitude.phi_rad = roll_rad;
    let (mut flown, mut states) = (Vec::new(), Vec::new());
    for (k, t_s) in plan.times_s().iter().enumerate() {
        let (e, w) = (at.attitude, at.rates_rad_s);
        let mut now = plan.row(k).to_vec();
        now[2] += f64::clamp(-2.0 * e.theta_rad - 0.4 * w.y, -0.3, 0.3);
        now[3] += f64::clamp(-2.0 * e.phi_rad - 0.4 * w.x, -0.3, 0.3);
        let times_s = [*t_s, (k + 1) as f64 * 0.01];
        let held = [now.as_slice(), now.as_slice()].concat();
        let hold = InputSeries::new(plan.names(), times_s.to_vec(), held).expect("inputs");
        let [first, second] = &simulate(vehicle, &hold, &at, &times_s).expect("a flight")[..] else {
            panic!()
        };
        states.push(first.clone());
        at = second.as_start();
        flown.extend(now);
    }
    let inputs = InputSeries::new(plan.names(), plan.times_s().to_vec(), flown).expect("inputs");
    (inputs, states.into_iter().step_by(4).collect())
}

fn holds_the_truth(fit: &OutputErrorFit, vehicle: &Vehicle) {
    let truth = true_values(vehicle);
    for p in &fit.parameters {
        // Where rotors stand, C_Z,0 and C_n,0 are free beside the thrusts and torques of the vehicle: zero.
        let Some(truth) = truth.get(&p.name) else { continue };
        let off = (p.value - truth) / p.std;
        assert!(off.abs() < 3.0, "{}: {:.4e} ± {:.1e} is {off:.1} away", p.name, p.value, p.std);
    }
}

#[test]
fn an_unstable_aircraft_is_identified_in_segments_where_one_shot_fails() {
    let vehicle = unstable();
    let (inputs, states) = piloted(&vehicle, &multisine(8.0), 0.0);
    let tilt = states.iter().map(|s| s.attitude.theta_rad.abs().max(s.attitude.phi_rad.abs()));
    assert!(tilt.fold(0.0, f64::max) < 1.0, "the pilot holds it");
    // From the start that knows nothing of it: hubs above the centre of gravity.
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let measured = Measurements::States(noisy_poses(&states, 1.0, &mut Random::new(3, 0)));
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    holds_the_truth(&fit, &vehicle);
    let single = OutputErrorOptions { segment_s: f64::INFINITY, ..Default::default() };
    let shot = output_error(&model, &inputs, &measured, &single);
    assert!(shot.is_err() || shot.is_ok_and(|f| f.reduced_chi_square > 1.5));
}

/// Roll hardly moves, so that its damping is free to go far: steps opened the gaps between segments anew, and
/// the fit had not converged after a hundred.
#[test]
fn a_long_flight_with_cameras_that_are_off_converges() {
    let vehicle = Vehicle::paper();
    let mut scenario = multisine(20.0);
    scenario.maneuver.truncate(1);
    let (inputs, states) = piloted(&vehicle, &scenario, 2e-3);
    let mut random = Random::new(3, 0);
    let systematic = Matrix6xX::from_fn(9, |i, j| (2e-2 * (1.0 + i as f64 + 7.0 * j as f64).sin()) as f32);
    let off = systematic.map(f64::from) * DVector::from_fn(9, |_, _| random.normal());
    let turn = UnitQuaternion::from_scaled_axis(off.fixed_rows::<3>(3).into_owned());
    let moved = |measured: StateMeasurement| {
        let (at, covariance) = measured.pose.expect("a pose");
        let place = at.translation.vector + off.fixed_rows::<3>(0);
        let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
        let estimate = PoseEstimate::new(pose, &covariance).with_systematic(&systematic);
        PoseSample { t_ns: measured.t_ns, estimate: Ok(estimate) }
    };
    let poses: Vec<PoseSample> = noisy_poses(&states, 1.0, &mut random).into_iter().map(moved).collect();
    let measured = Measurements::States(StateMeasurement::of_poses(poses.iter()));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    assert!(fit.iterations < 80, "{}", fit.iterations);
    holds_the_truth(&fit, &vehicle);
}
