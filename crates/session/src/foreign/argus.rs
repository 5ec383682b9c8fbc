//! Argus' camera profiles: `cam f w h cx cy AR k1 k2 t1 t2 k3`, spaces between, a line a camera.
//!
//! Argus builds K from f, cx and cy alone (AR is read but not used), and applies it with OpenCV's distortion
//! to points whose v grows up from the lower edge. Reading and writing does the same: cy, and the sign of t1,
//! are turned with the image.

use super::Noted;
use super::pixels::PixelOrigin;
use super::rigs::{checked, exact_rig, image_size, rig_camera, without_skew};
use super::text::Text;
use crate::{SessionError, write_whole};
use mavsight_geometry::{BrownConrady, Camera, Intrinsics, Isometry3};
use mavsight_pose::Rig;
use std::path::Path;

/// Reads a profile; cameras get no place, which the profile does not hold.
///
/// # Errors
/// Names the line and column: 12 numbers are wanted (the omnidirectional model has 19 and is refused).
pub fn read_profile(path: &Path, origin: PixelOrigin, names: &[String]) -> Result<Noted<Rig>, SessionError> {
    let text = Text::read(path, "Argus camera profile")?;
    let mut cameras = Vec::new();
    for line in text.filled() {
        let cells: Vec<&str> = line.text.split_whitespace().collect();
        let numbers =
            cells.iter().enumerate().map(|(k, c)| line.number_in(k, c)).collect::<Result<Vec<f64>, _>>()?;
        let [_, f, w, h, cx, cy, _, k1, k2, t1, t2, k3] = numbers[..] else {
            let detail = format!(
                "{} numbers: cam f w h cx cy AR k1 k2 t1 t2 k3 are wanted, the pinhole model",
                numbers.len()
            );
            return Err(line.refuse(detail));
        };
        let size = image_size(w, h).map_err(|e| line.refuse(e))?;
        let (cy, t1) = flip(origin, h, cy, t1);
        let key = format!("line {}", line.number);
        let intrinsics = checked(
            path,
            &key,
            Intrinsics { fx_px: f, fy_px: f, cx_px: cx - u_shift(origin), cy_px: cy, skew_px: 0.0 },
            size,
        )?;
        let name = names.get(cameras.len()).cloned().unwrap_or_else(|| format!("cam{}", cameras.len() + 1));
        let distortion = BrownConrady { k1, k2, p1: t1, p2: t2, k3 };
        cameras.push(rig_camera(
            name,
            Camera { cam_from_world: Isometry3::identity(), intrinsics, distortion, size },
        ));
    }
    if cameras.is_empty() {
        return Err(SessionError::EmptyTable { path: path.to_owned() });
    }
    let notes = vec![
        "a profile says nothing of where the cameras are: they all stand at the origin and look along Z"
            .to_owned(),
    ];
    Ok(exact_rig(cameras, notes))
}

fn u_shift(origin: PixelOrigin) -> f64 {
    if matches!(origin, PixelOrigin::Dltdv8 | PixelOrigin::Dltdv5) { 1.0 } else { 0.0 }
}

/// Turning v over turns cy, and with y also the sign of the first tangential term: y' = -y leaves k and t2 as
/// they are. The same map leads back.
fn flip(origin: PixelOrigin, height: f64, cy: f64, t1: f64) -> (f64, f64) {
    match origin {
        PixelOrigin::TopLeftZero => (cy, t1),
        PixelOrigin::Dltdv8 => (cy - 1.0, t1),
        PixelOrigin::Dltdv5 | PixelOrigin::Argus => (height - cy, -t1),
    }
}

/// Writes a profile.
///
/// # Errors
/// Pixels that are not square, or skewed (unless dropped): the profile has one focal length.
pub fn write_profile(
    path: &Path,
    rig: &Rig,
    origin: PixelOrigin,
    drop_skew: bool,
) -> Result<Vec<String>, SessionError> {
    let mut text = String::new();
    let mut notes = Vec::new();
    for (k, camera) in rig.cameras.iter().enumerate() {
        notes.extend(without_skew(path, camera, drop_skew)?);
        let (i, d, size) = (&camera.camera.intrinsics, &camera.camera.distortion, camera.camera.size);
        if i.fx_px != i.fy_px {
            let detail = format!(
                "focal lengths {:.3} and {:.3} px differ, and Argus uses one: write another format, or set fy_px to fx_px in the rig",
                i.fx_px, i.fy_px
            );
            return Err(SessionError::value(path, format!("camera {}", camera.name), detail));
        }
        let (w, h) = (size.width_px, size.height_px);
        let (cy, t1) = match origin {
            PixelOrigin::Dltdv8 => (i.cy_px + 1.0, d.p1),
            _ => flip(origin, f64::from(h), i.cy_px, d.p1),
        };
        let cx = i.cx_px + u_shift(origin);
        text += &format!(
            "{} {:?} {w} {h} {cx:?} {cy:?} 1 {:?} {:?} {t1:?} {:?} {:?}\n",
            k + 1,
            i.fx_px,
            d.k1,
            d.k2,
            d.p2,
            d.k3
        );
    }
    write_whole(path, text.as_bytes())?;
    notes.push("a profile holds no places: write the coefficients too".into());
    Ok(notes)
}
