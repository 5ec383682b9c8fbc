//! Cameras that another program has calibrated.

use super::{Noted, numbered};
use crate::SessionError;
use mavsight_geometry::{
    BrownConrady, Camera, ImageSize, Intrinsics, Isometry3, Matrix3, UnitQuaternion, Vector3,
};
use mavsight_pose::{CameraModel, Lens, Pixels, Rig, RigCamera};
use nalgebra::Rotation3;
use std::path::Path;

/// What is said of cameras whose file holds no uncertainty.
const EXACT: &str = "the file says nothing of how certain the cameras are: they count as exact, and standard deviations of \
poses hold the noise of the centres and the markers alone";

/// A camera of another program: exact, with the least model that holds it.
pub(super) fn rig_camera(name: String, camera: Camera) -> RigCamera {
    let (i, d) = (&camera.intrinsics, &camera.distortion);
    let pixels = match () {
        () if i.skew_px != 0.0 => Pixels::Skewed,
        () if i.fx_px != i.fy_px => Pixels::Rectangular,
        () => Pixels::Square,
    };
    let lens = match () {
        () if d.k3 != 0.0 => Lens::Full,
        () if d.p1 != 0.0 || d.p2 != 0.0 => Lens::Tangential,
        () if d.k2 != 0.0 => Lens::K1K2,
        () if d.k1 != 0.0 => Lens::K1,
        () => Lens::Straight,
    };
    RigCamera::exact(name, camera, CameraModel { pixels, lens })
}

/// Cameras as a rig, with what must be said of all such rigs.
pub(super) fn exact_rig(cameras: Vec<RigCamera>, notes: Vec<String>) -> Noted<Rig> {
    let notes = std::iter::once(EXACT.to_owned()).chain(notes).collect();
    Noted { value: Rig::exact(cameras), notes }
}

/// Focal lengths above zero and an image that is there; everything finite.
pub(super) fn checked(
    path: &Path,
    key: &str,
    k: Intrinsics,
    size: ImageSize,
) -> Result<Intrinsics, SessionError> {
    let all = [k.fx_px, k.fy_px, k.cx_px, k.cy_px, k.skew_px];
    if !all.iter().all(|x| x.is_finite()) || k.fx_px <= 0.0 || k.fy_px <= 0.0 {
        let detail =
            format!("focal lengths {}, {} must be finite and above zero: calibrate again", k.fx_px, k.fy_px);
        return Err(SessionError::value(path, key, detail));
    }
    if size.width_px == 0 || size.height_px == 0 {
        return Err(SessionError::value(path, key, "the image has no size: give it as --size 640x480"));
    }
    Ok(k)
}

/// An image size from numbers that must be whole and above zero.
pub(super) fn image_size(
    width: f64,
    height: f64,
    refuse: impl FnOnce(String) -> SessionError,
) -> Result<ImageSize, SessionError> {
    if [width, height].iter().all(|n| n.fract() == 0.0 && (1.0..1e6).contains(n)) {
        return Ok(ImageSize { width_px: width as u32, height_px: height as u32 });
    }
    Err(refuse(format!("an image of {width} by {height} pixels: whole numbers above zero are wanted")))
}

/// OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6 [...]]], of which this program has the first five.
pub(super) fn distortion(path: &Path, key: &str, d: &[f64]) -> Result<BrownConrady, SessionError> {
    if !matches!(d.len(), 0 | 4 | 5 | 8 | 12 | 14) {
        let detail =
            format!("{} numbers: k1 k2 p1 p2 and perhaps k3 are wanted (0, 4, 5, 8, 12 or 14)", d.len());
        return Err(SessionError::value(path, key, detail));
    }
    if let Some(x) = d.iter().skip(5).find(|x| **x != 0.0) {
        let detail = format!(
            "a coefficient beyond k3 is {x}: this program has k1 k2 p1 p2 k3 alone; calibrate without the rational, \
             thin-prism and tilted models"
        );
        return Err(SessionError::value(path, key, detail));
    }
    let at = |k: usize| d.get(k).copied().unwrap_or(0.0);
    Ok(BrownConrady { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4) })
}

