//! How well a log's clock and the attitude of its gyroscope are found.
//!
//! `cargo run --release -p mavsight-inertial --example alignment -- FLIGHTS`: flights of a minute, poses good to 1 mrad at 30 Hz,
//! a consumer gyroscope at 400 Hz whose clock is 1.7 s early and 80 ppm fast, turned by 30 degrees in the body.

#![allow(clippy::unwrap_used)]

#[path = "../tests/simulated/flight.rs"]
#[allow(dead_code)]
mod flight;

fn main() {
    let flights = std::env::args().nth(1).and_then(|w| w.parse().ok()).unwrap_or(100);
    let ([clock, turn], [offset_s, drift, turn_deg]) = flight::scored(flights);
    println!(
        "{flights} flights; largest error of the offset {:.3} ms, drift {:.2} ppm, attitude {turn_deg:.3} deg",
        1e3 * offset_s,
        1e6 * drift
    );
    println!("normalised squared error: offset and drift {clock:.2} of 2, attitude {turn:.2} of 3");
}
