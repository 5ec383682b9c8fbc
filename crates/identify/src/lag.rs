//! How much later than the inputs' clock says the motion follows them.

mod far;

pub use far::far_lag;

use crate::coloured::coloured;
use crate::dependence::independent_columns;
use crate::model::{Equations, states_of};
use crate::regressors::coefficients_of;
use crate::{Bandwidth, CoefficientTable, Correlation, IdentifyError, Options, least_squares};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_model::regression::{RegressionEquation, Regressor};
use mavsight_pose::Motion;
use nalgebra::{DMatrix, DVector};

/// The lag of the motion behind the inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// To be added to the inputs' times; positive where the motion shows them later than they say.
    pub lag_s: f64,
    /// Standard deviation.
    pub std_s: f64,
}

impl Lag {
    /// Whether it is more than three standard deviations from nothing, which chance exceeds once in 370
    /// flights.
    pub fn significant(&self) -> bool {
        self.lag_s.abs() > 3.0 * self.std_s
    }
}

/// What a flight shows of the clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Clocks {
    /// The lag that was found.
    Lag(Lag),
    /// The lag is beyond so many seconds: one there explains the motion clearly better ([`far_lag`]).
    Beyond(f64),
    /// The inputs move too little to determine it.
    Undetermined,
    /// The lag was given.
    Known(f64),
}

impl Clocks {
    /// What is to be added to the inputs' times: a lag that was given, or one that is significant.
    pub fn correction_s(&self) -> f64 {
        match self {
            Self::Lag(lag) if lag.significant() => lag.lag_s,
            Self::Known(lag_s) => *lag_s,
            _ => 0.0,
        }
    }

    /// What a user must know of it; nothing where the clocks agree.
    pub fn words(&self) -> Option<String> {
        match self {
            Self::Lag(lag) if lag.significant() => {
                let (size_ms, std_ms) = (1e3 * lag.lag_s.abs(), 1e3 * lag.std_s);
                let side = if lag.lag_s > 0.0 { "later" } else { "earlier" };
                Some(format!(
                    "The clocks differ: the motion shows the inputs {size_ms:.1} ± {std_ms:.1} ms {side} than their time \
                     stamps say, and they were moved by as much. An actuator that is slower than the model says looks like a later \
                     clock: if the clocks are known to agree, give --lag 0."
                ))
            }
            Self::Beyond(reach_s) => Some(format!(
                "The clocks differ by more than the {reach_s:.2} s that were searched, and nothing was moved: \
                 check that inputs and motion are of the same flight, or give --lag."
            )),
            Self::Undetermined => Some(
                "The inputs move too little to determine their clock against the motion's, or are of another flight: both clocks are \
                 taken as equal."
                    .to_owned(),
            ),
            _ => None,
        }
    }
}

/// Steps of Gauss-Newton at most; each gains digits, since the lag enters the residuals almost linearly.
const MAX_STEPS: usize = 12;

/// The inputs with `lag_s` added to their times, the first or last value held, at the mean interval,
/// for as long as that uncovers.
///
/// # Errors
/// A lag that is not finite.
pub fn delayed(inputs: &InputSeries, lag_s: f64) -> Result<InputSeries, IdentifyError> {
    if !lag_s.is_finite() {
        return Err(IdentifyError::BadSetting { what: "the lag", value: lag_s, must: "be a number" });
    }
    let given_s = inputs.times_s();
    let interval_s = (inputs.end_s() - inputs.start_s()) / (given_s.len() - 1) as f64;
    let uncovered = (lag_s.abs() / interval_s).ceil() as usize;
    let before = if lag_s > 0.0 { uncovered } else { 0 };
    // The place of each row from the first that was given, and of the given one whose values it has.
    let places = || {
        let all = (0..given_s.len() + uncovered).map(move |k| k as f64 - before as f64);
        all.map(|k| (k, (k.max(0.0) as usize).min(given_s.len() - 1)))
    };
    let t_s = |(k, of): (f64, usize)| given_s[of] + lag_s + (k - of as f64) * interval_s;
    let values = places().flat_map(|(_, of)| inputs.row(of)).copied().collect();
    Ok(InputSeries::new(inputs.names(), places().map(t_s).collect(), values)?)
}

