//! Poses over time without their uncertainty: what trajectory formats hold.

use super::frames::AxesOf;
use super::text::{Line, Text, decimal_from_ns};
use crate::results::{columns, read_poses};
use crate::{SessionError, write_whole};
use mavsight_geometry::{EulerAngles, Isometry3, UnitQuaternion, Vector3};
use nalgebra::Quaternion;
use std::path::Path;

/// A pose and its time; none where it was not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedPose {
    /// Time.
    pub t_ns: i64,
    /// The pose, in this program's axes.
    pub world_from_body: Option<Isometry3<f64>>,
}

/// Reads `pose.csv`, `motion.csv` or another table with `t_s` and the six columns of a pose.
///
/// # Errors
/// Those of [`read_poses`].
pub fn read_pose_table(path: &Path) -> Result<Vec<TimedPose>, SessionError> {
    let samples = read_poses(path, &[])?;
    Ok(samples
        .iter()
        .map(|s| TimedPose {
            t_ns: s.t_ns,
            world_from_body: s.estimate.as_ref().ok().map(|e| e.world_from_body),
        })
        .collect())
}

/// Writes `t_s` and the six columns of a pose, empty where it was not measured: a table that `mavsight
/// identify` takes.
///
/// # Errors
/// What the file system refuses.
pub fn write_pose_table(path: &Path, poses: &[TimedPose]) -> Result<(), SessionError> {
    let mut text = String::from("t_s");
    for quantity in columns::POSE {
        text.push(',');
        text += &columns::value(quantity);
    }
    for pose in poses {
        text += &format!("\n{}", decimal_from_ns(pose.t_ns));
        match &pose.world_from_body {
            Some(p) => {
                let (t, e) = (p.translation.vector, EulerAngles::from_world_from_body(p));
                text += &format!(
                    ",{:?},{:?},{:?},{:?},{:?},{:?}",
                    t.x, t.y, t.z, e.phi_rad, e.theta_rad, e.psi_rad
                );
            }
            None => text += ",,,,,,",
        }
    }
    text.push('\n');
    write_whole(path, text.as_bytes())
}

/// A pose from a position and a quaternion w, x, y, z; says what is wrong with it.
pub(super) fn pose(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Result<Isometry3<f64>, String> {
    let q = Quaternion::new(w, x, y, z);
    let norm = q.norm();
    // Four printed digits leave 1e-4.
    if !norm.is_finite() || (norm - 1.0).abs() > 1e-3 {
        return Err(format!("the quaternion's length is {norm:.4}, not 1: check the order of the columns"));
    }
    Ok(Isometry3::from_parts(Vector3::from(position).into(), UnitQuaternion::from_quaternion(q)))
}

/// Reads a trajectory's lines, each one pose; lines that begin with `#` are comments.
pub(super) fn read_lines(
    text: &Text,
    axes: AxesOf,
    pose_of: impl Fn(&Line<'_>) -> Result<(i64, Isometry3<f64>), SessionError>,
) -> Result<Vec<TimedPose>, SessionError> {
    let mut poses: Vec<TimedPose> = Vec::new();
    for line in text.filled().filter(|l| !l.text.trim_start().starts_with('#')) {
        let (t_ns, theirs) = pose_of(&line)?;
        if poses.last().is_some_and(|before| before.t_ns >= t_ns) {
            return Err(line.refuse("the time does not come after that of the line before: sort the lines"));
        }
        poses.push(TimedPose { t_ns, world_from_body: Some(axes.to_ours(&theirs)) });
    }
    if poses.is_empty() { Err(SessionError::EmptyTable { path: text.path().to_owned() }) } else { Ok(poses) }
}

/// Seven numbers from the second cell of a line on.
pub(super) fn seven(line: &Line<'_>, cells: &[&str]) -> Result<[f64; 7], SessionError> {
    let mut numbers = [0.0; 7];
    for (k, value) in numbers.iter_mut().enumerate() {
        *value = line.number_in(k + 1, cells[k + 1])?;
    }
    Ok(numbers)
}

/// Writes a header and a line for each pose that was measured; says how many were not.
pub(super) fn write_lines(
    path: &Path,
    header: &str,
    poses: &[TimedPose],
    axes: AxesOf,
    line_of: impl Fn(i64, Vector3<f64>, [f64; 4]) -> String,
) -> Result<Vec<String>, SessionError> {
    let times = poses.iter().filter(|p| p.world_from_body.is_some()).map(|p| p.t_ns);
    let theirs = continuous(poses.iter().filter_map(|p| p.world_from_body).map(|p| axes.from_ours(&p)));
    let mut text = format!("{header}\n");
    for (t_ns, (position, quaternion)) in times.zip(theirs) {
        text += &line_of(t_ns, position, quaternion);
        text.push('\n');
    }
    write_whole(path, text.as_bytes())?;
    Ok(left_out(poses))
}

/// Quaternions w, x, y, z that do not jump to their negatives; the first has w ≥ 0.
fn continuous(poses: impl Iterator<Item = Isometry3<f64>>) -> Vec<(Vector3<f64>, [f64; 4])> {
    let mut before = Quaternion::new(1.0, 0.0, 0.0, 0.0);
    let next = |p: Isometry3<f64>| {
        let q = p.rotation.into_inner();
        let q = if q.dot(&before) < 0.0 { -q } else { q };
        before = q;
        (p.translation.vector, [q.w, q.i, q.j, q.k])
    };
    poses.map(next).collect()
}

/// How many poses were not measured, in a sentence; nothing where all were.
fn left_out(poses: &[TimedPose]) -> Vec<String> {
    let missing = poses.iter().filter(|p| p.world_from_body.is_none()).count();
    let note = || {
        format!(
            "{missing} of {} instants were not measured and are left out: the format has no empty rows",
            poses.len()
        )
    };
    (missing > 0).then(note).into_iter().collect()
}
