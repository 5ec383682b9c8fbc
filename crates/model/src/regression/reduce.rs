//! Which parts of a regressor are signals of inputs, and which are linear in motion.

use super::{
    InputSignal, MOST_FACTORS, MotionSignal, RegressionEquation, RegressionError, Regressor, StateResponse,
    StateTerm,
};
use crate::graph::{Graph, Node, Operation, Variable};
use crate::model::Model;
use crate::rigid_body::RIGID_STATES;
use std::ops::Range;

/// Products within products, at most.
const DEEPEST: usize = 200;
const VELOCITY: Range<usize> = 7..10;
const RATES: Range<usize> = 10..13;
/// Both.
const MOTION: Range<usize> = 7..13;
const NAMES: [&str; RIGID_STATES] = [
    "x",
    "y",
    "z",
    "the attitude",
    "the attitude",
    "the attitude",
    "the attitude",
    "u",
    "v",
    "w",
    "p",
    "q",
    "r",
];

/// A further state as a signal, or why it is none.
type Reduced = Result<StateResponse, String>;

/// Equations of a model in which parameters are numbers.
pub(super) struct Reduction<'a> {
    model: &'a Model,
    graph: Graph,
    scales: Vec<Node>,
    regressors: Vec<Vec<Node>>,
    states: Vec<Reduced>,
    /// Those of the states that are of first order, each behind those that drive it.
    order: Vec<usize>,
    /// Which states the equations need.
    used: Vec<bool>,
}

/// Factors of a regressor.
#[derive(Default)]
struct Factors {
    held: Vec<Node>,
    following: Vec<Node>,
    motion: Vec<Node>,
}

impl<'a> Reduction<'a> {
    pub(super) fn new(model: &'a Model, values: &[f64]) -> Self {
        let nodes = &model.nodes;
        let count = model.states.len();
        let mut all: Vec<Node> = nodes.rates.iter().skip(RIGID_STATES).copied().collect();
        all.extend(&nodes.initial);
        all.extend(&nodes.scales);
        all.extend(nodes.regressors.iter().flatten());
        let (graph, copies) = model.graph.substituted(&all, |variable, graph| match variable {
            Variable::Parameter(k) => graph.constant(values[k]),
            other => graph.variable(other),
        });
        let (rates, rest) = copies.split_at(count);
        let (initial, rest) = rest.split_at(count);
        let (scales, mut rest) = rest.split_at(nodes.scales.len());
        let mut regressors = Vec::new();
        for own in &nodes.regressors {
            let (first, after) = rest.split_at(own.len());
            regressors.push(first.to_vec());
            rest = after;
        }
        let scales = scales.to_vec();
        let states = vec![Err(String::new()); count];
        let (order, used) = (Vec::new(), vec![false; count]);
        let mut out = Self { model, graph, scales, regressors, states, order, used };
        out.reduce_states(rates, initial);
        out
    }

    /// States that inputs alone drive may drive others, so that a pass may find more than the one before.
    fn reduce_states(&mut self, rates: &[Node], initial: &[Node]) {
        let mut found = usize::MAX;
        while found != self.order.len() {
            found = self.order.len();
            for k in 0..rates.len() {
                if self.states[k].is_err() {
                    self.states[k] = self.reduce_state(k, rates[k], initial[k]);
                    if self.states[k].is_ok() {
                        self.order.push(k);
                    }
                }
            }
        }
    }

    fn reduce_state(&mut self, k: usize, rate: Node, initial: Node) -> Reduced {
        let own = Variable::State(RIGID_STATES + k);
        let slope = self.constant_slope(rate, own).filter(|a| *a < 0.0);
        let slope = slope.ok_or("does not fall back in proportion to itself, by a constant factor")?;
        let (velocity, rates) = (self.factors_of(rate, VELOCITY)?, self.factors_of(rate, RATES)?);
        let zero = self.graph.constant(0.0);
        let forcing = self.replaced(rate, |v| {
            let is_moving = v == own || matches!(v, Variable::State(k) if MOTION.contains(&k));
            is_moving.then_some(zero)
        });
        let foreign = self.graph.variables(&[forcing]).into_iter().find(|v| !self.is_of_inputs(*v));
        if let Some(foreign) = foreign {
            return Err(format!("depends on {}", self.name_of(foreign)));
        }
        Ok(StateResponse {
            state: k,
            name: self.model.states[k].name.clone(),
            time_s: -1.0 / slope,
            velocity,
            rates,
            forcing: InputSignal::new(&self.graph, forcing),
            initial: InputSignal::new(&self.graph, initial),
        })
    }

