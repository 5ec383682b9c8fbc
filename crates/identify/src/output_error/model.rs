//! The model of a fit: which parameters are free, and where they start.

use crate::{IdentifyError, independent_columns};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_model::{BODY_PARAMETERS, Dynamics, Freedom, Model, Unit};
use nalgebra::DMatrix;
use std::sync::Arc;

/// A number that a fit may free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ModelParameter {
    /// A parameter of the flight model, by its place.
    Parameter(usize),
    /// How late the inputs' clock is, s: an input recorded at t acts at t + lag on the clock of the
    /// measurements.
    InputLag,
}

const LAG: &str = "input_lag_s";

/// A flight model with the values that a fit starts from and the list of those that it may change.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightModel {
    model: Arc<Model>,
    /// One a parameter of the model.
    values: Vec<f64>,
    pub(crate) input_lag_s: f64,
    free: Vec<ModelParameter>,
}

impl FlightModel {
    /// The flight model of a vehicle, which starts from the values in its files. Free are the parameters that
    /// the model's file frees for these inputs ([`Freedom`]), but for those that `[outputs]` alone contain.
    ///
    /// # Errors
    /// A vehicle that is not valid, inputs without a column of the model.
    pub fn new(vehicle: &Vehicle, inputs: &InputSeries) -> Result<Self, IdentifyError> {
        Self::build(vehicle, inputs, |model, k| !model.is_of_outputs_alone(k))
    }

    /// The flight model of a vehicle as by [`FlightModel::new`], but free are also the parameters that `[outputs]`
    /// alone contain, such as a sensor's bias: for measurements with sensors ([`super::Measurements::with_sensors`]).
    ///
    /// # Errors
    /// Those of [`FlightModel::new`].
    pub fn with_outputs(vehicle: &Vehicle, inputs: &InputSeries) -> Result<Self, IdentifyError> {
        Self::build(vehicle, inputs, |_, _| true)
    }

    fn build(
        vehicle: &Vehicle,
        inputs: &InputSeries,
        is_seen: impl Fn(&Model, usize) -> bool,
    ) -> Result<Self, IdentifyError> {
        vehicle.validate()?;
        let inputs = inputs.select(&vehicle.input_columns())?;
        let model = vehicle.model_for_fits();
        let is_free = |freedom: &Freedom| match freedom {
            Freedom::Free => true,
            Freedom::Fixed => false,
            Freedom::WhereMoved(own) => are_moved(&inputs, own),
            Freedom::UnlessMoved(own) => !are_moved(&inputs, own),
        };
        let free = (0..model.parameters.len())
            .filter(|k| is_free(&model.parameters[*k].freedom) && is_seen(&model, *k));
        let free = free.map(ModelParameter::Parameter).collect();
        Ok(Self { values: vehicle.values(), model, input_lag_s: 0.0, free })
    }

    /// Replaces the free parameters by those of the given names; all others keep their values.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownParameter`]; repeated names count once.
    pub fn with_free(mut self, names: &[&str]) -> Result<Self, IdentifyError> {
        self.free.clear();
        names.iter().try_for_each(|name| self.parameter(name).map(|parameter| self.make_free(parameter)))?;
        Ok(self)
    }

    /// Without the free parameters that `[outputs]` alone contain, and these: for what sensors take no part in.
    pub(super) fn without_outputs(mut self) -> (Self, Vec<ModelParameter>) {
        let is_of_outputs = |parameter: &ModelParameter| match parameter {
            ModelParameter::Parameter(k) => self.model.is_of_outputs_alone(*k),
            ModelParameter::InputLag => false,
        };
        let (of_outputs, kept) = std::mem::take(&mut self.free).into_iter().partition(is_of_outputs);
        self.free = kept;
        (self, of_outputs)
    }

    pub(super) fn make_free(&mut self, parameter: ModelParameter) {
        if !self.free.contains(&parameter) {
            self.free.push(parameter);
        }
    }