/// Estimates the lag between the inputs' clock and the motion's, up to `reach_s` either way, from what the
/// inputs leave in the outputs: the shift of least residuals, by one more column of each regression, the
/// derivative of its residuals by the shift. Outputs are weighed by their variances; where they disagree by
/// more, the standard deviation grows by the root of chi-square over its degrees of freedom (Birge 1932).
///
/// An input's own column beside that of a state that it drives, as a swash-plate's beside that of a disc, is
/// left out: the rate of the state is a sum of both and the body's rate, so that the two columns together
/// imitate a lag.
///
/// Valid for a model that holds: a time constant that is longer than the vehicle file says looks like a lag.
///
/// # Errors
/// Those of [`crate::coefficients`].
pub fn estimate_lag(
    motion: &Motion,
    inputs: &InputSeries,
    vehicle: &Vehicle,
    options: &Options,
    reach_s: f64,
) -> Result<Clocks, IdentifyError> {
    let search = LagSearch::new(motion, inputs, vehicle, options)?;
    // Where inputs move little, residuals are least at an end of the search by chance.
    let beyond = || match far_lag(motion, inputs, vehicle, options, reach_s) {
        Ok(Some(_)) => Clocks::Beyond(reach_s),
        // Where the search further out is refused, nothing shows that clocks differ either.
        Ok(None) | Err(_) => Clocks::Undetermined,
    };
    let mut lag_s = match search.coarse(reach_s)? {
        Coarse::Inside(lag_s) => lag_s,
        Coarse::End => return Ok(beyond()),
        Coarse::Flat => return Ok(Clocks::Undetermined),
    };
    let step_s = 0.02 / search.bandwidth_hz;
    for _ in 0..MAX_STEPS {
        let Some(Lag { lag_s: step, std_s }) = search.step(lag_s, step_s)? else { break };
        lag_s += step;
        if lag_s.is_nan() {
            break;
        }
        if lag_s.abs() > reach_s {
            return Ok(beyond());
        }
        if step.abs() < 1e-3 * std_s || step.abs() < 1e-9 {
            return Ok(Clocks::Lag(Lag { lag_s, std_s }));
        }
    }
    Ok(Clocks::Undetermined)
}

/// Where on a grid of shifts the residuals are least.
enum Coarse {
    Inside(f64),
    End,
    /// Everywhere alike, as far as the residuals' scatter shows.
    Flat,
}

/// Twice the logarithm of the likelihood that a shift must gain to count: the 99.9 % quantile of chi-square
/// with one degree of freedom.
const DISTINCT: f64 = 10.83;

struct LagSearch<'a> {
    motion: &'a Motion,
    inputs: &'a InputSeries,
    vehicle: &'a Vehicle,
    equations: Vec<Equation>,
    bandwidth_hz: f64,
}

/// An output that is fitted, behind the widest of all outputs' low-passes.
struct Equation {
    equations: Equations,
    options: Options,
    independent: Vec<usize>,
}

/// An equation under a lag, in the rows of its window.
struct Lagged {
    table: CoefficientTable,
    rows: Vec<usize>,
    x: DMatrix<f64>,
    y: DVector<f64>,
}

impl<'a> LagSearch<'a> {
    fn new(
        motion: &'a Motion,
        inputs: &'a InputSeries,
        vehicle: &'a Vehicle,
        options: &Options,
    ) -> Result<Self, IdentifyError> {
        let mut search = Self { motion, inputs, vehicle, equations: Vec::new(), bandwidth_hz: 0.0 };
        let all = Equations::new(vehicle, inputs, options.equations.as_ref())?;
        for equation in &all.regression.equations {
            let mut own = all.clone();
            own.regression.equations = vec![equation.clone()];
            let table = coefficients_of(motion, inputs, vehicle, &own, options)?;
            let Some(output) = table.outputs.first() else { continue };
            let bandwidth_hz = output.bandwidth_hz.min(0.5 / table.sample_interval_s);
            search.bandwidth_hz = search.bandwidth_hz.max(bandwidth_hz);
            leave_out_imitators(&mut own);
            let (options, independent) = (options.clone(), Vec::new());
            search.equations.push(Equation { equations: own, options, independent });
        }
        // Those that can be fitted: their rows are the same under every lag.
        for mut equation in std::mem::take(&mut search.equations) {
            equation.options.bandwidth = Bandwidth::Hz(search.bandwidth_hz);
            let table = coefficients_of(motion, inputs, vehicle, &equation.equations, &equation.options)?;
            let (output, rows) = (&table.outputs[0], table.rows_in_window());
            equation.independent = output.dependence(&output.regressors_at(&rows)).independent;
            let count = equation.independent.len();
            if count > 0 && rows.len() > count + 1 {
                search.equations.push(equation);
            }
        }
        Ok(search)
    }

    fn lagged(&self, equation: &Equation, lag_s: f64) -> Result<Lagged, IdentifyError> {
        let inputs = delayed(self.inputs, lag_s)?;
        let own = &equation.equations;
        let table = coefficients_of(self.motion, &inputs, self.vehicle, own, &equation.options)?;
        let rows = table.rows_in_window();
        let x = table.outputs[0].columns_at(&equation.independent, &rows);
        let y = table.outputs[0].values_at(&rows);
        Ok(Lagged { table, rows, x, y })
    }

    /// Steps of a grid of a quarter of a period of the low-pass.
    fn grid_steps(&self, reach_s: f64) -> i32 {
        (4.0 * self.bandwidth_hz * reach_s).ceil().clamp(2.0, 200.0) as i32
    }

    /// The shift of least residuals on a grid.
    fn coarse(&self, reach_s: f64) -> Result<Coarse, IdentifyError> {
        let count = self.grid_steps(reach_s);
        let shift_s = |k: i32| reach_s * f64::from(k) / f64::from(count);
        let (mut best, mut most) = ((f64::INFINITY, 0), f64::NEG_INFINITY);
        for k in -count..=count {
            let sum = self.scatter(shift_s(k))?;
            most = most.max(sum);
            if sum < best.0 {
                best = (sum, k);
            }
        }
        if most - best.0 < DISTINCT {
            return Ok(Coarse::Flat);
        }
        Ok(if best.1.abs() < count { Coarse::Inside(shift_s(best.1)) } else { Coarse::End })
    }

