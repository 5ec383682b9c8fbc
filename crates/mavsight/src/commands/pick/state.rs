//! What the page shows.

use mavsight_engine::{PickedBall, Picker};
use mavsight_flight::Color;
use mavsight_pose::Rig;
use serde::Serialize;

#[derive(Serialize)]
pub(super) struct State {
    /// An answer to what was done, in words; empty where all is as asked.
    said: String,
    cameras: Vec<CameraState>,
    points: Vec<PointState>,
    picked: Vec<BallState>,
    /// The points that disagree, in words.
    wrong: Vec<String>,
}

#[derive(Serialize)]
struct CameraState {
    name: String,
    verdict: String,
}

#[derive(Serialize)]
struct PointState {
    name: String,
    color: String,
}

#[derive(Serialize)]
struct BallState {
    camera: usize,
    point: usize,
    u_px: f64,
    v_px: f64,
    diameter_px: f64,
    color: String,
    residual_px: Option<f64>,
    residual_uv_px: Option<[f64; 2]>,
    wrong: bool,
}

pub(super) fn of(picker: &Picker, mut said: String) -> State {
    let rig = match picker.solved() {
        Ok(rig) => rig.unwrap_or_default(),
        Err(refused) => {
            if said.is_empty() {
                said = refused.to_string();
            }
            Rig::default()
        }
    };
    let points = picker.points().iter();
    State {
        said,
        cameras: (0..picker.stills().len()).map(|k| camera(picker, &rig, k)).collect(),
        points: points.map(|p| PointState { name: p.name.clone(), color: p.color.to_string() }).collect(),
        picked: picker.picked().iter().map(|p| ball(picker, &rig, p)).collect(),
        wrong: rig.left_out.iter().map(ToString::to_string).collect(),
    }
}

fn camera(picker: &Picker, rig: &Rig, k: usize) -> CameraState {
    let name = picker.stills()[k].camera.clone();
    let count = picker.picked().iter().filter(|p| p.camera == k).count();
    let verdict = match rig.cameras.iter().find(|c| c.name == name) {
        Some(solved) => format!(
            "{name} is calibrated by {} of {count} points: residuals {:.2} px (root mean square), centre to {:.1} mm.",
            solved.points.iter().filter(|p| p.used).count(),
            solved.residual_rms_px,
            1e3 * solved.centre_std_m.norm()
        ),
        None => format!(
            "{name}: {count} of {} points; six determine a camera, more check it.",
            picker.points().len()
        ),
    };
    CameraState { name, verdict }
}

fn ball(picker: &Picker, rig: &Rig, picked: &PickedBall) -> BallState {
    let (camera, name) = (&picker.stills()[picked.camera].camera, &picker.points()[picked.point].name);
    let solved = rig.cameras.iter().find(|c| c.name == *camera);
    let residual = solved.and_then(|c| c.points.iter().find(|p| p.name == *name));
    let [r, g, b] = picked.ball.color;
    BallState {
        camera: picked.camera,
        point: picked.point,
        u_px: picked.ball.pixel.x,
        v_px: picked.ball.pixel.y,
        diameter_px: picked.ball.diameter_px,
        color: Color::new(r, g, b).to_string(),
        residual_px: residual.map(|p| p.residual_px.norm()),
        residual_uv_px: residual.map(|p| p.residual_px.into()),
        wrong: residual.is_some_and(|p| !p.used),
    }
}
