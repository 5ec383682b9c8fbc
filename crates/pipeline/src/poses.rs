//! Poses of instants whose observations are identified.

use crate::tracked::Tracked;
use mavsight_geometry::Isometry3;
use mavsight_pose::{MarkerObservation, PoseError, PoseEstimate, PoseEstimator, PoseSample};

pub(crate) fn pose_at(
    estimator: &PoseEstimator,
    t_ns: i64,
    seen: &[MarkerObservation],
    previous: Option<&Isometry3<f64>>,
) -> PoseSample {
    PoseSample { t_ns, estimate: estimator.estimate(t_ns, seen, previous) }
}

/// Estimates all poses again with what the first estimates have shown of the centres: how good those of
/// each ball in each camera are, which enters the observations' covariances, and how large their systematic
/// errors are.
pub(crate) fn poses_anew(estimator: PoseEstimator, tracked: &mut Tracked) -> Result<(), PoseError> {
    let factors = estimator.centre_factors(&tracked.observations, &tracked.poses)?;
    let markers = estimator.markers().len();
    tracked.observations.scale_covariances(|camera, marker| factors[camera * markers + marker]);
    estimate_all(&estimator, tracked, provisional);
    let bias_px = estimator.centre_bias_px(&tracked.observations, &tracked.poses)?;
    let estimator = estimator.with_centre_bias(bias_px)?;
    estimate_all(&estimator, tracked, condensed);
    tracked.estimator = Some(estimator);
    Ok(())
}

/// The same for poses of other cameras and markers than those that are there.
pub(crate) fn poses_again(estimator: PoseEstimator, tracked: &mut Tracked) -> Result<(), PoseError> {
    estimate_all(&estimator, tracked, provisional);
    poses_anew(estimator, tracked)
}

/// A pose that will be estimated again, without what only the last estimate of it is asked for: in an hour
/// of film the systematic part of its errors is hundreds of megabytes.
pub(crate) fn provisional(mut pose: PoseSample) -> PoseSample {
    pose.estimate = pose.estimate.map(PoseEstimate::all_new);
    pose
}

/// A pose with the systematic part of its own covariance; how that is correlated between poses is formed
/// from the observations when it is needed.
fn condensed(mut pose: PoseSample) -> PoseSample {
    pose.estimate = pose.estimate.map(PoseEstimate::condensed);
    pose
}

