//! Cameras that were calibrated elsewhere.

use crate::session_file::is_empty;
use crate::{Session, SessionError, read_rig};
use mavsight_geometry::CAMERA_PARAMETERS;
use mavsight_pose::Rig;
use std::path::Path;

impl Session {
    /// The rig that the session names in place of a calibration, its cameras in the session's order; `None`
    /// where it names none. Cameras of the file that the session does not have are left out.
    ///
    /// # Errors
    /// Those of [`read_rig`]; a camera that the file does not have, or that has another image size there than
    /// its recording. Where there is none, as for a camera that is only flown live, the size is the file's.
    pub fn rig(&self) -> Result<Option<Rig>, SessionError> {
        let Some(path) = self.file.rig.as_ref().map(|r| &r.file) else { return Ok(None) };
        let names: Vec<&str> = self.cameras().iter().map(|c| c.name.as_str()).collect();
        let rig = cameras_of(&read_rig(path)?, &names, path)?;
        self.require_sizes(&rig, path)?;
        Ok(Some(rig))
    }

    /// Refuses a rig, which has the session's cameras in their order by what `path` names, where a recording
    /// has another size than its camera was calibrated at.
    ///
    /// # Errors
    /// The first such camera; recordings that cannot be read.
    pub fn require_sizes(&self, rig: &Rig, path: &Path) -> Result<(), SessionError> {
        let recorded = |k: &(usize, _)| self.cameras().get(k.0).is_some_and(|c| !is_empty(&c.video));
        for (k, own) in rig.cameras.iter().enumerate().filter(recorded) {
            let (filmed, size) = (self.image_size(k)?, own.camera.size);
            if filmed != size {
                let detail = format!(
                    "is calibrated at {}×{} px, but its recording has {}×{}: calibrate it at the size it films in",
                    size.width_px, size.height_px, filmed.width_px, filmed.height_px
                );
                return Err(SessionError::value(path, format!("camera {}", own.name), detail));
            }
        }
        Ok(())
    }
}

/// The cameras of a rig that have some names, in the order of these, with what is not known of them.
///
/// # Errors
/// A name that no camera has; the rig was read from `path`.
pub fn cameras_of(rig: &Rig, names: &[&str], path: &Path) -> Result<Rig, SessionError> {
    let places = names
        .iter()
        .map(|name| {
            rig.cameras.iter().position(|c| c.name == *name).ok_or_else(|| {
                let found: Vec<&str> = rig.cameras.iter().map(|c| c.name.as_str()).collect();
                let detail =
                    format!("is missing: the file has {}; rename one or the other", found.join(", "));
                SessionError::value(path, format!("camera {name}"), detail)
            })
        })
        .collect::<Result<Vec<usize>, _>>()?;
    let rows: Vec<usize> =
        places.iter().flat_map(|k| CAMERA_PARAMETERS * k..CAMERA_PARAMETERS * (k + 1)).collect();
    let uncertainty = rig.uncertainty.select_rows(&rows);
    let cameras = places.into_iter().map(|k| rig.cameras[k].clone()).collect();
    Ok(Rig { cameras, uncertainty, ..rig.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Camera, ImageSize, Intrinsics, Vector3};
    use mavsight_pose::{Lens, Pixels};
    use nalgebra::DMatrix;

    fn rig() -> Rig {
        let size = ImageSize { width_px: 640, height_px: 480 };
        let k = Intrinsics::from_horizontal_fov(size, 1.0);
        let camera = |name: &str, x: f64| {
            let camera = Camera::looking_at(Vector3::new(x, -4.0, 1.0), Vector3::zeros(), k, size);
            let model = mavsight_pose::CameraModel { pixels: Pixels::Square, lens: Lens::Straight };
            mavsight_pose::RigCamera::exact(name.into(), camera, model)
        };
        let cameras = vec![camera("a", -1.0), camera("b", 0.0), camera("c", 1.0)];
        let uncertainty = DMatrix::from_fn(48, 2, |i, j| (i / 16) as f64 + 10.0 * j as f64);
        Rig { cameras, uncertainty, left_out: vec![], frames: 0 }
    }

    #[test]
    fn cameras_come_by_their_names_with_their_own_uncertainty() {
        let got = cameras_of(&rig(), &["c", "a"], Path::new("rig.toml")).unwrap();
        assert_eq!(got.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["c", "a"]);
        assert_eq!(got.uncertainty.shape(), (32, 2));
        assert!(got.uncertainty[(0, 0)] == 2.0 && got.uncertainty[(31, 1)] == 10.0);
        let refused = cameras_of(&rig(), &["a", "d"], Path::new("rig.toml")).unwrap_err().to_string();
        assert!(refused.contains("camera d") && refused.contains("a, b, c"), "{refused}");
    }
}
