//! The equations of motion of one aircraft, ready to be integrated, with exact derivatives.

use crate::graph::{Graph, Variable};
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
    by_input: Vec<(usize, usize)>,
    is_linear: Vec<bool>,
}

/// A derivative of the rate of a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// The state whose rate it is of.
    pub row: usize,
    /// The state, the free parameter or the input by which.
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
        Self::with_slopes(model, values, free, 0)
    }

    /// The same with derivatives by the inputs too.
    pub fn with_input_slopes(model: &Model, values: &[f64], free: &[usize]) -> Self {
        Self::with_slopes(model, values, free, model.inputs.len())
    }

    fn with_slopes(model: &Model, values: &[f64], free: &[usize], inputs: usize) -> Self {
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
        let mut is_linear = Vec::new();
        let mut slopes = |variables: &mut dyn Iterator<Item = Variable>,
                          mut is_linear: Option<&mut Vec<bool>>| {
            let zero = graph.constant(0.0);
            let mut places = Vec::new();
            for (column, variable) in variables.enumerate() {
                let slopes = graph.derivatives(&rates, variable);
                if let Some(is_linear) = &mut is_linear {
                    is_linear.push(!graph.variables(&slopes).contains(&variable));
                }
                for (row, slope) in slopes.into_iter().enumerate().filter(|(_, slope)| *slope != zero) {
                    places.push((row, column));
                    outputs.push(slope);
                }
            }
            places
        };
        let by_state = slopes(&mut (0..states).map(Variable::State), None);
        let by_input = slopes(&mut (0..inputs).map(Variable::Input), None);
        let by_parameter = slopes(&mut (0..free.len()).map(Variable::Parameter), Some(&mut is_linear));
        Self {
            free: free.to_vec(),
            states,
            rates: Program::new(&graph, &rates),
            linear: Program::new(&graph, &outputs),
            by_state,
            by_parameter,
            by_input,
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
        let before = self.dynamics.by_state.len() + self.dynamics.by_input.len();
        self.slopes(before, &self.dynamics.by_parameter)
    }

    /// Derivatives of the rates by the inputs, where [`Dynamics::with_input_slopes`] has made them.
    pub fn by_input(&self) -> impl Iterator<Item = Slope> {
        self.slopes(self.dynamics.by_state.len(), &self.dynamics.by_input)
    }
}
