use super::*;
use crate::testing::{cameras, normal, rig};
use mavsight_geometry::{EulerAngles, world_from_body};

fn body() -> Vec<BodyMarker> {
    [[0.225, 0.225], [0.225, -0.225], [-0.225, -0.225], [-0.225, 0.225]]
        .iter()
        .enumerate()
        .map(|(i, p)| BodyMarker {
            name: format!("m{i}"),
            marker_in_body_m: Vector3::new(p[0], p[1], 0.1),
            radius_m: 0.025,
        })
        .collect()
}

fn truth() -> Isometry3<f64> {
    let attitude = EulerAngles { phi_rad: 0.1, theta_rad: -0.15, psi_rad: -0.4 };
    world_from_body(Vector3::new(0.3, -0.2, 1.6), attitude)
}

fn seen(pose: &Isometry3<f64>, std_px: f64, seed: &mut u64) -> Vec<MarkerObservation> {
    let mut out = vec![];
    for (camera, view) in cameras().iter().enumerate() {
        for (marker, ball) in body().iter().enumerate() {
            let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let pixel = view.project_ball(&centre, ball.radius_m).unwrap().pixel;
            out.push(MarkerObservation {
                t_ns: 0,
                camera,
                marker,
                pixel: pixel + Vector2::new(normal(seed), normal(seed)) * std_px,
                covariance_px2: Matrix2::identity() * std_px.max(1e-3).powi(2),
            });
        }
    }
    out
}

/// Error in the chart of the covariance.
fn error(got: &Isometry3<f64>, truth: &Isometry3<f64>) -> Vector6<f64> {
    let turn = (truth.rotation.inverse() * got.rotation).scaled_axis();
    let shift = got.translation.vector - truth.translation.vector;
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

#[test]
fn exact_sights_give_the_pose_back_also_from_three_markers() {
    let estimator = PoseEstimator::new(&rig(), &body());
    for hidden in 0..=4 {
        let mut sights = seen(&truth(), 0.0, &mut 1);
        sights.retain(|o| o.marker != hidden);
        let got = estimator.estimate(0, &sights, None).unwrap();
        assert!(error(&got.world_from_body, &truth()).norm() < 1e-8);
        assert_eq!(got.markers_used.len(), if hidden < 4 { 3 } else { 4 });
        assert!(got.left_out.is_empty() && got.residual_px < 1e-7);
    }
}

#[test]
fn the_covariance_is_true() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let (mut seed, trials, mut dropped) = (17, 1500, 0);
    let (mut nees, mut inflation) = (0.0, 0.0);
    for _ in 0..trials {
        let got = estimator.estimate(0, &seen(&truth(), 0.2, &mut seed), None).unwrap();
        let e = error(&got.world_from_body, &truth());
        nees += e.dot(&got.covariance.cholesky().unwrap().solve(&e));
        dropped += got.left_out.len();
        inflation += (got.residual_px / 0.2).powi(2);
    }
    let trials = f64::from(trials);
    // With 10 redundant coordinates the inflation by max(1, s²) lowers the mean of 6 to 6 E[1/max(1, s²)] = 5.22.
    let mean = nees / trials;
    assert!((mean - 5.22).abs() < 0.35, "mean NEES {mean}");
    assert!((inflation / trials - 10.0 / 16.0).abs() < 0.03, "residuals {inflation}");
    assert!((dropped as f64) < 0.01 * trials, "{dropped} good markers left out");
}

#[test]
fn a_marker_that_disagrees_is_left_out_and_named() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let mut seed = 5;
    for marker in 0..4 {
        for shift in [3.0, 40.0] {
            let mut sights = seen(&truth(), 0.1, &mut seed);
            let bad = sights.iter_mut().find(|o| o.marker == marker && o.camera == 1).unwrap();
            bad.pixel += Vector2::new(shift, -shift);
            let got = estimator.estimate(0, &sights, None).unwrap();
            assert_eq!(got.left_out, vec![marker], "shift {shift}");
            assert_eq!(got.markers_used.len(), 3);
            assert!(error(&got.world_from_body, &truth()).norm() < 0.03);
        }
    }
}

