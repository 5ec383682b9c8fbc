//! Outputs and regressors of a model from motion and inputs.

use crate::coloured::coloured;
use crate::inverse::log_determinant;
use crate::lowpass::lowpass_at;
use crate::model::{self, EquationFile, Equations};
use crate::noise::{Bands, SignalErrors, Source, SourceVariance, Term, Transfer};
use crate::passed::Passed;
use crate::signals::{Flight, Signal, scale_terms};
use crate::table::{CoefficientTable, Column, Fixed, Output};
use crate::{Correlation, IdentifyError, least_squares};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_model::regression::RegressionEquation;
use mavsight_pose::{Motion, median};
use nalgebra::{DMatrix, DVector, DVectorView};

/// The low-pass that both sides of a regression pass in addition to the smoother's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Bandwidth {
    /// Of a grid below the smoother's the lowest whose parameters have, in the geometric mean, standard
    /// deviations that cannot be distinguished from the least of the grid, by the determinant of the
    /// least-squares covariance (D-optimal: Box & Lucas 1959). From a record of n = 2BT independent values a
    /// standard deviation is known to 1/√(2n), and what is within that is the simpler choice (Breiman,
    /// Friedman, Olshen & Stone 1984, section 3.4.3). The smoother's bandwidth suits positions; the noise of
    /// accelerations grows with frequency to the fourth power.
    #[default]
    Automatic,
    /// None.
    Smoother,
    /// One that passes one half at so many hertz.
    Hz(f64),
}

/// What a user may choose.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Left out at either end, where a low-pass leans on one side only; at least one period of the
    /// smoother's, and of a further low-pass, and at most a quarter of the record.
    pub margin_s: f64,
    /// Equations in place of those of the vehicle's model.
    pub equations: Option<EquationFile>,
    /// The equations that are formed, by their names; all where none are named.
    pub only: Vec<String>,
    /// Low-pass.
    pub bandwidth: Bandwidth,
}

impl Default for Options {
    fn default() -> Self {
        Self { margin_s: 0.5, equations: None, only: Vec::new(), bandwidth: Bandwidth::Automatic }
    }
}

impl Options {
    /// These options for each equation of a vehicle by itself.
    ///
    /// # Errors
    /// [`IdentifyError::NoEquations`] where the vehicle's model has none and no file gives any.
    pub fn by_equation(&self, vehicle: &Vehicle) -> Result<Vec<Self>, IdentifyError> {
        let mut names = model::names(vehicle, self.equations.as_ref());
        names.retain(|name| self.is_formed(name));
        if names.is_empty() {
            return Err(IdentifyError::NoEquations(vehicle.model.name.clone()));
        }
        Ok(names.into_iter().map(|name| Self { only: vec![name], ..self.clone() }).collect())
    }

    fn is_formed(&self, equation: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|name| name == equation)
    }
}

/// Forms the outputs of the vehicle's equations and their regressors.
///
/// What is measured are the forces and moments of the air in body axes: mass times specific force, and
/// I ω̇ + ω × I ω. Each is divided by its equation's scale; the paper's C_X, C_Z = m a/(½ρπR⁴ω²) and
/// C_m = I_yy q̇/(½ρπR⁵ω²) are of this kind (equation 4, with q̇ in place of the misprinted q). Further
/// states, such as flapping angles, are integrated from the smoothed rates and the recorded inputs, from
/// their initial values at the first input. All that stands in one equation has passed the same low-passes
/// ([`mavsight_pose::lowpass_like`]): the smoother's and that of [`Bandwidth`].
///
/// Valid for flights that begin in trim, with time constants that are known. Instants in a gap of the poses,
/// where the smoother's variance of a velocity or rate is above nine times its median, or beside a gap in
/// time, are not fitted.
///
/// # Errors
/// Times of the motion that do not increase; inputs that do not cover the flight or lack a column; equations
/// that are no regression ([`mavsight_model::regression`]), or none; a signal that is not finite, a scale that is not above zero; a
/// bandwidth that is not positive, an empty motion, or states that rates drive where the motion has a gap in
/// time, over which rates cannot be integrated.
pub fn coefficients(
    motion: &Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    options: &Options,
) -> Result<CoefficientTable, IdentifyError> {
    let mut equations = Equations::new(vehicle, inputs, options.equations.as_ref())?;
    equations.regression.equations.retain(|e| options.is_formed(&e.name));
    coefficients_of(motion, inputs, vehicle, &equations, options)
}

