//! TUM trajectories: `t tx ty tz qx qy qz qw`, seconds, one space between, `#` before comments. The
//! quaternion is x, y, z, w.

use super::frames::AxesOf;
use super::poses::{TimedPose, pose, read_lines, seven, write_lines};
use super::text::{Text, decimal_from_ns, ns_from_decimal};
use crate::SessionError;
use std::path::Path;

/// Reads a trajectory in the given axes.
///
/// # Errors
/// Names the line and column; commas, another count than eight, quaternions that are none, times that do not
/// increase.
pub fn read(path: &Path, axes: AxesOf) -> Result<Vec<TimedPose>, SessionError> {
    let text = Text::read(path, "TUM trajectory")?;
    read_lines(&text, axes, |line| {
        let cells: Vec<&str> = line.text.split_whitespace().collect();
        if cells.len() != 8 || line.text.contains(',') {
            let detail =
                format!("{} cells: t tx ty tz qx qy qz qw with spaces between are wanted", cells.len());
            return Err(line.refuse(detail));
        }
        let t_ns = ns_from_decimal(cells[0])
            .ok_or_else(|| line.refuse(format!("column 1: {:?} is no time in seconds", cells[0])))?;
        let n = seven(line, &cells)?;
        Ok((t_ns, pose([n[0], n[1], n[2]], [n[6], n[3], n[4], n[5]]).map_err(|e| line.refuse(e))?))
    })
}

/// Writes the poses that were measured.
///
/// # Errors
/// What the file system refuses.
pub fn write(path: &Path, poses: &[TimedPose], axes: AxesOf) -> Result<Vec<String>, SessionError> {
    write_lines(path, "# t_s tx_m ty_m tz_m qx qy qz qw", poses, axes, |t_ns, p, [w, x, y, z]| {
        format!("{} {:?} {:?} {:?} {x:?} {y:?} {z:?} {w:?}", decimal_from_ns(t_ns), p.x, p.y, p.z)
    })
}
