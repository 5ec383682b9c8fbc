//! OpenCV's calibration files (FileStorage, YAML): one camera, or several.
//!
//! Names read: `M1 D1 M2 D2 ... R T` of the stereo sample (also `K1`, `cameraMatrix1`, `distCoeffs1`), or
//! `camera_matrix` and `distortion_coefficients` of the calibration sample; `image_width`, `image_height`;
//! and `cam_from_world_1`, ..., 3×4, which this program writes and OpenCV leaves alone. With R and T (x2 = R
//! x1 + T) and without those, camera 1 is the world. Pixels and distortion (k1 k2 p1 p2 k3) are as in this
//! program.

use super::rigs::{
    camera_matrix, coefficients, distortion, exact_rig, image_size, isometry, names_and_sizes, rig_camera,
    rotation, rows_of, without_skew,
};
use super::yaml::{Yaml, YamlFile};
use super::{CameraOptions, Noted};
use crate::{SessionError, write_whole};
use mavsight_geometry::{Camera, ImageSize, Isometry3, Matrix3, Vector3};
use mavsight_pose::Rig;
use std::path::Path;

const MATRIX: [&str; 4] = ["M", "K", "cameraMatrix", "camera_matrix"];
const LENS: [&str; 4] = ["D", "D", "distCoeffs", "distortion_coefficients"];

/// Reads a file that OpenCV 3, 4 or 5 or this program wrote; keeps skew, refuses coefficients beyond k3.
///
/// # Errors
/// Those of [`crate::foreign`] for readers of cameras; what the file system refuses.
pub fn read(path: &Path, options: &CameraOptions) -> Result<Noted<Rig>, SessionError> {
    let file = YamlFile::read(path, "OpenCV calibration")?;
    let Some((family, suffixes)) = suffixes(&file) else {
        let detail = format!(
            "no camera matrix: M1, K1, cameraMatrix1 or camera_matrix is wanted; the keys are {}",
            file.root.keys().join(", ")
        );
        return Err(SessionError::value(path, "camera", detail));
    };
    let own = own_sizes(&file, &suffixes)?;
    if !own.is_empty() && options.sizes.iter().zip(own.iter().cycle()).any(|(a, b)| a != b) {
        let detail = format!(
            "the file says {}×{}, the call another: leave it out of the call, or correct the file",
            own[0].width_px, own[0].height_px
        );
        return Err(SessionError::value(path, "image size", detail));
    }
    let sizes = if own.is_empty() { &options.sizes } else { &own };
    let name = |s: &String| Some(file.root.get(&format!("name{s}"))?.text()?.to_owned());
    let own_names: Option<Vec<String>> = suffixes.iter().map(name).collect();
    let own_names = own_names.filter(|_| options.names.is_empty());
    let names = own_names.as_ref().unwrap_or(&options.names);
    let named = names_and_sizes(path, suffixes.len(), names, sizes)?;
    let (mut notes, mut cameras) = (Vec::new(), Vec::new());
    for (k, (suffix, (name, size))) in suffixes.iter().zip(named).enumerate() {
        let intrinsics = file.intrinsics(&format!("{}{suffix}", MATRIX[family]), size)?;
        let lens_key = format!("{}{suffix}", LENS[family]);
        let lens = file.root.get(&lens_key).map_or(Ok(Vec::new()), |node| file.matrix(node, None))?;
        let distortion = distortion(path, &lens_key, &lens)?;
        let cam_from_world = place(&file, suffix, k, suffixes.len(), &mut notes)?;
        cameras.push(rig_camera(name, Camera { cam_from_world, intrinsics, distortion, size }));
    }
    Ok(exact_rig(cameras, notes))
}

