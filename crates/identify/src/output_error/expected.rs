//! The expected result of an output-error fit of a planned flight.

use super::condense::Bound;
use super::determined::{refuse_undetermined, typical_sizes};
use super::fitter::{Begin, Fitter, Recorded, TIGHTNESS};
use super::measure::{Measurements, StateMeasurement};
use super::model::{FlightModel, ModelParameter};
use super::options::OutputErrorOptions;
use super::row::whitener;
use super::start::segment_starts;
use crate::IdentifyError;
use crate::inverse::log_determinant;
use mavsight_flight::InputSeries;
use mavsight_geometry::Isometry3;
use mavsight_pose::NORMAL_95;
use nalgebra::{DMatrix, DVector, Matrix6xX};

/// What is expected of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedParameter {
    /// The parameter.
    pub parameter: ModelParameter,
    /// Name of the parameter.
    pub name: String,
    /// Value in the planned flight.
    pub value: f64,
    /// Standard deviation that an estimate will have: the Cramér-Rao bound.
    pub std: f64,
    /// Whether half the 95 % interval will be less than the parameter's typical size; see
    /// [`super::FittedParameter::identifiable`].
    pub identifiable: bool,
}

/// The fit of a planned flight, linear about the truth.
#[derive(Debug, Clone)]
pub struct ExpectedFit {
    /// Free parameters in the order of the model.
    pub parameters: Vec<ExpectedParameter>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// The combination that changes nothing that is measured, where there is one.
    pub undetermined: Option<String>,
    states: Vec<Vec<f64>>,
    measured: Vec<StateMeasurement>,
    /// What each parameter's size is, with which half its interval is compared.
    typical: Vec<f64>,
    /// Parameters by rows: what a unit of each row's noise does to them.
    influence: DMatrix<f64>,
}

/// The covariance with which [`super::output_error`] will estimate the free parameters of a model from
/// measurements that are as good as they say, about the motion with the model's own values; `states` are
/// those of the motion at the instants of the measurements, each of which holds a pose.
///
/// Uses the integration, sensitivities, constraint between segments and unknown start of the fit: the
/// inverse of the information, which is Cramér and Rao's bound and, for an efficient estimator, the
/// covariance (Maine & Iliff 1985).
///
/// # Errors
/// [`IdentifyError::PlannedStates`]; nothing free; inputs that do not cover the flight; a flight without
/// information.
pub fn expected_fit(
    model: &FlightModel,
    inputs: &InputSeries,
    measured: Vec<StateMeasurement>,
    states: &[Vec<f64>],
    options: &OutputErrorOptions,
) -> Result<ExpectedFit, IdentifyError> {
    if model.free().is_empty() {
        return Err(IdentifyError::NothingFree);
    }
    if states.len() != measured.len() || states.len() < 2 {
        return Err(IdentifyError::PlannedStates { states: states.len(), instants: measured.len() });
    }
    if let Some(m) = measured.iter().find(|m| m.pose.is_none()) {
        return Err(IdentifyError::BadMeasurement { t_s: m.t_ns as f64 * 1e-9, what: "planned pose" });
    }
    let measurements = Measurements::States(measured.clone());
    measurements.check()?;
    let starts = segment_starts(&measurements.times_s(), options.segment_s, |_| false);
    let nodes = starts.into_iter().map(|k| (k, states[k].clone())).collect();
    let begin = Begin { model: model.clone(), nodes };
    let inputs = &model.inputs_of(inputs)?;
    let fitter = Fitter::new(model, begin, Recorded { inputs, measurements: &measurements }, options)?;
    let linear = fitter.linearised(TIGHTNESS[3])?;
    let undetermined = refuse_undetermined(&fitter, &linear).err().map(|e| e.to_string());
    let Bound { covariance, influence, .. } = linear.bound(model.free().len())?;
    let typical = typical_sizes(&fitter);
    let expected = |(k, parameter): (usize, &ModelParameter)| {
        let std = covariance[(k, k)].sqrt();
        ExpectedParameter {
            parameter: *parameter,
            name: model.name(*parameter).to_owned(),
            value: model.value(*parameter),
            std,
            identifiable: undetermined.is_none() && NORMAL_95 * std < typical[k],
        }
    };
    let parameters = model.free().iter().enumerate().map(expected).collect();
    let states = states.to_vec();
    Ok(ExpectedFit { parameters, covariance, undetermined, states, measured, typical, influence })
}

