//! Output equations as data: the content of a model file.

use crate::IdentifyError;
use mavsight_flight::{HelicopterInput, InputSeries};
use serde::Deserialize;
use std::collections::BTreeMap;

/// The model file of equation 3, which is used where no other is given.
pub const EQUATION_3: &str = include_str!("equation_3.toml");

/// Every signal that a regressor may name, and what it is.
pub const SIGNALS: [(&str, &str); 20] = [
    ("1", "a constant"),
    ("alpha_u", "flapping of the upper rotor, longitudinal, rad"),
    ("alpha_l", "flapping of the lower rotor, longitudinal, rad"),
    ("beta_u", "flapping of the upper rotor, lateral, rad"),
    ("beta_l", "flapping of the lower rotor, lateral, rad"),
    ("p", "roll rate, rad/s"),
    ("q", "pitch rate, rad/s"),
    ("r", "yaw rate, rad/s"),
    ("u", "velocity along body x, m/s"),
    ("v", "velocity along body y, m/s"),
    ("w", "velocity along body z, m/s"),
    ("delta_lon", "swash-plate, longitudinal, rad"),
    ("delta_lat", "swash-plate, lateral, rad"),
    ("T_u", "thrust of the upper rotor by its coefficient and speed, N"),
    ("T_l", "thrust of the lower rotor, N"),
    ("omega_u", "speed of the upper rotor, rad/s"),
    ("omega_l", "speed of the lower rotor, rad/s"),
    ("kappa_u", "square of the upper rotor's speed over the mean speed"),
    ("kappa_l", "square of the lower rotor's speed over the mean speed"),
    ("kappa_d", "kappa_l less kappa_u: the rotors' yaw torque for equal torque coefficients"),
];

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
    /// Moment about body x: I_xx ṗ + (I_zz - I_yy) q r.
    MomentX,
    /// Moment about body y: I_yy q̇ + (I_xx - I_zz) p r.
    MomentY,
    /// Moment about body z: I_zz ṙ + (I_yy - I_xx) p q.
    MomentZ,
}

impl Measured {
    /// Body axis, and whether it is a moment.
    pub(crate) fn axis(self) -> (usize, bool) {
        (self as usize % 3, self as usize >= 3)
    }
}

/// What an output is divided by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// ½ρπR⁴ω² for a force, ½ρπR⁵ω² for a moment, with ω the mean rotor speed (equation 4): no unit.
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

/// One output equation.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputModel {
    /// Name, such as `C_X`.
    pub name: String,
    /// What is explained.
    pub measured: Measured,
    /// Unit of the signal.
    pub scale: Scale,
    /// Names of [`SIGNALS`] or of other columns of the inputs, or products of them such as `kappa_u*alpha_u`.
    pub regressors: Vec<String>,
    /// Regressors whose coefficients are known, and their values: their part is taken off the output.
    #[serde(default)]
    pub fixed: BTreeMap<String, f64>,
    /// Whether it is fitted.
    #[serde(default)]
    pub when: When,
}

/// A set of output equations.
///
/// A file names `schema = 1`, a `name`, and for each `[[output]]` its `name`, what is `measured` (`force_x`
/// to `moment_z`), its `scale` (`rotor` or `si`), its `regressors`, and, where wanted, `fixed` coefficients
/// and `when = "excited"`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Version of the format: 1.
    pub schema: u32,
    /// Name.
    pub name: String,
    /// Equations.
    pub output: Vec<OutputModel>,
}

impl Model {
    /// Reads a model file's text.
    ///
    /// # Errors
    /// [`IdentifyError::ModelFile`] for text that is not such a file. Whether its signals exist,
    /// [`Model::check_signals`] says.
    pub fn parse(text: &str) -> Result<Self, IdentifyError> {
        let model: Self = toml::from_str(text).map_err(|e| IdentifyError::ModelFile(e.to_string()))?;
        model.check()?;
        Ok(model)
    }

    /// [`EQUATION_3`].
    ///
    /// # Errors
    /// Never: the text is part of the program, and a test reads it.
    pub fn equation_3() -> Result<Self, IdentifyError> {
        Self::parse(EQUATION_3)
    }

