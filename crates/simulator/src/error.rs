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
    /// A scenario that cannot be flown.
    #[error("scenario: {what}")]
    Scenario {
        /// What is wrong and what to do.
        what: String,
    },
    /// The integrator failed.
    #[error("the simulation broke down at {t_s:.3} s ({detail}): check inertia, flapping times and inputs")]
    Integration {
        /// Time reached.
        t_s: f64,
        /// The integrator's message.
        detail: String,
    },
}

impl SimulatorError {
    pub(crate) fn scenario(what: impl Into<String>) -> Self {
        Self::Scenario { what: what.into() }
    }
}
