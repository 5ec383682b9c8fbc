//! Systematic errors of poses.

use crate::output_error::measure::{Measurements, StateMeasurement};
use crate::output_error::row::pose_of;
use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion};
use mavsight_pose::{PoseEstimate, PoseSample};
use nalgebra::{Matrix6xX, Vector6};

fn level() -> [f64; 13] {
    let mut y = [0.0; 13];
    y[3] = 1.0;
    y
}

fn columns() -> Matrix6xX<f32> {
    Matrix6xX::from_fn(7, |i, j| (1e-3 * (1.0 + i as f64 + 7.0 * j as f64).sin()) as f32)
}

/// Two poses at a state, both displaced along a direction of the systematic errors.
fn poses(along: usize, by: f64) -> Vec<PoseSample> {
    let mut covariance = Matrix6::identity() * 4e-6;
    (covariance[(0, 4)], covariance[(4, 0)]) = (1e-6, 1e-6);
    let moved: Vector6<f64> = columns().column(along).map(f64::from) * by;
    let at = pose_of(&level());
    let turn = UnitQuaternion::from_scaled_axis(moved.fixed_rows::<3>(3).into_owned());
    let place = at.translation.vector + moved.fixed_rows::<3>(0);
    let pose = Isometry3::from_parts(place.into(), at.rotation * turn);
    let estimate = PoseEstimate::new(pose, &covariance).with_systematic(&columns());
    let sample = |t_ns| PoseSample { t_ns, estimate: Ok(estimate.clone()) };
    vec![sample(0), sample(33_000_000)]
}

fn measured(poses: &[PoseSample]) -> Measurements {
    Measurements::States(StateMeasurement::of_poses(poses.iter()))
}

fn residuals(poses: &[PoseSample]) -> Vec<f64> {
    measured(poses).rows(1, &level()).expect("rows").iter().map(|row| row.residual).collect()
}

#[test]
fn each_direction_moves_the_rows_as_a_pose_that_is_displaced_along_it() {
    const STEP: f64 = 1e-3;
    let measured = measured(&poses(0, 0.0));
    assert_eq!(measured.nuisances(), 7);
    for along in 0..7 {
        let (ahead, behind) = (residuals(&poses(along, STEP)), residuals(&poses(along, -STEP)));
        for (k, row) in measured.rows(1, &level()).expect("rows").iter().enumerate() {
            let want = (ahead[k] - behind[k]) / (2.0 * STEP);
            let got = row.directions[along];
            assert!((got - want).abs() < 1e-5, "row {k} along {along}: {got} for {want}");
        }
    }
}

#[test]
fn poses_without_common_directions_have_random_errors_alone() {
    let condensed: Vec<PoseSample> = poses(0, 0.0)
        .into_iter()
        .map(|p| PoseSample { estimate: p.estimate.map(PoseEstimate::condensed), ..p })
        .collect();
    let measured = measured(&condensed);
    assert_eq!(measured.nuisances(), 0);
    assert!(measured.rows(1, &level()).expect("rows").iter().all(|row| row.directions.is_empty()));
    let Measurements::States(states) = measured else { panic!("states") };
    let (_, covariance) = states[0].pose.expect("a pose");
    let own = condensed[0].estimate.as_ref().expect("a pose").own_covariance();
    assert!((covariance - own).trace() > 1e-6);
}
