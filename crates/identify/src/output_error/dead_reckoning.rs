//! A start where only velocities and rates were measured.

use super::measure::StateMeasurement;
use mavsight_geometry::{Isometry3, UnitQuaternion, Vector3, world_from_level};

/// Poses summed up from velocity and rates, from the origin, level and along X; those instants that have
/// both.
///
/// Position and heading are then conventions, which the fit pins; roll and pitch are found from gravity.
pub(crate) fn poses(samples: &[StateMeasurement]) -> Vec<(usize, Isometry3<f64>)> {
    let mut pose = Isometry3::from_parts(Vector3::zeros().into(), world_from_level());
    let mut before: Option<(f64, Vector3<f64>, Vector3<f64>)> = None;
    let mut out = Vec::new();
    for (i, s) in samples.iter().enumerate() {
        let (Some((velocity, _)), Some((rates, _))) = (&s.velocity, &s.rates) else { continue };
        let t_s = s.t_ns as f64 * 1e-9;
        if let Some((before_s, v0, w0)) = before {
            let h_s = t_s - before_s;
            let middle = turned(&pose.rotation, &(w0 * 0.75 + rates * 0.25), 0.5 * h_s);
            pose.translation.vector += middle * (v0 + velocity) * (0.5 * h_s);
            pose.rotation = turned(&pose.rotation, &((w0 + rates) * 0.5), h_s);
        }
        before = Some((t_s, *velocity, *rates));
        out.push((i, pose));
    }
    out
}

/// The turn that leads from one attitude to another over a time at constant rates.
fn turned(rotation: &UnitQuaternion<f64>, rates: &Vector3<f64>, h_s: f64) -> UnitQuaternion<f64> {
    rotation * UnitQuaternion::from_scaled_axis(rates * h_s)
}
