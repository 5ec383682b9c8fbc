//! Marker positions from the flight itself, against bodies whose markers are known.

#[allow(dead_code)]
mod simulated;

use mavsight_flight::FlightState;
use mavsight_geometry::{Isometry3, Vector3, rigid_fit};
use mavsight_pose::{
    BodyMarker, MarkerObservation, PoseError, PoseEstimator, PoseSample, RefinedMarkers, refine_markers,
};
use nalgebra::DVector;
use simulated::{Random, flight, pose_of, poses, rigs, sights, square, true_cameras};

const RULER_M: f64 = 2e-3;

fn off_by_a_ruler(markers: &[BodyMarker], random: &mut Random) -> Vec<BodyMarker> {
    let mut out = markers.to_vec();
    for m in &mut out {
        m.marker_in_body_m += Vector3::from_fn(|_, _| random.normal()) * RULER_M;
    }
    out
}

/// The motion that carries the true body axes' coordinates into those of the file: the axes that refined markers have.
fn file_from_body(true_body: &[BodyMarker], file: &[BodyMarker]) -> Isometry3<f64> {
    let places = |m: &[BodyMarker]| m.iter().map(|m| m.marker_in_body_m).collect::<Vec<_>>();
    rigid_fit(&places(true_body), &places(file), &vec![1.0; file.len()]).expect("a fit").world_from_body
}

/// Position RMS against the flight in the axes that `file_from_body` leads to.
fn rms(poses: &[PoseSample], flight: &[FlightState], file_from_body: &Isometry3<f64>) -> f64 {
    let error = |(p, s): (&PoseSample, &FlightState)| {
        let truth = pose_of(s) * file_from_body.inverse();
        let e = p.estimate.as_ref()?;
        Some((e.world_from_body.translation.vector - truth.translation.vector).norm_squared())
    };
    let errors: Vec<f64> = poses.iter().zip(flight).filter_map(error).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
}

struct Case {
    file: Vec<BodyMarker>,
    flight: Vec<FlightState>,
    seen: Vec<Vec<MarkerObservation>>,
    refined: RefinedMarkers,
}

fn case(rig: &mavsight_pose::Rig, random: &mut Random) -> Case {
    let file = off_by_a_ruler(&square(), random);
    let flight = flight(random);
    let cameras = true_cameras(rig, random);
    let seen = sights(&cameras, &square(), &flight, random);
    let refined = refine_markers(&seen.concat(), rig, &file, RULER_M).expect("a refined body");
    Case { file, flight, seen, refined }
}

#[test]
fn positions_with_refined_markers_are_as_good_as_with_true_ones() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let mut random = Random(5);
    let (mut with_true, mut with_file, mut with_refined) = (0.0, 0.0, 0.0);
    for _ in 0..6 {
        let c = case(&rig, &mut random);
        let axes = file_from_body(&square(), &c.file);
        let run = |e: &PoseEstimator| poses(e, &c.flight, &c.seen);
        with_true += rms(&run(&PoseEstimator::new(&rig, &square())), &c.flight, &Isometry3::identity());
        with_file += rms(&run(&PoseEstimator::new(&rig, &c.file)), &c.flight, &axes);
        with_refined += rms(&run(&PoseEstimator::refined(&rig, &c.refined).unwrap()), &c.flight, &axes);
        assert!(c.refined.chi_square.1 < 0.9 * c.refined.chi_square.0, "{:?}", c.refined.chi_square);
    }
    assert!(with_refined < 1.2 * with_true, "{with_refined} against {with_true} (file: {with_file})");
    assert!(
        with_file > 1.03 * with_refined,
        "the ruler must matter in this test: {with_file} {with_refined}"
    );
}

#[test]
fn what_remains_unknown_of_the_shape_is_true_and_no_motion_is_added() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let (mut random, mut nees, trials) = (Random(9), 0.0, 12);
    for _ in 0..trials {
        let c = case(&rig, &mut random);
        let axes = file_from_body(&square(), &c.file);
        let error = DVector::from_fn(12, |i, _| {
            let want = axes * nalgebra::Point3::from(square()[i / 3].marker_in_body_m);
            c.refined.markers[i / 3].marker_in_body_m[i % 3] - want[i % 3]
        });
        let m = &c.refined;
        let covariance =
            &m.uncertainty_m * m.uncertainty_m.transpose() + &m.by_rig_m * m.by_rig_m.transpose();
        let eigen = covariance.symmetric_eigen();
        for k in 0..12 {
            let (along, variance) = (eigen.eigenvectors.column(k).dot(&error), eigen.eigenvalues[k]);
            if variance > 1e-12 {
                nees += along * along / variance / f64::from(trials);
            } else {
                assert!(along.abs() < 5e-5, "{along} m along a motion of the whole body");
            }
        }
        let shift: Vector3<f64> = c.refined.markers.iter().map(|m| m.marker_in_body_m).sum::<Vector3<f64>>()
            - c.file.iter().map(|m| m.marker_in_body_m).sum::<Vector3<f64>>();
        assert!(shift.norm() < 1e-6, "{shift}");
    }
    // Twelve coordinates less six of the body's motion; the mean over twelve trials scatters by one.
    assert!((nees - 6.0).abs() < 2.5, "mean NEES {nees}");
}

#[test]
fn what_cannot_be_refined_is_refused() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let mut random = Random(2);
    let states = flight(&mut random);
    let mut seen = sights(&true_cameras(&rig, &mut random), &square(), &states[..9], &mut random).concat();
    assert!(matches!(
        refine_markers(&seen, &rig, &square(), RULER_M),
        Err(PoseError::TooFewPoses { measured: 9, samples: 9, needed: 10 })
    ));
    for std_m in [0.0, -1.0, f64::NAN] {
        assert!(matches!(refine_markers(&seen, &rig, &square(), std_m), Err(PoseError::BadPrior { .. })));
    }
    seen[3].pixel.x = f64::NAN;
    assert!(matches!(refine_markers(&seen, &rig, &square(), RULER_M), Err(PoseError::BadObservation { .. })));
}

/// With one attitude all the while a centre that is off looks like a marker elsewhere; with a turn about the vertical it does not.
#[test]
fn a_flight_that_does_not_turn_is_refused_and_one_that_does_is_not() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let (mut random, good_ruler_m) = (Random(4), 5e-4);
    let mut states = flight(&mut random);
    let (attitude, cameras) = (states[0].attitude, true_cameras(&rig, &mut random));
    for turns in [0.0, 1.0] {
        let share = 1.0 / states.len() as f64;
        for (k, s) in states.iter_mut().enumerate() {
            s.attitude = attitude;
            s.attitude.psi_rad += turns * std::f64::consts::TAU * k as f64 * share;
        }
        let seen = sights(&cameras, &square(), &states, &mut random).concat();
        match refine_markers(&seen, &rig, &square(), good_ruler_m) {
            Err(PoseError::ShapeNotShown { std_m, turned_rad, .. }) => {
                assert!(turns == 0.0 && std_m > good_ruler_m && turned_rad < 0.1, "{std_m} {turned_rad}");
            }
            Ok(refined) => {
                assert!(turns > 0.0 && refined.turned_rad > 3.0, "{turns} {}", refined.turned_rad);
                assert!(refined.std_m.iter().all(|s| s.amax() < good_ruler_m), "{:?}", refined.std_m);
            }
            Err(other) => panic!("{other}"),
        }
    }
}
