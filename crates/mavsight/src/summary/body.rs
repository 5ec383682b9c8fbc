//! Figures of the body as built.

use super::Summary;
use mavsight_session::RunResults;
use serde_json::json;

impl Summary {
    /// Where the markers are, where the flight has told it.
    pub(super) fn body(&mut self, results: &RunResults) {
        for marker in &results.body {
            let (name, p, s) = (&marker.name, 1e3 * marker.position_m, 1e3 * marker.position_std_m);
            let shown =
                format!("({:.2}, {:.2}, {:.2}) ± ({:.2}, {:.2}, {:.2}) mm", p.x, p.y, p.z, s.x, s.y, s.z);
            let value = json!(marker.position_m.as_slice());
            self.add("body", format!("{name}_position_m"), format!("{name} marker"), value, shown);
            let value = json!(marker.position_std_m.as_slice());
            self.add("body", format!("{name}_position_std_m"), "", value, String::new());
            let Some(std_m) = marker.diameter_std_m else { continue };
            let shown = format!("{:.2} ± {:.2} mm", 1e3 * marker.diameter_m, 1e3 * std_m);
            let value = json!(marker.diameter_m);
            self.add("body", format!("{name}_diameter_m"), format!("{name} ball, diameter"), value, shown);
            self.add("body", format!("{name}_diameter_std_m"), "", json!(std_m), String::new());
        }
    }
}
