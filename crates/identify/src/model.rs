//! Which equations are fitted: those of the vehicle's model, or of a file that is given beside it.

use crate::IdentifyError;
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_model::regression::{NamedEquation, PowerProduct, Regression, Regressor};
use mavsight_model::{Axis, Freedom, Input, Model};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What is explained: the aerodynamic force or moment that moves the aircraft as it was seen to move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measured {
    /// Mass times specific force along body x.
    ForceX,
    /// Along body y.
    ForceY,
    /// Along body z.
    ForceZ,
    /// Moment about body x: that component of I ω̇ + ω × I ω.
    MomentX,
    /// Moment about body y.
    MomentY,
    /// Moment about body z.
    MomentZ,
}

impl Measured {
    fn axis(self) -> Axis {
        let axis = self as usize % 3;
        if self as usize >= 3 { Axis::Moment(axis) } else { Axis::Force(axis) }
    }
}

/// What an output is divided by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// ½ρπR⁴ω² for a force, ½ρπR⁵ω² for a moment, with `R` and `omega_m` of the vehicle's model, rotor radius
    /// and mean rotor speed: no unit.
    Rotor,
    /// One: newtons and newton metres.
    Si,
}

/// Whether an output is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum When {
    /// Always.
    #[default]
    Always,
    /// Where the output and one of its regressors move by more than three times their errors.
    Excited,
}

/// One output equation of a file of schema 1.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputEquation {
    /// Name, such as `C_X`.
    pub name: String,
    /// What is explained.
    pub measured: Measured,
    /// Unit of the signal.
    pub scale: Scale,
    /// Signals of the vehicle's model, columns of the inputs, or products of them such as
    /// `kappa_u*alpha_u`.
    pub regressors: Vec<String>,
    /// Regressors whose coefficients are known, and their values: their part is taken off the output.
    #[serde(default)]
    pub fixed: BTreeMap<String, f64>,
    /// Whether it is fitted.
    #[serde(default)]
    pub when: When,
}

/// Output equations over a vehicle's model.
///
/// A file names `schema = 1`, a `name`, and for each `[[output]]` its `name`, what is `measured` (`force_x`
/// to `moment_z`), its `scale` (`rotor` or `si`), its `regressors`, and, where wanted, `fixed` coefficients
/// and `when = "excited"`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputEquations {
    /// Version of the format: 1.
    pub schema: u32,
    /// Name.
    pub name: String,
    /// Equations.
    pub output: Vec<OutputEquation>,
}

/// A file that says which equations are fitted in place of those of the vehicle's own model.
#[derive(Debug, Clone, PartialEq)]
pub enum EquationFile {
    /// Schema 1: other equations over the vehicle's model.
    Outputs(OutputEquations),
    /// Schema 2: a flight model with equations of its own, in place of the vehicle's.
    Model(Arc<Model>),
}

impl EquationFile {
    /// Reads a file's text; `file` is its name in errors.
    ///
    /// # Errors
    /// [`IdentifyError::ModelFile`] for text of neither schema. Whether the signals of a file of schema 1
    /// exist is seen with the vehicle and the inputs.
    pub fn parse(file: &str, text: &str) -> Result<Self, IdentifyError> {
        #[derive(Deserialize)]
        struct Schema {
            schema: Option<toml::Value>,
        }
        let schema = toml::from_str::<Schema>(text).ok().and_then(|s| s.schema);
        if schema.is_some_and(|s| s.as_integer() == Some(2)) {
            let model = Model::parse(file, text).map_err(|e| IdentifyError::ModelFile(e.to_string()))?;
            return Ok(Self::Model(Arc::new(model)));
        }
        OutputEquations::parse(text).map(Self::Outputs)
    }

    /// Whether these equations may be of another aircraft than the vehicle's model: a vehicle file of
    /// schema 1 is that of a coaxial helicopter, whatever flew, and a model without a free parameter is none
    /// that could be fitted.
    pub fn is_of_another_aircraft(&self, vehicle: &Vehicle) -> bool {
        let nothing_free = vehicle.model.parameters.iter().all(|p| p.freedom == Freedom::Fixed);
        matches!(self, Self::Outputs(_)) && (vehicle.is_of_schema_1 || nothing_free)
    }

