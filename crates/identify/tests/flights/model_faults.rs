//! What residuals follow in flights whose model lacks nothing, and in flights whose inputs act otherwise than recorded.

use crate::aircraft::{Flown, multisine};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_identify::output_error::{FlightFitOptions, FlightFits, InputClock};
use mavsight_random::Random;
use mavsight_simulator::simulate;

/// The coaxial helicopter with the damping in yaw that its simulation has.
fn vehicle() -> Vehicle {
    let mut vehicle = Vehicle::paper();
    let damping = vehicle.simulation["C_n_r"];
    vehicle.parameters.insert("C_n_r".to_owned(), damping);
    vehicle
}

/// The swash-plate turned about the vertical.
fn turned(inputs: &InputSeries, turn_rad: f64) -> InputSeries {
    let names = inputs.names().to_vec();
    let place = |name: &str| names.iter().position(|n| n == name).expect("a channel");
    let (lon, lat) = (place("delta_lon_rad"), place("delta_lat_rad"));
    let (sine, cosine) = turn_rad.sin_cos();
    let row = |k: usize| {
        let mut row = inputs.row(k).to_vec();
        (row[lon], row[lat]) = (cosine * row[lon] - sine * row[lat], sine * row[lon] + cosine * row[lat]);
        row
    };
    let rows: Vec<f64> = (0..inputs.times_s().len()).flat_map(row).collect();
    InputSeries::new(names, inputs.times_s().to_vec(), rows).expect("inputs")
}

fn identified(simulated: &Vehicle, turn_rad: f64) -> FlightFits {
    let vehicle = vehicle();
    let scenario = multisine(&[("delta_lon", 2.0), ("delta_lat", 2.0)]);
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let start = scenario.start(&vehicle).expect("a start");
    let acting = turned(&inputs, turn_rad);
    let states = simulate(simulated, &acting, &start, &scenario.frame_times_s()).expect("a flight");
    let flown = Flown { vehicle, inputs, states };
    let poses = flown.poses(0.5e-3, 1e-3, &mut Random::new(54, 0));
    let options = FlightFitOptions { clock: InputClock::Known, ..FlightFitOptions::default() };
    FlightFits::of_flight(&flown.vehicle, &flown.inputs, &poses, None, &options).expect("fits")
}

fn asked_for(fits: &FlightFits) -> Vec<String> {
    let asked = fits.adequacy.asked_for.as_ref().expect("it was asked").as_ref().expect("a fit");
    asked.candidates.iter().chain(&asked.signals).map(|t| t.name.clone()).collect()
}

#[test]
fn a_model_that_lacks_nothing_is_asked_for_nothing() {
    let fits = identified(&vehicle(), 0.0);
    assert!(!fits.adequacy.lacks_something(), "{:?}", fits.adequacy);
}

/// The estimates of output error hardly move, and its colour takes what is missing for slow errors of the poses.
#[test]
fn a_swash_plate_that_is_turned_is_seen_in_the_moments_that_it_makes() {
    let fits = identified(&vehicle(), 5_f64.to_radians());
    let asked = asked_for(&fits);
    let strongest = &asked[..3];
    for moment in ["moment x by delta_lon", "moment y by delta_lat"] {
        assert!(strongest.iter().any(|name| name == moment), "{asked:?}");
    }
    let notes = &fits.poses.as_ref().expect("output error").notes;
    assert!(notes[0].contains("moment x that follows delta_lon"), "{notes:?}");
}

/// Damping that the vehicle's file does not have is a candidate of the model.
#[test]
fn damping_that_the_file_lacks_is_asked_for() {
    let mut simulated = vehicle();
    simulated.simulation.insert("C_m_u".to_owned(), 2e-5);
    let asked = asked_for(&identified(&simulated, 0.0));
    assert_eq!(asked.first().map(String::as_str), Some("C_m,u"), "{asked:?}");
}
