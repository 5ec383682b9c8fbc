//! Median time of a simulated flight: the paper's, 10 s with 300 instants, and of preparing its equations.
//!
//! `cargo run --release -p mavsight-simulator --example time`

use mavsight_flight::Vehicle;
use mavsight_simulator::{Scenario, Simulator, SimulatorError, simulate};
use std::hint::black_box;
use std::time::Instant;

/// Repetitions, of which the median counts.
const TIMES: usize = 201;

fn median_ms(mut run: impl FnMut()) -> f64 {
    let mut times_ms: Vec<f64> = (0..TIMES)
        .map(|_| {
            let begin = Instant::now();
            run();
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times_ms.sort_by(f64::total_cmp);
    times_ms[TIMES / 2]
}

fn main() -> Result<(), SimulatorError> {
    let (vehicle, scenario) = (Vehicle::paper(), Scenario::paper());
    let (inputs, start) = (scenario.inputs(&vehicle)?, scenario.start(&vehicle)?);
    let times_s = scenario.frame_times_s();
    let whole = median_ms(|| drop(black_box(simulate(&vehicle, &inputs, &start, &times_s))));
    let prepared = median_ms(|| drop(black_box(Simulator::new(&vehicle))));
    println!("10 s of flight: {whole:.2} ms, of which the equations are prepared in {prepared:.2} ms");
    Ok(())
}
