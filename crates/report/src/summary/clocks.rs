//! The cameras' clocks.

use super::list::Summary;
use mavsight_pose::{ClockEstimate, ClockVerdict};
use mavsight_session::RunResults;
use serde_json::{Value, json};

/// Offset and drift of each camera's clock, and what was made of them.
pub(super) fn add(summary: &mut Summary, results: &RunResults) {
    for (name, clock) in results.camera_names.iter().zip(&results.camera_clocks) {
        add_clock(summary, name, clock);
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
    let mut section = summary.section("time");
    section.add(format!("{name}_clock"), format!("{name} clock"), verdict, clock.to_string());
    let finite = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
    for (key, value) in [
        ("offset_ms", 1e3 * clock.clock.offset_s),
        ("offset_shown_ms", 1e3 * clock.shown.offset_s),
        ("offset_std_ms", 1e3 * clock.offset_std_s),
        ("drift_ppm", 1e6 * clock.clock.drift),
        ("drift_std_ppm", 1e6 * clock.drift_std),
    ] {
        section.hidden(format!("{name}_{key}"), finite(value));
    }
    if clock.clock.line_time_s != 0.0 || clock.line_time_std_s != 0.0 {
        let (line_us, std_us) = (1e6 * clock.clock.line_time_s, 1e6 * clock.line_time_std_s);
        let shown = format!("{line_us:.2} ± {std_us:.2} µs");
        let label = format!("{name} time from row to row");
        section.add(format!("{name}_line_time_us"), label, finite(line_us), shown);
        section.hidden(format!("{name}_line_time_std_us"), finite(std_us));
    }
}
