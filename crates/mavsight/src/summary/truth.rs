//! Errors against what is known to be true.

use super::Summary;
use mavsight_score::{ParameterError, Scores};
use serde_json::json;

impl Summary {
    /// Every figure of a comparison with truth.
    pub(super) fn scores(&mut self, scores: &Scores) {
        for camera in &scores.cameras {
            self.number(
                "truth",
                format!("{}_centre_error_mm", camera.camera),
                format!("{} centre error", camera.camera),
                camera.centre_mm,
                "mm",
            );
        }
        if let Some(i) = scores.identity {
            let shown = format!("{} of {}", i.measured, i.measurable);
            let label = "frames measured of those with three balls visible to two cameras";
            self.add("truth", "measured_of_measurable", label, json!([i.measured, i.measurable]), shown);
            let label = "frames with a wrong identity, with a frozen pose";
            let shown = format!("{}, {}", i.wrong, i.frozen);
            self.add("truth", "wrong_and_frozen", label, json!([i.wrong, i.frozen]), shown);
        }
        let poses = [("poses", scores.poses), ("motion", scores.motion.map(|m| m.pose))];
        for (what, errors) in poses {
            let Some(e) = errors else { continue };
            self.number(
                "truth",
                format!("{what}_position_rms_mm"),
                format!("{what}: position error, RMS (3-D)"),
                e.position_rms_mm,
                "mm",
            );
            self.number(
                "truth",
                format!("{what}_position_max_mm"),
                format!("{what}: position error, largest"),
                e.position_max_mm,
                "mm",
            );
            self.triple(
                &format!("{what}_attitude_rms_deg"),
                &format!("{what}: roll, pitch, yaw error, RMS"),
                e.attitude_rms_deg,
                "°",
            );
        }
        if let Some(m) = scores.motion {
            self.triple("velocity_rms_mm_s", "motion: u, v, w error, RMS", m.velocity_rms_mm_s, "mm/s");
            self.triple("rates_rms_deg_s", "motion: p, q, r error, RMS", m.rates_rms_deg_s, "°/s");
        }
        for p in &scores.parameters {
            let percent = p.error_percent.map_or(String::new(), |e| format!("{e:+.1} %, "));
            let held = if p.in_interval { "inside" } else { "outside" };
            let label = format!("{} ({}) against {:+.3e}", p.name, p.estimator, p.truth);
            let key = format!("{}_{}_error_percent", p.estimator, p.name.replace(',', "_"));
            self.add("truth", key, label, json!(p.error_percent), format!("{percent}{held} its interval"));
        }
        self.output_error_against_truth(&scores.output_error);
    }

    /// One line for each way in which output error was fitted.
    fn output_error_against_truth(&mut self, errors: &[ParameterError]) {
        for (name, shown_as) in
            [("oe", "output error from the poses"), ("image", "output error from the images")]
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
            self.add("truth", key, label, json!([inside, count]), format!("{inside} of {count}{beyond}"));
        }
    }

    fn triple(&mut self, key: &str, label: &str, values: [f64; 3], unit: &str) {
        let [a, b, c] = values;
        self.add("truth", key, label, json!(values), format!("{a:.3}, {b:.3}, {c:.3} {unit}"));
    }
}
