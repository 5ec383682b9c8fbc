//! From the text of a model file to a model.

mod check;
mod entries;

use crate::document::{Section, Source, Text, shown};
use crate::fault::{Fault, ModelError};
use crate::graph::{Node, Variable};
use crate::lower::{ACCELERATIONS, Lower};
use crate::model::{Axis, Equation, Model, Nodes, Parameter};
use crate::rigid_body::{BODY_PARAMETERS, Load, RIGID_STATES, RigidBody, unit_of};
use crate::unit::Unit;
use entries::{Declared, declare};
use toml::de::DeTable;

/// Bytes of a file, at most.
const LARGEST_FILE: usize = 1_000_000;

/// Keys of a file.
const KEYS: [&str; 13] = [
    "schema",
    "name",
    "source",
    "text",
    "inputs",
    "parameters",
    "definitions",
    "states",
    "forces",
    "moments",
    "derived",
    "outputs",
    "table",
];
const EQUATION: &str = "equation";

/// What an expression may use.
#[derive(Debug, Clone, Copy)]
struct Allowed {
    inputs: bool,
    /// Those beyond the rigid body's.
    states: bool,
    words: &'static str,
}

const PARAMETERS: Allowed = Allowed { inputs: false, states: false, words: "may use parameters alone" };
const DRIVEN: Allowed =
    Allowed { inputs: true, states: true, words: "may use inputs, further states and parameters alone" };
const INPUTS: Allowed = Allowed { inputs: true, states: false, words: "may use inputs and parameters alone" };

impl Model {
    /// Reads a model file; `file` is its name in errors.
    ///
    /// # Errors
    /// The first fault, with its line and column: text that is no TOML; unknown or missing keys; names that
    /// are taken or not defined; definitions in a circle; units that do not agree; a parameter without
    /// effect; a file of more than a megabyte, a hundred states or inputs, or 50 000 operations, a million in
    /// all derivatives.
    pub fn parse(file: &str, text: &str) -> Result<Self, ModelError> {
        let source = Source { file, text };
        if text.len() > LARGEST_FILE {
            let (what, found, most) = ("bytes", text.len(), LARGEST_FILE);
            return source.fault(0, Fault::TooMany { what, found, most });
        }
        let document = DeTable::parse(text).or_else(|error| {
            let at = error.span().map_or(0, |span| span.start);
            let mut words = error.message().lines().next().unwrap_or("this is no TOML").to_owned();
            if let Some(key) =
                error.span().and_then(|span| text.get(span)).filter(|_| words == "duplicate key")
            {
                words = format!("`{}` stands here for the second time: remove one of them", shown(key));
            }
            source.fault(at, Fault::NotToml(words))
        })?;
        let root = Section::new("the file".to_owned(), 0, document.get_ref(), source);
        let Some(schema) = root.get("schema") else {
            return source.fault(0, Fault::Schema("missing".to_owned()));
        };
        if schema.number()? != 2.0 {
            return source.fault(schema.at, Fault::Schema(schema.number()?.to_string()));
        }
        root.only(&[&KEYS[..], &[EQUATION]].concat())?;
        Reading::new(&root, source)?.model(&root)
    }
}

/// A file whose names are declared and whose expressions are being read.
struct Reading<'a> {
    lower: Lower<'a>,
    declared: Declared,
    body: [Node; BODY_PARAMETERS.len()],
    rigid: RigidBody,
    nodes: Nodes,
}

impl<'a> Reading<'a> {
    fn new(root: &Section<'a>, source: Source<'a>) -> Result<Self, ModelError> {
        let mut lower = Lower::new(source);
        let body = std::array::from_fn(|k| {
            let node = lower.graph.variable(Variable::Parameter(k));
            lower.provide(BODY_PARAMETERS[k], node, Some(unit_of(k)));
            node
        });
        let rigid = RigidBody::new(&mut lower.graph);
        let speed = Unit::METRE.over(Unit::SECOND);
        let rate = Unit::SECOND.to_the(-1.0);
        for (names, nodes, unit) in [
            (["x", "y", "z"], rigid.position, Unit::METRE),
            (["u", "v", "w"], rigid.velocity, speed),
            (["p", "q", "r"], rigid.rates, rate),
            (["phi", "theta", "psi"], rigid.euler_angles(&mut lower.graph), Unit::ONE),
        ] {
            for (name, node) in names.into_iter().zip(nodes) {
                lower.provide(name, node, Some(unit));
            }
        }
        let declared = declare(root, &mut lower)?;
        Ok(Self { lower, declared, body, rigid, nodes: Nodes::default() })
    }

