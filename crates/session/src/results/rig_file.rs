//! `rig.toml`: the cameras, with the eleven parameters and what they mean.

use crate::SessionError;
use crate::files::{read_toml, toml_text, write_whole};
use mavsight_geometry::{
    BrownConrady, CAMERA_PARAMETERS, Camera, Dlt, ImageSize, Intrinsics, Isometry3, Matrix3, UnitQuaternion,
    Vector3,
};
use mavsight_pose::{ControlResidual, LeftOut, LeftOutReason, Rig, RigCamera};
use nalgebra::{DMatrix, Quaternion, Translation3};
use serde::{Deserialize, Serialize};
use std::path::Path;

const RIG_SCHEMA: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    schema: u32,
    /// Frames of a flight that have refined the cameras.
    #[serde(default)]
    frames: usize,
    /// What is not known of all cameras together: each row one independent direction of error, one standard
    /// deviation long; 16 numbers a camera, in their order: turn about the camera's axes (rad), centre in the
    /// world (m), fx, fy, skew, cx, cy (px), k1, k2, p1, p2, k3.
    #[serde(default)]
    uncertainty: Vec<Vec<f64>>,
    #[serde(default)]
    left_out: Vec<LeftOutEntry>,
    #[serde(default)]
    camera: Vec<CameraEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LeftOutEntry {
    name: String,
    camera: Option<String>,
    kind: LeftOutKind,
    /// The other points concerned.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    with: String,
    #[serde(default)]
    reason: String,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum LeftOutKind {
    Displaced,
    Swapped,
    Doubtful,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    name: String,
    width_px: u32,
    height_px: u32,
    model: String,
    /// L1 to L11 of the camera without its distortion; absent where the world's origin has no image.
    dlt: Option<[f64; 11]>,
    centre_in_world_m: [f64; 3],
    centre_std_m: [f64; 3],
    /// Row by row.
    centre_cov_m2: [f64; 9],
    /// Of the rotation from world to camera axes.
    cam_from_world_wxyz: [f64; 4],
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    #[serde(default)]
    skew_px: f64,
    #[serde(default)]
    distortion_k1_k2_p1_p2_k3: [f64; 5],
    residual_rms_px: f64,
    sigma_px: f64,
    #[serde(default)]
    point: Vec<PointEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointEntry {
    name: String,
    position_m: [f64; 3],
    residual_px: [f64; 2],
    #[serde(default)]
    studentised: f64,
    #[serde(default = "yes")]
    used: bool,
}

fn yes() -> bool {
    true
}

/// Writes a rig.
///
/// # Errors
/// What the file system refuses.
pub fn write_rig(path: &Path, rig: &Rig) -> Result<(), SessionError> {
    write_whole(path, text(rig, path)?.as_bytes())
}

pub(super) fn text(rig: &Rig, path: &Path) -> Result<String, SessionError> {
    let file = RigFile {
        schema: RIG_SCHEMA,
        frames: rig.frames,
        uncertainty: rig.uncertainty.column_iter().map(|c| c.iter().copied().collect()).collect(),
        left_out: rig.left_out.iter().map(left_out_entry).collect(),
        camera: rig.cameras.iter().map(entry).collect(),
    };
    toml_text(path, &file)
}

fn left_out_entry(point: &LeftOut) -> LeftOutEntry {
    let (kind, with) = match &point.reason {
        LeftOutReason::Displaced => (LeftOutKind::Displaced, String::new()),
        LeftOutReason::Swapped { with } => (LeftOutKind::Swapped, with.clone()),
        LeftOutReason::Doubtful { with } => (LeftOutKind::Doubtful, with.clone()),
    };
    let (name, camera) = (point.name.clone(), point.camera.clone());
    LeftOutEntry { name, camera, kind, with, reason: point.to_string() }
}

fn entry(camera: &RigCamera) -> CameraEntry {
    let Camera { cam_from_world, intrinsics, distortion: d, size } = camera.camera;
    let Intrinsics { fx_px, fy_px, cx_px, cy_px, skew_px } = intrinsics;
    let ImageSize { width_px, height_px } = size;
    let q = cam_from_world.rotation.quaternion();
    CameraEntry {
        name: camera.name.clone(),
        width_px,
        height_px,
        model: camera.model.to_string(),
        dlt: Dlt::from_camera(&camera.camera).ok().map(|dlt| dlt.l),
        centre_in_world_m: camera.camera.centre_in_world().into(),
        centre_std_m: camera.centre_std_m.into(),
        centre_cov_m2: std::array::from_fn(|k| camera.centre_cov_m2[(k / 3, k % 3)]),
        cam_from_world_wxyz: [q.w, q.i, q.j, q.k],
        fx_px,
        fy_px,
        cx_px,
        cy_px,
        skew_px,
        distortion_k1_k2_p1_p2_k3: [d.k1, d.k2, d.p1, d.p2, d.k3],
        residual_rms_px: camera.residual_rms_px,
        sigma_px: camera.sigma_px,
        point: camera
            .points
            .iter()
            .map(|p| PointEntry {
                name: p.name.clone(),
                position_m: p.point_in_world_m.into(),
                residual_px: p.residual_px.into(),
                studentised: p.studentised,
                used: p.used,
            })
            .collect(),
    }
}

/// Reads a rig that this crate, or a person, wrote.
///
/// # Errors
/// Names the file and the line or camera.
pub fn read_rig(path: &Path) -> Result<Rig, SessionError> {
    let file: RigFile = read_toml(path, "rig: `calibrate` writes it")?;
    let refuse = |key: &str, detail: &str| SessionError::value(path, key, detail);
    if file.schema != RIG_SCHEMA {
        return Err(refuse("schema", "this version reads schema = 1"));
    }
    if file.camera.is_empty() {
        return Err(refuse("camera", "there is none: calibrate again"));
    }
    let rows = CAMERA_PARAMETERS * file.camera.len();
    let whole = |direction: &Vec<f64>| direction.len() == rows && direction.iter().all(|x| x.is_finite());
    if !file.uncertainty.iter().all(whole) {
        let detail = "each row must have 16 finite numbers a camera: calibrate again";
        return Err(refuse("uncertainty", detail));
    }
    let uncertainty = DMatrix::from_fn(rows, file.uncertainty.len(), |i, k| file.uncertainty[k][i]);
    let cameras = file.camera.into_iter().map(|entry| camera(entry, path));
    let left_out = file.left_out.into_iter().map(|LeftOutEntry { name, camera, kind, with, .. }| {
        let reason = match kind {
            LeftOutKind::Displaced => LeftOutReason::Displaced,
            LeftOutKind::Swapped => LeftOutReason::Swapped { with },
            LeftOutKind::Doubtful => LeftOutReason::Doubtful { with },
        };
        LeftOut { name, camera, reason }
    });
    let (left_out, frames) = (left_out.collect(), file.frames);
    let cameras = cameras.collect::<Result<_, _>>()?;
    Ok(Rig { cameras, uncertainty, left_out, frames, ..Rig::default() })
}

fn camera(entry: CameraEntry, path: &Path) -> Result<RigCamera, SessionError> {
    let refuse = |detail: String| SessionError::value(path, format!("camera {}", entry.name), detail);
    let CameraEntry { width_px, height_px, fx_px, fy_px, cx_px, cy_px, skew_px, .. } = entry;
    let [w, i, j, k] = entry.cam_from_world_wxyz;
    let quaternion = Quaternion::new(w, i, j, k);
    let lens = entry.distortion_k1_k2_p1_p2_k3;
    let are_finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    let is_focal = |f: f64| f.is_finite() && f > 0.0;
    let checks = [
        ((quaternion.norm() - 1.0).abs() <= 1e-6, "cam_from_world_wxyz is not a unit quaternion"),
        (
            is_focal(fx_px) && is_focal(fy_px) && are_finite(&entry.centre_in_world_m),
            "focal lengths must be above zero and the centre finite",
        ),
        (
            are_finite(&[cx_px, cy_px, skew_px]) && are_finite(&lens),
            "principal point, skew and distortion must be finite",
        ),
        (width_px > 0 && height_px > 0, "width_px and height_px must be above zero"),
    ];
    if let Some((_, wrong)) = checks.iter().find(|(holds, _)| !holds) {
        return Err(refuse(format!("{wrong}: calibrate again")));
    }
    let model = entry.model.parse().map_err(|e| refuse(format!("{e}")))?;
    let rotation = UnitQuaternion::new_unchecked(quaternion);
    let translation = -(rotation * Vector3::from(entry.centre_in_world_m));
    let [k1, k2, p1, p2, k3] = lens;
    Ok(RigCamera {
        camera: Camera {
            cam_from_world: Isometry3::from_parts(Translation3::from(translation), rotation),
            intrinsics: Intrinsics { fx_px, fy_px, cx_px, cy_px, skew_px },
            distortion: BrownConrady { k1, k2, p1, p2, k3 },
            size: ImageSize { width_px, height_px },
        },
        model,
        centre_std_m: entry.centre_std_m.into(),
        centre_cov_m2: Matrix3::from_row_slice(&entry.centre_cov_m2),
        points: entry
            .point
            .into_iter()
            .map(|p| ControlResidual {
                name: p.name,
                point_in_world_m: p.position_m.into(),
                residual_px: p.residual_px.into(),
                studentised: p.studentised,
                used: p.used,
            })
            .collect(),
        residual_rms_px: entry.residual_rms_px,
        sigma_px: entry.sigma_px,
        name: entry.name,
    })
}