/// Which family of names the cameras have, and their numbers; the number of a lone camera is empty.
fn suffixes(file: &YamlFile) -> Option<(usize, Vec<String>)> {
    (0..MATRIX.len()).find_map(|family| {
        let is_there = |suffix: &String| file.root.get(&format!("{}{suffix}", MATRIX[family])).is_some();
        let numbered: Vec<String> = (1..100).map(|k| k.to_string()).take_while(is_there).collect();
        if !numbered.is_empty() {
            return Some((family, numbered));
        }
        is_there(&String::new()).then(|| (family, vec![String::new()]))
    })
}

/// `image_size1`, ... of each camera, or `image_width` and `image_height` for all, where the file has them.
fn own_sizes(file: &YamlFile, suffixes: &[String]) -> Result<Vec<ImageSize>, SessionError> {
    let size = |w, h| image_size(w, h, |detail| SessionError::value(&file.path, "image size", detail));
    let nodes: Option<Vec<&Yaml>> =
        suffixes.iter().map(|s| file.root.get(&format!("image_size{s}"))).collect();
    if let Some(nodes) = nodes {
        let one = |node: &Yaml| file.exactly(node, "an image size").and_then(|[w, h]| size(w, h));
        return nodes.into_iter().map(one).collect();
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
        return isometry(&file.path, &key, &file.matrix(node, Some((3, 4)))?);
    }
    match (index, file.root.get("R"), file.root.get("T")) {
        (0, _, _) if count == 1 => {
            let note =
                "the file says nothing of where the camera is: it stands at the origin and looks along Z";
            notes.push(note.to_owned());
            Ok(Isometry3::identity())
        }
        (0, Some(_), Some(_)) => {
            notes.push("the world is camera 1: x right, y down, z forward; lengths are in the board's unit, taken as metres".into());
            Ok(Isometry3::identity())
        }
        (1, Some(r), Some(t)) if count == 2 => {
            let r = rotation(&file.path, "R", &Matrix3::from_row_slice(&file.matrix(r, Some((3, 3)))?))?;
            let [x, y, z] = file.matrix(t, None)?[..] else {
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
/// Those of [`crate::foreign`] for writers of cameras; what the file system refuses.
pub fn write(path: &Path, rig: &Rig, options: &CameraOptions) -> Result<Vec<String>, SessionError> {
    let mut text = String::from("%YAML:1.0\n---\n");
    let mut notes = Vec::new();
    let one = rig.cameras.len() == 1;
    for (k, camera) in rig.cameras.iter().enumerate() {
        notes.extend(without_skew(path, camera, options.drop_skew)?);
        let size = camera.camera.size;
        let (m, d, suffix, place) = if one {
            (MATRIX[3], LENS[3], String::new(), "cam_from_world")
        } else {
            (MATRIX[0], LENS[0], (k + 1).to_string(), "cam_from_world_")
        };
        text += &if one {
            format!("image_width: {}\nimage_height: {}\n", size.width_px, size.height_px)
        } else {
            format!("image_size{suffix}: [ {}, {} ]\n", size.width_px, size.height_px)
        };
        text += &format!("name{suffix}: {:?}\n", camera.name);
        text += &matrix(&format!("{m}{suffix}"), 3, &camera_matrix(&camera.camera.intrinsics));
        text += &matrix(&format!("{d}{suffix}"), 1, &coefficients(&camera.camera.distortion));
        text +=
            &matrix(&format!("{place}{suffix}"), 3, rows_of(&camera.camera.cam_from_world).as_flattened());
    }
    if let [a, b] = rig.cameras.as_slice() {
        let second_from_first = b.camera.cam_from_world * a.camera.cam_from_world.inverse();
        let rows = rows_of(&second_from_first);
        text += &matrix("R", 3, rows.map(|[x, y, z, _]| [x, y, z]).as_flattened());
        text += &matrix("T", 3, &rows.map(|row| row[3]));
    }
    write_whole(path, text.as_bytes())?;
    Ok(notes)
}

fn matrix(key: &str, rows: usize, data: &[f64]) -> String {
    let (cols, numbers) = (data.len() / rows, format!("{data:?}"));
    let numbers = numbers.trim_matches(['[', ']']);
    format!("{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {numbers} ]\n")
}