    /// Σ n ln(RSS), with n the number of rows that are not correlated.
    fn scatter(&self, lag_s: f64) -> Result<f64, IdentifyError> {
        self.weighted_scatter(lag_s, |rows, _| rows)
    }

    /// Σ w ln(RSS), with weights of the numbers of uncorrelated rows and of coefficients.
    fn weighted_scatter(&self, lag_s: f64, weight: fn(f64, usize) -> f64) -> Result<f64, IdentifyError> {
        let mut sum = 0.0;
        for equation in &self.equations {
            let at = self.lagged(equation, lag_s)?;
            let squares = least_squares(&at.x, &at.y, Correlation::White)?.residuals.norm_squared();
            let rows = at.rows.len() as f64 / at.correlated_rows() as f64;
            sum += weight(rows, equation.independent.len()) * squares.max(f64::MIN_POSITIVE).ln();
        }
        Ok(sum)
    }

    /// The step from a lag to where every output's residuals are least, with its standard deviation.
    fn step(&self, lag_s: f64, by_s: f64) -> Result<Option<Lag>, IdentifyError> {
        let mut steps = Vec::new();
        for equation in &self.equations {
            steps.extend(self.step_of(equation, lag_s, by_s)?);
        }
        Ok(together(&steps))
    }

    /// The step of one output: the coefficient of the residuals' slope beside the regressors.
    fn step_of(&self, equation: &Equation, lag_s: f64, by_s: f64) -> Result<Option<Lag>, IdentifyError> {
        let at = self.lagged(equation, lag_s)?;
        let fit = least_squares(&at.x, &at.y, Correlation::White)?;
        let left = |lag_s: f64| self.lagged(equation, lag_s).map(|s| s.y - s.x * &fit.values);
        let slope = (left(lag_s - by_s)? - left(lag_s + by_s)?) / (2.0 * by_s);
        let count = at.x.ncols();
        let mut x = at.x.clone().insert_column(count, 0.0);
        x.set_column(count, &slope);
        if !independent_columns(&x, &vec![0.0; count + 1]).independent.contains(&count) {
            return Ok(None);
        }
        let Ok(slope) = least_squares(&x, &fit.residuals, Correlation::Rows(at.correlated_rows())) else {
            return Ok(None);
        };
        let output = &at.table.outputs[0];
        let errors = at.table.residual_errors(output, &equation.independent, &fit.values, &at.rows);
        let known = coloured(&x, &slope.inverse_gram, &slope.residuals, &errors);
        let covariance = known.map_or(slope.covariance, |c| c.covariance);
        let std_s = covariance[(count, count)].max(0.0).sqrt();
        Ok((std_s > 0.0 && std_s.is_finite()).then_some(Lag { lag_s: slope.values[count], std_s }))
    }
}

impl Lagged {
    fn correlated_rows(&self) -> usize {
        self.table.correlated_rows(self.table.outputs[0].bandwidth_hz, self.rows.len())
    }
}

/// Leaves out the columns that a lag could hide in; the output is fitted whatever a shift does to it.
fn leave_out_imitators(equations: &mut Equations) {
    let mut own = std::mem::take(&mut equations.regression.equations);
    for equation in &mut own {
        equation.where_excited = false;
        let driving = equations.inputs_of_states(equation.regressors.iter().flat_map(states_of).collect());
        let imitates = |r: &Regressor| {
            let inputs = r.inputs.iter().flat_map(|signal| signal.inputs());
            let mut inputs = inputs.peekable();
            let holds = r.motion.is_empty() && r.inputs.iter().all(|signal| signal.states().is_empty());
            holds && inputs.peek().is_some() && inputs.all(|k| driving.contains(k))
        };
        let is_fixed = |k: usize, equation: &RegressionEquation| equation.fixed.iter().any(|f| f.0 == k);
        for k in (0..equation.regressors.len()).rev() {
            if !is_fixed(k, equation) && imitates(&equation.regressors[k]) {
                equation.regressors.remove(k);
                equation.fixed.iter_mut().filter(|f| f.0 > k).for_each(|f| f.0 -= 1);
            }
        }
    }
    equations.regression.equations = own;
}

/// The mean by inverse variances.
fn together(steps: &[Lag]) -> Option<Lag> {
    let weight: f64 = steps.iter().map(|s| s.std_s.powi(-2)).sum();
    if weight <= 0.0 {
        return None;
    }
    let lag_s = steps.iter().map(|s| s.lag_s * s.std_s.powi(-2)).sum::<f64>() / weight;
    let chi_square: f64 = steps.iter().map(|s| ((s.lag_s - lag_s) / s.std_s).powi(2)).sum();
    let disagreement = (chi_square / (steps.len().max(2) - 1) as f64).max(1.0).sqrt();
    Some(Lag { lag_s, std_s: disagreement / weight.sqrt() })
}
