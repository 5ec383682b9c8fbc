use super::support::{flown, multisine, noisy_poses, pose, pose_covariance};
use crate::output_error::{
    FlightFitOptions, FlightFits, FlightModel, ImageMeasurements, Images, InputClock, Measurements,
    MotionFits, OutputErrorOptions, Prediction, StateMeasurement, output_error, predict_ahead, predict_poses,
};
use mavsight_flight::Vehicle;
use mavsight_geometry::{Camera, ControlPoint, ImageSize, Intrinsics, Matrix2, Vector2, Vector3};
use mavsight_pose::{BodyMarker, CameraControl, MarkerObservation, PoseEstimate, PoseSample, Rig, calibrate};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Scenario, true_values};
use nalgebra::Point3;

const KNOWN: FlightFitOptions<'_> = FlightFitOptions {
    clock: InputClock::Known,
    held_out_s: None,
    fits: MotionFits { output_error: true, filter_error: true },
    search: false,
    sensors: None,
    anew_ns: &[],
    begins_in_flight: false,
    at_most: None,
};

pub(crate) fn rig() -> Rig {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let k = Intrinsics::from_horizontal_fov(size, 53f64.to_radians());
    let target = Vector3::new(0.0, 0.0, 1.5);
    let side = |i: u32, bit: u32| if (i >> bit) & 1 == 1 { 1.5 } else { -1.5 };
    let controls: Vec<_> = [[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]]
        .iter()
        .map(|c| {
            let camera = Camera::looking_at(Vector3::from(*c), target, k, size);
            let points = (0..8)
                .map(|i| Vector3::new(side(i, 0), side(i, 1), side(i, 2) + 1.5))
                .map(|p| ControlPoint {
                    name: String::new(),
                    point_in_world_m: p,
                    pixel: camera.project(&p).expect("in view").pixel,
                    pixel_cov_px2: Matrix2::identity() * 0.01,
                })
                .collect();
            CameraControl::exact("camera".to_owned(), size, points, vec![0.0; 8])
        })
        .collect();
    calibrate(&controls).expect("a rig")
}

pub(crate) fn markers(vehicle: &Vehicle) -> Vec<BodyMarker> {
    let marker = |m: &mavsight_flight::Marker| BodyMarker {
        name: m.name.clone(),
        marker_in_body_m: Vector3::from(m.position_m),
        radius_m: 0.5 * m.diameter_m,
    };
    vehicle.marker.iter().map(marker).collect()
}

/// What the cameras see, with white noise of `std_px` and further displacements.
pub(crate) fn seen(
    states: &[FlightState],
    (rig, markers): (&Rig, &[BodyMarker]),
    std_px: f64,
    random: &mut Random,
    shift: impl Fn(usize, usize) -> Vector2<f64>,
) -> Vec<MarkerObservation> {
    let mut out = Vec::new();
    for s in states {
        for (c, camera) in rig.cameras.iter().enumerate() {
            for (m, marker) in markers.iter().enumerate() {
                let centre = (pose(s) * Point3::from(marker.marker_in_body_m)).coords;
                let exact = camera.camera.project_ball(&centre, marker.radius_m).expect("in view").pixel;
                let noise = Vector2::new(random.normal(), random.normal()) * std_px;
                out.push(MarkerObservation {
                    t_ns: (s.t_s * 1e9).round() as i64,
                    camera: c,
                    marker: m,
                    pixel: exact + noise + shift(c, m),
                    covariance_px2: Matrix2::identity() * (std_px * std_px),
                });
            }
        }
    }
    out
}

