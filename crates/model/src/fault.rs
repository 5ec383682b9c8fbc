//! What is refused of a model file, where, and what to do about it.

use crate::unit::Unit;
use std::fmt;
use thiserror::Error;

/// A fault of a model file and its place.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelError {
    /// Name of the file.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// Column in characters, counted from 1.
    pub column: usize,
    /// What is wrong.
    pub fault: Fault,
}

impl fmt::Display for ModelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, line {}, column {}: {}", self.file, self.line, self.column, self.fault)
    }
}

impl std::error::Error for ModelError {}

impl ModelError {
    /// A fault at a place of a text, in bytes.
    pub(crate) fn at(file: &str, text: &str, at: usize, fault: Fault) -> Self {
        let mut at = at.min(text.len());
        while !text.is_char_boundary(at) {
            at -= 1;
        }
        let before = &text[..at];
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
        Self { file: file.to_owned(), line, column, fault }
    }
}

/// What is wrong with a model file.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Fault {
    /// Text that is no TOML.
    #[error("{0}")]
    NotToml(String),
    /// A version that is not read.
    #[error("schema is {0}, but a flight model has schema 2: write `schema = 2`")]
    Schema(String),
    /// A key that is missing.
    #[error("{section} has no `{key}`: add it")]
    Missing {
        /// Section of the file.
        section: String,
        /// Key.
        key: &'static str,
    },
    /// A key that the format does not have.
    #[error("`{name}` is no key of {section}{}", keys(.near))]
    UnknownKey {
        /// Key.
        name: String,
        /// Section of the file.
        section: String,
        /// The nearest known ones.
        near: Vec<String>,
    },
    /// A value of another kind.
    #[error("`{key}` must be {wanted}, but is {found}")]
    Kind {
        /// Key.
        key: String,
        /// What is needed.
        wanted: &'static str,
        /// What there is.
        found: String,
    },
    /// A value that the vehicle file gives.
    #[error("the value of `{0}` comes from the vehicle file: remove it here")]
    FromVehicle(String),
    /// A name that is not one.
    #[error("`{0}` is no name: begin with a letter, go on with letters, digits and _, at most 60")]
    BadName(String),
    /// A name that has a meaning already.
    #[error("`{name}` is already {what}: take another name")]
    Taken {
        /// The name.
        name: String,
        /// What has it.
        what: String,
    },
    /// A unit that is not known.
    #[error("`{0}` is no unit{hint}; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"", hint = instead(.0))]
    UnknownUnit(String),
    /// A number that is not one.
    #[error("`{0}` is no number: write 0.05 or 5e-2")]
    NotANumber(String),
    /// A number outside what is possible.
    #[error("`{key}` is {value}, but must {must}")]
    Number {
        /// Key.
        key: String,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A character or word in the wrong place.
    #[error("`{found}` does not belong here{}", operator_missing(.found))]
    Unexpected {
        /// What is there.
        found: String,
    },
    /// An expression that is not complete.
    #[error("the expression ends here: a name, a number or a `)` is missing")]
    Ends,
    /// An expression that is nested too deeply.
    #[error(
        "more than {0} parentheses or definitions within each other: split the expression into definitions"
    )]
    TooDeep(usize),
    /// An expression that is too long.
    #[error("more than {0} parts in one expression: split it into definitions")]
    TooLong(usize),
    /// A name that is not defined.
    #[error("`{name}` is not defined{}", nearest(.near, ": give it under [parameters], [inputs] or [definitions]"))]
    UnknownName {
        /// The name.
        name: String,
        /// The nearest known ones.
        near: Vec<String>,
    },
    /// A function that there is not.
    #[error("there is no function `{name}`{}", nearest(.near, ": a table would be one, see [[table]]"))]
    UnknownFunction {
        /// The name.
        name: String,
        /// The nearest known ones.
        near: Vec<String>,
    },
    /// A function with another number of arguments.
    #[error("`{name}` takes {}, but has {found}: write `{}`", arguments(.wanted), call(.name, *.wanted))]
    Arguments {
        /// The function.
        name: String,
        /// What it takes.
        wanted: usize,
        /// What there are.
        found: usize,
    },
    /// A name that may not stand here.
    #[error("`{name}` may not be used in {place}, which {allows}")]
    NotHere {
        /// The name.
        name: String,
        /// Where it is.
        place: String,
        /// What may be used there.
        allows: &'static str,
    },
    /// Definitions that need each other.
    #[error("this goes in a circle: {0}; give one of them without the others")]
    Circle(String),
    /// Units that do not agree.
    #[error("{what} is {}, this is {}: a factor in {} is missing, or a declared unit is wrong", .wanted.words(), .found.words(), .wanted.over(*.found))]
    Unit {
        /// What has the unit.
        what: String,
        /// Its unit.
        wanted: Unit,
        /// The unit found.
        found: Unit,
    },
    /// A parameter without effect.
    #[error(
        "the parameter `{0}` appears in no force, moment, state, output or other parameter: use it or remove it"
    )]
    Unused(String),
    /// Too much of something.
    #[error("{found} {what}, but at most {most} are read")]
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// The most that is read.
        most: usize,
    },
    /// An equation for regression whose coefficients are all known.
    #[error("equation {0} has no free regressor: add one, or take one out of `fixed`")]
    NothingFree(String),
    /// A model without effect.
    #[error("the model has no force and no moment: give [forces] or [moments]")]
    Empty,
    /// A table that is not one.
    #[error("table `{0}` needs as many y as x, at least two, finite, x increasing")]
    Table(String),
    /// A model that has no value at its start.
    #[error(
        "{what} is {value} at the start of the flight: keep divisors and arguments of sqrt and log above zero there"
    )]
    NotFinite {
        /// What has no value.
        what: String,
        /// The value.
        value: f64,
    },
    /// A state that changes faster than the integrator follows.
    #[error(
        "{what} follows with a time constant of {time_s:.2e} s, and nothing faster than {shortest_s:.2e} s can be \
         integrated: make it slower, or replace it by the value it runs to"
    )]
    TooFast {
        /// The state.
        what: String,
        /// Its time constant.
        time_s: f64,
        /// The shortest that can be followed.
        shortest_s: f64,
    },
}

