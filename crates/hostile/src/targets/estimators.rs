//! Estimators of poses and motion, on any finite detections, rigs and poses.

use crate::Outcome;
use crate::numbers::{Numbers, assert_covariance};
use mavsight_geometry::{
    BrownConrady, Camera, ImagePoint, ImageSize, Intrinsics, Isometry3, Matrix2, Matrix6, UnitQuaternion,
    Vector2, Vector3, triangulate,
};
use mavsight_pose::{
    BodyMarker, CameraModel, CausalFilter, FlightPrior, Lens, MarkerObservation, Motion, Observations,
    Pixels, PoseEstimate, PoseEstimator, PoseSample, Rig, RigCamera, motion_noise, refine_flight, smooth,
};
use nalgebra::Translation3;

/// Share of a covariance that rounding may cost.
const ROUNDING: f64 = 1e-6;

/// The same of covariances that are kept in single precision.
const SINGLE: f64 = 1e-4;

const GRAVITY_M_S2: f64 = 9.81;

fn is_finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
}

/// Cameras around a room; none where the numbers give no finite ones.
fn cameras(numbers: &mut Numbers<'_>) -> Option<Vec<Camera>> {
    let count = 2 + numbers.below(3);
    let size = ImageSize { width_px: 640, height_px: 480 };
    let places = [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5], [0.0, -5.0, 2.5], [0.5, 4.0, 1.0]];
    let all: Vec<Camera> = (0..count)
        .map(|k| {
            let lens = Intrinsics::from_horizontal_fov(size, numbers.near(0.9, 0.3));
            let (centre, target) = (numbers.near3(places[k], 0.5), numbers.near3([0.0, 0.0, 1.5], 0.2));
            let mut camera = Camera::looking_at(centre, target, lens, size);
            camera.distortion = BrownConrady {
                k1: numbers.near(0.0, 0.1),
                k2: numbers.near(0.0, 0.02),
                ..BrownConrady::default()
            };
            camera
        })
        .collect();
    let of_camera = |c: &Camera| {
        let (k, d) = (c.intrinsics, c.distortion);
        k.fx_px > 0.0
            && k.fy_px > 0.0
            && c.cam_from_world.to_matrix().iter().all(|x| x.is_finite())
            && is_finite(&[k.fx_px, k.fy_px, k.cx_px, k.cy_px, d.k1, d.k2])
    };
    all.iter().all(of_camera).then_some(all)
}

fn rig(cameras: &[Camera]) -> Rig {
    let model = CameraModel { pixels: Pixels::Square, lens: Lens::Straight };
    let of = |(k, camera): (usize, &Camera)| RigCamera::exact(format!("cam{}", k + 1), *camera, model);
    Rig::exact(cameras.iter().enumerate().map(of).collect())
}

fn body(numbers: &mut Numbers<'_>) -> Vec<BodyMarker> {
    let count = 3 + numbers.below(4);
    let places = [
        [0.2, 0.2, 0.1],
        [0.2, -0.2, 0.1],
        [-0.2, -0.2, 0.1],
        [-0.2, 0.2, 0.1],
        [0.0, 0.0, -0.1],
        [0.3, 0.0, 0.0],
    ];
    let marker = |k: usize| BodyMarker {
        name: format!("m{k}"),
        marker_in_body_m: numbers.near3(places[k], 0.02),
        radius_m: numbers.std(0.025).abs(),
    };
    (0..count).map(marker).collect()
}

/// A pose about a middle, of which position and attitude may be anything finite.
fn pose(numbers: &mut Numbers<'_>, middle: [f64; 3]) -> Isometry3<f64> {
    let turn = numbers.near3([0.0; 3], 0.5);
    let rotation = UnitQuaternion::from_scaled_axis(turn.map(|x| x.clamp(-1e3, 1e3)));
    Isometry3::from_parts(Translation3::from(numbers.near3(middle, 0.3)), rotation)
}

