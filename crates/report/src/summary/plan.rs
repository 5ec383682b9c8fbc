//! What a session has shown that a plan of the next one asks for.

use super::list::Summary;
use mavsight_session::RunResults;
use serde_json::json;

/// The noise of centres as a room file has it, keys as there.
pub(super) fn add(summary: &mut Summary, results: &RunResults) {
    let mut section = summary.section("plan");
    if let Some(centres) = results.centres {
        let shown: Vec<String> = centres.tenths_px.iter().map(|v| format!("{v:.3}")).collect();
        let label = "camera.centre_std_px: noise of centres, of ten equal parts of them";
        section.add("centre_std_px", label, json!(centres.tenths_px), format!("[{}] px", shown.join(", ")));
        let label = "centre_bias_px: systematic error of a centre";
        section.number("centre_bias_px", label, centres.bias_std_px, "px");
    }
    let cameras = || results.rig.iter().flat_map(|r| &r.cameras).filter(|c| c.sigma_px > 0.0);
    let n = cameras().count();
    if n > 0 {
        let variance_px2 = cameras().map(|c| c.sigma_px.powi(2)).sum::<f64>() / n as f64;
        let label = "control.std_px: noise of a control point, were all alike";
        section.number("control_std_px", label, variance_px2.sqrt(), "px");
    }
}
