//! The model of a fit: which coefficients are free, and where they start.

use crate::{IdentifyError, independent_columns};
use mavsight_flight::{Airframe, Coefficient, Coefficients, HelicopterInput, InputSeries, Vehicle};
use nalgebra::DMatrix;

/// A number that a fit may free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ModelParameter {
    /// A coefficient of the equations of motion.
    Coefficient(Coefficient),
    /// How late the inputs' clock is, s: an input recorded at t acts at t + lag on the clock of the
    /// measurements.
    InputLag,
}

impl ModelParameter {
    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Coefficient(c) => c.name(),
            Self::InputLag => "input_lag_s",
        }
    }

    /// Whether it is a flapping time or the lag, which enter the motion less linearly than all others.
    pub(crate) fn is_time(self) -> bool {
        matches!(self, Self::InputLag | Self::Coefficient(Coefficient::TauLower | Coefficient::TauFlybar))
    }

    /// The parameter of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all().find(|p| p.name() == name)
    }

    fn all() -> impl Iterator<Item = Self> {
        Coefficient::ALL.into_iter().map(Self::Coefficient).chain([Self::InputLag])
    }
}

/// The equations of motion with the values that a fit starts from and the mask of those that it may change.
///
/// K_u is seen only as a product with the gains of the upper rotor, and K_b only as a product with those of
/// the lower where the body hardly turns: both are fixed unless freed by name.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightModel {
    pub(crate) airframe: Airframe,
    pub(crate) coefficients: Coefficients,
    pub(crate) input_lag_s: f64,
    free: Vec<ModelParameter>,
}

impl FlightModel {
    /// A model that starts from what a vehicle file states: mass, inertia, size, thrust coefficients,
    /// flapping times, linkages. What is not stated starts from a guess that a fit replaces: hubs half a
    /// rotor radius above the centre of gravity, balanced torques at a figure of merit of one half, no
    /// damping, no offsets.
    ///
    /// Free are the forces and moments per disc angle, pitch damping, both flapping times, and the offsets of
    /// all axes; where the record moves them, also roll damping (lateral swash-plate), and thrust and torque
    /// of each rotor and yaw damping in place of the offsets of thrust and torque (rotor speeds, not both by
    /// the same part).
    ///
    /// # Errors
    /// A vehicle that is not valid.
    pub fn new(vehicle: &Vehicle, inputs: &InputSeries) -> Result<Self, IdentifyError> {
        let airframe = Airframe::of_vehicle(vehicle)?;
        let r = &vehicle.rotor;
        let torque = |thrust_coefficient: f64| 2.0 * thrust_coefficient.powf(1.5) / std::f64::consts::SQRT_2;
        let mean_torque = 2.0 * torque(0.5 * (r.thrust_coefficient_upper + r.thrust_coefficient_lower));
        let mut coefficients = Coefficients::default();
        for (which, value) in [
            (Coefficient::CxAlphaU, -2.0 * r.thrust_coefficient_upper),
            (Coefficient::CxAlphaL, -2.0 * r.thrust_coefficient_lower),
            (Coefficient::CzU, -2.0 * r.thrust_coefficient_upper),
            (Coefficient::CzL, -2.0 * r.thrust_coefficient_lower),
            (Coefficient::CmAlphaU, r.thrust_coefficient_upper),
            (Coefficient::CmAlphaL, r.thrust_coefficient_lower),
            (Coefficient::CnUpper, -mean_torque),
            (Coefficient::CnLower, mean_torque),
            (Coefficient::TauLower, r.flap_time_lower_s),
            (Coefficient::TauFlybar, r.flap_time_flybar_s),
            (Coefficient::SwashplateGain, r.swashplate_gain),
            (Coefficient::FlybarGain, r.flybar_gain),
        ] {
            coefficients.set(which, value);
        }
        let free = default_free(&HelicopterInput::series(inputs)?)
            .into_iter()
            .map(ModelParameter::Coefficient)
            .collect();
        Ok(Self { airframe, coefficients, input_lag_s: 0.0, free })
    }

    /// Replaces the free parameters by those of the given names; all others keep their values.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownParameter`]; repeated names count once.
    pub fn with_free(mut self, names: &[&str]) -> Result<Self, IdentifyError> {
        self.free.clear();
        names.iter().try_for_each(|name| known(name).map(|parameter| self.make_free(parameter)))?;
        Ok(self)
    }

    fn make_free(&mut self, parameter: ModelParameter) {
        if !self.free.contains(&parameter) {
            self.free.push(parameter);
        }
    }

    /// Sets the value that a fit starts from, or holds where the parameter is fixed.
    ///
    /// # Errors
    /// [`IdentifyError::UnknownParameter`], [`IdentifyError::BadSetting`] for a number that is not finite
    /// or a flapping time below 2 ms.
    pub fn with_value(mut self, name: &str, value: f64) -> Result<Self, IdentifyError> {
        let parameter = known(name)?;
        self.set(parameter, value);
        if !value.is_finite() || !self.is_physical() {
            let must = "be a finite number, and a flapping time 2 ms or more";
            return Err(IdentifyError::BadSetting { what: parameter.name(), value, must });
        }
        Ok(self)
    }

