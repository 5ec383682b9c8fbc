//! The body as built, over simulated flights: `cargo run --release -p mavsight-pose --example refine`.
//!
//! An argument is the number of flights per rig (50 without one). Each flight draws marker positions that are
//! off by a ruler's 2 mm in every coordinate, manoeuvres, an error of every camera from the calibration's
//! covariance, and the centres' noise.

#[path = "../tests/simulated/mod.rs"]
#[allow(dead_code)]
mod simulated;

use simulated::ruler::{case, position_rms_m};
use simulated::{Random, rigs};

fn main() {
    let flights = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(50);
    println!("position RMS of single poses over {flights} flights, mm");
    println!("| rig | true positions | the file's | refined | refined over true |");
    println!("|---|---|---|---|---|");
    for (name, rig) in rigs() {
        let (mut random, mut squares) = (Random::new(21, 0), [0.0; 3]);
        for _ in 0..flights {
            let rms_m = position_rms_m(&rig, &case(&rig, &mut random));
            squares.iter_mut().zip(rms_m).for_each(|(sum, rms_m)| *sum += rms_m * rms_m);
        }
        let [of_true, of_file, refined] = squares.map(|s: f64| 1e3 * (s / f64::from(flights)).sqrt());
        println!("| {name} | {of_true:.3} | {of_file:.3} | {refined:.3} | {:.3} |", refined / of_true);
    }
}
