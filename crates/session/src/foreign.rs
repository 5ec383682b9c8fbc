//! Files of other programs, both ways: cameras, trajectories, tracked points, tables.
//!
//! One file a format. Inside this crate everything keeps the house's conventions; what differs (a pixel's
//! origin, the order of a quaternion, which way the world's axes point) is turned here, where the file is
//! read or written. What a format cannot express is refused with a remedy, or said in [`Noted::notes`].

mod argus;
pub mod c3d;
mod c3d_parameters;
pub mod dltdv;
pub mod dltdv_points;
pub mod frames;
mod kalibr;
pub mod marker_paths;
mod noted;
mod opencv;
#[cfg(feature = "parquet")]
pub mod parquet;
pub mod pixels;
pub mod poses;
mod rigs;
mod ros;
mod text;
pub mod trc;
mod yaml;

use crate::SessionError;
use mavsight_pose::Rig;
use std::path::Path;

use noted::numbered;
pub use noted::{CameraOptions, Noted};

/// A format for cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraFormat {
    /// Eleven DLT coefficients a camera, of DLTdv or Argus.
    Dlt,
    /// Argus' camera profile: lenses without places.
    Argus,
    /// OpenCV's FileStorage.
    Opencv,
    /// ROS camera_info: the lens of one camera.
    Ros,
    /// Kalibr's camchain.
    Kalibr,
}

/// Reads cameras; they count as exact, since none of the formats holds an uncertainty.
///
/// # Errors
/// Names the line, column or key: numbers that are none or too few, a lens or a projection that this program
/// does not have, an image size that neither the file nor the options give, an origin of the pixels that the
/// coefficients belie.
pub fn read_cameras(
    path: &Path,
    format: CameraFormat,
    options: &CameraOptions,
) -> Result<Noted<Rig>, SessionError> {
    match format {
        CameraFormat::Dlt => dltdv::read(path, options),
        CameraFormat::Argus => argus::read(path, options),
        CameraFormat::Opencv => opencv::read(path, options),
        CameraFormat::Ros => ros::read(path, options),
        CameraFormat::Kalibr => kalibr::read(path, options),
    }
}

/// Writes cameras, and says what was left out.
///
/// # Errors
/// What the format cannot hold (skew unless it may be dropped, unequal focal lengths, k3, a second camera),
/// with the camera; what the file system refuses.
pub fn write_cameras(
    path: &Path,
    format: CameraFormat,
    rig: &Rig,
    options: &CameraOptions,
) -> Result<Vec<String>, SessionError> {
    match format {
        CameraFormat::Dlt => dltdv::write(path, rig, options),
        CameraFormat::Argus => argus::write(path, rig, options),
        CameraFormat::Opencv => opencv::write(path, rig, options),
        CameraFormat::Ros => ros::write(path, rig, options),
        CameraFormat::Kalibr => kalibr::write(path, rig, options),
    }
}
