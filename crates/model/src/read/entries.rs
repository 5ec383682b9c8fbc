//! Entries of a model file: inputs, parameters, states, definitions, tables, derived quantities, sensors.

use crate::document::{Entry, Section, Source, Text, shown};
use crate::fault::{Fault, ModelError, near};
use crate::graph::{Table, Variable};
use crate::lower::Lower;
use crate::model::{Derived, Freedom, FurtherState, Input, Parameter, Sensor};
use crate::rigid_body::{BODY_PARAMETERS, RIGID_STATES, unit_of};

/// Entries of one kind, at most.
pub(super) const MOST: usize = 100;
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

/// Reads all sections that give names.
pub(super) fn declare<'a>(root: &Section<'a>, lower: &mut Lower<'a>) -> Result<Declared, ModelError> {
    let mut out = Declared::default();
    for entry in of_section(root, lower, "inputs", MOST)? {
        let item = input(&entry, lower.source)?;
        lower.declare(&entry.key, entry.key_at, Variable::Input(out.inputs.len()), item.item.unit)?;
        out.inputs.push(item);
    }
    for (k, name) in BODY_PARAMETERS.into_iter().enumerate() {
        out.parameters.push(body_parameter(name, k));
    }
    for entry in of_section(root, lower, "parameters", MOST)? {
        if let Some(own) = BODY_PARAMETERS.iter().position(|name| *name == entry.key) {
            out.parameters[own] = parameter(&entry, &out.inputs, lower, Some(own))?;
            continue;
        }
        let item = parameter(&entry, &out.inputs, lower, None)?;
        let variable = Variable::Parameter(out.parameters.len());
        lower.declare(&entry.key, entry.key_at, variable, item.item.unit)?;
        out.parameters.push(item);
    }
    labels_differ(&out.parameters, lower)?;
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

/// Refuses a label that is the name or the label of another parameter: whoever asks for one would get the
/// other.
fn labels_differ(parameters: &[Item<Parameter>], lower: &Lower<'_>) -> Result<(), ModelError> {
    for (k, Item { item, at, .. }) in parameters.iter().enumerate() {
        let same = |other: &Item<Parameter>| other.item.name == item.label || other.item.label == item.label;
        let other = parameters.iter().enumerate().find(|(j, other)| *j != k && same(other));
        if let Some((_, other)) = other {
            let what = format!("name or label of the parameter {}", other.item.name);
            return lower.source.fault(*at, Fault::Taken { name: shown(&item.label), what });
        }
    }
    Ok(())
}

/// The tables of a list such as `[[table]]`.
pub(super) fn sections_of<'a>(
    root: &Section<'a>,
    key: &'static str,
    name: &'static str,
    source: Source<'a>,
) -> Result<Vec<Section<'a>>, ModelError> {
    let Some(entry) = root.get(key) else { return Ok(Vec::new()) };
    let sections = entry.sections(name)?;
    if sections.len() > MOST {
        return source.fault(entry.at, Fault::TooMany { what: name, found: sections.len(), most: MOST });
    }
    Ok(sections)
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
    let section = entry.section(format!("`{}`", shown(&entry.key)))?;
    let (text, unit) = (section.require("value")?.expression()?, section.unit()?);
    section.string("text")?;
    section.finish()?;
    Ok((text, unit))
}