fn estimate_all(estimator: &PoseEstimator, tracked: &mut Tracked, kept: impl Fn(PoseSample) -> PoseSample) {
    let mut previous = None;
    let mut seen = Vec::new();
    for pose in &mut tracked.poses {
        tracked.observations.at(pose.t_ns, &mut seen);
        if seen.is_empty() && pose.estimate.is_err() {
            continue;
        }
        // Where two minima are likely, the one that was found with what the instant knew is the one.
        let known = pose.estimate.as_ref().ok().map(|e| e.world_from_body).or(previous);
        *pose = kept(pose_at(estimator, pose.t_ns, &seen, known.as_ref()));
        previous = pose.estimate.as_ref().ok().map(|e| e.world_from_body).or(previous);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Refinement, body_markers, refine};
    use mavsight_flight::Vehicle;
    use mavsight_geometry::{
        Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Matrix2, Point3, Vector2, Vector3,
        world_from_body,
    };
    use mavsight_pose::{BodyMarker, CameraControl, MarkerObservation, Rig, calibrate};

    const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

    fn rig() -> Rig {
        let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
        let side = |i: usize| (i % 3) as f64 * 1.5 - 1.5;
        let points: Vec<Vector3<f64>> =
            (0..27).map(|i| Vector3::new(side(i), side(i / 3), side(i / 9) + 1.5)).collect();
        let control = |x: f64| {
            let camera = Camera::looking_at(Vector3::new(x, -4.5, 1.5), Vector3::new(0.0, 0.0, 1.5), k, SIZE);
            let seen = points.iter().map(|p| ControlPoint {
                name: String::new(),
                point_in_world_m: *p,
                pixel: camera.project(p).unwrap().pixel,
                pixel_cov_px2: Matrix2::identity() * 1e-5,
            });
            CameraControl {
                name: format!("at {x}"),
                size: SIZE,
                points: seen.collect(),
                ball_radius_m: vec![0.0; 27],
                survey_std_m: vec![0.0; 27],
            }
        };
        calibrate(&[control(4.5), control(-4.5)]).unwrap()
    }

    /// A slow turn and climb, seen with noise of a uniform spread; each centre has a systematic error of
    /// its own.
    fn tracked(rig: &Rig, markers: &[BodyMarker], bias_px: f64) -> Tracked {
        // Most seeds show some systematic error where there is none; this one shows none.
        let mut random = mavsight_random::Random::new(4, 0);
        let mut uniform = || random.uniform() - 0.5;
        let mut out = Tracked::default();
        for k in 0..90 {
            let (t_ns, t) = (k * 33_333_333, k as f64 / 30.0);
            let attitude =
                EulerAngles { phi_rad: 0.2 * t.sin(), theta_rad: 0.2 * (2.0 * t).cos(), psi_rad: 0.3 * t };
            let pose = world_from_body(Vector3::new(0.3 * t.sin(), 0.1 * t, 1.3 + 0.1 * t), attitude);
            for (camera, view) in rig.cameras.iter().enumerate() {
                for (marker, ball) in markers.iter().enumerate() {
                    let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
                    let noise = Vector2::new(uniform(), uniform()) * 0.1;
                    let sign = if (camera + marker) % 2 == 0 { bias_px } else { -bias_px };
                    let pixel = view.camera.project_ball(&centre, ball.radius_m).unwrap().pixel;
                    out.observations.push(&MarkerObservation {
                        t_ns,
                        camera,
                        marker,
                        pixel: pixel + noise + Vector2::new(sign, -sign),
                        covariance_px2: Matrix2::identity() * 0.01 / 12.0,
                    });
                }
            }
            out.poses.push(PoseSample { t_ns, estimate: Err(PoseError::NotMeasured) });
        }
        let (estimator, mut previous) = (PoseEstimator::new(rig, &body_markers(&Vehicle::paper())), None);
        let mut seen = Vec::new();
        for pose in &mut out.poses {
            out.observations.at(pose.t_ns, &mut seen);
            *pose = pose_at(&estimator, pose.t_ns, &seen, previous.as_ref());
            previous = pose.estimate.as_ref().ok().map(|e| e.world_from_body);
        }
        out
    }

    /// Standard deviations of x: systematic, and random.
    fn systematic_and_random_std_m(tracked: &Tracked) -> (f64, f64) {
        let estimate = tracked.poses[40].estimate.as_ref().unwrap();
        (f64::from(estimate.systematic().row(0).norm()), estimate.own_covariance()[(0, 0)].sqrt())
    }

    #[test]
    fn centres_that_are_off_for_good_do_so_in_all_poses_alike() {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        for (bias_px, is_systematic) in [(0.0, false), (0.3, true)] {
            let mut tracked = tracked(&rig, &body, bias_px);
            let before = systematic_and_random_std_m(&tracked);
            poses_anew(PoseEstimator::new(&rig, &body), &mut tracked).unwrap();
            let after = systematic_and_random_std_m(&tracked);
            assert_eq!(after.0 > 2.0 * before.0, is_systematic, "bias {bias_px}: {before:?} then {after:?}");
            assert!(after.1 < 1.1 * before.1, "bias {bias_px}: {before:?} then {after:?}");
        }
    }

    /// The red ball, in the second camera, is ten times as noisy as it claims.
    #[test]
    fn a_ball_that_is_worse_than_it_claims_weighs_less() {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        let mut tracked = tracked(&rig, &body, 0.0);
        let mut sign = 0.2;
        let mut spoilt: Vec<_> = tracked.observations.iter().collect();
        for seen in spoilt.iter_mut().filter(|o| o.camera == 1 && o.marker == 0) {
            seen.pixel += Vector2::new(sign, -sign);
            sign = -sign;
        }
        tracked.observations = spoilt.iter().collect();
        let estimator = PoseEstimator::new(&rig, &body);
        estimate_all(&estimator, &mut tracked, |pose| pose);
        let claimed_px2 = spoilt[0].covariance_px2.trace();
        let residual_px =
            |t: &Tracked| t.poses.iter().map(|p| p.estimate.as_ref().unwrap().residual_px).sum::<f64>();
        let before_px = residual_px(&tracked);
        poses_anew(estimator, &mut tracked).unwrap();
        for seen in tracked.observations.iter() {
            let factor = seen.covariance_px2.trace() / claimed_px2;
            let spoilt = seen.camera == 1 && seen.marker == 0;
            assert!(
                if spoilt { (20.0..100.0).contains(&factor) } else { factor < 8.0 },
                "{seen:?}: {factor}"
            );
        }
        assert!(residual_px(&tracked) > before_px, "the others fit better, the spoilt ball worse");
    }

    #[test]
    fn a_body_that_is_not_as_in_its_file_is_refined() {
        let (rig, vehicle) = (rig(), Vehicle::paper());
        let mut built = body_markers(&vehicle);
        built[2].marker_in_body_m.x += 4e-3;
        let mut tracked = tracked(&rig, &built, 0.0);
        let how = Refinement { markers_std_m: Some(2e-3), ..Refinement::default() };
        let refined = refine(&mut tracked, &rig, &vehicle, how).unwrap().refined;
        let length =
            |m: &[BodyMarker], a: usize, b: usize| (m[a].marker_in_body_m - m[b].marker_in_body_m).norm();
        for (a, b) in [(0, 1), (0, 2), (1, 2), (2, 3)] {
            let error = length(&refined.markers, a, b) - length(&built, a, b);
            assert!(error.abs() < 3e-4, "between {a} and {b}: {error} m");
        }
        assert!(tracked.poses.iter().all(|p| p.estimate.is_ok()));
        let wrong = Refinement { markers_std_m: Some(-1.0), ..how };
        let refused = refine(&mut tracked, &rig, &vehicle, wrong).unwrap_err().to_string();
        assert!(refused.contains("a ruler is good to"), "{refused}");
    }
}
