//! Cameras from wands and boards whose places are drawn at random.

use super::test_sets::{Noise, both, seen, unlike_cameras};
use super::*;
use crate::testing::{cameras, cube};
use crate::{BodyMarker, MarkerObservation, PoseError};
use mavsight_geometry::{Camera, Isometry3, Matrix2, Point3, UnitQuaternion, Vector2, Vector3};
use mavsight_random::Random;
use nalgebra::Translation3;

const LENGTH_M: f64 = 0.5;

/// Observations of a body at some poses; a point in ten is lost.
fn observed(
    cameras: &[Camera],
    body: &[BodyMarker],
    poses: &[Isometry3<f64>],
    std_px: f64,
    random: &mut Random,
) -> Vec<MarkerObservation> {
    let mut out = Vec::new();
    for (k, pose) in poses.iter().enumerate() {
        for (camera, view) in cameras.iter().enumerate() {
            for (marker, point) in body.iter().enumerate() {
                let centre = (pose * Point3::from(point.marker_in_body_m)).coords;
                let Ok(at) = view.project_ball(&centre, point.radius_m) else { continue };
                let noise = Vector2::from(random.normals()) * std_px;
                if view.size.contains(&at.pixel, 5.0) && random.normal().abs() > 0.126 {
                    let covariance_px2 = Matrix2::identity() * std_px * std_px;
                    let (pixel, t_ns) = (at.pixel + noise, 33_333_333 * k as i64);
                    out.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                }
            }
        }
    }
    out
}

/// Places in a room of 2 m, in any attitude.
fn waved(n: usize, random: &mut Random) -> Vec<Isometry3<f64>> {
    (0..n)
        .map(|_| {
            let at = Vector3::new(0.0, 0.0, 1.5) + Vector3::from(random.normals()) * 0.5;
            Isometry3::from_parts(
                Translation3::from(at),
                UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * 2.0),
            )
        })
        .collect()
}

fn wand(cameras: &[Camera], std_px: f64, random: &mut Random) -> MovedObject {
    let empty = MovedObject::wand(LENGTH_M, 0.0, [("a", 0.04), ("b", 0.04)], Vec::new());
    let poses = waved(80, random);
    let observations = observed(cameras, &empty.points, &poses, std_px, random);
    MovedObject { observations, ..empty }
}

fn unseen(cameras: &[Camera]) -> Vec<CameraControl> {
    let one = |(k, c): (usize, &Camera)| {
        CameraControl::exact(format!("cam{}", k + 1), c.size, Vec::new(), Vec::new())
    };
    cameras.iter().enumerate().map(one).collect()
}

/// Distances between cameras over the true ones, less one.
fn scale_error(rig: &Rig, truth: &[Camera]) -> f64 {
    let apart = |a: &Camera, b: &Camera| (a.centre_in_world() - b.centre_in_world()).norm();
    let mut worst = 0.0_f64;
    for i in 0..truth.len() {
        for j in i + 1..truth.len() {
            let ratio = apart(&rig.cameras[i].camera, &rig.cameras[j].camera) / apart(&truth[i], &truth[j]);
            worst = worst.max((ratio - 1.0).abs());
        }
    }
    worst
}

#[test]
fn a_wand_alone_gives_cameras_their_lenses_and_the_scale() {
    let mut random = Random::new(3, 0);
    for truth in [cameras().to_vec(), unlike_cameras().split_off(1)] {
        let rig = calibrate_with(&unseen(&truth), &[wand(&truth, 0.05, &mut random)]).unwrap();
        let error = scale_error(&rig, &truth);
        assert!(error < 2e-3, "{error}");
        for (found, truth) in rig.cameras.iter().zip(&truth) {
            let (f, want) = (found.camera.intrinsics.fx_px, truth.intrinsics.fx_px);
            assert!((f / want - 1.0).abs() < 5e-3, "{f} {want}");
            assert_eq!(found.model.lens != Lens::Straight, truth.distortion.k1 != 0.0, "{}", found.model);
            assert!((0.04..0.06).contains(&found.sigma_px), "{}", found.sigma_px);
        }
        // The first camera is the world: level, in its origin.
        let first = &rig.cameras[0];
        assert!(first.camera.centre_in_world().norm() < 1e-9 && first.centre_std_m.norm() < 1e-9);
        let forward = first.camera.cam_from_world.rotation.inverse() * Vector3::z();
        assert!((forward - Vector3::y()).norm() < 1e-9);
    }
}

