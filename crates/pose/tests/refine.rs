//! Cameras and marker positions from the flight itself, against cameras and bodies that are known.

#[allow(dead_code)]
mod simulated;

use mavsight_geometry::{Camera, Vector2, Vector3};
use mavsight_pose::{FlightPrior, PoseError, PoseEstimator, RefinedFlight, Rig, hold_out, refine_flight};
use nalgebra::{DMatrix, DVector, Isometry3};
use simulated::ruler::{Case, RULER, case, case_with_bias, file_from_body, position_rms_m, rms};
use simulated::{PIXEL_STD, Random, flight, observed, poses, rigs, square, true_cameras};

/// Squared error of the refined shape by its stated uncertainty. Along motions of the whole body nothing is
/// added.
fn shape_nees(c: &Case) -> f64 {
    let axes = file_from_body(&square(), &c.file);
    let error = DVector::from_fn(12, |i, _| {
        let want = axes * nalgebra::Point3::from(square()[i / 3].marker_in_body_m);
        c.refined.markers[i / 3].marker_in_body_m[i % 3] - want[i % 3]
    });
    let mut nees = 0.0;
    let of_markers = c.refined.uncertainty.rows(32, 12);
    let covariance = of_markers * of_markers.transpose();
    let eigen = covariance.symmetric_eigen();
    for k in 0..12 {
        let (along, variance) = (eigen.eigenvectors.column(k).dot(&error), eigen.eigenvalues[k]);
        if variance > 1e-12 {
            nees += along * along / variance;
        } else {
            assert!(along.abs() < 5e-5, "{along} m along a motion of the whole body");
        }
    }
    nees
}

#[test]
fn positions_with_refined_markers_are_as_good_as_with_true_ones() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let mut random = Random::new(5, 0);
    let (mut with_true, mut with_file, mut with_refined) = (0.0, 0.0, 0.0);
    for _ in 0..6 {
        let c = case(&rig, &mut random);
        let [of_true, of_file, of_refined] = position_rms_m(&rig, &c);
        with_true += of_true;
        with_file += of_file;
        with_refined += of_refined;
        assert!(c.refined.chi_square.1 < 0.9 * c.refined.chi_square.0, "{:?}", c.refined.chi_square);
    }
    assert!(with_refined < 1.2 * with_true, "{with_refined} against {with_true} (file: {with_file})");
    assert!(
        with_file > 1.03 * with_refined,
        "the ruler must matter in this test: {with_file} {with_refined}"
    );
}

#[test]
fn the_stated_uncertainty_of_the_shape_is_true_and_no_motion_is_added() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let (mut random, mut nees, trials) = (Random::new(9, 0), 0.0, 12);
    let exact = FlightPrior { centres_std_px: Some(0.0), ..RULER };
    for _ in 0..trials {
        let c = case_with_bias(&rig, 0.0, exact, &mut random);
        nees += shape_nees(&c) / f64::from(trials);
        let shift: Vector3<f64> = c.refined.markers.iter().map(|m| m.marker_in_body_m).sum::<Vector3<f64>>()
            - c.file.iter().map(|m| m.marker_in_body_m).sum::<Vector3<f64>>();
        assert!(shift.norm() < 1e-6, "{shift}");
    }
    // Twelve coordinates less six of the body's motion; the mean over twelve trials scatters by one.
    assert!((nees - 6.0).abs() < 2.5, "mean NEES {nees}");
}

