//! ROS camera_info as YAML (camera_calibration_parsers): one camera, its lens and image size; no place.

use super::rigs::{camera_matrix, coefficients, distortion, exact_rig, image_size, rig_camera, without_skew};
use super::yaml::YamlFile;
use super::{CameraOptions, Noted};
use crate::{SessionError, write_whole};
use mavsight_geometry::{Camera, Isometry3};
use mavsight_pose::Rig;
use std::path::Path;

/// Reads one camera; the distortion model is `plumb_bob`, or `rational_polynomial` with k4 to k6 of zero.
///
/// # Errors
/// Those of [`crate::foreign`] for readers of cameras; what the file system refuses.
pub fn read(path: &Path, options: &CameraOptions) -> Result<Noted<Rig>, SessionError> {
    let file = YamlFile::read(path, "ROS camera_info")?;
    let at = file.key(&file.root, "image_width")?;
    let (w, h) = (file.number(at)?, file.number(file.key(&file.root, "image_height")?)?);
    let size = image_size(w, h, |detail| file.refuse(at, detail))?;
    let intrinsics = file.intrinsics("camera_matrix", size)?;
    let remedy = "this program has plumb_bob; calibrate with it";
    file.word(&file.root, "distortion_model", &["plumb_bob", "rational_polynomial"], remedy)?;
    let d = file.matrix(file.key(&file.root, "distortion_coefficients")?, None)?;
    let distortion = distortion(path, "distortion_coefficients", &d)?;
    let own = file.root.get("camera_name").and_then(|n| n.text()).filter(|n| !n.is_empty()).unwrap_or("cam1");
    let name = options.names.first().map_or(own, String::as_str).to_owned();
    let camera = Camera { cam_from_world: Isometry3::identity(), intrinsics, distortion, size };
    let note = "camera_info says nothing of where the camera is: it stands at the origin and looks along Z";
    Ok(exact_rig(vec![rig_camera(name, camera)], vec![note.to_owned()]))
}

/// Writes one camera; its rectification is none, its projection that of the undistorted camera.
///
/// # Errors
/// Those of [`crate::foreign`] for writers of cameras; what the file system refuses.
pub fn write(path: &Path, rig: &Rig, options: &CameraOptions) -> Result<Vec<String>, SessionError> {
    let [camera] = &rig.cameras[..] else {
        let names: Vec<&str> = rig.cameras.iter().map(|c| c.name.as_str()).collect();
        let detail = format!("the format holds one: choose by --camera, of {}", names.join(", "));
        return Err(SessionError::value(path, "camera", detail));
    };
    let mut notes: Vec<String> = without_skew(path, camera, options.drop_skew)?.into_iter().collect();
    let (i, size) = (&camera.camera.intrinsics, camera.camera.size);
    if camera.name.contains(['"', '\n']) {
        let detail = format!("{:?} holds a quote or a line's end: rename the camera", camera.name);
        return Err(SessionError::value(path, "camera_name", detail));
    }
    let projection = [i.fx_px, 0.0, i.cx_px, 0.0, 0.0, i.fy_px, i.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0];
    let text = format!(
        "image_width: {}\nimage_height: {}\ncamera_name: {:?}\n{}distortion_model: plumb_bob\n{}{}{}",
        size.width_px,
        size.height_px,
        camera.name,
        matrix("camera_matrix", 3, &camera_matrix(i)),
        matrix("distortion_coefficients", 1, &coefficients(&camera.camera.distortion)),
        matrix("rectification_matrix", 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        matrix("projection_matrix", 3, &projection),
    );
    write_whole(path, text.as_bytes())?;
    notes.push("camera_info holds no place: it is left out".into());
    Ok(notes)
}

fn matrix(key: &str, rows: usize, data: &[f64]) -> String {
    format!("{key}:\n  rows: {rows}\n  cols: {}\n  data: {data:?}\n", data.len() / rows)
}
