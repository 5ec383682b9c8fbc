//! Errors against what is known to be true.

use crate::parameters::words;
use crate::summary::Summary;
use mavsight_identify::output_error::{FILTER_ERROR, OUTPUT_ERROR};
use mavsight_score::Scores;
use serde_json::json;

pub(super) fn add(summary: &mut Summary, scores: &Scores) {
    for camera in &scores.cameras {
        let mut section = summary.section_of("truth", &camera.camera, &camera.camera);
        section.number("centre_error_mm", "centre error", camera.centre_mm, "mm");
    }
    let mut section = summary.section("truth");
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
        let mut section = summary.section_of("truth", what, &format!("{what}:"));
        section.number("position_rms_mm", "position error, RMS (3-D)", e.position_rms_mm, "mm");
        section.number("position_max_mm", "position error, largest", e.position_max_mm, "mm");
        section.triple("attitude_rms_deg", "roll, pitch, yaw error, RMS", e.attitude_rms_deg, "°");
    }
    let mut section = summary.section("truth");
    if let Some(m) = scores.motion {
        section.triple("velocity_rms_mm_s", "motion: u, v, w error, RMS", m.velocity_rms_mm_s, "mm/s");
        section.triple("rates_rms_deg_s", "motion: p, q, r error, RMS", m.rates_rms_deg_s, "°/s");
    }
    for p in &scores.parameters {
        let percent = p.error_percent.map_or(String::new(), |e| format!("{e:+.1} %, "));
        let held = if p.in_interval { "inside" } else { "outside" };
        let label = format!("{} ({}) against {:+.3e}", p.name, p.estimator, p.truth);
        let key = format!("{}_{}_error_percent", p.estimator, p.name.replace(',', "_"));
        section.add(key, label, json!(p.error_percent), format!("{percent}{held} its interval"));
    }
    for name in [OUTPUT_ERROR, FILTER_ERROR, "image"] {
        let own = || scores.output_error.iter().filter(|p| p.estimator == name);
        let (inside, count) = (own().filter(|p| p.in_interval).count(), own().count());
        if count == 0 {
            continue;
        }
        let outside: Vec<&str> = own().filter(|p| !p.in_interval).map(|p| p.name.as_str()).collect();
        let beyond =
            if outside.is_empty() { String::new() } else { format!("; outside: {}", outside.join(", ")) };
        let label = format!("{}: true values inside the 95 % intervals", words(name));
        let key = format!("{name}_inside_of");
        section.add(key, label, json!([inside, count]), format!("{inside} of {count}{beyond}"));
    }
}
