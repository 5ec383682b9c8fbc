//! Every figure of a run: printed, in `summary.json` and in the report from one list.

mod cameras;
mod health;
mod motion;
mod truth;

use crate::summary::{Summary, listed};
use crate::{equation_error, findings, output_error};
use mavsight_pipeline::Finding;
use mavsight_pose::{CameraClock, ClockEstimate, ClockVerdict};
use mavsight_score::Scores;
use mavsight_session::RunResults;
use serde_json::{Value, json};

pub(crate) use cameras::pixel_std_px;

impl Summary {
    /// Collects the figures of a run, and the errors against truth where there are any.
    pub fn of(results: &RunResults, scores: Option<&Scores>) -> Self {
        let finding = |found: &Finding| {
            let causes: Vec<&str> = found.causes.iter().map(|c| c.words()).collect();
            let camera = found.camera.and_then(|k| results.camera_names.get(k));
            json!({"causes": causes, "camera": camera, "note": found.note})
        };
        let faults = results.findings.iter().map(finding).collect();
        let mut summary = Self {
            rows: Vec::new(),
            verdicts: Vec::new(),
            notes: results.notes.clone(),
            advice: Vec::new(),
            findings: faults,
        };
        cameras::add(&mut summary, results);
        for (name, clock) in results.camera_names.iter().zip(&results.camera_clocks) {
            add_clock(&mut summary, name, clock);
        }
        add_body(&mut summary, results);
        motion::add_poses(&mut summary, results);
        health::add(&mut summary, results);
        add_for_plan(&mut summary, results);
        motion::add_motion(&mut summary, results);
        equation_error::summarise(&mut summary, results);
        output_error::summarise(&mut summary, results);
        if let Some(scores) = scores {
            truth::add(&mut summary, scores);
        }
        summary.advice = findings::of(results, &summary.notes);
        summary
    }
}

fn add_clock(summary: &mut Summary, name: &str, clock: &ClockEstimate) {
    let verdict = match clock.verdict {
        ClockVerdict::Reference => "reference",
        ClockVerdict::Known => "known",
        ClockVerdict::InStep => "in step",
        ClockVerdict::SetRight => "set right",
        ClockVerdict::TooSlow { .. } => "too slow",
    };
    let mut section = summary.section_of("time", name, name);
    section.add("clock", "clock", verdict, clock.to_string());
    let finite = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
    for (key, value) in [
        ("offset_ms", 1e3 * clock.clock.offset_s),
        ("offset_shown_ms", 1e3 * clock.shown.offset_s),
        ("offset_std_ms", 1e3 * clock.offset_std_s),
        ("drift_ppm", 1e6 * clock.clock.drift),
        ("drift_std_ppm", 1e6 * clock.drift_std),
    ] {
        section.hidden(key, finite(value));
    }
    if clock.clock.line_time_s != 0.0 || clock.line_time_std_s != 0.0 {
        let (line_us, std_us) = (1e6 * clock.clock.line_time_s, 1e6 * clock.line_time_std_s);
        let shown = format!("{line_us:.2} ± {std_us:.2} µs");
        section.add("line_time_us", "time from row to row", finite(line_us), shown);
        section.hidden("line_time_std_us", finite(std_us));
    }
}

/// The clocks of these cameras as the figures of an earlier stage have them; none where one of them is missing.
pub fn clocks_in(summary: &Value, cameras: &[String]) -> Option<Vec<CameraClock>> {
    let time = &summary["time"];
    let clock = |name: &String| {
        let figure = |key: &str| time[format!("{name}_{key}")].as_f64().filter(|v| v.is_finite());
        Some(CameraClock {
            offset_s: 1e-3 * figure("offset_ms")?,
            drift: 1e-6 * figure("drift_ppm")?,
            line_time_s: 1e-6 * figure("line_time_us").unwrap_or(0.0),
        })
    };
    cameras.iter().map(clock).collect()
}

fn add_body(summary: &mut Summary, results: &RunResults) {
    for marker in &results.body {
        let mut section = summary.section_of("body", &marker.name, &marker.name);
        let (place, std) = (marker.position_m, marker.position_std_m);
        let shown = [1e3 * place, 1e3 * std].map(|v| format!("({})", listed(v.as_slice(), 2))).join(" ± ");
        section.add("position_m", "marker", json!(place.as_slice()), format!("{shown} mm"));
        section.hidden("position_std_m", json!(std.as_slice()));
        let Some(std_m) = marker.diameter_std_m else { continue };
        let shown = format!("{:.2} ± {:.2} mm", 1e3 * marker.diameter_m, 1e3 * std_m);
        section.add("diameter_m", "ball, diameter", marker.diameter_m, shown);
        section.hidden("diameter_std_m", std_m);
    }
}

/// The noise of centres, with the keys of the room file of a plan.
fn add_for_plan(summary: &mut Summary, results: &RunResults) {
    let mut section = summary.section("plan");
    if let Some(centres) = results.centres {
        let label = "camera.centre_std_px: noise of centres, of ten equal parts of them";
        let shown = format!("[{}] px", listed(&centres.tenths_px, 3));
        section.add("centre_std_px", label, json!(centres.tenths_px), shown);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_is_read_back_from_the_figures_of_its_camera() {
        let clock = CameraClock { offset_s: 0.4, drift: 50e-6, line_time_s: 30e-6 };
        let late = ClockEstimate {
            clock,
            shown: clock,
            offset_std_s: f64::INFINITY,
            drift_std: 1e-6,
            line_time_std_s: 0.0,
            verdict: ClockVerdict::SetRight,
        };
        let results = RunResults {
            camera_names: vec!["cam2".into()],
            camera_clocks: vec![late],
            ..RunResults::default()
        };
        let figures = Summary::of(&results, None).json();
        let read = clocks_in(&figures, &results.camera_names).expect("its clock")[0];
        assert!((read.offset_s - 0.4).abs() < 1e-12 && (read.drift - 50e-6).abs() < 1e-15, "{read:?}");
        assert_eq!(read.time_ns(400_000_000), 0);
        assert!(clocks_in(&figures, &["cam3".into()]).is_none());
        assert!(clocks_in(&Value::Null, &results.camera_names).is_none());
    }
}
