//! Files of other programs, both ways: cameras, trajectories, tracked points, tables.
//!
//! One file a format. Inside this crate everything keeps the house's conventions; what differs (a pixel's
//! origin, the order of a quaternion, which way the world's axes point) is turned here, where the file is
//! read or written. What a format cannot express is refused with a remedy, or said in [`Noted::notes`].
//!
//! Readers of cameras refuse, with the line, column or key: numbers that are none or too few, a lens or a
//! projection that this program does not have, an image size that neither the file nor the options give, an
//! origin of the pixels that the coefficients belie. The cameras count as exact, since no format holds an
//! uncertainty. Writers of cameras refuse what their format cannot hold, with the camera: skew unless it may
//! be dropped, unequal focal lengths, k3, a second camera.

pub mod argus;
pub mod c3d;
mod c3d_parameters;
pub mod dltdv;
pub mod dltdv_points;
pub mod frames;
pub mod kalibr;
pub mod marker_paths;
mod noted;
pub mod opencv;
#[cfg(feature = "parquet")]
pub mod parquet;
pub mod pixels;
pub mod poses;
mod rigs;
pub mod ros;
mod text;
pub mod trc;
mod yaml;

use noted::numbered;
pub use noted::{CameraOptions, Noted};
