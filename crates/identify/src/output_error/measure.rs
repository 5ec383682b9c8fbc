//! What was measured: states with their covariance, or images of markers.

use super::image::ImageMeasurements;
use super::propagate::SEEN;
use super::row::{Row, pose_of, whitener};
use crate::IdentifyError;
use mavsight_flight::StateVector;
use mavsight_geometry::attitude::right_jacobian;
use mavsight_geometry::{Isometry3, Matrix3, Matrix6, Vector3};
use mavsight_pose::{MotionSample, PoseEstimate, PoseSample};
use nalgebra::{SMatrix, SVector};

/// What was measured of the motion at one instant. A part that was not measured is `None`.
#[derive(Debug, Clone, PartialEq)]
pub struct StateMeasurement {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// Pose, and the covariance of position (world axes, m²) and of a small turn about body axes (rad²).
    pub pose: Option<(Isometry3<f64>, Matrix6<f64>)>,
    /// Velocity in body axes, m/s, and its covariance.
    pub velocity: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// p, q, r in rad/s, and their covariance.
    pub rates: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Effect of systematic errors on the pose, in addition to that covariance: a column for each independent
    /// direction, one standard deviation along it, the same directions at all instants. Six rows of as many
    /// numbers as there are directions, whitened by the covariance; empty: none.
    systematic: Box<[f64]>,
}

impl StateMeasurement {
    /// A pose with its covariance, all of it new at this instant.
    pub fn of_pose(t_ns: i64, pose: Isometry3<f64>, covariance: Matrix6<f64>) -> Self {
        Self { t_ns, pose: Some((pose, covariance)), velocity: None, rates: None, systematic: Box::default() }
    }

    /// The pose of a sample, all of its covariance as new; nothing where it holds none.
    pub fn from_pose(sample: &PoseSample) -> Self {
        let nothing =
            Self { t_ns: sample.t_ns, pose: None, velocity: None, rates: None, systematic: Box::default() };
        let pose = sample.estimate.as_ref().ok().map(|e| (e.world_from_body, e.covariance()));
        Self { pose, ..nothing }
    }

    /// The poses of a flight; nothing where a sample holds none. Their systematic errors count as such where
    /// all of them have the same directions ([`mavsight_pose::PoseEstimate::systematic`]), else as random
    /// errors of each pose.
    pub fn of_poses<'a>(samples: impl Iterator<Item = &'a PoseSample> + Clone) -> Vec<Self> {
        let estimates = || samples.clone().filter_map(|s| s.estimate.as_ref().ok());
        let directions = estimates().next().map_or(0, PoseEstimate::systematic_columns);
        let is_shared = estimates().all(|e| e.systematic_columns() == directions && !e.is_condensed());
        let of = |sample: &PoseSample| {
            let Some(e) = sample.estimate.as_ref().ok().filter(|_| is_shared) else {
                return Self::from_pose(sample);
            };
            let own = e.own_covariance();
            // What has no inverse is refused where it is checked.
            let whitened = whitener(&own).map(|l| (l * e.systematic().map(f64::from)).transpose());
            let systematic = whitened.map_or_else(Box::default, |w| w.as_slice().into());
            Self { systematic, ..Self::of_pose(sample.t_ns, e.world_from_body, own) }
        };
        samples.clone().map(of).collect()
    }

    /// Velocity and rates of a smoothed sample, and its pose.
    ///
    /// A smoother's errors are correlated over its time constant; the corrected standard deviations of the
    /// fit allow for that, its Cramér-Rao bounds do not.
    pub fn from_motion(sample: &MotionSample) -> Self {
        let c = &sample.covariance;
        Self {
            t_ns: sample.t_ns,
            pose: Some((sample.world_from_body, c.pose())),
            velocity: Some((sample.velocity_in_body_m_s, c.quantity(2))),
            rates: Some((sample.rates_rad_s, c.quantity(3))),
            systematic: Box::default(),
        }
    }
}

/// The measurements of a flight.
#[derive(Debug, Clone)]
pub enum Measurements {
    /// Poses, velocities or rates at increasing times, each with its covariance.
    States(Vec<StateMeasurement>),
    /// Markers in images.
    Image(ImageMeasurements),
}

/// Coordinates of a pose.
const POSE: usize = 6;

const STATE_CHANNELS: [&str; 12] =
    ["x", "y", "z", "turn_x", "turn_y", "turn_z", "u", "v", "w", "p", "q", "r"];

impl Measurements {
    pub(crate) fn times_s(&self) -> Vec<f64> {
        match self {
            Self::States(s) => s.iter().map(|m| m.t_ns as f64 * 1e-9).collect(),
            Self::Image(i) => i.times_s(),
        }
    }

    pub(crate) fn channels(&self) -> Vec<String> {
        match self {
            Self::States(_) => STATE_CHANNELS.map(str::to_owned).to_vec(),
            Self::Image(i) => i.channels(),
        }
    }