    /// Sets the value that a fit starts from, or holds where the parameter is fixed.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownParameter`], [`IdentifyError::BadParameter`] for a number that is not finite
    /// or outside the bounds of the model's file.
    pub fn with_value(mut self, name: &str, value: f64) -> Result<Self, IdentifyError> {
        let parameter = self.parameter(name)?;
        self.set(parameter, value);
        if !self.is_within_bounds(parameter) {
            let must = "be a finite number within the bounds of the model's file";
            return Err(IdentifyError::BadParameter { name: name.to_owned(), value, must });
        }
        Ok(self)
    }

    /// The parameter of a name or label.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownParameter`], with the nearest.
    pub fn parameter(&self, name: &str) -> Result<ModelParameter, IdentifyError> {
        if name == LAG {
            return Ok(ModelParameter::InputLag);
        }
        self.model.parameter(name).map(ModelParameter::Parameter).ok_or_else(|| {
            let labels = || self.model.parameters.iter().map(|p| p.label.as_str()).chain([LAG]);
            let near = self.model.near_parameters(name);
            let known = if near.is_empty() {
                labels().collect::<Vec<_>>()
            } else {
                near.iter().map(String::as_str).collect()
            };
            IdentifyError::UnknownParameter { name: name.to_owned(), known: known.join(", ") }
        })
    }

    /// The name of a parameter in tables.
    pub fn name(&self, parameter: ModelParameter) -> &str {
        match parameter {
            ModelParameter::Parameter(k) => &self.model.parameters[k].label,
            ModelParameter::InputLag => LAG,
        }
    }

    /// A share of gravity, m/s², and about each axis of the body the angular acceleration that its force makes at three
    /// radii of gyration, rad/s².
    pub(crate) fn accelerations(&self, share: f64) -> Option<(f64, [f64; 3])> {
        let [mass_kg, i_xx, i_yy, i_zz, .., gravity_m_s2, _] = self.values[..BODY_PARAMETERS.len()] else {
            return None;
        };
        let linear_m_s2 = share * gravity_m_s2;
        let turning = |inertia_kg_m2: f64| linear_m_s2 / (3.0 * (inertia_kg_m2 / mass_kg).sqrt());
        Some((linear_m_s2, [i_xx, i_yy, i_zz].map(turning)))
    }

    /// The unit of a parameter; empty where it has none, or none is declared.
    pub fn unit(&self, parameter: ModelParameter) -> String {
        let unit = match parameter {
            ModelParameter::Parameter(k) => self.model.parameters[k].unit,
            ModelParameter::InputLag => return "s".to_owned(),
        };
        unit.filter(|unit| *unit != Unit::ONE).map_or_else(String::new, |unit| unit.to_string())
    }

    /// The free parameters, in the order of the fit.
    pub fn free(&self) -> &[ModelParameter] {
        &self.free
    }

    /// Names of parameters that keep their values because the flight does not move the inputs that would
    /// determine them.
    pub fn held(&self) -> Vec<String> {
        let waits = |k: &usize| {
            let freedom = &self.model.parameters[*k].freedom;
            matches!(freedom, Freedom::WhereMoved(_)) && !self.free.contains(&ModelParameter::Parameter(*k))
        };
        (0..self.model.parameters.len())
            .filter(waits)
            .map(|k| self.model.parameters[k].label.clone())
            .collect()
    }

    /// This model with the lag of the inputs free as well.
    #[must_use]
    pub fn with_free_lag(mut self) -> Self {
        self.make_free(ModelParameter::InputLag);
        self
    }

    /// This model with terms that follow the signals of the flight, fixed at zero ([`Model::with_signal_terms`]).
    pub(crate) fn with_signal_terms(mut self) -> Self {
        self.model = Arc::new(self.model.with_signal_terms());
        self.values.resize(self.model.parameters.len(), 0.0);
        self
    }