/// Four surveyed points: too few for a camera, enough for the axes.
#[test]
fn a_wand_and_four_surveyed_points_give_centres_as_good_as_they_claim() {
    let truth = cameras().to_vec();
    let places: Vec<Vector3<f64>> =
        [[-0.6, -0.5, 0.4], [0.7, -0.4, 0.6], [0.1, 0.8, 0.5], [0.2, -0.2, 2.3]].map(Vector3::from).into();
    let (mut random, mut nees, trials) = (Random::new(11, 0), 0.0, 3);
    for _ in 0..trials {
        let control: Vec<CameraControl> = truth
            .iter()
            .enumerate()
            .map(|(k, c)| {
                seen(
                    &format!("cam{}", k + 1),
                    c,
                    &places,
                    Noise { std_px: 0.05, radius_m: 0.03 },
                    &mut random,
                )
            })
            .collect();
        let rig = calibrate_with(&control, &[wand(&truth, 0.05, &mut random)]).unwrap();
        for (found, truth) in rig.cameras.iter().zip(&truth) {
            let error = found.camera.centre_in_world() - truth.centre_in_world();
            assert!(error.norm() < 4.0 * found.centre_std_m.norm(), "{error} {}", found.centre_std_m);
            let solved = found.centre_cov_m2.cholesky().expect("positive").solve(&error);
            nees += error.dot(&solved) / f64::from(3 * 2 * trials);
        }
    }
    assert!((0.3..2.0).contains(&nees), "{nees}");
}

/// One observation in fifty is of another object.
#[test]
fn balls_that_are_none_are_left_out() {
    let (truth, mut random) = (cameras().to_vec(), Random::new(21, 0));
    let mut wand = wand(&truth, 0.05, &mut random);
    for o in wand.observations.iter_mut().step_by(53) {
        o.pixel += Vector2::from(random.normals()) * 40.0;
    }
    let rig = calibrate_with(&unseen(&truth), &[wand]).unwrap();
    assert!(scale_error(&rig, &truth) < 2e-3, "{}", scale_error(&rig, &truth));
    assert!(rig.cameras.iter().all(|c| c.sigma_px < 0.06));
}

/// A wand whose length is known to a part in a thousand leaves the scale open by as much.
#[test]
fn a_length_that_is_not_exact_is_in_the_uncertainty() {
    let (truth, mut random) = (cameras().to_vec(), Random::new(5, 0));
    let std = |length_std_m: f64, random: &mut Random| {
        let mut wand = wand(&truth, 0.02, random);
        wand.scale_std = length_std_m / LENGTH_M;
        let rig = calibrate_with(&unseen(&truth), &[wand]).unwrap();
        let apart = rig.cameras[1].camera.centre_in_world();
        let along = apart.normalize();
        ((along.transpose() * rig.cameras[1].centre_cov_m2 * along)[0].sqrt()) / apart.norm()
    };
    let (exact, unsure) = (std(0.0, &mut random), std(1e-3 * LENGTH_M * 2.0, &mut random));
    assert!((unsure.hypot(0.0) / exact.hypot(2e-3) - 1.0).abs() < 0.15, "{exact} {unsure}");
}