    pub(crate) fn nuisances(&self) -> usize {
        match self {
            Self::States(s) => s.iter().map(|m| m.systematic.len() / POSE).max().unwrap_or(0),
            Self::Image(i) => i.nuisances(),
        }
    }

    /// Whitened directions of a row, one value a nuisance.
    pub(crate) fn nuisance_row(&self, row: Option<usize>) -> &[f64] {
        match (self, row) {
            (_, None) => &[],
            (Self::States(s), Some(row)) => {
                let all = &s[row / POSE].systematic;
                let directions = all.len() / POSE;
                &all[row % POSE * directions..][..directions]
            }
            (Self::Image(i), Some(row)) => i.nuisance_row(row),
        }
    }

    /// Known poses at their instants, for a start.
    pub(crate) fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        match self {
            Self::States(s) => {
                s.iter().enumerate().filter_map(|(i, m)| m.pose.map(|(pose, _)| (i, pose))).collect()
            }
            Self::Image(i) => i.poses(),
        }
    }

    /// Rows of one instant at a state, into a cleared `out`.
    pub(crate) fn rows(
        &self,
        instant: usize,
        y: &StateVector,
        out: &mut Vec<Row>,
    ) -> Result<(), IdentifyError> {
        out.clear();
        match self {
            Self::States(s) => state_rows(&s[instant], POSE * instant, y, out),
            Self::Image(i) => i.rows(instant, y, out),
        }
    }

    /// Refuses what cannot be fitted.
    pub(crate) fn check(&self) -> Result<(), IdentifyError> {
        let times = self.times_s();
        for pair in times.windows(2) {
            if pair[1] <= pair[0] {
                return Err(IdentifyError::MeasurementTimes { t_s: pair[1], before_s: pair[0] });
            }
        }
        let Self::States(samples) = self else { return Ok(()) };
        for s in samples {
            let t_s = s.t_ns as f64 * 1e-9;
            let bad = |what| IdentifyError::BadMeasurement { t_s, what };
            if let Some((pose, covariance)) = &s.pose {
                let finite =
                    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|v| v.is_finite());
                if !finite || whitener(covariance).is_none() {
                    return Err(bad("pose"));
                }
            }
            for (what, part) in [("velocity", &s.velocity), ("rates", &s.rates)] {
                if let Some((value, covariance)) = part
                    && (!value.iter().all(|v| v.is_finite()) || whitener(covariance).is_none())
                {
                    return Err(bad(what));
                }
            }
        }
        Ok(())
    }
}

fn state_rows(
    s: &StateMeasurement,
    first_nuisance: usize,
    y: &StateVector,
    out: &mut Vec<Row>,
) -> Result<(), IdentifyError> {
    let t_s = s.t_ns as f64 * 1e-9;
    let bad = |what| IdentifyError::BadMeasurement { t_s, what };
    if let Some((measured, covariance)) = &s.pose {
        let l = whitener(covariance).ok_or(bad("pose"))?;
        let at = pose_of(y);
        let turn = (at.rotation.inverse() * measured.rotation).scaled_axis();
        let offset = measured.translation.vector - at.translation.vector;
        let mut error = SVector::<f64, 6>::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&offset);
        error.fixed_rows_mut::<3>(3).copy_from(&turn);
        // log(exp(-δ) exp(e)) = e - J_l(e)⁻¹ δ, and J_l(e) = J_r(-e).
        let by_turn = right_jacobian(&-turn).try_inverse().unwrap_or_else(Matrix3::identity);
        let mut jacobian = Matrix6::identity();
        jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&by_turn);
        push(&(l * error), &(l * jacobian), 0, out);
        if !s.systematic.is_empty() {
            out.iter_mut().enumerate().for_each(|(k, row)| row.nuisance = Some(first_nuisance + k));
        }
    }
    for (what, part, first) in [("velocity", &s.velocity, 6), ("rates", &s.rates, 9)] {
        if let Some((measured, covariance)) = part {
            let l = whitener(covariance).ok_or(bad(what))?;
            let at = Vector3::new(y[first + 1], y[first + 2], y[first + 3]);
            push(&(l * (measured - at)), &l, first, out);
        }
    }
    Ok(())
}

fn push<const N: usize>(
    residual: &SVector<f64, N>,
    jacobian: &SMatrix<f64, N, N>,
    first: usize,
    out: &mut Vec<Row>,
) {
    for i in 0..N {
        let mut row = Row {
            residual: residual[i],
            jacobian: [0.0; SEEN],
            channel: first + i,
            nuisance: None,
            pixel: [0.0; 2],
        };
        for j in 0..N {
            row.jacobian[first + j] = jacobian[(i, j)];
        }
        out.push(row);
    }
}