fn input(entry: &Entry<'_>, source: Source<'_>) -> Result<Item<Input>, ModelError> {
    let section = entry.section(format!("input {}", shown(&entry.key)))?;
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
    in_order(entry, item.min, item.max, source)?;
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
    of_body: Option<usize>,
) -> Result<Item<Parameter>, ModelError> {
    let section = entry.section(format!("parameter {}", shown(&entry.key)))?;
    let own = of_body.map(|k| body_parameter(&entry.key, k).item);
    let mut item = Parameter {
        name: entry.key.clone(),
        label: section.string("label")?.unwrap_or_else(|| entry.key.clone()),
        unit: section.unit()?,
        freedom: section.get("free").map_or(Ok(Freedom::Fixed), |free| freedom(free, inputs, lower))?,
        min: section.number("min")?.unwrap_or(own.as_ref().map_or(f64::NEG_INFINITY, |own| own.min)),
        max: section.number("max")?.unwrap_or(f64::INFINITY),
        prior_std: positive(&section, "prior_std", lower)?,
        candidate: section.string("candidate")?,
        text: section.string("text")?.unwrap_or_default(),
    };
    in_order(entry, item.min, item.max, lower.source)?;
    let value = match own {
        None => Some(section.require("value")?.expression()?),
        Some(own) => {
            if let Some(value) = section.get("value") {
                return lower.source.fault(value.key_at, Fault::FromVehicle(own.name));
            }
            if let (Some(wanted), Some(found)) = (own.unit, item.unit)
                && wanted != found
            {
                return lower.source.fault(entry.at, Fault::units(&own.name, wanted, found));
            }
            item.unit = own.unit;
            None
        }
    };
    section.finish()?;
    Ok(Item { item, at: entry.key_at, expressions: vec![value] })
}

fn in_order(entry: &Entry<'_>, min: f64, max: f64, source: Source<'_>) -> Result<(), ModelError> {
    if min < max {
        return Ok(());
    }
    let key = format!("max of {}", shown(&entry.key));
    source.fault(entry.at, Fault::Number { key, value: max, must: "be above min" })
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
    const WORDS: &str = "true, false, or one of { moved = [\"...\"] } and { unless_moved = [\"...\"] }";
    let other = |found: &str| {
        let (key, found) = ("free".to_owned(), found.to_owned());
        lower.source.fault(entry.at, Fault::Kind { key, wanted: WORDS, found })
    };
    if entry.value.as_table().is_none() {
        return other(entry.kind_in_words());
    }
    let section = entry.section("`free`".to_owned())?;
    let places = |key: &'static str| -> Result<Option<Vec<usize>>, ModelError> {
        let Some(list) = section.get(key) else { return Ok(None) };
        let place = |name: String| match inputs.iter().position(|i| i.item.name == name) {
            Some(k) => Ok(k),
            None => {
                let near = near(&name, inputs.iter().map(|i| i.item.name.as_str()));
                lower.source.fault(list.at, Fault::UnknownName { name: shown(&name), near })
            }
        };
        list.strings()?.into_iter().map(place).collect::<Result<Vec<usize>, ModelError>>().map(Some)
    };
    let (moved, unless) = (places("moved")?, places("unless_moved")?);
    section.finish()?;
    match (moved, unless) {
        (Some(inputs), None) => Ok(Freedom::WhereMoved(inputs)),
        (None, Some(inputs)) => Ok(Freedom::UnlessMoved(inputs)),
        (Some(_), Some(_)) => other("both"),
        (None, None) => other("empty"),
    }
}

fn state(entry: &Entry<'_>, lower: &Lower<'_>) -> Result<Item<FurtherState>, ModelError> {
    let section = entry.section(format!("state {}", shown(&entry.key)))?;
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
    let section = entry.section(format!("output {}", shown(&entry.key)))?;
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
    for section in sections_of(root, "table", "[[table]]", lower.source)? {
        let name = section.require("name")?;
        let (x, y) = (section.require("x")?.numbers()?, section.require("y")?.numbers()?);
        let unit = |key: &'static str| -> Result<Option<crate::unit::Unit>, ModelError> {
            let Some(entry) = section.get(key) else { return Ok(None) };
            let parsed = crate::unit::Unit::parse(&entry.string()?);
            parsed.map(Some).or_else(|part| lower.source.fault(entry.at, Fault::UnknownUnit(shown(&part))))
        };
        let units = [unit("x_unit")?, unit("unit")?];
        section.string("text")?;
        section.finish()?;
        let increases = x.windows(2).all(|w| w[0] < w[1]);
        if x.len() != y.len() || x.len() < 2 || x.len() > MOST_POINTS || !increases {
            return lower.source.fault(section.at, Fault::Table(shown(&name.string()?)));
        }
        lower.table(&name.string()?, name.at, Table { x, y }, units)?;
    }
    Ok(())
}
