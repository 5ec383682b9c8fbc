use super::support::{flown, multisine, noisy_poses};
use crate::output_error::{
    FittedParameter, FlightModel, Measurements, OutputErrorFit, OutputErrorOptions, StateMeasurement,
    filter_error, output_error,
};
use mavsight_flight::Vehicle;
use mavsight_geometry::{Isometry3, Vector3};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, true_values};

/// The camera rig was pushed at this time: all poses behind it lie elsewhere, by no motion.
const PUSHED_S: f64 = 3.0;

fn pushed_poses(states: &[FlightState]) -> Vec<StateMeasurement> {
    let push = Isometry3::new(Vector3::new(0.3, -0.2, 0.1), Vector3::new(0.0, 0.0, 0.4));
    let mut poses = noisy_poses(states, 1.0, &mut Random::new(7, 0));
    for measured in poses.iter_mut().filter(|m| m.t_s() >= PUSHED_S) {
        measured.pose = measured.pose.map(|(own, covariance)| (push * own, covariance));
    }
    poses
}

/// The largest distance from the truth in standard deviations.
fn furthest(fit: &OutputErrorFit, vehicle: &Vehicle) -> f64 {
    let truth = true_values(vehicle);
    let off = |p: &FittedParameter| Some((p.value - truth.get(&p.name)?).abs() / p.std);
    fit.parameters.iter().filter_map(off).fold(0.0, f64::max)
}

/// A jump that no motion made: the pieces before and behind it have one set of parameters and each its own start. In one
/// piece the noise would have to be a hundred times what it is.
#[test]
fn a_motion_that_begins_anew_is_fitted_in_pieces() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(6.0));
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let whole = Measurements::States(pushed_poses(&states));
    let pieces = whole.clone().beginning_anew(&[(PUSHED_S * 1e9) as i64]);
    let options = OutputErrorOptions::default();
    for fit in [output_error, filter_error] {
        let fit = fit(&model, &inputs, &pieces, &options).expect("a fit");
        assert!(furthest(&fit, &vehicle) < 4.0, "{:?}", fit.parameters);
        for (name, factor) in &fit.variance_factors[..6] {
            assert!((0.6..1.4).contains(factor), "{name}: {factor}");
        }
    }
    let is_right = |fit: OutputErrorFit| fit.variance_factors[..6].iter().all(|(_, factor)| *factor < 1.4);
    assert!(!output_error(&model, &inputs, &whole, &options).is_ok_and(is_right));
}
