//! The cameras: what was calibrated, and how precise a ball between them is.

use crate::summary::{Summary, listed};
use mavsight_pose::{Rig, RigCamera, control_volume, volume_precision};
use mavsight_session::RunResults;
use serde_json::json;

pub(super) fn add(summary: &mut Summary, results: &RunResults) {
    let Some(rig) = &results.rig else { return };
    rig.cameras.iter().for_each(|c| camera(summary, c));
    precision(summary, rig, pixel_std_px(results));
    let names: Vec<&str> = rig.left_out.iter().map(|l| l.name.as_str()).collect();
    if !names.is_empty() {
        let label = "control points left out";
        summary.section("cameras").add("control_points_left_out", label, json!(names), names.join(", "));
    }
    for point in &rig.left_out {
        let mut note = point.to_string();
        if let Some(first) = note.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        summary.notes.push(format!("{note}."));
    }
}

fn camera(summary: &mut Summary, camera: &RigCamera) {
    let mut section = summary.section_of("cameras", &camera.name, &camera.name);
    let (centre, std) = (camera.camera.centre_in_world(), camera.centre_std_m);
    let shown = format!("({}) m ± ({}) mm", listed(centre.as_slice(), 4), listed((1e3 * std).as_slice(), 1));
    section.add("centre_m", "centre", json!(centre.as_slice()), shown);
    section.hidden("centre_std_m", json!(std.as_slice()));
    let (k, d) = (camera.camera.intrinsics, camera.camera.distortion);
    let (focal, principal) = ([k.fx_px, k.fy_px], [k.cx_px, k.cy_px]);
    section.add("focal_px", "focal lengths", json!(focal), format!("{} px", listed(&focal, 1)));
    let shown = format!("({}) px", listed(&principal, 1));
    section.add("principal_point_px", "principal point", json!(principal), shown);
    let (all_px, control_px) = (camera.residual_rms_px, control_residual_px(camera));
    if let Some(control_px) = control_px {
        section.number("control_residual_rms_px", "control residual, RMS", control_px, "px");
    }
    // Of control points alone both are one figure; a camera that was not calibrated here has none.
    if all_px == 0.0 || control_px.is_some_and(|control_px| (all_px - control_px).abs() <= 1e-6 * all_px) {
        section.hidden("residual_rms_px", all_px);
    } else {
        section.number("residual_rms_px", "residual of all images of the calibration, RMS", all_px, "px");
    }
    let model = camera.model.to_string();
    section.add("model", "model, chosen by the data", model.clone(), model);
    if camera.distortion_is_estimated() {
        let shown = format!("{:.4}, {:.4}, {:.5}, {:.5}, {:.4}", d.k1, d.k2, d.p1, d.p2, d.k3);
        let value = json!([d.k1, d.k2, d.p1, d.p2, d.k3]);
        section.add("distortion_k1_k2_p1_p2_k3", "distortion k1, k2, p1, p2, k3", value, shown);
    }
}

/// Root mean square residual of the control points that were used, over all coordinates; none without such points.
fn control_residual_px(camera: &RigCamera) -> Option<f64> {
    let used = || camera.points.iter().filter(|p| p.used).map(|p| p.residual_px.norm_squared());
    let coordinates = 2 * used().count();
    (coordinates > 0).then(|| (used().sum::<f64>() / coordinates as f64).sqrt())
}

fn precision(summary: &mut Summary, rig: &Rig, pixel_std_px: f64) {
    let Some(p) = control_volume(rig).and_then(|v| volume_precision(rig, &v, pixel_std_px)) else { return };
    let mut section = summary.section("cameras");
    if let Some(centre_mm) = p.centre_mm {
        let label = format!("a ball seen with {pixel_std_px:.3} px: predicted error in the middle (3-D)");
        section.number("predicted_centre_mm", label, centre_mm, "mm");
    }
    let shown = format!("{:.3} mm at ({}) m", p.worst_mm, listed(p.worst_at_m.as_slice(), 2));
    section.add("predicted_worst_mm", "and worst within the control frame", p.worst_mm, shown);
    let label = "part of the control frame's volume that two cameras see";
    section.add("share_seen", label, p.share_seen, format!("{:.0} %", 100.0 * p.share_seen));
}

/// Standard deviation of one coordinate of a ball's centre: as the markers' observations state it, root
/// mean square; as the control points' residuals show it where nothing was tracked.
pub(crate) fn pixel_std_px(results: &RunResults) -> f64 {
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        (n > 0.0).then(|| f64::sqrt(sum / n))
    };
    let cameras = results.rig.iter().flat_map(|r| &r.cameras);
    rms(&mut results.markers.iter().map(|m| m.covariance_px2.trace() / 2.0))
        .or_else(|| rms(&mut cameras.map(|c| c.sigma_px * c.sigma_px)))
        .unwrap_or(0.0)
}