/// A pixel where a camera sees a point, with noise; anything where it does not see it.
fn pixel(numbers: &mut Numbers<'_>, camera: &Camera, point: &Vector3<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let at = camera.project(point).ok().map(|p| p.pixel).filter(|p| p.iter().all(|x| x.is_finite()));
    let at = at.unwrap_or(Vector2::new(320.0, 240.0));
    let seen = Vector2::new(numbers.near(at.x, 0.3), numbers.near(at.y, 0.3));
    let (u, v) = (numbers.std(0.05), numbers.std(0.05));
    let mut covariance = Matrix2::new(u * u, 0.0, 0.0, v * v);
    if numbers.chance(4) {
        let shared = numbers.near(0.0, 0.9) * u * v;
        (covariance[(0, 1)], covariance[(1, 0)]) = (shared, shared);
    }
    // Squares of what is finite may not be.
    (seen, covariance.map(|x| if x.is_finite() { x } else { f64::MAX }))
}

pub(super) fn triangulation(bytes: &[u8]) -> Outcome {
    let numbers = &mut Numbers::of(bytes);
    let Some(cameras) = cameras(numbers) else { return Outcome::Refused("no finite cameras".to_owned()) };
    let point = numbers.near3([0.0, 0.0, 1.5], 0.5);
    let images: Vec<ImagePoint<'_>> = cameras
        .iter()
        .map(|camera| {
            let (pixel, covariance_px2) = pixel(numbers, camera, &point);
            ImagePoint { camera, pixel, covariance_px2 }
        })
        .collect();
    let found = triangulate(&images);
    if let Ok(found) = &found {
        assert!(found.point_in_world_m.iter().all(|x| x.is_finite()) && found.residual_px.is_finite());
        assert_covariance("a triangulated point", &found.covariance_m2, ROUNDING);
    }
    found.into()
}

/// Observations of a body at an instant, by cameras that see each marker or not.
fn observed(
    numbers: &mut Numbers<'_>,
    cameras: &[Camera],
    body: &[BodyMarker],
    (t_ns, at): (i64, &Isometry3<f64>),
) -> Vec<MarkerObservation> {
    let mut all = Vec::new();
    for (camera, of) in cameras.iter().enumerate() {
        for (marker, ball) in body.iter().enumerate() {
            if numbers.chance(8) {
                continue;
            }
            let point = at.rotation * ball.marker_in_body_m + at.translation.vector;
            let (pixel, covariance_px2) = pixel(numbers, of, &point);
            all.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
        }
    }
    all
}

fn assert_pose(found: &PoseEstimate) {
    let place = &found.world_from_body;
    assert!(place.to_matrix().iter().all(|x| x.is_finite()), "a pose is not finite: {place}");
    assert!((place.rotation.norm() - 1.0).abs() < 1e-9, "the turn of a pose is none: {place}");
    assert_covariance("a pose", &found.covariance(), SINGLE);
    assert_covariance("the random error of a pose", &found.own_covariance(), SINGLE);
}

pub(super) fn pose_of_markers(bytes: &[u8]) -> Outcome {
    let numbers = &mut Numbers::of(bytes);
    let Some(cameras) = cameras(numbers) else { return Outcome::Refused("no finite cameras".to_owned()) };
    let body = body(numbers);
    let at = pose(numbers, [0.0, 0.0, 1.5]);
    let seen = observed(numbers, &cameras, &body, (0, &at));
    let estimator = PoseEstimator::new(&rig(&cameras), &body);
    let estimator =
        if numbers.chance(2) { estimator.with_centre_bias(numbers.std(0.05)) } else { Ok(estimator) };
    let previous = numbers.chance(3).then_some(&at);
    let found = estimator.and_then(|estimator| estimator.estimate(0, &seen, previous));
    if let Ok(found) = &found {
        assert_pose(found);
    }
    found.into()
}