    fn model(mut self, root: &Section<'a>) -> Result<Model, ModelError> {
        let name = root.require("name")?.string()?;
        let (source, text) = (root.string("source")?, root.string("text")?);
        self.nodes.definitions = self.lower.finish_definitions()?;
        let force = self.load(root, "forces", Unit::KILOGRAM.times(Unit::METRE))?;
        let moment = self.load(root, "moments", Unit::KILOGRAM.times(Unit::METRE.to_the(2.0)))?;
        if force.is_none() && moment.is_none() {
            return self.lower.source.fault(0, Fault::Empty);
        }
        let zero = self.lower.graph.constant(0.0);
        let load = Load { force: force.unwrap_or([zero; 3]), moment: moment.unwrap_or([zero; 3]) };
        let acceleration = self.rigid.accelerate(&mut self.lower.graph, &self.body, &load);
        self.nodes.loads = load.force.into_iter().chain(load.moment).collect();
        self.nodes.rates.clone_from(&acceleration.rates_of_state);
        self.states()?;
        self.values()?;
        self.derived()?;
        self.provide_accelerations(&acceleration.specific_force, &acceleration.angular);
        self.sensors()?;
        let equations = self.equations(root)?;
        let Declared { inputs, parameters, states, derived, sensors, .. } = self.declared.clone();
        let model = Model {
            file: self.lower.source.file.to_owned(),
            definition: self.lower.source.text.to_owned(),
            name,
            source: source.unwrap_or_default(),
            text: text.unwrap_or_default(),
            inputs: inputs.into_iter().map(|d| d.item).collect(),
            parameters: parameters.into_iter().map(|d| d.item).collect(),
            states: states.into_iter().map(|d| d.item).collect(),
            derived: derived.into_iter().map(|d| d.item).collect(),
            sensors: sensors.into_iter().map(|d| d.item).collect(),
            equations,
            graph: self.lower.graph,
            nodes: self.nodes,
        };
        check::derivatives_are_few(&model, self.lower.source)?;
        check::every_parameter_is_used(&model, &self.declared.parameters, self.lower.source)?;
        Ok(model)
    }

    /// Three components of a load; none where the section is missing. `unit` is that of a load times s².
    fn load(
        &mut self,
        root: &Section<'a>,
        key: &'static str,
        unit: Unit,
    ) -> Result<Option<[Node; 3]>, ModelError> {
        let Some(entry) = root.get(key) else { return Ok(None) };
        let section = entry.section(format!("[{key}]"))?;
        let unit = unit.over(Unit::SECOND.to_the(2.0));
        let mut out = [self.lower.graph.constant(0.0); 3];
        for (node, axis) in out.iter_mut().zip(["x", "y", "z"]) {
            if let Some(text) = section.expression(axis)? {
                self.nodes.places.loads.insert(format!("{axis} of [{key}]"), text.at);
                *node = self.lower.expression(&format!("{axis} of [{key}]"), &text, Some(unit))?;
            }
        }
        section.finish()?;
        Ok(Some(out))
    }

    fn states(&mut self) -> Result<(), ModelError> {
        for state in self.declared.states.clone() {
            let (name, unit) = (&state.item.name, state.item.unit);
            let rate = unit.map(|unit| unit.over(Unit::SECOND));
            let derivative = state.expressions.first().cloned().flatten();
            let Some(derivative) = derivative else {
                let section = format!("state {name}");
                return self.lower.source.fault(state.at, Fault::Missing { section, key: "derivative" });
            };
            self.nodes.places.states.push(derivative.at);
            let node = self.lower.expression(&format!("the derivative of {name}"), &derivative, rate)?;
            self.nodes.rates.push(node);
            let what = format!("the initial value of {name}");
            let node = self.optional(&what, state.expressions.get(1), unit, INPUTS)?;
            self.nodes
                .places
                .initial
                .push(state.expressions.get(1).cloned().flatten().map_or(state.at, |t| t.at));
            self.nodes.initial.push(node);
        }
        for input in self.declared.inputs.clone() {
            let what = format!("the trim of {}", input.item.name);
            let node = self.optional(&what, input.expressions.first(), input.item.unit, PARAMETERS)?;
            self.nodes.places.inputs.push(input.at);
            self.nodes.trim.push(node);
        }
        Ok(())
    }

