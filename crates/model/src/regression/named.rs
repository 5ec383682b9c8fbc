//! Equations that name signals of a model, or columns of the inputs that it does not have.

use super::RegressionError;
use crate::graph::{Node, Variable};
use crate::model::{Axis, Equation, Input, Model};
use crate::rigid_body::RIGID_STATES;

/// A factor times powers of names.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerProduct {
    /// Factor.
    pub factor: f64,
    /// Names, each with its exponent.
    pub powers: Vec<(&'static str, i32)>,
}

/// An equation whose regressors are products of names.
///
/// A name is `1`, one of u v w p q r, or one of the model's further states, inputs and definitions, or of
/// a column of the inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedEquation {
    /// Name.
    pub name: String,
    /// What is measured.
    pub measured: Axis,
    /// What it is divided by, by names and parameters of the model.
    pub scale: PowerProduct,
    /// Regressors: names with `*` between.
    pub regressors: Vec<String>,
    /// Coefficients that are known, by regressor.
    pub fixed: Vec<(usize, f64)>,
    /// Whether it is fitted only where the flight moves it.
    pub where_excited: bool,
}

const MOTION: [&str; 6] = ["u", "v", "w", "p", "q", "r"];

impl Model {
    /// The model with other equations, which may name its signals and any of the columns that the inputs
    /// have; such columns become inputs of it.
    ///
    /// # Errors
    /// [`RegressionError::UnknownSignal`], [`RegressionError::Scale`].
    pub fn with_equations(
        &self,
        equations: &[NamedEquation],
        columns: &[String],
    ) -> Result<Self, RegressionError> {
        let mut out = self.clone();
        out.equations.clear();
        out.nodes.scales.clear();
        out.nodes.regressors.clear();
        for equation in equations {
            let scale = out.scale_of(equation)?;
            let mut nodes = Vec::with_capacity(equation.regressors.len());
            for text in &equation.regressors {
                let mut product = out.graph.constant(1.0);
                for name in text.split('*').map(str::trim) {
                    let node = out.signal(name, columns).ok_or_else(|| RegressionError::UnknownSignal {
                        equation: equation.name.clone(),
                        signal: name.to_owned(),
                        known: out.known_signals(columns).join(", "),
                    })?;
                    product = out.graph.multiply(product, node);
                }
                nodes.push(product);
            }
            out.nodes.scales.push(scale);
            out.nodes.regressors.push(nodes);
            out.equations.push(Equation {
                name: equation.name.clone(),
                measured: equation.measured,
                regressors: equation.regressors.clone(),
                fixed: equation.fixed.clone(),
                where_excited: equation.where_excited,
            });
        }
        Ok(out)
    }

    fn scale_of(&mut self, equation: &NamedEquation) -> Result<Node, RegressionError> {
        let mut scale = self.graph.constant(equation.scale.factor);
        for (name, exponent) in &equation.scale.powers {
            let base = match (*name, self.parameters.iter().position(|p| p.name == *name)) {
                ("pi", _) => Some(self.graph.constant(std::f64::consts::PI)),
                (_, Some(k)) => Some(self.graph.variable(Variable::Parameter(k))),
                _ => self.signal(name, &[]),
            };
            let base = base.ok_or_else(|| RegressionError::Scale {
                equation: equation.name.clone(),
                name: (*name).to_owned(),
                model: self.name.clone(),
            })?;
            let exponent = self.graph.constant(f64::from(*exponent));
            let power = self.graph.power(base, exponent);
            scale = self.graph.multiply(scale, power);
        }
        Ok(scale)
    }

    fn signal(&mut self, name: &str, columns: &[String]) -> Option<Node> {
        if name == "1" {
            return Some(self.graph.constant(1.0));
        }
        let place = |known: &str| known == name;
        let motion = MOTION.iter().position(|known| place(known)).map(|k| Variable::State(7 + k));
        let state = self.states.iter().position(|s| place(&s.name));
        let input = self.inputs.iter().position(|i| place(&i.name));
        let known =
            motion.or(state.map(|k| Variable::State(RIGID_STATES + k))).or(input.map(Variable::Input));
        if let Some(variable) = known {
            return Some(self.graph.variable(variable));
        }
        if let Some((_, node)) = self.nodes.definitions.iter().find(|(known, _)| place(known)) {
            return Some(*node);
        }
        let column = self.inputs.iter().position(|i| place(&i.column));
        if column.is_none() && !columns.iter().any(|known| place(known)) {
            return None;
        }
        let k = column.unwrap_or_else(|| {
            self.inputs.push(Input {
                name: name.to_owned(),
                column: name.to_owned(),
                min: f64::NEG_INFINITY,
                max: f64::INFINITY,
                ..Input::default()
            });
            let zero = self.graph.constant(0.0);
            self.nodes.trim.push(zero);
            self.inputs.len() - 1
        });
        Some(self.graph.variable(Variable::Input(k)))
    }

    fn known_signals(&self, columns: &[String]) -> Vec<String> {
        let own = ["1"].into_iter().chain(MOTION);
        let own = own.chain(self.states.iter().map(|s| s.name.as_str()));
        let own = own.chain(self.inputs.iter().map(|i| i.name.as_str()));
        let own = own.chain(self.nodes.definitions.iter().map(|(name, _)| name.as_str()));
        let mut out: Vec<String> = Vec::new();
        for name in own.chain(columns.iter().map(String::as_str)) {
            if !out.iter().any(|known| known == name) {
                out.push(name.to_owned());
            }
        }
        out
    }
}