    /// This model with a scale and an offset of each sensor, fixed at zero ([`Model::with_sensor_terms`]).
    pub(crate) fn with_sensor_terms(mut self) -> Self {
        self.model = Arc::new(self.model.with_sensor_terms());
        self.values.resize(self.model.parameters.len(), 0.0);
        self
    }

    /// One value.
    pub fn value(&self, parameter: ModelParameter) -> f64 {
        match parameter {
            ModelParameter::Parameter(k) => self.values[k],
            ModelParameter::InputLag => self.input_lag_s,
        }
    }

    /// The columns of recorded inputs that the model reads, in its order.
    ///
    /// # Errors
    /// A column that is missing.
    pub fn inputs_of(&self, inputs: &InputSeries) -> Result<InputSeries, IdentifyError> {
        let columns: Vec<&str> = self.model.inputs.iter().map(|i| i.column.as_str()).collect();
        Ok(inputs.select(&columns)?)
    }

    /// The flight model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Values of all parameters of the flight model.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    pub(crate) fn set(&mut self, parameter: ModelParameter, value: f64) {
        match parameter {
            ModelParameter::Parameter(k) => self.values[k] = value,
            ModelParameter::InputLag => self.input_lag_s = value,
        }
    }

    /// Moves a parameter by a step of the fit, up to its bounds. One that must be above zero moves by its
    /// logarithm, at most by a factor of two.
    pub(crate) fn shift(&mut self, parameter: ModelParameter, step: f64) {
        let value = self.value(parameter);
        let to = match parameter {
            ModelParameter::Parameter(k) => {
                let p = &self.model.parameters[k];
                let to =
                    if p.min > 0.0 { value * (step / value).exp().clamp(0.5, 2.0) } else { value + step };
                to.clamp(p.min, p.max)
            }
            ModelParameter::InputLag => value + step,
        };
        self.set(parameter, to);
    }

    /// The step that takes a parameter to its bound, where one would take it beyond.
    pub(crate) fn step_to_bound(&self, parameter: ModelParameter, step: f64) -> Option<f64> {
        let ModelParameter::Parameter(k) = parameter else { return None };
        let (value, p) = (self.values[k], &self.model.parameters[k]);
        let to = if p.min > 0.0 { value * (step / value).exp().clamp(0.5, 2.0) } else { value + step };
        let bound = to.clamp(p.min, p.max);
        let back = if p.min > 0.0 { value * (bound / value).ln() } else { bound - value };
        (to != bound).then_some(back)
    }

    fn is_within_bounds(&self, parameter: ModelParameter) -> bool {
        let value = self.value(parameter);
        match parameter {
            ModelParameter::Parameter(k) => {
                let p = &self.model.parameters[k];
                value.is_finite() && value >= p.min && value <= p.max
            }
            ModelParameter::InputLag => value.is_finite(),
        }
    }

    /// Whether a parameter lies at a bound.
    pub(crate) fn is_at_bound(&self, parameter: ModelParameter) -> bool {
        self.to_bound(parameter) <= 0.0
    }

    /// How far a parameter is from the nearer of its bounds; infinite without bounds.
    pub(crate) fn to_bound(&self, parameter: ModelParameter) -> f64 {
        let ModelParameter::Parameter(k) = parameter else { return f64::INFINITY };
        let (value, p) = (self.values[k], &self.model.parameters[k]);
        (value - p.min).min(p.max - value)
    }

    /// Whether all free parameters are finite and within their bounds.
    pub(crate) fn is_physical(&self) -> bool {
        self.free.iter().all(|p| self.is_within_bounds(*p))
    }

    /// Standard deviations of what is known before the flight of free parameters, with their places in the
    /// list of free ones.
    pub(crate) fn priors(&self) -> impl Iterator<Item = (usize, f64)> {
        self.free.iter().enumerate().filter_map(|(place, parameter)| match parameter {
            ModelParameter::Parameter(k) => Some((place, self.model.parameters[*k].prior_std?)),
            ModelParameter::InputLag => None,
        })
    }
}