#[test]
fn noise_larger_than_claimed_widens_the_covariance_and_drops_nobody() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let (mut seed, mut dropped, mut nees) = (9, 0, 0.0);
    for _ in 0..200 {
        let mut sights = seen(&truth(), 0.5, &mut seed);
        sights.iter_mut().for_each(|o| o.covariance_px2 = Matrix2::identity() * 1e-4);
        let got = estimator.estimate(0, &sights, None).unwrap();
        let e = error(&got.world_from_body, &truth());
        nees += e.dot(&got.covariance.cholesky().unwrap().solve(&e)) / 200.0;
        dropped += got.left_out.len();
    }
    assert!(dropped <= 4, "{dropped} dropped");
    assert!(nees < 12.0, "mean NEES {nees}");
}

#[test]
fn the_previous_pose_helps_where_only_one_marker_is_seen_twice() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let mut sights = seen(&truth(), 0.0, &mut 1);
    sights.retain(|o| o.camera == 0 || o.marker == 0);
    assert!(matches!(estimator.estimate(0, &sights, None), Err(PoseError::TooFewMarkers { seen: 1, .. })));
    let near =
        world_from_body(Vector3::new(0.25, -0.15, 1.62), EulerAngles { psi_rad: -0.4, ..Default::default() });
    let got = estimator.estimate(0, &sights, Some(&near)).unwrap();
    assert!(error(&got.world_from_body, &truth()).norm() < 1e-7);
}

#[test]
fn what_makes_no_pose_is_refused_with_its_reason() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let all = seen(&truth(), 0.1, &mut 3);
    let two: Vec<_> = all.iter().filter(|o| o.marker < 2).cloned().collect();
    let refused = estimator.estimate(0, &two, Some(&truth())).unwrap_err();
    assert_eq!(refused, PoseError::TooFewMarkers { seen: 2, markers: 4, sights: 4 });
    assert!(estimator.estimate(0, &[], None).is_err());
    let swapped: Vec<_> = all
        .iter()
        .cloned()
        .map(|mut o| {
            o.marker = [1, 0, 3, 2][o.marker];
            o
        })
        .collect();
    let refused = estimator.estimate(0, &swapped, None);
    assert!(matches!(refused, Err(PoseError::NotRigid { .. })) || refused.is_ok(), "{refused:?}");
    for spoil in 0..4 {
        let mut sights = all.clone();
        match spoil {
            0 => sights[0].pixel.x = f64::NAN,
            1 => sights[0].covariance_px2 = Matrix2::zeros(),
            2 => sights[0].camera = 7,
            _ => sights[0].marker = 9,
        }
        assert!(matches!(estimator.estimate(0, &sights, None), Err(PoseError::BadObservation { .. })));
    }
    let line: Vec<_> = body()
        .into_iter()
        .enumerate()
        .map(|(i, m)| BodyMarker { marker_in_body_m: Vector3::new(0.1 * i as f64, 0.0, 0.0), ..m })
        .collect();
    let refused = PoseEstimator::new(&rig(), &line).estimate(0, &all, None);
    assert!(
        matches!(refused, Err(PoseError::Geometry(GeometryError::CollinearMarkers { .. }))),
        "{refused:?}"
    );
}

#[test]
fn gates_are_the_quantiles_of_tables() {
    for (degrees, quantile) in [(2u32, 13.816), (4, 18.467), (10, 29.588)] {
        assert!(
            (chi_square_gate(degrees as usize) / quantile - 1.0).abs() < 0.06 / f64::from(degrees),
            "{degrees}"
        );
    }
    // F(4, 6) at 99.9 % is 21.92, F(4, 12) is 9.633; the approximation errs upwards, by a seventh at most here.
    assert!(!beyond_f_gate(19.5, 4, 6) && beyond_f_gate(26.0, 4, 6));
    assert!(!beyond_f_gate(9.2, 4, 12) && beyond_f_gate(10.6, 4, 12));
}
