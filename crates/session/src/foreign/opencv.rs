//! OpenCV's calibration files (FileStorage, YAML): one camera, or several.
//!
//! Names read: `M1 D1 M2 D2 ... R T` of the stereo sample (also `K1`, `cameraMatrix1`, `distCoeffs1`), or
//! `camera_matrix` and `distortion_coefficients` of the calibration sample; `image_width`, `image_height`;
//! and `cam_from_world_1`, ..., 3×4, which this program writes and OpenCV leaves alone. With R and T (x2 = R
//! x1 + T) and without those, camera 1 is the world. Pixels and distortion (k1 k2 p1 p2 k3) are as in this
//! program.

use super::Noted;
use super::rigs::{
    checked, coefficients, distortion, exact_rig, image_size, isometry, names_and_sizes, rig_camera,
    rotation, rows_of, without_skew,
};
use super::yaml::YamlFile;
use crate::{SessionError, write_whole};
use mavsight_geometry::{Camera, ImageSize, Intrinsics, Isometry3, Matrix3, Vector3};
use mavsight_pose::Rig;
use std::path::Path;

const MATRIX: [&str; 4] = ["M", "K", "cameraMatrix", "camera_matrix"];
const LENS: [&str; 4] = ["D", "D", "distCoeffs", "distortion_coefficients"];

/// Reads a file that OpenCV 3, 4 or 5 or this program wrote.
///
/// # Errors
/// Names the line or key: no camera matrix, a wrong count of numbers, skew is kept, coefficients beyond k3
/// are refused, an image size that neither the file nor the caller gives.
pub fn read(path: &Path, sizes: &[ImageSize], names: &[String]) -> Result<Noted<Rig>, SessionError> {
    let file = YamlFile::read(path, "OpenCV calibration")?;
    let suffixes = suffixes(&file);
    if suffixes.is_empty() {
        let detail = format!(
            "no camera matrix: M1, K1, cameraMatrix1 or camera_matrix is wanted; the keys are {}",
            file.root.keys().join(", ")
        );
        return Err(SessionError::value(path, "camera", detail));
    }
    let own = own_sizes(&file, &suffixes)?;
    if !own.is_empty() && !sizes.is_empty() && sizes.iter().zip(own.iter().cycle()).any(|(a, b)| a != b) {
        let (wide, high) = (own[0].width_px, own[0].height_px);
        let detail = format!(
            "the file says {wide}×{high}, the call another: leave it out of the call, or correct the file"
        );
        return Err(SessionError::value(path, "image size", detail));
    }
    let sizes = if own.is_empty() { sizes.to_vec() } else { own };
    let own_names: Vec<String> = suffixes
        .iter()
        .filter_map(|(_, _, s)| Some(file.root.get(&format!("name{s}"))?.text()?.to_owned()))
        .collect();
    let names =
        if names.is_empty() && own_names.len() == suffixes.len() { own_names } else { names.to_vec() };
    let named = names_and_sizes(path, suffixes.len(), &names, &sizes)?;
    let mut notes = Vec::new();
    let mut cameras = Vec::new();
    let count = suffixes.len();
    for (k, ((family, key, suffix), (name, size))) in suffixes.into_iter().zip(named).enumerate() {
        let m = file.shaped(file.key(&file.root, &key)?, 3, 3)?;
        let intrinsics = Intrinsics { fx_px: m[0], skew_px: m[1], cx_px: m[2], fy_px: m[4], cy_px: m[5] };
        let intrinsics = checked(path, &key, intrinsics, size)?;
        let lens_key = format!("{}{suffix}", LENS[family]);
        let lens =
            file.root.get(&lens_key).map_or(Ok(Vec::new()), |node| file.matrix(node).map(|m| m.data))?;
        let distortion = distortion(path, &lens_key, &lens)?;
        let cam_from_world = place(&file, &suffix, k, count, &mut notes)?;
        cameras.push(rig_camera(name, Camera { cam_from_world, intrinsics, distortion, size }));
    }
    notes.dedup();
    Ok(exact_rig(cameras, notes))
}

/// Which names the cameras have: family, whole key of the matrix, and number.
fn suffixes(file: &YamlFile) -> Vec<(usize, String, String)> {
    for (family, stem) in MATRIX.iter().enumerate() {
        let there = |suffix: &String| file.root.get(&format!("{stem}{suffix}")).is_some();
        let numbered: Vec<String> = (1..100).map(|k| k.to_string()).take_while(there).collect();
        let found = if numbered.is_empty() {
            Some(String::new()).filter(there).into_iter().collect()
        } else {
            numbered
        };
        if !found.is_empty() {
            return found.into_iter().map(|s: String| (family, format!("{stem}{s}"), s)).collect();
        }
    }
    Vec::new()
}

