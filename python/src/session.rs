//! A recorded session through all stages, and the program.

use crate::motion::Motion;
use mavsight::command_line;
use mavsight::engine::{self, EngineError, Options};
use mavsight::pipeline::NoProgress;
use mavsight::session::{RunResults, Session, result_tables};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;

/// Estimator, name, value and standard deviation.
type Parameter = (String, String, f64, f64);

/// What a run found: its tables as the text of the files of `mavsight run`, and what Python asks for most.
#[pyclass(frozen, get_all)]
pub(crate) struct Found {
    /// Name of the session.
    session: String,
    /// Smoothed motion; None where the flight gives none.
    motion: Option<Py<Motion>>,
    /// Parameters as (estimator, name, value, standard deviation), of those that are determined.
    parameters: Vec<Parameter>,
    /// What could not be had, and why.
    notes: Vec<String>,
    /// Text of each table, by the name of its file.
    tables: BTreeMap<String, String>,
}

/// Carries a recorded session through all stages, as `mavsight run` does, and writes nothing.
#[pyfunction]
#[pyo3(signature = (session, equation_error_only=false, lag_s=None, hold_out_s=None, search=false))]
pub(crate) fn run(
    py: Python<'_>,
    session: PathBuf,
    equation_error_only: bool,
    lag_s: Option<f64>,
    hold_out_s: Option<(f64, f64)>,
    search: bool,
) -> PyResult<Found> {
    let options =
        Options { equation_error_only, lag_s, held_out_s: hold_out_s, search, ..Options::default() };
    let results = py.detach(|| {
        let session = Session::load(&session).map_err(EngineError::Input)?;
        engine::run(&session, &options, &NoProgress)
    });
    let results = results.map_err(|error| {
        let words = error.to_string();
        if error.is_of_the_input() { PyValueError::new_err(words) } else { PyRuntimeError::new_err(words) }
    })?;
    let tables = result_tables(&results).map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
    Ok(Found {
        session: results.session.clone(),
        parameters: parameters(&results),
        tables: tables.into_iter().map(|(name, text)| (name.to_owned(), text)).collect(),
        motion: results.motion.map(|motion| Py::new(py, Motion::from(motion))).transpose()?,
        notes: results.notes,
    })
}

/// Does what the command `mavsight` does with such words, of which the first is its name, and gives its exit status.
#[pyfunction]
pub(crate) fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| command_line(words))
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