pub(super) fn camera_matrix(k: &Intrinsics) -> [f64; 9] {
    [k.fx_px, 0.0, k.cx_px, 0.0, k.fy_px, k.cy_px, 0.0, 0.0, 1.0]
}

/// k1 k2 p1 p2 k3, OpenCV's order.
pub(super) fn coefficients(d: &BrownConrady) -> [f64; 5] {
    [d.k1, d.k2, d.p1, d.p2, d.k3]
}

/// A transform from the upper three rows of its matrix, row by row; the 3×3 block must be a rotation.
pub(super) fn isometry(path: &Path, key: &str, m: &[f64]) -> Result<Isometry3<f64>, SessionError> {
    if m.len() != 12 && m.len() != 16 {
        let detail = format!("{} numbers: a transform has 12 or 16", m.len());
        return Err(SessionError::value(path, key, detail));
    }
    let block = Matrix3::from_fn(|i, j| m[4 * i + j]);
    rotation(path, key, &block).map(|r| Isometry3::from_parts(Vector3::new(m[3], m[7], m[11]).into(), r))
}

/// A rotation from its matrix, made exactly orthonormal.
pub(super) fn rotation(
    path: &Path,
    key: &str,
    block: &Matrix3<f64>,
) -> Result<UnitQuaternion<f64>, SessionError> {
    let off = (block * block.transpose() - Matrix3::identity()).norm();
    // Six printed digits leave 1e-6 each.
    if !off.is_finite() || off > 1e-4 || block.determinant() < 0.0 {
        let detail = format!("not a rotation (R Rᵀ is off by {off:.1e}): check rows, signs and digits");
        return Err(SessionError::value(path, key, detail));
    }
    let start = Rotation3::from_matrix_unchecked(*block);
    let exact = Rotation3::from_matrix_eps(block, 1e-15, 100, start);
    Ok(UnitQuaternion::from_rotation_matrix(&exact))
}

/// Row by row, 3×4.
pub(super) fn rows_of(t: &Isometry3<f64>) -> [[f64; 4]; 3] {
    let m = t.to_homogeneous();
    std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
}

/// Refuses skew that a format has no place for, unless it may be dropped; then says what that costs.
pub(super) fn without_skew(
    path: &Path,
    camera: &RigCamera,
    drop: bool,
) -> Result<Option<String>, SessionError> {
    let k = &camera.camera.intrinsics;
    if k.skew_px == 0.0 {
        return Ok(None);
    }
    let reach_px = f64::from(camera.camera.size.height_px) / 2.0 / k.fy_px * k.skew_px.abs();
    let (name, skew) = (&camera.name, format!("a skew of {:.3} px", k.skew_px));
    if drop {
        return Ok(Some(format!("camera {name}: {skew} is dropped: {reach_px:.3} px at the image's edge")));
    }
    let detail = format!(
        "{skew} has no place in this format; --drop-skew leaves it out, which moves the image's edge by {reach_px:.3} px"
    );
    Err(SessionError::value(path, format!("camera {name}"), detail))
}

/// Name and size of each camera of a file that says neither; refuses numbers of them that do not fit.
///
/// Sizes are one for all or one a camera; names are `cam1`, `cam2`, ... where none are given.
pub(super) fn names_and_sizes(
    path: &Path,
    count: usize,
    names: &[String],
    sizes: &[ImageSize],
) -> Result<Vec<(String, ImageSize)>, SessionError> {
    if !names.is_empty() && names.len() != count {
        let detail = format!("{} names for {count} cameras: give one each", names.len());
        return Err(SessionError::value(path, "names", detail));
    }
    let sizes = match sizes {
        [one] => vec![*one; count],
        many if many.len() == count => many.to_vec(),
        many => {
            let detail = format!(
                "the file does not say it: give --size 640x480 for all cameras, or {count} sizes with commas between ({} given)",
                many.len()
            );
            return Err(SessionError::value(path, "image size", detail));
        }
    };
    Ok(sizes.into_iter().enumerate().map(|(k, size)| (numbered(names, k, "cam"), size)).collect())
}
