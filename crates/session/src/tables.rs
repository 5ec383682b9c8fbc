//! The tables of a session, both ways: inputs, sensors, control points and pixels.

use crate::SessionError;
use crate::files::PartFile;
use crate::table::{Row, Table, csv_lines, write_csv};
use mavsight_flight::{Color, InputSeries, SensorSeries, Vehicle};
use mavsight_model::Model;
use mavsight_pipeline::{CLICKED_STD_PX, ControlPixel, ControlPointRow};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Column of the times.
pub(crate) const TIME_COLUMN: &str = "t_s";

/// Largest diameter, and largest standard deviation of a coordinate, of a control ball; a larger number is in another unit.
const LONGEST_M: f64 = 2.0;
const CONTROL_COLUMNS: [&str; 6] = ["name", "x_m", "y_m", "z_m", "diameter_m", "color"];

/// Column of the control points that may be left out.
const SURVEY_COLUMN: &str = "std_m";

/// Reads `t_s` and every other column that holds numbers alone, in the order of the table. A table with any
/// of the columns that the vehicle's model reads ([`Vehicle::input_columns`]), or with no other column, must
/// have them all.
///
/// # Errors
/// Names the file, row and column; a column of the model that is not there, with those that are; times must
/// increase.
pub fn read_inputs(path: &Path, vehicle: &Vehicle) -> Result<InputSeries, SessionError> {
    let table = Table::read(path, "inputs")?;
    let own = vehicle.input_columns();
    let is_other = |name: &str| !name.is_empty() && name != TIME_COLUMN;
    let other_alone = table.names().any(is_other) && !table.names().any(|name| own.contains(&name));
    let needed: &[&str] = if other_alone { &[] } else { &own };
    let time = table.column(TIME_COLUMN)?;
    let times_s = table.rows()?.map(|row| row.number(time)).collect::<Result<Vec<f64>, _>>()?;
    for name in needed {
        table.column(name)?;
    }
    let (names, values) =
        columns_of_numbers(&table, |name| needed.contains(&name), |row, place| row.number(place))?;
    InputSeries::new(names, times_s, values).map_err(|source| SessionError::content(path, source))
}

/// Reads `t_s` and the columns of a model's sensors, in its order. A cell that is empty or `nan` has no
/// sample.
///
/// # Errors
/// Names the file, row and column; a model without sensors; a column of a sensor that is not there, with the
/// nearest; times must increase.
pub fn read_sensors(path: &Path, model: &Model) -> Result<SensorSeries, SessionError> {
    let table = Table::read(path, "sensors")?;
    let time = table.column(TIME_COLUMN)?;
    let times_ns = table.rows()?.map(|row| row.time_ns(time)).collect::<Result<Vec<i64>, _>>()?;
    let is_empty = |text: &str| text.is_empty() || text.eq_ignore_ascii_case("nan");
    let is_needed = |name: &str| model.sensors.iter().any(|s| s.column == name);
    let (names, values) = columns_of_numbers(&table, is_needed, |row, place| {
        if is_empty(row.text(place)) { Ok(f64::NAN) } else { row.number(place) }
    })?;
    let all = SensorSeries::new(names, times_ns, values).and_then(|all| all.of(model));
    all.map_err(|source| SessionError::content(path, source))
}

