//! Errors of estimates against truth, and the virtual laboratories that show whether their intervals are
//! true.
//!
//! No crate of the estimators depends on this one.

mod between;
mod campaign;
mod campaign_file;
mod chunks;
mod coverage;
mod error;
mod fault;
mod fault_campaign;
mod faulty_flight;
mod identity;
mod truth;
mod virtual_flight;
mod virtual_lab;

pub use between::{true_pose, true_state};
pub use campaign::{Campaign, CellSummary, TrueParameter};
pub use campaign_file::{
    CAMPAIGN_SCHEMA, CampaignCamera, CampaignFile, CampaignManoeuvre, CampaignRig, FitKind, NoiseLevel,
};
pub use chunks::ChunkFile;
pub use coverage::{Coverage, QUANTITIES, Quantity, TOO_FEW, Tally};
pub use error::ScoreError;
pub use fault::{Expected, Fault};
pub use fault_campaign::{FaultCampaign, FaultSummary};
pub use identity::{IdentityScore, score_identity};
pub use truth::{VISIBILITY, read_truth, truth_of, visibility_of, write_truth, write_visibility};
pub use virtual_flight::VirtualFlight;
pub use virtual_lab::{ObservationNoise, VirtualCamera, VirtualLab};

use mavsight_flight::Vehicle;
use mavsight_geometry::{EulerAngles, Vector3};
use mavsight_identify::output_error::FlightFits;
use mavsight_identify::{Estimator, Identification};
use mavsight_pose::{Motion, PoseSample, Rig};
use mavsight_simulator::{FlightState, true_values};
use serde::Serialize;

/// Errors of position and attitude.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseErrors {
    /// Instants that were compared.
    pub compared: usize,
    /// Root mean square of the distance.
    pub position_rms_mm: f64,
    /// Largest distance.
    pub position_max_mm: f64,
    /// Root mean square error of roll, pitch and yaw.
    pub attitude_rms_deg: [f64; 3],
}

/// Errors of the smoothed motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MotionErrors {
    /// Pose.
    pub pose: PoseErrors,
    /// Root mean square error of u, v, w.
    pub velocity_rms_mm_s: [f64; 3],
    /// Root mean square error of p, q, r.
    pub rates_rms_deg_s: [f64; 3],
}

/// Error of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterError {
    /// `ols`, `tls`, `oe`, `fe` or `image`.
    pub estimator: &'static str,
    /// Such as `C_m,alpha_u`.
    pub name: String,
    /// Value of the simulated model.
    pub truth: f64,
    /// Estimate.
    pub value: f64,
    /// Error over truth, where truth is not zero.
    pub error_percent: Option<f64>,
    /// Whether the 95 % interval holds the truth.
    pub in_interval: bool,
}

impl ParameterError {
    fn new(
        estimator: &'static str,
        name: String,
        truth: f64,
        value: f64,
        interval: Option<(f64, f64)>,
    ) -> Self {
        let error_percent = (truth != 0.0).then(|| 100.0 * (value - truth) / truth.abs());
        let in_interval = interval.is_some_and(|(low, high)| low <= truth && truth <= high);
        Self { estimator, name, truth, value, error_percent, in_interval }
    }
}

/// Error of one camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraError {
    /// Camera name.
    pub camera: String,
    /// Distance of the projection centre from the true one.
    pub centre_mm: f64,
}

/// All errors of a run.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Scores {
    /// Single poses.
    pub poses: Option<PoseErrors>,
    /// Smoothed motion.
    pub motion: Option<MotionErrors>,
    /// Parameters of equation error.
    pub parameters: Vec<ParameterError>,
    /// Parameters of output error.
    pub output_error: Vec<ParameterError>,
    /// Cameras.
    pub cameras: Vec<CameraError>,
    /// Identities, where it is known which balls were visible.
    pub identity: Option<IdentityScore>,
}

/// Largest difference of two time stamps of one instant.
const SAME_INSTANT_S: f64 = 1e-3;

/// The true state at a time; `None` where truth has no row within a millisecond.
pub fn truth_at(truth: &[FlightState], t_s: f64) -> Option<&FlightState> {
    let after = truth.partition_point(|row| row.t_s < t_s - SAME_INSTANT_S);
    truth.get(after).filter(|row| (row.t_s - t_s).abs() <= SAME_INSTANT_S)
}

fn rms(squares: f64, count: usize) -> f64 {
    (squares / count.max(1) as f64).sqrt()
}

