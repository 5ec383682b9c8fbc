//! Share of truths inside the 95 % intervals over simulated flights: `cargo run --release -p mavsight-pose --example coverage`.
//!
//! An argument is the number of flights per rig (200 without one). Each flight draws manoeuvres, an error of every camera
//! from the calibration's covariance, the noise of every centre, and eight frames in a row that are lost.

#[path = "../tests/simulated/mod.rs"]
#[allow(dead_code)]
mod simulated;

use simulated::{PIXEL_STD, ROWS, Random, Tally, rigs};

fn main() {
    let films = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(200);
    println!("{films} flights of 6 s at 30 frames a second for each rig, centres good to {PIXEL_STD} px");
    for (name, rig) in rigs() {
        let (mut tally, mut random) = (Tally::default(), Random(7));
        let begin = std::time::Instant::now();
        (0..films).for_each(|_| tally.film(&rig, &mut random));
        let each_ms = begin.elapsed().as_secs_f64() * 1e3 / f64::from(films);
        println!("\n{name} ({each_ms:.0} ms a flight, {} frames without a pose)", tally.unmeasured());
        println!("| quantity | inside 95 % | NEES per coordinate | RMS per axis |");
        println!("|---|---|---|---|");
        for (row, what) in ROWS.iter().enumerate() {
            let (share, nees, rms) = (100.0 * tally.share(row), tally.nees(row), tally.rms(row));
            println!("| {what} | {share:.1} % | {nees:.2} | {rms:.2e} |");
        }
    }
}
