//! Terms that no file names: forces and moments that follow a signal of the flight.

use crate::graph::{Graph, Node, Variable};
use crate::model::{Freedom, Input, Model, Parameter};
use crate::rigid_body::{BODY_PARAMETERS, Load, RIGID_STATES, RigidBody};
use crate::unit::Unit;

/// What a force or a moment may follow.
struct Signal {
    name: String,
    node: Node,
    unit: Option<Unit>,
}

impl Model {
    /// This model with forces and moments that follow signals of the flight: to each of the three forces and three
    /// moments in body axes is added, for each signal, a parameter times the signal. Signals are a constant, velocity and
    /// rates in body axes, roll and pitch, each input less its trim, and the time, s, which is a further input,
    /// the last: what follows it drifts, as an aircraft does whose battery empties.
    ///
    /// The new parameters come after all others, are fixed at zero, so that the flight is as before, and are candidates
    /// ([`Parameter::candidate`]): whether measurements ask for them shows what residuals follow. Sensors do not feel
    /// them. What already acts in the same way is not left out.
    #[must_use]
    pub fn with_signal_terms(&self) -> Self {
        let mut out = self.clone();
        let graph = &mut out.graph;
        let body: [Node; BODY_PARAMETERS.len()] =
            std::array::from_fn(|k| graph.variable(Variable::Parameter(k)));
        let rigid = RigidBody::new(graph);
        let zero = graph.constant(0.0);
        out.inputs.push(time());
        out.nodes.trim.push(zero);
        let signals = signals(&out.inputs, &out.nodes.trim, &rigid, graph);
        let mut loads = out.nodes.loads.clone();
        for (load, (axis, of_load)) in loads.iter_mut().zip(LOADS) {
            for signal in &signals {
                let parameter = out.add_candidate(term_parameter(axis, of_load(), signal));
                let term = out.graph.multiply(parameter, signal.node);
                *load = out.graph.add(*load, term);
            }
        }
        let load = Load { force: [loads[0], loads[1], loads[2]], moment: [loads[3], loads[4], loads[5]] };
        let rates = rigid.accelerate(&mut out.graph, &body, &load).rates_of_state;
        out.nodes.rates[..RIGID_STATES].copy_from_slice(&rates);
        out.nodes.loads = loads;
        out
    }

    /// Adds a parameter that is zero, after all others.
    pub(crate) fn add_candidate(&mut self, parameter: Parameter) -> Node {
        let (place, zero) = (self.parameters.len(), self.graph.constant(0.0));
        self.nodes.values.push(Some(zero));
        self.nodes.value_order.push(place);
        self.parameters.push(parameter);
        self.graph.variable(Variable::Parameter(place))
    }
}

type UnitOf = fn() -> Unit;

/// Forces and moments, each with its unit.
const LOADS: [(&str, UnitOf); 6] = [
    ("force x", newton),
    ("force y", newton),
    ("force z", newton),
    ("moment x", newton_metre),
    ("moment y", newton_metre),
    ("moment z", newton_metre),
];

fn newton() -> Unit {
    Unit::KILOGRAM.times(Unit::METRE).over(Unit::SECOND.to_the(2.0))
}

fn newton_metre() -> Unit {
    newton().times(Unit::METRE)
}

fn time() -> Input {
    Input {
        name: "time".to_owned(),
        column: "t_s".to_owned(),
        unit: Some(Unit::SECOND),
        is_angle: false,
        min: f64::NEG_INFINITY,
        max: f64::INFINITY,
        text: "time".to_owned(),
    }
}

