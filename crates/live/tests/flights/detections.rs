//! What a camera sees of a body, without pictures.

use mavsight_flight::Vehicle;
use mavsight_geometry::{Isometry3, Matrix2, Point3, Vector3};
use mavsight_pose::{Rig, TrackedDetection};

/// A camera's balls of a body at a pose, a little off so that residuals are not zero.
pub(crate) fn detections(
    (rig, vehicle): (&Rig, &Vehicle),
    index: usize,
    stamp_ns: i64,
    at: &Isometry3<f64>,
) -> Vec<TrackedDetection> {
    let camera = &rig.cameras[index].camera;
    let of = |(k, ball): (usize, &mavsight_flight::Marker)| {
        let centre = (at * Point3::from(Vector3::from(ball.position_m))).coords;
        let seen = camera.project_ball(&centre, 0.5 * ball.diameter_m).expect("in view").pixel;
        let depth_m = (camera.cam_from_world * Point3::from(centre)).z;
        let off_px = 0.03 * ((stamp_ns / 1000 * (k as i64 + 3)) as f64).sin();
        TrackedDetection {
            t_ns: stamp_ns,
            camera: index,
            track_id: k as u32,
            color: k,
            pixel: seen.add_scalar(off_px),
            covariance_px2: Matrix2::identity() * 1e-3,
            diameter_px: camera.intrinsics.fx_px * ball.diameter_m / depth_m,
            is_static: false,
            is_preferred: true,
        }
    };
    vehicle.marker.iter().enumerate().map(of).collect()
}