impl ExpectedFit {
    /// Adds systematic errors of the poses: for each instant one column for each independent direction, a
    /// standard deviation along it in position (world, m) and turn (body, rad), as
    /// [`mavsight_pose::PoseEstimate::systematic`] has them. The fit does not know of them; they move its
    /// estimates by the influence of every row.
    ///
    /// # Errors
    /// [`IdentifyError::PlannedSystematic`] for another number of instants, or of directions at some of them.
    pub fn with_systematic(mut self, systematic: &[Matrix6xX<f32>]) -> Result<Self, IdentifyError> {
        let instants = self.states.len();
        let directions = systematic.first().map_or(0, Matrix6xX::ncols);
        if systematic.len() != instants || systematic.iter().any(|s| s.ncols() != directions) {
            let most = systematic.iter().map(Matrix6xX::ncols).max().unwrap_or_default();
            return Err(IdentifyError::PlannedSystematic {
                found: systematic.len(),
                instants,
                directions,
                most,
            });
        }
        let mut moved = DMatrix::zeros(self.parameters.len(), directions);
        for (k, (m, s)) in self.measured.iter().zip(systematic).enumerate() {
            let t_s = m.t_ns as f64 * 1e-9;
            let whitener = m.pose.as_ref().and_then(|(_, covariance)| whitener(covariance));
            let whitener = whitener.ok_or(IdentifyError::BadMeasurement { t_s, what: "pose" })?;
            moved += self.influence.columns(6 * k, 6) * (whitener * s.map(f64::from));
        }
        self.covariance += &moved * moved.transpose();
        for (k, p) in self.parameters.iter_mut().enumerate() {
            p.std = self.covariance[(k, k)].sqrt();
            p.identifiable &= NORMAL_95 * p.std < self.typical[k];
        }
        Ok(self)
    }

    /// The parameters that poses of the planned flight give, to first order about the truth: one Gauss-Newton
    /// step of the fit, with the weights of the plan. One pose an instant.
    ///
    /// # Errors
    /// [`IdentifyError::PlannedStates`] for another number of poses; a pose that is not finite.
    pub fn first_order(&self, poses: &[Isometry3<f64>]) -> Result<DVector<f64>, IdentifyError> {
        let instants = self.states.len();
        if poses.len() != instants {
            return Err(IdentifyError::PlannedStates { states: poses.len(), instants });
        }
        let mut measured = self.measured.clone();
        for (m, pose) in measured.iter_mut().zip(poses) {
            m.pose = m.pose.map(|(_, covariance)| (*pose, covariance));
        }
        let measured = Measurements::States(measured);
        let mut residual = Vec::with_capacity(self.influence.ncols());
        for (instant, y) in self.states.iter().enumerate() {
            residual.extend(measured.rows(instant, y)?.iter().map(|r| r.residual));
        }
        let mut out = &self.influence * DVector::from_vec(residual);
        out.iter_mut().zip(&self.parameters).for_each(|(value, p)| *value += p.value);
        let bad = IdentifyError::BadMeasurement { t_s: self.measured[0].t_ns as f64 * 1e-9, what: "pose" };
        Some(out).filter(|o| o.iter().all(|v| v.is_finite())).ok_or(bad)
    }

    /// Log of the determinant of the covariance of some parameters, by name: the generalised variance that a
    /// D-optimal plan makes least. `None` for names that are not free or a covariance that is not positive.
    pub fn log_generalised_variance(&self, names: &[&str]) -> Option<f64> {
        let place = |name: &&str| self.parameters.iter().position(|p| p.name == *name);
        let at = names.iter().map(place).collect::<Option<Vec<usize>>>()?;
        log_determinant(&self.covariance.select_rows(&at).select_columns(&at))
    }
}
