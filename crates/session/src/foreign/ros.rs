//! ROS camera_info as YAML (camera_calibration_parsers): one camera, its lens and image size; no place.

use super::Noted;
use super::rigs::{
    checked, coefficients, distortion, exact_rig, image_size, one_camera, rig_camera, without_skew,
};
use super::yaml::YamlFile;
use crate::{SessionError, write_whole};
use mavsight_geometry::{Camera, Intrinsics, Isometry3};
use mavsight_pose::Rig;
use std::path::Path;

/// Reads one camera; `names` may give it another name.
///
/// # Errors
/// Names the line or key; a distortion model other than `plumb_bob`, or `rational_polynomial` with k4 to k6
/// of zero.
pub fn read(path: &Path, names: &[String]) -> Result<Noted<Rig>, SessionError> {
    let file = YamlFile::read(path, "ROS camera_info")?;
    let at = file.key(&file.root, "image_width")?;
    let (w, h) = (file.number(at)?, file.number(file.key(&file.root, "image_height")?)?);
    let size = image_size(w, h).map_err(|e| file.refuse(at, e))?;
    let m = file.shaped(file.key(&file.root, "camera_matrix")?, 3, 3)?;
    let intrinsics = Intrinsics { fx_px: m[0], skew_px: m[1], cx_px: m[2], fy_px: m[4], cy_px: m[5] };
    let intrinsics = checked(path, "camera_matrix", intrinsics, size)?;
    let model = file.key(&file.root, "distortion_model")?;
    let kind = model.text().unwrap_or("").to_owned();
    if !matches!(kind.as_str(), "plumb_bob" | "rational_polynomial") {
        return Err(file.refuse(
            model,
            format!("distortion model {kind:?}: this program has plumb_bob; calibrate with it"),
        ));
    }
    let d = file.matrix(file.key(&file.root, "distortion_coefficients")?)?.data;
    let distortion = distortion(path, "distortion_coefficients", &d)?;
    let own = file.root.get("camera_name").and_then(|n| n.text()).filter(|n| !n.is_empty()).unwrap_or("cam1");
    let name = names.first().map_or(own, String::as_str).to_owned();
    let camera = Camera { cam_from_world: Isometry3::identity(), intrinsics, distortion, size };
    let notes = vec![
        "camera_info says nothing of where the camera is: it stands at the origin and looks along Z"
            .to_owned(),
    ];
    Ok(exact_rig(vec![rig_camera(name, camera)], notes))
}

/// Writes one camera; its rectification is none, its projection that of the undistorted camera.
///
/// # Errors
/// No choice among several cameras, skew that may not be dropped, what the file system refuses.
pub fn write(
    path: &Path,
    rig: &Rig,
    camera: Option<&str>,
    drop_skew: bool,
) -> Result<Vec<String>, SessionError> {
    let camera = one_camera(path, rig, camera)?;
    let mut notes: Vec<String> = without_skew(path, camera, drop_skew)?.into_iter().collect();
    let (i, size) = (&camera.camera.intrinsics, camera.camera.size);
    if camera.name.contains(['"', '\n']) {
        return Err(SessionError::value(
            path,
            "camera_name",
            format!("{:?} holds a quote or a line's end: rename the camera", camera.name),
        ));
    }
    let k = [i.fx_px, 0.0, i.cx_px, 0.0, i.fy_px, i.cy_px, 0.0, 0.0, 1.0];
    let p = [i.fx_px, 0.0, i.cx_px, 0.0, 0.0, i.fy_px, i.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0];
    let text = format!(
        "image_width: {}\nimage_height: {}\ncamera_name: {:?}\n{}distortion_model: plumb_bob\n{}{}{}",
        size.width_px,
        size.height_px,
        camera.name,
        matrix("camera_matrix", 3, &k),
        matrix("distortion_coefficients", 1, &coefficients(&camera.camera.distortion)),
        matrix("rectification_matrix", 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        matrix("projection_matrix", 3, &p),
    );
    write_whole(path, text.as_bytes())?;
    notes.push("camera_info holds no place: it is left out".into());
    Ok(notes)
}

fn matrix(key: &str, rows: usize, data: &[f64]) -> String {
    let numbers: Vec<String> = data.iter().map(|x| format!("{x:?}")).collect();
    format!("{key}:\n  rows: {rows}\n  cols: {}\n  data: [{}]\n", data.len() / rows, numbers.join(", "))
}
