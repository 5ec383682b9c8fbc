//! What the page shows.

use mavsight_engine::{PickedBall, Picker};
use mavsight_flight::Color;
use mavsight_pose::Rig;
use mavsight_report::picture_address;
use mavsight_vision::{Detection, Frame};
use serde::Serialize;

/// Pictures are shown with all their pixels up to this width.
const MOST_WIDTH_PX: u32 = 8192;

/// All that is named by clicks: control points, or markers.
#[derive(Default, Serialize)]
pub(super) struct State {
    /// An answer to what was done, in words; empty where all is as asked.
    pub(super) said: String,
    pub(super) cameras: Vec<CameraState>,
    pub(super) points: Vec<PointState>,
    pub(super) picked: Vec<BallState>,
    /// What disagrees, in words.
    pub(super) wrong: Vec<String>,
    /// What the detection finds in the frame that is shown, by the colours that were clicked.
    pub(super) found: Vec<FoundState>,
}

#[derive(Serialize)]
pub(super) struct CameraState {
    pub(super) name: String,
    pub(super) verdict: String,
    /// Frames that can be chosen; one still has none.
    pub(super) frames: usize,
}

#[derive(Serialize)]
pub(super) struct PointState {
    pub(super) name: String,
    pub(super) color: String,
}

#[derive(Serialize)]
pub(super) struct BallState {
    pub(super) camera: usize,
    pub(super) frame: usize,
    pub(super) point: usize,
    pub(super) u_px: f64,
    pub(super) v_px: f64,
    pub(super) diameter_px: f64,
    pub(super) color: String,
    pub(super) residual_px: Option<f64>,
    pub(super) residual_uv_px: Option<[f64; 2]>,
    pub(super) wrong: bool,
}

impl BallState {
    pub(super) fn of(camera: usize, frame: usize, point: usize, ball: &Detection) -> Self {
        let [r, g, b] = ball.color;
        Self {
            camera,
            frame,
            point,
            u_px: ball.pixel.x,
            v_px: ball.pixel.y,
            diameter_px: ball.diameter_px,
            color: Color::new(r, g, b).to_string(),
            residual_px: None,
            residual_uv_px: None,
            wrong: false,
        }
    }
}

#[derive(Serialize)]
pub(super) struct FoundState {
    pub(super) point: usize,
    pub(super) u_px: f64,
    pub(super) v_px: f64,
    pub(super) diameter_px: f64,
}

/// A picture, or how far a film was read on the way to it.
#[derive(Default, Serialize)]
pub(super) struct Picture {
    /// As an address; none where it was not reached yet, or where it cannot be read.
    pub(super) address: Option<String>,
    /// Its time, or that of the last frame on the way.
    pub(super) t_s: Option<f64>,
    /// Why there is none, in words.
    pub(super) refused: Option<String>,
}

impl Picture {
    pub(super) fn of(frame: &Frame, t_s: Option<f64>) -> Self {
        match picture_address(frame, MOST_WIDTH_PX) {
            Ok(address) => Self { address: Some(address), t_s, refused: None },
            Err(error) => Self { address: None, t_s, refused: Some(error.to_string()) },
        }
    }
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
        found: Vec::new(),
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
    CameraState { name, verdict, frames: 0 }
}

fn ball(picker: &Picker, rig: &Rig, picked: &PickedBall) -> BallState {
    let (camera, name) = (&picker.stills()[picked.camera].camera, &picker.points()[picked.point].name);
    let solved = rig.cameras.iter().find(|c| c.name == *camera);
    let residual = solved.and_then(|c| c.points.iter().find(|p| p.name == *name));
    BallState {
        residual_px: residual.map(|p| p.residual_px.norm()),
        residual_uv_px: residual.map(|p| p.residual_px.into()),
        wrong: residual.is_some_and(|p| !p.used),
        ..BallState::of(picked.camera, 0, picked.point, &picked.ball)
    }
}
