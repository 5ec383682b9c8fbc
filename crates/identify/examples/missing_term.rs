//! Twelve flights of a helicopter whose drag the model lacks, by an independent simulator.
//!
//! `cargo run --release -p mavsight-identify --example missing_term -- FOLDER`: the folder has `vehicle.toml`
//! and, for flights 11 to 22, `poses-N.csv` and `inputs-N.csv`. How many of the true parameters lie in the
//! intervals of output error and of filter error; then, for each flight, what a structure search added, and
//! whether the drag (0.1 N s/m) and the fly-bar's time constant (3 s) lie in their intervals by output error and, with
//! what was added, by filter error.

#[path = "../tests/missing_term/flights.rs"]
mod flights;

use flights::{Flown, TRUTH};
use mavsight_identify::IdentifyError;
use mavsight_identify::output_error::{
    InitialStates, OutputErrorFit, OutputErrorOptions, filter_error, output_error, search_structure,
};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

/// What the simulator had, of the terms that are searched and of what suffers most from their lack.
const SEARCHED: [(&str, f64); 3] = [("d_xy", 0.1), ("d_z", 0.1), ("tau_f", 3.0)];

/// How many of the true parameters lie in their intervals, and the fly-bar's time constant; none of a fit that was
/// refused.
fn inside(name: &str, fit: Result<OutputErrorFit, IdentifyError>) -> usize {
    let fit = match fit {
        Ok(fit) => fit,
        Err(why) => {
            println!("  {name}: {why}");
            return 0;
        }
    };
    let holds = |(name, truth): &&(&str, f64)| {
        fit.parameter(name).is_some_and(|p| (p.ci_low..=p.ci_high).contains(truth))
    };
    let count = TRUTH.iter().filter(holds).count();
    if let Some(tau) = fit.parameter("tau_f") {
        println!("  {name}: {count} of {}, tau_f {:.3} ± {:.3} s", TRUTH.len(), tau.value, tau.std);
    }
    count
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("give the folder of the flights")?;
    let (mut found, mut others) = (0, 0);
    let (mut by_output_error, mut by_filter_error) = ([0; SEARCHED.len()], [0; SEARCHED.len()]);
    let (mut by_output, mut by_filter) = (0, 0);
    for flight in 11..=22 {
        let flown = Flown::read(Path::new(&folder), flight)?;
        let (model, inputs, measurements) = (flown.model()?, &flown.inputs, flown.measurements());
        println!("flight {flight}:");
        let options = OutputErrorOptions::default();
        by_output += inside("output error", output_error(&model, inputs, &measurements, &options));
        by_filter += inside("filter error", filter_error(&model, inputs, &measurements, &options));
        // The discs are not in trim at the first instant.
        let options = OutputErrorOptions { initial: InitialStates::Free, ..options };
        let begin = Instant::now();
        let search = match search_structure(&model, inputs, &measurements, &options) {
            Ok(search) => search,
            Err(error) => {
                println!("  search: {error}");
                continue;
            }
        };
        println!("  search, {:.1} s:", begin.elapsed().as_secs_f64());
        search.notes().iter().for_each(|note| println!("  {note}"));
        let names = || search.added.iter().map(|term| term.fitted.name.as_str());
        found += usize::from(names().any(|name| name == "d_xy"));
        others += names().filter(|name| !["d_xy", "d_z"].contains(name)).count();
        let again = filter_error(&search.model, inputs, &measurements, &options)?;
        for (fit, held) in [(&search.fit, &mut by_output_error), (&again, &mut by_filter_error)] {
            for ((name, truth), held) in SEARCHED.iter().zip(held) {
                let Some(p) = fit.parameter(name) else { continue };
                let is_held = (p.ci_low..=p.ci_high).contains(truth);
                *held += usize::from(is_held);
                println!("  {name} {:.4} ± {:.4}{}", p.value, p.std, if is_held { "" } else { ", not held" });
            }
        }
    }
    let all = 12 * TRUTH.len();
    println!("inside their intervals: output error {by_output} of {all}, filter error {by_filter} of {all}");
    println!("search: drag along x and y found in {found} of 12, {others} terms that are not drag");
    for (k, (name, truth)) in SEARCHED.iter().enumerate() {
        println!(
            "after it intervals of {name} hold {truth}: output error {}, filter error {}",
            by_output_error[k], by_filter_error[k]
        );
    }
    Ok(())
}
