//! Results from their files, so that a stage can begin where another one ended.

use super::columns;
use crate::table::{Row, Table};
use crate::{SessionError, error::require_file};
use mavsight_geometry::{EulerAngles, Matrix2, Matrix3, Matrix6, Vector2, Vector3, world_from_body};
use mavsight_pose::{MarkerObservation, MarkerSet, PoseError, PoseEstimate, PoseSample, covariance_from_std};
use nalgebra::Matrix6xX;
use std::path::Path;

/// What a pose without `_std` columns is taken to be good to: a millimetre and a milliradian. Only their
/// ratio matters, since the smoother finds the scale of the noise from the poses themselves.
const UNKNOWN_STD: [f64; 6] = [1e-3; 6];

/// Whether a pose was read from a table that says of no coordinate how good it is.
pub fn has_assumed_std(estimate: &PoseEstimate) -> bool {
    estimate.systematic_columns() == 0
        && estimate.own_covariance() == covariance_from_std(&estimate.world_from_body, &UNKNOWN_STD)
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
    let index = |row: Row<'_>, column: usize, names: &[String]| {
        let text = row.text(column);
        names.iter().position(|n| n == text).ok_or_else(|| {
            row.refuse(column, format!("{text:?} is not known: use one of {}", names.join(", ")))
        })
    };
    let read = |row: Row<'_>| {
        let [u_px, v_px, u_std_px, v_std_px] = row.numbers([u, v, u_std, v_std])?;
        Ok(MarkerObservation {
            t_ns: row.time_ns(t)?,
            camera: index(row, camera, camera_names)?,
            marker: index(row, marker, marker_names)?,
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
/// The standard deviations of the Euler angles are taken as uncorrelated, and without them every pose counts
/// the same (1 mm, 1 mrad): the smoother scales the noise to what the poses show. With the `new_` columns
/// that this program writes the part of the covariance that is new in each frame is read exactly; what is
/// beyond it in the standard deviations is taken as systematic errors, one for each coordinate and
/// independent of each other.
///
/// # Errors
/// Names the file, row and column.
pub fn read_poses(path: &Path, marker_names: &[String]) -> Result<Vec<PoseSample>, SessionError> {
    let table = Table::read(path, "poses: `track` writes them")?;
    let t = table.column("t_s")?;
    let mut values = [0; 6];
    let mut stds = [None; 6];
    for (k, quantity) in columns::POSE.into_iter().enumerate() {
        values[k] = table.column(&columns::value(quantity))?;
        stds[k] = table.column(&columns::std(quantity)).ok();
    }
    let (markers, residual) = (table.column("markers").ok(), table.column("residual_px").ok());
    let own = columns::upper_triangle().map(|at| table.column(&columns::new_covariance(at)));
    let own: Option<Vec<usize>> = own.collect::<Result<_, _>>().ok();
    let mut samples: Vec<PoseSample> = Vec::new();
    for row in table.rows()? {
        let t_ns = row.time_ns(t)?;
        if samples.last().is_some_and(|before| before.t_ns >= t_ns) {
            return Err(
                row.refuse(t, "the time does not come after that of the row before: sort the rows".into())
            );
        }
        if values.iter().all(|column| row.text(*column).is_empty()) {
            samples.push(PoseSample { t_ns, estimate: Err(PoseError::NotMeasured) });
            continue;
        }
        let pose = row.numbers(values)?;
        let used = markers.map(|c| row.text(c)).unwrap_or("");
        let stds = std_cells(row, stds)?;
        let place = isometry(&pose);
        let estimate = match &own {
            Some(columns) => {
                let (new, systematic) = with_new_part(row, columns, &pose, &stds)?;
                PoseEstimate::new(place, &new).with_systematic(&systematic)
            }
            None => PoseEstimate::new(place, &covariance_from_std(&place, &stds)),
        };
        let is_used = |m: &usize| used.split_whitespace().any(|name| name == marker_names[*m]);
        let by: MarkerSet = (0..marker_names.len()).filter(is_used).collect();
        let residual_px = residual.map_or(Ok(None), |c| row.number_if_any(c))?.unwrap_or(0.0);
        let estimate = estimate.by_markers(by, MarkerSet::default(), residual_px);
        samples.push(PoseSample { t_ns, estimate: Ok(estimate) });
    }
    Ok(samples)
}

fn std_cells(row: Row<'_>, columns: [Option<usize>; 6]) -> Result<[f64; 6], SessionError> {
    let mut stds = UNKNOWN_STD;
    for (std, column) in stds.iter_mut().zip(columns) {
        let Some(column) = column else { continue };
        let Some(value) = row.number_if_any(column)? else { continue };
        if value <= 0.0 {
            return Err(
                row.refuse(column, format!("{value} must be above zero: leave the cell empty if unknown"))
            );
        }
        *std = value;
    }
    Ok(stds)
}

fn angles(pose: &[f64; 6]) -> EulerAngles {
    EulerAngles { phi_rad: pose[3], theta_rad: pose[4], psi_rad: pose[5] }
}

pub(super) fn isometry(pose: &[f64; 6]) -> mavsight_geometry::Isometry3<f64> {
    world_from_body(Vector3::new(pose[0], pose[1], pose[2]), angles(pose))
}

/// The covariance of what is new in each frame, and what the standard deviations have beyond it as systematic
/// columns.
fn with_new_part(
    row: Row<'_>,
    columns: &[usize],
    pose: &[f64; 6],
    stds: &[f64; 6],
) -> Result<(Matrix6<f64>, Matrix6xX<f32>), SessionError> {
    let mut own = Matrix6::zeros();
    for ((i, j), column) in columns::upper_triangle().zip(columns) {
        let [value] = row.numbers([*column])?;
        (own[(i, j)], own[(j, i)]) = (value, value);
    }
    let euler_from_turn = angles(pose).rates_from_body_rates();
    let turn_from_euler = euler_from_turn.try_inverse().filter(|j| j.iter().all(|x| x.is_finite()));
    let (to_euler, to_turn) = turn_from_euler
        .map_or((Matrix3::identity(), Matrix3::identity()), |inverse| (euler_from_turn, inverse));
    let turn = to_euler * own.fixed_view::<3, 3>(3, 3) * to_euler.transpose();
    // Below a billionth of the variance the difference is one of the last digits.
    let beyond = |std: f64, new: f64| {
        let rest = std * std - new;
        if rest > 1e-9 * std * std { rest.sqrt() } else { 0.0 }
    };
    let mut systematic = Matrix6xX::zeros(6);
    for k in 0..3 {
        systematic[(k, k)] = beyond(stds[k], own[(k, k)]);
        let column = to_turn.column(k) * beyond(stds[3 + k], turn[(k, k)]);
        systematic.fixed_view_mut::<3, 1>(3, 3 + k).copy_from(&column);
    }
    Ok((own, systematic.map(|v: f64| v as f32)))
}

/// Reads `summary.json`.
///
/// # Errors
/// A file that is missing or not JSON.
pub fn read_summary(path: &Path) -> Result<serde_json::Value, SessionError> {
    require_file(path, "summary of a run")?;
    let text = std::fs::read_to_string(path).map_err(|e| SessionError::io(path, "read it", e))?;
    serde_json::from_str(&text).map_err(|e| SessionError::Row {
        path: path.to_owned(),
        line: e.line() as u64,
        detail: format!("not JSON: {e}"),
    })
}
