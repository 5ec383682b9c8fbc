//! Whether a model can begin: with the values of one aircraft, finite and not too fast.

use crate::dynamics::Dynamics;
use crate::fastest::Fastest;
use crate::fault::{Fault, ModelError};
use crate::graph::{Graph, Node, Variable};
use crate::model::{Freedom, Model};
use crate::program::Program;
use crate::rigid_body::RIGID_STATES;

/// Inputs and a state with which a flight begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Inputs.
    pub inputs: Vec<f64>,
    /// All states: position, quaternion, velocity, rates, further ones.
    pub state: Vec<f64>,
}

impl Model {
    /// Trim inputs, level, without velocity and rates, and the further states that these inputs give.
    pub fn at_rest(&self, values: &[f64]) -> Start {
        let inputs = self.trim(values);
        let mut state = vec![0.0; RIGID_STATES];
        state[3] = 1.0;
        state.extend(self.initial(values, &inputs));
        Start { inputs, state }
    }

    /// Refuses values of the parameters with which something is not finite at a start: a parameter, the trim,
    /// the initial value of a state, a force, a moment, the derivative of a state, or their derivatives by
    /// the states and by the parameters that may be free. A wing, which has no angle of attack at rest, needs
    /// a start in flight.
    ///
    /// # Errors
    /// [`Fault::NotFinite`] with what is not finite, at its place in the file.
    pub fn check(&self, values: &[f64], start: &Start) -> Result<(), ModelError> {
        self.check_numbers(values, &start.inputs)?;
        self.check_start(values, start)
    }

    /// Refuses a model that changes faster at a start than an integrator follows.
    ///
    /// # Errors
    /// [`Fault::TooFast`] with the state that changes most in the fastest motion, where its time constant is
    /// below `shortest_s`.
    pub fn check_speed(&self, values: &[f64], start: &Start, shortest_s: f64) -> Result<(), ModelError> {
        let dynamics = Dynamics::new(self, values, &[]);
        let mut evaluation = dynamics.with(&[]);
        evaluation.set_inputs(&start.inputs);
        let fastest = evaluation.fastest(&start.state);
        if fastest.time_s < shortest_s { Err(self.too_fast(fastest, shortest_s)) } else { Ok(()) }
    }

    /// The refusal of a motion that is faster than what can be integrated, at the place in the file of the
    /// force, moment or derivative that moves its state.
    pub fn too_fast(&self, fastest: Fastest, shortest_s: f64) -> ModelError {
        let (places, axis) = (&self.nodes.places, |k: usize| ["x", "y", "z"][k % 3]);
        let place = match fastest.state {
            k @ 7..=9 => places.loads.get(&format!("{} of [forces]", axis(k - 7))),
            k @ 10..=12 => places.loads.get(&format!("{} of [moments]", axis(k - 10))),
            k => k.checked_sub(RIGID_STATES).and_then(|own| places.states.get(own)),
        };
        let (what, time_s) = (self.state_name(fastest.state), fastest.time_s);
        self.fault(place.copied().unwrap_or(0), Fault::TooFast { what, time_s, shortest_s })
    }

    fn fault(&self, at: usize, fault: Fault) -> ModelError {
        ModelError::at(&self.file, &self.definition, at, fault)
    }

    /// The name of a state in messages.
    pub fn state_name(&self, state: usize) -> String {
        let rigid = ["x", "y", "z", "the attitude", "the attitude", "the attitude", "the attitude"];
        let rigid: Vec<&str> = rigid.into_iter().chain(["u", "v", "w", "p", "q", "r"]).collect();
        match (rigid.get(state), state.checked_sub(RIGID_STATES)) {
            (Some(name), _) => (*name).to_owned(),
            (None, own) => own.and_then(|k| self.states.get(k)).map_or_else(String::new, |s| s.name.clone()),
        }
    }

    fn check_numbers(&self, values: &[f64], inputs: &[f64]) -> Result<(), ModelError> {
        let places = &self.nodes.places;
        for (k, (value, parameter)) in values.iter().zip(&self.parameters).enumerate() {
            let what = format!("the value of {}", parameter.name);
            self.finite(what, *value, places.parameters[k])?;
        }
        for (k, value) in self.trim(values).into_iter().enumerate() {
            self.finite(format!("the trim of {}", self.inputs[k].name), value, places.inputs[k])?;
        }
        for (k, value) in self.initial(values, inputs).into_iter().enumerate() {
            let what = format!("the initial value of {}", self.states[k].name);
            self.finite(what, value, places.initial[k])?;
        }
        Ok(())
    }

    fn finite(&self, what: String, value: f64, at: usize) -> Result<(), ModelError> {
        if value.is_finite() { Ok(()) } else { Err(self.fault(at, Fault::NotFinite { what, value })) }
    }

    /// What a flight integrates, with names and places: components of the load, derivatives of further
    /// states.
    fn integrated(&self) -> Vec<(String, usize, Node)> {
        let axes = ["x", "y", "z"].map(|axis| format!("{axis} of [forces]")).into_iter();
        let axes = axes.chain(["x", "y", "z"].map(|axis| format!("{axis} of [moments]")));
        let place = |name: &String| self.nodes.places.loads.get(name).copied().unwrap_or(0);
        let loads = axes.zip(&self.nodes.loads).map(|(name, node)| (name.clone(), place(&name), *node));
        let own = self.states.iter().zip(&self.nodes.places.states).zip(&self.nodes.rates[RIGID_STATES..]);
        let own = own.map(|((state, at), node)| (format!("the derivative of {}", state.name), *at, *node));
        loads.chain(own).collect()
    }

    fn check_start(&self, values: &[f64], start: &Start) -> Result<(), ModelError> {
        let integrated = self.integrated();
        let nodes: Vec<Node> = integrated.iter().map(|(.., node)| *node).collect();
        let evaluate = |graph: &Graph, nodes: &[Node]| {
            let program = Program::new(graph, nodes);
            let mut registers = program.with_parameters(values);
            program.set_inputs(&start.inputs, &mut registers);
            program.set_state(&start.state, &mut registers);
            program.outputs(&registers).collect::<Vec<f64>>()
        };
        for ((what, at, _), value) in integrated.iter().zip(evaluate(&self.graph, &nodes)) {
            self.finite(what.clone(), value, *at)?;
        }
        let states = (0..self.state_count()).map(|k| (Variable::State(k), self.state_name(k)));
        let may_be_free = |k: &usize| {
            let parameter = &self.parameters[*k];
            parameter.freedom != Freedom::Fixed || parameter.candidate.is_some()
        };
        let parameters = (0..self.parameters.len()).filter(may_be_free);
        let parameters = parameters.map(|k| (Variable::Parameter(k), self.parameters[k].name.clone()));
        let mut graph = self.graph.clone();
        let (mut slopes, mut names) = (Vec::new(), Vec::new());
        for (variable, by) in states.chain(parameters) {
            slopes.extend(graph.derivatives(&nodes, variable));
            names.extend(integrated.iter().map(|(what, at, _)| (what, *at, by.clone())));
        }
        for (value, (what, at, by)) in evaluate(&graph, &slopes).into_iter().zip(names) {
            self.finite(format!("the slope of {what} over {by}"), value, at)?;
        }
        // The load is finite: what is left is the body's mass and inertia.
        for (k, rate) in evaluate(&self.graph, &self.nodes.rates[..RIGID_STATES]).into_iter().enumerate() {
            let what = format!("the rate of change of {}, with this mass and inertia,", self.state_name(k));
            self.finite(what, rate, 0)?;
        }
        Ok(())
    }
}
