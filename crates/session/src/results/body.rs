//! The body as built: `body.csv`.

use super::columns;
use crate::SessionError;
use crate::table::Table;
use mavsight_geometry::Vector3;
use std::path::Path;

/// A marker as the flight has shown it.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerAsBuilt {
    /// Its name.
    pub name: String,
    /// Centre, body axes. These are the axes for which the markers together are neither shifted nor turned
    /// against the vehicle file (least squares): a film shows the shape of the body, not where its axes lie
    /// in it.
    pub position_m: Vector3<f64>,
    /// Standard deviation of each coordinate.
    pub position_std_m: Vector3<f64>,
    /// Diameter: measured, or that of the vehicle file.
    pub diameter_m: f64,
    /// Standard deviation of a measured diameter.
    pub diameter_std_m: Option<f64>,
}

/// A row of the table.
pub(super) fn row(marker: &MarkerAsBuilt) -> Vec<String> {
    let numbers = marker.position_m.iter().chain(marker.position_std_m.iter()).chain([&marker.diameter_m]);
    let mut cells = vec![marker.name.clone()];
    cells.extend(numbers.map(|x| format!("{x:?}")));
    cells.push(marker.diameter_std_m.map_or(String::new(), |x| format!("{x:?}")));
    cells
}

/// Reads `body.csv`.
///
/// # Errors
/// Names the file, row and column.
pub fn read_body(path: &Path) -> Result<Vec<MarkerAsBuilt>, SessionError> {
    let table = Table::read(path, "markers as built: `track` writes them")?;
    let [name, x, y, z, x_std, y_std, z_std, diameter, diameter_std] = table.columns(columns::BODY)?;
    let read = |row: crate::table::Row<'_>| {
        let [x_m, y_m, z_m] = row.numbers([x, y, z])?;
        let std_m = row.numbers([x_std, y_std, z_std])?;
        let [diameter_m] = row.numbers([diameter])?;
        Ok(MarkerAsBuilt {
            name: row.text(name).to_owned(),
            position_m: Vector3::new(x_m, y_m, z_m),
            position_std_m: std_m.into(),
            diameter_m,
            diameter_std_m: row.number_if_any(diameter_std)?,
        })
    };
    table.rows()?.map(read).collect()
}
