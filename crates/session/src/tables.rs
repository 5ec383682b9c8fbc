//! The tables of a session: inputs, control points and pixels.

use crate::SessionError;
use crate::table::Table;
use mavsight_flight::{Color, InputChannel, InputSample, InputSeries};
use mavsight_pipeline::{ControlPixel, ControlPointRow};
use std::path::Path;

/// Columns of the inputs.
pub(crate) const INPUT_COLUMNS: [&str; 5] =
    ["t_s", "omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"];

/// Columns of the control points.
pub(crate) const CONTROL_COLUMNS: [&str; 6] = ["name", "x_m", "y_m", "z_m", "diameter_m", "color"];

/// Column of the control points that may be left out.
pub(crate) const SURVEY_COLUMN: &str = "std_m";

/// Reads `t_s,omega_u_rad_s,omega_l_rad_s,delta_lon_rad,delta_lat_rad`; a table of another aircraft may have
/// none of the last four, which are then zero. Every other column that holds numbers alone is a channel that
/// models may name.
///
/// # Errors
/// Names the file, row and column; times must increase.
pub fn read_inputs(path: &Path) -> Result<InputSeries, SessionError> {
    let table = Table::read(path, "inputs")?;
    let own = &INPUT_COLUMNS[1..];
    let others: Vec<&str> = table.names().filter(|n| !n.is_empty() && !INPUT_COLUMNS.contains(n)).collect();
    let foreign = !others.is_empty() && own.iter().all(|name| table.column_if_any(name).is_none());
    let t = table.column(INPUT_COLUMNS[0])?;
    let columns = if foreign { None } else { Some(table.columns(INPUT_COLUMNS)?) };
    let mut samples = Vec::new();
    for row in table.rows()? {
        let [t_s, omega_u_rad_s, omega_l_rad_s, delta_lon_rad, delta_lat_rad] = match columns {
            Some(columns) => row.numbers(columns)?,
            None => [row.number(t)?, 0.0, 0.0, 0.0, 0.0],
        };
        samples.push(InputSample { t_s, omega_u_rad_s, omega_l_rad_s, delta_lon_rad, delta_lat_rad });
    }
    let channel = |name: &&str| {
        let column = table.column_if_any(name)?;
        let values: Result<Vec<f64>, _> = table.rows_if_any().map(|row| row.number(column)).collect();
        Some(InputChannel { name: (*name).to_owned(), values: values.ok()? })
    };
    let channels = others.iter().filter_map(channel).collect();
    InputSeries::new(samples)
        .and_then(|series| series.with_channels(channels))
        .map_err(|source| SessionError::Flight { path: path.to_owned(), source })
}

/// Reads `name,x_m,y_m,z_m,diameter_m,color` and, if it is there, `std_m`; an empty cell of it is 0.
///
/// # Errors
/// Names the file, row and column; names must be unique, colours `#rrggbb`.
pub fn read_control_points(path: &Path) -> Result<Vec<ControlPointRow>, SessionError> {
    let table = Table::read(path, "control points")?;
    let [name, x, y, z, diameter, color] = table.columns(CONTROL_COLUMNS)?;
    let std = table.column_if_any(SURVEY_COLUMN);
    let mut points: Vec<ControlPointRow> = Vec::new();
    for row in table.rows()? {
        let text = row.text(name);
        if text.is_empty() || points.iter().any(|p| p.name == text) {
            return Err(row.refuse(name, format!("{text:?} is empty or taken: give each point its own name")));
        }
        let diameter_m = row.number(diameter)?;
        if diameter_m < 0.0 {
            return Err(
                row.refuse(diameter, format!("{diameter_m} m is below zero: give the ball's diameter"))
            );
        }
        let std_m = match std {
            Some(column) => row.number_if_any(column)?.unwrap_or(0.0),
            None => 0.0,
        };
        if let Some(column) = std.filter(|_| std_m < 0.0) {
            let detail = format!("{std_m} m is below zero: give the standard deviation of each coordinate");
            return Err(row.refuse(column, detail));
        }
        points.push(ControlPointRow {
            std_m,
            name: text.to_owned(),
            position_m: row.numbers([x, y, z])?,
            diameter_m,
            color: Color::parse(row.text(color)).map_err(|e| row.refuse(color, e.to_string()))?,
        });
    }
    Ok(points)
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
        for (column, known) in [(camera, cameras), (name, names)] {
            if !known.contains(&row.text(column)) {
                let detail = format!("{:?} is not known: use one of {}", row.text(column), known.join(", "));
                return Err(row.refuse(column, detail));
            }
        }
        let pixel = ControlPixel {
            camera: row.text(camera).to_owned(),
            name: row.text(name).to_owned(),
            u_px: row.number(u)?,
            v_px: row.number(v)?,
        };
        if pixels.iter().any(|p| p.camera == pixel.camera && p.name == pixel.name) {
            return Err(
                row.refuse(name, format!("{} is there twice for {}: keep one", pixel.name, pixel.camera))
            );
        }
        pixels.push(pixel);
    }
    Ok(pixels)
}