/// The equations of motion of a flight model, with the derivatives that a fit needs.
#[derive(Debug, Clone)]
pub(crate) struct Equations {
    pub(crate) dynamics: Dynamics,
    /// The place in the list of free parameters of each that the equations have.
    pub(crate) places: Vec<usize>,
    /// The place of the lag.
    pub(crate) lag: Option<usize>,
    /// Whether the equations are linear in each free parameter; in the lag they are not.
    pub(crate) is_linear: Vec<bool>,
}

impl Equations {
    pub(crate) fn new(model: &FlightModel) -> Self {
        Self::build(model, Dynamics::new)
    }

    /// With the model's sensors.
    pub(crate) fn with_sensors(model: &FlightModel) -> Self {
        Self::build(model, Dynamics::with_sensors)
    }

    fn build(model: &FlightModel, dynamics: fn(&Model, &[f64], &[usize]) -> Dynamics) -> Self {
        let own = |(place, parameter): (usize, &ModelParameter)| match parameter {
            ModelParameter::Parameter(k) => Some((place, *k)),
            ModelParameter::InputLag => None,
        };
        let (places, parameters): (Vec<usize>, Vec<usize>) =
            model.free.iter().enumerate().filter_map(own).unzip();
        let dynamics = dynamics(&model.model, &model.values, &parameters);
        let mut is_linear = vec![false; model.free.len()];
        places.iter().enumerate().for_each(|(k, place)| is_linear[*place] = dynamics.is_linear_in(k));
        let lag = model.free.iter().position(|p| *p == ModelParameter::InputLag);
        Self { dynamics, places, lag, is_linear }
    }

    /// Values of the free parameters that the equations have.
    pub(crate) fn values(&self, model: &FlightModel) -> Vec<f64> {
        self.places.iter().map(|place| model.value(model.free[*place])).collect()
    }

    /// Degrees of freedom of a state: its attitude has three, not four.
    pub(crate) fn tangent(&self) -> usize {
        self.dynamics.states() - 1
    }
}

/// Whether the inputs each move, and not all by the same part.
fn are_moved(inputs: &InputSeries, own: &[usize]) -> bool {
    let rows = inputs.times_s().len();
    let values = DMatrix::from_fn(rows, own.len(), |row, k| inputs.row(row)[own[k]]);
    let moves = |column: nalgebra::DVectorView<'_, f64>| {
        let (low, high) = (column.min(), column.max());
        high - low > 1e-9 * high.abs().max(1.0)
    };
    let each = values.column_iter().all(moves);
    each && (own.len() < 2
        || independent_columns(&values, &vec![0.0; own.len()]).independent.len() == own.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thrusts_are_free_where_rotors_move_and_not_by_the_same_part() {
        let vehicle = Vehicle::paper();
        let free = |lower: fn(f64) -> f64| {
            let times_s: Vec<f64> = (0..200).map(|k| 0.02 * f64::from(k)).collect();
            let row = |t_s: &f64| {
                let part = 1.0 + 0.04 * (3.0 * t_s).sin();
                [214.0 * part, 210.0 * lower(part), 0.0, 0.0]
            };
            let values = times_s.iter().flat_map(row).collect();
            let names: Vec<String> = vehicle.input_columns().iter().map(|n| (*n).to_owned()).collect();
            let inputs = InputSeries::new(names, times_s, values).unwrap();
            let model = FlightModel::new(&vehicle, &inputs).unwrap();
            ["C_Z,u", "C_Z,l", "C_Z,0"].map(|n| model.free().contains(&model.parameter(n).unwrap()))
        };
        assert_eq!(free(|part| part), [false, false, true]);
        assert_eq!(free(|_| 1.0), [false, false, true]);
        assert_eq!(free(|part| 2.0 - part), [true, true, false]);
    }
}
