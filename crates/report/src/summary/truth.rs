//! Errors against what is known to be true.

use super::list::{Section, Summary};
use mavsight_score::{ParameterError, Scores};
use serde_json::json;

/// Every figure of a comparison with truth.
pub(super) fn add(summary: &mut Summary, scores: &Scores) {
    let mut section = summary.section("truth");
    for camera in &scores.cameras {
        let name = &camera.camera;
        section.number(
            format!("{name}_centre_error_mm"),
            format!("{name} centre error"),
            camera.centre_mm,
            "mm",
        );
    }
    if let Some(i) = scores.identity {
        let shown = format!("{} of {}", i.measured, i.measurable);
        let label = "frames measured of those with three balls visible to two cameras";
        section.add("measured_of_measurable", label, json!([i.measured, i.measurable]), shown);
        let label = "frames with a wrong identity, with a frozen pose";
        let shown = format!("{}, {}", i.wrong, i.frozen);
        section.add("wrong_and_frozen", label, json!([i.wrong, i.frozen]), shown);
    }
    for (what, errors) in [("poses", scores.poses), ("motion", scores.motion.map(|m| m.pose))] {
        let Some(e) = errors else { continue };
        let label = format!("{what}: position error, RMS (3-D)");
        section.number(format!("{what}_position_rms_mm"), label, e.position_rms_mm, "mm");
        let label = format!("{what}: position error, largest");
        section.number(format!("{what}_position_max_mm"), label, e.position_max_mm, "mm");
        let label = format!("{what}: roll, pitch, yaw error, RMS");
        section.triple(format!("{what}_attitude_rms_deg"), label, e.attitude_rms_deg, "°");
    }
    if let Some(m) = scores.motion {
        let label = "motion: u, v, w error, RMS";
        section.triple("velocity_rms_mm_s", label, m.velocity_rms_mm_s, "mm/s");
        section.triple("rates_rms_deg_s", "motion: p, q, r error, RMS", m.rates_rms_deg_s, "°/s");
    }
    for p in &scores.parameters {
        let percent = p.error_percent.map_or(String::new(), |e| format!("{e:+.1} %, "));
        let held = if p.in_interval { "inside" } else { "outside" };
        let label = format!("{} ({}) against {:+.3e}", p.name, p.estimator, p.truth);
        let key = format!("{}_{}_error_percent", p.estimator, p.name.replace(',', "_"));
        section.add(key, label, json!(p.error_percent), format!("{percent}{held} its interval"));
    }
    output_error(&mut section, &scores.output_error);
}

/// One line for each way in which output error was fitted.
fn output_error(section: &mut Section<'_>, errors: &[ParameterError]) {
    for (name, shown_as) in [("oe", "output error from the poses"), ("image", "output error from the images")]
    {
        let own = || errors.iter().filter(|p| p.estimator == name);
        let (inside, count) = (own().filter(|p| p.in_interval).count(), own().count());
        if count == 0 {
            continue;
        }
        let outside: Vec<&str> = own().filter(|p| !p.in_interval).map(|p| p.name.as_str()).collect();
        let beyond =
            if outside.is_empty() { String::new() } else { format!("; outside: {}", outside.join(", ")) };
        let label = format!("{shown_as}: true values inside the 95 % intervals");
        let key = format!("{name}_inside_of");
        section.add(key, label, json!([inside, count]), format!("{inside} of {count}{beyond}"));
    }
}
