//! Which balls a virtual camera saw: truth that only scoring reads.

use crate::table::{Table, csv_cell};
use crate::{SessionError, TruthRow, write_whole};
use mavsight_flight::Vehicle;
use std::path::Path;

/// Name of the file, in the folder of `truth.csv`.
pub const VISIBILITY: &str = "visibility.csv";

/// Writes which share of each ball's face each camera saw: by instant, camera and marker.
///
/// # Errors
/// What the file system refuses.
pub fn write_visibility(
    path: &Path,
    truth: &[TruthRow],
    cameras: &[String],
    vehicle: &Vehicle,
    shares: &[Vec<Vec<f64>>],
) -> Result<(), SessionError> {
    let mut text = "t_s,camera".to_owned();
    vehicle.marker.iter().for_each(|m| text += &format!(",{}", csv_cell(&m.name)));
    text.push('\n');
    for (row, of_cameras) in truth.iter().zip(shares) {
        for (camera, of_markers) in cameras.iter().zip(of_cameras) {
            text += &format!("{:.9},{}", row.t_s, csv_cell(camera));
            of_markers.iter().for_each(|share| text += &format!(",{share:.3}"));
            text.push('\n');
        }
    }
    write_whole(path, text.as_bytes())
}

/// Reads the visibility table: the shares by instant, camera and marker, in the order of the rows, for a
/// number of cameras.
///
/// # Errors
/// Names the file, row and column.
pub fn read_visibility(
    path: &Path,
    cameras: usize,
    markers: &[String],
) -> Result<Vec<Vec<Vec<f64>>>, SessionError> {
    let table = Table::read(path, "visibility")?;
    let columns = markers.iter().map(|m| table.column(m)).collect::<Result<Vec<_>, _>>()?;
    let rows = table
        .rows()?
        .map(|row| columns.iter().map(|c| row.number(*c)).collect::<Result<Vec<f64>, _>>())
        .collect::<Result<Vec<_>, _>>()?;
    Ok(rows.chunks(cameras.max(1)).map(<[Vec<f64>]>::to_vec).collect())
}