fn pose_errors<'a>(
    poses: impl Iterator<Item = (i64, &'a mavsight_geometry::Isometry3<f64>)>,
    truth: &[FlightState],
) -> Option<PoseErrors> {
    let (mut count, mut square, mut worst, mut angles) = (0, 0.0, 0.0_f64, [0.0; 3]);
    for (t_ns, pose) in poses {
        let t_s = t_ns as f64 * 1e-9;
        // Rows that are meant for this instant are taken as they are; cameras with clocks of their own lie
        // between rows.
        let at_row = truth_at(truth, t_s).map(FlightState::pose);
        let Some(wanted) = at_row.or_else(|| true_pose(truth, t_s)) else { continue };
        let distance_m = (pose.translation.vector - wanted.translation.vector).norm();
        let (e, row) = (EulerAngles::from_world_from_body(pose), EulerAngles::from_world_from_body(&wanted));
        count += 1;
        square += distance_m * distance_m;
        worst = worst.max(distance_m);
        let errors = [e.phi_rad - row.phi_rad, e.theta_rad - row.theta_rad, e.psi_rad - row.psi_rad];
        for (sum, error) in angles.iter_mut().zip(errors) {
            let turns = (error / std::f64::consts::TAU).round();
            *sum += (error - std::f64::consts::TAU * turns).to_degrees().powi(2);
        }
    }
    (count > 0).then(|| PoseErrors {
        compared: count,
        position_rms_mm: 1e3 * rms(square, count),
        position_max_mm: 1e3 * worst,
        attitude_rms_deg: angles.map(|s| rms(s, count)),
    })
}

/// Errors of single poses; `None` where no instant has a truth.
pub fn score_poses(poses: &[PoseSample], truth: &[FlightState]) -> Option<PoseErrors> {
    let measured = poses.iter().filter_map(|p| Some((p.t_ns, &p.estimate.as_ref().ok()?.world_from_body)));
    pose_errors(measured, truth)
}

/// Errors of smoothed motion; `None` where no instant has a truth.
pub fn score_motion(motion: &Motion, truth: &[FlightState]) -> Option<MotionErrors> {
    let pose = pose_errors(motion.samples.iter().map(|s| (s.t_ns, &s.world_from_body)), truth)?;
    let (mut count, mut velocity, mut rates) = (0, [0.0; 3], [0.0; 3]);
    for s in &motion.samples {
        let t_s = s.t_ns as f64 * 1e-9;
        let at_row = truth_at(truth, t_s).cloned();
        let Some(row) = at_row.or_else(|| true_state(truth, t_s)) else { continue };
        count += 1;
        for k in 0..3 {
            velocity[k] += (1e3 * (s.velocity_in_body_m_s[k] - row.velocity_in_body_m_s[k])).powi(2);
            rates[k] += (s.rates_rad_s[k] - row.rates_rad_s[k]).to_degrees().powi(2);
        }
    }
    Some(MotionErrors {
        pose,
        velocity_rms_mm_s: velocity.map(|s| rms(s, count)),
        rates_rms_deg_s: rates.map(|s| rms(s, count)),
    })
}

/// What a regression finds on a flight of the coaxial helicopter, as sums of its model's parameters: output,
/// regressor, parameters. The hub's stiffness acts as the moment of either disc does.
const REGRESSED: [(&str, &str, &[&str]); 4] = [
    ("C_X", "alpha_u", &["C_X,alpha_u"]),
    ("C_X", "alpha_l", &["C_X,alpha_l"]),
    ("C_m", "alpha_u", &["C_m,alpha_u", "C_m,hub"]),
    ("C_m", "alpha_l", &["C_m,alpha_l", "C_m,hub"]),
];

/// Errors of the flapping parameters of equation error against the simulated vehicle; parameters that the
/// vehicle's model does not have, that were declared not identifiable, or left out, have no error.
pub fn score_parameters(identification: &Identification, vehicle: &Vehicle) -> Vec<ParameterError> {
    let truth = true_values(vehicle);
    let sum = |labels: &[&str]| labels.iter().map(|label| truth.get(*label).copied()).sum::<Option<f64>>();
    let estimators = [Estimator::LeastSquares, Estimator::TotalLeastSquares];
    let all = estimators.into_iter().flat_map(|estimator| REGRESSED.map(|w| (estimator, w)));
    let error = |(estimator, (output, name, labels)): (Estimator, (&str, &str, &[&str]))| {
        let truth = sum(labels)?;
        let fit = identification.fit(output, estimator)?;
        let p = fit.parameters.iter().find(|p| p.name == name)?;
        let interval = p.ci_low.zip(p.ci_high);
        Some(ParameterError::new(estimator.name(), format!("{output},{name}"), truth, p.value?, interval))
    };
    all.filter_map(error).collect()
}

