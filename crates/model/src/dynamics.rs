//! The equations of motion of one aircraft, ready to be integrated, with exact derivatives.

use crate::graph::{Graph, Node, Variable};
use crate::model::Model;
use crate::program::{Program, Registers};

/// The equations of motion of a model with the values of one aircraft.
///
/// Fixed parameters are numbers in them; free ones may change from evaluation to evaluation.
#[derive(Debug, Clone, PartialEq)]
pub struct Dynamics {
    free: Vec<usize>,
    states: usize,
    rates: Program,
    linear: Program,
    /// Where the derivatives behind the rates in `linear` belong: row, column.
    by_state: Vec<(usize, usize)>,
    by_parameter: Vec<(usize, usize)>,
    is_linear: Vec<bool>,
}

/// A derivative of the rate of a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// The state whose rate it is of.
    pub row: usize,
    /// The state, or the free parameter, by which.
    pub column: usize,
    /// Its value.
    pub value: f64,
}

/// Numbers of an evaluation on the way, for given free parameters.
#[derive(Debug, Clone)]
pub struct Evaluation<'a> {
    dynamics: &'a Dynamics,
    rates: Registers,
    linear: Registers,
}

impl Dynamics {
    /// The equations of motion with `values` for all parameters, of which those in `free` may change.
    pub fn new(model: &Model, values: &[f64], free: &[usize]) -> Self {
        let states = model.state_count();
        let replace = |variable: Variable, graph: &mut Graph| match variable {
            Variable::Parameter(k) => match free.iter().position(|f| *f == k) {
                Some(place) => graph.variable(Variable::Parameter(place)),
                None => graph.constant(values[k]),
            },
            other => graph.variable(other),
        };
        let (mut graph, rates) = model.graph.substituted(&model.nodes.rates, replace);
        let mut outputs = rates.clone();
        let slopes = |graph: &mut Graph, outputs: &mut Vec<Node>, variables: &[Variable]| {
            let zero = graph.constant(0.0);
            let mut places = Vec::new();
            for (column, variable) in variables.iter().enumerate() {
                let slopes = graph.derivatives(&rates, *variable);
                for (row, slope) in slopes.into_iter().enumerate().filter(|(_, slope)| *slope != zero) {
                    places.push((row, column));
                    outputs.push(slope);
                }
            }
            places
        };
        let of_state: Vec<Variable> = (0..states).map(Variable::State).collect();
        let of_parameter: Vec<Variable> = (0..free.len()).map(Variable::Parameter).collect();
        let by_state = slopes(&mut graph, &mut outputs, &of_state);
        let by_parameter = slopes(&mut graph, &mut outputs, &of_parameter);
        let is_linear = of_parameter.iter().map(|own| is_linear_in(&mut graph, &rates, *own)).collect();
        Self {
            free: free.to_vec(),
            states,
            rates: Program::new(&graph, &rates),
            linear: Program::new(&graph, &outputs),
            by_state,
            by_parameter,
            is_linear,
        }
    }

    /// The parameters that may change, by their places in the model.
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.states
    }

    /// Whether the rates are linear in a free parameter.
    pub fn is_linear_in(&self, free: usize) -> bool {
        self.is_linear[free]
    }

    /// Begins an evaluation with values of the free parameters; inputs must be set before a state.
    pub fn with(&self, free: &[f64]) -> Evaluation<'_> {
        Evaluation {
            dynamics: self,
            rates: self.rates.with_parameters(free),
            linear: self.linear.with_parameters(free),
        }
    }
}

/// Whether the derivative by a variable does not depend on it.
fn is_linear_in(graph: &mut Graph, rates: &[Node], variable: Variable) -> bool {
    let slopes = graph.derivatives(rates, variable);
    !graph.variables(&slopes).contains(&variable)
}

impl Evaluation<'_> {
    /// Sets the inputs.
    pub fn set_inputs(&mut self, inputs: &[f64]) {
        self.dynamics.rates.set_inputs(inputs, &mut self.rates);
        self.dynamics.linear.set_inputs(inputs, &mut self.linear);
    }

    /// The time derivative of a state.
    pub fn rates(&mut self, state: &[f64], out: &mut [f64]) {
        self.dynamics.rates.set_state(state, &mut self.rates);
        for (out, value) in out.iter_mut().zip(self.dynamics.rates.outputs(&self.rates)) {
            *out = value;
        }
    }

    /// The time derivative of a state together with its derivatives, which [`Evaluation::by_state`] and
    /// [`Evaluation::by_parameter`] then list.
    pub fn linearise(&mut self, state: &[f64], out: &mut [f64]) {
        self.dynamics.linear.set_state(state, &mut self.linear);
        for (k, out) in out.iter_mut().enumerate() {
            *out = self.dynamics.linear.output(k, &self.linear);
        }
    }

    fn slopes<'a>(&'a self, from: usize, places: &'a [(usize, usize)]) -> impl Iterator<Item = Slope> + 'a {
        let value =
            move |k: usize| self.dynamics.linear.output(self.dynamics.states + from + k, &self.linear);
        places.iter().enumerate().map(move |(k, (row, column))| Slope {
            row: *row,
            column: *column,
            value: value(k),
        })
    }

    /// Derivatives of the rates by the states, those that are zero for every state left out.
    pub fn by_state(&self) -> impl Iterator<Item = Slope> {
        self.slopes(0, &self.dynamics.by_state)
    }

    /// Derivatives of the rates by the free parameters.
    pub fn by_parameter(&self) -> impl Iterator<Item = Slope> {
        self.slopes(self.dynamics.by_state.len(), &self.dynamics.by_parameter)
    }
}
