//! The tables of a session, both ways: inputs, control points and pixels.

use crate::SessionError;
use crate::table::{Table, write_csv};
use mavsight_flight::{Color, InputChannel, InputSample, InputSeries};
use mavsight_pipeline::{ControlPixel, ControlPointRow};
use std::path::Path;

const INPUT_COLUMNS: [&str; 5] = ["t_s", "omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"];

const CONTROL_COLUMNS: [&str; 6] = ["name", "x_m", "y_m", "z_m", "diameter_m", "color"];

/// Column of the control points that may be left out.
const SURVEY_COLUMN: &str = "std_m";

/// Reads `t_s,omega_u_rad_s,omega_l_rad_s,delta_lon_rad,delta_lat_rad`; a table of another aircraft may have
/// none of the last four, which are then zero. Every other column that holds numbers alone is a channel that
/// models may name.
///
/// # Errors
/// Names the file, row and column; times must increase.
pub fn read_inputs(path: &Path) -> Result<InputSeries, SessionError> {
    let table = Table::read(path, "inputs")?;
    let others: Vec<&str> = table.names().filter(|n| !n.is_empty() && !INPUT_COLUMNS.contains(n)).collect();
    let has_own = INPUT_COLUMNS[1..].iter().any(|name| table.column(name).is_ok());
    let t = table.column(INPUT_COLUMNS[0])?;
    let columns = if has_own || others.is_empty() { Some(table.columns(INPUT_COLUMNS)?) } else { None };
    let mut samples = Vec::new();
    for row in table.rows()? {
        let [t_s, omega_u_rad_s, omega_l_rad_s, delta_lon_rad, delta_lat_rad] = match columns {
            Some(columns) => row.numbers(columns)?,
            None => [row.number(t)?, 0.0, 0.0, 0.0, 0.0],
        };
        samples.push(InputSample { t_s, omega_u_rad_s, omega_l_rad_s, delta_lon_rad, delta_lat_rad });
    }
    let channel = |name: &&str| {
        let column = table.column(name).ok()?;
        let values: Result<Vec<f64>, _> = table.rows_if_any().map(|row| row.number(column)).collect();
        Some(InputChannel { name: (*name).to_owned(), values: values.ok()? })
    };
    let channels = others.iter().filter_map(channel).collect();
    InputSeries::new(samples)
        .and_then(|series| series.with_channels(channels))
        .map_err(|source| SessionError::content(path, source))
}

/// Writes recorded inputs.
///
/// # Errors
/// What the file system refuses.
pub fn write_inputs(path: &Path, inputs: &InputSeries) -> Result<(), SessionError> {
    let samples = inputs.samples().iter();
    let rows =
        samples.map(|s| vec![s.t_s, s.omega_u_rad_s, s.omega_l_rad_s, s.delta_lon_rad, s.delta_lat_rad]);
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
    write_csv(path, columns, rows.map(|row| row.iter().map(|x| format!("{x:.12}")).collect::<Vec<_>>()))
}

/// Reads `name,x_m,y_m,z_m,diameter_m,color` and, if it is there, `std_m`; an empty cell of it is 0.
///
/// # Errors
/// Names the file, row and column; names must be unique, colours `#rrggbb`.
pub fn read_control_points(path: &Path) -> Result<Vec<ControlPointRow>, SessionError> {
    let table = Table::read(path, "control points")?;
    let [name, x, y, z, diameter, color] = table.columns(CONTROL_COLUMNS)?;
    let std = table.column(SURVEY_COLUMN).ok();
    let mut points: Vec<ControlPointRow> = Vec::new();
    for row in table.rows()? {
        let text = row.text(name);
        if text.is_empty() || points.iter().any(|p| p.name == text) {
            return Err(row.refuse(name, format!("{text:?} is empty or taken: give each point its own name")));
        }
        let length = |column: usize, value_m: f64, what: &str| {
            let wrong = || row.refuse(column, format!("{value_m} m is below zero: give {what}"));
            if value_m < 0.0 { Err(wrong()) } else { Ok(value_m) }
        };
        let std_m = std.map_or(Ok(0.0), |column| {
            let std_m = row.number_if_any(column)?.unwrap_or(0.0);
            length(column, std_m, "the standard deviation of each coordinate")
        })?;
        points.push(ControlPointRow {
            std_m,
            name: text.to_owned(),
            position_m: row.numbers([x, y, z])?,
            diameter_m: length(diameter, row.number(diameter)?, "the ball's diameter")?,
            color: Color::parse(row.text(color)).map_err(|e| row.refuse(color, e.to_string()))?,
        });
    }
    Ok(points)
}

/// Writes surveyed control points.
///
/// # Errors
/// What the file system refuses.
pub fn write_control_points(path: &Path, points: &[ControlPointRow]) -> Result<(), SessionError> {
    let surveyed = points.iter().any(|p| p.std_m > 0.0);
    let rows = points.iter().map(|p| {
        let [x, y, z] = p.position_m.map(|v| v.to_string());
        let mut cells = vec![p.name.clone(), x, y, z, p.diameter_m.to_string(), p.color.to_string()];
        cells.extend(surveyed.then(|| p.std_m.to_string()));
        cells
    });
    write_csv(path, CONTROL_COLUMNS.into_iter().chain(surveyed.then_some(SURVEY_COLUMN)), rows)
}

/// Reads `camera,name,u_px,v_px`; every camera and name must be among those given.
///
/// # Errors
/// Names the file, row and column.
pub fn read_control_pixels(
    path: &Path,
    cameras: &[&str],
    names: &[&str],
) -> Result<Vec<ControlPixel>, SessionError> {
    let table = Table::read(path, "control pixels")?;
    let [camera, name, u, v] = table.columns(["camera", "name", "u_px", "v_px"])?;
    let mut pixels: Vec<ControlPixel> = Vec::new();
    for row in table.rows()? {
        row.place_in(camera, cameras)?;
        row.place_in(name, names)?;
        let [u_px, v_px] = row.numbers([u, v])?;
        let pixel =
            ControlPixel { camera: row.text(camera).to_owned(), name: row.text(name).to_owned(), u_px, v_px };
        if pixels.iter().any(|p| p.camera == pixel.camera && p.name == pixel.name) {
            let detail = format!("{} is there twice for {}: keep one", pixel.name, pixel.camera);
            return Err(row.refuse(name, detail));
        }
        pixels.push(pixel);
    }
    Ok(pixels)
}