    /// Zero where there is no expression.
    fn optional(
        &mut self,
        what: &str,
        text: Option<&Option<Text>>,
        unit: Option<Unit>,
        allowed: Allowed,
    ) -> Result<Node, ModelError> {
        let Some(Some(text)) = text else { return Ok(self.lower.graph.constant(0.0)) };
        self.restricted(what, text, unit, allowed)
    }

    fn restricted(
        &mut self,
        what: &str,
        text: &Text,
        unit: Option<Unit>,
        allowed: Allowed,
    ) -> Result<Node, ModelError> {
        let node = self.lower.expression(what, text, unit)?;
        let wrong = self.lower.graph.variables(&[node]).into_iter().find(|variable| match variable {
            Variable::State(k) => *k < RIGID_STATES || !allowed.states,
            Variable::Input(_) => !allowed.inputs,
            Variable::Parameter(_) => false,
        });
        let Some(variable) = wrong else { return Ok(node) };
        let (at, name) = self.lower.first_use(text, variable)?;
        self.lower.source.fault(at, Fault::NotHere { name, place: what.to_owned(), allows: allowed.words })
    }

    fn values(&mut self) -> Result<(), ModelError> {
        for parameter in self.declared.parameters.clone() {
            let what = format!("the value of {}", parameter.item.name);
            let text = parameter.expressions.first().cloned().flatten();
            let node = match &text {
                Some(text) => Some(self.restricted(&what, text, parameter.item.unit, PARAMETERS)?),
                None => None,
            };
            if let (Some(node), Some(text)) = (node, text) {
                self.within_bounds(&parameter.item, node, &text)?;
            }
            self.nodes.places.parameters.push(parameter.at);
            self.nodes.values.push(node);
        }
        self.nodes.value_order =
            check::order_of_values(&self.lower.graph, &self.nodes.values).or_else(|circle| {
                let first = circle.first().into_iter();
                let names =
                    circle.iter().chain(first).map(|k| self.declared.parameters[*k].item.name.as_str());
                let names: Vec<&str> = names.collect();
                let at = circle.first().map_or(0, |k| self.declared.parameters[*k].at);
                self.lower.source.fault(at, Fault::Circle(names.join(" needs ")))
            })?;
        Ok(())
    }

    /// Refuses a number outside its own bounds.
    fn within_bounds(&self, parameter: &Parameter, node: Node, text: &Text) -> Result<(), ModelError> {
        let Some(value) = self.lower.graph.constant_value(node) else { return Ok(()) };
        if value.is_finite() && (parameter.min..=parameter.max).contains(&value) {
            return Ok(());
        }
        let key = format!("the value of {}", parameter.name);
        let must = if value.is_finite() { "be between its min and its max" } else { "be a finite number" };
        self.lower.source.fault(text.at, Fault::Number { key, value, must })
    }

    fn derived(&mut self) -> Result<(), ModelError> {
        for derived in self.declared.derived.clone() {
            let what = format!("`{}`", derived.item.name);
            let node = self.optional(&what, derived.expressions.first(), derived.item.unit, PARAMETERS)?;
            self.nodes.derived.push(node);
        }
        Ok(())
    }

    fn provide_accelerations(&mut self, specific_force: &[Node; 3], angular: &[Node; 3]) {
        let linear = Unit::METRE.over(Unit::SECOND.to_the(2.0));
        let turning = Unit::SECOND.to_the(-2.0);
        for k in 0..3 {
            self.lower.provide(ACCELERATIONS[k], specific_force[k], Some(linear));
            self.lower.provide(ACCELERATIONS[k + 3], angular[k], Some(turning));
        }
    }

