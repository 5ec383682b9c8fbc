//! What identification refuses, and what to do about it.

use thiserror::Error;

/// A fit without a determined answer.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum IdentifyError {
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
    /// Inputs that do not cover the flight, or vehicle constants that make no sense.
    #[error(transparent)]
    Flight(#[from] mavsight_flight::FlightError),
    /// Flapping cannot be integrated over times without rates.
    #[error(
        "the motion has nothing between {from_s:.3} s and {to_s:.3} s, over which flapping cannot be integrated: give poses with an empty row for each instant that was not measured, or fit the parts one by one"
    )]
    GapInMotion {
        /// From.
        from_s: f64,
        /// To.
        to_s: f64,
    },
    /// Rotors that stand still make the coefficients infinite.
    #[error(
        "the mean rotor speed at {t_s:.3} s is {omega_rad_s:.1} rad/s: coefficients need turning rotors; fit a window in flight"
    )]
    RotorsStopped {
        /// Time.
        t_s: f64,
        /// Mean speed.
        omega_rad_s: f64,
    },
    /// Tables of different lengths or with numbers that are not finite.
    #[error("{what}: every column must have {rows} finite values")]
    BadColumn {
        /// The column.
        what: String,
        /// Rows expected.
        rows: usize,
    },
    /// An error covariance that is none.
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
    #[error("the model file: {detail}")]
    ModelFile {
        /// What is wrong with it.
        detail: String,
    },
    /// A regressor that names no signal.
    #[error(
        "output {output} names the signal {signal:?}, which there is not; there are {known}, and each further column of numbers in the inputs"
    )]
    UnknownSignal {
        /// Output.
        output: String,
        /// What was written.
        signal: String,
        /// Those that there are.
        known: String,
    },
    /// No column carries anything.
    #[error("the regressors have rank zero: nothing was excited; fly a manoeuvre")]
    RankZero,
    /// The total least-squares solution does not exist.
    #[error(
        "total least squares has no solution here (the smallest singular vector has no part in the output, {part:.1e}): use least squares, or a manoeuvre that excites the regressors"
    )]
    NonGeneric {
        /// Share of the output in the vector.
        part: f64,
    },
}
