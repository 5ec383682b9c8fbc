//! What was measured: states with their covariance, or images of markers, and sensors beside them.

use super::image::ImageMeasurements;
use super::model::{Equations, FlightModel};
use super::propagate::SEEN;
use super::row::{Row, pose_of, whitener};
use super::sensor::{Sample, SensedMeasurements};
use crate::IdentifyError;
use mavsight_flight::SensorSeries;
use mavsight_geometry::attitude::right_jacobian;
use mavsight_geometry::{Isometry3, Matrix3, Matrix6};
use mavsight_model::Model;
use mavsight_pose::{PoseEstimate, PoseSample};
use nalgebra::Vector6;
use std::ops::Range;

/// The pose that was measured at one instant, or none.
#[derive(Debug, Clone, PartialEq)]
pub struct StateMeasurement {
    /// Middle of the exposure.
    pub t_ns: i64,
    /// Pose, and the covariance of position (world axes, m²) and of a small turn about body axes (rad²).
    pub pose: Option<(Isometry3<f64>, Matrix6<f64>)>,
    /// Effect of systematic errors on the pose, in addition to that covariance: six rows of one standard
    /// deviation along each independent direction, whitened by the covariance; empty: none.
    systematic: Box<[f64]>,
    /// Of the motion before it nothing is known but by itself ([`Measurements::beginning_anew`]).
    begins_anew: bool,
}

impl StateMeasurement {
    /// A pose with its covariance, all of it new at this instant.
    pub fn of_pose(t_ns: i64, pose: Isometry3<f64>, covariance: Matrix6<f64>) -> Self {
        Self { t_ns, pose: Some((pose, covariance)), systematic: Box::default(), begins_anew: false }
    }

    /// The pose of a sample, all of its covariance as new; nothing where it holds none.
    pub fn from_pose(sample: &PoseSample) -> Self {
        let pose = sample.estimate.as_ref().ok().map(|e| (e.world_from_body, e.covariance()));
        Self { t_ns: sample.t_ns, pose, systematic: Box::default(), begins_anew: false }
    }

    /// Middle of the exposure, s.
    pub fn t_s(&self) -> f64 {
        self.t_ns as f64 * 1e-9
    }

    fn bad(&self) -> IdentifyError {
        IdentifyError::BadMeasurement { t_s: self.t_s(), what: "pose" }
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
}

/// The measurements of a flight.
#[derive(Debug, Clone)]
pub enum Measurements {
    /// Poses at increasing times, each with its covariance.
    States(Vec<StateMeasurement>),
    /// Markers in images.
    Image(ImageMeasurements),
    /// Measurements of which some instants are not fitted; the motion there is only where segments begin to
    /// be fitted from, as long gaps without would keep a fit from converging.
    Part(Box<Measurements>, LeftOut),
    /// One of those with sensors ([`Measurements::with_sensors`]).
    Sensed(Box<SensedMeasurements>),
}

/// Of each instant, whether it is not fitted.
#[derive(Debug, Clone)]
pub struct LeftOut(pub(crate) Vec<bool>);

const POSE_CHANNELS: [&str; SEEN] = ["x", "y", "z", "turn_x", "turn_y", "turn_z"];

impl Measurements {
    /// These with samples of the model's sensors by the same clock, in the place of any before. Samples before
    /// the first instant of these and after the last are left out, and those that are not finite.
    ///
    /// # Errors
    /// A column of a sensor of the model that is not there.
    pub fn with_sensors(self, model: &Model, sensors: &SensorSeries) -> Result<Self, IdentifyError> {
        let seen = match self {
            Self::Sensed(all) => all.seen,
            seen => seen,
        };
        Ok(Self::Sensed(Box::new(SensedMeasurements::new(seen, model, sensors)?)))
    }

    /// These with the motion beginning anew at the first pose from each of some times on: what was seen behind them
    /// contradicts what was seen before, or is of another flight.
    #[must_use]
    pub fn beginning_anew(mut self, from_ns: &[i64]) -> Self {
        match &mut self {
            Self::States(all) => {
                for from_ns in from_ns {
                    let first = all.iter_mut().find(|s| s.t_ns >= *from_ns && s.pose.is_some());
                    first.into_iter().for_each(|s| s.begins_anew = true);
                }
                self
            }
            Self::Image(all) => {
                all.begin_anew(from_ns);
                self
            }
            Self::Part(all, left_out) => {
                let all = std::mem::replace(all.as_mut(), Self::States(Vec::new()));
                Self::Part(Box::new(all.beginning_anew(from_ns)), left_out.clone())
            }
            Self::Sensed(all) => {
                let seen = std::mem::replace(&mut all.seen, Self::States(Vec::new()));
                all.seen = seen.beginning_anew(from_ns);
                self
            }
        }
    }

    /// Whether the motion begins anew at an instant.
    pub(crate) fn begins_anew(&self, instant: usize) -> bool {
        match self {
            Self::States(all) => all[instant].begins_anew,
            Self::Image(all) => all.begins_anew(instant),
            Self::Part(all, _) => all.begins_anew(instant),
            Self::Sensed(all) => all.seen_at(instant).is_some_and(|own| all.seen.begins_anew(own)),
        }
    }

    /// Whether no pose or image is fitted, and sensors alone are.
    pub(crate) fn are_of_sensors_alone(&self) -> bool {
        match self {
            Self::Part(_, LeftOut(left_out)) => left_out.iter().all(|is_out| *is_out),
            Self::Sensed(all) => all.seen.are_of_sensors_alone(),
            Self::States(_) | Self::Image(_) => false,
        }
    }

    /// Whether there are sensors.
    pub(crate) fn have_sensors(&self) -> bool {
        matches!(self, Self::Sensed(_))
    }