/// A board at arm's length from each camera, tilted up to `tilt_rad`.
fn board_views(camera: &Camera, n: usize, tilt_rad: f64, random: &mut Random) -> Vec<Isometry3<f64>> {
    let middle = Vector3::new(0.12, 0.075, 0.0);
    (0..n)
        .map(|_| {
            let depth_m = 0.9 + 0.2 * random.normal().abs();
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(
                random.normal().clamp(-1.5, 1.5) * tilt_rad,
                random.normal().clamp(-1.5, 1.5) * tilt_rad,
                random.normal() * 0.3,
            ));
            let aside = Vector3::new(random.normal() * 0.15, random.normal() * 0.1, 0.0);
            let at = Vector3::new(0.0, 0.0, depth_m) + aside - turn * middle;
            camera.cam_from_world.inverse() * Isometry3::from_parts(Translation3::from(at), turn)
        })
        .collect()
}

fn board(cameras: &[Camera], per_camera: usize, tilt_rad: f64, random: &mut Random) -> MovedObject {
    let empty = MovedObject::board(7, 5, 0.04, Vec::new());
    let mut all = Vec::new();
    for (k, camera) in cameras.iter().enumerate() {
        let poses = board_views(camera, per_camera, tilt_rad, random);
        let mut own = observed(std::slice::from_ref(camera), &empty.points, &poses, 0.05, random);
        own.iter_mut().for_each(|o| (o.camera, o.t_ns) = (k, o.t_ns + 1_000_000_000_000 * k as i64));
        all.extend(own);
    }
    MovedObject { observations: all, ..empty }
}

#[test]
fn boards_give_lenses_and_control_points_where_the_cameras_are() {
    let (truth, mut random) = (unlike_cameras(), Random::new(7, 0));
    let truth = &truth[..2];
    let board = board(truth, 10, 0.5, &mut random);
    let control: Vec<CameraControl> = truth
        .iter()
        .enumerate()
        .map(|(k, c)| {
            let mut one = seen(
                &format!("cam{}", k + 1),
                c,
                &crate::testing::cube(),
                Noise { std_px: 0.1, radius_m: 0.03 },
                &mut random,
            );
            one.size = c.size;
            one
        })
        .collect();
    let alone = calibrate(&control).unwrap();
    let both = calibrate_with(&control, &[board]).unwrap();
    for ((found, alone), truth) in both.cameras.iter().zip(&alone.cameras).zip(truth) {
        let (f, want) = (found.camera.intrinsics.fx_px, truth.intrinsics.fx_px);
        assert!((f / want - 1.0).abs() < 2e-3, "{f} {want} {}", found.model);
        let (k, want) = (&found.camera.distortion, &truth.distortion);
        assert!((k.k1 - want.k1).abs() < 0.01 && (k.k2 - want.k2).abs() < 0.03, "{k:?}");
        assert!(found.centre_std_m.norm() < alone.centre_std_m.norm());
        let error = found.camera.centre_in_world() - truth.centre_in_world();
        assert!(error.norm() < 4.0 * found.centre_std_m.norm(), "{error} {}", found.centre_std_m);
    }
}

/// A board that two cameras see at once joins them.
#[test]
fn a_board_that_cameras_share_links_them() {
    let (mut truth, mut random) = (cameras().to_vec(), Random::new(9, 0));
    let target = Vector3::new(0.0, 0.0, 1.5);
    for (camera, at) in truth.iter_mut().zip([[1.0, -1.2, 1.5], [-0.9, -1.3, 1.8]]) {
        *camera = Camera::looking_at(Vector3::from(at), target, camera.intrinsics, camera.size);
    }
    let empty = MovedObject::board(6, 4, 0.08, Vec::new());
    let between =
        Camera::looking_at(Vector3::new(0.0, -1.4, 1.6), target, truth[0].intrinsics, truth[0].size);
    let poses = board_views(&between, 12, 0.4, &mut random);
    let observations = observed(&truth, &empty.points, &poses, 0.05, &mut random);
    let rig = calibrate_with(&unseen(&truth), &[MovedObject { observations, ..empty }]).unwrap();
    assert!(scale_error(&rig, &truth) < 2e-3, "{}", scale_error(&rig, &truth));
}

