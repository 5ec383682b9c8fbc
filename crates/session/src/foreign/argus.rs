//! Argus' camera profiles: `cam f w h cx cy AR k1 k2 t1 t2 k3`, spaces between, a line a camera.
//!
//! Argus builds K from f, cx and cy alone (AR is read but not used), and applies it with OpenCV's distortion
//! to points whose v grows up from the lower edge. Turning v over turns cy, and with y also the sign of the
//! first tangential term: y' = -y leaves k and t2 as they are. The omnidirectional model has 19 numbers and
//! is refused.

use super::pixels::PixelOrigin;
use super::rigs::{checked, exact_rig, image_size, rig_camera, without_skew};
use super::text::Text;
use super::{CameraOptions, Noted, numbered};
use crate::{SessionError, write_whole};
use mavsight_geometry::{BrownConrady, Camera, Intrinsics, Isometry3, Vector2};
use mavsight_pose::Rig;
use std::path::Path;

/// Reads a profile; cameras get no place, which the profile does not hold.
///
/// # Errors
/// Those of [`crate::foreign`] for readers of cameras; what the file system refuses.
pub fn read(path: &Path, options: &CameraOptions) -> Result<Noted<Rig>, SessionError> {
    let origin = options.origin.unwrap_or(PixelOrigin::Argus);
    let text = Text::read(path, "Argus camera profile")?;
    let mut cameras = Vec::new();
    for line in text.filled() {
        let numbers = line.numbers(' ')?;
        let [_, f, w, h, cx, cy, _, k1, k2, t1, t2, k3] = numbers[..] else {
            let count = numbers.len();
            return Err(line.refuse(format!(
                "{count} numbers: cam f w h cx cy AR k1 k2 t1 t2 k3 are wanted, the pinhole model"
            )));
        };
        let size = image_size(w, h, |detail| line.refuse(detail))?;
        let centre = origin.to_ours(Vector2::new(cx, cy), size.height_px);
        let p1 = if origin.is_top_left() { t1 } else { -t1 };
        let k = Intrinsics { fx_px: f, fy_px: f, cx_px: centre.x, cy_px: centre.y, skew_px: 0.0 };
        let intrinsics = checked(path, &format!("line {}", line.number), k, size)?;
        let distortion = BrownConrady { k1, k2, p1, p2: t2, k3 };
        let camera = Camera { cam_from_world: Isometry3::identity(), intrinsics, distortion, size };
        cameras.push(rig_camera(numbered(&options.names, cameras.len(), "cam"), camera));
    }
    if cameras.is_empty() {
        return Err(SessionError::no_rows(path));
    }
    let note =
        "a profile says nothing of where the cameras are: they all stand at the origin and look along Z";
    Ok(exact_rig(cameras, vec![note.to_owned()]))
}

/// Writes a profile; refuses pixels that are not square, since it has one focal length.
///
/// # Errors
/// Those of [`crate::foreign`] for writers of cameras; what the file system refuses.
pub fn write(path: &Path, rig: &Rig, options: &CameraOptions) -> Result<Vec<String>, SessionError> {
    let origin = options.origin.unwrap_or(PixelOrigin::Argus);
    let mut text = String::new();
    let mut notes = Vec::new();
    for (k, camera) in rig.cameras.iter().enumerate() {
        notes.extend(without_skew(path, camera, options.drop_skew)?);
        let (i, d, size) = (&camera.camera.intrinsics, &camera.camera.distortion, camera.camera.size);
        if i.fx_px != i.fy_px {
            let detail = format!(
                "focal lengths {:.3} and {:.3} px differ, and Argus uses one: write another format, or set fy_px to fx_px in the rig",
                i.fx_px, i.fy_px
            );
            return Err(SessionError::value(path, format!("camera {}", camera.name), detail));
        }
        let (w, h) = (size.width_px, size.height_px);
        let centre = origin.to_theirs(Vector2::new(i.cx_px, i.cy_px), h);
        let t1 = if origin.is_top_left() { d.p1 } else { -d.p1 };
        let (number, f, cx, cy) = (k + 1, i.fx_px, centre.x, centre.y);
        text += &format!(
            "{number} {f:?} {w} {h} {cx:?} {cy:?} 1 {:?} {:?} {t1:?} {:?} {:?}\n",
            d.k1, d.k2, d.p2, d.k3
        );
    }
    write_whole(path, text.as_bytes())?;
    notes.push("a profile holds no places: write the coefficients too".into());
    Ok(notes)
}