pub(super) fn bundle(bytes: &[u8]) -> Outcome {
    let numbers = &mut Numbers::of(bytes);
    let Some(cameras) = cameras(numbers) else { return Outcome::Refused("no finite cameras".to_owned()) };
    let body = body(numbers);
    let mut seen = Observations::default();
    for k in 0..8 + numbers.below(8) as i64 {
        let at = pose(numbers, [0.1 * k as f64 - 0.6, 0.0, 1.5]);
        for one in observed(numbers, &cameras, &body, (33_333_333 * k, &at)) {
            seen.push(&one);
        }
    }
    let centres_std_px = numbers.chance(2).then(|| numbers.std(0.05));
    let prior = FlightPrior { markers_std_m: numbers.std(2e-3), centres_std_px };
    let found = refine_flight(&seen, &rig(&cameras), &body, prior);
    if let Ok(flight) = &found {
        assert!(flight.uncertainty.iter().all(|x| x.is_finite()), "the uncertainty is not finite");
        assert!(flight.markers.iter().all(|m| m.marker_in_body_m.iter().all(|x| x.is_finite())));
        assert!(flight.offsets_px.iter().all(|o| o.iter().all(|x| x.is_finite())));
    }
    found.into()
}

/// Poses of a flight, some of them missing, with covariances of any finite size.
fn flight(numbers: &mut Numbers<'_>) -> Vec<PoseSample> {
    let count = 5 + numbers.below(60);
    let mut t_ns = 0_i64;
    let sample = |k: usize| {
        t_ns = t_ns.saturating_add(numbers.near(33_333_333.0, 1e6) as i64);
        if numbers.chance(12) {
            return PoseSample { t_ns, estimate: Err(mavsight_pose::PoseError::NotMeasured) };
        }
        let phase = 0.1 * k as f64;
        let at = pose(numbers, [phase.sin(), phase.cos(), 1.5]);
        let std = [1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3].map(|usual| numbers.std(usual));
        let covariance = Matrix6::from_diagonal(&std.map(|s| (s * s).min(f64::MAX)).into());
        PoseSample { t_ns, estimate: Ok(PoseEstimate::new(at, &covariance)) }
    };
    (0..count).map(sample).collect()
}

fn assert_motion(motion: &Motion) {
    for sample in &motion.samples {
        let vectors = [
            sample.velocity_in_body_m_s,
            sample.rates_rad_s,
            sample.specific_force_m_s2,
            sample.angular_acceleration_rad_s2,
        ];
        let numbers = vectors.iter().flat_map(|v| v.iter().copied()).collect::<Vec<f64>>();
        assert!(is_finite(&numbers), "motion at {} ns is not finite: {numbers:?}", sample.t_ns);
        assert!(
            sample.world_from_body.to_matrix().iter().all(|x| x.is_finite()),
            "a smoothed pose is not finite"
        );
        assert_covariance("a smoothed pose", &sample.covariance.pose(), SINGLE);
        assert_covariance("velocity and rates", &sample.covariance.velocity_and_rates(), SINGLE);
        assert_covariance("specific force", &sample.covariance.quantity(4), SINGLE);
        assert_covariance("angular acceleration", &sample.covariance.quantity(5), SINGLE);
    }
    let bandwidths =
        [motion.translation_bandwidth_hz, motion.rotation_bandwidth_hz, motion.sample_interval_s];
    assert!(is_finite(&bandwidths), "{bandwidths:?}");
}

pub(super) fn smoother(bytes: &[u8]) -> Outcome {
    let numbers = &mut Numbers::of(bytes);
    let poses = flight(numbers);
    let found = smooth(&poses, GRAVITY_M_S2);
    if let Ok(motion) = &found {
        assert_motion(motion);
    }
    found.into()
}

pub(super) fn causal_filter(bytes: &[u8]) -> Outcome {
    let numbers = &mut Numbers::of(bytes);
    let poses = flight(numbers);
    let filter = motion_noise(&poses).and_then(|noise| CausalFilter::new(noise, GRAVITY_M_S2));
    let found = filter.and_then(|mut filter| {
        for pose in &poses {
            if let Some(sample) = filter.push(pose)? {
                let interval = 1.0 / 30.0;
                assert_motion(&Motion {
                    samples: vec![sample],
                    unknown_ns: Vec::new(),
                    doubts: mavsight_pose::Doubts::default(),
                    translation_bandwidth_hz: 1.0,
                    rotation_bandwidth_hz: 1.0,
                    sample_interval_s: interval,
                });
            }
        }
        Ok(())
    });
    found.into()
}
