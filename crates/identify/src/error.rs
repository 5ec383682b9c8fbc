//! What identification refuses, and what to do about it.

use thiserror::Error;

/// A fit without a determined answer.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum IdentifyError {
    /// A planned flight whose states and measurements are not of the same instants.
    #[error("{states} states of a planned flight for {instants} instants of measurement: give one for each")]
    PlannedStates {
        /// States given.
        states: usize,
        /// Instants.
        instants: usize,
    },
    /// Systematic errors of a planned flight that are not those of its instants.
    #[error(
        "systematic errors are given for {found} of {instants} instants of a planned flight, with {directions} directions at the \
         first and up to {most} at others: give each instant the same number of them"
    )]
    PlannedSystematic {
        /// Instants with systematic errors.
        found: usize,
        /// Instants.
        instants: usize,
        /// Directions at the first.
        directions: usize,
        /// The most directions.
        most: usize,
    },
    /// Fewer instants than parameters.
    #[error(
        "{found} instants are not enough to fit {parameters} parameters: fly for longer, or widen the window"
    )]
    TooFewInstants {
        /// Instants in the window.
        found: usize,
        /// Parameters of the model.
        parameters: usize,
    },
    /// Inputs that do not cover the flight, vehicle constants that make no sense, or a flight model that has
    /// no value or is too fast at its start.
    #[error(transparent)]
    Flight(#[from] mavsight_flight::FlightError),
    /// A state that follows the motion cannot be integrated over times without it.
    #[error(
        "the motion has nothing between {from_s:.3} s and {to_s:.3} s, over which {state} cannot be integrated: give poses with an empty row for each instant that was not measured, or fit the parts one by one"
    )]
    GapInMotion {
        /// The state.
        state: String,
        /// From.
        from_s: f64,
        /// To.
        to_s: f64,
    },
    /// Nothing to regress.
    #[error(
        "the model {0} has no equations for regression: add [[equation]] sections to its file, or give a file that has some"
    )]
    NoEquations(String),
    /// Equations that are no regression.
    #[error(transparent)]
    Regression(#[from] mavsight_model::regression::RegressionError),
    /// A signal without a value.
    #[error(
        "{regressor:?} of equation {equation} is {value} under the inputs at {t_s:.3} s: change the expression, or fit a window in flight"
    )]
    SignalNotFinite {
        /// Equation.
        equation: String,
        /// Regressor, or `scale`.
        regressor: String,
        /// Time of the inputs.
        t_s: f64,
        /// Its value.
        value: f64,
    },
    /// A scale that makes the coefficients infinite, as that of rotors that stand still.
    #[error(
        "the scale of equation {equation} at {t_s:.3} s is {value:.3e}, but must be above zero: coefficients need rotors or air that move; fit a window in flight"
    )]
    ScaleNotPositive {
        /// Equation.
        equation: String,
        /// Time.
        t_s: f64,
        /// Its value.
        value: f64,
    },
    /// Tables of different lengths or with numbers that are not finite.
    #[error("{what}: every column must have {rows} finite values")]
    BadColumn {
        /// The column.
        what: String,
        /// Rows expected.
        rows: usize,
    },
    /// An error covariance that is not valid.
    #[error("the error covariance of {columns} regressors and the output {what}")]
    BadErrors {
        /// What it must be.
        what: &'static str,
        /// Regressors.
        columns: usize,
    },
    /// Steps that do not end.
    #[error(
        "{what} has not converged in {steps} steps: the data hardly determine the answer; use fewer regressors"
    )]
    NotConverged {
        /// The estimator.
        what: &'static str,
        /// Steps taken.
        steps: usize,
    },
    /// A setting outside its range.
    #[error("{what} is {value}, but must {must}")]
    BadSetting {
        /// The setting.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A band without a frequency that the samples can show.
    #[error(
        "no band of frequencies: {low_hz} to {high_hz} Hz; it must rise and lie between 0 and {nyquist_hz:.2} Hz, half the sampling rate"
    )]
    BadBand {
        /// From.
        low_hz: f64,
        /// To.
        high_hz: f64,
        /// Half the sampling rate.
        nyquist_hz: f64,
    },
    /// A model file that cannot be read.
    #[error("the model file: {0}")]
    ModelFile(String),
    /// No column carries anything.
    #[error("the regressors have rank zero: nothing was excited; fly a manoeuvre")]
    RankZero,
    /// The total least-squares solution does not exist, by the share of the output in the vector.
    #[error(
        "total least squares has no solution here (the smallest singular vector has no part in the output, {0:.1e}): use least squares, or a manoeuvre that excites the regressors"
    )]
    NonGeneric(f64),
    /// A name that the model does not have.
    #[error("the model has no parameter {name:?}: use one of {known}")]
    UnknownParameter {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A value of a parameter that it cannot have.
    #[error("{name} is {value}, but must {must}")]
    BadParameter {
        /// The parameter.
        name: String,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// Times of measurements must increase.
    #[error(
        "the measurement at {t_s} s does not come after the one at {before_s} s: sort them and remove repeats"
    )]
    MeasurementTimes {
        /// Time.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// A measurement that cannot be weighed.
    #[error(
        "the {what} at {t_s:.3} s is not usable: it needs a time after the one before, finite numbers, a positive definite covariance, and a known camera and marker"
    )]
    BadMeasurement {
        /// Time.
        t_s: f64,
        /// Which part.
        what: &'static str,
    },
    /// A sensor whose expression has no value where the fit has gone.
    #[error(
        "the sensor {name} has no finite value at {t_s:.3} s of the flown motion: change its expression in [outputs], or start from other values"
    )]
    SensorNotFinite {
        /// The sensor.
        name: String,
        /// Time.
        t_s: f64,
    },
    /// Too few instants with a pose to start from.
    #[error("{0} instants have a pose, but at least 4 are needed to start: measure more of the flight")]
    NoStart(usize),
    /// A trajectory that is not finite in a segment, by the segment's first time.
    #[error("the trajectory from {0:.3} s on diverges: start from other values")]
    RanAway(f64),
    /// Nothing to be estimated.
    #[error("no parameter is free: name at least one")]
    NothingFree,
    /// Parameters that the flight does not distinguish.
    #[error("the flight does not determine {}: {combination}; {}", names.join(", "), to_determine(names))]
    NotDetermined {
        /// The parameters.
        names: Vec<String>,
        /// Which change of them leaves every measurement as it is.
        combination: String,
    },
    /// The iteration stopped early.
    #[error(
        "the fit has not converged after {iterations} iterations{} (the next step would lower the weighted squares of {squares:.4e} by {promise:.1e}{}): {}fix parameters or give them a prior_std, or start from other values. Its best values so far, which no interval covers: {}", too_long(*.too_long_s), loose(.at_bounds, .moving), more_time(*.too_long_s), values(.so_far)
    )]
    FitNotConverged {
        /// Iterations.
        iterations: usize,
        /// The time that it took, if that was all that it was given.
        too_long_s: Option<f64>,
        /// The free parameters with the values of the least squares so far.
        so_far: Vec<(String, f64)>,
        /// Weighted squares reached.
        squares: f64,
        /// Predicted decrease by the next step.
        promise: f64,
        /// Parameters that lie at a bound of theirs.
        at_bounds: Vec<String>,
        /// Parameters that the next step would move most, by a tenth of their size or more.
        moving: Vec<String>,
    },
    /// A marker that no camera can see at the fitted pose, or a camera that cannot be differentiated.
    #[error(transparent)]
    Geometry(#[from] mavsight_geometry::GeometryError),
}

/// What to do about parameters that a flight does not determine.
fn to_determine(names: &[String]) -> &'static str {
    match names {
        [_] => "fix it at a known value, or fly a manoeuvre that moves what it acts on",
        _ => "fix one of them, or fly a manoeuvre that moves them by themselves",
    }
}

fn too_long(seconds: Option<f64>) -> String {
    seconds.map_or_else(String::new, |s| format!(" and the {s} s that it was given"))
}

fn more_time(seconds: Option<f64>) -> &'static str {
    if seconds.is_some() { "give it more time, " } else { "" }
}

fn values(of: &[(String, f64)]) -> String {
    of.iter().map(|(name, value)| format!("{name} {value:.3e}")).collect::<Vec<_>>().join(", ")
}

fn loose(at_bounds: &[String], moving: &[String]) -> String {
    let part = |names: &[String], before: &str, behind: &str| match names {
        [] => String::new(),
        names => format!("; {before}{}{behind}", names.join(", ")),
    };
    part(at_bounds, "", " at their bounds") + &part(moving, "it would still move ", "")
}