    /// Checks that every signal is one of [`SIGNALS`] or a column of the inputs.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownSignal`], with those that there are.
    pub fn check_signals(&self, inputs: &InputSeries) -> Result<(), IdentifyError> {
        let own = SIGNALS.iter().map(|(name, _)| *name);
        let columns = inputs.names().iter().map(String::as_str);
        let others = columns.filter(|name| !HelicopterInput::COLUMNS.contains(name));
        let known: Vec<&str> = own.chain(others).collect();
        for output in &self.output {
            let mut signals = output.regressors.iter().flat_map(|r| factors(r));
            if let Some(signal) = signals.find(|signal| !known.contains(signal)) {
                return Err(IdentifyError::UnknownSignal {
                    output: output.name.clone(),
                    signal: signal.to_owned(),
                    known: known.join(", "),
                });
            }
        }
        Ok(())
    }

    fn check(&self) -> Result<(), IdentifyError> {
        if self.schema != 1 {
            return wrong(format!("schema is {}, but this program reads 1", self.schema));
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

impl OutputModel {
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
}

fn wrong(detail: String) -> Result<(), IdentifyError> {
    Err(IdentifyError::ModelFile(detail))
}

/// The signals whose product a regressor is.
pub(crate) fn factors(regressor: &str) -> impl Iterator<Item = &str> {
    regressor.split('*').map(str::trim)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equation_3_is_read() {
        let model = Model::equation_3().expect("a model");
        let names: Vec<&str> = model.output.iter().map(|o| o.name.as_str()).collect();
        assert_eq!(names, ["C_X", "C_Z", "C_m", "C_Y", "C_l", "C_n"]);
        assert_eq!(model.output[0].regressors.len(), 7);
        assert_eq!((model.output[2].measured, model.output[2].scale), (Measured::MomentY, Scale::Rotor));
        assert_eq!((model.output[0].when, model.output[4].when), (When::Always, When::Excited));
    }

    fn with_output(rest: &str) -> Result<Model, IdentifyError> {
        Model::parse(&format!(
            "schema = 1\nname = \"quad\"\n[[output]]\nname = \"Z\"\nmeasured = \"force_z\"\nscale = \"si\"\n{rest}"
        ))
    }

    #[test]
    fn a_laboratorys_own_model_is_read() {
        let model =
            with_output("regressors = [\"omega_u*omega_u\", \"w\"]\nfixed = { w = -0.1 }").expect("a model");
        assert_eq!(model.output[0].fixed["w"], -0.1);
        assert_eq!(factors(&model.output[0].regressors[0]).collect::<Vec<_>>(), ["omega_u", "omega_u"]);
    }

    #[test]
    fn an_unknown_signal_is_named_with_those_that_there_are() {
        let inputs = |names: &[&str]| {
            let all: Vec<String> =
                HelicopterInput::COLUMNS.iter().chain(names).map(|n| (*n).into()).collect();
            let values = vec![0.0; 2 * all.len()];
            InputSeries::new(all, vec![0.0, 1.0], values).expect("inputs")
        };
        let model = with_output("regressors = [\"1\", \"alpha_u*gamma\"]").expect("a model");
        let refused = model.check_signals(&inputs(&[])).expect_err("an error");
        assert!(matches!(&refused, IdentifyError::UnknownSignal { signal, .. } if signal == "gamma"));
        let text = refused.to_string();
        assert!(text.contains("gamma") && SIGNALS.iter().all(|(name, _)| text.contains(name)), "{text}");
        assert_eq!(model.check_signals(&inputs(&["gamma"])), Ok(()));
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
        assert!(matches!(
            Model::parse("schema = 2\nname = \"\"\noutput = []"),
            Err(IdentifyError::ModelFile { .. })
        ));
        assert!(matches!(
            Model::parse("schema = 1\nname = \"\"\noutput = []"),
            Err(IdentifyError::ModelFile { .. })
        ));
        assert!(matches!(Model::parse("no toml"), Err(IdentifyError::ModelFile { .. })));
    }
}
