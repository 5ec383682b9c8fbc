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
        what: String,
        /// Its value.
        value: f64,
    },
    /// A start with another number of states than the model has.
    #[error(
        "the start of the flight has {given} states beside those of the rigid body, but the model {model} has {needed}: begin with Scenario::start or InitialState::at_rest of this vehicle"
    )]
    FurtherStates {
        /// Name of the model.
        model: String,
        /// How many are given.
        given: usize,
        /// How many there are.
        needed: usize,
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
    /// A manoeuvre of an input that the model does not have.
    #[error("scenario: the model {model} has no input {name}; {}", offered(.near, .inputs))]
    UnknownInput {
        /// Name in the scenario.
        name: String,
        /// Name of the model.
        model: String,
        /// Inputs with the nearest names.
        near: Vec<String>,
        /// All inputs of the model.
        inputs: Vec<String>,
    },
    /// An input beyond what the model allows.
    #[error(
        "scenario: {input} is {value:.4} at {t_s:.3} s, but the model allows {min} to {max}: make the manoeuvre smaller"
    )]
    InputRange {
        /// Name of the input.
        input: String,
        /// Time.
        t_s: f64,
        /// Its value.
        value: f64,
        /// Least value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// An aircraft that the pilot cannot fly.
    #[error(
        "the pilot flies a coaxial helicopter with the inputs {needed}, but the model {model} has no {missing}: film another aircraft on a scenario instead"
    )]
    Pilot {
        /// Name of the model.
        model: String,
        /// The inputs that the pilot moves.
        needed: String,
        /// The first of them that is missing.
        missing: String,
    },
    /// What a scenario needs and has not.
    #[error("scenario: {0}")]
    Scenario(&'static str),
    /// The integrator failed.
    #[error(
        "the simulation broke down at {t_s:.3} s ({detail}): check inertia, time constants far below a millisecond, and inputs"
    )]
    Integration {
        /// Time reached.
        t_s: f64,
        /// The integrator's message.
        detail: String,
    },
}

fn offered(near: &[String], all: &[String]) -> String {
    match (near, all) {
        ([], []) => "it has none".to_owned(),
        ([], all) => format!("it has {}", all.join(", ")),
        (near, _) => format!("did you mean {}?", near.join(" or ")),
    }
}