/// A sheet that bows by 1.5 mm in its half metre; it was taken as flat, and cameras were further off than they claimed.
#[test]
fn a_board_that_is_not_flat_gives_cameras_as_good_as_they_claim() {
    let (mut truth, mut random) = (cameras().to_vec(), Random::new(19, 0));
    let target = Vector3::new(0.0, 0.0, 1.5);
    for (camera, at) in truth.iter_mut().zip([[1.0, -1.2, 1.5], [-0.9, -1.3, 1.8]]) {
        *camera = Camera::looking_at(Vector3::from(at), target, camera.intrinsics, camera.size);
    }
    let flat = MovedObject::board(7, 5, 0.08, Vec::new());
    let mut bowed = flat.points.clone();
    for corner in &mut bowed {
        let at = &mut corner.marker_in_body_m;
        at.z = 1.5e-3 * ((at.x / 0.24 - 1.0).powi(2) - 0.5 * (at.y / 0.16 - 1.0).powi(2));
    }
    let between =
        Camera::looking_at(Vector3::new(0.0, -1.4, 1.6), target, truth[0].intrinsics, truth[0].size);
    let poses = board_views(&between, 25, 0.4, &mut random);
    let observations = observed(&truth, &bowed, &poses, 0.05, &mut random);
    let rig = calibrate_with(&unseen(&truth), &[MovedObject { observations, ..flat }]).unwrap();
    let first = truth[0].cam_from_world;
    let found = first * truth[1].cam_from_world.inverse();
    // The world is in the first camera's axes: x right, y forward, z up.
    let axes = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2);
    let error = rig.cameras[1].camera.centre_in_world() - axes * found.translation.vector;
    let claim = rig.cameras[1].centre_cov_m2.cholesky().unwrap();
    let nees = error.dot(&claim.solve(&error));
    let std_m = rig.cameras[1].centre_std_m.norm();
    // The 0.999 quantile of three degrees of freedom.
    assert!(nees < 16.3 && std_m < 0.01, "{error} of {}, {nees}", rig.cameras[1].centre_std_m);
}

#[test]
fn what_objects_leave_undetermined_is_refused() {
    let (truth, mut random) = (cameras().to_vec(), Random::new(13, 0));
    let control = unseen(&truth);
    let good = wand(&truth, 0.05, &mut random);
    let refused = |object: MovedObject| calibrate_with(&control, &[object]).unwrap_err();
    // Only one camera saw it.
    let mut alone = good.clone();
    alone.observations.retain(|o| o.camera == 0);
    let why = refused(alone).to_string();
    assert!(why.contains("camera cam2 shares 0 places of the wand"), "{why}");
    for (length_m, std_m) in [(0.0, 0.0), (f64::NAN, 0.0), (0.5, -1.0)] {
        let none = MovedObject::wand(length_m, std_m, [("a", 0.04), ("b", 0.04)], good.observations.clone());
        assert!(matches!(refused(none), PoseError::BadObject { .. }), "{length_m} {std_m}");
    }
    let mut wrong = good.clone();
    wrong.observations[5].marker = 2;
    assert!(matches!(refused(wrong), PoseError::BadObservation { marker: 2, .. }));
    let mut wrong = good.clone();
    wrong.observations[5].pixel.x = f64::NAN;
    assert!(matches!(refused(wrong), PoseError::BadObservation { .. }));
    // Where the recordings are out of step, control points keep the cameras and the wand is nowhere.
    let mut late = good.clone();
    late.observations.iter_mut().filter(|o| o.camera == 1).for_each(|o| o.t_ns += 333_333_330);
    let full = super::test_sets::both(0.05, &mut random);
    let why = calibrate_with(&full, &[late]).unwrap_err();
    assert!(matches!(why, PoseError::ObjectMisfit { .. }), "{why}");
    assert!(why.to_string().contains("run in step"), "{why}");
    // Two points do not fix the axes.
    let places = [Vector3::new(0.5, 0.5, 0.5), Vector3::new(-0.5, 0.5, 0.5)];
    let two: Vec<CameraControl> = truth
        .iter()
        .map(|c| seen("cam", c, &places, Noise { std_px: 0.05, radius_m: 0.03 }, &mut random))
        .collect();
    let why = calibrate_with(&two, &[good]).unwrap_err();
    assert!(matches!(why, PoseError::WorldAxes { found: 2, needed: 3 }), "{why}");
}