    /// The equations of a model, with its sensors where there are some.
    pub(crate) fn equations(&self, model: &FlightModel) -> Equations {
        if self.have_sensors() { Equations::with_sensors(model) } else { Equations::new(model) }
    }

    /// What the sensors show at an instant.
    pub(crate) fn sample(&self, instant: usize) -> Option<Sample<'_>> {
        match self {
            Self::Sensed(all) => all.sample(instant),
            _ => None,
        }
    }

    /// Channels that are sampled together: those of the poses or images, and of the sensors.
    pub(crate) fn series(&self) -> Vec<Range<usize>> {
        match self {
            Self::Sensed(all) => all.series(),
            _ => std::iter::once(0..self.channels().len()).collect(),
        }
    }

    pub(crate) fn times_s(&self) -> Vec<f64> {
        match self {
            Self::States(s) => s.iter().map(StateMeasurement::t_s).collect(),
            Self::Image(i) => i.times_s(),
            Self::Part(all, _) => all.times_s(),
            Self::Sensed(all) => all.times_s(),
        }
    }

    pub(crate) fn channels(&self) -> Vec<String> {
        match self {
            Self::States(_) => POSE_CHANNELS.map(str::to_owned).to_vec(),
            Self::Image(i) => i.channels(),
            Self::Part(all, _) => all.channels(),
            Self::Sensed(all) => all.channels(),
        }
    }

    pub(crate) fn nuisances(&self) -> usize {
        match self {
            Self::States(s) => s.iter().map(|m| m.systematic.len() / SEEN).max().unwrap_or(0),
            Self::Image(i) => i.nuisances(),
            Self::Part(all, _) => all.nuisances(),
            Self::Sensed(all) => all.seen.nuisances(),
        }
    }

    /// Known poses at their instants, for a start.
    pub(crate) fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        match self {
            Self::States(s) => {
                s.iter().enumerate().filter_map(|(i, m)| m.pose.map(|(pose, _)| (i, pose))).collect()
            }
            Self::Image(i) => i.poses(),
            Self::Part(all, _) => all.poses(),
            Self::Sensed(all) => all.poses(),
        }
    }

    /// These without sensors.
    pub(crate) fn seen(&self) -> &Self {
        match self {
            Self::Sensed(all) => &all.seen,
            seen => seen,
        }
    }

    /// The poses or images of some of their instants.
    pub(crate) fn at(&self, instants: &[usize]) -> Self {
        match self {
            Self::States(s) => Self::States(instants.iter().map(|i| s[*i].clone()).collect()),
            Self::Image(i) => Self::Image(i.at(instants)),
            Self::Part(all, LeftOut(left_out)) => {
                let own = LeftOut(instants.iter().map(|i| left_out[*i]).collect());
                Self::Part(Box::new(all.at(instants)), own)
            }
            Self::Sensed(all) => all.seen.at(instants),
        }
    }

    /// What poses or images say at an instant.
    pub(crate) fn rows(&self, instant: usize, y: &[f64]) -> Result<Vec<Row<'_>>, IdentifyError> {
        match self {
            Self::States(s) => pose_rows(s, instant, y),
            Self::Image(i) => i.rows(instant, y),
            Self::Part(_, LeftOut(left_out)) if left_out[instant] => Ok(Vec::new()),
            Self::Part(all, _) => all.rows(instant, y),
            Self::Sensed(all) => all.seen_at(instant).map_or(Ok(Vec::new()), |own| all.seen.rows(own, y)),
        }
    }

    /// Refuses what cannot be fitted.
    pub(crate) fn check(&self) -> Result<(), IdentifyError> {
        let times = self.seen().times_s();
        for pair in times.windows(2) {
            if pair[1] <= pair[0] {
                return Err(IdentifyError::MeasurementTimes { t_s: pair[1], before_s: pair[0] });
            }
        }
        let samples = match self {
            Self::States(samples) => samples,
            Self::Image(_) => return Ok(()),
            Self::Part(all, _) => return all.check(),
            Self::Sensed(all) => return all.seen.check(),
        };
        for s in samples {
            if let Some((pose, covariance)) = &s.pose {
                let is_finite = pose.to_homogeneous().iter().all(|v| v.is_finite());
                whitener(covariance).filter(|_| is_finite).ok_or(s.bad())?;
            }
        }
        Ok(())
    }
}

fn pose_rows<'a>(
    all: &'a [StateMeasurement],
    instant: usize,
    y: &[f64],
) -> Result<Vec<Row<'a>>, IdentifyError> {
    let s = &all[instant];
    let Some((measured, covariance)) = &s.pose else { return Ok(Vec::new()) };
    let l = whitener(covariance).ok_or(s.bad())?;
    let at = pose_of(y);
    let turn = (at.rotation.inverse() * measured.rotation).scaled_axis();
    let offset = measured.translation.vector - at.translation.vector;
    let error = l * Vector6::new(offset.x, offset.y, offset.z, turn.x, turn.y, turn.z);
    // log(exp(-δ) exp(e)) = e - J_l(e)⁻¹ δ, and J_l(e) = J_r(-e).
    let by_turn = right_jacobian(&-turn).try_inverse().unwrap_or_else(Matrix3::identity);
    let mut jacobian = Matrix6::identity();
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&by_turn);
    let by = (l * jacobian).transpose();
    let directions = s.systematic.len() / SEEN;
    let row = |k: usize| Row {
        residual: error[k],
        by_pose: by.column(k).into_owned(),
        by_rest: Vec::new(),
        by_parameter: Vec::new(),
        instant,
        channel: k,
        directions: &s.systematic[k * directions..(k + 1) * directions],
        pixel: [0.0; 2],
    };
    Ok((0..SEEN).map(row).collect())
}
