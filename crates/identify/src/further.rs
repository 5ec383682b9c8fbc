//! Further states at the times of the inputs, as far as inputs drive them.

use crate::IdentifyError;
use crate::model::Equations;
use mavsight_flight::InputSeries;
use mavsight_flight::response::{Between, first_order_response};
use mavsight_model::regression::{InputRow, InputSignal};

/// The inputs of a flight in the order of its equations, and what they make of the further states.
pub(crate) struct Further {
    rows: usize,
    inputs: Vec<f64>,
    width: usize,
    states: Vec<f64>,
    count: usize,
}

/// How a signal goes from one row of the inputs to the next: inputs hold, what states follow moves smoothly.
pub(crate) fn between(signal: &InputSignal) -> Between {
    if signal.states().is_empty() { Between::Hold } else { Between::Line }
}

impl Further {
    /// # Errors
    /// A column that is needed and not there.
    pub(crate) fn new(inputs: &InputSeries, equations: &Equations) -> Result<Self, IdentifyError> {
        let (regression, width) = (&equations.regression, equations.inputs.len());
        let needed = regression.inputs();
        let names: Vec<&str> = needed.iter().map(|k| equations.inputs[*k].column.as_str()).collect();
        let rows = inputs.times_s().len();
        let mut own = vec![0.0; rows * width];
        if !names.is_empty() {
            let selected = inputs.select(&names)?;
            for row in 0..rows {
                for (k, value) in needed.iter().zip(selected.row(row)) {
                    own[row * width + k] = *value;
                }
            }
        }
        let count = regression.states.iter().map(|s| s.state + 1).max().unwrap_or(0);
        let states = vec![0.0; rows * count];
        let mut out = Self { rows, inputs: own, width, states, count };
        for state in &regression.states {
            let forcing = out.values(&state.forcing);
            let start = out.values(&state.initial).first().copied().unwrap_or(0.0);
            let response = first_order_response(
                inputs.times_s(),
                &forcing,
                between(&state.forcing),
                state.time_s,
                start,
            );
            for (row, value) in response.into_iter().enumerate() {
                out.states[row * count + state.state] = value;
            }
        }
        Ok(out)
    }

    /// A signal at each row.
    pub(crate) fn values(&self, signal: &InputSignal) -> Vec<f64> {
        signal.series((0..self.rows).map(|row| InputRow {
            inputs: &self.inputs[row * self.width..(row + 1) * self.width],
            states: &self.states[row * self.count..(row + 1) * self.count],
        }))
    }

    /// What inputs make of a further state, at each row.
    pub(crate) fn series(&self, state: usize) -> Vec<f64> {
        (0..self.rows).map(|row| self.states[row * self.count + state]).collect()
    }
}
