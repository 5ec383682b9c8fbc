//! Every figure of a run: printed, in `summary.json` and in the report from one list.

use mavsight_pose::{Rig, control_volume, euler_std, volume_precision};
use mavsight_score::Scores;
use mavsight_session::{RESULTS_SCHEMA, RunResults, has_assumed_std};
use serde_json::{Map, Value, json};

mod body;
mod clocks;
mod health;
mod plan;
mod truth;

/// One figure.
pub(crate) struct Row {
    /// Group, also the key of the JSON object that holds it.
    pub(crate) section: &'static str,
    /// Key in the JSON object.
    pub(crate) key: String,
    /// What it is, for people.
    pub(crate) label: String,
    /// For machines, in the unit that the key ends in.
    pub(crate) value: Value,
    /// For people.
    pub(crate) shown: String,
}

/// All figures, and what else must be said.
pub(crate) struct Summary {
    /// Figures in order.
    pub(crate) rows: Vec<Row>,
    /// Verdicts on identifiability.
    pub(crate) verdicts: Vec<String>,
    /// What could not be had, and why.
    pub(crate) notes: Vec<String>,
}

impl Summary {
    /// Collects the figures of a run.
    pub(crate) fn of(results: &RunResults, scores: Option<&Scores>) -> Self {
        let mut summary = Self { rows: Vec::new(), verdicts: Vec::new(), notes: results.notes.clone() };
        summary.cameras(results);
        summary.clocks(results);
        summary.body(results);
        summary.poses(results);
        summary.health(results);
        summary.plan(results);
        summary.motion(results);
        crate::fits::summarise(&mut summary, results);
        crate::motion_fits::summarise(&mut summary, results);
        if let Some(scores) = scores {
            summary.scores(scores);
        }
        summary
    }

    pub(crate) fn add(
        &mut self,
        section: &'static str,
        key: impl Into<String>,
        label: impl Into<String>,
        value: Value,
        shown: String,
    ) {
        self.rows.push(Row { section, key: key.into(), label: label.into(), value, shown });
    }

    pub(crate) fn number(
        &mut self,
        section: &'static str,
        key: impl Into<String>,
        label: impl Into<String>,
        value: f64,
        unit: &str,
    ) {
        let shown = if value == 0.0 || (1e-2..1e5).contains(&value.abs()) {
            format!("{value:.3} {unit}")
        } else {
            format!("{value:.3e} {unit}")
        };
        self.add(section, key, label, json!(value), shown.trim_end().to_owned());
    }

    fn cameras(&mut self, results: &RunResults) {
        for camera in results.rig.iter().flat_map(|r| &r.cameras) {
            let (name, c, s) = (&camera.name, camera.camera.centre_in_world(), camera.centre_std_m);
            let shown = format!(
                "({:.4}, {:.4}, {:.4}) m ± ({:.1}, {:.1}, {:.1}) mm",
                c.x,
                c.y,
                c.z,
                1e3 * s.x,
                1e3 * s.y,
                1e3 * s.z
            );
            self.add(
                "cameras",
                format!("{name}_centre_m"),
                format!("{name} centre"),
                json!([c.x, c.y, c.z]),
                shown,
            );
            self.add("cameras", format!("{name}_centre_std_m"), "", json!([s.x, s.y, s.z]), String::new());
            let k = camera.camera.intrinsics;
            let shown = format!("{:.1}, {:.1} px", k.fx_px, k.fy_px);
            self.add(
                "cameras",
                format!("{name}_focal_px"),
                format!("{name} focal lengths"),
                json!([k.fx_px, k.fy_px]),
                shown,
            );
            let shown = format!("({:.1}, {:.1}) px", k.cx_px, k.cy_px);
            let value = json!([k.cx_px, k.cy_px]);
            self.add(
                "cameras",
                format!("{name}_principal_point_px"),
                format!("{name} principal point"),
                value,
                shown,
            );
            self.number(
                "cameras",
                format!("{name}_residual_rms_px"),
                format!("{name} control residual, RMS"),
                camera.residual_rms_px,
                "px",
            );
            let model = camera.model.to_string();
            self.add(
                "cameras",
                format!("{name}_model"),
                format!("{name} model, chosen by the data"),
                json!(model),
                model.clone(),
            );
            if camera.distortion_is_estimated() {
                let d = camera.camera.distortion;
                self.add(
                    "cameras",
                    format!("{name}_distortion_k1_k2_p1_p2_k3"),
                    format!("{name} distortion k1, k2, p1, p2, k3"),
                    json!([d.k1, d.k2, d.p1, d.p2, d.k3]),
                    format!("{:.4}, {:.4}, {:.5}, {:.5}, {:.4}", d.k1, d.k2, d.p1, d.p2, d.k3),
                );
            }
        }
        if let Some(rig) = &results.rig {
            self.rig(rig, pixel_std_px(results));
        }
    }