    fn sensors(&mut self) -> Result<(), ModelError> {
        for sensor in self.declared.sensors.clone() {
            let what = format!("output `{}`", sensor.item.name);
            let Some(Some(text)) = sensor.expressions.first() else {
                return self.lower.source.fault(sensor.at, Fault::Missing { section: what, key: "value" });
            };
            let node = self.lower.expression(&what, text, sensor.item.unit)?;
            self.nodes.sensors.push(node);
        }
        Ok(())
    }

    fn equations(&mut self, root: &Section<'a>) -> Result<Vec<Equation>, ModelError> {
        let mut out: Vec<Equation> = Vec::new();
        for section in entries::sections_of(root, EQUATION, "[[equation]]", self.lower.source)? {
            let equation = self.equation(&section)?;
            if out.iter().any(|other| other.name == equation.name) {
                let what = "an equation".to_owned();
                return self.lower.source.fault(section.at, Fault::Taken { name: equation.name, what });
            }
            out.push(equation);
        }
        Ok(out)
    }

    fn equation(&mut self, section: &Section<'a>) -> Result<Equation, ModelError> {
        let name = section.require("name")?.string()?;
        let measured = section.require("measured")?;
        let source = self.lower.source;
        let word = measured.string()?;
        let axis = match word.as_str() {
            "force_x" => Axis::Force(0),
            "force_y" => Axis::Force(1),
            "force_z" => Axis::Force(2),
            "moment_x" => Axis::Moment(0),
            "moment_y" => Axis::Moment(1),
            "moment_z" => Axis::Moment(2),
            _ => {
                let (key, found) = ("measured".to_owned(), format!("`{}`", shown(&word)));
                let wanted = "force_x, force_y, force_z, moment_x, moment_y or moment_z";
                return source.fault(measured.at, Fault::Kind { key, wanted, found });
            }
        };
        let what = format!("the scale of {name}");
        let scale = match section.expression("scale")? {
            Some(text) => self.restricted(&what, &text, None, DRIVEN)?,
            None => self.lower.graph.constant(1.0),
        };
        let regressors = section.require("regressors")?;
        let texts = regressors.expressions()?;
        if texts.len() > entries::MOST {
            let (what, found, most) = ("regressors", texts.len(), entries::MOST);
            return source.fault(regressors.at, Fault::TooMany { what, found, most });
        }
        let names: Vec<String> = texts.iter().map(|t| t.text.trim().to_owned()).collect();
        let nodes: Result<Vec<Node>, ModelError> =
            texts.iter().map(|text| self.lower.expression("a regressor", text, None)).collect();
        if let Some((k, twice)) = names.iter().enumerate().find(|(k, name)| names[..*k].contains(name)) {
            let (name, what) = (twice.clone(), format!("a regressor of {name}"));
            return source.fault(texts[k].at, Fault::Taken { name, what });
        }
        let mut fixed = Vec::new();
        if let Some(entry) = section.get("fixed") {
            for value in entry.section(format!("`fixed` of {name}"))?.entries() {
                let Some(k) = names.iter().position(|n| *n == value.key) else {
                    let (name, section) =
                        (shown(&value.key), format!("`fixed` of {name}, which takes its regressors"));
                    return source.fault(value.key_at, Fault::UnknownKey { name, section, near: names });
                };
                fixed.push((k, value.number()?));
            }
        }
        if fixed.len() >= names.len() {
            return source.fault(regressors.at, Fault::NothingFree(name));
        }
        let where_excited = match section.get("when") {
            None => false,
            Some(entry) => match entry.string()?.as_str() {
                "excited" => true,
                "always" => false,
                _ => {
                    let (key, wanted) = ("when".to_owned(), "always or excited");
                    let found = format!("`{}`", shown(&entry.string()?));
                    return source.fault(entry.at, Fault::Kind { key, wanted, found });
                }
            },
        };
        section.finish()?;
        self.nodes.scales.push(scale);
        self.nodes.regressors.push(nodes?);
        Ok(Equation { name, measured: axis, regressors: names, fixed, where_excited })
    }
}
