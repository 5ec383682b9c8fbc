//! How well each camera saw the markers, and what could be done about it.

use crate::summary::Summary;
use mavsight_pipeline::{CameraHealth, MarkerHealth};
use mavsight_session::RunResults;
use serde_json::json;

/// A ball of fewer pixels across is measured no better than to a tenth of a pixel.
const SMALL_PX: f64 = 4.0;
/// Share of frames from which a marker counts as seen throughout.
const OFTEN_SEEN: f64 = 0.9;
/// Share of full pixels up to which they are the glint of a lamp on a ball.
const GLINT: f64 = 0.05;
/// Hue by which a surface changes with the light, degrees: nearer background is taken for the ball.
const NEAR_HUE_DEG: f64 = 25.0;

/// Health of the masks and of the exposure, by camera and marker, with advice as notes.
pub(super) fn add(summary: &mut Summary, results: &RunResults) {
    for camera in &results.camera_health {
        let mut section = summary.section_of("health", &camera.camera, &camera.camera);
        let value = json!({"frames": camera.frames, "dark": camera.dark, "edge_px": camera.edge_px});
        let shown = format!("{} frames, {} dark, edges {:.2} px", camera.frames, camera.dark, camera.edge_px);
        section.add("frames", "", value, shown);
        for (marker, m) in results.marker_names.iter().zip(&camera.markers) {
            let ball = &m.ball;
            let value = json!({
                "seen": m.seen, "saturated": ball.saturated, "contrast": ball.contrast,
                "diameter_px": ball.diameter_px, "others": ball.others, "hue_apart_deg": ball.hue_apart_deg,
            });
            let shown = format!(
                "{:.0} % of frames, {:.1} px, {:.0} % full, contrast {:.2}, {:.1} others, hue {:.0}° apart",
                100.0 * m.seen,
                ball.diameter_px,
                100.0 * ball.saturated,
                ball.contrast,
                ball.others,
                ball.hue_apart_deg
            );
            section.add(marker, marker, value, shown);
        }
        summary.notes.extend(advice(camera, &results.marker_names));
    }
}

/// What a person could do for a camera, one sentence for each kind of trouble.
fn advice(camera: &CameraHealth, markers: &[String]) -> Vec<String> {
    let name = &camera.camera;
    let of = |wrong: fn(&MarkerHealth) -> bool| {
        let named = markers.iter().zip(&camera.markers).filter(|(_, m)| wrong(m));
        named.map(|(name, _)| name.as_str()).collect::<Vec<_>>()
    };
    let near_hue = of(|m| m.seen > 0.0 && m.ball.hue_apart_deg < NEAR_HUE_DEG);
    let small = of(|m| m.ball.diameter_px > 0.0 && m.ball.diameter_px < SMALL_PX);
    [
        (of(|m| m.ball.saturated > GLINT), "overexposed: shorten the exposure or close the iris"),
        (near_hue, "before a background of nearly its hue: cover that, or paint the ball otherwise"),
        (small, "small: come closer, or use a longer lens or a larger ball"),
        (
            of(|m| m.seen < OFTEN_SEEN),
            "often not identified: look for what hides it, or place a further camera",
        ),
    ]
    .into_iter()
    .filter(|(named, _)| !named.is_empty())
    .map(|(named, what)| {
        let is = if named.len() == 1 { "is" } else { "are" };
        format!("{name}: {} {is} {what}.", named.join(", "))
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_vision::BallHealth;

    #[test]
    fn advice_names_camera_marker_and_trouble() {
        let ball =
            BallHealth { contrast: 0.5, diameter_px: 8.0, hue_apart_deg: 180.0, ..BallHealth::default() };
        let good = MarkerHealth { seen: 1.0, ball };
        let names = ["red".to_owned(), "blue".to_owned()];
        let mut camera = CameraHealth {
            camera: "cam1".into(),
            edge_px: 0.6,
            markers: vec![good; 2],
            ..CameraHealth::default()
        };
        assert!(advice(&camera, &names).is_empty());
        camera.markers[1] =
            MarkerHealth { seen: 1.0, ball: BallHealth { saturated: 0.4, hue_apart_deg: 5.0, ..ball } };
        let advice = advice(&camera, &names);
        assert_eq!(advice.len(), 2, "{advice:?}");
        assert!(
            advice[0].starts_with("cam1: blue is overexposed") && !advice.iter().any(|s| s.contains(" red "))
        );
    }
}
