//! The body as built.

use super::list::Summary;
use mavsight_session::RunResults;
use serde_json::json;

/// Where the markers are, where they were refined from the flight.
pub(super) fn add(summary: &mut Summary, results: &RunResults) {
    let mut section = summary.section("body");
    for marker in &results.body {
        let (name, p, s) = (&marker.name, 1e3 * marker.position_m, 1e3 * marker.position_std_m);
        let shown = format!("({:.2}, {:.2}, {:.2}) ± ({:.2}, {:.2}, {:.2}) mm", p.x, p.y, p.z, s.x, s.y, s.z);
        let value = json!(marker.position_m.as_slice());
        section.add(format!("{name}_position_m"), format!("{name} marker"), value, shown);
        section.hidden(format!("{name}_position_std_m"), json!(marker.position_std_m.as_slice()));
        let Some(std_m) = marker.diameter_std_m else { continue };
        let shown = format!("{:.2} ± {:.2} mm", 1e3 * marker.diameter_m, 1e3 * std_m);
        let label = format!("{name} ball, diameter");
        section.add(format!("{name}_diameter_m"), label, marker.diameter_m, shown);
        section.hidden(format!("{name}_diameter_std_m"), std_m);
    }
}
