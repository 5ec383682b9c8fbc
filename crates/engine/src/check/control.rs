//! The control points in the stills: where the calibration has them, and which were not found.

use super::film::disc_rgb;
use super::{CameraCheck, CheckItem};
use mavsight_geometry::{Camera, Vector2};
use mavsight_pipeline::{Cause, ControlPointRow};
use mavsight_pose::{LeftOut, Rig};
use mavsight_session::Session;

/// A control point in a still.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlBall {
    /// Its name.
    pub name: String,
    /// Its nominal colour.
    pub nominal: [u8; 3],
    /// Where the calibration has it; it may lie outside of the image.
    pub pixel: Vector2<f64>,
    /// Apparent diameter there.
    pub diameter_px: f64,
    /// Length of the residual; none where it was not found.
    pub residual_px: Option<f64>,
    /// Whether it entered the calibration.
    pub is_used: bool,
    /// Mean colour of the disc there, sRGB-coded.
    pub rgb: [u8; 3],
}

/// Marks the control points in the stills, and names those that a camera does not see and the calibration did not leave out.
pub(super) fn look(session: &Session, rig: &Rig, cameras: &mut [CameraCheck]) -> Vec<CheckItem> {
    let Ok(table) = session.control_points() else { return Vec::new() };
    if session.file.control.as_ref().is_none_or(|c| c.observations.is_some()) {
        return Vec::new();
    }
    let mut items = Vec::new();
    for (k, (camera, own)) in cameras.iter_mut().zip(&rig.cameras).enumerate() {
        let Some((frame, balls)) = &mut camera.still else { continue };
        for row in &table {
            let Some((pixel, diameter_px)) = seen_by(&own.camera, row) else { continue };
            let found = own.points.iter().find(|p| p.name == row.name);
            balls.push(ControlBall {
                name: row.name.clone(),
                nominal: row.color.rgb(),
                pixel,
                diameter_px,
                residual_px: found.map(|p| p.residual_px.norm()),
                is_used: found.is_some_and(|p| p.used),
                rgb: disc_rgb(frame, pixel, diameter_px),
            });
        }
        let is_left_out = |ball: &ControlBall| {
            let of_this = |point: &&LeftOut| point.camera.as_ref().is_none_or(|name| *name == camera.name);
            rig.left_out.iter().filter(of_this).any(|point| point.name == ball.name)
        };
        for ball in balls.iter().filter(|b| b.residual_px.is_none() && !is_left_out(b)) {
            items.push(not_found(k, &camera.name, &own.camera, ball));
        }
    }
    items
}

/// Control points that the calibration left out, and why.
pub(super) fn left_out(rig: &Rig) -> impl Iterator<Item = CheckItem> {
    rig.left_out.iter().map(|point| {
        let of = point.camera.as_ref();
        let camera = of.and_then(|name| rig.cameras.iter().position(|own| own.name == *name));
        CheckItem { camera, ..CheckItem::of_note(format!("Calibration: {point}.")) }
    })
}

fn seen_by(camera: &Camera, row: &ControlPointRow) -> Option<(Vector2<f64>, f64)> {
    let at = row.position_m.into();
    let pixel = camera.project(&at).ok()?.pixel;
    let away_m = (at - camera.centre_in_world()).norm();
    let focal_px = (camera.intrinsics.fx_px * camera.intrinsics.fy_px).abs().sqrt();
    Some((pixel, focal_px * row.diameter_m / away_m))
}

/// Whether it is outside of the image is where the calibration by the others has it.
fn not_found(k: usize, name: &str, camera: &Camera, ball: &ControlBall) -> CheckItem {
    let (u, v) = (ball.pixel.x, ball.pixel.y);
    if !camera.size.contains(&ball.pixel, 0.5 * ball.diameter_px) {
        let text = format!(
            "{name}: the control ball {} lies outside of its image, at ({u:.0}, {v:.0}) of {}×{} px: turn the camera, move it back, or move \
             the ball; it is calibrated by the others.",
            ball.name, camera.size.width_px, camera.size.height_px
        );
        return CheckItem::of_cause(Cause::ControlOutside, Some(k), text);
    }
    let [r, g, b] = ball.rgb;
    CheckItem {
        camera: Some(k),
        by_click: true,
        ..CheckItem::of_note(format!(
            "{name}: the control ball {} was not found at ({u:.0}, {v:.0}), where the others have it: it is hidden, or its colour is \
             another; there the picture has #{r:02x}{g:02x}{b:02x}.",
            ball.name
        ))
    }
}