/// `image_size1`, ... of each camera, or `image_width` and `image_height` for all; nothing where the file has
/// neither.
fn own_sizes(file: &YamlFile, suffixes: &[(usize, String, String)]) -> Result<Vec<ImageSize>, SessionError> {
    let size = |w, h| image_size(w, h).map_err(|e| SessionError::value(&file.path, "image size", e));
    let nodes: Vec<_> =
        suffixes.iter().filter_map(|(_, _, s)| file.root.get(&format!("image_size{s}"))).collect();
    if nodes.len() == suffixes.len() {
        let one =
            |node: &&super::yaml::Yaml| file.exactly(node, "an image size").and_then(|[w, h]| size(w, h));
        return nodes.iter().map(one).collect();
    }
    match (file.root.get("image_width"), file.root.get("image_height")) {
        (Some(w), Some(h)) => Ok(vec![size(file.number(w)?, file.number(h)?)?]),
        _ => Ok(Vec::new()),
    }
}

fn place(
    file: &YamlFile,
    suffix: &str,
    index: usize,
    count: usize,
    notes: &mut Vec<String>,
) -> Result<Isometry3<f64>, SessionError> {
    let key = format!("cam_from_world{}{suffix}", if suffix.is_empty() { "" } else { "_" });
    if let Some(node) = file.root.get(&key) {
        return isometry(&file.path, &key, &file.shaped(node, 3, 4)?);
    }
    match (index, file.root.get("R"), file.root.get("T")) {
        (0, _, _) if count == 1 => {
            notes.push(
                "the file says nothing of where the camera is: it stands at the origin and looks along Z"
                    .into(),
            );
            Ok(Isometry3::identity())
        }
        (0, Some(_), Some(_)) => {
            notes.push("the world is camera 1: x right, y down, z forward; lengths are in the board's unit, taken as metres".into());
            Ok(Isometry3::identity())
        }
        (1, Some(r), Some(t)) if count == 2 => {
            let r = rotation(&file.path, "R", &Matrix3::from_row_slice(&file.shaped(r, 3, 3)?))?;
            let [x, y, z] = file.matrix(t)?.data[..] else {
                return Err(SessionError::value(&file.path, "T", "three numbers are wanted"));
            };
            Ok(Isometry3::from_parts(Vector3::new(x, y, z).into(), r))
        }
        _ => {
            let detail = "is missing, and so are R and T of two cameras: add the extrinsics (the sample writes them to a file of \
                          their own; both texts may stand in one file)";
            Err(SessionError::value(&file.path, key, detail))
        }
    }
}

/// Writes all cameras of a rig as M1 D1 M2 D2 ..., with R and T where there are two.
///
/// # Errors
/// Skew, which OpenCV's projection does not use, unless it may be dropped; what the file system refuses.
pub fn write(path: &Path, rig: &Rig, drop_skew: bool) -> Result<Vec<String>, SessionError> {
    let mut text = String::from("%YAML:1.0\n---\n");
    let mut notes = Vec::new();
    let one = rig.cameras.len() == 1;
    for (k, camera) in rig.cameras.iter().enumerate() {
        notes.extend(without_skew(path, camera, drop_skew)?);
        let suffix = if one { String::new() } else { (k + 1).to_string() };
        let (i, size) = (&camera.camera.intrinsics, camera.camera.size);
        let (m, d) = if one { (MATRIX[3], LENS[3]) } else { (MATRIX[0], LENS[0]) };
        if one {
            text += &format!("image_width: {}\nimage_height: {}\n", size.width_px, size.height_px);
        } else {
            text += &format!("image_size{suffix}: [ {}, {} ]\n", size.width_px, size.height_px);
        }
        text += &format!("name{suffix}: {:?}\n", camera.name);
        text += &matrix(
            &format!("{m}{suffix}"),
            3,
            &[i.fx_px, 0.0, i.cx_px, 0.0, i.fy_px, i.cy_px, 0.0, 0.0, 1.0],
        );
        text += &matrix(&format!("{d}{suffix}"), 1, &coefficients(&camera.camera.distortion));
        let key = format!("cam_from_world{}{suffix}", if one { "" } else { "_" });
        text += &matrix(&key, 3, rows_of(&camera.camera.cam_from_world).as_flattened());
    }
    if let [a, b] = rig.cameras.as_slice() {
        let second_from_first = b.camera.cam_from_world * a.camera.cam_from_world.inverse();
        let rows = rows_of(&second_from_first);
        let r: Vec<f64> = rows.iter().flat_map(|row| row[..3].to_vec()).collect();
        text += &matrix("R", 3, &r);
        text += &matrix("T", 3, &rows.map(|row| row[3]));
    }
    write_whole(path, text.as_bytes())?;
    Ok(notes)
}

fn matrix(key: &str, rows: usize, data: &[f64]) -> String {
    let numbers: Vec<String> = data.iter().map(|x| format!("{x:?}")).collect();
    format!(
        "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {}\n   dt: d\n   data: [ {} ]\n",
        data.len() / rows,
        numbers.join(", ")
    )
}
