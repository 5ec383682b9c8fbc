//! mavsight in Python: NumPy arrays in and out.

mod campaign;
mod motion;
mod session;

use pyo3::prelude::*;

/// The compiled part of the package.
#[pymodule]
fn _mavsight(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<campaign::Campaign>()?;
    module.add_class::<motion::Motion>()?;
    module.add_function(wrap_pyfunction!(motion::smooth, module)?)?;
    module.add_class::<session::Found>()?;
    module.add_function(wrap_pyfunction!(session::command, module)?)?;
    module.add_function(wrap_pyfunction!(session::run, module)?)
}