/// What to write for units that people write.
fn instead(part: &str) -> &'static str {
    match part {
        "deg" | "°" => ": write rad",
        "rpm" | "rev" => ": write rad/s",
        "g" | "gram" => ": write kg",
        "mm" | "cm" | "km" | "ft" | "in" => ": write m",
        "ms" | "min" | "h" => ": write s",
        "Nm" => ": write \"N m\"",
        _ if part.contains(['(', ')']) => ": write each divisor with its own `/`, without parentheses",
        _ => "",
    }
}

fn operator_missing(found: &str) -> &'static str {
    match found {
        "=" | "<" | ">" | "!" | "&" | "|" | "?" => {
            ": there are no comparisons; use min, max, clamp or a table"
        }
        ")" => ": a value, or the `(` of this, is missing before it",
        "[" | "]" | "{" | "}" => ": use round parentheses",
        f if f.starts_with(|c: char| c.is_alphanumeric() || "_.(".contains(c)) => {
            ": an operator or a comma is missing before it"
        }
        _ => "",
    }
}

impl Fault {
    /// Units that do not agree.
    pub(crate) fn units(what: &str, wanted: Unit, found: Unit) -> Self {
        Self::Unit { what: what.to_owned(), wanted, found }
    }
}

fn arguments(wanted: &usize) -> String {
    if *wanted == 1 { "one argument".to_owned() } else { format!("{wanted} arguments") }
}

fn call(name: &str, wanted: usize) -> String {
    let named: &[&str] = match name {
        "atan2" => &["y", "x"],
        "clamp" => &["x", "low", "high"],
        "deadzone" => &["x", "half"],
        "saturate" => &["x", "limit"],
        "min" | "max" => &["a", "b"],
        _ => &["x"],
    };
    format!("{name}({})", named[..wanted.min(named.len())].join(", "))
}

fn nearest(near: &[String], none: &str) -> String {
    if near.is_empty() { none.to_owned() } else { format!(": did you mean {}?", near.join(", ")) }
}

/// Near ones, or all.
fn keys(near: &[String]) -> String {
    if near.len() > NEAREST { format!("; keys are {}", near.join(", ")) } else { nearest(near, "") }
}

/// Names that a message proposes, at most.
const NEAREST: usize = 3;

/// The names nearest to one, best first, three at most: those that differ in at most a third of their letters, by the
/// distance of Damerau and Levenshtein.
pub fn near<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Vec<String> {
    let short: String = name.chars().take(60).collect();
    let mut near: Vec<(usize, &str)> = known.map(|k| (strsim::osa_distance(&short, k), k)).collect();
    near.retain(|(distance, k)| 3 * distance <= k.chars().count().max(short.chars().count()) + 2);
    near.sort();
    near.dedup();
    near.into_iter().take(NEAREST).map(|(_, name)| name.to_owned()).collect()
}
