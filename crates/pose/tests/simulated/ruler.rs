//! Bodies whose vehicle file has the errors of a ruler.

use super::{Random, flight, observed, pose_of, poses, square, true_cameras};
use mavsight_geometry::{Isometry3, Vector2, Vector3, rigid_fit};
use mavsight_pose::{
    BodyMarker, FlightPrior, MarkerObservation, PoseEstimator, PoseSample, RefinedFlight, Rig, refine_flight,
};
use mavsight_simulator::FlightState;

/// Standard deviation of a coordinate in the file.
pub(crate) const RULER_M: f64 = 2e-3;

/// A body read with a ruler, and no knowledge of systematic errors of centres.
pub(crate) const RULER: FlightPrior = FlightPrior { markers_std_m: RULER_M, centres_std_px: None };

fn off_by_a_ruler(markers: &[BodyMarker], random: &mut Random) -> Vec<BodyMarker> {
    let mut out = markers.to_vec();
    for m in &mut out {
        m.marker_in_body_m += Vector3::from_fn(|_, _| random.normal()) * RULER_M;
    }
    out
}

/// The motion that carries the true body axes' coordinates into those of the file: the axes that refined
/// markers have.
pub(crate) fn file_from_body(true_body: &[BodyMarker], file: &[BodyMarker]) -> Isometry3<f64> {
    let pairs = true_body.iter().zip(file).map(|(a, b)| (a.marker_in_body_m, b.marker_in_body_m));
    rigid_fit(pairs).expect("a fit")
}

/// Position RMS against the flight in the axes that `file_from_body` leads to.
pub(crate) fn rms(poses: &[PoseSample], flight: &[FlightState], file_from_body: &Isometry3<f64>) -> f64 {
    let error = |(p, s): (&PoseSample, &FlightState)| {
        let truth = pose_of(s) * file_from_body.inverse();
        let e = p.estimate.as_ref().ok()?;
        Some((e.world_from_body.translation.vector - truth.translation.vector).norm_squared())
    };
    let errors: Vec<f64> = poses.iter().zip(flight).filter_map(error).collect();
    (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
}

/// A flight, and the body that it refines.
pub(crate) struct Case {
    pub(crate) file: Vec<BodyMarker>,
    pub(crate) flight: Vec<FlightState>,
    pub(crate) seen: Vec<Vec<MarkerObservation>>,
    pub(crate) refined: RefinedFlight,
}

/// A file, a flight and a calibration at random.
pub(crate) fn case(rig: &Rig, random: &mut Random) -> Case {
    case_with_bias(rig, 0.0, RULER, random)
}

/// [`case`] with a constant error of each centre and a stated prior.
pub(crate) fn case_with_bias(rig: &Rig, bias_px: f64, prior: FlightPrior, random: &mut Random) -> Case {
    let file = off_by_a_ruler(&square(), random);
    let flight = flight(random);
    let cameras = true_cameras(rig, random);
    let mut seen = observed(&cameras, &square(), &flight, random);
    if bias_px > 0.0 {
        let mut off = || Vector2::new(random.normal(), random.normal()) * bias_px;
        let bias: Vec<_> = (0..4 * cameras.len()).map(|_| off()).collect();
        seen.iter_mut().flatten().for_each(|o| o.pixel += bias[4 * o.camera + o.marker]);
    }
    let refined = refine_flight(&seen.concat().iter().collect(), rig, &file, prior).expect("a refined body");
    Case { file, flight, seen, refined }
}

/// Position RMS with the true marker positions, with those of the file, and with the refined ones. The last
/// two are in the axes of the file, which are off from the true ones by a motion that no film can show.
pub(crate) fn position_rms_m(rig: &Rig, c: &Case) -> [f64; 3] {
    let axes = file_from_body(&square(), &c.file);
    let with = |e: &PoseEstimator, axes: &Isometry3<f64>| rms(&poses(e, &c.flight, &c.seen), &c.flight, axes);
    [
        with(&PoseEstimator::new(rig, &square()), &Isometry3::identity()),
        with(&PoseEstimator::new(rig, &c.file), &axes),
        with(&PoseEstimator::refined(&c.refined, None).expect("a refined body"), &axes),
    ]
}
