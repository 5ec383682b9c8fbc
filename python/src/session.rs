//! A recorded session through all stages.

use crate::motion::Motion;
use mavsight_engine::{EngineError, Options};
use mavsight_pipeline::NoProgress;
use mavsight_session::{RunResults, Session};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Estimator, name, value and standard deviation.
type Parameter = (String, String, f64, f64);

/// Carries a recorded session through all stages, as `mavsight run` does, and writes nothing: the motion, None where the flight
/// gives none; parameters as (estimator, name, value, standard deviation); notes on what could not be had.
#[pyfunction]
#[pyo3(signature = (session, equation_error_only=false, lag_s=None))]
pub(crate) fn run(
    py: Python<'_>,
    session: PathBuf,
    equation_error_only: bool,
    lag_s: Option<f64>,
) -> PyResult<(Option<Motion>, Vec<Parameter>, Vec<String>)> {
    let options = Options { equation_error_only, lag_s, ..Options::default() };
    let results = py.detach(|| {
        let session = Session::load(&session).map_err(EngineError::Input)?;
        mavsight_engine::run(&session, &options, &NoProgress)
    });
    let results = results.map_err(|error| {
        let words = error.to_string();
        if error.is_of_the_input() { PyValueError::new_err(words) } else { PyRuntimeError::new_err(words) }
    })?;
    Ok((results.motion.clone().map(Motion), parameters(&results), results.notes))
}

fn parameters(results: &RunResults) -> Vec<Parameter> {
    let equations = results.identification.iter().flat_map(|i| &i.fits).flat_map(|fit| {
        let known = fit.parameters.iter().filter_map(|p| Some((p, p.value?, p.std?)));
        known.map(|(p, value, std)| {
            (fit.estimator.name().to_owned(), format!("{},{}", fit.output, p.name), value, std)
        })
    });
    let motion = results.output_error.named().flat_map(|(estimator, fit)| {
        fit.parameters.iter().map(move |p| (estimator.to_owned(), p.name.to_owned(), p.value, p.std))
    });
    equations.chain(motion).collect()
}