/// Boards held square to the camera do not determine its focal length.
#[test]
fn a_board_at_no_useful_angle_says_which_views_are_missing() {
    let mut random = Random::new(17, 0);
    let side = |x: f64| {
        let k = cameras()[0];
        let at = Vector3::new(x, -2.0, 1.5);
        Camera::looking_at(at, at + Vector3::y(), k.intrinsics, k.size)
    };
    let truth = [side(-0.1), side(0.1)];
    let empty = MovedObject::board(6, 4, 0.04, Vec::new());
    let poses = board_views(&side(0.0), 8, 0.003, &mut random);
    let observations = observed(&truth, &empty.points, &poses, 0.05, &mut random);
    let why = calibrate_with(&unseen(&truth), &[MovedObject { observations, ..empty }]).unwrap_err();
    assert!(why.to_string().contains("add views tilted by 30°"), "{why}");
}

/// A body of four balls, flown before three cameras of which the third sees five, three or none of the control points.
#[test]
fn a_camera_with_few_control_points_is_as_good_as_it_claims_by_the_flight_and_the_others() {
    let mut truth = cameras().to_vec();
    let aim = Vector3::new(0.0, 0.0, 1.5);
    truth.push(Camera::looking_at(Vector3::new(0.5, 6.0, 2.5), aim, truth[0].intrinsics, truth[0].size));
    let ball = |at: [f64; 3]| BodyMarker { name: String::new(), marker_in_body_m: at.into(), radius_m: 0.02 };
    let body = [[0.2, 0.0, 0.0], [-0.1, 0.15, 0.0], [-0.1, -0.15, 0.02], [0.0, 0.0, 0.2]].map(ball).to_vec();
    let mut random = Random::new(31, 0);
    let (mut nees, trials) = (0.0, 8);
    for trial in 0..trials {
        let mut controls = both(0.05, &mut random);
        let mut third = seen("cam3", &truth[2], &cube(), Noise { std_px: 0.05, radius_m: 0.03 }, &mut random);
        for list in [&mut third.ball_radius_m, &mut third.survey_std_m] {
            list.truncate([5, 3, 0, 5][trial % 4]);
        }
        third.points.truncate(third.ball_radius_m.len());
        controls.push(third);
        // The ruler and the centres are off by as much as is stated.
        let mut built = body.clone();
        built.iter_mut().for_each(|p| p.marker_in_body_m += Vector3::from(random.normals()) * 5e-4);
        let mut observations = observed(&truth, &built, &waved(60, &mut random), 0.05, &mut random);
        let mut offset = || Vector2::from(random.normals()) * 0.05;
        let offsets: Vec<Vector2<f64>> = (0..12).map(|_| offset()).collect();
        observations.iter_mut().for_each(|o| o.pixel += offsets[4 * o.camera + o.marker]);
        let flight = MovedObject {
            name: "aircraft".into(),
            points: body.clone(),
            doubt: ObjectDoubt { points_std_m: 5e-4, centres_std_px: 0.05 },
            observations,
            ..MovedObject::wand(1.0, 0.0, [("", 0.0), ("", 0.0)], Vec::new())
        };
        let rig = calibrate_with(&controls, std::slice::from_ref(&flight)).unwrap();
        let error = rig.cameras[2].camera.centre_in_world() - truth[2].centre_in_world();
        let claim = &rig.cameras[2].centre_cov_m2;
        assert!(error.norm() < 0.01 && claim.trace().sqrt() < 0.01, "{error} of {}", claim.trace().sqrt());
        nees += error.dot(&claim.cholesky().unwrap().solve(&error)) / (3.0 * trials as f64);
        let [note] = &rig.by_flight[..] else { panic!("{:?}", rig.by_flight) };
        assert!(note.camera == "cam3" && note.instead.is_some_and(|i| i.1 == 8), "{note}");
        // Without a flight in its view it is refused.
        let unseen = flight.observations.iter().filter(|o| o.camera != 2).copied().collect();
        controls[2].points.truncate(3);
        controls[2].ball_radius_m.truncate(3);
        controls[2].survey_std_m.truncate(3);
        let why = calibrate_with(&controls, &[MovedObject { observations: unseen, ..flight }]).unwrap_err();
        assert!(matches!(why, PoseError::FewControlPoints { places: 0, needed: 6, .. }), "{why}");
    }
    // The mean of 24 squares of normal numbers: 0.95 quantiles.
    assert!((0.5..1.65).contains(&nees), "{nees}");
}

