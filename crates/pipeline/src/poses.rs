//! Poses of instants whose observations are identified.

use crate::tracked::Tracked;
use mavsight_geometry::Isometry3;
use mavsight_pose::{
    MarkerObservation, PoseError, PoseEstimate, PoseEstimator, PoseSample, displacements_of_reordered_frames,
};

pub(crate) fn pose_at(
    estimator: &PoseEstimator,
    t_ns: i64,
    seen: &[MarkerObservation],
    previous: Option<&Isometry3<f64>>,
) -> PoseSample {
    PoseSample { t_ns, estimate: estimator.estimate(t_ns, seen, previous) }
}

/// Estimates all poses again with what the first estimates have shown of the centres: how good those of
/// each ball in each camera are, which enters the observations' covariances, and how large their systematic
/// errors are.
pub(crate) fn poses_anew(estimator: PoseEstimator, tracked: &mut Tracked) -> Result<(), PoseError> {
    let factors = estimator.centre_factors(&tracked.observations, &tracked.poses)?;
    let markers = estimator.markers().len();
    tracked.observations.scale_covariances(|camera, marker| factors[camera * markers + marker]);
    estimate_all(&estimator, tracked, provisional);
    let bias_px = estimator.centre_bias_px(&tracked.observations, &tracked.poses)?;
    let estimator = estimator.with_centre_bias(bias_px)?;
    estimate_all(&estimator, tracked, condensed);
    tracked.estimator = Some(estimator);
    if tracked.may_be_reordered {
        allow_for_displacements(tracked);
    }
    Ok(())
}

fn allow_for_displacements(tracked: &mut Tracked) {
    let displacements = displacements_of_reordered_frames(&tracked.poses);
    for (pose, displaced) in tracked.poses.iter_mut().zip(&displacements) {
        if let Ok(estimate) = &mut pose.estimate {
            *estimate = estimate.clone().with_systematic_column(displaced);
        }
    }
    tracked.displacements = displacements.iter().map(|by| by.map(|v| v as f32)).collect();
}

/// The same for poses of other cameras and markers than those that are there.
pub(crate) fn poses_again(estimator: PoseEstimator, tracked: &mut Tracked) -> Result<(), PoseError> {
    estimate_all(&estimator, tracked, provisional);
    poses_anew(estimator, tracked)
}

/// A pose that will be estimated again, without what only the last estimate of it is asked for: in an hour
/// of film the systematic part of its errors is hundreds of megabytes.
pub(crate) fn provisional(mut pose: PoseSample) -> PoseSample {
    pose.estimate = pose.estimate.map(PoseEstimate::all_new);
    pose
}

/// A pose with the systematic part of its own covariance; how that is correlated between poses is formed
/// from the observations when it is needed.
fn condensed(mut pose: PoseSample) -> PoseSample {
    pose.estimate = pose.estimate.map(PoseEstimate::condensed);
    pose
}