/// [`coefficients`] of equations that are at hand.
pub(crate) fn coefficients_of(
    motion: &Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    equations: &Equations,
    options: &Options,
) -> Result<CoefficientTable, IdentifyError> {
    if let Some(pair) = motion.samples.windows(2).find(|pair| pair[1].t_ns <= pair[0].t_ns) {
        return Err(IdentifyError::BadMeasurement { t_s: pair[1].t_ns as f64 * 1e-9, what: "motion" });
    }
    let flight = Flight::new(motion, inputs, vehicle, equations)?;
    let (Some(first_s), Some(last_s)) = (flight.t_s.first().copied(), flight.t_s.last().copied()) else {
        return Err(IdentifyError::TooFewInstants { found: 0, parameters: 1 });
    };
    let mut slowest_hz = motion.translation_bandwidth_hz.min(motion.rotation_bandwidth_hz);
    if let Bandwidth::Hz(hz) = options.bandwidth {
        slowest_hz = slowest_hz.min(hz);
    }
    let margin_s = options.margin_s.max(1.0 / slowest_hz).clamp(0.0, (last_s - first_s) / 4.0);
    let mut table = CoefficientTable {
        t_s: flight.t_s.clone(),
        outputs: Vec::with_capacity(equations.regression.equations.len()),
        window_s: (first_s + margin_s, last_s - margin_s),
        sample_interval_s: motion.sample_interval_s,
        usable: usable(&flight, margin_s),
        not_excited: Vec::new(),
    };
    let rows = table.rows_in_window();
    for equation in &equations.regression.equations {
        let draft = Draft::new(&flight, equation)?;
        let whole = || draft.finish(&flight, &table.usable, None);
        if equation.where_excited && !excited(&whole(), &rows) {
            table.not_excited.push(equation.name.clone());
            continue;
        }
        let output = match options.bandwidth {
            Bandwidth::Smoother => whole(),
            Bandwidth::Hz(value) if !(value.is_finite() && value > 0.0) => {
                let (what, must) = ("the bandwidth", "be above zero");
                return Err(IdentifyError::BadSetting { what, value, must });
            }
            Bandwidth::Hz(hz) => draft.finish(&flight, &table.usable, Some(hz)),
            Bandwidth::Automatic => draft.best(&flight, &rows, &table),
        };
        table.outputs.push(output);
    }
    Ok(table)
}

/// Instants whose smoothed rates are not much worse than usual, and not within the margin of a gap in time.
fn usable(flight: &Flight<'_>, margin_s: f64) -> Vec<bool> {
    let mut out = vec![true; flight.t_s.len()];
    for source in Source::all() {
        let variances = flight.variances(source);
        let usual = median(variances.clone()).unwrap_or(0.0);
        for (usable, variance) in out.iter_mut().zip(&variances) {
            *usable &= usual == 0.0 || *variance <= 9.0 * usual;
        }
    }
    for (from_s, to_s) in flight.gaps_s() {
        for (usable, t_s) in out.iter_mut().zip(&flight.t_s) {
            *usable &= *t_s < from_s - margin_s || *t_s > to_s + margin_s;
        }
    }
    out
}

