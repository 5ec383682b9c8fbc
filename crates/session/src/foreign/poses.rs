//! Poses over time without their uncertainty: what trajectory formats hold.

use super::text::decimal_from_ns;
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
        .map(|s| TimedPose { t_ns: s.t_ns, world_from_body: s.estimate.as_ref().map(|e| e.world_from_body) })
        .collect())
}

/// Writes `t_s` and the six columns of a pose, empty where it was not measured: a table that `mavsight identify` takes.
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

/// Quaternions w, x, y, z that do not jump to their negatives; the first has w ≥ 0.
pub(super) fn continuous(poses: impl Iterator<Item = Isometry3<f64>>) -> Vec<(Vector3<f64>, [f64; 4])> {
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
pub(super) fn left_out(poses: &[TimedPose]) -> Vec<String> {
    let missing = poses.iter().filter(|p| p.world_from_body.is_none()).count();
    let note = || {
        format!(
            "{missing} of {} instants were not measured and are left out: the format has no empty rows",
            poses.len()
        )
    };
    (missing > 0).then(note).into_iter().collect()
}