/// A board waved at arm's length before two cameras of which the second is late by up to half a frame, each time anew.
#[test]
fn cameras_that_are_not_in_step_are_as_good_as_they_claim() {
    const INTERVAL_S: f64 = 1.0 / 15.0;
    let truth = cameras().to_vec();
    let empty = MovedObject::board(6, 4, 0.2, Vec::new());
    let pose = |t_s: f64| {
        let wave = |hz: f64, shift: f64| (std::f64::consts::TAU * hz * t_s + shift).sin();
        let at = Vector3::new(0.8 * wave(0.21, 0.0), 0.8 * wave(0.17, 1.0) - 1.5, 1.5 + 0.5 * wave(0.3, 2.0));
        let turn = Vector3::new(1.6 + 0.5 * wave(0.2, 0.3), 0.5 * wave(0.13, 1.0), 0.4 * wave(0.29, 2.0));
        Isometry3::from_parts(Translation3::from(at), UnitQuaternion::from_scaled_axis(turn))
    };
    let mut random = Random::new(41, 0);
    let (mut observations, mut velocities_px_s) = (Vec::new(), Vec::new());
    for k in 0..90 {
        for (camera, view) in truth.iter().enumerate() {
            let own_s = 0.2 * f64::from(k) + random.between(-0.5, 0.5) * INTERVAL_S * camera as f64;
            for (marker, point) in empty.points.iter().enumerate() {
                let image = |t_s: f64| {
                    view.project(&(pose(t_s) * Point3::from(point.marker_in_body_m)).coords).unwrap().pixel
                };
                let pixel = image(own_s) + Vector2::from(random.normals()) * 0.05;
                let (t_ns, covariance_px2) = (i64::from(k), Matrix2::identity() * 0.0025);
                observations.push(MarkerObservation { t_ns, camera, marker, pixel, covariance_px2 });
                let moved_px = image(own_s + INTERVAL_S) - image(own_s - INTERVAL_S);
                velocities_px_s.push(moved_px / (2.0 * INTERVAL_S));
            }
        }
    }
    let in_step = MovedObject { observations, ..empty };
    let lags = Some(ObjectLags { std_s: INTERVAL_S / 24f64.sqrt(), velocities_px_s });
    let rig = calibrate_with(&unseen(&truth), &[MovedObject { lags, ..in_step.clone() }]).unwrap();
    let off = |rig: &Rig| {
        let (found, real) = (rig.cameras[1].camera.centre_in_world().norm(), truth[1].centre_in_world());
        found - (real - truth[0].centre_in_world()).norm()
    };
    let along = rig.cameras[1].camera.centre_in_world().normalize();
    let std_m = (along.transpose() * rig.cameras[1].centre_cov_m2 * along)[0].sqrt();
    assert!(off(&rig).abs() < 3.0 * std_m && std_m < 0.05, "{} of {std_m}", off(&rig));
    assert!(rig.cameras.iter().all(|c| c.residual_rms_px < 0.1), "{}", rig.cameras[1].residual_rms_px);
    let taken_as = calibrate_with(&unseen(&truth), &[in_step]);
    assert!(taken_as.is_err() || taken_as.is_ok_and(|r| r.cameras[1].residual_rms_px > 0.3));
}