    /// The vehicle, with the model of this file where it has one.
    pub fn vehicle(&self, vehicle: &Vehicle) -> Vehicle {
        match self {
            Self::Outputs(_) => vehicle.clone(),
            Self::Model(model) => {
                Vehicle { model: Arc::clone(model), is_of_schema_1: false, ..vehicle.clone() }
            }
        }
    }
}

impl OutputEquations {
    /// Reads the text of a file of schema 1.
    ///
    /// # Errors
    /// [`IdentifyError::ModelFile`].
    pub fn parse(text: &str) -> Result<Self, IdentifyError> {
        let equations: Self = toml::from_str(text).map_err(|e| IdentifyError::ModelFile(e.to_string()))?;
        equations.check()?;
        Ok(equations)
    }

    /// The same as `[[equation]]` sections of a flight model's file, which must have inputs, states or
    /// definitions of the names that are used.
    pub fn sections(&self) -> String {
        self.output.iter().map(OutputEquation::section).collect::<Vec<_>>().join("\n")
    }

    fn check(&self) -> Result<(), IdentifyError> {
        if self.schema != 1 {
            return wrong(format!("schema is {}, but this program reads 1 and 2", self.schema));
        }
        if self.output.is_empty() {
            return wrong("there is no [[output]]: name at least one".to_owned());
        }
        for (k, output) in self.output.iter().enumerate() {
            if self.output[..k].iter().any(|o| o.name == output.name) {
                return wrong(format!("two outputs are named {}: give each its own name", output.name));
            }
            output.check()?;
        }
        Ok(())
    }
}

impl OutputEquation {
    fn check(&self) -> Result<(), IdentifyError> {
        let Self { name: output, regressors, fixed, .. } = self;
        if let Some((_, twice)) = regressors.iter().enumerate().find(|(k, r)| regressors[..*k].contains(r)) {
            return wrong(format!("output {output} names the regressor {twice} twice"));
        }
        for (name, value) in fixed {
            if !regressors.contains(name) {
                return wrong(format!(
                    "output {output} fixes {name}, which is none of its regressors: add it there, or take it out of `fixed`"
                ));
            }
            if !value.is_finite() {
                return wrong(format!("output {output} fixes {name} at {value}, which is not a number"));
            }
        }
        if regressors.len() == fixed.len() {
            return wrong(format!("output {output} has no free regressor"));
        }
        Ok(())
    }

    fn section(&self) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let (kind, radii) = match self.measured.axis() {
            Axis::Force(axis) => (["force_x", "force_y", "force_z"][axis], 4),
            Axis::Moment(axis) => (["moment_x", "moment_y", "moment_z"][axis], 5),
        };
        let regressors: Vec<String> = self.regressors.iter().map(|r| quoted(r)).collect();
        let mut out = format!("[[equation]]\nname = {}\nmeasured = \"{kind}\"\n", quoted(&self.name));
        if self.scale == Scale::Rotor {
            out += &format!("scale = \"0.5*rho*pi*R^{radii}*omega_m^2\"\n");
        }
        out += &format!("regressors = [{}]\n", regressors.join(", "));
        if !self.fixed.is_empty() {
            let fixed = self.fixed.iter().map(|(name, value)| format!("{} = {value:?}", quoted(name)));
            out += &format!("fixed = {{ {} }}\n", fixed.collect::<Vec<_>>().join(", "));
        }
        if self.when == When::Excited {
            out += "when = \"excited\"\n";
        }
        out
    }

    fn named(&self) -> NamedEquation {
        let measured = self.measured.axis();
        let radii = if matches!(measured, Axis::Moment(_)) { 5 } else { 4 };
        let scale = match self.scale {
            Scale::Rotor => {
                let powers = vec![("rho", 1), ("pi", 1), ("R", radii), ("omega_m", 2)];
                PowerProduct { factor: 0.5, powers }
            }
            Scale::Si => PowerProduct { factor: 1.0, powers: Vec::new() },
        };
        let fixed = self.regressors.iter().enumerate().filter_map(|(k, r)| Some((k, *self.fixed.get(r)?)));
        NamedEquation {
            name: self.name.clone(),
            measured,
            scale,
            regressors: self.regressors.clone(),
            fixed: fixed.collect(),
            where_excited: self.when == When::Excited,
        }
    }
}

