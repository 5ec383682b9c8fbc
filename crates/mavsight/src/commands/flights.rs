//! Several flights of one aircraft: their names, and parameters over all of them.

use crate::out::{out, outln};
use anyhow::Result;
use mavsight_identify::output_error::FlightFits;
use mavsight_identify::{FittedFlight, Identification, pooled_parameters};
use mavsight_report::{pooled_text, write_flights_report};
use mavsight_session::{RunResults, results::names, write_pooled};
use std::path::Path;

/// The fits of one flight.
pub(crate) struct Fitted {
    equations: Option<Identification>,
    motion: FlightFits,
}

impl Fitted {
    /// All else of the results is freed: of many flights it would be much.
    pub(crate) fn of(results: RunResults) -> Self {
        Self { equations: results.identification, motion: results.output_error }
    }
}

/// Names that all differ: those that are there twice get a number.
pub(crate) fn distinct(names: Vec<String>) -> Vec<String> {
    let is_alone = |name: &String| names.iter().filter(|other| *other == name).count() == 1;
    let own = names.iter().enumerate();
    own.map(|(k, name)| if is_alone(name) { name.clone() } else { format!("{name}-{}", k + 1) }).collect()
}

/// Prints whose results follow.
pub(crate) fn heading(name: &str) -> Result<()> {
    outln!("\n== {name}\n");
    Ok(())
}

/// Pools the parameters of several flights, prints them, and writes `pooled.csv` and `flights.html` where a folder is
/// given.
pub(crate) fn pool(title: &str, flights: &[String], fitted: &[Fitted], out: Option<&Path>) -> Result<()> {
    let all = fitted.iter().map(|f| FittedFlight { equations: f.equations.as_ref(), motion: &f.motion });
    let parameters = pooled_parameters(&all.collect::<Vec<_>>());
    out!("{}", pooled_text(flights, &parameters));
    if let Some(out) = out {
        write_pooled(out, &parameters)?;
        write_flights_report(title, flights, &parameters, out)?;
        outln!("\nOver all flights: {}, {}", out.join(names::POOLED).display(), names::FLIGHTS);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_are_alike_are_numbered() {
        let names = |all: &[&str]| distinct(all.iter().map(|n| (*n).to_owned()).collect());
        assert_eq!(names(&["a", "b"]), ["a", "b"]);
        assert_eq!(names(&["pose", "b", "pose"]), ["pose-1", "b", "pose-3"]);
    }
}