    /// The factors of velocity or rates in a rate of a state.
    fn factors_of(&mut self, rate: Node, states: Range<usize>) -> Result<[f64; 3], String> {
        let mut out = [0.0; 3];
        for (factor, by) in out.iter_mut().zip(states) {
            let constant = self.constant_slope(rate, Variable::State(by));
            *factor =
                constant.ok_or_else(|| format!("does not follow {} by a constant factor", NAMES[by]))?;
        }
        Ok(out)
    }

    fn name_of(&self, variable: Variable) -> String {
        match variable {
            Variable::State(k) if k < RIGID_STATES => NAMES[k].to_owned(),
            Variable::State(k) => format!("the state {}", self.model.states[k - RIGID_STATES].name),
            Variable::Input(k) => self.model.inputs[k].name.clone(),
            Variable::Parameter(k) => self.model.parameters[k].name.clone(),
        }
    }

    /// Whether a variable is an input, or a state that inputs alone drive.
    fn is_of_inputs(&self, variable: Variable) -> bool {
        match variable {
            Variable::State(k) if k < RIGID_STATES => false,
            Variable::State(k) => {
                self.states[k - RIGID_STATES].as_ref().is_ok_and(StateResponse::is_of_inputs)
            }
            Variable::Input(_) | Variable::Parameter(_) => true,
        }
    }

    fn constant_slope(&mut self, node: Node, by: Variable) -> Option<f64> {
        let slope = self.graph.derivatives(&[node], by)[0];
        self.graph.constant_value(slope)
    }

    /// The node with others in the place of some variables.
    fn replaced(&mut self, node: Node, with: impl Fn(Variable) -> Option<Node>) -> Node {
        let reached = self.graph.reached(&[node]);
        let mut copies: Vec<Node> = (0..reached.len()).map(|k| self.graph.node(k)).collect();
        for k in (0..reached.len()).filter(|k| reached[*k]) {
            let own = self.graph.node(k);
            copies[k] = match self.graph.operation(own) {
                Operation::Variable(variable) => with(variable).unwrap_or(own),
                other => self.graph.again(other, |operand| copies[operand.index()]),
            };
        }
        copies[node.index()]
    }

    pub(super) fn equation(&mut self, k: usize) -> Result<RegressionEquation, RegressionError> {
        let equation = &self.model.equations[k];
        let mut regressors = Vec::with_capacity(equation.regressors.len());
        for (j, text) in equation.regressors.iter().enumerate() {
            regressors.push(self.regressor(&equation.name, text, self.regressors[k][j])?);
        }
        Ok(RegressionEquation {
            name: equation.name.clone(),
            measured: equation.measured,
            scale: self.scale(&equation.name, self.scales[k])?,
            regressors,
            fixed: equation.fixed.clone(),
            where_excited: equation.where_excited,
        })
    }

    fn scale(&mut self, equation: &str, node: Node) -> Result<InputSignal, RegressionError> {
        let foreign = self.graph.variables(&[node]).into_iter().find(|v| !self.is_of_inputs(*v));
        match foreign {
            Some(foreign) => Err(RegressionError::Regressor {
                equation: equation.to_owned(),
                regressor: "scale".to_owned(),
                reason: format!("depends on {}", self.name_of(foreign)),
            }),
            None => Ok(self.input_signal(node)),
        }
    }

    fn input_signal(&mut self, node: Node) -> InputSignal {
        let signal = InputSignal::new(&self.graph, node);
        signal.states.iter().for_each(|state| self.uses(*state));
        signal
    }

    /// Marks a state, and those that drive it, as needed.
    fn uses(&mut self, state: usize) {
        if std::mem::replace(&mut self.used[state], true) {
            return;
        }
        let drivers = self.states[state].as_ref().map(|s| s.forcing.states.clone()).unwrap_or_default();
        drivers.into_iter().for_each(|state| self.uses(state));
    }