    /// What the cameras together promise, and what of the control points was left out.
    fn rig(&mut self, rig: &Rig, pixel_std_px: f64) {
        let precision = control_volume(rig).and_then(|v| volume_precision(rig, &v, pixel_std_px));
        if let Some(p) = precision {
            if let Some(centre_mm) = p.centre_mm {
                self.number(
                    "cameras",
                    "predicted_centre_mm",
                    format!("a ball seen with {pixel_std_px:.3} px: predicted error in the middle (3-D)"),
                    centre_mm,
                    "mm",
                );
            }
            let at = p.worst_at_m;
            let shown = format!("{:.3} mm at ({:.2}, {:.2}, {:.2}) m", p.worst_mm, at.x, at.y, at.z);
            let label = "and worst within the control frame";
            self.add("cameras", "predicted_worst_mm", label, json!(p.worst_mm), shown);
            let seen = format!("{:.0} %", 100.0 * p.share_seen);
            let label = "part of the control frame's volume that two cameras see";
            self.add("cameras", "share_seen", label, json!(p.share_seen), seen);
        }
        let names: Vec<&str> = rig.left_out.iter().map(|l| l.name.as_str()).collect();
        if !names.is_empty() {
            let label = "control points left out";
            self.add("cameras", "control_points_left_out", label, json!(names), names.join(", "));
        }
        for point in &rig.left_out {
            let mut note = point.to_string();
            if let Some(first) = note.get_mut(..1) {
                first.make_ascii_uppercase();
            }
            self.notes.push(format!("{note}."));
        }
    }

    fn poses(&mut self, results: &RunResults) {
        if results.poses.is_empty() {
            return;
        }
        let measured: Vec<_> = results.poses.iter().filter_map(|p| p.estimate.as_ref()).collect();
        let (n, all) = (measured.len(), results.poses.len());
        self.add("poses", "measured", "frames measured", json!(n), format!("{n} of {all}"));
        self.add("poses", "frames", "", json!(all), String::new());
        let left_out: usize = measured.iter().map(|e| e.left_out.len()).sum();
        self.add(
            "poses",
            "markers_left_out",
            "markers left out as not rigid",
            json!(left_out),
            left_out.to_string(),
        );
        if n == 0 {
            return;
        }
        let mean = |f: &dyn Fn(&mavsight_pose::PoseEstimate) -> f64| {
            measured.iter().map(|e| f(e)).sum::<f64>() / n as f64
        };
        if !measured.iter().any(|e| has_assumed_std(e)) {
            let position = mean(&|e| e.covariance().fixed_view::<3, 3>(0, 0).trace()).sqrt();
            let attitude = mean(&|e| e.covariance().fixed_view::<3, 3>(3, 3).trace() / 3.0).sqrt();
            self.number("poses", "position_std_mm", "predicted position error (3-D)", 1e3 * position, "mm");
            let (label, deg) = ("predicted attitude error (an axis)", attitude.to_degrees());
            self.number("poses", "attitude_std_deg", label, deg, "°");
        }
        // Poses of another system have no images.
        if measured.iter().any(|e| !e.markers_used.is_empty()) {
            let residual = (mean(&|e| e.residual_px * e.residual_px)).sqrt();
            self.number("poses", "residual_rms_px", "reprojection residual, RMS", residual, "px");
        }
        if let Some(missing) = results.poses.iter().find(|p| p.estimate.is_none()) {
            let reason = missing.reason.clone().unwrap_or_else(|| "no reason given".to_owned());
            self.notes.push(format!(
                "{} frame(s) could not be measured; the first at {:.3} s: {reason}",
                all - n,
                missing.t_ns as f64 * 1e-9
            ));
        }
    }