fn estimate_all(estimator: &PoseEstimator, tracked: &mut Tracked, kept: impl Fn(PoseSample) -> PoseSample) {
    let mut previous = None;
    let mut seen = Vec::new();
    for pose in &mut tracked.poses {
        tracked.observations.at(pose.t_ns, &mut seen);
        if seen.is_empty() && pose.estimate.is_err() {
            continue;
        }
        // Where two minima are likely, the one that was found with what the instant knew is the one.
        let known = pose.estimate.as_ref().ok().map(|e| e.world_from_body).or(previous);
        *pose = kept(pose_at(estimator, pose.t_ns, &seen, known.as_ref()));
        previous = pose.estimate.as_ref().ok().map(|e| e.world_from_body).or(previous);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::systematic_columns;
    use crate::testing::carried::{SMALL, TWO, rig_at, seen_by};
    use crate::{NoProgress, motion_of};
    use crate::{Refinement, body_markers, refine};
    use mavsight_flight::Vehicle;
    use mavsight_geometry::{EulerAngles, Vector2, Vector3, world_from_body};
    use mavsight_pose::{BodyMarker, Rig};
    use mavsight_random::Random;

    /// Standard deviation of the centres: a uniform spread of a tenth of a pixel.
    const STD_PX: f64 = 0.0289;
    const FRAMES: u32 = 90;

    fn rig() -> Rig {
        rig_at(&TWO, SMALL, 1e-5f64.sqrt())
    }

    /// A slow turn and climb; each centre has a systematic error of its own, drawn with this standard
    /// deviation.
    fn tracked(rig: &Rig, body: &[BodyMarker], bias_px: f64, draw: u64) -> Tracked {
        let (mut random, mut own) = (Random::new(draw, 0), Random::new(draw, 1));
        let mut out = Tracked::default();
        let mut bias = || Vector2::new(own.normal(), own.normal()) * bias_px;
        let biases: Vec<Vector2<f64>> = (0..rig.cameras.len() * body.len()).map(|_| bias()).collect();
        for k in 0..FRAMES {
            let (t_ns, t) = (i64::from(k) * 33_333_333, f64::from(k) / 30.0);
            let attitude =
                EulerAngles { phi_rad: 0.2 * t.sin(), theta_rad: 0.2 * (2.0 * t).cos(), psi_rad: 0.3 * t };
            let pose = world_from_body(Vector3::new(0.3 * t.sin(), 0.1 * t, 1.3 + 0.1 * t), attitude);
            for camera in 0..rig.cameras.len() {
                let seen = seen_by((rig, camera), (body, &pose), t_ns, (STD_PX, &mut random));
                for mut observation in seen {
                    observation.pixel += biases[camera * body.len() + observation.marker];
                    out.observations.push(&observation);
                }
            }
            out.poses.push(PoseSample { t_ns, estimate: Err(PoseError::NotMeasured) });
        }
        let (estimator, mut previous) = (PoseEstimator::new(rig, &body_markers(&Vehicle::paper())), None);
        let mut seen = Vec::new();
        for pose in &mut out.poses {
            out.observations.at(pose.t_ns, &mut seen);
            *pose = pose_at(&estimator, pose.t_ns, &seen, previous.as_ref());
            previous = pose.estimate.as_ref().ok().map(|e| e.world_from_body);
        }
        out
    }

    /// The systematic error that poses show, px, and the standard deviations of x before and after:
    /// systematic and random.
    fn shown(bias_px: f64, draw: u64) -> (f64, [(f64, f64); 2]) {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        let mut tracked = tracked(&rig, &body, bias_px, draw);
        let std_m = |tracked: &Tracked| {
            let estimate = tracked.poses[40].estimate.as_ref().unwrap();
            (f64::from(estimate.systematic().row(0).norm()), estimate.own_covariance()[(0, 0)].sqrt())
        };
        let before = std_m(&tracked);
        poses_anew(PoseEstimator::new(&rig, &body), &mut tracked).unwrap();
        (tracked.estimator.as_ref().unwrap().bias_std_px(), [before, std_m(&tracked)])
    }

    /// What is found where there is none is what noise leaves of a mean over the frames.
    #[test]
    fn centres_without_systematic_errors_show_no_more_than_noise_leaves() {
        for draw in 0..20 {
            let (bias_px, _) = shown(0.0, draw);
            assert!(bias_px < 2.0 * STD_PX / f64::from(FRAMES).sqrt(), "draw {draw}: {bias_px} px");
        }
    }

    #[test]
    fn systematic_errors_of_centres_are_found_and_are_in_all_poses_alike() {
        for bias_px in [0.01, 0.03] {
            let mut parts: Vec<f64> = (0..20).map(|draw| shown(bias_px, draw).0 / bias_px).collect();
            parts.sort_by(f64::total_cmp);
            assert!((0.6..1.4).contains(&parts[10]), "of {bias_px} px: {parts:?}");
        }
        for draw in 0..5 {
            let (_, [before, after]) = shown(STD_PX, draw);
            assert!(after.0 > 2.0 * before.0, "draw {draw}: {before:?} then {after:?}");
            assert!(after.1 < 1.1 * before.1, "draw {draw}: {before:?} then {after:?}");
        }
    }

    /// What the encoder leaves open is in the poses' covariances. Output error, which solves for systematic errors, solved for
    /// this one too and found the poses' noise: paper-flight's parameters were ten standard deviations off.
    #[test]
    fn poses_from_reordered_frames_may_be_displaced_and_output_error_does_not_solve_for_it() {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        let [as_shown, reordered] = [false, true].map(|may_be_reordered| {
            let mut tracked = Tracked { may_be_reordered, ..tracked(&rig, &body, 0.0, 0) };
            poses_anew(PoseEstimator::new(&rig, &body), &mut tracked).unwrap();
            tracked
        });
        let (without, with) = (systematic_columns(&as_shown), systematic_columns(&reordered));
        assert!(!without.is_empty() && without.iter().all(|(_, columns)| columns.norm() > 0.0));
        assert_eq!(without, with);
        let variance = |tracked: &Tracked| {
            let motion = motion_of(tracked, None, &Vehicle::paper(), &NoProgress).unwrap();
            motion.samples.iter().map(|s| s.covariance.pose().trace()).sum::<f64>()
        };
        assert!(variance(&reordered) > variance(&as_shown), "the motion may be displaced too");
        for (k, by) in reordered.displacements.iter().enumerate() {
            let covariance = |t: &Tracked| t.poses[k].estimate.as_ref().unwrap().covariance();
            let more = covariance(&reordered) - covariance(&as_shown);
            let expected = by.map(f64::from);
            assert!(expected.norm() > 0.0);
            assert!((more - expected * expected.transpose()).norm() < 1e-3 * expected.norm_squared());
        }
    }

    /// The red ball, in the second camera, is ten times as noisy as it claims.
    #[test]
    fn a_ball_that_is_worse_than_it_claims_weighs_less() {
        let (rig, body) = (rig(), body_markers(&Vehicle::paper()));
        let mut tracked = tracked(&rig, &body, 0.0, 0);
        let mut sign = 0.2;
        let mut spoilt: Vec<_> = tracked.observations.iter().collect();
        for seen in spoilt.iter_mut().filter(|o| o.camera == 1 && o.marker == 0) {
            seen.pixel += Vector2::new(sign, -sign);
            sign = -sign;
        }
        tracked.observations = spoilt.iter().collect();
        let estimator = PoseEstimator::new(&rig, &body);
        estimate_all(&estimator, &mut tracked, |pose| pose);
        let claimed_px2 = spoilt[0].covariance_px2.trace();
        let residual_px = |t: &Tracked| {
            t.poses.iter().map(|p| p.estimate.as_ref().unwrap().residual_px.unwrap()).sum::<f64>()
        };
        let before_px = residual_px(&tracked);
        poses_anew(estimator, &mut tracked).unwrap();
        for seen in tracked.observations.iter() {
            let factor = seen.covariance_px2.trace() / claimed_px2;
            let spoilt = seen.camera == 1 && seen.marker == 0;
            assert!(
                if spoilt { (20.0..100.0).contains(&factor) } else { factor < 8.0 },
                "{seen:?}: {factor}"
            );
        }
        assert!(residual_px(&tracked) > before_px, "the others fit better, the spoilt ball worse");
    }

    #[test]
    fn a_body_that_is_not_as_in_its_file_is_refined() {
        let (rig, vehicle) = (rig(), Vehicle::paper());
        let mut built = body_markers(&vehicle);
        built[2].marker_in_body_m.x += 4e-3;
        let mut tracked = tracked(&rig, &built, 0.0, 0);
        let how = Refinement { markers_std_m: Some(2e-3), ..Refinement::default() };
        let refined = refine(&mut tracked, &rig, &vehicle, how).unwrap().expect("a refinement").refined;
        let length =
            |m: &[BodyMarker], a: usize, b: usize| (m[a].marker_in_body_m - m[b].marker_in_body_m).norm();
        for (a, b) in [(0, 1), (0, 2), (1, 2), (2, 3)] {
            let error = length(&refined.markers, a, b) - length(&built, a, b);
            assert!(error.abs() < 3e-4, "between {a} and {b}: {error} m");
        }
        assert!(tracked.poses.iter().all(|p| p.estimate.is_ok()));
        let wrong = Refinement { markers_std_m: Some(-1.0), ..how };
        let refused = refine(&mut tracked, &rig, &vehicle, wrong).unwrap_err().to_string();
        assert!(refused.contains("a ruler is good to"), "{refused}");
    }

    #[test]
    fn cameras_that_nothing_speaks_against_are_refined_on_request_alone() {
        let (rig, vehicle) = (rig(), Vehicle::paper());
        let as_tracked = tracked(&rig, &body_markers(&vehicle), 0.0, 0);
        for (asked, refined) in [(None, false), (Some(false), false), (Some(true), true)] {
            let mut tracked = as_tracked.clone();
            let how = Refinement { rig: asked, ..Refinement::default() };
            let body = refine(&mut tracked, &rig, &vehicle, how).unwrap();
            assert_eq!(body.is_some(), refined, "{asked:?}");
            assert_eq!(tracked.poses == as_tracked.poses, !refined, "{asked:?}");
        }
    }
}