/// Whether the output, and one regressor, move by more than three times their errors: a signal that does not
/// is not distinguished from noise at any usual level.
fn excited(output: &Output, rows: &[usize]) -> bool {
    let variance = rows.iter().map(|i| output.std_at(*i).powi(2)).sum::<f64>() / rows.len().max(1) as f64;
    let moved = |values: &DVector<f64>, std: f64| {
        let spread = values.variance().sqrt();
        spread > 3.0 * std && spread > 1e-9 * values.amax()
    };
    let regressors = output.regressors_at(rows);
    let moves = |(column, x): (&Column, DVectorView<'_, f64>)| moved(&x.into_owned(), column.std);
    moved(&output.values_at(rows), variance.sqrt())
        && output.columns.iter().zip(regressors.column_iter()).any(moves)
}

/// What a column is called, and the inputs that drive it.
struct Named {
    name: String,
    inputs: Vec<String>,
}

/// An output behind the smoother's low-passes alone.
struct Draft {
    name: String,
    output: Signal,
    columns: Vec<(Named, Signal)>,
    fixed: Vec<Fixed>,
    scale_std: f64,
    bands: Bands,
}

impl Draft {
    fn new(flight: &Flight<'_>, equation: &RegressionEquation) -> Result<Self, IdentifyError> {
        let passed = equation
            .regressors
            .iter()
            .fold(Passed::by_measured(equation.measured), |all, r| all.and(flight.passed_by(r)));
        let mut output = flight.measured(equation.measured, passed);
        if equation.scale.constant() != Some(1.0) {
            let scale = flight.scale(equation, passed)?;
            let inverse = scale.iter().map(|s| 1.0 / s).collect();
            output.multiply(Signal { values: inverse, terms: Vec::new() });
        }
        let mut columns = Vec::new();
        let mut fixed = Vec::new();
        for (k, regressor) in equation.regressors.iter().enumerate() {
            let name = if regressor.name == "1" { "0".to_owned() } else { regressor.name.clone() };
            let mut signal = flight.regressor(&equation.name, regressor, passed)?;
            if let Some((_, value)) = equation.fixed.iter().find(|(which, _)| *which == k) {
                output.values.iter_mut().zip(&signal.values).for_each(|(y, x)| *y -= value * x);
                scale_terms(&mut signal.terms, &vec![-value; signal.values.len()]);
                output.terms.extend(signal.terms);
                fixed.push(Fixed { name, value: *value });
            } else {
                columns.push((Named { name, inputs: flight.inputs_that_drive(regressor) }, signal));
            }
        }
        let bands = Bands {
            translation_hz: flight.motion.translation_bandwidth_hz,
            rotation_hz: flight.motion.rotation_bandwidth_hz,
            passed_hz: flight.bandwidths_hz(passed).collect(),
        };
        let scale_std = flight.scale_std(equation.measured);
        Ok(Self { name: equation.name.clone(), output, columns, fixed, scale_std, bands })
    }

    fn finish(&self, flight: &Flight<'_>, usable: &[bool], extra_hz: Option<f64>) -> Output {
        let pass = |values: &[f64]| match extra_hz {
            Some(hz) => lowpass_at(&flight.t_s, values, hz),
            None => values.to_vec(),
        };
        let mut bands = self.bands.clone();
        bands.passed_hz.extend(extra_hz);
        let columns = self.columns.iter().map(|(_, s)| s.terms.as_slice());
        let terms: Vec<&[Term]> = columns.chain([self.output.terms.as_slice()]).collect();
        let used: Vec<usize> = (0..usable.len()).filter(|row| usable[*row]).collect();
        let errors = SignalErrors::new(&bands, &terms, |source| {
            let by_row = flight.variances(source);
            let usual = median(used.iter().map(|row| by_row[*row]).collect()).unwrap_or(0.0);
            SourceVariance { by_row, usual }
        });
        let column = |(j, (named, signal)): (usize, &(Named, Signal))| {
            let sum: f64 = used.iter().map(|row| errors.variance(*row, j)).sum();
            let std = (sum / used.len().max(1) as f64).sqrt();
            let Named { name, inputs } = named;
            Column { name: name.clone(), inputs: inputs.clone(), values: pass(&signal.values), std }
        };
        Output {
            name: self.name.clone(),
            values: pass(&self.output.values),
            columns: self.columns.iter().enumerate().map(column).collect(),
            once: start_errors(flight, &terms),
            errors,
            fixed: self.fixed.clone(),
            scale_std: self.scale_std,
            bandwidth_hz: bands.passed_hz.iter().copied().fold(f64::INFINITY, f64::min),
        }
    }

    /// The output behind the low-pass of [`Bandwidth::Automatic`]: of steps of a fourth of an octave, down to
    /// where the window's margin is one period.
    fn best(&self, flight: &Flight<'_>, rows: &[usize], table: &CoefficientTable) -> Output {
        let lowest_hz = 1.0 / (table.window_s.0 - table.t_s[0]);
        let whole = self.finish(flight, &table.usable, None);
        let independent = whole.dependence(&whole.regressors_at(rows)).independent;
        let measure =
            |output: &Output| log_variance(output, &independent, rows, table).unwrap_or(f64::INFINITY);
        // One candidate is held at a time; the one that is chosen is formed again.
        let mut candidates_hz = vec![None];
        let mut measures = vec![measure(&whole)];
        let widest_hz = whole.bandwidth_hz;
        drop(whole);
        let mut hz = widest_hz.min(0.5 / table.sample_interval_s);
        while hz >= lowest_hz {
            candidates_hz.push(Some(hz));
            measures.push(measure(&self.finish(flight, &table.usable, Some(hz))));
            hz *= 0.5_f64.powf(0.25);
        }
        let least = measures.iter().copied().fold(f64::INFINITY, f64::min);
        let degrees = 2.0 * widest_hz * (table.window_s.1 - table.window_s.0);
        let known_to = 1.0 + (2.0 * degrees.max(1.0)).sqrt().recip();
        let enough = least + 2.0 * independent.len() as f64 * known_to.ln();
        let chosen = measures.iter().rposition(|m| *m <= enough).unwrap_or(0);
        self.finish(flight, &table.usable, candidates_hz[chosen])
    }
}

/// What an error of the pose at the first time does to states that follow the motion, which are integrated
/// from there: it fades with the state's time.
fn start_errors(flight: &Flight<'_>, signals: &[&[Term]]) -> Vec<DMatrix<f64>> {
    let mut out = Vec::new();
    let slowest_s = signals.iter().flat_map(|terms| terms.iter()).filter_map(|t| match t.transfer {
        Transfer::Washout { time_s } => Some(time_s),
        Transfer::Derivative(_) => None,
    });
    // Behind so many times of the slowest state less than 1e-13 of it is left.
    let gone_s = flight.t_s[0] + 30.0 * slowest_s.fold(0.0, f64::max);
    let rows = flight.t_s.partition_point(|t_s| *t_s <= gone_s);
    for source in Source::all() {
        let std = flight.start_std(source);
        let mut effect = DMatrix::zeros(rows, signals.len());
        for (j, terms) in signals.iter().enumerate() {
            for term in terms.iter().filter(|t| t.source == source) {
                let Transfer::Washout { time_s } = term.transfer else { continue };
                for (row, t_s) in flight.t_s[..rows].iter().enumerate() {
                    let fading = (-(t_s - flight.t_s[0]) / time_s).exp();
                    effect[(row, j)] -= std * term.gains[row] * fading;
                }
            }
        }
        if effect.iter().any(|e| *e != 0.0) {
            out.push(effect);
        }
    }
    out
}

/// Logarithm of the determinant of the least-squares covariance of independent columns, for coloured
/// residuals.
fn log_variance(
    output: &Output,
    independent: &[usize],
    rows: &[usize],
    table: &CoefficientTable,
) -> Option<f64> {
    let x = output.columns_at(independent, rows);
    let how = Correlation::Rows(table.correlated_rows(output.bandwidth_hz, rows.len()));
    let fit = least_squares(&x, &output.values_at(rows), how).ok()?;
    let errors = table.residual_errors(output, independent, &fit.values, rows);
    let known = coloured(&x, &fit.inverse_gram, &fit.residuals, &errors);
    log_determinant(&known.map_or(fit.covariance, |c| c.covariance))
}
