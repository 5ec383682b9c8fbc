//! TUM trajectories: `t tx ty tz qx qy qz qw`, seconds, one space between, `#` before comments. The quaternion is x, y, z, w.

use super::frames::AxesOf;
use super::poses::{TimedPose, continuous, left_out, pose};
use super::text::{Text, decimal_from_ns, ns_from_decimal};
use crate::{SessionError, write_whole};
use std::path::Path;

/// Reads a trajectory in the given axes.
///
/// # Errors
/// Names the line and column; commas, another count than eight, quaternions that are none, times that do not increase.
pub fn read(path: &Path, axes: AxesOf) -> Result<Vec<TimedPose>, SessionError> {
    let text = Text::read(path, "TUM trajectory")?;
    let mut poses: Vec<TimedPose> = Vec::new();
    for line in text.filled().filter(|l| !l.text.trim_start().starts_with('#')) {
        let cells: Vec<&str> = line.text.split_whitespace().collect();
        if cells.len() != 8 || line.text.contains(',') {
            let detail =
                format!("{} cells: t tx ty tz qx qy qz qw with spaces between are wanted", cells.len());
            return Err(line.refuse(detail));
        }
        let t_ns = ns_from_decimal(cells[0])
            .ok_or_else(|| line.refuse(format!("column 1: {:?} is no time in seconds", cells[0])))?;
        let mut n = [0.0; 7];
        for (k, value) in n.iter_mut().enumerate() {
            *value = line.number_in(k + 1, cells[k + 1])?;
        }
        let theirs = pose([n[0], n[1], n[2]], [n[6], n[3], n[4], n[5]]).map_err(|e| line.refuse(e))?;
        if poses.last().is_some_and(|before| before.t_ns >= t_ns) {
            return Err(line.refuse("the time does not come after that of the line before: sort the lines"));
        }
        poses.push(TimedPose { t_ns, world_from_body: Some(axes.to_ours(&theirs)) });
    }
    if poses.is_empty() { Err(SessionError::EmptyTable { path: path.to_owned() }) } else { Ok(poses) }
}

/// Writes the poses that were measured.
///
/// # Errors
/// What the file system refuses.
pub fn write(path: &Path, poses: &[TimedPose], axes: AxesOf) -> Result<Vec<String>, SessionError> {
    let times = poses.iter().filter(|p| p.world_from_body.is_some()).map(|p| p.t_ns);
    let theirs = continuous(poses.iter().filter_map(|p| p.world_from_body).map(|p| axes.from_ours(&p)));
    let rows = times.zip(theirs).map(|(t_ns, (p, [w, x, y, z]))| {
        format!("{} {:?} {:?} {:?} {x:?} {y:?} {z:?} {w:?}\n", decimal_from_ns(t_ns), p.x, p.y, p.z)
    });
    let text: String = std::iter::once("# t_s tx_m ty_m tz_m qx qy qz qw\n".to_owned()).chain(rows).collect();
    write_whole(path, text.as_bytes())?;
    Ok(left_out(poses))
}