/// Names of the columns besides the time that hold numbers alone, and their values row by row. Others hold words, or are
/// of a log with empty cells; one that is needed is refused.
fn columns_of_numbers(
    table: &Table,
    is_needed: impl Fn(&str) -> bool,
    number: impl Fn(Row<'_>, usize) -> Result<f64, SessionError>,
) -> Result<(Vec<String>, Vec<f64>), SessionError> {
    let (mut names, mut columns) = (Vec::new(), Vec::new());
    for (place, name) in table.names().enumerate().filter(|(_, n)| !n.is_empty() && *n != TIME_COLUMN) {
        match table.rows()?.map(|row| number(row, place)).collect::<Result<Vec<f64>, _>>() {
            Ok(values) => {
                names.push(name.to_owned());
                columns.push(values);
            }
            Err(broken) if is_needed(name) => return Err(broken),
            Err(_) => {}
        }
    }
    let rows = columns.first().map_or(0, Vec::len);
    let row = |k: usize| columns.iter().map(move |values| values[k]);
    Ok((names, (0..rows).flat_map(row).collect()))
}

/// Writes recorded inputs: their times, and every column under its name.
///
/// # Errors
/// What the file system refuses.
pub fn write_inputs(path: &Path, inputs: &InputSeries) -> Result<(), SessionError> {
    let header: Vec<&str> =
        std::iter::once(TIME_COLUMN).chain(inputs.names().iter().map(String::as_str)).collect();
    let rows = inputs.times_s().iter().enumerate();
    let rows = rows.map(|(k, t_s)| std::iter::once(*t_s).chain(inputs.row(k).iter().copied()).collect());
    write_numbers(path, &header, rows)
}

/// Writes samples of sensors: their times, and every column under its name.
///
/// # Errors
/// What the file system refuses.
pub fn write_sensors(path: &Path, sensors: &SensorSeries) -> Result<(), SessionError> {
    let header: Vec<&str> =
        std::iter::once(TIME_COLUMN).chain(sensors.columns().iter().map(String::as_str)).collect();
    let rows = sensors.times_ns().iter().enumerate();
    let rows = rows.map(|(k, t_ns)| {
        std::iter::once(*t_ns as f64 * 1e-9).chain(sensors.row(k).iter().copied()).collect()
    });
    write_numbers(path, &header, rows)
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
    // Numbers need no quotes, and a long log has millions of them.
    let write = |out: &mut dyn Write| {
        csv_lines(out, columns)?.flush()?;
        let mut line = String::new();
        for row in rows {
            line.clear();
            for (k, number) in row.iter().enumerate() {
                line.push_str(if k == 0 { "" } else { "," });
                push_fixed(&mut line, *number);
            }
            line.push('\n');
            out.write_all(line.as_bytes())?;
        }
        Ok(())
    };
    PartFile::write(path, write)?.keep()
}

/// Appends a number with twelve decimals, by whole numbers, which take half the time of `{:.12}`; numbers that have
/// no digit behind the point, and what is no number, by that.
fn push_fixed(line: &mut String, number: f64) {
    const DECIMALS: f64 = 1e12;
    const WHOLE: f64 = (1_u64 << f64::MANTISSA_DIGITS) as f64;
    let size = number.abs();
    // A text takes whatever is written.
    if !number.is_finite() || size >= WHOLE {
        let _ = write!(line, "{number:.12}");
        return;
    }
    let sign = if number.is_sign_negative() { "-" } else { "" };
    let rest = ((size - size.trunc()) * DECIMALS).round();
    let (whole, rest) = if rest < DECIMALS { (size.trunc(), rest) } else { (size.trunc() + 1.0, 0.0) };
    let _ = write!(line, "{sign}{}.{:012}", whole as u64, rest as u64);
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
            let long = || {
                row.refuse(column, format!("{value_m} m is too long for {what}: give all lengths in metres"))
            };
            match value_m {
                0.0..=LONGEST_M => Ok(value_m),
                LONGEST_M.. => Err(long()),
                _ => Err(wrong()),
            }
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

/// Reads `camera,name,u_px,v_px` and, if it is there, `std_px`; every camera and name must be among those given.
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
    let std = table.column("std_px").ok();
    let mut pixels: Vec<ControlPixel> = Vec::new();
    for row in table.rows()? {
        row.place_in(camera, cameras)?;
        row.place_in(name, names)?;
        let [u_px, v_px] = row.numbers([u, v])?;
        let std_px = std.map_or(Ok(None), |column| match row.number_if_any(column)? {
            Some(std_px) if std_px <= 0.0 => {
                Err(row.refuse(column, "no click is exact: give what is above 0"))
            }
            given => Ok(given),
        })?;
        let (of, point) = (row.text(camera).to_owned(), row.text(name).to_owned());
        let std_px = std_px.unwrap_or(CLICKED_STD_PX);
        let pixel = ControlPixel { camera: of, name: point, u_px, v_px, std_px };
        if pixels.iter().any(|p| p.camera == pixel.camera && p.name == pixel.name) {
            let detail = format!("{} is there twice for {}: keep one", pixel.name, pixel.camera);
            return Err(row.refuse(name, detail));
        }
        pixels.push(pixel);
    }
    Ok(pixels)
}

/// Writes control pixels.
///
/// # Errors
/// What the file system refuses.
pub fn write_control_pixels(path: &Path, pixels: &[ControlPixel]) -> Result<(), SessionError> {
    let digits = |px: f64| format!("{px:.4}");
    let row = |p: &ControlPixel| {
        [p.camera.clone(), p.name.clone(), digits(p.u_px), digits(p.v_px), digits(p.std_px)]
    };
    write_csv(path, ["camera", "name", "u_px", "v_px", "std_px"], pixels.iter().map(row))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_the_library_writes_them() {
        let written = |number: f64| {
            let mut line = String::new();
            push_fixed(&mut line, number);
            line
        };
        let exact = [0.0, -0.0, 1100.0, -2.5, 1.0 - 1e-13, 999.999_999_999_999_9, 1e300, 9.1e15, f64::NAN];
        for number in exact.into_iter().chain([f64::INFINITY, f64::NEG_INFINITY]) {
            assert_eq!(written(number), format!("{number:.12}"));
        }
        for k in 0..1000 {
            let number = (f64::from(k) * 0.37 - 90.0) * f64::exp(f64::from(k % 40) - 20.0);
            let [own, library]: [f64; 2] =
                [written(number), format!("{number:.12}")].map(|text| text.parse().expect("a number"));
            assert!((own - library).abs() <= 1.01e-12 + 2e-16 * number.abs(), "{number}");
        }
    }
}