/// Cameras as control points determine them, refined by flights with and without systematic errors of
/// centres.
#[test]
fn cameras_that_a_flight_has_refined_are_better_and_as_good_as_they_claim() {
    for (name, rig) in rigs().into_iter().skip(1) {
        let mut random = Random::new(17, 0);
        for bias_px in [0.0, 0.1] {
            let (mut nees, mut before, mut after, trials) = (0.0, 0.0, 0.0, 4);
            for _ in 0..trials {
                let states = flight(&mut random);
                let cameras = true_cameras(&rig, &mut random);
                let mut seen = observed(&cameras, &square(), &states, &mut random);
                let bias: Vec<Vector2<f64>> = (0..4 * cameras.len())
                    .map(|_| Vector2::new(random.normal(), random.normal()) * bias_px)
                    .collect();
                seen.iter_mut().flatten().for_each(|o| o.pixel += bias[4 * o.camera + o.marker]);
                let prior = FlightPrior { markers_std_m: 5e-4, centres_std_px: Some(bias_px) };
                let flown: RefinedFlight =
                    refine_flight(&seen.concat().iter().collect(), &rig, &square(), prior)
                        .expect("a refined flight");
                let n = 3 * cameras.len();
                let error = DVector::from_fn(n, |i, _| {
                    let is = flown.rig.cameras[i / 3].camera.centre_in_world();
                    (cameras[i / 3].centre_in_world() - is)[i % 3]
                });
                let of_centres = DMatrix::from_fn(n, flown.rig.uncertainty.ncols(), |i, k| {
                    flown.rig.uncertainty[(16 * (i / 3) + 3 + i % 3, k)]
                });
                let covariance = &of_centres * of_centres.transpose();
                nees +=
                    error.dot(&covariance.cholesky().expect("positive").solve(&error)) / (n * trials) as f64;
                let rms_m = |e: &PoseEstimator| {
                    rms(&poses(e, &states, &seen), &states, &Isometry3::identity()).powi(2)
                };
                before += rms_m(&PoseEstimator::new(&rig, &square()));
                after += rms_m(&PoseEstimator::refined(&flown, Some(&square())).expect("a body"));
            }
            assert!((0.5..1.6).contains(&nees), "{name}, bias {bias_px}: {nees}");
            // Single poses have mostly noise of their own, which the cameras do not lessen.
            let most = if bias_px > 0.0 { 1.0 } else { 1.03 };
            assert!(after < most * before, "{name}, bias {bias_px}: {after} {before}");
        }
    }
}

/// Errors of a ruler explain much of the constant part of the residuals. Without that part among the
/// systematic errors of centres, the stated errors of markers would be four to ten times too small.
#[test]
fn systematic_errors_of_centres_are_found_next_to_errors_of_markers() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    for bias_px in [0.0, 0.05, 0.2] {
        let mut random = Random::new(23, 0);
        let (mut squares_px2, mut nees, trials) = (0.0, 0.0, 12);
        for _ in 0..trials {
            let case = case_with_bias(&rig, bias_px, RULER, &mut random);
            squares_px2 += case.refined.centres_std_px.powi(2) / f64::from(trials);
            nees += shape_nees(&case) / f64::from(trials);
        }
        let found_px = squares_px2.sqrt();
        assert!(
            (found_px - bias_px).abs() < 0.25 * PIXEL_STD + 0.35 * bias_px,
            "{found_px} px for {bias_px}"
        );
        // Six, or less: what a flight does not determine counts as large as the stated errors of centres.
        assert!((1.0..9.0).contains(&nees), "{bias_px} px: mean NEES {nees}");
    }
}

#[test]
fn what_cannot_be_refined_is_refused() {
    let (_, mut rig) = rigs().into_iter().next().unwrap();
    let mut random = Random::new(2, 0);
    let states = flight(&mut random);
    let mut seen = observed(&true_cameras(&rig, &mut random), &square(), &states[..9], &mut random).concat();
    assert!(matches!(
        refine_flight(&seen.iter().collect(), &rig, &square(), RULER),
        Err(PoseError::TooFewPoses { measured: 9, samples: 9, needed: 10 })
    ));
    for std in [0.0, -1.0, f64::NAN] {
        let prior = FlightPrior { markers_std_m: std, ..RULER };
        assert!(matches!(
            refine_flight(&seen.iter().collect(), &rig, &square(), prior),
            Err(PoseError::BadPrior { .. })
        ));
    }
    let prior = FlightPrior { centres_std_px: Some(-1.0), ..RULER };
    assert!(matches!(
        refine_flight(&seen.iter().collect(), &rig, &square(), prior),
        Err(PoseError::BadBias { .. })
    ));
    seen[3].pixel.x = f64::NAN;
    assert!(matches!(
        refine_flight(&seen.iter().collect(), &rig, &square(), RULER),
        Err(PoseError::BadObservation { .. })
    ));
    rig.frames = 150;
    let twice = refine_flight(&seen.iter().collect(), &rig, &square(), RULER).unwrap_err();
    assert!(twice.to_string().contains("150 frames of a flight have refined"), "{twice}");
}

