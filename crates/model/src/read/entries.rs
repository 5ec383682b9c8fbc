//! Entries of a model file: inputs, parameters, states, definitions, tables, derived quantities, sensors.

use crate::document::{Entry, Section, Text};
use crate::fault::{Fault, ModelError, near};
use crate::graph::{Table, Variable};
use crate::lower::Lower;
use crate::model::{Derived, Freedom, FurtherState, Input, Parameter, Sensor};
use crate::rigid_body::{BODY_PARAMETERS, RIGID_STATES, unit_of};

/// Entries of one kind, at most.
const MOST: usize = 100;
const MOST_DEFINITIONS: usize = 1000;
const MOST_POINTS: usize = 10_000;

/// An entry of the file, where it is, and its expressions.
#[derive(Debug, Clone)]
pub(super) struct Item<T> {
    pub(super) item: T,
    pub(super) at: usize,
    pub(super) expressions: Vec<Option<Text>>,
}

#[derive(Debug, Clone, Default)]
pub(super) struct Declared {
    pub(super) inputs: Vec<Item<Input>>,
    pub(super) parameters: Vec<Item<Parameter>>,
    pub(super) states: Vec<Item<FurtherState>>,
    pub(super) derived: Vec<Item<Derived>>,
    pub(super) sensors: Vec<Item<Sensor>>,
}

impl Declared {
    pub(super) fn name_of(&self, variable: Variable) -> String {
        match variable {
            Variable::Input(k) => self.inputs[k].item.name.clone(),
            Variable::Parameter(k) => self.parameters[k].item.name.clone(),
            Variable::State(k) if k < RIGID_STATES => "the pose, a velocity or a rate".to_owned(),
            Variable::State(k) => self.states[k - RIGID_STATES].item.name.clone(),
        }
    }
}

/// Reads all sections that give names.
pub(super) fn declare<'a>(root: &Section<'a>, lower: &mut Lower<'a>) -> Result<Declared, ModelError> {
    let mut out = Declared::default();
    for entry in of_section(root, lower, "inputs", MOST)? {
        let item = input(&entry)?;
        lower.declare(&entry.key, entry.key_at, Variable::Input(out.inputs.len()), item.item.unit)?;
        out.inputs.push(item);
    }
    for (k, name) in BODY_PARAMETERS.into_iter().enumerate() {
        out.parameters.push(body_parameter(name, k));
    }
    for entry in of_section(root, lower, "parameters", MOST)? {
        if let Some(own) = BODY_PARAMETERS.iter().position(|name| *name == entry.key) {
            let mut item = parameter(&entry, &out.inputs, lower, true)?;
            item.item.unit = Some(unit_of(own));
            out.parameters[own] = item;
            continue;
        }
        let item = parameter(&entry, &out.inputs, lower, false)?;
        let variable = Variable::Parameter(out.parameters.len());
        lower.declare(&entry.key, entry.key_at, variable, item.item.unit)?;
        out.parameters.push(item);
    }
    for entry in of_section(root, lower, "states", MOST)? {
        let item = state(&entry, lower)?;
        let variable = Variable::State(RIGID_STATES + out.states.len());
        lower.declare(&entry.key, entry.key_at, variable, item.item.unit)?;
        out.states.push(item);
    }
    tables(root, lower)?;
    for entry in of_section(root, lower, "definitions", MOST_DEFINITIONS)? {
        let (text, unit) = expression_or_table(&entry)?;
        lower.define(&entry.key, entry.key_at, text, unit)?;
    }
    for entry in of_section(root, lower, "derived", MOST)? {
        let (text, unit) = expression_or_table(&entry)?;
        let item = Derived { name: entry.key.clone(), unit };
        out.derived.push(Item { item, at: entry.key_at, expressions: vec![Some(text)] });
    }
    for entry in of_section(root, lower, "outputs", MOST)? {
        out.sensors.push(sensor(&entry, lower)?);
    }
    Ok(out)
}

