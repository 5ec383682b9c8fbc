//! Alignment of simulated logs.

#![allow(clippy::unwrap_used, clippy::panic)]

mod flight;

use flight::{DRIFT, OFFSET_S, aligned, errors, log, poses, scored};
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

/// PX4's logger drops out for tenths of a second. Turns beside the dropouts determine the clock hardly less well than a whole log.
#[test]
fn a_log_with_dropouts_is_aligned_within_its_intervals() {
    let mut random = Random::new(35, 0);
    let (poses, whole) = (poses(0.25, &mut random), log(0.25, &mut random));
    let first_ns = whole.times_ns()[0];
    let is_kept = |t_ns: i64| {
        let since_s = (t_ns - first_ns) as f64 * 1e-9;
        ![18.0, 29.3, 44.1, 57.7].iter().any(|from_s| (*from_s..from_s + 0.3).contains(&since_s))
    };
    let rows = whole.times_ns().iter().zip(whole.rates_rad_s()).filter(|(t_ns, _)| is_kept(**t_ns));
    let (times_ns, rates) = rows.map(|(t_ns, rate)| (*t_ns, *rate)).unzip();
    let found = align_log(&poses, &GyroscopeSeries::new(times_ns, rates).unwrap()).unwrap();
    let ([offset_s, drift], turn) = errors(&found);
    let std = |k: usize| found.covariance[(k, k)].sqrt();
    assert!(offset_s.abs() < 4.0 * std(0) && drift.abs() < 4.0 * std(1), "{offset_s} {drift} {}", std(0));
    assert!((0..3).all(|k| turn[k].abs() < 4.0 * std(2 + k)), "{turn}");
    let of_whole = aligned(0);
    assert!(std(0) < 1.2 * of_whole.covariance[(0, 0)].sqrt(), "{}", std(0));
    assert!(of_whole.turns - found.turns <= 4 * 12, "{} {}", of_whole.turns, found.turns);
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