/// Errors of the parameters of output error against the simulated vehicle; the true input lag is 0.
pub fn score_output_error(fits: &FlightFits, vehicle: &Vehicle) -> Vec<ParameterError> {
    let truth = true_values(vehicle);
    let all = fits.named().flat_map(|(estimator, fit)| fit.parameters.iter().map(move |p| (estimator, p)));
    all.map(|(estimator, p)| {
        // The lag alone is no parameter of the vehicle's model.
        let own = truth.get(&p.name).copied().unwrap_or(0.0);
        let interval = Some((p.ci_low, p.ci_high));
        ParameterError::new(estimator, p.name.clone(), own, p.value, interval)
    })
    .collect()
}

/// Distances of the cameras' centres from the true ones, by name.
pub fn score_cameras(rig: &Rig, centres_in_world_m: &[(String, Vector3<f64>)]) -> Vec<CameraError> {
    rig.cameras
        .iter()
        .filter_map(|camera| {
            let (_, truth) = centres_in_world_m.iter().find(|(name, _)| name == &camera.name)?;
            let centre_mm = 1e3 * (camera.camera.centre_in_world() - truth).norm();
            Some(CameraError { camera: camera.name.clone(), centre_mm })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Matrix6, world_from_body};
    use mavsight_pose::{PoseEstimate, smooth};

    #[test]
    fn a_known_error_is_reported_as_such() {
        let truth: Vec<FlightState> = (0..10)
            .map(|k| FlightState {
                t_s: 0.1 * f64::from(k),
                attitude: EulerAngles { psi_rad: 3.0, ..Default::default() },
                ..Default::default()
            })
            .collect();
        let poses: Vec<PoseSample> = (0..10)
            .map(|k| {
                let off = Vector3::new(0.003, 0.0, 0.004);
                let turned = EulerAngles { psi_rad: -3.0, theta_rad: 0.01, ..Default::default() };
                PoseSample {
                    t_ns: k * 100_000_000,
                    estimate: Ok(PoseEstimate::new(world_from_body(off, turned), &Matrix6::identity())),
                }
            })
            .collect();
        let errors = score_poses(&poses, &truth).expect("compared");
        assert_eq!(errors.compared, 10);
        assert!((errors.position_rms_mm - 5.0).abs() < 1e-9);
        assert!((errors.attitude_rms_deg[1] - 0.01_f64.to_degrees()).abs() < 1e-9);
        let across = (std::f64::consts::TAU - 6.0).to_degrees();
        assert!((errors.attitude_rms_deg[2] - across).abs() < 1e-9, "yaw is compared across the half turn");
        assert_eq!(score_poses(&poses, &[]), None);
    }

    /// Instants between rows had no truth for velocity and rates, and counted as exact.
    #[test]
    fn velocity_and_rates_between_rows_are_compared_too() {
        let rates_rad_s = Vector3::new(0.0, 0.0, 0.5);
        let row = |k: i32| {
            let t_s = 0.1 * f64::from(k);
            let attitude = EulerAngles { psi_rad: 0.5 * t_s, ..Default::default() };
            FlightState { t_s, attitude, rates_rad_s, ..Default::default() }
        };
        let truth: Vec<FlightState> = (0..40).map(row).collect();
        for between_ns in [0, 40_000_000] {
            let pose = |k: i64| {
                let t_ns = k * 100_000_000 + between_ns;
                let pose = true_pose(&truth, t_ns as f64 * 1e-9).expect("inside");
                let estimate = Ok(PoseEstimate::new(pose, &(Matrix6::identity() * 1e-8)));
                PoseSample { t_ns, estimate }
            };
            let mut motion = smooth(&(0..39).map(pose).collect::<Vec<_>>(), 9.81).expect("a motion");
            for sample in &mut motion.samples {
                sample.velocity_in_body_m_s = Vector3::new(0.002, 0.0, 0.0);
                sample.rates_rad_s = rates_rad_s + Vector3::new(0.0, 0.01, 0.0);
            }
            let errors = score_motion(&motion, &truth).expect("compared");
            assert!((errors.velocity_rms_mm_s[0] - 2.0).abs() < 1e-6, "{errors:?}");
            assert!((errors.rates_rms_deg_s[1] - 0.01_f64.to_degrees()).abs() < 1e-6, "{errors:?}");
        }
    }
}
