//! Inputs from a log by a mapping: which field is which input.

use super::{Preset, TableTime, read_log, units};
use crate::SessionError;
use crate::foreign::Noted;
use mavsight_flight::{InputSeries, Interpolation};
use mavsight_log::{Column, Log, LogError, Stream};
use mavsight_model::{Model, Unit};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The log of a session, and which of its fields are inputs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogSection {
    /// The log, or a table.
    pub file: PathBuf,
    /// Inputs of a known program; those of `input` are added, or take the place of one of their column.
    pub preset: Option<Preset>,
    /// Which of several topics of one name the preset takes.
    pub instance: Option<u32>,
    /// Column of the times of a table; left out: `t_s`.
    pub time: Option<String>,
    /// Unit of the times of a table.
    #[serde(default)]
    pub time_unit: TimeUnit,
    /// Inputs, each with its field.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input: Vec<LogInput>,
}

/// The unit of times.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// Seconds.
    #[default]
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
}

/// An input, and the field that it is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogInput {
    /// Column of the inputs, as the flight model names it.
    pub column: String,
    /// Topic; may be left out where one topic alone has the field.
    pub topic: Option<String>,
    /// Which of several topics of that name.
    pub instance: Option<u32>,
    /// Field, as the log names it.
    pub field: String,
    /// Unit of the field, where the log does not say it, or says it wrongly.
    pub unit: Option<String>,
    /// By what the field is multiplied; left out: its unit is converted to that of the input.
    pub scale: Option<f64>,
    /// What is added after that.
    #[serde(default)]
    pub offset: f64,
    /// How it goes from one sample to the next.
    #[serde(default)]
    pub interpolation: Interpolation,
}

/// The unit that an input must have; `None` where it is not said.
pub type UnitOf<'a> = dyn Fn(&str) -> Option<Unit> + 'a;

impl LogSection {
    /// Whether it has inputs, and not the log alone.
    pub fn has_inputs(&self) -> bool {
        self.preset.is_some() || !self.input.is_empty()
    }

    /// How the times of a table are written.
    pub fn table_time(&self) -> TableTime<'_> {
        let unit_ns = match self.time_unit {
            TimeUnit::S => 1_000_000_000,
            TimeUnit::Ms => 1_000_000,
            TimeUnit::Us => 1000,
            TimeUnit::Ns => 1,
        };
        self.time
            .as_deref()
            .map_or(TableTime { unit_ns, ..TableTime::default() }, |column| TableTime { column, unit_ns })
    }

    pub(super) fn wants(&self, topic: &str, instance: u32, field: &str) -> bool {
        let is_one = |input: &LogInput| {
            input.field == field
                && input.topic.as_deref().is_none_or(|t| t == topic)
                && input.instance.is_none_or(|i| i == instance)
        };
        let of_preset = |preset: Preset| {
            preset.number(topic, instance, field).is_some() && self.instance.is_none_or(|i| i == instance)
        };
        self.preset.is_some_and(of_preset) || self.input.iter().any(is_one)
    }
}

/// Reads the inputs that a section names, on the clock of the log.
///
/// # Errors
/// Those of [`read_log`] and of [`inputs_of`], with the file.
pub fn read_log_inputs(
    section: &LogSection,
    unit_of: &UnitOf<'_>,
) -> Result<Noted<InputSeries>, SessionError> {
    let wanted = |topic: &str, instance: u32, field: &str| section.wants(topic, instance, field);
    let log = read_log(&section.file, section.table_time(), &wanted)?;
    inputs_of(&log, section, unit_of)
}

