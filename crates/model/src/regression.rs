//! The equations of a model in the form that a regression needs: every regressor a product of signals that
//! are known before the fit.
//!
//! Such a signal is one of the inputs; or linear in velocity, rates and further states. A further state is
//! one if it is of first order: what it does between two instants then has a closed form.

mod named;
mod reduce;

pub use named::{NamedEquation, PowerProduct};

use crate::graph::Node;
use crate::graph::{Graph, Variable};
use crate::model::{Axis, Model};
use crate::program::Program;
use crate::rigid_body::RIGID_STATES;
use reduce::Reduction;
use thiserror::Error;

/// Motion factors of a regressor, at most.
const MOST_FACTORS: usize = 8;

/// An equation that is no regression.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RegressionError {
    /// A name that is no signal.
    #[error("equation {equation} names the signal {signal:?}, which does not exist: use one of {known}")]
    UnknownSignal {
        /// Equation.
        equation: String,
        /// What was written.
        signal: String,
        /// Those that there are.
        known: String,
    },
    /// A regressor that is no product of known signals.
    #[error(
        "the regressor {regressor:?} of equation {equation} {reason}: write it as a product of inputs, u v w p q r and states of first order, or fit the model by output error, which can have it"
    )]
    Regressor {
        /// Equation.
        equation: String,
        /// Its text.
        regressor: String,
        /// Why.
        reason: String,
    },
    /// A state that is not of first order.
    #[error(
        "equation {equation} needs the state {state}, which {reason}: leave out {regressor:?}, or fit the model by output error, which can have it"
    )]
    State {
        /// Equation.
        equation: String,
        /// Regressor that needs it, or `scale`.
        regressor: String,
        /// State.
        state: String,
        /// Why.
        reason: String,
    },
    /// A scale that needs what the model does not have.
    #[error(
        "the scale of equation {equation} needs {name}, which the model {model} does not have: write scale = \"si\", or a file of schema 2 with an expression of its own"
    )]
    Scale {
        /// Equation.
        equation: String,
        /// What is needed.
        name: String,
        /// Model.
        model: String,
    },
}

/// A signal of inputs, and of further states that inputs alone drive.
#[derive(Debug, Clone, PartialEq)]
pub struct InputSignal {
    program: Program,
    inputs: Vec<usize>,
    states: Vec<usize>,
}

impl InputSignal {
    fn new(graph: &Graph, node: Node) -> Self {
        // States are counted from the first further one.
        let (graph, nodes) = graph.substituted(&[node], |variable, graph| match variable {
            Variable::State(k) => graph.variable(Variable::State(k.saturating_sub(RIGID_STATES))),
            other => graph.variable(other),
        });
        let variables = graph.variables(&nodes);
        let input = |v: &Variable| if let Variable::Input(k) = v { Some(*k) } else { None };
        let state = |v: &Variable| if let Variable::State(k) = v { Some(*k) } else { None };
        Self {
            program: Program::new(&graph, &nodes),
            inputs: variables.iter().filter_map(input).collect(),
            states: variables.iter().filter_map(state).collect(),
        }
    }

    /// The inputs that it needs.
    pub fn inputs(&self) -> &[usize] {
        &self.inputs
    }

    /// The further states that it needs, each driven by inputs alone. A signal without any holds from one
    /// row of the inputs to the next, as these do.
    pub fn states(&self) -> &[usize] {
        &self.states
    }

    /// The value, where it depends on nothing.
    pub fn constant(&self) -> Option<f64> {
        let alone = self.inputs.is_empty() && self.states.is_empty();
        alone.then(|| self.program.output(0, &self.program.with_parameters(&[])))
    }

    /// Values at some rows, each of all inputs and of all further states.
    pub fn series<'a>(&self, rows: impl Iterator<Item = InputRow<'a>>) -> Vec<f64> {
        let mut registers = self.program.with_parameters(&[]);
        let value = |row: InputRow<'a>| {
            self.program.set_inputs(row.inputs, &mut registers);
            self.program.set_state(row.states, &mut registers);
            self.program.output(0, &registers)
        };
        rows.map(value).collect()
    }
}

