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

/// What acts where these inputs are recorded: each row changed, at its time.
fn changed(inputs: &InputSeries, change: impl Fn(f64, &mut [f64])) -> InputSeries {
    let row = |(k, t_s): (usize, &f64)| {
        let mut row = inputs.row(k).to_vec();
        change(*t_s, &mut row);
        row
    };
    let rows: Vec<f64> = inputs.times_s().iter().enumerate().flat_map(row).collect();
    InputSeries::new(inputs.names().to_vec(), inputs.times_s().to_vec(), rows).expect("inputs")
}

fn place(inputs: &InputSeries, name: &str) -> usize {
    inputs.names().iter().position(|n| n == name).expect("a channel")
}

/// The swash-plate turned about the vertical.
fn turned(inputs: &InputSeries, turn_rad: f64) -> InputSeries {
    let (lon, lat) = (place(inputs, "delta_lon_rad"), place(inputs, "delta_lat_rad"));
    let (sine, cosine) = turn_rad.sin_cos();
    changed(inputs, |_, row| {
        (row[lon], row[lat]) = (cosine * row[lon] - sine * row[lat], sine * row[lon] + cosine * row[lat]);
    })
}

/// The upper rotor turns slower and slower at the same command: its battery empties, by a hundred thousandth each second.
fn fading(inputs: &InputSeries) -> InputSeries {
    let upper = place(inputs, "omega_u_rad_s");
    changed(inputs, |t_s, row| row[upper] *= 1.0 - 1e-5 * t_s)
}

fn identified(simulated: &Vehicle, acting: impl Fn(&InputSeries) -> InputSeries) -> FlightFits {
    let vehicle = vehicle();
    let scenario = multisine(&[("delta_lon", 2.0), ("delta_lat", 2.0)]);
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let start = scenario.start(&vehicle).expect("a start");
    let states = simulate(simulated, &acting(&inputs), &start, &scenario.frame_times_s()).expect("a flight");
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
    let fits = identified(&vehicle(), InputSeries::clone);
    assert!(!fits.adequacy.lacks_something(), "{:?}", fits.adequacy);
}

/// The estimates of output error hardly move, and its colour takes what is missing for slow errors of the poses.
#[test]
fn a_swash_plate_that_is_turned_is_seen_in_the_moments_that_it_makes() {
    let fits = identified(&vehicle(), |inputs| turned(inputs, 5_f64.to_radians()));
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
    let asked = asked_for(&identified(&simulated, InputSeries::clone));
    assert_eq!(asked.first().map(String::as_str), Some("C_m,u"), "{asked:?}");
}

#[test]
fn a_battery_that_empties_is_seen_in_what_follows_time() {
    let asked = asked_for(&identified(&vehicle(), fading));
    assert!(asked[..3].iter().any(|name| name == "moment z by time"), "{asked:?}");
}