fn of_section<'a>(
    root: &Section<'a>,
    lower: &Lower<'a>,
    key: &'static str,
    most: usize,
) -> Result<Vec<Entry<'a>>, ModelError> {
    let Some(entry) = root.get(key) else { return Ok(Vec::new()) };
    let entries = entry.section(format!("[{key}]"))?.entries().to_vec();
    if entries.len() > most {
        return lower.source.fault(entry.at, Fault::TooMany { what: key, found: entries.len(), most });
    }
    Ok(entries)
}

fn expression_or_table(entry: &Entry<'_>) -> Result<(Text, Option<crate::unit::Unit>), ModelError> {
    if entry.value.as_table().is_none() {
        return Ok((entry.expression()?, None));
    }
    let section = entry.section(format!("`{}`", entry.key))?;
    let (text, unit) = (section.require("value")?.expression()?, section.unit()?);
    section.string("text")?;
    section.finish()?;
    Ok((text, unit))
}

fn input(entry: &Entry<'_>) -> Result<Item<Input>, ModelError> {
    let section = entry.section(format!("input {}", entry.key))?;
    let item = Input {
        name: entry.key.clone(),
        column: section.string("column")?.unwrap_or_else(|| entry.key.clone()),
        is_angle: section.string("unit")?.is_some_and(|unit| unit.trim() == "rad"),
        unit: section.unit()?,
        min: section.number("min")?.unwrap_or(f64::NEG_INFINITY),
        max: section.number("max")?.unwrap_or(f64::INFINITY),
        text: section.string("text")?.unwrap_or_default(),
    };
    let expressions = vec![section.expression("trim")?];
    section.finish()?;
    Ok(Item { item, at: entry.key_at, expressions })
}

fn body_parameter(name: &str, k: usize) -> Item<Parameter> {
    let item = Parameter {
        name: name.to_owned(),
        label: name.to_owned(),
        unit: Some(unit_of(k)),
        freedom: Freedom::Fixed,
        // A mass and a moment of inertia are above zero; a product of inertia may have any sign.
        min: if (4..7).contains(&k) { f64::NEG_INFINITY } else { f64::MIN_POSITIVE },
        max: f64::INFINITY,
        prior_std: None,
        candidate: None,
        text: String::new(),
    };
    Item { item, at: 0, expressions: vec![None] }
}

fn parameter(
    entry: &Entry<'_>,
    inputs: &[Item<Input>],
    lower: &Lower<'_>,
    of_body: bool,
) -> Result<Item<Parameter>, ModelError> {
    let section = entry.section(format!("parameter {}", entry.key))?;
    let own =
        BODY_PARAMETERS.iter().position(|name| *name == entry.key).map(|k| body_parameter(&entry.key, k));
    let item = Parameter {
        name: entry.key.clone(),
        label: section.string("label")?.unwrap_or_else(|| entry.key.clone()),
        unit: section.unit()?,
        freedom: section.get("free").map_or(Ok(Freedom::Fixed), |free| freedom(free, inputs, lower))?,
        min: section.number("min")?.unwrap_or(own.map_or(f64::NEG_INFINITY, |own| own.item.min)),
        max: section.number("max")?.unwrap_or(f64::INFINITY),
        prior_std: positive(&section, "prior_std", lower)?,
        candidate: section.string("candidate")?,
        text: section.string("text")?.unwrap_or_default(),
    };
    if item.min >= item.max {
        let (key, value) = (format!("max of {}", entry.key), item.max);
        return lower.source.fault(entry.at, Fault::Number { key, value, must: "be above min" });
    }
    let value = match of_body {
        true => None,
        false => Some(section.require("value")?.expression()?),
    };
    section.finish()?;
    Ok(Item { item, at: entry.key_at, expressions: vec![value] })
}

fn positive(section: &Section<'_>, key: &'static str, lower: &Lower<'_>) -> Result<Option<f64>, ModelError> {
    let Some(entry) = section.get(key) else { return Ok(None) };
    let value = entry.number()?;
    if value > 0.0 {
        return Ok(Some(value));
    }
    lower.source.fault(entry.at, Fault::Number { key: key.to_owned(), value, must: "be above zero" })
}

