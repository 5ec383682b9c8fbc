//! The true state between two rows of a truth table.

use mavsight_geometry::{EulerAngles, Isometry3, UnitQuaternion, Vector3};
use mavsight_simulator::FlightState;

/// Rows further apart are not one motion.
const LONGEST_STEP_S: f64 = 0.2;

/// The true pose at any time from the first row to the last.
///
/// Position is the polynomial of fifth degree with both rows' positions, velocities and accelerations,
/// attitude that of third degree in the turn from the earlier row with both rows' attitudes and rates. `None`
/// outside the rows, and between rows more than a fifth of a second apart.
pub fn true_pose(truth: &[FlightState], t_s: f64) -> Option<Isometry3<f64>> {
    let [row, next] = rows_about(truth, t_s)?;
    if next.t_s == t_s {
        return Some(next.pose());
    }
    let step_s = next.t_s - row.t_s;
    let (a, b) = (row.pose(), next.pose());
    let x = (t_s - row.t_s) / step_s;
    let (x2, x3, x4, x5) = (x * x, x.powi(3), x.powi(4), x.powi(5));
    // Hermite's weights of fifth degree: of the end's place, of both velocities and of both accelerations.
    let p = 10.0 * x3 - 15.0 * x4 + 6.0 * x5;
    let v = [x - 6.0 * x3 + 8.0 * x4 - 3.0 * x5, -4.0 * x3 + 7.0 * x4 - 3.0 * x5];
    let w = [0.5 * x2 - 1.5 * x3 + 1.5 * x4 - 0.5 * x5, 0.5 * x3 - x4 + 0.5 * x5];
    let (from, to) = (WorldRates::of(row, &a), WorldRates::of(next, &b));
    let position = a.translation.vector * (1.0 - p)
        + b.translation.vector * p
        + (from.velocity * v[0] + to.velocity * v[1]) * step_s
        + (from.acceleration * w[0] + to.acceleration * w[1]) * (step_s * step_s);
    let turn = (a.rotation.inverse() * b.rotation).scaled_axis();
    // The turn's own rate at its end, to the second order of the inverse right Jacobian.
    let end = next.rates_rad_s;
    let end = end + turn.cross(&end) * 0.5 + turn.cross(&turn.cross(&end)) / 12.0;
    let axis =
        turn * (3.0 * x2 - 2.0 * x3) + (row.rates_rad_s * (x3 - 2.0 * x2 + x) + end * (x3 - x2)) * step_s;
    Some(Isometry3::from_parts(position.into(), a.rotation * UnitQuaternion::from_scaled_axis(axis)))
}

/// The true state at any time from the first row to the last, without the model's further states: the pose is
/// [`true_pose`], velocity and rates are polynomials of third degree with both rows' values and derivatives.
/// `None` as there.
pub fn true_state(truth: &[FlightState], t_s: f64) -> Option<FlightState> {
    let [row, next] = rows_about(truth, t_s)?;
    if next.t_s == t_s {
        return Some(next.clone());
    }
    let pose = true_pose(truth, t_s)?;
    let step_s = next.t_s - row.t_s;
    let x = (t_s - row.t_s) / step_s;
    let cubic = |[a, b]: [Vector3<f64>; 2], [da, db]: [Vector3<f64>; 2]| {
        let value = 3.0 * x * x - 2.0 * x.powi(3);
        a * (1.0 - value)
            + b * value
            + (da * (x.powi(3) - 2.0 * x * x + x) + db * (x.powi(3) - x * x)) * step_s
    };
    let (dv, dw) = (
        [row.velocity_rate_m_s2, next.velocity_rate_m_s2],
        [row.angular_acceleration_rad_s2, next.angular_acceleration_rad_s2],
    );
    Some(FlightState {
        t_s,
        position_in_world_m: pose.translation.vector,
        attitude: EulerAngles::from_world_from_body(&pose),
        velocity_in_body_m_s: cubic([row.velocity_in_body_m_s, next.velocity_in_body_m_s], dv),
        rates_rad_s: cubic([row.rates_rad_s, next.rates_rad_s], dw),
        further: Vec::new(),
        velocity_rate_m_s2: dv[0] * (1.0 - x) + dv[1] * x,
        angular_acceleration_rad_s2: dw[0] * (1.0 - x) + dw[1] * x,
    })
}

/// The rows before and after a time, if they are one motion; at the time of a row, that row twice.
fn rows_about(truth: &[FlightState], t_s: f64) -> Option<[&FlightState; 2]> {
    let after = truth.partition_point(|row| row.t_s < t_s);
    let next = truth.get(after)?;
    if next.t_s == t_s {
        return Some([next, next]);
    }
    let row = truth.get(after.checked_sub(1)?)?;
    let step_s = next.t_s - row.t_s;
    (step_s > 0.0 && step_s <= LONGEST_STEP_S).then_some([row, next])
}

/// Motion in world axes.
struct WorldRates {
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
}

impl WorldRates {
    fn of(row: &FlightState, pose: &Isometry3<f64>) -> Self {
        let velocity = row.velocity_in_body_m_s;
        let acceleration = row.velocity_rate_m_s2 + row.rates_rad_s.cross(&velocity);
        Self { velocity: pose.rotation * velocity, acceleration: pose.rotation * acceleration }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_flight::Vehicle;
    use mavsight_simulator::{Maneuver, Scenario, simulate};

    /// Every second instant of a flight against the simulation itself.
    #[test]
    fn between_rows_it_is_what_the_simulation_gives() {
        let vehicle = Vehicle::paper();
        let scenario = Scenario {
            duration_s: 4.0,
            maneuver: vec![Maneuver::Doublet {
                channel: "delta_lon".into(),
                start_s: 0.5,
                pulse_s: 0.7,
                amplitude: 5.0,
            }],
            ..Scenario::paper()
        };
        let inputs = scenario.inputs(&vehicle).unwrap();
        let times: Vec<f64> = (0..240).map(|k| f64::from(k) / 60.0).collect();
        let states = simulate(&vehicle, &inputs, &scenario.start(&vehicle).unwrap(), &times).unwrap();
        let coarse: Vec<FlightState> = states.iter().step_by(2).cloned().collect();
        for row in &states[..238] {
            let (got, want) = (true_pose(&coarse, row.t_s).unwrap(), row.pose());
            let apart_m = (got.translation.vector - want.translation.vector).norm();
            assert!(apart_m < 2e-6, "{} s: {apart_m} m", row.t_s);
            assert!(got.rotation.angle_to(&want.rotation) < 1e-4, "{} s", row.t_s);
            let state = true_state(&coarse, row.t_s).unwrap();
            let apart_m_s = (state.velocity_in_body_m_s - row.velocity_in_body_m_s).norm();
            let apart_rad_s = (state.rates_rad_s - row.rates_rad_s).norm();
            assert!(
                apart_m_s < 1e-4 && apart_rad_s < 1e-2,
                "{} s: {apart_m_s} m/s {apart_rad_s} rad/s",
                row.t_s
            );
        }
        assert_eq!(true_pose(&coarse, -0.01), None);
        assert_eq!(true_pose(&coarse, 4.1), None);
        let far = [coarse[0].clone(), coarse[30].clone()];
        assert_eq!(true_pose(&far, 0.5), None);
    }
}