/// The inputs of a log of which what the section names has been kept.
///
/// Rows are at the time of every sample of any of them, from where all have begun to where the first ends: what
/// holds then holds on, and what moves on a line is on it, and nothing is resampled.
///
/// # Errors
/// With the input: a topic, an instance or a field that is not there or not one alone, times that run
/// backwards, a unit that is not said or another than the input's, a field without a number; inputs that have
/// no time in common, names that are there twice.
pub fn inputs_of(
    log: &Log,
    section: &LogSection,
    unit_of: &UnitOf<'_>,
) -> Result<Noted<InputSeries>, SessionError> {
    let path = &section.file;
    let mut notes = log.notes.clone();
    let mut inputs = Vec::new();
    if let Some(preset) = section.preset {
        inputs = preset.inputs(log, section.instance);
        if inputs.is_empty() {
            let known = Preset::ALL.iter().filter(|(_, preset)| preset.is_of(log)).map(|(name, _)| *name);
            let known = known.collect::<Vec<_>>().join(", ");
            let detail = format!("the log has nothing that it takes; presets of which it has: {known}");
            return Err(SessionError::value(path, format!("preset {}", preset.name()), detail));
        }
        inputs.retain(|input| !section.input.iter().any(|own| own.column == input.column));
        drop_unused(log, &mut inputs, &mut notes);
    }
    inputs.extend(section.input.iter().cloned());
    let (mut samples, mut shifts) = (Vec::new(), Vec::new());
    for input in &inputs {
        let refuse =
            |error: LogError| SessionError::value(path, format!("input {}", input.column), error.to_string());
        let (stream, column) =
            log.column(input.topic.as_deref(), input.instance, &input.field).map_err(refuse)?;
        let factor = factor(input, column, unit_of)
            .map_err(|detail| SessionError::value(path, format!("input {}", input.column), detail))?;
        samples.push(Samples::of(stream, column));
        shifts.push((factor, input.offset));
        let missing = column.values().filter(|v| !v.is_finite()).count();
        if missing > 0 {
            let count = stream.times_ns.len();
            notes.push(format!(
                "{}: {missing} of {count} samples are no numbers, and are left out",
                input.column
            ));
        }
    }
    let interpolation: Vec<Interpolation> = inputs.iter().map(|input| input.interpolation).collect();
    let (times_s, values) = merged(samples, &shifts, &interpolation).map_err(|(input, detail)| {
        SessionError::value(path, format!("input {}", inputs[input].column), detail)
    })?;
    let names: Vec<String> = inputs.into_iter().map(|input| input.column).collect();
    let value = InputSeries::interpolated(names, times_s, values, &interpolation)
        .map_err(|source| SessionError::content(path, source))?;
    Ok(Noted { value, notes })
}

/// Leaves out what a preset found and the aircraft does not use: it is zero, or no number, throughout.
fn drop_unused(log: &Log, inputs: &mut Vec<LogInput>, notes: &mut Vec<String>) {
    let mut unused = Vec::new();
    inputs.retain(|input| {
        let Ok((_, column)) = log.column(input.topic.as_deref(), input.instance, &input.field) else {
            return true;
        };
        let is_used = column.values().any(|v| v.is_finite() && v != 0.0);
        if !is_used {
            unused.push(input.column.clone());
        }
        is_used
    });
    // Where none is used they are what was asked for.
    if !unused.is_empty() {
        notes.push(format!("{}: zero or no number throughout, and left out", unused.join(", ")));
    }
}

/// The unit in which an input must be.
struct WantedUnit {
    unit: Unit,
    /// In SI.
    size: f64,
    text: String,
}

impl WantedUnit {
    /// Of a model's input that of the model, which is of SI; of another that with which its name ends; `None` where neither
    /// says it.
    fn of(column: &str, unit_of: &UnitOf<'_>) -> Option<Self> {
        let named = units::of_name(column).and_then(|text| {
            let (size, unit) = units::in_si(text)?;
            Some(Self { unit, size, text: text.to_owned() })
        });
        let Some(unit) = unit_of(column) else { return named };
        let is_same = |named: &Self| named.unit == unit && named.size == 1.0;
        Some(named.filter(is_same).unwrap_or_else(|| Self { unit, size: 1.0, text: unit.to_string() }))
    }
}

/// By what a field is multiplied to be the input.
fn factor(input: &LogInput, column: &Column, unit_of: &UnitOf<'_>) -> Result<f64, String> {
    let remedy = "give `scale`, by which it is multiplied";
    match (input.scale, WantedUnit::of(&input.column, unit_of)) {
        (Some(scale), _) if scale.is_finite() && scale != 0.0 => Ok(scale),
        (Some(scale), _) => Err(format!("scale is {scale}: give a number that is not 0")),
        (None, None) => Ok(1.0),
        (None, Some(WantedUnit { unit: wanted, size, text: as_said })) => {
            let field = &input.field;
            let Some(text) = input.unit.as_ref().or(column.unit.as_ref()) else {
                return Err(format!(
                    "the input is in {as_said}, and the log does not say the unit of {field}: give its `unit`, or {remedy}"
                ));
            };
            match units::in_si(text) {
                Some((factor, unit)) if unit == wanted => Ok(factor / size),
                Some((_, unit)) => Err(format!(
                    "the input is in {as_said}, but {field} is in {text}, which is {unit} in SI: name another field, or {remedy}"
                )),
                None => Err(format!("{field} is in {text:?}, which is no known unit: {remedy}")),
            }
        }
    }
}