fn freedom(entry: &Entry<'_>, inputs: &[Item<Input>], lower: &Lower<'_>) -> Result<Freedom, ModelError> {
    if let Some(free) = entry.bool() {
        return Ok(if free { Freedom::Free } else { Freedom::Fixed });
    }
    let section = entry.section("`free`".to_owned())?;
    let places = |key: &'static str| -> Result<Option<Vec<usize>>, ModelError> {
        let Some(list) = section.get(key) else { return Ok(None) };
        let place = |name: String| match inputs.iter().position(|i| i.item.name == name) {
            Some(k) => Ok(k),
            None => {
                let near = near(&name, inputs.iter().map(|i| i.item.name.as_str()));
                lower.source.fault(list.at, Fault::UnknownName { name, near })
            }
        };
        list.strings()?.into_iter().map(place).collect::<Result<Vec<usize>, ModelError>>().map(Some)
    };
    let (moved, unless) = (places("moved")?, places("unless_moved")?);
    section.finish()?;
    Ok(match (moved, unless) {
        (Some(inputs), _) => Freedom::WhereMoved(inputs),
        (_, Some(inputs)) => Freedom::UnlessMoved(inputs),
        _ => Freedom::Fixed,
    })
}

fn state(entry: &Entry<'_>, lower: &Lower<'_>) -> Result<Item<FurtherState>, ModelError> {
    let section = entry.section(format!("state {}", entry.key))?;
    let std = section.number("initial_std")?.unwrap_or(0.0);
    let unit_text = section.string("unit")?.unwrap_or_default();
    let unit_text = unit_text.replace('^', "");
    let words = unit_text.split(|c: char| !c.is_alphanumeric()).filter(|w| !matches!(*w, "" | "1"));
    let words: Vec<&str> = words.collect();
    let item = FurtherState {
        name: entry.key.clone(),
        column: [&[entry.key.as_str()], words.as_slice()].concat().join("_"),
        unit: section.unit()?,
        initial_std: std,
        size: positive(&section, "size", lower)?.unwrap_or(1.0),
        text: section.string("text")?.unwrap_or_default(),
    };
    if std < 0.0 {
        let key = format!("initial_std of {}", entry.key);
        return lower.source.fault(entry.at, Fault::Number { key, value: std, must: "be zero or more" });
    }
    let expressions = vec![section.expression("derivative")?, section.expression("initial")?];
    section.finish()?;
    Ok(Item { item, at: entry.key_at, expressions })
}

fn sensor(entry: &Entry<'_>, lower: &Lower<'_>) -> Result<Item<Sensor>, ModelError> {
    let section = entry.section(format!("output {}", entry.key))?;
    let Some(std) = positive(&section, "std", lower)? else {
        let name = section.name.clone();
        return lower.source.fault(entry.at, Fault::Missing { section: name, key: "std" });
    };
    let item = Sensor {
        name: entry.key.clone(),
        column: section.string("column")?.unwrap_or_else(|| entry.key.clone()),
        unit: section.unit()?,
        std,
    };
    let expressions = vec![section.expression("value")?];
    section.string("text")?;
    section.finish()?;
    Ok(Item { item, at: entry.key_at, expressions })
}

fn tables(root: &Section<'_>, lower: &mut Lower<'_>) -> Result<(), ModelError> {
    let Some(entry) = root.get("table") else { return Ok(()) };
    for section in entry.sections("[[table]]")? {
        let name = section.require("name")?;
        let (x, y) = (section.require("x")?.numbers()?, section.require("y")?.numbers()?);
        let unit = |key: &'static str| -> Result<Option<crate::unit::Unit>, ModelError> {
            let Some(entry) = section.get(key) else { return Ok(None) };
            let parsed = crate::unit::Unit::parse(&entry.string()?);
            parsed.map(Some).or_else(|part| lower.source.fault(entry.at, Fault::UnknownUnit(part)))
        };
        let units = [unit("x_unit")?, unit("unit")?];
        section.string("text")?;
        section.finish()?;
        let increases = x.windows(2).all(|w| w[0] < w[1]);
        if x.len() != y.len() || x.len() < 2 || x.len() > MOST_POINTS || !increases {
            return lower.source.fault(section.at, Fault::Table(name.string()?));
        }
        lower.table(&name.string()?, name.at, Table { x, y }, units)?;
    }
    Ok(())
}