#[test]
fn pixels_give_the_truth_within_their_intervals() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(5.0));
    let truth = true_values(&vehicle);
    let (rig, markers) = (rig(), markers(&vehicle));
    let mut random = Random::new(8, 0);
    let shifts: Vec<Vector2<f64>> =
        (0..8).map(|_| Vector2::new(random.normal(), random.normal()) * 0.1).collect();
    let observations = seen(&states, (&rig, &markers), 0.1, &mut random, |c, m| shifts[4 * c + m]);
    let images = ImageMeasurements::new(&rig, &markers, &observations)
        .expect("images")
        .with_marker_positions(5e-4)
        .with_marker_biases(0.1);
    let model = FlightModel::new(&vehicle, &inputs).expect("a model");
    let measured = Measurements::Image(images);
    let fit = output_error(&model, &inputs, &measured, &OutputErrorOptions::default()).expect("a fit");
    println!("{} iterations, {:?} lag {}", fit.iterations, fit.variance_factors, fit.correlated_instants);
    for p in &fit.parameters {
        let Some(truth) = truth.get(&p.name) else { continue };
        let off = (p.value - truth) / p.std;
        println!("{:12} {:+.5e} ± {:.1e} {off:+.2}", p.name, p.value, p.std);
        assert!(
            off.abs() < 3.5,
            "{}: {:.4e} ± {:.1e} is {off:.1} standard deviations off",
            p.name,
            p.value,
            p.std
        );
    }
    // 150 residuals each: a standard deviation of 0.12.
    for (name, factor) in &fit.variance_factors {
        assert!((0.6..1.4).contains(factor), "{name}: {factor}");
    }
    let mean = fit.variance_factors.iter().map(|f| f.1).sum::<f64>() / fit.variance_factors.len() as f64;
    assert!((0.9..1.1).contains(&mean), "{mean}");
}

pub(crate) fn samples(states: &[FlightState], random: &mut Random) -> Vec<PoseSample> {
    let estimate = |world_from_body| PoseEstimate::new(world_from_body, &pose_covariance());
    noisy_poses(states, 1.0, random)
        .into_iter()
        .map(|m| PoseSample {
            t_ns: m.t_ns,
            estimate: m.pose.map(|(p, _)| estimate(p)).ok_or(mavsight_pose::PoseError::NotMeasured),
        })
        .collect()
}

#[test]
fn poses_and_images_of_a_flight_agree_and_a_wrong_scale_makes_them_disagree() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(5.0));
    let (rig, markers) = (rig(), markers(&vehicle));
    let mut random = Random::new(12, 0);
    let observations = seen(&states, (&rig, &markers), 0.1, &mut random, |_, _| Vector2::zeros());
    let mut poses = samples(&states, &mut random);
    let fit = |poses: &[PoseSample]| {
        let images =
            Images { rig: &rig, markers: &markers, markers_std_m: 5e-4, observations: &observations };
        FlightFits::of_flight(&vehicle, &inputs, poses, Some(images), &KNOWN).expect("fits")
    };
    let fits = fit(&poses);
    assert_eq!(fits.named().map(|(name, _)| name).collect::<Vec<_>>(), ["oe", "fe", "image"]);
    assert!(fits.held.is_empty() && fits.refusals.is_empty(), "{:?} {:?}", fits.held, fits.refusals);
    let comparisons = fits.comparisons(None);
    let pairs: Vec<_> = comparisons.iter().map(|c| (c.between.0.as_str(), c.between.1.as_str())).collect();
    assert_eq!(pairs, [("oe", "fe"), ("oe", "image")]);
    let both = &comparisons[1];
    assert_eq!(both.parameters.len(), 17);
    assert!(both.test.p_value > 1e-3, "{:?}", both.test);
    for estimate in poses.iter_mut().filter_map(|p| p.estimate.as_mut().ok()) {
        estimate.world_from_body.translation.vector *= 1.05;
    }
    let scaled = fit(&poses);
    let apart = scaled.comparisons(None);
    assert!(apart[1].test.is_significant(), "{:?} {:?}", apart[1].test, scaled.refusals);
}