/// The samples of an input that are numbers, while they are merged with those of others.
struct Samples<'a> {
    times_ns: &'a [i64],
    column: &'a Column,
    /// Which samples are numbers, where not all are.
    numbers: Option<Vec<usize>>,
    /// The sample that holds, of those that are numbers.
    at: usize,
}

impl<'a> Samples<'a> {
    fn of(stream: &'a Stream, column: &'a Column) -> Self {
        let numbers = column.values().any(|v| !v.is_finite()).then(|| {
            let numbers = column.values().enumerate().filter(|(_, value)| value.is_finite());
            numbers.map(|(k, _)| k).collect()
        });
        Self { times_ns: &stream.times_ns, column, numbers, at: 0 }
    }

    /// Time and value of a sample, of those that are numbers.
    fn sample(&self, k: usize) -> Option<(i64, f64)> {
        let k = self.numbers.as_ref().map_or(Some(k), |numbers| numbers.get(k).copied())?;
        Some((*self.times_ns.get(k)?, self.column.value(k)))
    }

    /// Times of the first and the last.
    fn span_ns(&self) -> Option<[i64; 2]> {
        let last = self.numbers.as_ref().map_or(self.times_ns.len(), Vec::len).checked_sub(1)?;
        Some([self.sample(0)?.0, self.sample(last)?.0])
    }

    /// Goes on to the sample that holds at a time; the time of the next.
    fn advance(&mut self, t_ns: i64) -> Option<i64> {
        loop {
            let (next_ns, _) = self.sample(self.at + 1)?;
            if next_ns > t_ns {
                return Some(next_ns);
            }
            self.at += 1;
        }
    }

    /// The value at a time at or after that of the sample that holds.
    fn value(&self, t_ns: i64, interpolation: Interpolation) -> f64 {
        let Some((from_ns, from)) = self.sample(self.at) else { return f64::NAN };
        match (interpolation, self.sample(self.at + 1)) {
            (Interpolation::Linear, Some((next_ns, next))) => {
                let share = (t_ns - from_ns) as f64 / (next_ns - from_ns) as f64;
                from + (next - from) * share
            }
            _ => from,
        }
    }
}

/// Times and row after row of values.
type Rows = (Vec<f64>, Vec<f64>);

/// All inputs at the times of all samples; an error has the place of the input.
fn merged(
    mut all: Vec<Samples<'_>>,
    shifts: &[(f64, f64)],
    interpolation: &[Interpolation],
) -> Result<Rows, (usize, String)> {
    let (mut start_ns, mut end) = (i64::MIN, (i64::MAX, 0));
    for (k, samples) in all.iter().enumerate() {
        let Some([first_ns, last_ns]) = samples.span_ns() else {
            return Err((k, "its field has no sample that is a number: name another".to_owned()));
        };
        start_ns = start_ns.max(first_ns);
        end = end.min((last_ns, k));
    }
    if start_ns >= end.0 {
        let [from_s, to_s] = [start_ns, end.0].map(|t| t as f64 * 1e-9);
        let detail = format!(
            "it ends at {to_s:.3} s, and another begins at {from_s:.3} s: name fields that were logged together"
        );
        return Err((end.1, detail));
    }
    let rows = all.iter().map(|samples| samples.times_ns.len()).max().unwrap_or(0);
    let (mut times_s, mut values) = (Vec::with_capacity(rows), Vec::with_capacity(rows * all.len()));
    let mut t_ns = Some(start_ns);
    while let Some(now_ns) = t_ns.filter(|t| *t <= end.0) {
        t_ns = all.iter_mut().filter_map(|samples| samples.advance(now_ns)).min();
        times_s.push(now_ns as f64 * 1e-9);
        for ((samples, (factor, offset)), interpolation) in all.iter().zip(shifts).zip(interpolation) {
            values.push(samples.value(now_ns, *interpolation) * factor + offset);
        }
    }
    Ok((times_s, values))
}

/// The unit that a flight model gives an input, by its column.
pub fn unit_by_model<'a>(model: &'a Model) -> impl Fn(&str) -> Option<Unit> + 'a {
    |column| model.inputs.iter().find(|input| input.column == column).and_then(|input| input.unit)
}

impl LogSection {
    /// Refuses what cannot be meant.
    pub(crate) fn validate(&self, path: &Path) -> Result<(), SessionError> {
        for (k, input) in self.input.iter().enumerate() {
            let is_free = !self.input[..k].iter().any(|other| other.column == input.column);
            if input.column.is_empty() || !is_free {
                let detail =
                    format!("{:?} is empty or taken: give each input the column of one", input.column);
                return Err(SessionError::value(path, format!("log.input {}: column", k + 1), detail));
            }
        }
        Ok(())
    }
}
