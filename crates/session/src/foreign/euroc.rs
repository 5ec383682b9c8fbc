//! EuRoC trajectories: integer nanoseconds, commas, the quaternion w, x, y, z; columns beyond the eighth (velocity, biases)
//! are not read.

use super::frames::AxesOf;
use super::poses::{TimedPose, continuous, left_out, pose};
use super::text::Text;
use crate::{SessionError, write_whole};
use std::path::Path;

const HEADER: &str =
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n";

/// Reads a trajectory in the given axes.
///
/// # Errors
/// Names the line and column; fewer than eight columns, times that are no integers or do not increase.
pub fn read(path: &Path, axes: AxesOf) -> Result<Vec<TimedPose>, SessionError> {
    let text = Text::read(path, "EuRoC trajectory")?;
    let mut poses: Vec<TimedPose> = Vec::new();
    for line in text.filled().filter(|l| !l.text.trim_start().starts_with('#')) {
        let cells = line.cells(',');
        if cells.len() < 8 {
            let detail =
                format!("{} cells: t_ns,x,y,z,qw,qx,qy,qz with commas between are wanted", cells.len());
            return Err(line.refuse(detail));
        }
        let wrong = || line.refuse(format!("column 1: {:?} is no whole number of nanoseconds", cells[0]));
        let t_ns: i64 = cells[0].parse().map_err(|_| wrong())?;
        let mut n = [0.0; 7];
        for (k, value) in n.iter_mut().enumerate() {
            *value = line.number_in(k + 1, cells[k + 1])?;
        }
        let theirs = pose([n[0], n[1], n[2]], [n[3], n[4], n[5], n[6]]).map_err(|e| line.refuse(e))?;
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
        format!("{t_ns},{:?},{:?},{:?},{w:?},{x:?},{y:?},{z:?}\n", p.x, p.y, p.z)
    });
    let text: String = std::iter::once(HEADER.to_owned()).chain(rows).collect();
    write_whole(path, text.as_bytes())?;
    Ok(left_out(poses))
}