fn wrong(detail: String) -> Result<(), IdentifyError> {
    Err(IdentifyError::ModelFile(detail))
}

/// The equations of a flight, with parameters as numbers.
#[derive(Debug, Clone)]
pub(crate) struct Equations {
    pub(crate) regression: Regression,
    /// The inputs, in the order in which the equations number them.
    pub(crate) inputs: Vec<Input>,
}

impl Equations {
    /// Those of a file, where there is one, or of the vehicle's model.
    ///
    /// # Errors
    /// Equations that are no regression, and a model without any.
    pub(crate) fn new(
        vehicle: &Vehicle,
        inputs: &InputSeries,
        file: Option<&EquationFile>,
    ) -> Result<Self, IdentifyError> {
        let model = match file {
            None => Arc::clone(&vehicle.model),
            Some(EquationFile::Model(model)) => Arc::clone(model),
            Some(EquationFile::Outputs(own)) => {
                let named: Vec<NamedEquation> = own.output.iter().map(OutputEquation::named).collect();
                Arc::new(vehicle.model.with_equations(&named, inputs.names())?)
            }
        };
        if model.equations.is_empty() {
            return Err(IdentifyError::NoEquations(model.name.clone()));
        }
        let own = Vehicle { model, ..vehicle.clone() };
        Ok(Self { regression: own.model.regression(&own.values())?, inputs: own.model.inputs.clone() })
    }

