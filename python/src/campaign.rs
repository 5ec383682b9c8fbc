//! Campaigns of simulated flights.

use mavsight::score::Campaign as Flights;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// What flights return: combination of each flight, estimates and standard deviations, a row a flight.
type Arrays<'py> = (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// A campaign: a grid of rigs, noise and manoeuvres, each planned once.
#[pyclass(frozen)]
pub(crate) struct Campaign {
    flights: Flights,
    path: PathBuf,
}

#[pymethods]
impl Campaign {
    /// Reads a campaign file and all that it names, and plans every combination.
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let flights = Flights::load(&path).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok(Self { flights, path })
    }

    /// The campaign file.
    #[getter]
    fn path(&self) -> String {
        self.path.display().to_string()
    }

    /// Number of flights in all.
    fn __len__(&self) -> usize {
        self.flights.flights() as usize
    }

    /// Header of the table, one line.
    #[getter]
    fn header(&self) -> &'static str {
        Flights::HEADER
    }

    /// Rows of the table of the flights from `start` to before `stop`, as text.
    fn rows(&self, py: Python<'_>, start: u64, stop: u64) -> String {
        let stop = stop.min(self.flights.flights());
        py.detach(|| self.flights.rows(start..stop))
    }

    /// The same as arrays: combination of each flight, estimates, and standard deviations, each row a flight and each column a
    /// parameter of `parameters(combination)`; not a number where a fit was refused or another combination has more parameters.
    fn estimates<'py>(&self, py: Python<'py>, start: u64, stop: u64) -> PyResult<Arrays<'py>> {
        let stop = stop.min(self.flights.flights());
        let start = start.min(stop);
        let width = self.flights.combinations().map(|c| c.1.len()).max().unwrap_or(0);
        let flown: Vec<_> = py.detach(|| (start..stop).map(|k| self.flights.fly(k)).collect());
        let n = flown.len();
        let (mut cells, mut values, mut stds) =
            (Vec::with_capacity(n), vec![f64::NAN; n * width], vec![f64::NAN; n * width]);
        for (row, (cell, estimates)) in flown.into_iter().enumerate() {
            cells.push(cell as u64);
            for (k, p) in estimates.into_iter().flatten().enumerate() {
                values[row * width + k] = p.estimate;
                stds[row * width + k] = p.std;
            }
        }
        let table = |numbers: Vec<f64>| PyArray1::from_vec(py, numbers).reshape([n, width]);
        Ok((PyArray1::from_vec(py, cells), table(values)?, table(stds)?))
    }

    /// Rig, noise and manoeuvre of a combination.
    fn combination(&self, index: usize) -> PyResult<(String, String, String)> {
        let found = self.flights.combinations().nth(index).map(|c| c.0.clone());
        let [rig, noise, manoeuvre] =
            found.ok_or_else(|| PyValueError::new_err(format!("there is no combination {index}")))?;
        Ok((rig, noise, manoeuvre))
    }

    /// Names of a combination's parameters, and the truth of each.
    fn parameters(&self, index: usize) -> PyResult<Vec<(String, f64)>> {
        let found = self.flights.combinations().nth(index).map(|c| c.1);
        found.ok_or_else(|| PyValueError::new_err(format!("there is no combination {index}")))
    }
}
