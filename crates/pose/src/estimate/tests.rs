use super::*;
use crate::reprojection::moved;
use crate::testing::{cameras, rig};
use crate::{MarkerObservation, PoseError, Rig};
use mavsight_geometry::{
    EulerAngles, GeometryError, Isometry3, Matrix2, Point3, Vector2, Vector3, world_from_body,
};
use mavsight_random::Random;
use nalgebra::{DMatrix, Vector6};

pub(super) fn body() -> Vec<BodyMarker> {
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

pub(super) fn truth() -> Isometry3<f64> {
    let attitude = EulerAngles { phi_rad: 0.1, theta_rad: -0.15, psi_rad: -0.4 };
    world_from_body(Vector3::new(0.3, -0.2, 1.6), attitude)
}

pub(super) fn seen(pose: &Isometry3<f64>, std_px: f64, random: &mut Random) -> Vec<MarkerObservation> {
    let mut out = vec![];
    for (camera, view) in cameras().iter().enumerate() {
        for (marker, ball) in body().iter().enumerate() {
            let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
            let pixel = view.project_ball(&centre, ball.radius_m).unwrap().pixel;
            out.push(MarkerObservation {
                t_ns: 0,
                camera,
                marker,
                pixel: pixel + Vector2::from(random.normals()) * std_px,
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
fn exact_observations_give_the_pose_back_also_from_three_markers() {
    let estimator = PoseEstimator::new(&rig(), &body());
    for hidden in 0..=4 {
        let mut views = seen(&truth(), 0.0, &mut Random::new(1, 0));
        views.retain(|o| o.marker != hidden);
        let got = estimator.estimate(0, &views, None).unwrap();
        assert!(error(&got.world_from_body, &truth()).norm() < 1e-8);
        assert_eq!(got.markers_used.len(), if hidden < 4 { 3 } else { 4 });
        assert!(got.left_out.is_empty() && got.residual_px.unwrap() < 1e-7);
    }
}

#[test]
fn a_pose_without_redundancy_has_no_residual() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let mut views = seen(&truth(), 0.2, &mut Random::new(2, 0));
    views.retain(|o| o.marker != 0 && o.camera == 0);
    assert_eq!(views.len(), 3);
    assert_eq!(estimator.estimate(0, &views, Some(&truth())).unwrap().residual_px, None);
}

#[test]
fn the_covariance_is_true() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let (mut random, trials, mut dropped) = (Random::new(17, 0), 1500, 0);
    let (mut nees, mut inflation) = (0.0, 0.0);
    for _ in 0..trials {
        let got = estimator.estimate(0, &seen(&truth(), 0.2, &mut random), None).unwrap();
        let e = error(&got.world_from_body, &truth());
        nees += e.dot(&got.covariance().cholesky().unwrap().solve(&e));
        dropped += got.left_out.len();
        inflation += (got.residual_px.unwrap() / 0.2).powi(2);
    }
    let trials = f64::from(trials);
    // The factor has a variance of 2·10/20² about one, which raises the mean of 6 to 6.3.
    let mean = nees / trials;
    assert!((mean - 6.3).abs() < 0.35, "mean NEES {mean}");
    assert!((inflation / trials - 10.0 / 16.0).abs() < 0.03, "residuals {inflation}");
    assert!((dropped as f64) < 0.01 * trials, "{dropped} good markers left out");
}

#[test]
fn a_marker_that_disagrees_is_left_out_and_named() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let mut random = Random::new(5, 0);
    for marker in 0..4 {
        for shift in [3.0, 40.0] {
            let mut views = seen(&truth(), 0.1, &mut random);
            let bad = views.iter_mut().find(|o| o.marker == marker && o.camera == 1).unwrap();
            bad.pixel += Vector2::new(shift, -shift);
            let got = estimator.estimate(0, &views, None).unwrap();
            assert_eq!(got.left_out, [marker].into_iter().collect(), "shift {shift}");
            assert_eq!(got.markers_used.len(), 3);
            assert!(error(&got.world_from_body, &truth()).norm() < 0.03);
        }
    }
}

#[test]
fn noise_larger_than_claimed_widens_the_covariance_and_drops_nobody() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let (mut random, mut dropped, mut nees) = (Random::new(9, 0), 0, 0.0);
    for _ in 0..200 {
        let mut views = seen(&truth(), 0.5, &mut random);
        views.iter_mut().for_each(|o| o.covariance_px2 = Matrix2::identity() * 1e-4);
        let got = estimator.estimate(0, &views, None).unwrap();
        let e = error(&got.world_from_body, &truth());
        nees += e.dot(&got.covariance().cholesky().unwrap().solve(&e)) / 200.0;
        dropped += got.left_out.len();
    }
    assert!(dropped <= 4, "{dropped} dropped");
    assert!(nees < 12.0, "mean NEES {nees}");
}

/// Marker 0 is seen by both cameras, 1 by the first only, 2 by the second only: the previous pose has to
/// start it.
#[test]
fn the_previous_pose_helps_where_no_camera_sees_three() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let mut views = seen(&truth(), 0.0, &mut Random::new(1, 0));
    views.retain(|o| matches!((o.camera, o.marker), (_, 0) | (0, 1) | (1, 2)));
    assert!(matches!(
        estimator.estimate(0, &views, None),
        Err(PoseError::TooFewMarkers { seen: 3, markers: 4, observations: 4 })
    ));
    let near =
        world_from_body(Vector3::new(0.25, -0.15, 1.62), EulerAngles { psi_rad: -0.4, ..Default::default() });
    let got = estimator.estimate(0, &views, Some(&near)).unwrap();
    assert!(error(&got.world_from_body, &truth()).norm() < 1e-7);
}

#[test]
fn one_view_of_all_and_a_second_of_one_marker_need_no_previous_pose() {
    let estimator = PoseEstimator::new(&rig(), &body());
    for (hidden, noise) in [(4, 0.0), (2, 0.0), (4, 0.1)] {
        let mut views = seen(&truth(), noise, &mut Random::new(1, 0));
        views.retain(|o| (o.camera == 0 || o.marker == 0) && o.marker != hidden);
        let got = estimator.estimate(0, &views, None).unwrap();
        let e = error(&got.world_from_body, &truth());
        assert!(e.norm() < 1e-6 + 0.1 * noise, "hidden {hidden}: {e}");
    }
}

/// Tipped away from the camera, the square's mirror image about the viewing ray explains it nearly as well.
#[test]
fn the_mirror_pose_of_a_square_is_not_fallen_into() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let (mut random, mut decided, mut refused) = (Random::new(3, 0), 0, 0);
    for k in 0..200 {
        let tilt = |random: &mut Random| 0.25 * random.normal();
        let attitude =
            EulerAngles { phi_rad: tilt(&mut random), theta_rad: tilt(&mut random), psi_rad: f64::from(k) };
        let pose = world_from_body(Vector3::new(0.2, -0.3, 1.5), attitude);
        let mut views = seen(&pose, 0.5, &mut random);
        views.retain(|o| o.camera == 0);
        match estimator.estimate(0, &views, None) {
            Ok(got) => {
                decided += 1;
                let e = error(&got.world_from_body, &pose);
                let nees = e.dot(&got.covariance().cholesky().unwrap().solve(&e));
                assert!(nees < 60.0, "a wrong pose passed as sure: {e}");
            }
            Err(PoseError::AmbiguousPose { poses, .. }) => {
                refused += 1;
                assert!(poses >= 2);
                let near = moved(&pose, &Vector6::new(0.01, -0.01, 0.02, 0.03, -0.02, 0.01));
                if let Ok(got) = estimator.estimate(0, &views, Some(&near)) {
                    let e = error(&got.world_from_body, &pose);
                    assert!(e.fixed_rows::<3>(3).norm() < 0.3, "the pose before points elsewhere: {e}");
                }
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(decided > 20 && refused > 20, "{decided} decided, {refused} refused");
}

#[test]
fn three_observations_alone_are_ambiguous_until_a_pose_before_decides() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let mut views = seen(&truth(), 0.05, &mut Random::new(4, 0));
    views.retain(|o| o.camera == 1 && o.marker < 3);
    let refused = estimator.estimate(0, &views, None).unwrap_err();
    assert!(matches!(refused, PoseError::AmbiguousPose { markers: 3, .. }), "{refused:?}");
    let near = moved(&truth(), &Vector6::new(0.005, 0.0, 0.005, 0.01, 0.0, -0.01));
    let got = estimator.estimate(0, &views, Some(&near)).unwrap();
    let e = error(&got.world_from_body, &truth());
    assert!(e.dot(&got.covariance().cholesky().unwrap().solve(&e)) < 25.0, "{e}");
}

/// A rig whose cameras are uncertain, and the rig with one such error in it.
fn uncertain_rig() -> Rig {
    let mut out = rig();
    let std = |k: usize| match k {
        0..3 => 1e-3,
        3..6 => 2e-3,
        6..8 => 1.0,
        8 => 0.0,
        9..11 => 1.0,
        11 => 1e-3,
        _ => 0.0,
    };
    out.uncertainty = DMatrix::from_fn(32, 32, |i, j| if i == j { std(i % 16) } else { 0.0 });
    // A direction that both cameras share.
    out.uncertainty[(16 + 3, 3)] = 2e-3;
    out
}

fn with_error(rig: &Rig, along: &nalgebra::DVector<f64>) -> Rig {
    let change = &rig.uncertainty * along;
    let mut out = rig.clone();
    for (i, camera) in out.cameras.iter_mut().enumerate() {
        camera.camera = camera.camera.moved(&change.fixed_rows::<16>(16 * i).into_owned());
    }
    out
}

#[test]
fn systematic_columns_are_what_errors_of_cameras_and_markers_do() {
    let rig = uncertain_rig();
    let factor = DMatrix::from_fn(12, 12, |i, j| if i == j { 1e-3 } else { 0.0 });
    let estimator = PoseEstimator::new(&rig, &body()).with_marker_uncertainty(&factor).unwrap();
    let views = seen(&truth(), 0.0, &mut Random::new(1, 0));
    let at = estimator.estimate(0, &views, None).unwrap();
    assert_eq!(at.systematic_columns(), 44);
    let step = 1e-3;
    for c in 0..44 {
        let moved_pose = |sign: f64| {
            // Observations made by the other cameras and markers are read as if they were by the nominal
            // ones.
            let mut along = nalgebra::DVector::zeros(32);
            let mut markers = body();
            if c < 32 {
                along[c] = sign * step;
            } else {
                markers[(c - 32) / 3].marker_in_body_m[(c - 32) % 3] += sign * step * 1e-3;
            }
            let cameras = with_error(&rig, &along);
            let mut views = views.clone();
            for o in &mut views {
                let ball = &markers[o.marker];
                let centre = (truth() * Point3::from(ball.marker_in_body_m)).coords;
                o.pixel =
                    cameras.cameras[o.camera].camera.project_ball(&centre, ball.radius_m).unwrap().pixel;
            }
            estimator.estimate(0, &views, None).unwrap().world_from_body
        };
        let want = error(&moved_pose(1.0), &moved_pose(-1.0)) / (2.0 * step);
        let got = at.systematic_column(c);
        assert!((got - want).norm() < 2e-3 * (want.norm() + 1e-5), "column {c}: {got} against {want}");
    }
}

#[test]
fn the_covariance_holds_errors_of_cameras_and_markers() {
    let rig = uncertain_rig();
    let factor = DMatrix::from_fn(12, 12, |i, j| if i == j { 1e-3 } else { 0.0 });
    let estimator = PoseEstimator::new(&rig, &body()).with_marker_uncertainty(&factor).unwrap();
    let (mut random, mut nees, trials) = (Random::new(23, 0), 0.0, 400);
    for _ in 0..trials {
        let along = nalgebra::DVector::from_fn(32, |_, _| random.normal());
        let cameras = with_error(&rig, &along);
        let mut views = seen(&truth(), 0.1, &mut random);
        let shift: Vec<_> = (0..4).map(|_| Vector3::from(random.normals()) * 1e-3).collect();
        for o in &mut views {
            let ball = &body()[o.marker];
            let centre = (truth() * Point3::from(ball.marker_in_body_m + shift[o.marker])).coords;
            o.pixel = cameras.cameras[o.camera].camera.project_ball(&centre, ball.radius_m).unwrap().pixel
                + Vector2::from(random.normals()) * 0.1;
        }
        let got = estimator.estimate(0, &views, None).unwrap();
        assert!(got.left_out.is_empty(), "{:?}", got.left_out);
        let e = error(&got.world_from_body, &truth());
        nees += e.dot(&got.covariance().cholesky().unwrap().solve(&e)) / f64::from(trials);
    }
    assert!((nees - 6.1).abs() < 0.7, "mean NEES {nees}");
}

/// One observation in a hundred is off by eight standard deviations: too little to drop a marker for
/// every time.
#[test]
fn bounded_influence_beats_least_squares_where_some_observations_are_off() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let (mut random, mut bounded, mut least) = (Random::new(31, 0), 0.0, 0.0);
    for _ in 0..400 {
        let mut views = seen(&truth(), 0.1, &mut random);
        views[3].pixel += Vector2::from(random.normals()) * 0.25;
        let own = estimator.views(views.iter().copied()).unwrap();
        let plain = estimator.descend(&own, &truth()).unwrap();
        let robust = estimator.bounded_from(&own, plain.clone());
        least += error(&plain.world_from_body, &truth()).fixed_rows::<3>(0).norm_squared();
        bounded += error(&robust.world_from_body, &truth()).fixed_rows::<3>(0).norm_squared();
    }
    assert!(bounded < 0.97 * least, "{bounded} against {least}");
}

/// Beyond 1e38 single precision keeps no systematic column; beyond 1e154 squares are no numbers either.
#[test]
fn stated_errors_beyond_all_numbers_give_no_pose() {
    let views = seen(&truth(), 0.1, &mut Random::new(3, 0));
    let planned = views.iter().map(|o| PredictedObservation {
        camera: o.camera,
        marker: o.marker,
        covariance_px2: o.covariance_px2,
    });
    let planned: Vec<_> = planned.collect();
    for std_px in [1e45, 1e160, 1e308] {
        let estimator = PoseEstimator::new(&rig(), &body()).with_centre_bias(std_px).unwrap();
        for found in [estimator.estimate(0, &views, None), estimator.predict(&truth(), &planned)] {
            let unbounded = GeometryError::UnboundedCovariance { what: "the pose", coordinates: 6 };
            assert_eq!(found.unwrap_err(), PoseError::Geometry(unbounded), "{std_px}");
        }
    }
}

/// Poses with a standard deviation of seventy turns were given, and their mean was 33 000 degrees.
#[test]
fn an_attitude_that_is_unknown_about_an_axis_gives_no_pose() {
    let views = seen(&truth(), 0.1, &mut Random::new(3, 0));
    let by = |std_px: f64| {
        PoseEstimator::new(&rig(), &body()).with_centre_bias(std_px).unwrap().estimate(0, &views, None)
    };
    assert!(by(10.0).is_ok());
    for std_px in [1e3, 1e30] {
        assert!(
            matches!(by(std_px), Err(PoseError::AttitudeUnknown { std_deg }) if std_deg > 104.0),
            "{std_px}"
        );
    }
}

#[test]
fn what_makes_no_pose_is_refused_with_its_reason() {
    let estimator = PoseEstimator::new(&rig(), &body());
    let all = seen(&truth(), 0.1, &mut Random::new(3, 0));
    let two: Vec<_> = all.iter().filter(|o| o.marker < 2).cloned().collect();
    let refused = estimator.estimate(0, &two, Some(&truth())).unwrap_err();
    assert_eq!(refused, PoseError::TooFewMarkers { seen: 2, markers: 4, observations: 4 });
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
        let mut views = all.clone();
        match spoil {
            0 => views[0].pixel.x = f64::NAN,
            1 => views[0].covariance_px2 = Matrix2::zeros(),
            2 => views[0].camera = 7,
            _ => views[0].marker = 9,
        }
        assert!(matches!(estimator.estimate(0, &views, None), Err(PoseError::BadObservation { .. })));
    }
    let short = DMatrix::zeros(11, 2);
    assert_eq!(
        PoseEstimator::new(&rig(), &body()).with_marker_uncertainty(&short).unwrap_err(),
        PoseError::MarkerUncertainty { rows: 11, needed: 12 }
    );
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