    /// The inputs that drive a regressor, by themselves or by states.
    pub(crate) fn inputs_that_drive(&self, regressor: &Regressor) -> Vec<usize> {
        let of_motion = regressor.motion.iter().filter_map(|m| m.inputs.as_ref());
        let own = regressor.inputs.iter().chain(of_motion);
        let own = own.flat_map(|signal| signal.inputs().iter().copied());
        let mut out: Vec<usize> = own.chain(self.inputs_of_states(states_of(regressor))).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// The inputs that drive some states, by themselves or by other states.
    pub(crate) fn inputs_of_states(&self, mut driven: Vec<usize>) -> Vec<usize> {
        let mut inputs = Vec::new();
        // A state comes behind those that drive it.
        for state in self.regression.states.iter().rev() {
            if driven.contains(&state.state) {
                driven.extend(state.forcing.states());
                inputs.extend(state.forcing.inputs());
            }
        }
        inputs
    }
}

/// The further states that a regressor names.
pub(crate) fn states_of(regressor: &Regressor) -> Vec<usize> {
    let own = regressor.motion.iter().flat_map(|m| m.states.iter().map(|term| term.state));
    let of_motion = regressor.motion.iter().filter_map(|m| m.inputs.as_ref());
    let of_inputs = regressor.inputs.iter().chain(of_motion);
    own.chain(of_inputs.flat_map(|signal| signal.states().iter().copied())).collect()
}

/// Names of the equations of a file, where there is one, or of the vehicle's model.
pub(crate) fn names(vehicle: &Vehicle, file: Option<&EquationFile>) -> Vec<String> {
    let of_model = |model: &Model| model.equations.iter().map(|e| e.name.clone()).collect();
    match file {
        None => of_model(&vehicle.model),
        Some(EquationFile::Model(model)) => of_model(model),
        Some(EquationFile::Outputs(own)) => own.output.iter().map(|o| o.name.clone()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_model::regression::RegressionError;

    fn with_output(rest: &str) -> Result<EquationFile, IdentifyError> {
        EquationFile::parse(
            "model.toml",
            &format!(
                "schema = 1\nname = \"quad\"\n[[output]]\nname = \"Z\"\nmeasured = \"force_z\"\nscale = \"si\"\n{rest}"
            ),
        )
    }

    fn inputs(names: &[&str]) -> InputSeries {
        let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
        let values = vec![0.0; 2 * names.len()];
        InputSeries::new(names, vec![0.0, 1.0], values).expect("inputs")
    }

    #[test]
    fn the_papers_equations_are_those_of_its_model() {
        let vehicle = Vehicle::paper();
        assert_eq!(names(&vehicle, None), ["C_X", "C_Z", "C_m", "C_Y", "C_l", "C_n"]);
        let columns = vehicle.input_columns();
        let got = Equations::new(&vehicle, &inputs(&columns), None).expect("equations");
        let equations = &got.regression.equations;
        assert_eq!((equations[0].regressors.len(), equations[2].measured), (7, Axis::Moment(1)));
        assert_eq!((equations[0].where_excited, equations[4].where_excited), (false, true));
        assert_eq!(got.regression.states.len(), 4);
    }

    #[test]
    fn a_laboratorys_own_model_is_read() {
        let file =
            with_output("regressors = [\"omega_u*omega_u\", \"w\"]\nfixed = { w = -0.1 }").expect("a file");
        let EquationFile::Outputs(own) = &file else { panic!("{file:?}") };
        assert_eq!(own.output[0].named().fixed, [(1, -0.1)]);
        assert_eq!(file.vehicle(&Vehicle::paper()), Vehicle::paper());
        let shelf = mavsight_model::SHELF[0].1;
        let file = EquationFile::parse("own.toml", shelf).expect("a model");
        let bare = Vehicle { model: Arc::new(Model::rigid_body()), ..Vehicle::paper() };
        assert_eq!(file.vehicle(&bare), Vehicle::paper());
        let other = with_output("regressors = [\"1\"]").expect("a file");
        let earlier = Vehicle { is_of_schema_1: true, ..Vehicle::paper() };
        let of_another = [&bare, &earlier, &Vehicle::paper()].map(|v| other.is_of_another_aircraft(v));
        assert_eq!(of_another, [true, true, false]);
        assert!(!file.is_of_another_aircraft(&bare));
        let refused = Equations::new(&bare, &inputs(&["a"]), None).expect_err("no equation").to_string();
        assert!(refused.contains("rigid body") && refused.contains("[[equation]]"), "{refused}");
    }

    #[test]
    fn an_unknown_signal_is_named_with_those_that_there_are() {
        let file = with_output("regressors = [\"1\", \"alpha_u*gamma\"]").expect("a file");
        let with = |names: &[&str]| Equations::new(&Vehicle::paper(), &inputs(names), Some(&file));
        let refused = with(&["delta_lat_rad"]).expect_err("an error");
        assert!(matches!(
            &refused,
            IdentifyError::Regression(RegressionError::UnknownSignal { signal, .. }) if signal == "gamma"
        ));
        let text = refused.to_string();
        for name in ["gamma", "alpha_u", "beta_l", "T_u", "kappa_d", "omega_l", "delta_lat_rad", "q"] {
            assert!(text.contains(name), "{text}");
        }
        assert_eq!(with(&["gamma"]).expect("equations").inputs.len(), 5);
    }

    #[test]
    fn files_that_make_no_sense_are_refused() {
        for (text, hint) in [
            ("regressors = [\"1\", \"1\"]", "twice"),
            ("regressors = [\"1\"]\nfixed = { q = 1.0 }", "none of its regressors"),
            ("regressors = [\"1\"]\nfixed = { 1 = 1.0 }", "no free regressor"),
            ("regressors = [\"1\", \"q\"]\nfixed = { q = nan }", "not a number"),
            ("regressors = []", "no free regressor"),
            ("regressors = [\"1\"]\ntypo = 1", "typo"),
            (
                "regressors = [\"1\"]\n[[output]]\nname = \"Z\"\nmeasured = \"force_z\"\nscale = \"si\"\nregressors = [\"1\"]",
                "two outputs",
            ),
        ] {
            let refused = with_output(text).expect_err(text).to_string();
            assert!(refused.contains(hint), "{refused} should say {hint}");
        }
        for text in [
            "schema = 2\nname = \"\"\noutput = []",
            "schema = 1\nname = \"\"\noutput = []",
            "schema = 3\nname = \"\"\n[[output]]\nname = \"Z\"\nmeasured = \"force_z\"\nscale = \"si\"\nregressors = [\"1\"]",
            "no toml",
        ] {
            let refused = EquationFile::parse("model.toml", text);
            assert!(matches!(refused, Err(IdentifyError::ModelFile { .. })), "{refused:?}");
        }
    }
}
