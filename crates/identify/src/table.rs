//! Outputs and regressors of a flight over time, with their errors.

use crate::coloured::ResidualErrors;
use crate::dependence::{Dependence, independent_columns};
use crate::noise::SignalErrors;
use nalgebra::{DMatrix, DVector};

/// One regressor over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name: `0` for the constant, else as the model has it.
    pub name: String,
    /// Names of the inputs that drive it, by themselves or by states; none of what is of motion alone.
    pub inputs: Vec<String>,
    /// Values at the table's times.
    pub values: Vec<f64>,
    /// Root mean square standard deviation of their error outside gaps; 0 where the column is exact.
    pub std: f64,
}

/// A coefficient that the model knows.
#[derive(Debug, Clone, PartialEq)]
pub struct Fixed {
    /// Name of its column.
    pub name: String,
    /// Value of the coefficient.
    pub value: f64,
}

/// One coefficient over time with its regressors, which have passed the same low-pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// As the model has it, such as `C_X`.
    pub name: String,
    /// Values at the table's times, less the part of fixed coefficients.
    pub values: Vec<f64>,
    /// Regressors.
    pub columns: Vec<Column>,
    /// Errors of the regressors and, last, of the output.
    pub errors: SignalErrors,
    /// Errors that happen once, of the pose from which states that follow the motion are integrated: for
    /// each, what one standard deviation of it does to the regressors and, last, the output, at the times
    /// until it has died away.
    pub once: Vec<DMatrix<f64>>,
    /// Coefficients that the model fixes; their part is taken off the values.
    pub fixed: Vec<Fixed>,
    /// Standard deviation over value of the mass or the moment of inertia with which the values, and so all coefficients, scale.
    pub scale_std: f64,
    /// The lowest frequency at which a low-pass of both sides passes one half.
    pub bandwidth_hz: f64,
}

impl Output {
    pub(crate) fn with_columns(&self, chosen: &[usize]) -> Self {
        let kept: Vec<usize> = chosen.iter().copied().chain([self.columns.len()]).collect();
        Self {
            columns: chosen.iter().map(|j| self.columns[*j].clone()).collect(),
            errors: self.errors.of_signals(&kept),
            once: self.once.iter().map(|e| e.select_columns(&kept)).collect(),
            ..self.clone()
        }
    }

    pub(crate) fn columns_at(&self, chosen: &[usize], rows: &[usize]) -> DMatrix<f64> {
        DMatrix::from_fn(rows.len(), chosen.len(), |i, j| self.columns[chosen[j]].values[rows[i]])
    }

    pub(crate) fn regressors_at(&self, rows: &[usize]) -> DMatrix<f64> {
        self.columns_at(&(0..self.columns.len()).collect::<Vec<_>>(), rows)
    }

    /// Standard deviation of the error of the value at a row.
    pub(crate) fn std_at(&self, row: usize) -> f64 {
        self.errors.variance(row, self.columns.len()).sqrt()
    }

    pub(crate) fn values_at(&self, rows: &[usize]) -> DVector<f64> {
        DVector::from_fn(rows.len(), |i, _| self.values[rows[i]])
    }

    /// Which of the regressors, given at some rows, are combinations of others, as far as their errors show.
    pub(crate) fn dependence(&self, regressors: &DMatrix<f64>) -> Dependence {
        independent_columns(regressors, &self.columns.iter().map(|c| c.std).collect::<Vec<_>>())
    }
}

/// Coefficients and regressors of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct CoefficientTable {
    /// Times.
    pub t_s: Vec<f64>,
    /// Outputs.
    pub outputs: Vec<Output>,
    /// First and last time that is fitted.
    pub window_s: (f64, f64),
    /// Median interval of the times.
    pub sample_interval_s: f64,
    /// Whether each instant rests on poses; those in a gap, which the smoother has bridged, are left out of
    /// fits.
    pub usable: Vec<bool>,
    /// Names of outputs that are fitted only when excited, and were not.
    pub not_excited: Vec<String>,
}

impl CoefficientTable {
    fn in_window(&self) -> impl Iterator<Item = (usize, bool)> {
        const ROUNDING_S: f64 = 1e-9;
        let (from_s, to_s) = (self.window_s.0 - ROUNDING_S, self.window_s.1 + ROUNDING_S);
        let inside = move |i: &usize| self.t_s[*i] >= from_s && self.t_s[*i] <= to_s;
        (0..self.t_s.len()).filter(inside).map(|i| (i, self.usable.get(i).copied().unwrap_or(true)))
    }

    /// Indices of the times that are fitted.
    pub fn rows_in_window(&self) -> Vec<usize> {
        self.in_window().filter(|(_, usable)| *usable).map(|(i, _)| i).collect()
    }

    /// Instants of the window that are not fitted because they lie in a gap.
    pub fn instants_in_gaps(&self) -> usize {
        self.in_window().filter(|(_, usable)| !usable).count()
    }

    /// Rows over which errors behind a low-pass are correlated: about one period of its cut-off frequency, at
    /// most a quarter of the rows.
    pub(crate) fn correlated_rows(&self, bandwidth_hz: f64, rows: usize) -> usize {
        (1.0 / (bandwidth_hz * self.sample_interval_s)).ceil().min(rows as f64 / 4.0).max(1.0) as usize
    }

    /// What is known of the errors of the residuals of a fit of some columns at some rows: autocovariances
    /// over eight periods of the low-pass, behind which less than a thousandth is left.
    pub(crate) fn residual_errors(
        &self,
        output: &Output,
        columns: &[usize],
        values: &DVector<f64>,
        rows: &[usize],
    ) -> ResidualErrors {
        // What each regressor, and last the output, weighs in the residual.
        let mut weights = DVector::zeros(output.columns.len() + 1);
        columns.iter().zip(values).for_each(|(column, value)| weights[*column] = -value);
        weights[output.columns.len()] = 1.0;
        let periods = 8.0 / (output.bandwidth_hz * self.sample_interval_s);
        let lags = periods.ceil().clamp(1.0, self.t_s.len() as f64) as usize;
        let effect = |all: &DMatrix<f64>| {
            let effect = all * &weights;
            DVector::from_fn(rows.len(), |k, _| effect.get(rows[k]).copied().unwrap_or(0.0))
        };
        ResidualErrors {
            gamma: output.errors.autocovariances(&weights, self.sample_interval_s, lags),
            once: output.once.iter().map(effect).collect(),
        }
    }
}

/// A column's or a parameter's name for people: `0` is the constant.
pub fn column_words(name: &str) -> &str {
    if name == "0" { "the constant" } else { name }
}
