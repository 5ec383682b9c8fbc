//! A flight model: what a file says, checked.

use crate::graph::{Graph, Node, Variable};
use crate::program::Program;
use crate::rigid_body::{BODY_PARAMETERS, RIGID_STATES};
use crate::unit::Unit;
use std::collections::HashMap;

/// An input of the aircraft.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Input {
    /// Name in expressions.
    pub name: String,
    /// Column of the table of inputs.
    pub column: String,
    /// Unit.
    pub unit: Option<Unit>,
    /// Whether the file has it in radians: people write such an input in degrees.
    pub is_angle: bool,
    /// Least value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// What it is.
    pub text: String,
}

/// Whether an estimator may change a parameter.
#[derive(Debug, Clone, PartialEq)]
pub enum Freedom {
    /// Fixed unless freed by name.
    Fixed,
    /// Free.
    Free,
    /// Free where the flight moves these inputs, each by itself.
    WhereMoved(Vec<usize>),
    /// Free where the flight does not.
    UnlessMoved(Vec<usize>),
}

/// A number of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name in expressions.
    pub name: String,
    /// Name in tables.
    pub label: String,
    /// Unit.
    pub unit: Option<Unit>,
    /// Whether an estimator may change it.
    pub freedom: Freedom,
    /// Least value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Standard deviation of what is known of it before a flight.
    pub prior_std: Option<f64>,
    /// What it would explain, where a search of the structure may add it.
    pub candidate: Option<String>,
    /// What it is.
    pub text: String,
}

/// A state beyond those of the rigid body.
#[derive(Debug, Clone, PartialEq)]
pub struct FurtherState {
    /// Name.
    pub name: String,
    /// Name of its column in tables: the name and the unit.
    pub column: String,
    /// Unit.
    pub unit: Option<Unit>,
    /// Standard deviation of its initial value at the beginning of a flight; 0 where it is known.
    pub initial_std: f64,
    /// Usual excursion: the standard deviation of its value where a record begins in flight.
    pub size: f64,
    /// What it is.
    pub text: String,
}

/// A quantity that follows from parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Derived {
    /// Name in tables.
    pub name: String,
    /// Unit.
    pub unit: Option<Unit>,
}

/// A sensor beside the pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Name.
    pub name: String,
    /// Column of its table.
    pub column: String,
    /// Unit.
    pub unit: Option<Unit>,
    /// Standard deviation of a sample.
    pub std: f64,
}

/// A force or moment in body axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// Force along x, y or z.
    Force(usize),
    /// Moment about x, y or z.
    Moment(usize),
}

/// Coefficients of one force or moment by regression.
#[derive(Debug, Clone, PartialEq)]
pub struct Equation {
    /// Name, such as `C_X`.
    pub name: String,
    /// What is explained.
    pub measured: Axis,
    /// Names of the regressors: the text of each.
    pub regressors: Vec<String>,
    /// Coefficients that are known, by regressor.
    pub fixed: Vec<(usize, f64)>,
    /// Whether it is fitted only where the flight moves it and one of its regressors beyond their errors.
    pub where_excited: bool,
}

/// A flight model that has been read and checked.
///
/// States are those of the rigid body ([`RIGID_STATES`]) and further ones; parameters are
/// [`crate::BODY_PARAMETERS`] and those of the file.
#[derive(Debug, Clone, Default)]
pub struct Model {
    /// Name of its file.
    pub file: String,
    /// Text of its file.
    pub definition: String,
    /// Name.
    pub name: String,
    /// Where the equations come from.
    pub source: String,
    /// What it is for.
    pub text: String,
    /// Inputs, in the order of the file.
    pub inputs: Vec<Input>,
    /// Parameters; those of the body first.
    pub parameters: Vec<Parameter>,
    /// States beyond the rigid body's.
    pub states: Vec<FurtherState>,
    /// Quantities that follow from parameters.
    pub derived: Vec<Derived>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// Equations for regression.
    pub equations: Vec<Equation>,
    pub(crate) graph: Graph,
    pub(crate) nodes: Nodes,
}

/// Where expressions are in the file, in bytes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Places {
    /// Of those components of force and moment that the file gives, by their names.
    pub(crate) loads: HashMap<String, usize>,
    /// Of the derivatives of further states.
    pub(crate) states: Vec<usize>,
    pub(crate) initial: Vec<usize>,
    pub(crate) inputs: Vec<usize>,
    pub(crate) parameters: Vec<usize>,
}

impl PartialEq for Model {
    /// Models are equal if their texts are.
    fn eq(&self, other: &Self) -> bool {
        self.definition == other.definition
    }
}

/// Where the expressions of a model are in its graph.
#[derive(Debug, Clone, Default)]
pub(crate) struct Nodes {
    /// Derivatives of all states.
    pub(crate) rates: Vec<Node>,
    /// Force and moment.
    pub(crate) loads: Vec<Node>,
    pub(crate) initial: Vec<Node>,
    pub(crate) trim: Vec<Node>,
    /// Of the file's own parameters; none for those of the body.
    pub(crate) values: Vec<Option<Node>>,
    /// An order in which each value needs earlier ones alone.
    pub(crate) value_order: Vec<usize>,
    pub(crate) derived: Vec<Node>,
    pub(crate) sensors: Vec<Node>,
    pub(crate) definitions: Vec<(String, Node)>,
    pub(crate) scales: Vec<Node>,
    pub(crate) regressors: Vec<Vec<Node>>,
    pub(crate) places: Places,
}

