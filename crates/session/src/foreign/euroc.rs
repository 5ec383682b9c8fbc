//! EuRoC trajectories: integer nanoseconds, commas, the quaternion w, x, y, z; columns beyond the eighth
//! (velocity, biases) are not read.

use super::frames::AxesOf;
use super::poses::{TimedPose, pose, read_lines, seven, write_lines};
use super::text::Text;
use crate::SessionError;
use std::path::Path;

const HEADER: &str =
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []";

/// Reads a trajectory in the given axes.
///
/// # Errors
/// Names the line and column; fewer than eight columns, times that are no integers or do not increase.
pub fn read(path: &Path, axes: AxesOf) -> Result<Vec<TimedPose>, SessionError> {
    let text = Text::read(path, "EuRoC trajectory")?;
    read_lines(&text, axes, |line| {
        let cells = line.cells(',');
        if cells.len() < 8 {
            let detail =
                format!("{} cells: t_ns,x,y,z,qw,qx,qy,qz with commas between are wanted", cells.len());
            return Err(line.refuse(detail));
        }
        let wrong = || line.refuse(format!("column 1: {:?} is no whole number of nanoseconds", cells[0]));
        let t_ns: i64 = cells[0].parse().map_err(|_| wrong())?;
        let n = seven(line, &cells)?;
        Ok((t_ns, pose([n[0], n[1], n[2]], [n[3], n[4], n[5], n[6]]).map_err(|e| line.refuse(e))?))
    })
}

/// Writes the poses that were measured.
///
/// # Errors
/// What the file system refuses.
pub fn write(path: &Path, poses: &[TimedPose], axes: AxesOf) -> Result<Vec<String>, SessionError> {
    write_lines(path, HEADER, poses, axes, |t_ns, p, [w, x, y, z]| {
        format!("{t_ns},{:?},{:?},{:?},{w:?},{x:?},{y:?},{z:?}", p.x, p.y, p.z)
    })
}
