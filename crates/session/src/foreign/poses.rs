//! Poses over time without their uncertainty: our own table, and trajectories of other programs.

use super::frames::AxesOf;
use super::text::Text;
use crate::decimal::{LATEST_NS, decimal_from_ns, ns_from_decimal};
use crate::results::{columns, read_poses};
use crate::{SessionError, write_csv, write_whole};
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

/// A format for trajectories, a line a pose; lines that begin with `#` are comments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trajectory {
    /// TUM: `t tx ty tz qx qy qz qw`, seconds, spaces between, the quaternion x, y, z, w.
    Tum,
    /// EuRoC: integer nanoseconds, commas, the quaternion w, x, y, z; columns beyond the eighth (velocity,
    /// biases) are not read.
    Euroc,
}

/// Reads `pose.csv`, `motion.csv` or another table with `t_s` and the six columns of a pose.
///
/// # Errors
/// Those of [`read_poses`].
pub fn read_pose_table(path: &Path) -> Result<Vec<TimedPose>, SessionError> {
    let samples = read_poses(path, &[])?.into_iter();
    let pose = |s: mavsight_pose::PoseSample| s.estimate.ok().map(|e| e.world_from_body);
    Ok(samples.map(|s| TimedPose { t_ns: s.t_ns, world_from_body: pose(s) }).collect())
}

/// Writes `t_s` and the six columns of a pose, empty where it was not measured: a table that `mavsight
/// identify` takes.
///
/// # Errors
/// What the file system refuses.
pub fn write_pose_table(path: &Path, poses: &[TimedPose]) -> Result<(), SessionError> {
    let header = std::iter::once("t_s".to_owned()).chain(columns::POSE.map(columns::value));
    let row = |pose: &TimedPose| {
        let values = pose.world_from_body.map(|p| {
            let (t, e) = (p.translation.vector, EulerAngles::from_world_from_body(&p));
            [t.x, t.y, t.z, e.phi_rad, e.theta_rad, e.psi_rad].map(Some)
        });
        (decimal_from_ns(pose.t_ns), values.unwrap_or_default())
    };
    write_csv(path, header, poses.iter().map(row))
}

/// Reads a trajectory in the given axes.
///
/// # Errors
/// Names the line and column: another count of cells, a time that is none or does not increase, a quaternion
/// that is none.
pub fn read_trajectory(
    path: &Path,
    format: Trajectory,
    axes: AxesOf,
) -> Result<Vec<TimedPose>, SessionError> {
    let text = Text::read(path, "trajectory")?;
    let mut poses: Vec<TimedPose> = Vec::new();
    for line in text.filled().filter(|l| !l.text.trim_start().starts_with('#')) {
        let cells = line.cells(if format == Trajectory::Tum { ' ' } else { ',' });
        let (fits, wanted, time) = match format {
            Trajectory::Tum => (
                cells.len() == 8 && !line.text.contains(','),
                "t tx ty tz qx qy qz qw with spaces",
                "time in seconds",
            ),
            Trajectory::Euroc => {
                (cells.len() >= 8, "t_ns,x,y,z,qw,qx,qy,qz with commas", "whole number of nanoseconds")
            }
        };
        if !fits {
            return Err(line.refuse(format!("{} cells: {wanted} between are wanted", cells.len())));
        }
        let t_ns = match format {
            Trajectory::Tum => ns_from_decimal(cells[0]),
            Trajectory::Euroc => {
                cells[0].parse().ok().filter(|t_ns: &i64| t_ns.unsigned_abs() <= LATEST_NS.unsigned_abs())
            }
        };
        let t_ns = t_ns.ok_or_else(|| line.refuse(format!("column 1: {:?} is no {time}", cells[0])))?;
        if poses.last().is_some_and(|before| before.t_ns >= t_ns) {
            return Err(line.refuse("the time does not come after that of the line before: sort the lines"));
        }
        let mut n = [0.0; 7];
        for (k, value) in n.iter_mut().enumerate() {
            *value = line.number_in(k + 1, cells[k + 1])?;
        }
        let q = match format {
            Trajectory::Tum => Quaternion::new(n[6], n[3], n[4], n[5]),
            Trajectory::Euroc => Quaternion::new(n[3], n[4], n[5], n[6]),
        };
        // Four printed digits leave 1e-4.
        if (q.norm() - 1.0).abs() > 1e-3 {
            let length = q.norm();
            let detail =
                format!("the quaternion's length is {length:.4}, not 1: check the order of the columns");
            return Err(line.refuse(detail));
        }
        let theirs =
            Isometry3::from_parts(Vector3::new(n[0], n[1], n[2]).into(), UnitQuaternion::from_quaternion(q));
        poses.push(TimedPose { t_ns, world_from_body: Some(axes.to_ours(&theirs)) });
    }
    if poses.is_empty() { Err(SessionError::no_rows(path)) } else { Ok(poses) }
}

/// Writes the poses that were measured, and says how many were not. Quaternions do not jump to their
/// negatives; the first has w ≥ 0.
///
/// # Errors
/// What the file system refuses.
pub fn write_trajectory(
    path: &Path,
    format: Trajectory,
    poses: &[TimedPose],
    axes: AxesOf,
) -> Result<Vec<String>, SessionError> {
    let mut text = match format {
        Trajectory::Tum => "# t_s tx_m ty_m tz_m qx qy qz qw\n",
        Trajectory::Euroc => {
            "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
        }
    }
    .to_owned();
    let mut before = Quaternion::new(1.0, 0.0, 0.0, 0.0);
    let mut missing = 0;
    for pose in poses {
        let Some(theirs) = pose.world_from_body.map(|p| axes.from_ours(&p)) else {
            missing += 1;
            continue;
        };
        let (t_ns, p, q) = (pose.t_ns, theirs.translation.vector, theirs.rotation.into_inner());
        let q = if q.dot(&before) < 0.0 { -q } else { q };
        before = q;
        let [x, y, z, w]: [f64; 4] = q.coords.into();
        text += &match format {
            Trajectory::Tum => {
                let t_s = decimal_from_ns(t_ns);
                format!("{t_s} {:?} {:?} {:?} {x:?} {y:?} {z:?} {w:?}\n", p.x, p.y, p.z)
            }
            Trajectory::Euroc => {
                format!("{t_ns},{:?},{:?},{:?},{w:?},{x:?},{y:?},{z:?}\n", p.x, p.y, p.z)
            }
        };
    }
    write_whole(path, text.as_bytes())?;
    let all = poses.len();
    let note = || {
        format!(
            "{missing} of {all} instants were not measured and are left out: the format has no empty rows"
        )
    };
    Ok((missing > 0).then(note).into_iter().collect())
}