/// Mass, inertia and surroundings of an aircraft, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Mass.
    pub mass_kg: f64,
    /// I_xx, I_yy, I_zz, and the products I_xy, I_xz, I_yz: integrals of xy, xz and yz over the mass.
    pub inertia_kg_m2: [f64; 6],
    /// Acceleration of gravity.
    pub gravity_m_s2: f64,
    /// Density of the air.
    pub air_density_kg_m3: f64,
}

impl Body {
    fn values(&self) -> [f64; BODY_PARAMETERS.len()] {
        let [xx, yy, zz, xy, xz, yz] = self.inertia_kg_m2;
        [self.mass_kg, xx, yy, zz, xy, xz, yz, self.gravity_m_s2, self.air_density_kg_m3]
    }
}

impl Model {
    /// Number of states, the rigid body's included.
    pub fn state_count(&self) -> usize {
        RIGID_STATES + self.states.len()
    }

    /// The place of an input by its name.
    pub fn input(&self, name: &str) -> Option<usize> {
        self.inputs.iter().position(|i| i.name == name)
    }

    /// Inputs with the nearest names, for messages.
    pub fn near_inputs(&self, name: &str) -> Vec<String> {
        crate::fault::near(name, self.inputs.iter().map(|i| i.name.as_str()))
    }

    /// The place of a parameter by its name or its label.
    pub fn parameter(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|p| p.name == name || p.label == name)
    }

    /// Parameters with the nearest names, for messages.
    pub fn near_parameters(&self, name: &str) -> Vec<String> {
        crate::fault::near(name, self.parameters.iter().flat_map(|p| [p.name.as_str(), p.label.as_str()]))
    }

    /// Whether nothing but sensors depends on a parameter, by its place, so that the motion does not show it.
    pub fn is_of_outputs_alone(&self, parameter: usize) -> bool {
        let depend = |nodes: &[Node]| self.graph.variables(nodes).contains(&Variable::Parameter(parameter));
        let nodes = &self.nodes;
        depend(&nodes.sensors) && !depend(&[&nodes.rates[..], &nodes.initial].concat())
    }

    /// The values of all parameters for a body, where `given` returns what is known of this aircraft and the
    /// file the rest; a value that the file computes from others follows those.
    pub fn values(&self, body: &Body, given: impl Fn(&Parameter) -> Option<f64>) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.parameters.len()];
        out[..BODY_PARAMETERS.len()].copy_from_slice(&body.values());
        for k in &self.nodes.value_order {
            out[*k] = match (given(&self.parameters[*k]), self.nodes.values[*k]) {
                (Some(value), _) => value,
                (None, Some(node)) => Program::new(&self.graph, &[node]).values(&out, &[])[0],
                (None, None) => out[*k],
            };
        }
        out
    }

    /// The inputs that hold the aircraft in steady flight.
    pub fn trim(&self, values: &[f64]) -> Vec<f64> {
        Program::new(&self.graph, &self.nodes.trim).values(values, &[])
    }

    /// The further states with which a flight begins under some inputs.
    pub fn initial(&self, values: &[f64], inputs: &[f64]) -> Vec<f64> {
        Program::new(&self.graph, &self.nodes.initial).values(values, inputs)
    }

    /// The derived quantities and, for each, its derivatives by some parameters.
    pub fn derived_values(&self, values: &[f64], by: &[usize]) -> Vec<(f64, Vec<f64>)> {
        let mut graph = self.graph.clone();
        let slopes: Vec<Vec<Node>> =
            by.iter().map(|k| graph.derivatives(&self.nodes.derived, Variable::Parameter(*k))).collect();
        let own = Program::new(&graph, &self.nodes.derived).values(values, &[]);
        let slopes: Vec<Vec<f64>> =
            slopes.iter().map(|nodes| Program::new(&graph, nodes).values(values, &[])).collect();
        own.into_iter().enumerate().map(|(k, value)| (value, slopes.iter().map(|s| s[k]).collect())).collect()
    }

    /// For each coefficient of an equation that a parameter of the equations of motion is named like
    /// (`equation,regressor`): that name, and the coefficient over the parameter, over some rows of the
    /// inputs.
    ///
    /// A coefficient is made dimensionless by the equation's scale, the parameter by whatever stands by it in
    /// the forces: for the same force their ratio is that of the means of both.
    pub fn equation_over_motion<'a>(
        &self,
        values: &[f64],
        rows: impl Iterator<Item = &'a [f64]> + Clone,
    ) -> Vec<(String, f64)> {
        let mut out = Vec::new();
        let state: Vec<f64> =
            (0..self.state_count()).map(|k| if matches!(k, 0..=2 | 4..=6) { 0.0 } else { 1.0 }).collect();
        for (e, equation) in self.equations.iter().enumerate() {
            for (r, regressor) in equation.regressors.iter().enumerate() {
                let label = format!("{},{regressor}", equation.name);
                let Some(k) = self.parameters.iter().position(|p| p.label == label) else { continue };
                let load = match equation.measured {
                    Axis::Force(axis) => self.nodes.loads[axis],
                    Axis::Moment(axis) => self.nodes.loads[3 + axis],
                };
                let mut graph = self.graph.clone();
                let slope = graph.derivatives(&[load], Variable::Parameter(k))[0];
                let nodes = [slope, self.nodes.regressors[e][r], self.nodes.scales[e]];
                let program = Program::new(&graph, &nodes);
                let mut registers = program.with_parameters(values);
                let (mut by, mut scale) = (0.0, 0.0);
                for row in rows.clone() {
                    program.set_inputs(row, &mut registers);
                    program.set_state(&state, &mut registers);
                    by += program.output(0, &registers) / program.output(1, &registers);
                    scale += program.output(2, &registers);
                }
                let ratio = by / scale;
                if ratio.is_finite() && ratio != 0.0 {
                    out.push((label, ratio));
                }
            }
        }
        out
    }
}
