//! What flight refuses, and what to do about it.

use thiserror::Error;

/// A vehicle, an input or a simulation that makes no sense.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FlightError {
    /// A constant that must be positive.
    #[error("{key} is {value}, but must be a finite number above zero: correct the vehicle file")]
    NotPositive {
        /// Key in the vehicle file.
        key: String,
        /// Its value.
        value: f64,
    },
    /// A constant that must be a number.
    #[error("{key} is {value}, but must be a finite number: correct the vehicle file")]
    NotFinite {
        /// Key in the vehicle file.
        key: String,
        /// Its value.
        value: f64,
    },
    /// A pose needs three markers.
    #[error(
        "the vehicle has {found} markers, but at least 3 that are not on one line are needed: add [[marker]] sections"
    )]
    TooFewMarkers {
        /// Markers given.
        found: usize,
    },
    /// Two markers share a name or a colour.
    #[error("markers {first} and {second} share the {what} {value}: give each its own")]
    DuplicateMarker {
        /// Marker name.
        first: String,
        /// Marker name.
        second: String,
        /// "name" or "color".
        what: &'static str,
        /// The shared value.
        value: String,
    },
    /// A colour that is not written as one.
    #[error("unknown colour {text:?}: write it as \"#rrggbb\", for instance \"#db1212\"")]
    UnknownColor {
        /// What was written.
        text: String,
    },
    /// Inputs need two samples to cover a time.
    #[error("the inputs have {found} samples, but at least 2 are needed")]
    TooFewInputs {
        /// Samples given.
        found: usize,
    },
    /// A sample that is not a number.
    #[error("input row {row}: {column} is not a finite number: correct or remove the row")]
    InputNotFinite {
        /// Row, counted from 1 below the header.
        row: usize,
        /// Column.
        column: &'static str,
    },
    /// A channel that does not go with the samples.
    #[error("input {name}: there must be {samples} finite values, one a row")]
    BadChannel {
        /// Its name.
        name: String,
        /// Samples of the series.
        samples: usize,
    },
    /// Times must increase.
    #[error(
        "input row {row}: time {t_s} s does not come after the {before_s} s of the row before: sort the rows and remove repeats"
    )]
    TimeNotIncreasing {
        /// Row, counted from 1 below the header.
        row: usize,
        /// Its time.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// Inputs that end before the flight does.
    #[error(
        "the inputs cover {start_s:.3} to {end_s:.3} s, but the flight needs {t_s:.3} s: record the inputs over the whole flight"
    )]
    InputsDoNotCover {
        /// Time asked for.
        t_s: f64,
        /// First input.
        start_s: f64,
        /// Last input.
        end_s: f64,
    },
    /// A flight that begins nowhere.
    #[error("{what} at the start of the flight is {value}: give a finite number")]
    StartNotFinite {
        /// Which part of the state.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Output times must increase.
    #[error("output time {t_s} s does not come after {before_s} s")]
    OutputTimes {
        /// Time asked for.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// A scenario that cannot be flown.
    #[error("scenario: {what}")]
    Scenario {
        /// What is wrong and what to do.
        what: String,
    },
    /// The integrator gave up.
    #[error("the simulation broke down at {t_s:.3} s ({detail}): check inertia, flapping times and inputs")]
    Integration {
        /// Time reached.
        t_s: f64,
        /// The integrator's words.
        detail: String,
    },
}
