//! `rig.toml`: the cameras, with the eleven parameters and what they mean.

use crate::{SessionError, toml_file::read_toml, write_whole};
use mavsight_geometry::{
    BrownConrady, Camera, Dlt, DltFit, ImageSize, Intrinsics, Isometry3, Matrix3, UnitQuaternion, Vector2,
    Vector3,
};
use mavsight_pose::{Rig, RigCamera};
use nalgebra::{Quaternion, SMatrix, Translation3};
use serde::{Deserialize, Serialize};
use std::path::Path;

const RIG_SCHEMA: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    schema: u32,
    #[serde(default)]
    camera: Vec<CameraEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    name: String,
    width_px: u32,
    height_px: u32,
    /// L1 to L11.
    dlt: [f64; 11],
    /// Row by row.
    #[serde(default)]
    dlt_covariance: Vec<f64>,
    centre_in_world_m: [f64; 3],
    centre_std_m: [f64; 3],
    /// Row by row.
    centre_cov_m2: Vec<f64>,
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
    condition: f64,
    #[serde(default)]
    point: Vec<PointEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointEntry {
    name: String,
    position_m: [f64; 3],
    residual_px: [f64; 2],
}

/// Writes a rig.
///
/// # Errors
/// What the file system refuses.
pub fn write_rig(path: &Path, rig: &Rig) -> Result<(), SessionError> {
    write_whole(path, text(rig, path)?.as_bytes())
}

pub(super) fn text(rig: &Rig, path: &Path) -> Result<String, SessionError> {
    let file = RigFile { schema: RIG_SCHEMA, camera: rig.cameras.iter().map(entry).collect() };
    toml::to_string(&file)
        .map_err(|e| SessionError::io(path, "express it as TOML", std::io::Error::other(e.to_string())))
}

fn row_by_row(values: impl Fn(usize, usize) -> f64, size: usize) -> Vec<f64> {
    (0..size * size).map(|k| values(k / size, k % size)).collect()
}

fn entry(camera: &RigCamera) -> CameraEntry {
    let Camera { cam_from_world, intrinsics: i, distortion: d, size } = &camera.camera;
    let q = cam_from_world.rotation.quaternion();
    let points = camera.points.iter().zip(&camera.points_in_world_m);
    CameraEntry {
        name: camera.name.clone(),
        width_px: size.width_px,
        height_px: size.height_px,
        dlt: camera.fit.dlt.l,
        dlt_covariance: row_by_row(|r, c| camera.fit.covariance[(r, c)], 11),
        centre_in_world_m: cam_from_world.inverse().translation.vector.into(),
        centre_std_m: camera.centre_std_m.into(),
        centre_cov_m2: row_by_row(|r, c| camera.centre_cov_m2[(r, c)], 3),
        cam_from_world_wxyz: [q.w, q.i, q.j, q.k],
        fx_px: i.fx_px,
        fy_px: i.fy_px,
        cx_px: i.cx_px,
        cy_px: i.cy_px,
        skew_px: i.skew_px,
        distortion_k1_k2_p1_p2_k3: [d.k1, d.k2, d.p1, d.p2, d.k3],
        residual_rms_px: camera.fit.rms_px,
        sigma_px: camera.sigma_px,
        condition: camera.fit.condition,
        point: points
            .map(|((name, residual), position)| PointEntry {
                name: name.clone(),
                position_m: (*position).into(),
                residual_px: (*residual).into(),
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
    let refuse = |key: String, detail: &str| SessionError::Value {
        path: path.to_owned(),
        key,
        detail: detail.to_owned(),
    };
    if file.schema != RIG_SCHEMA {
        return Err(refuse("schema".into(), "this version reads schema = 1"));
    }
    if file.camera.is_empty() {
        return Err(refuse("camera".into(), "there is none: calibrate again"));
    }
    let cameras = file.camera.into_iter().map(|entry| {
        let name = entry.name.clone();
        camera(entry).map_err(|detail| refuse(format!("camera {name}"), detail))
    });
    Ok(Rig::exact(cameras.collect::<Result<_, _>>()?))
}

fn camera(entry: CameraEntry) -> Result<RigCamera, &'static str> {
    let [w, i, j, k] = entry.cam_from_world_wxyz;
    let quaternion = Quaternion::new(w, i, j, k);
    let off_unit = (quaternion.norm() - 1.0).abs();
    if !off_unit.is_finite() || off_unit > 1e-6 {
        return Err("cam_from_world_wxyz is not a unit quaternion: calibrate again");
    }
    let focal = [entry.fx_px, entry.fy_px].iter().all(|f| f.is_finite() && *f > 0.0);
    if !focal || !entry.centre_in_world_m.iter().all(|x| x.is_finite()) {
        return Err("focal lengths must be above zero and the centre finite: calibrate again");
    }
    if entry.width_px == 0 || entry.height_px == 0 {
        return Err("width_px and height_px must be above zero: calibrate again");
    }
    if entry.centre_cov_m2.len() != 9
        || !(entry.dlt_covariance.is_empty() || entry.dlt_covariance.len() == 121)
    {
        return Err("centre_cov_m2 must have 9 numbers and dlt_covariance 121: calibrate again");
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    let translation = -(rotation * Vector3::from(entry.centre_in_world_m));
    let [k1, k2, p1, p2, k3] = entry.distortion_k1_k2_p1_p2_k3;
    let covariance = if entry.dlt_covariance.is_empty() {
        SMatrix::zeros()
    } else {
        SMatrix::from_row_slice(&entry.dlt_covariance)
    };
    Ok(RigCamera {
        camera: Camera {
            cam_from_world: Isometry3::from_parts(Translation3::from(translation), rotation),
            intrinsics: Intrinsics {
                fx_px: entry.fx_px,
                fy_px: entry.fy_px,
                cx_px: entry.cx_px,
                cy_px: entry.cy_px,
                skew_px: entry.skew_px,
            },
            distortion: BrownConrady { k1, k2, p1, p2, k3 },
            size: ImageSize { width_px: entry.width_px, height_px: entry.height_px },
        },
        fit: DltFit {
            dlt: Dlt { l: entry.dlt },
            residuals_px: entry.point.iter().map(|p| Vector2::from(p.residual_px)).collect(),
            rms_px: entry.residual_rms_px,
            condition: entry.condition,
            covariance,
        },
        centre_std_m: entry.centre_std_m.into(),
        centre_cov_m2: Matrix3::from_row_slice(&entry.centre_cov_m2),
        points_in_world_m: entry.point.iter().map(|p| p.position_m.into()).collect(),
        points: entry.point.into_iter().map(|p| (p.name, p.residual_px.into())).collect(),
        sigma_px: entry.sigma_px,
        name: entry.name,
    })
}
