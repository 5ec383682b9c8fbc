//! The true pose between two rows of a truth table.

use crate::TruthRow;
use mavsight_geometry::{EulerAngles, Isometry3, UnitQuaternion, Vector3, world_from_body};
use nalgebra::Translation3;

/// Rows further apart are not one motion.
const LONGEST_STEP_S: f64 = 0.2;

/// A row's pose.
pub(crate) fn pose_of_row(row: &TruthRow) -> Isometry3<f64> {
    let attitude = EulerAngles { phi_rad: row.phi_rad, theta_rad: row.theta_rad, psi_rad: row.psi_rad };
    world_from_body(Vector3::new(row.x_m, row.y_m, row.z_m), attitude)
}

/// The true pose at any time from the first row to the last.
///
/// Position is the polynomial of fifth degree with both rows' positions, velocities and accelerations,
/// attitude that of third degree in the turn from the earlier row with both rows' attitudes and rates. `None`
/// outside the rows, and between rows more than a fifth of a second apart.
pub fn true_pose(truth: &[TruthRow], t_s: f64) -> Option<Isometry3<f64>> {
    let after = truth.partition_point(|row| row.t_s < t_s);
    let next = truth.get(after)?;
    if next.t_s == t_s {
        return Some(pose_of_row(next));
    }
    let row = truth.get(after.checked_sub(1)?)?;
    let step_s = next.t_s - row.t_s;
    if !(step_s > 0.0 && step_s <= LONGEST_STEP_S) {
        return None;
    }
    let (a, b) = (pose_of_row(row), pose_of_row(next));
    let x = (t_s - row.t_s) / step_s;
    let Hermite { value: p, slopes: v, curvatures: w } = hermite(x);
    let (from, to) = (world_rates(row, &a), world_rates(next, &b));
    let position = a.translation.vector * (1.0 - p)
        + b.translation.vector * p
        + (from.0 * v[0] + to.0 * v[1]) * step_s
        + (from.1 * w[0] + to.1 * w[1]) * (step_s * step_s);
    let turn = (a.rotation.inverse() * b.rotation).scaled_axis();
    let rates = |r: &TruthRow| Vector3::new(r.p_rad_s, r.q_rad_s, r.r_rad_s);
    // The turn's own rate at its end, to the second order of the inverse right Jacobian.
    let end = rates(next);
    let end = end + turn.cross(&end) * 0.5 + turn.cross(&turn.cross(&end)) / 12.0;
    let (x2, x3) = (x * x, x * x * x);
    let axis = turn * (3.0 * x2 - 2.0 * x3) + (rates(row) * (x3 - 2.0 * x2 + x) + end * (x3 - x2)) * step_s;
    Some(Isometry3::from_parts(
        Translation3::from(position),
        a.rotation * UnitQuaternion::from_scaled_axis(axis),
    ))
}

/// Velocity and acceleration in world axes.
fn world_rates(row: &TruthRow, pose: &Isometry3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let velocity = Vector3::new(row.u_m_s, row.v_m_s, row.w_m_s);
    let rates = Vector3::new(row.p_rad_s, row.q_rad_s, row.r_rad_s);
    let change = Vector3::new(row.du_m_s2, row.dv_m_s2, row.dw_m_s2);
    (pose.rotation * velocity, pose.rotation * (change + rates.cross(&velocity)))
}

/// Hermite's weights of fifth degree: of the end's value (the start's is its complement), of both slopes and
/// of both curvatures.
struct Hermite {
    value: f64,
    slopes: [f64; 2],
    curvatures: [f64; 2],
}

fn hermite(x: f64) -> Hermite {
    let (x2, x3, x4, x5) = (x * x, x.powi(3), x.powi(4), x.powi(5));
    Hermite {
        value: 10.0 * x3 - 15.0 * x4 + 6.0 * x5,
        slopes: [x - 6.0 * x3 + 8.0 * x4 - 3.0 * x5, -4.0 * x3 + 7.0 * x4 - 3.0 * x5],
        curvatures: [0.5 * x2 - 1.5 * x3 + 1.5 * x4 - 0.5 * x5, 0.5 * x3 - x4 + 0.5 * x5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_flight::Vehicle;
    use mavsight_simulator::{Channel, Maneuver, Scenario, simulate};

    /// Every second instant of a flight against the simulation itself.
    #[test]
    fn between_rows_it_is_what_the_simulation_gives() {
        let vehicle = Vehicle::paper();
        let scenario = Scenario {
            duration_s: 4.0,
            maneuver: vec![Maneuver::Doublet {
                channel: Channel::DeltaLon,
                start_s: 0.5,
                pulse_s: 0.7,
                amplitude: 5.0,
            }],
            ..Scenario::paper()
        };
        let inputs = scenario.inputs(&vehicle).unwrap();
        let times: Vec<f64> = (0..240).map(|k| f64::from(k) / 60.0).collect();
        let states = simulate(&vehicle, &inputs, &scenario.start(), &times).unwrap();
        let rows: Vec<TruthRow> = states.iter().map(TruthRow::from).collect();
        let coarse: Vec<TruthRow> = rows.iter().step_by(2).copied().collect();
        for row in &rows[..238] {
            let (got, want) = (true_pose(&coarse, row.t_s).unwrap(), pose_of_row(row));
            let apart_m = (got.translation.vector - want.translation.vector).norm();
            assert!(apart_m < 2e-6, "{} s: {apart_m} m", row.t_s);
            assert!(got.rotation.angle_to(&want.rotation) < 1e-4, "{} s", row.t_s);
        }
        assert_eq!(true_pose(&coarse, -0.01), None);
        assert_eq!(true_pose(&coarse, 4.1), None);
        let far = [coarse[0], coarse[30]];
        assert_eq!(true_pose(&far, 0.5), None);
    }
}
