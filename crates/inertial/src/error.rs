//! What is refused, and what to do about it.

use thiserror::Error;

/// Why a log cannot be aligned with poses.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum InertialError {
    /// A table of the gyroscope whose times and rates differ in number, or which is too short.
    #[error("{times} times and {rates} rates of a gyroscope: give one rate for each of two or more times")]
    Table {
        /// Times given.
        times: usize,
        /// Rates given.
        rates: usize,
    },
    /// Times that do not increase.
    #[error(
        "the gyroscope's time {t_s:.6} s follows {before_s:.6} s in row {row}: sort the rows, and leave out repeated ones"
    )]
    Time {
        /// Row, from 1.
        row: usize,
        /// Its time.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// A rate that is no number.
    #[error("the gyroscope's rate at {t_s:.6} s is not finite: leave the row out")]
    NotFinite {
        /// When.
        t_s: f64,
    },
    /// Too few poses that follow each other, or too little of them within the log.
    #[error(
        "{found} pairs of poses that follow each other lie within the log, which is too little ({least} are needed): give the log of this flight"
    )]
    TooFewPoses {
        /// Pairs found.
        found: usize,
        /// Pairs needed.
        least: usize,
    },
    /// Turns too small to show when they happened, or alike at two times.
    #[error(
        "the aircraft turns by {turn_rms_rad_s:.3} rad/s (root mean square), which shows no one place of the log: clocks apart by {first_s:.3} s \
         and by {second_s:.3} s explain it alike (correlations {first:.2} and {second:.2}); before or after the flight turn the aircraft by \
         hand, irregularly, by 20 degrees and more about two axes for some seconds in view of the cameras"
    )]
    TooQuiet {
        /// Root mean square rate by the poses.
        turn_rms_rad_s: f64,
        /// Time of the log less that of the poses, best place.
        first_s: f64,
        /// Second best.
        second_s: f64,
        /// Correlation there.
        first: f64,
        /// And there.
        second: f64,
    },
    /// Rates in degrees a second.
    #[error(
        "the gyroscope's rates are in degrees a second: divided by 57.3 they agree with the turns of the poses (correlation {correlation:.2}), as \
         they are they do not; give them in rad/s"
    )]
    Degrees {
        /// The correlation of the rates in rad/s.
        correlation: f64,
    },
    /// Turns that do not agree anywhere, where the log has no second place to compare with.
    #[error(
        "the turns of the log and of the poses agree by a correlation of {correlation:.2}, which is chance: is this the log of the flight?"
    )]
    NoAgreement {
        /// The largest correlation.
        correlation: f64,
    },
    /// A log that is longer than can be searched, which a wrong time makes of any.
    #[error(
        "the gyroscope's times span {span_s:.0} s, and {most_s:.0} s are searched at most: look for a wrong time, or cut the log to the flight"
    )]
    TooLong {
        /// From the first to the last sample.
        span_s: f64,
        /// What is searched at most.
        most_s: f64,
    },
    /// A fit that does not end.
    #[error(
        "the log's clock could not be fitted: after {steps} steps it still moves by {step_ms:.3} ms; is the log of this flight, and are its rates in rad/s?"
    )]
    NotConverged {
        /// Steps taken.
        steps: usize,
        /// Last step of the offset.
        step_ms: f64,
    },
}
