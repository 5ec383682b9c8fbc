//! Logs of the aircraft: binary ones by their own readers, and tables; inputs from them by a mapping.

mod gyroscope;
mod inputs;
mod presets;
mod sensors;
mod units;

pub use gyroscope::{LogGyroscope, read_log_gyroscope};
pub use inputs::{LogInput, LogSection, TimeUnit, UnitOf, inputs_of, read_log_inputs, unit_by_model};
pub use presets::Preset;
pub use sensors::read_log_sensors;

use crate::table::{Row, Table};
use crate::tables::TIME_COLUMN;
use crate::{SessionError, error::require_file};
use mavsight_log::{Column, Log, Wanted};
use std::path::Path;

/// What names and times of a table are, where it is read as a log.
#[derive(Debug, Clone, Copy)]
pub struct TableTime<'a> {
    /// Column of the times.
    pub column: &'a str,
    /// Length of its unit, ns.
    pub unit_ns: i64,
}

const SECOND_NS: i64 = 1_000_000_000;

impl Default for TableTime<'_> {
    /// The column `t_s`, in seconds.
    fn default() -> Self {
        Self { column: TIME_COLUMN, unit_ns: SECOND_NS }
    }
}

/// Reads a log whose kind is seen from its content, or a table (`.csv`, `.parquet`) as a log of one topic
/// named `table`, of whose columns those of numbers are fields. What is wanted of a log is kept, and a table
/// whole.
///
/// # Errors
/// A file that is not there, or that no reader knows; what cannot be read of it, with the place.
pub fn read_log(path: &Path, time: TableTime<'_>, wanted: &Wanted<'_>) -> Result<Log, SessionError> {
    let is_table =
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv") || e.eq_ignore_ascii_case("parquet"));
    if is_table {
        return read_table(path, time);
    }
    require_file(path, "log")?;
    let mut file = std::fs::File::open(path).map_err(|e| SessionError::io(path, "read it", e))?;
    Log::read(&mut file, wanted).map_err(|source| SessionError::content(path, source))
}

/// Name of the one topic of a table.
pub const TABLE_TOPIC: &str = "table";

fn read_table(path: &Path, time: TableTime<'_>) -> Result<Log, SessionError> {
    let table = Table::read(path, "log")?;
    let place = table.column(time.column)?;
    let t_ns = |row: Row<'_>| {
        if time.unit_ns == SECOND_NS {
            return row.time_ns(place);
        }
        // Whole numbers digit by digit: nanoseconds since 1970 have more of them than a double.
        let whole = row.text(place).parse::<i64>().ok().and_then(|t| t.checked_mul(time.unit_ns));
        let t_ns = row.number(place)? * time.unit_ns as f64;
        whole.or_else(|| (t_ns.abs() < 9e18).then(|| t_ns.round() as i64)).ok_or_else(|| {
            row.refuse(place, "the time is beyond what nanoseconds can count: give another unit of the times")
        })
    };
    let times_ns = table.rows()?.map(t_ns).collect::<Result<Vec<i64>, _>>()?;
    let is_field = |(_, name): &(usize, &str)| !name.is_empty() && *name != time.column;
    // Words are no numbers, and a column of them no field.
    let columns = table.names().enumerate().filter(is_field).filter_map(|(place, name)| {
        let number = |row: Row<'_>| match row.text(place) {
            "" => Ok(f64::NAN),
            text if text.eq_ignore_ascii_case("nan") => Ok(f64::NAN),
            _ => row.number(place),
        };
        let values = table.rows_if_any().map(number).collect::<Result<Vec<f64>, _>>().ok()?;
        Some(Column::new(name, units::of_name(name), values))
    });
    Ok(Log::of_table(TABLE_TOPIC, &times_ns, columns.collect()))
}
