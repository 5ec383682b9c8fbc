//! Single poses and smoothed motion.

use crate::summary::Summary;
use mavsight_pose::{PoseEstimate, PoseSample, euler_std};
use mavsight_session::{RunResults, has_assumed_std};
use serde_json::json;

/// How many poses were measured and how precise they are predicted to be.
pub(super) fn add_poses(summary: &mut Summary, results: &RunResults) {
    if results.poses.is_empty() {
        return;
    }
    let measured: Vec<&PoseEstimate> =
        results.poses.iter().filter_map(|p| p.estimate.as_ref().ok()).collect();
    let (n, all) = (measured.len(), results.poses.len());
    let mut section = summary.section("poses");
    section.add("measured", "frames measured", json!(n), format!("{n} of {all}"));
    section.hidden("frames", json!(all));
    let left_out: usize = measured.iter().map(|e| e.left_out.len()).sum();
    let label = "markers left out as not rigid";
    section.add("markers_left_out", label, json!(left_out), left_out.to_string());
    if n == 0 {
        return;
    }
    let mean = |f: &dyn Fn(&PoseEstimate) -> f64| measured.iter().map(|e| f(e)).sum::<f64>() / n as f64;
    if !measured.iter().any(|e| has_assumed_std(e)) {
        let position = mean(&|e| e.covariance().fixed_view::<3, 3>(0, 0).trace()).sqrt();
        let attitude = mean(&|e| e.covariance().fixed_view::<3, 3>(3, 3).trace() / 3.0).sqrt();
        section.number("position_std_mm", "predicted position error (3-D)", 1e3 * position, "mm");
        section.number("attitude_std_deg", "predicted attitude error (an axis)", attitude.to_degrees(), "°");
    }
    add_residuals(summary, &measured);
    let refused = |p: &PoseSample| p.estimate.as_ref().err().map(|reason| (p.t_ns, reason.to_string()));
    if let Some((t_ns, reason)) = results.poses.iter().find_map(refused) {
        summary.notes.push(format!(
            "{} frame(s) could not be measured; the first at {:.3} s: {reason}",
            all - n,
            t_ns as f64 * 1e-9
        ));
    }
}

/// How well the markers of each pose fit together, where they can disagree.
fn add_residuals(summary: &mut Summary, measured: &[&PoseEstimate]) {
    // Poses of another system have no images.
    let squares_px2: Vec<f64> = measured.iter().filter_map(|e| Some(e.residual_px?.powi(2))).collect();
    if !squares_px2.is_empty() {
        let residual_px = (squares_px2.iter().sum::<f64>() / squares_px2.len() as f64).sqrt();
        let mut section = summary.section("poses");
        section.number("residual_rms_px", "reprojection residual, RMS", residual_px, "px");
    }
    let is_unchecked = |e: &&PoseEstimate| e.residual_px.is_none() && !e.markers_used.is_empty();
    let unchecked = measured.iter().copied().filter(is_unchecked).count();
    if unchecked > 0 {
        summary.notes.push(format!(
            "{unchecked} pose(s) have no redundancy, as three markers in one camera determine a pose and no more: they have no \
             residual, and only the motion before and after checks them."
        ));
    }
}

/// How far the smoother passes, and how precise the motion is predicted to be.
pub(super) fn add_motion(summary: &mut Summary, results: &RunResults) {
    let Some(motion) = &results.motion else { return };
    let mut section = summary.section("motion");
    for (of, value) in
        [("translation", motion.translation_bandwidth_hz), ("rotation", motion.rotation_bandwidth_hz)]
    {
        let label = format!("smoother passes half at, {of}");
        section.number(&format!("{of}_bandwidth_hz"), label, value, "Hz");
    }
    let n = motion.samples.len().max(1) as f64;
    let position: f64 = motion.samples.iter().map(|s| s.covariance.quantity(0).trace()).sum();
    let label = "predicted position error (3-D)";
    section.number("position_std_mm", label, 1e3 * (position / n).sqrt(), "mm");
    let turn = |s: &mavsight_pose::MotionSample| euler_std(&s.world_from_body, &s.covariance.quantity(1));
    let pitch: f64 = motion.samples.iter().map(|s| turn(s).y.powi(2)).sum();
    section.number("theta_std_deg", "predicted pitch error", (pitch / n).sqrt().to_degrees(), "°");
}