/// Coefficients that are wrong by a fifth predict worse by far.
#[test]
fn what_is_held_out_is_predicted_and_enters_no_fit() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &multisine(5.0));
    let (rig, markers) = (rig(), markers(&vehicle));
    let mut random = Random::new(4, 0);
    let observations = seen(&states, (&rig, &markers), 0.1, &mut random, |_, _| Vector2::zeros());
    let mut poses = samples(&states, &mut random);
    let options = FlightFitOptions { held_out_s: Some((3.0, 4.0)), ..KNOWN };
    let images = Images { rig: &rig, markers: &markers, markers_std_m: 5e-4, observations: &observations };
    let fits = FlightFits::of_flight(&vehicle, &inputs, &poses, Some(images), &options).expect("fits");
    assert!(fits.refusals.is_empty(), "{:?}", fits.refusals);
    for (name, fit) in fits.named() {
        let held = fit.held_out.as_ref().expect("a prediction");
        assert!(held.span_s.0 >= 3.0 && held.span_s.1 <= 4.0 && held.agreements[0].count == 31, "{held:?}");
        for (coordinate, a) in Prediction::COORDINATES.iter().zip(&held.agreements) {
            // The noise is 0.5 mm and 0.05 degrees.
            let noise = if coordinate.len() == 1 { 5e-4 } else { 9e-4 };
            assert!(a.rms < 3.0 * noise, "{name} {coordinate}: {a:?}");
        }
        // The part is one second long: its start is filtered from the poses before it.
        let ahead = fit.ahead.expect("a prediction");
        assert_eq!((ahead.count, ahead.ran_away), (1, 0), "{name}");
        let by_model = ahead.model.expect("a pose");
        assert!(by_model.attitude_rad < ahead.held.attitude_rad, "{name}: {ahead:?}");
        let model = FlightModel::new(&vehicle, &inputs).expect("a model");
        // How noisy pixels are says nothing of poses.
        let mut noisy = fit.clone();
        let of_pixels = noisy.variance_factors.iter_mut().filter(|(channel, _)| channel.contains("camera"));
        of_pixels.take(3).for_each(|(_, factor)| *factor *= 1e4);
        let states: Vec<_> = poses.iter().map(StateMeasurement::from_pose).collect();
        let [own, other] = [fit, &noisy].map(|fit| predict_ahead(&model, fit, &inputs, &states, 1.0));
        assert_eq!(own.expect("predicted"), other.expect("predicted"), "{name}");
        let mut wrong = fit.clone();
        wrong.parameters.iter_mut().filter(|p| p.name.starts_with("C_m,alpha")).for_each(|p| p.value *= 1.2);
        let worse = predict_poses(&model, &wrong, &inputs, &poses[90..=120]).expect("a prediction");
        assert!(worse.agreements[4].rms > 2.0 * held.agreements[4].rms, "{name}: {worse:?}");
    }
    let none = FlightFitOptions { held_out_s: Some((9.0, 9.5)), ..KNOWN };
    let empty = FlightFits::of_flight(&vehicle, &inputs, &poses, None, &none).expect("fits");
    assert!(
        empty.refusals[0].starts_with("No prediction by output error from poses"),
        "{:?}",
        empty.refusals
    );
    for held in poses.iter_mut().filter(|p| options.holds_out(p.t_ns)) {
        held.estimate.as_mut().expect("all").world_from_body.translation.vector.x += 1.0;
    }
    let again = FlightFits::of_flight(&vehicle, &inputs, &poses, None, &options).expect("fits");
    assert_eq!(again.poses.map(|f| f.covariance), fits.poses.map(|f| f.covariance));
}

#[test]
fn what_constant_rotor_speeds_do_not_determine_is_held_and_named() {
    let vehicle = Vehicle::paper();
    let (inputs, states) = flown(&vehicle, &Scenario::paper());
    let fits =
        FlightFits::of_flight(&vehicle, &inputs, &samples(&states, &mut Random::new(3, 0)), None, &KNOWN)
            .expect("fits");
    assert_eq!(fits.held, ["C_l,p", "C_Z,u", "C_Z,l", "C_n,u", "C_n,l", "C_n,r"]);
    assert!(fits.image.is_none() && fits.comparisons(None).len() == 1, "output error and filter error");
    let nothing = FlightFits::of_flight(&vehicle, &inputs, &[], None, &KNOWN).expect("refused, not wrong");
    assert!(nothing.poses.is_none() && nothing.refusals.len() == 2, "{:?}", nothing.refusals);
}