/// With one attitude throughout, a systematic error of a centre looks like a marker elsewhere; with a turn
/// about the vertical it does not.
#[test]
fn a_flight_that_does_not_turn_is_refused_and_one_that_does_is_not() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let (mut random, good_ruler_m) = (Random::new(4, 0), 5e-4);
    let mut states = flight(&mut random);
    let (attitude, cameras) = (states[0].attitude, true_cameras(&rig, &mut random));
    for turns in [0.0, 1.0] {
        let share = 1.0 / states.len() as f64;
        for (k, s) in states.iter_mut().enumerate() {
            s.attitude = attitude;
            s.attitude.psi_rad += turns * std::f64::consts::TAU * k as f64 * share;
        }
        let seen = observed(&cameras, &square(), &states, &mut random).concat();
        // The whole stated error of a centre may be systematic.
        let prior = FlightPrior { markers_std_m: good_ruler_m, centres_std_px: Some(PIXEL_STD) };
        let refined =
            refine_flight(&seen.iter().collect(), &rig, &square(), prior).expect("a refined flight");
        match refined.shape_is_shown() {
            Err(PoseError::ShapeNotShown { std_m, turned_rad, .. }) => {
                assert!(
                    turns == 0.0 && std_m > 0.9 * good_ruler_m && turned_rad < 0.1,
                    "{std_m} {turned_rad}"
                );
            }
            Ok(()) => {
                assert!(turns > 0.0 && refined.turned_rad > 3.0, "{turns} {}", refined.turned_rad);
                let std_m = &refined.markers_std_m;
                assert!(std_m.iter().all(|s| s.amax() < good_ruler_m), "{std_m:?}");
            }
            Err(other) => panic!("{other}"),
        }
    }
}

/// Whether held-out seconds ask for a refinement, and the RMS of positions without and with it, of a hover about
/// which the aircraft is carried in sweeps of a size.
fn weighed(rig: &Rig, cameras: &[Camera], sweep_m: f64, random: &mut Random) -> (bool, [f64; 2]) {
    const BIAS_PX: f64 = 0.1;
    let mut states = flight(random);
    for state in &mut states {
        let along = Vector3::new(1.3, 1.9, 0.8) * state.t_s;
        state.position_in_world_m += along.map(f64::sin) * sweep_m;
    }
    let mut seen = observed(cameras, &square(), &states, random);
    let bias: Vec<Vector2<f64>> =
        (0..4 * cameras.len()).map(|_| Vector2::new(random.normal(), random.normal()) * BIAS_PX).collect();
    seen.iter_mut().flatten().for_each(|o| o.pixel += bias[4 * o.camera + o.marker]);
    let observations = seen.concat().iter().collect();
    let prior = FlightPrior { markers_std_m: 5e-4, centres_std_px: None };
    let held_out = hold_out(&observations, rig, &square(), prior).expect("seconds that are held out");
    let flown = refine_flight(&observations, rig, &square(), prior).expect("a refined flight");
    let rms_m = |e: &PoseEstimator| rms(&poses(e, &states, &seen), &states, &Isometry3::identity());
    let refined = PoseEstimator::refined(&flown, Some(&square())).expect("a body");
    (held_out.knows_more(), [rms_m(&PoseEstimator::new(rig, &square())), rms_m(&refined)])
}

/// Of cameras that are right none are refined, whatever errors the centres have; of cameras that are off by 20 times
/// what a good calibration leaves, most are.
#[test]
fn held_out_seconds_ask_for_other_cameras_where_these_are_better() {
    let (_, mut rig) = rigs().into_iter().nth(1).unwrap();
    rig.uncertainty *= 20.0;
    let as_calibrated: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
    let (mut random, trials) = (Random::new(31, 0), 4);
    let (mut asks, mut before_m2, mut after_m2) = ([0; 3], 0.0, 0.0);
    for _ in 0..trials {
        let wrong = true_cameras(&rig, &mut random);
        for (k, (cameras, sweep_m)) in
            [(&as_calibrated, 0.0), (&as_calibrated, 0.8), (&wrong, 0.8)].into_iter().enumerate()
        {
            let (is_asked, [before_m, after_m]) = weighed(&rig, cameras, sweep_m, &mut random);
            asks[k] += usize::from(is_asked);
            if is_asked {
                before_m2 += before_m * before_m;
                after_m2 += after_m * after_m;
            }
        }
    }
    assert!(asks[..2] == [0, 0] && asks[2] > trials / 2, "{asks:?}");
    assert!(after_m2 < 0.9 * before_m2, "{after_m2} of {before_m2} m²");
}
