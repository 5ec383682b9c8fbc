//! Results from their files, so that a stage can begin where another one ended.

use super::columns::{self, Series};
use crate::table::{Row, Table};
use crate::{SessionError, error::read_text};
use mavsight_geometry::{EulerAngles, Isometry3, Matrix2, Matrix6, Vector2, Vector3, world_from_body};
use mavsight_pose::{MarkerObservation, MarkerSet, PoseError, PoseEstimate, PoseSample, covariance_from_std};
use nalgebra::{Matrix6xX, Vector6};
use std::path::Path;

/// What a pose without `_std` columns is taken to be good to: a millimetre and a milliradian. Only their
/// ratio matters, since the smoother finds the scale of the noise from the poses themselves.
const UNKNOWN_STD: f64 = 1e-3;

/// Whether a pose was read from a table that says of no coordinate how good it is.
pub fn has_assumed_std(estimate: &PoseEstimate) -> bool {
    estimate.systematic_columns() == 0 && estimate.own_covariance() == equal_turns(&[UNKNOWN_STD; 6])
}

/// Reads `markers.csv`. Only the standard deviations are on file: the covariance between u and v is zero.
///
/// # Errors
/// Names the file, row and column; a camera or marker that is not among those given.
pub fn read_markers(
    path: &Path,
    camera_names: &[String],
    marker_names: &[String],
) -> Result<Vec<MarkerObservation>, SessionError> {
    let table = Table::read(path, "markers: `track` writes them")?;
    let [t, camera, marker, u, v, u_std, v_std] = table.columns(columns::MARKERS)?;
    let read = |row: Row<'_>| {
        let [u_px, v_px, u_std_px, v_std_px] = row.numbers([u, v, u_std, v_std])?;
        Ok(MarkerObservation {
            t_ns: row.time_ns(t)?,
            camera: row.place_in(camera, camera_names)?,
            marker: row.place_in(marker, marker_names)?,
            pixel: Vector2::new(u_px, v_px),
            covariance_px2: Matrix2::new(u_std_px * u_std_px, 0.0, 0.0, v_std_px * v_std_px),
        })
    };
    table.rows_if_any().map(read).collect()
}

/// Reads `pose.csv`, or the pose table of another system: the columns
/// `t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad` are needed, `_std` columns, `markers` and `residual_px` are
/// not. A row whose pose is empty was not measured.
///
/// The standard deviations of the Euler angles are taken as uncorrelated. Without them every pose counts the same
/// (1 mm, and 1 mrad of a turn about any axis): the smoother scales the noise to what the poses show. With the `new_` columns
/// that this program writes the part of the covariance that is new in each frame is read exactly; what is
/// beyond it in the standard deviations is taken as systematic errors, one for each coordinate and
/// independent of each other.
///
/// # Errors
/// Names the file, row and column.
pub fn read_poses(path: &Path, marker_names: &[String]) -> Result<Vec<PoseSample>, SessionError> {
    let table = Table::read(path, "poses: `track` writes them")?;
    let series = Series::of(&table, columns::POSE.into_iter())?;
    let (markers, residual) = (table.column("markers").ok(), table.column("residual_px").ok());
    let own = columns::upper_triangle().map(|at| table.column(&columns::new_covariance(at)));
    let own: Option<Vec<usize>> = own.collect::<Result<_, _>>().ok();
    let read = |instant: columns::Instant<'_, 6>| {
        let (row, t_ns) = (instant.row, instant.t_ns);
        let Some(pose) = instant.values else {
            return Ok(PoseSample { t_ns, estimate: Err(PoseError::NotMeasured) });
        };
        let stds = series.stds(row, UNKNOWN_STD, |std| std > 0.0)?;
        let place = isometry(&pose);
        let estimate = match &own {
            Some(columns) => with_new_part(row, columns, &pose, &stds)?,
            None if stds[3..] == [UNKNOWN_STD; 3] => PoseEstimate::new(place, &equal_turns(&stds)),
            None => PoseEstimate::new(place, &covariance_from_std(&place, &stds)),
        };
        let used = markers.map(|c| row.text(c)).unwrap_or("");
        let is_used = |m: &usize| used.split_whitespace().any(|name| name == marker_names[*m]);
        let by: MarkerSet = (0..marker_names.len()).filter(is_used).collect();
        let residual_px = residual.map_or(Ok(None), |c| row.number_if_any(c))?;
        Ok(PoseSample { t_ns, estimate: Ok(estimate.by_markers(by, MarkerSet::default(), residual_px)) })
    };
    series.rows(&table)?.into_iter().map(read).collect()
}

/// The covariance of a pose of whose angles nothing is said: a turn of the body is as likely about any axis.
fn equal_turns(stds: &[f64; 6]) -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::from(*stds).map(|std| std * std))
}

fn angles(pose: &[f64; 6]) -> EulerAngles {
    EulerAngles { phi_rad: pose[3], theta_rad: pose[4], psi_rad: pose[5] }
}

pub(super) fn isometry(pose: &[f64; 6]) -> Isometry3<f64> {
    world_from_body(Vector3::new(pose[0], pose[1], pose[2]), angles(pose))
}

/// A pose with the covariance that is new in each frame; the rest of the standard deviations is systematic.
fn with_new_part(
    row: Row<'_>,
    columns: &[usize],
    pose: &[f64; 6],
    stds: &[f64; 6],
) -> Result<PoseEstimate, SessionError> {
    let mut own = Matrix6::zeros();
    for ((i, j), column) in columns::upper_triangle().zip(columns) {
        let value = row.number(*column)?;
        (own[(i, j)], own[(j, i)]) = (value, value);
    }
    let mut to_euler = Matrix6::identity();
    to_euler.fixed_view_mut::<3, 3>(3, 3).copy_from(&angles(pose).rates_from_body_rates());
    let to_turn = to_euler.try_inverse().filter(|inverse| inverse.iter().all(|x| x.is_finite()));
    let to_turn = to_turn.unwrap_or_else(|| {
        to_euler = Matrix6::identity();
        to_euler
    });
    let new = (to_euler * own * to_euler.transpose()).diagonal();
    // Below a billionth of the variance the difference is one of the last digits.
    let beyond = Vector6::from(*stds).zip_map(&new, |std, new| {
        let rest = std * std - new;
        if rest > 1e-9 * std * std { rest.sqrt() } else { 0.0 }
    });
    let systematic = (to_turn * Matrix6::from_diagonal(&beyond)).map(|v| v as f32);
    let systematic = Matrix6xX::from_column_slice(systematic.as_slice());
    Ok(PoseEstimate::new(isometry(pose), &own).with_systematic(&systematic))
}

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
    let read = |row: Row<'_>| {
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

/// Reads `summary.json`.
///
/// # Errors
/// A file that is missing or not JSON.
pub fn read_summary(path: &Path) -> Result<serde_json::Value, SessionError> {
    let text = read_text(path, "summary of a run")?;
    serde_json::from_str(&text)
        .map_err(|e| SessionError::line(path, e.line() as u64, format!("not JSON: {e}")))
}