fn signals(inputs: &[Input], trim: &[Node], rigid: &RigidBody, graph: &mut Graph) -> Vec<Signal> {
    let of = |name: &str, node, unit| Signal { name: name.to_owned(), node, unit: Some(unit) };
    let (speed, rate) = (Unit::METRE.over(Unit::SECOND), Unit::SECOND.to_the(-1.0));
    let mut out = vec![of("constant", graph.constant(1.0), Unit::ONE)];
    out.extend(["u", "v", "w"].into_iter().zip(rigid.velocity).map(|(name, node)| of(name, node, speed)));
    out.extend(["p", "q", "r"].into_iter().zip(rigid.rates).map(|(name, node)| of(name, node, rate)));
    let [phi, theta, _] = rigid.euler_angles(graph);
    out.extend([("phi", phi), ("theta", theta)].map(|(name, node)| of(name, node, Unit::ONE)));
    for (k, (input, trim)) in inputs.iter().zip(trim).enumerate() {
        let input_node = graph.variable(Variable::Input(k));
        let node = graph.subtract(input_node, *trim);
        out.push(Signal { name: input.name.clone(), node, unit: input.unit });
    }
    out
}

fn term_parameter(load: &str, unit_of_load: Unit, signal: &Signal) -> Parameter {
    let follows = if signal.name == "constant" {
        format!("a constant {load}")
    } else {
        format!("a {load} that follows {}", signal.name)
    };
    let unit = signal.unit.map(|unit| unit_of_load.over(unit));
    Parameter::of_candidate(format!("{load} by {}", signal.name), unit, follows)
}

impl Parameter {
    /// A term that is held at zero, and what it would explain.
    pub(crate) fn of_candidate(name: String, unit: Option<Unit>, explains: String) -> Self {
        Self {
            label: name.clone(),
            name,
            unit,
            freedom: Freedom::Fixed,
            min: f64::NEG_INFINITY,
            max: f64::INFINITY,
            prior_std: None,
            candidate: Some(explains.clone()),
            text: explains,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Body, Dynamics};

    fn rates_of(model: &Model, values: &[f64], state: &[f64], inputs: &[f64]) -> Vec<f64> {
        let dynamics = Dynamics::new(model, values, &[]);
        let mut evaluation = dynamics.with(&[]);
        evaluation.set_inputs(inputs);
        let mut out = vec![0.0; model.state_count()];
        evaluation.rates(state, &mut out);
        out
    }

    /// Newton's law by hand: a force that follows u by -0.1 N s/m slows 2 kg at 3 m/s by 0.15 m/s².
    #[test]
    fn a_term_acts_as_it_says_and_at_zero_not_at_all() {
        let model = Model::shelf("coaxial").expect("a model");
        let with_terms = model.with_signal_terms();
        assert_eq!(with_terms.parameters.len(), model.parameters.len() + 6 * (1 + 6 + 2 + 4 + 1));
        let body = Body {
            mass_kg: 2.0,
            inertia_kg_m2: [0.02, 0.03, 0.04, 0.0, 0.0, 0.0],
            gravity_m_s2: 9.81,
            air_density_kg_m3: 1.2,
        };
        let mut values = with_terms.values(&body, |_| None);
        let mut state = vec![0.0; model.state_count()];
        (state[3], state[7], state[11]) = (1.0, 3.0, 0.5);
        let inputs = [200.0, 210.0, 0.1, 0.0];
        let before = rates_of(&model, &values[..model.parameters.len()], &state, &inputs);
        let inputs = [200.0, 210.0, 0.1, 0.0, 7.0];
        assert_eq!(rates_of(&with_terms, &values, &state, &inputs), before);
        let place = with_terms.parameter("force x by u").expect("a term");
        assert_eq!(with_terms.parameters[place].unit.map(|u| u.to_string()), Some("N s/m".to_owned()));
        values[place] = -0.1;
        values[with_terms.parameter("moment y by delta_lon").expect("a term")] = 0.6;
        values[with_terms.parameter("force z by time").expect("a term")] = 0.02;
        let after = rates_of(&with_terms, &values, &state, &inputs);
        assert!((after[7] - before[7] + 0.15).abs() < 1e-12);
        assert!((after[9] - before[9] - 0.02 * 7.0 / 2.0).abs() < 1e-12);
        assert!((after[11] - before[11] - 0.6 * 0.1 / 0.03).abs() < 1e-12);
        assert_eq!(after[13..], before[13..]);
    }
}
