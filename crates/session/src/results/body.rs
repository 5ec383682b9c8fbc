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

/// Reads `body.csv`.
///
/// # Errors
/// Names the file, row and column.
pub fn read_body(path: &Path) -> Result<Vec<MarkerAsBuilt>, SessionError> {
    let table = Table::read(path, "markers as built: `track` writes them")?;
    let [name, x, y, z, x_std, y_std, z_std, diameter, diameter_std] = table.columns(columns::BODY)?;
    let read = |row: crate::table::Row<'_>| {
        Ok(MarkerAsBuilt {
            name: row.text(name).to_owned(),
            position_m: row.numbers([x, y, z])?.into(),
            position_std_m: row.numbers([x_std, y_std, z_std])?.into(),
            diameter_m: row.number(diameter)?,
            diameter_std_m: row.number_if_any(diameter_std)?,
        })
    };
    table.rows()?.map(read).collect()
}
