//! Frames and rigid motions, camera models and rigs, projection with its Jacobians, DLT, triangulation, rigid
//! fit.
//!
//! Frames: world W (right handed, Z up, metres), level N (W turned by 180° about X), body B (x forward, y
//! right, z down), camera C (x right, y down, z forward). Pixels: u right, v down, the centre of the top-left
//! pixel is (0, 0).

pub mod attitude;
pub mod camera;
pub mod camera_parameters;
pub mod dlt;
mod error;
mod linear;
pub mod rigid_fit;
pub mod svd;
pub mod triangulate;

pub use attitude::{EulerAngles, world_from_body, world_from_level};
pub use camera::{BrownConrady, Camera, ImageSize, Intrinsics, Projection};
pub use camera_parameters::{CAMERA_PARAMETERS, CameraChange};
pub use dlt::{ControlPoint, Dlt};
pub use error::GeometryError;
pub use linear::{centroid_and_spread, whitener};
pub use rigid_fit::rigid_fit;
pub use svd::{Svd, jacobi_svd};
pub use triangulate::{ImagePoint, Triangulation, triangulate};

pub use nalgebra::{Isometry3, Matrix2, Matrix3, Matrix6, Point3, UnitQuaternion, Vector2, Vector3};