    /// The free parameters, in the order of the fit.
    pub fn free(&self) -> &[ModelParameter] {
        &self.free
    }

    /// Coefficients of thrust, torque and damping that keep the vehicle's values: those that a flight
    /// determines only if it moves the rotor speeds or the lateral swash-plate.
    pub fn held(&self) -> Vec<ModelParameter> {
        use Coefficient as C;
        [C::ClP, C::CzU, C::CzL, C::CnUpper, C::CnLower, C::CnR]
            .into_iter()
            .map(ModelParameter::Coefficient)
            .filter(|p| !self.free.contains(p))
            .collect()
    }

    /// This model with the lag of the inputs free as well.
    #[must_use]
    pub fn with_free_lag(mut self) -> Self {
        self.make_free(ModelParameter::InputLag);
        self
    }

    /// One value.
    pub fn value(&self, parameter: ModelParameter) -> f64 {
        match parameter {
            ModelParameter::Coefficient(c) => self.coefficients.get(c),
            ModelParameter::InputLag => self.input_lag_s,
        }
    }

    pub(crate) fn set(&mut self, parameter: ModelParameter, value: f64) {
        match parameter {
            ModelParameter::Coefficient(c) => self.coefficients.set(c, value),
            ModelParameter::InputLag => self.input_lag_s = value,
        }
    }

    /// Moves a parameter by a step of the fit. A flapping time moves by its logarithm, at most by a factor of
    /// two, so that no step makes it negative.
    pub(crate) fn shift(&mut self, parameter: ModelParameter, step: f64) {
        let value = self.value(parameter);
        let to = match parameter {
            ModelParameter::Coefficient(Coefficient::TauLower | Coefficient::TauFlybar) => {
                value * (step / value).exp().clamp(0.5, 2.0)
            }
            _ => value + step,
        };
        self.set(parameter, to);
    }

    pub(crate) fn is_physical(&self) -> bool {
        let is_long = |tau| self.coefficients.get(tau) >= MIN_FLAP_TIME_S;
        self.coefficients.values.iter().all(|v| v.is_finite())
            && self.input_lag_s.is_finite()
            && [Coefficient::TauLower, Coefficient::TauFlybar].into_iter().all(is_long)
    }
}

/// Flapping faster than this is over within a revolution of such a rotor and cannot be distinguished from
/// none.
const MIN_FLAP_TIME_S: f64 = 2e-3;

fn known(name: &str) -> Result<ModelParameter, IdentifyError> {
    ModelParameter::from_name(name).ok_or_else(|| IdentifyError::UnknownParameter {
        name: name.to_owned(),
        known: ModelParameter::all().map(ModelParameter::name).collect::<Vec<_>>().join(", "),
    })
}

fn default_free(inputs: &[HelicopterInput]) -> Vec<Coefficient> {
    use Coefficient as C;
    let moves = |value: fn(&HelicopterInput) -> f64| {
        let values = inputs.iter().map(value);
        let (low, high) = values.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        high - low > 1e-9 * high.abs().max(1.0)
    };
    let mut free =
        vec![C::CxAlphaU, C::CxAlphaL, C::CmAlphaU, C::CmAlphaL, C::CmQ, C::TauLower, C::TauFlybar];
    free.extend([C::Cx0, C::Cy0, C::Cl0, C::Cm0]);
    if moves(|s| s.delta_lat_rad) {
        free.push(C::ClP);
    }
    // Rotors that go together say only what both do.
    let squares = DMatrix::from_fn(inputs.len(), 2, |i, j| {
        let s = &inputs[i];
        [s.omega_u_rad_s, s.omega_l_rad_s][j].powi(2)
    });
    let apart = independent_columns(&squares, &[0.0; 2]).independent.len() == 2;
    if moves(|s| s.omega_u_rad_s) && moves(|s| s.omega_l_rad_s) && apart {
        free.extend([C::CzU, C::CzL, C::CnUpper, C::CnLower, C::CnR]);
    } else {
        free.extend([C::Cz0, C::Cn0]);
    }
    free
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thrusts_are_free_where_rotors_move_and_not_by_the_same_part() {
        let free = |lower: fn(f64) -> f64| {
            let sample = |k: i32| {
                let t_s = 0.02 * f64::from(k);
                let part = 1.0 + 0.04 * (3.0 * t_s).sin();
                let (omega_u_rad_s, omega_l_rad_s) = (214.0 * part, 210.0 * lower(part));
                HelicopterInput { t_s, omega_u_rad_s, omega_l_rad_s, ..Default::default() }
            };
            let samples: Vec<HelicopterInput> = (0..200).map(sample).collect();
            let inputs = HelicopterInput::recorded(&samples).unwrap();
            let model = FlightModel::new(&Vehicle::paper(), &inputs).unwrap();
            ["C_Z,u", "C_Z,l", "C_Z,0"].map(|n| model.free().contains(&ModelParameter::from_name(n).unwrap()))
        };
        assert_eq!(free(|part| part), [false, false, true]);
        assert_eq!(free(|_| 1.0), [false, false, true]);
        assert_eq!(free(|part| 2.0 - part), [true, true, false]);
    }
}
