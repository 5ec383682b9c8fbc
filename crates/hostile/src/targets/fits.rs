//! Equation error, on a simulated flight of which some numbers are any finite ones.

use crate::Outcome;
use crate::numbers::Numbers;
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Vector3, world_from_body};
use mavsight_identify::{Estimator, FitOptions, Options, coefficients, identify_with};
use mavsight_pose::{Doubts, Motion, MotionCovariance, MotionSample};
use mavsight_simulator::{FlightState, Maneuver, Scenario, simulate};
use nalgebra::SMatrix;
use std::sync::LazyLock;

struct Flown {
    vehicle: Vehicle,
    inputs: InputSeries,
    states: Vec<FlightState>,
}

static FLOWN: LazyLock<Flown> = LazyLock::new(|| {
    let vehicle = Vehicle::paper();
    let doublet = |channel: &str, amplitude: f64| Maneuver::Doublet {
        channel: channel.to_owned(),
        start_s: 0.5,
        pulse_s: 0.5,
        amplitude,
    };
    let maneuver = vec![doublet("delta_lon", 3.0), doublet("omega_u", 2.0)];
    let scenario = Scenario { duration_s: 4.0, maneuver, ..Scenario::paper() };
    let inputs = scenario.inputs(&vehicle).unwrap();
    let start = scenario.start(&vehicle).unwrap();
    let states = simulate(&vehicle, &inputs, &start, &scenario.frame_times_s()).unwrap();
    Flown { vehicle, inputs, states }
});

/// The flight's inputs, of which some numbers are others.
fn inputs(numbers: &mut Numbers<'_>) -> Option<InputSeries> {
    let flown = &FLOWN.inputs;
    let values = (0..flown.times_s().len()).flat_map(|k| flown.row(k).to_vec());
    let values = values.map(|value| numbers.near(value, 1e-4)).collect();
    InputSeries::new(flown.names().to_vec(), flown.times_s().to_vec(), values).ok()
}

fn t_ns(numbers: &mut Numbers<'_>, state: &FlightState) -> i64 {
    numbers.near(state.t_s * 1e9, 1e4) as i64
}

/// Motion with noise; other numbers in some places.
fn motion(numbers: &mut Numbers<'_>) -> Motion {
    let sample = |state: &FlightState| {
        let noisy =
            |v: &Vector3<f64>, within: f64, numbers: &mut Numbers<'_>| numbers.near3([v.x, v.y, v.z], within);
        let std: [f64; 18] = std::array::from_fn(|k| numbers.std([1e-3, 1e-3, 1e-2, 1e-2, 0.1, 0.1][k / 3]));
        let all = SMatrix::<f64, 18, 18>::from_diagonal(&std.map(|s| s * s).into());
        let position = noisy(&state.position_in_world_m, 1e-3, numbers);
        MotionSample {
            t_ns: t_ns(numbers, state),
            world_from_body: world_from_body(position, state.attitude),
            velocity_in_body_m_s: noisy(&state.velocity_in_body_m_s, 0.01, numbers),
            rates_rad_s: noisy(&state.rates_rad_s, 0.01, numbers),
            specific_force_m_s2: noisy(&(state.velocity_rate_m_s2 - Vector3::z() * 9.81), 0.1, numbers),
            angular_acceleration_rad_s2: noisy(&state.angular_acceleration_rad_s2, 0.1, numbers),
            covariance: MotionCovariance::of(&all),
        }
    };
    Motion {
        samples: FLOWN.states.iter().map(sample).collect(),
        unknown_ns: Vec::new(),
        doubts: Doubts::default(),
        translation_bandwidth_hz: numbers.near(4.0, 2.0),
        rotation_bandwidth_hz: numbers.near(4.0, 2.0),
        sample_interval_s: numbers.near(1.0 / 30.0, 1e-4),
    }
}

pub(super) fn equation_error(bytes: &[u8]) -> Outcome {
    let numbers = &mut Numbers::of(bytes);
    let (motion, inputs) = (motion(numbers), inputs(numbers));
    let Some(inputs) = inputs else { return Outcome::Refused("no inputs".to_owned()) };
    let estimator = Estimator::ALL[numbers.below(Estimator::ALL.len())];
    let options = FitOptions { estimators: vec![estimator], ..FitOptions::default() };
    let found = coefficients(&motion, &inputs, &FLOWN.vehicle, &Options::default())
        .and_then(|table| identify_with(&table, &options));
    if let Ok(found) = &found {
        for parameter in found.fits.iter().flat_map(|fit| &fit.parameters) {
            for number in [parameter.value, parameter.std, parameter.ci_low, parameter.ci_high] {
                assert!(number.is_none_or(f64::is_finite), "{parameter:?}");
            }
            assert!(parameter.std.is_none_or(|std| std >= 0.0), "{parameter:?}");
        }
    }
    found.into()
}
