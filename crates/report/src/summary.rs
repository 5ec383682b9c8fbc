//! A list of figures, for people and for machines.

use mavsight_session::RESULTS_SCHEMA;
use serde_json::{Map, Value, json};

/// One figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Group, also the key of the JSON object that holds it.
    pub section: &'static str,
    /// Key in the JSON object.
    pub key: String,
    /// What it is, for people.
    pub label: String,
    /// For machines, in the unit that the key ends in.
    pub value: Value,
    /// For people; empty where the figure is for machines alone.
    pub shown: String,
}

/// All figures of a run, with verdicts and notes.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Figures in order.
    pub rows: Vec<Row>,
    /// Verdicts on identifiability.
    pub verdicts: Vec<String>,
    /// What could not be had, and why.
    pub notes: Vec<String>,
    /// What to mend, most harmful first.
    pub advice: Vec<crate::Advice>,
    /// What is wrong with cameras, recordings and files: `causes`, one where it is decided; `camera`, its
    /// name; `note`.
    pub findings: Vec<Value>,
}

pub(crate) struct Section<'a> {
    name: &'static str,
    /// Before the keys and the labels of one camera, marker or fit.
    prefixes: Option<(String, String)>,
    rows: &'a mut Vec<Row>,
}

impl Section<'_> {
    pub(crate) fn add(
        &mut self,
        key: impl Into<String>,
        label: impl Into<String>,
        value: impl Into<Value>,
        shown: impl Into<String>,
    ) {
        let (mut key, mut label) = (key.into(), label.into());
        if let Some((of_key, of_label)) = &self.prefixes {
            (key, label) = (format!("{of_key}_{key}"), format!("{of_label} {label}").trim_end().to_owned());
        }
        self.rows.push(Row { section: self.name, key, label, value: value.into(), shown: shown.into() });
    }

    /// A figure for machines alone.
    pub(crate) fn hidden(&mut self, key: impl Into<String>, value: impl Into<Value>) {
        self.add(key, "", value, "");
    }

    /// A number with its unit.
    pub(crate) fn number(&mut self, key: &str, label: impl Into<String>, value: f64, unit: &str) {
        let is_plain = value == 0.0 || (1e-2..1e5).contains(&value.abs());
        let shown = if is_plain { format!("{value:.3} {unit}") } else { format!("{value:.3e} {unit}") };
        self.add(key, label, value, shown.trim_end());
    }

    /// Three numbers of one unit.
    pub(crate) fn triple(&mut self, key: &str, label: &str, values: [f64; 3], unit: &str) {
        self.add(key, label, json!(values), format!("{} {unit}", listed(&values, 3)));
    }
}

/// Numbers with some decimals and commas between them.
pub(crate) fn listed(values: &[f64], decimals: usize) -> String {
    values.iter().map(|v| format!("{v:.decimals$}")).collect::<Vec<_>>().join(", ")
}

impl Summary {
    /// A section to add figures to.
    pub(crate) fn section(&mut self, name: &'static str) -> Section<'_> {
        Section { name, prefixes: None, rows: &mut self.rows }
    }

    /// A section whose keys and labels all begin with those of one camera, marker or fit.
    pub(crate) fn section_of(&mut self, name: &'static str, key: &str, label: &str) -> Section<'_> {
        Section { name, prefixes: Some((key.to_owned(), label.to_owned())), rows: &mut self.rows }
    }

    /// The rows that people see; parameters have tables of their own.
    pub(crate) fn shown(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|r| !r.shown.is_empty() && r.section != "parameters")
    }

    /// For machines: one object a section, with the schema's version.
    pub fn json(&self) -> Value {
        let mut sections: Map<String, Value> = Map::new();
        sections.insert("schema".to_owned(), json!(RESULTS_SCHEMA));
        for row in &self.rows {
            let section = sections.entry(row.section).or_insert_with(|| json!({}));
            if let Some(object) = section.as_object_mut() {
                object.insert(row.key.clone(), row.value.clone());
            }
        }
        sections.insert("verdicts".to_owned(), json!(self.verdicts));
        sections.insert("notes".to_owned(), json!(self.notes));
        sections.insert("findings".to_owned(), json!(self.findings));
        Value::Object(sections)
    }

    /// The figure of a section and a key, as people see it.
    pub(crate) fn figure(&self, section: &str, key: &str) -> Option<&Row> {
        self.rows.iter().find(|r| r.section == section && r.key == key)
    }

    /// For people: aligned text.
    pub fn text(&self) -> String {
        let width = self.shown().map(|r| r.label.chars().count()).max().unwrap_or(0);
        let mut out = String::new();
        let mut section = "";
        for row in self.shown() {
            if row.section != section {
                section = row.section;
                out += &format!("\n{}\n", title(section));
            }
            let pad = " ".repeat(width - row.label.chars().count());
            out += &format!("  {}{pad}  {}\n", row.label, row.shown);
        }
        for (heading, lines) in [("Verdict", &self.verdicts), ("Notes", &self.notes)] {
            if !lines.is_empty() {
                out += &format!("\n{heading}\n");
                lines.iter().for_each(|line| out += &format!("  {line}\n"));
            }
        }
        out
    }
}

/// A section's heading.
pub(crate) fn title(section: &str) -> &'static str {
    match section {
        "cameras" => "Cameras",
        "time" => "Time",
        "body" => "Body as built (its axes: no common shift or turn against the vehicle file)",
        "poses" => "Single poses",
        "health" => "How well the cameras see the markers",
        "plan" => "For the room file of the next plan",
        "motion" => "Smoothed motion",
        "fit" => "Fit",
        "parameters" => "Parameters",
        _ => "Against truth",
    }
}
