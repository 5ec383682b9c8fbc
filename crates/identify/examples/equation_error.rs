//! Two hundred simulated flights of a multisine on swash-plate and rotor speeds, seen with the noise of
//! ordinary cameras: which share of the 95 % intervals holds the truth.
//!
//! `cargo run --release -p mavsight-identify --example equation_error [FLIGHTS]`

#[allow(dead_code)]
#[path = "../tests/flights/aircraft.rs"]
mod aircraft;
#[path = "../tests/flights/tally.rs"]
mod tally;

use mavsight_identify::Estimator;

fn main() {
    let runs = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(200);
    let flown = aircraft::fly(&aircraft::longitudinal_multisine(), mavsight_flight::Vehicle::paper());
    let truth = aircraft::multisine_truth(&flown.vehicle);
    tally::print(&tally::tally(&flown, aircraft::PRODUCTS, &truth, &Estimator::ALL, runs));
}
