//! The equations of motion of one aircraft, ready to be integrated, with exact derivatives.

use crate::graph::{Graph, Node, Variable};
use crate::model::Model;
use crate::program::{Program, Registers};

/// The equations of motion of a model with the values of one aircraft, and its sensors where asked for.
///
/// Fixed parameters are numbers in them; free ones may change from evaluation to evaluation.
#[derive(Debug, Clone, PartialEq)]
pub struct Dynamics {
    free: Vec<usize>,
    states: usize,
    rates: Program,
    linear: Linear,
    sensors: Option<Linear>,
    is_linear: Vec<bool>,
}

/// Expressions together with their derivatives.
#[derive(Debug, Clone, PartialEq)]
struct Linear {
    program: Program,
    /// Number of expressions; their derivatives are behind them.
    count: usize,
    /// Where the derivatives belong: row, column.
    by_state: Vec<(usize, usize)>,
    by_input: Vec<(usize, usize)>,
    by_parameter: Vec<(usize, usize)>,
    /// For each free parameter.
    is_linear: Vec<bool>,
}

/// What is worked out beside the rates and their derivatives by states and parameters.
#[derive(Debug, Clone, Copy, Default)]
struct Extent {
    input_slopes: bool,
    sensors: bool,
}

/// Numbers of variables by which derivatives are taken.
#[derive(Debug, Clone, Copy)]
struct Variables {
    states: usize,
    inputs: usize,
    parameters: usize,
}

/// A derivative of the rate of a state, or of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// The state whose rate it is of, or the sensor.
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
    sensors: Option<Registers>,
}

impl Linear {
    fn new(graph: &mut Graph, expressions: &[Node], by: Variables) -> Self {
        let mut outputs = expressions.to_vec();
        let zero = graph.constant(0.0);
        let mut slopes = |variable: fn(usize) -> Variable, count: usize| {
            let mut places = Vec::new();
            for column in 0..count {
                let slopes = graph.derivatives(expressions, variable(column));
                for (row, slope) in slopes.into_iter().enumerate().filter(|(_, slope)| *slope != zero) {
                    places.push((row, column));
                    outputs.push(slope);
                }
            }
            places
        };
        let by_state = slopes(Variable::State, by.states);
        let by_input = slopes(Variable::Input, by.inputs);
        let by_parameter = slopes(Variable::Parameter, by.parameters);
        let of_parameters = by_parameter.iter().zip(&outputs[outputs.len() - by_parameter.len()..]);
        let is_linear = |k: usize| {
            let own: Vec<Node> = of_parameters
                .clone()
                .filter(|((_, column), _)| *column == k)
                .map(|(_, slope)| *slope)
                .collect();
            !graph.variables(&own).contains(&Variable::Parameter(k))
        };
        let is_linear = (0..by.parameters).map(is_linear).collect();
        let program = Program::new(graph, &outputs);
        Self { program, count: expressions.len(), by_state, by_input, by_parameter, is_linear }
    }

    fn values(&self, state: &[f64], registers: &mut Registers, out: &mut [f64]) {
        self.program.set_state(state, registers);
        for (k, out) in out.iter_mut().enumerate().take(self.count) {
            *out = self.program.output(k, registers);
        }
    }

    fn slopes<'a>(
        &'a self,
        registers: &'a Registers,
        before: usize,
        places: &'a [(usize, usize)],
    ) -> impl Iterator<Item = Slope> + 'a {
        let value = move |k: usize| self.program.output(self.count + before + k, registers);
        places.iter().enumerate().map(move |(k, (row, column))| Slope {
            row: *row,
            column: *column,
            value: value(k),
        })
    }

    fn by_state<'a>(&'a self, registers: &'a Registers) -> impl Iterator<Item = Slope> + 'a {
        self.slopes(registers, 0, &self.by_state)
    }

    fn by_input<'a>(&'a self, registers: &'a Registers) -> impl Iterator<Item = Slope> + 'a {
        self.slopes(registers, self.by_state.len(), &self.by_input)
    }

    fn by_parameter<'a>(&'a self, registers: &'a Registers) -> impl Iterator<Item = Slope> + 'a {
        self.slopes(registers, self.by_state.len() + self.by_input.len(), &self.by_parameter)
    }
}

impl Dynamics {
    /// The equations of motion with `values` for all parameters, of which those in `free` may change.
    pub fn new(model: &Model, values: &[f64], free: &[usize]) -> Self {
        Self::build(model, values, free, Extent::default())
    }

    /// The same with the sensors, and with derivatives of the rates by the inputs too.
    pub fn with_all_slopes(model: &Model, values: &[f64], free: &[usize]) -> Self {
        Self::build(model, values, free, Extent { input_slopes: true, sensors: true })
    }

