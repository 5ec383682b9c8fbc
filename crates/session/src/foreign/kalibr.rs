//! Kalibr's camchain: `cam0`, `cam1`, ... with `T_cn_cnm1`, the transform from the camera before.
//!
//! Its pixels are OpenCV's and this program's. The world is cam0.

use super::rigs::{checked, exact_rig, image_size, isometry, rig_camera, rows_of, without_skew};
use super::yaml::{Yaml, YamlFile};
use super::{CameraOptions, Noted};
use crate::{SessionError, write_whole};
use mavsight_geometry::{BrownConrady, Camera, Intrinsics, Isometry3};
use mavsight_pose::Rig;
use std::path::Path;

/// Reads a camchain: pinhole cameras with radtan distortion or none.
///
/// # Errors
/// Those of [`crate::foreign`] for readers of cameras; what the file system refuses.
pub fn read(path: &Path, options: &CameraOptions) -> Result<Noted<Rig>, SessionError> {
    let file = YamlFile::read(path, "Kalibr camchain")?;
    let mut cameras = Vec::new();
    let mut notes = vec!["the world is cam0: x right, y down, z forward".to_owned()];
    let mut cam_from_world = Isometry3::identity();
    for k in 0.. {
        let key = format!("cam{k}");
        let Some(node) = file.root.get(&key) else { break };
        if k > 0 {
            let step = file.numbers(file.key(node, "T_cn_cnm1")?)?;
            cam_from_world = isometry(path, &format!("{key}: T_cn_cnm1"), &step)? * cam_from_world;
        }
        if let Some(shift) = node.get("timeshift_cam_imu") {
            notes.push(format!("{key}: timeshift_cam_imu of {} s is left alone", file.number(shift)?));
        }
        let camera = camera(&file, node, &key, cam_from_world)?;
        cameras.push(rig_camera(options.names.get(k).cloned().unwrap_or(key), camera));
    }
    if cameras.is_empty() {
        let detail = format!("is missing; the keys are {}", file.root.keys().join(", "));
        return Err(SessionError::value(path, "cam0", detail));
    }
    Ok(exact_rig(cameras, notes))
}

fn camera(
    file: &YamlFile,
    node: &Yaml,
    key: &str,
    cam_from_world: Isometry3<f64>,
) -> Result<Camera, SessionError> {
    let remedy = "this program has pinhole; calibrate with pinhole-radtan";
    file.word(node, "camera_model", &["pinhole"], remedy)?;
    let remedy = "this program has radtan; calibrate with pinhole-radtan";
    let lens = file.word(node, "distortion_model", &["radtan", "none"], remedy)?;
    let [fx_px, fy_px, cx_px, cy_px] = file.exactly(file.key(node, "intrinsics")?, "fu fv pu pv")?;
    let at = file.key(node, "resolution")?;
    let [w, h] = file.exactly(at, "a resolution")?;
    let size = image_size(w, h, |detail| file.refuse(at, detail))?;
    let intrinsics = checked(&file.path, key, Intrinsics { fx_px, fy_px, cx_px, cy_px, skew_px: 0.0 }, size)?;
    let mut distortion = BrownConrady::default();
    if lens == "radtan" {
        let [k1, k2, p1, p2] = file.exactly(file.key(node, "distortion_coeffs")?, "radtan")?;
        distortion = BrownConrady { k1, k2, p1, p2, k3: 0.0 };
    }
    Ok(Camera { cam_from_world, intrinsics, distortion, size })
}

/// Writes a camchain; refuses a k3, which radtan has not.
///
/// # Errors
/// Those of [`crate::foreign`] for writers of cameras; what the file system refuses.
pub fn write(path: &Path, rig: &Rig, options: &CameraOptions) -> Result<Vec<String>, SessionError> {
    let mut text = String::new();
    let mut notes = Vec::new();
    for (k, camera) in rig.cameras.iter().enumerate() {
        notes.extend(without_skew(path, camera, options.drop_skew)?);
        let (i, d, size) = (&camera.camera.intrinsics, &camera.camera.distortion, camera.camera.size);
        if d.k3 != 0.0 {
            let detail = format!(
                "k3 of {} has no place in Kalibr's radtan: write OpenCV or ROS, or calibrate without k3",
                d.k3
            );
            return Err(SessionError::value(path, format!("camera {}", camera.name), detail));
        }
        let others: Vec<String> = (0..rig.cameras.len()).filter(|o| *o != k).map(|o| o.to_string()).collect();
        text += &format!("cam{k}:\n");
        if k > 0 {
            let step = camera.camera.cam_from_world * rig.cameras[k - 1].camera.cam_from_world.inverse();
            text += "  T_cn_cnm1:\n";
            for row in rows_of(&step) {
                text += &format!("  - {row:?}\n");
            }
            text += "  - [0.0, 0.0, 0.0, 1.0]\n";
        }
        text += &format!(
            "  cam_overlaps: [{}]\n  camera_model: pinhole\n  distortion_coeffs: {:?}\n  distortion_model: radtan\n  intrinsics: {:?}\n  \
             resolution: [{}, {}]\n  rostopic: /{}/image_raw\n",
            others.join(", "),
            [d.k1, d.k2, d.p1, d.p2],
            [i.fx_px, i.fy_px, i.cx_px, i.cy_px],
            size.width_px,
            size.height_px,
            camera.name.replace(|c: char| !c.is_alphanumeric(), "_"),
        );
    }
    write_whole(path, text.as_bytes())?;
    notes.push("a camchain's world is its first camera: where that one stands is left out".into());
    Ok(notes)
}