/// Inputs and further states at one time, in the model's order; what a signal does not need may be anything.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputRow<'a> {
    /// Inputs.
    pub inputs: &'a [f64],
    /// States beyond the rigid body's.
    pub states: &'a [f64],
}

/// A further state x of first order: x' = -x/τ + a·(u, v, w) + b·(p, q, r) + f, with f of the inputs and of
/// other states that inputs alone drive.
#[derive(Debug, Clone, PartialEq)]
pub struct StateResponse {
    /// Its place among the further states.
    pub state: usize,
    /// Name.
    pub name: String,
    /// τ.
    pub time_s: f64,
    /// a.
    pub velocity: [f64; 3],
    /// b.
    pub rates: [f64; 3],
    /// f.
    pub forcing: InputSignal,
    /// x at the first row of the inputs.
    pub initial: InputSignal,
}

impl StateResponse {
    /// Whether inputs alone drive it.
    pub fn is_of_inputs(&self) -> bool {
        self.velocity == [0.0; 3] && self.rates == [0.0; 3]
    }
}

/// A signal that is linear in motion: the sum of constants times velocity, rates and further states, and of
/// a signal of the inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSignal {
    /// Factors of u, v, w.
    pub velocity: [f64; 3],
    /// Factors of p, q, r.
    pub rates: [f64; 3],
    /// Further states that the motion drives, and their factors.
    pub states: Vec<StateTerm>,
    /// The rest; none where there is none.
    pub inputs: Option<InputSignal>,
}

/// A further state in a sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateTerm {
    /// Place among the further states.
    pub state: usize,
    /// Factor.
    pub factor: f64,
}

/// A regressor: the product of all its signals.
#[derive(Debug, Clone, PartialEq)]
pub struct Regressor {
    /// Its text.
    pub name: String,
    /// Signals of inputs: at most one that holds between rows, and one that does not.
    pub inputs: Vec<InputSignal>,
    /// Signals of the motion.
    pub motion: Vec<MotionSignal>,
}

/// An equation, measured / scale = Σ coefficient · regressor.
#[derive(Debug, Clone, PartialEq)]
pub struct RegressionEquation {
    /// Name.
    pub name: String,
    /// What is measured.
    pub measured: Axis,
    /// What it is divided by.
    pub scale: InputSignal,
    /// Regressors.
    pub regressors: Vec<Regressor>,
    /// Coefficients that are known, by regressor.
    pub fixed: Vec<(usize, f64)>,
    /// Whether it is fitted only where the flight moves it.
    pub where_excited: bool,
}

/// All equations of a model for the values of one aircraft, and the further states that they need.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Regression {
    /// States of first order, each behind those that drive it.
    pub states: Vec<StateResponse>,
    /// Equations.
    pub equations: Vec<RegressionEquation>,
}

impl Regression {
    /// The inputs that the equations need, in the model's order.
    pub fn inputs(&self) -> Vec<usize> {
        let of_states = self.states.iter().flat_map(|s| [&s.forcing, &s.initial]);
        let of_equations = self.equations.iter().flat_map(|e| {
            let regressors = e.regressors.iter().flat_map(|r| {
                let motion = r.motion.iter().filter_map(|m| m.inputs.as_ref());
                r.inputs.iter().chain(motion)
            });
            std::iter::once(&e.scale).chain(regressors)
        });
        let mut out: Vec<usize> =
            of_states.chain(of_equations).flat_map(|signal| signal.inputs.iter().copied()).collect();
        out.sort_unstable();
        out.dedup();
        out
    }
}

impl Model {
    /// The model's equations for regression, with `values` for all parameters ([`Model::values`]).
    ///
    /// # Errors
    /// A regressor that is no product of signals of inputs and of signals linear in velocity, rates and
    /// further states of first order; a scale that needs motion.
    pub fn regression(&self, values: &[f64]) -> Result<Regression, RegressionError> {
        let mut reduction = Reduction::new(self, values);
        let equations = (0..self.equations.len()).map(|k| reduction.equation(k)).collect::<Result<_, _>>()?;
        Ok(Regression { states: reduction.used_states(), equations })
    }
}

#[cfg(test)]
mod tests;
