//! Files that a simulated flight leaves.

use crate::table::csv_cell;
use crate::tables::{CONTROL_COLUMNS, INPUT_COLUMNS, SURVEY_COLUMN};
use crate::{SessionError, SessionFile, write_whole};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_pipeline::ControlPointRow;
use std::path::Path;

/// Writes recorded inputs.
///
/// # Errors
/// What the file system refuses.
pub fn write_inputs(path: &Path, inputs: &InputSeries) -> Result<(), SessionError> {
    let rows = inputs
        .samples()
        .iter()
        .map(|s| vec![s.t_s, s.omega_u_rad_s, s.omega_l_rad_s, s.delta_lon_rad, s.delta_lat_rad]);
    write_numbers(path, &INPUT_COLUMNS, rows)
}

/// Writes a table of numbers with twelve decimals: a picometre, and beyond what any reader of these tables
/// resolves.
///
/// # Errors
/// What the file system refuses.
pub fn write_numbers(
    path: &Path,
    columns: &[&str],
    rows: impl Iterator<Item = Vec<f64>>,
) -> Result<(), SessionError> {
    let mut text = columns.join(",") + "\n";
    for row in rows {
        let cells: Vec<String> = row.iter().map(|x| format!("{x:.12}")).collect();
        text += &cells.join(",");
        text.push('\n');
    }
    write_whole(path, text.as_bytes())
}

/// Writes surveyed control points.
///
/// # Errors
/// What the file system refuses.
pub fn write_control_points(path: &Path, points: &[ControlPointRow]) -> Result<(), SessionError> {
    let surveyed = points.iter().any(|p| p.std_m > 0.0);
    let mut columns = CONTROL_COLUMNS.to_vec();
    columns.extend(surveyed.then_some(SURVEY_COLUMN));
    let mut text = columns.join(",") + "\n";
    for p in points {
        let [x, y, z] = p.position_m;
        let std = if surveyed { format!(",{}", p.std_m) } else { String::new() };
        let name = csv_cell(&p.name);
        text += &format!("{name},{x},{y},{z},{},{}{std}\n", p.diameter_m, p.color);
    }
    write_whole(path, text.as_bytes())
}

/// Writes a vehicle file.
///
/// # Errors
/// What the file system refuses.
pub fn write_vehicle(path: &Path, vehicle: &Vehicle) -> Result<(), SessionError> {
    write_toml(path, vehicle)
}

/// Writes a session file; its paths are written as given, relative ones relative to the file.
///
/// # Errors
/// What the file system refuses.
pub fn write_session(path: &Path, session: &SessionFile) -> Result<(), SessionError> {
    write_toml(path, session)
}

/// Writes anything as TOML.
pub(crate) fn write_toml(path: &Path, value: &impl serde::Serialize) -> Result<(), SessionError> {
    let text = toml::to_string(value)
        .map_err(|e| SessionError::io(path, "express it as TOML", std::io::Error::other(e.to_string())))?;
    write_whole(path, text.as_bytes())
}