    /// The same as [`Dynamics::new`] with the model's sensors, which then [`Evaluation::sense`] works out.
    pub fn with_sensors(model: &Model, values: &[f64], free: &[usize]) -> Self {
        Self::build(model, values, free, Extent { sensors: true, ..Extent::default() })
    }

    fn build(model: &Model, values: &[f64], free: &[usize], extent: Extent) -> Self {
        let replace = |variable: Variable, graph: &mut Graph| match variable {
            Variable::Parameter(k) => match free.iter().position(|f| *f == k) {
                Some(place) => graph.variable(Variable::Parameter(place)),
                None => graph.constant(values[k]),
            },
            other => graph.variable(other),
        };
        let own = if extent.sensors { &model.nodes.sensors[..] } else { &[] };
        let (mut graph, all) = model.graph.substituted(&[&model.nodes.rates[..], own].concat(), replace);
        let (rates, own) = all.split_at(model.nodes.rates.len());
        let inputs = if extent.input_slopes { model.inputs.len() } else { 0 };
        let by = Variables { states: model.state_count(), inputs, parameters: free.len() };
        let linear = Linear::new(&mut graph, rates, by);
        let by = Variables { inputs: model.inputs.len(), ..by };
        let sensors = extent.sensors.then(|| Linear::new(&mut graph, own, by));
        let mut is_linear = linear.is_linear.clone();
        if let Some(of_sensors) = &sensors {
            is_linear.iter_mut().zip(&of_sensors.is_linear).for_each(|(all, own)| *all &= own);
        }
        let rates = Program::new(&graph, rates);
        Self { free: free.to_vec(), states: by.states, rates, linear, sensors, is_linear }
    }

    /// The parameters that may change, by their places in the model.
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.states
    }

    /// Whether the rates, and the sensors where there are some, are linear in a free parameter.
    pub fn is_linear_in(&self, free: usize) -> bool {
        self.is_linear[free]
    }

    /// Begins an evaluation with values of the free parameters; inputs must be set before a state.
    pub fn with(&self, free: &[f64]) -> Evaluation<'_> {
        Evaluation {
            dynamics: self,
            rates: self.rates.with_parameters(free),
            linear: self.linear.program.with_parameters(free),
            sensors: self.sensors.as_ref().map(|s| s.program.with_parameters(free)),
        }
    }
}

impl Evaluation<'_> {
    /// Sets the inputs.
    pub fn set_inputs(&mut self, inputs: &[f64]) {
        self.dynamics.rates.set_inputs(inputs, &mut self.rates);
        self.dynamics.linear.program.set_inputs(inputs, &mut self.linear);
        if let Some((sensors, registers)) = self.dynamics.sensors.as_ref().zip(self.sensors.as_mut()) {
            sensors.program.set_inputs(inputs, registers);
        }
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
        self.dynamics.linear.values(state, &mut self.linear, out);
    }

    /// Derivatives of the rates by the states, those that are zero for every state left out.
    pub fn by_state(&self) -> impl Iterator<Item = Slope> {
        self.dynamics.linear.by_state(&self.linear)
    }

    /// Derivatives of the rates by the free parameters.
    pub fn by_parameter(&self) -> impl Iterator<Item = Slope> {
        self.dynamics.linear.by_parameter(&self.linear)
    }

    /// Derivatives of the rates by the inputs, where [`Dynamics::with_all_slopes`] has made them.
    pub fn by_input(&self) -> impl Iterator<Item = Slope> {
        self.dynamics.linear.by_input(&self.linear)
    }

    /// What each sensor of the model shows at a state, in the order of the model, together with its
    /// derivatives, which [`Evaluation::sensors_by_state`], [`Evaluation::sensors_by_parameter`] and
    /// [`Evaluation::sensors_by_input`] then list; nothing without [`Dynamics::with_sensors`].
    pub fn sense(&mut self, state: &[f64], out: &mut [f64]) {
        if let Some((sensors, registers)) = self.dynamics.sensors.as_ref().zip(self.sensors.as_mut()) {
            sensors.values(state, registers, out);
        }
    }

    fn sensors(&self) -> Option<(&Linear, &Registers)> {
        self.dynamics.sensors.as_ref().zip(self.sensors.as_ref())
    }

    /// Derivatives of the sensors by the states.
    pub fn sensors_by_state(&self) -> impl Iterator<Item = Slope> {
        self.sensors().into_iter().flat_map(|(sensors, registers)| sensors.by_state(registers))
    }

    /// Derivatives of the sensors by the free parameters.
    pub fn sensors_by_parameter(&self) -> impl Iterator<Item = Slope> {
        self.sensors().into_iter().flat_map(|(sensors, registers)| sensors.by_parameter(registers))
    }

    /// Derivatives of the sensors by the inputs.
    pub fn sensors_by_input(&self) -> impl Iterator<Item = Slope> {
        self.sensors().into_iter().flat_map(|(sensors, registers)| sensors.by_input(registers))
    }
}