    fn motion(&mut self, results: &RunResults) {
        let Some(motion) = &results.motion else { return };
        self.number(
            "motion",
            "translation_bandwidth_hz",
            "smoother passes half at, translation",
            motion.translation_bandwidth_hz,
            "Hz",
        );
        self.number(
            "motion",
            "rotation_bandwidth_hz",
            "smoother passes half at, rotation",
            motion.rotation_bandwidth_hz,
            "Hz",
        );
        let n = motion.samples.len().max(1) as f64;
        let mean = |from: usize| {
            let sum: f64 = motion.samples.iter().map(|s| s.covariance.quantity(from / 3).trace()).sum();
            (sum / n).sqrt()
        };
        self.number("motion", "position_std_mm", "predicted position error (3-D)", 1e3 * mean(0), "mm");
        let pitch: f64 = motion
            .samples
            .iter()
            .map(|s| euler_std(&s.world_from_body, &s.covariance.quantity(1)).y.powi(2))
            .sum();
        self.number("motion", "theta_std_deg", "predicted pitch error", (pitch / n).sqrt().to_degrees(), "°");
    }

    /// For machines: one object a section, with the schema's version.
    pub(crate) fn json(&self) -> Value {
        let mut sections: Map<String, Value> = Map::new();
        sections.insert("schema".to_owned(), json!(RESULTS_SCHEMA));
        for row in &self.rows {
            let section = sections.entry(row.section).or_insert_with(|| json!({}));
            if let Some(object) = section.as_object_mut() {
                object.insert(row.key.clone(), row.value.clone());
            }
        }
        sections.insert("verdicts".to_owned(), json!(self.verdicts));
        sections.insert("notes".to_owned(), json!(self.notes));
        Value::Object(sections)
    }

    /// For people: aligned text.
    pub(crate) fn text(&self) -> String {
        let shown: Vec<&Row> =
            self.rows.iter().filter(|r| !r.shown.is_empty() && r.section != "parameters").collect();
        let width = shown.iter().map(|r| r.label.chars().count()).max().unwrap_or(0);
        let mut out = String::new();
        let mut section = "";
        for row in shown {
            if row.section != section {
                section = row.section;
                out += &format!("\n{}\n", title(section));
            }
            let pad = " ".repeat(width - row.label.chars().count());
            out += &format!("  {}{pad}  {}\n", row.label, row.shown);
        }
        for (heading, lines) in [("Verdict", &self.verdicts), ("Notes", &self.notes)] {
            if !lines.is_empty() {
                out += &format!("\n{heading}\n");
                for line in lines {
                    out += &format!("  {line}\n");
                }
            }
        }
        out
    }
}

/// Standard deviation of one coordinate of a ball's centre: what the markers' observations claim, root mean square, or what
/// the control points' residuals show where nothing was tracked.
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

/// A section's heading.
pub(crate) fn title(section: &str) -> &'static str {
    match section {
        "cameras" => "Cameras",
        "time" => "Time",
        "body" => "Body as built (its axes: no common shift or turn against the vehicle file)",
        "poses" => "Single poses",
        "health" => "How well the cameras see the markers",
        "plan" => "For the room file of the next plan",
        "motion" => "Smoothed motion",
        "fit" => "Fit",
        "parameters" => "Parameters",
        _ => "Against truth",
    }
}
