//! What the simulator refuses, and what to do about it.

use mavsight_flight::FlightError;
use thiserror::Error;

/// A scenario that cannot be flown, or a flight that breaks down.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SimulatorError {
    /// The vehicle or its inputs.
    #[error(transparent)]
    Flight(#[from] FlightError),
    /// A start that is not finite.
    #[error("{what} at the start of the flight is {value}: give a finite number")]
    StartNotFinite {
        /// Part of the state.
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
    /// A number of a scenario that must be above zero.
    #[error("scenario: {key} is {value}, but must be above zero")]
    NotPositive {
        /// Key in the scenario file.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// A manoeuvre, as the scenario has it, without a length or with a number that is not finite.
    #[error("scenario: {0} needs finite numbers and a length above zero")]
    Maneuver(String),
    /// What a scenario needs and has not.
    #[error("scenario: {0}")]
    Scenario(&'static str),
    /// The integrator failed.
    #[error("the simulation broke down at {t_s:.3} s ({detail}): check inertia, flapping times and inputs")]
    Integration {
        /// Time reached.
        t_s: f64,
        /// The integrator's message.
        detail: String,
    },
}
