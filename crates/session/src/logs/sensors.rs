//! Sensors of a flight model from a log, by the same mapping as its inputs.

use super::{LogInput, LogSection, inputs_of, read_log};
use crate::SessionError;
use crate::foreign::Noted;
use mavsight_flight::SensorSeries;
use mavsight_model::Model;

/// The sensor of a model whose column an entry names.
fn is_sensor(model: &Model, input: &LogInput) -> bool {
    model.sensors.iter().any(|sensor| sensor.column == input.column)
}

impl LogSection {
    /// This without the entries that name sensors of a flight model: the inputs.
    #[must_use]
    pub fn without_sensors(&self, model: &Model) -> Self {
        let mut inputs = self.clone();
        inputs.input.retain(|input| !is_sensor(model, input));
        inputs
    }

    /// Whether an entry names a sensor of a flight model.
    pub fn names_sensors(&self, model: &Model) -> bool {
        self.input.iter().any(|input| is_sensor(model, input))
    }
}

/// Reads the samples of a flight model's sensors that a section names among its inputs, on the clock of the log; none
/// where it names none.
///
/// Each sensor keeps the times of its own stream, and a row has no sample of what was not sampled then. Samples that are no
/// numbers are left out, with a note.
///
/// # Errors
/// Those of [`read_log`] and of [`inputs_of`].
pub fn read_log_sensors(
    section: &LogSection,
    model: &Model,
) -> Result<Option<Noted<SensorSeries>>, SessionError> {
    if !section.names_sensors(model) {
        return Ok(None);
    }
    let mut own = LogSection { preset: None, ..section.clone() };
    own.input.retain(|input| is_sensor(model, input));
    let wanted = |topic: &str, instance: u32, field: &str| own.wants(topic, instance, field);
    let log = read_log(&own.file, own.table_time(), &wanted)?;
    let unit_of = |column: &str| model.sensors.iter().find(|s| s.column == column).and_then(|s| s.unit);
    let (mut columns, mut samples, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    for input in &own.input {
        let alone = LogSection { input: vec![input.clone()], ..own.clone() };
        let Noted { value, notes: own_notes } = inputs_of(&log, &alone, &unit_of)?;
        notes.extend(own_notes);
        let sample = |(k, t_s): (usize, &f64)| ((t_s * 1e9).round() as i64, value.row(k)[0]);
        samples.push(value.times_s().iter().enumerate().map(sample).collect::<Vec<_>>());
        columns.push(input.column.clone());
    }
    // What is to be said of the log is said with its inputs.
    notes.retain(|note| !log.notes.contains(note));
    let value = SensorSeries::of_samples(columns, &samples)
        .map_err(|source| SessionError::content(&own.file, source))?;
    Ok(Some(Noted { value, notes }))
}