    pub(super) fn used_states(&self) -> Vec<StateResponse> {
        let used = self.order.iter().filter(|k| self.used[**k]);
        used.filter_map(|k| self.states[*k].clone().ok()).collect()
    }

    fn regressor(&mut self, equation: &str, text: &str, node: Node) -> Result<Regressor, RegressionError> {
        let refused = |reason: String| RegressionError::Regressor {
            equation: equation.to_owned(),
            regressor: text.to_owned(),
            reason,
        };
        for variable in self.graph.variables(&[node]) {
            let Variable::State(k) = variable else { continue };
            if k < VELOCITY.start {
                return Err(refused(format!("depends on {}", NAMES[k])));
            }
            let further = k.checked_sub(RIGID_STATES).map(|k| (k, self.states[k].clone()));
            if let Some((k, Err(reason))) = further {
                return Err(RegressionError::State {
                    equation: equation.to_owned(),
                    regressor: text.to_owned(),
                    state: self.model.states[k].name.clone(),
                    reason,
                });
            }
        }
        let mut factors = Factors::default();
        self.split(node, &mut factors, 0).map_err(refused)?;
        let mut out = Regressor { name: text.to_owned(), inputs: Vec::new(), motion: Vec::new() };
        for own in [&factors.held, &factors.following] {
            let one = self.graph.constant(1.0);
            let product = own.iter().fold(one, |product, node| self.graph.multiply(product, *node));
            if product != one {
                out.inputs.push(self.input_signal(product));
            }
        }
        for node in factors.motion {
            out.motion.push(self.motion_signal(node).map_err(refused)?);
        }
        Ok(out)
    }

    fn split(&mut self, node: Node, out: &mut Factors, depth: usize) -> Result<(), String> {
        if depth > DEEPEST {
            return Err(format!("is a product of more than {DEEPEST} parts"));
        }
        let depth = depth + 1;
        let variables = self.graph.variables(&[node]);
        if variables.iter().all(|v| self.is_of_inputs(*v)) {
            let follows = variables.iter().any(|v| matches!(v, Variable::State(_)));
            if follows {
                out.following.push(node)
            } else {
                out.held.push(node)
            }
            return Ok(());
        }
        match self.graph.operation(node) {
            Operation::Multiply(a, b) => {
                self.split(a, out, depth)?;
                self.split(b, out, depth)?;
            }
            Operation::IntegerPower(a, n @ 2..) if n as usize <= MOST_FACTORS => {
                (0..n).try_for_each(|_| self.split(a, out, depth))?;
            }
            Operation::Subtract(a, b) if self.graph.constant_value(a) == Some(0.0) => {
                let minus = self.graph.constant(-1.0);
                out.held.push(minus);
                self.split(b, out, depth)?;
            }
            _ => out.motion.push(node),
        }
        if out.motion.len() > MOST_FACTORS {
            return Err(format!("is a product of more than {MOST_FACTORS} signals of the motion"));
        }
        Ok(())
    }

    fn motion_signal(&mut self, node: Node) -> Result<MotionSignal, String> {
        let mut out = MotionSignal { velocity: [0.0; 3], rates: [0.0; 3], states: Vec::new(), inputs: None };
        let variables = self.graph.variables(&[node]);
        let moving: Vec<Variable> = variables.into_iter().filter(|v| !self.is_of_inputs(*v)).collect();
        for variable in &moving {
            let Variable::State(k) = *variable else { continue };
            let factor = self.constant_slope(node, *variable).ok_or_else(|| {
                format!("is not linear in {} with a constant factor", self.name_of(*variable))
            })?;
            if VELOCITY.contains(&k) {
                out.velocity[k - VELOCITY.start] = factor;
            } else if RATES.contains(&k) {
                out.rates[k - RATES.start] = factor;
            } else {
                let state = k - RIGID_STATES;
                out.states.push(StateTerm { state, factor });
                self.uses(state);
            }
        }
        let zero = self.graph.constant(0.0);
        let rest = self.replaced(node, |v| moving.contains(&v).then_some(zero));
        if rest != zero {
            out.inputs = Some(self.input_signal(rest));
        }
        Ok(out)
    }
}
