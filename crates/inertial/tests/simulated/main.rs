//! Alignment of simulated logs.

#![allow(clippy::unwrap_used, clippy::panic)]

mod flight;

use flight::{DRIFT, OFFSET_S, aligned, log, poses, scored};
use mavsight_geometry::Vector3;
use mavsight_inertial::{GyroscopeSeries, InertialError, align_log};
use mavsight_random::Random;

/// Of 20 flights the mean squared error lies within the chi-square's 99 %.
#[test]
fn clock_drift_and_attitude_are_found_within_their_intervals() {
    let ([clock, turn], worst) = scored(20);
    // 0.5 ms, 5 ppm, 0.2 degrees.
    assert!(worst[0] < 0.5e-3 && worst[1] < 5e-6 && worst[2] < 0.2, "{worst:?}");
    assert!((1.03..3.35).contains(&clock) && (1.77..4.6).contains(&turn), "{clock} {turn}");
}

#[test]
fn times_are_carried_either_way() {
    let found = aligned(0);
    for pose_s in [0.0, 12.3, 59.0] {
        assert!((found.pose_s(found.log_s(pose_s)) - pose_s).abs() < 1e-12);
        let error_s = found.log_s(pose_s) - (pose_s * (1.0 + DRIFT) + OFFSET_S);
        assert!(error_s.abs() < 4.0 * found.offset_std_s(pose_s), "{error_s}");
    }
}

#[test]
fn a_flight_that_hardly_turns_is_refused_with_a_remedy() {
    let mut random = Random::new(36, 0);
    let poses = poses(1e-5, &mut random);
    let refused = align_log(&poses, &log(1e-5, &mut random)).unwrap_err();
    assert!(matches!(refused, InertialError::TooQuiet { .. }), "{refused}");
    assert!(refused.to_string().contains("about two axes"), "{refused}");
}

/// A log of another flight has no place where it fits.
#[test]
fn the_log_of_another_flight_is_refused() {
    let mut random = Random::new(37, 0);
    let poses = poses(0.25, &mut random);
    let other: Vec<Vector3<f64>> = {
        let mut rate = Vector3::zeros();
        (0..32_000)
            .map(|_| {
                rate = rate * 0.999 + Vector3::from(random.normals()) * 0.04;
                rate
            })
            .collect()
    };
    let times_ns = (0..32_000).map(|k| k * 2_500_000).collect();
    let refused = align_log(&poses, &GyroscopeSeries::new(times_ns, other).unwrap());
    assert!(matches!(refused, Err(InertialError::TooQuiet { .. })), "{refused:?}");
}

#[test]
fn too_few_poses_are_refused() {
    let mut random = Random::new(38, 0);
    let poses = poses(0.25, &mut random);
    let refused = align_log(&poses[..10], &log(0.25, &mut random)).unwrap_err();
    assert!(matches!(refused, InertialError::TooFewPoses { .. }), "{refused}");
}

/// A damaged time years ahead would make a search without end of any log.
#[test]
fn a_time_that_is_years_ahead_is_refused() {
    let mut random = Random::new(39, 0);
    let (poses, whole) = (poses(0.25, &mut random), log(0.25, &mut random));
    let mut times_ns = whole.times_ns().to_vec();
    *times_ns.last_mut().unwrap() = i64::MAX;
    let damaged = GyroscopeSeries::new(times_ns, whole.rates_rad_s().to_vec()).unwrap();
    let refused = align_log(&poses, &damaged).unwrap_err();
    assert!(matches!(refused, InertialError::TooLong { .. }), "{refused}");
}
