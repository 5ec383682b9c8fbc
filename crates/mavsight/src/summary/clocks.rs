//! The cameras' clocks.

use super::Summary;
use mavsight_pose::{ClockEstimate, ClockVerdict};
use mavsight_session::RunResults;
use serde_json::{Value, json};

impl Summary {
    /// How late and how fast each camera's clock is, and what was made of that.
    pub(super) fn clocks(&mut self, results: &RunResults) {
        for (name, clock) in results.camera_names.iter().zip(&results.camera_clocks) {
            self.clock(name, clock);
        }
    }

    fn clock(&mut self, name: &str, clock: &ClockEstimate) {
        let verdict = match clock.verdict {
            ClockVerdict::Reference => "reference",
            ClockVerdict::Known => "known",
            ClockVerdict::InStep => "in step",
            ClockVerdict::SetRight => "set right",
            ClockVerdict::TooSlow { .. } => "too slow to tell",
        };
        self.add("time", format!("{name}_clock"), format!("{name} clock"), json!(verdict), clock.to_string());
        let finite = |value: f64| if value.is_finite() { json!(value) } else { Value::Null };
        let figures = [
            ("offset_ms", 1e3 * clock.clock.offset_s),
            ("offset_shown_ms", 1e3 * clock.shown.offset_s),
            ("offset_std_ms", 1e3 * clock.offset_std_s),
            ("drift_ppm", 1e6 * clock.clock.drift),
            ("drift_std_ppm", 1e6 * clock.drift_std),
        ];
        for (key, value) in figures {
            self.add("time", format!("{name}_{key}"), "", finite(value), String::new());
        }
        if clock.clock.line_time_s != 0.0 || clock.line_time_std_s != 0.0 {
            let (line_us, std_us) = (1e6 * clock.clock.line_time_s, 1e6 * clock.line_time_std_s);
            let shown = format!("{line_us:.2} ± {std_us:.2} µs");
            let label = format!("{name} time from row to row");
            self.add("time", format!("{name}_line_time_us"), label, finite(line_us), shown);
            self.add("time", format!("{name}_line_time_std_us"), "", finite(std_us), String::new());
        }
    }
}
