//! What is known of the aircraft: mass, inertia, markers, air, and its flight model with the values of this
//! aircraft.

mod earlier;
mod file;

pub use file::VehicleFile;

use crate::{Color, FlightError};
use mavsight_geometry::{Vector3, rigid_fit};
use mavsight_model::{Axis, BODY_PARAMETERS, Body, Freedom, Model, RIGID_STATES};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Largest diameter of a ball on a small aircraft, which may itself span two metres; a larger number is in another unit.
const LARGEST_BALL_M: f64 = 1.0;

/// A coloured ball on the aircraft.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Marker {
    /// Name, unique.
    pub name: String,
    /// Centre in body axes, metres.
    pub position_m: [f64; 3],
    /// Diameter.
    pub diameter_m: f64,
    /// Nominal colour, as a person would pick it from a picture.
    pub color: Color,
}

/// Air and gravity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// ρ.
    pub air_density_kg_m3: f64,
    /// g.
    pub gravity_m_s2: f64,
}

/// The key of each of [`BODY_PARAMETERS`].
const BODY_KEYS: [&str; BODY_PARAMETERS.len()] = [
    "mass_kg",
    "inertia_kg_m2[0]",
    "inertia_kg_m2[1]",
    "inertia_kg_m2[2]",
    "products_of_inertia_kg_m2[0]",
    "products_of_inertia_kg_m2[1]",
    "products_of_inertia_kg_m2[2]",
    "environment.gravity_m_s2",
    "environment.air_density_kg_m3",
];

/// Moments of inertia that were measured may break the triangle's law by their errors.
const INERTIA_TOLERANCE: f64 = 0.05;

/// The aircraft: the content of a vehicle file, with the flight model that it names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "VehicleFile", into = "VehicleFile")]
pub struct Vehicle {
    /// Name.
    pub name: String,
    /// Mass m.
    pub mass_kg: f64,
    /// Moments of inertia I_xx, I_yy, I_zz about the body axes.
    pub inertia_kg_m2: [f64; 3],
    /// Products of inertia I_xy, I_xz, I_yz: integrals of xy, xz and yz over the mass.
    pub products_of_inertia_kg_m2: [f64; 3],
    /// Standard deviation of the mass; 0: it counts as exact.
    pub mass_std_kg: f64,
    /// Standard deviations of the moments of inertia; 0: they count as exact.
    pub inertia_std_kg_m2: [f64; 3],
    /// Balls.
    pub marker: Vec<Marker>,
    /// Air and gravity.
    pub environment: Environment,
    /// Forces and moments.
    pub model: Arc<Model>,
    /// Values of the model's parameters for this aircraft.
    pub parameters: BTreeMap<String, f64>,
    /// Values that the simulation alone has; no estimator reads them.
    pub simulation: BTreeMap<String, f64>,
    /// Whether it was read from a file of schema 1.
    pub is_of_schema_1: bool,
}

impl Vehicle {
    /// The modified Lama 400D of the paper: table 2 and section 3; I_xx, I_zz, K_u and where the square hangs
    /// are assumptions, as is all that the simulation alone has.
    pub fn paper() -> Self {
        file::paper()
    }

    /// Mass, inertia and surroundings.
    pub fn body(&self) -> Body {
        let ([xx, yy, zz], [xy, xz, yz]) = (self.inertia_kg_m2, self.products_of_inertia_kg_m2);
        Body {
            mass_kg: self.mass_kg,
            inertia_kg_m2: [xx, yy, zz, xy, xz, yz],
            gravity_m_s2: self.environment.gravity_m_s2,
            air_density_kg_m3: self.environment.air_density_kg_m3,
        }
    }

    /// The flight model for a fit: mass and moments of inertia that have a standard deviation are free, and known
    /// to that before the flight, so that what depends on them claims it too.
    pub fn model_for_fits(&self) -> Arc<Model> {
        let [xx, yy, zz] = self.inertia_std_kg_m2;
        let stds = [self.mass_std_kg, xx, yy, zz];
        if stds == [0.0; 4] {
            return Arc::clone(&self.model);
        }
        let mut model = Model::clone(&self.model);
        for (parameter, std) in model.parameters.iter_mut().zip(stds).filter(|(_, std)| *std > 0.0) {
            parameter.freedom = Freedom::Free;
            parameter.prior_std = Some(std);
        }
        Arc::new(model)
    }

    /// Standard deviation over value of what a measured force or moment is multiplied by: mass, or the moment of
    /// inertia about the axis.
    pub fn relative_std(&self, of: Axis) -> f64 {
        match of {
            Axis::Force(_) => self.mass_std_kg / self.mass_kg,
            Axis::Moment(axis) => self.inertia_std_kg_m2[axis] / self.inertia_kg_m2[axis],
        }
    }

    /// Values of all parameters of the model, in its order, as far as they are known of this aircraft; the
    /// rest as its file has them.
    pub fn values(&self) -> Vec<f64> {
        let given =
            |name: &str, label: &str| self.parameters.get(name).or_else(|| self.parameters.get(label));
        self.model.values(&self.body(), |p| given(&p.name, &p.label).copied())
    }

    /// The columns of the recorded inputs that the model reads, in its order.
    pub fn input_columns(&self) -> Vec<&str> {
        self.model.inputs.iter().map(|i| i.column.as_str()).collect()
    }

    /// The inputs that hold the aircraft in steady flight, in the model's order.
    pub fn trim(&self) -> Vec<f64> {
        self.model.trim(&self.values())
    }

    /// Names of all states as columns of tables have them.
    pub fn state_columns(&self) -> Vec<String> {
        let rigid: [&str; RIGID_STATES] = [
            "x_m", "y_m", "z_m", "q_w", "q_x", "q_y", "q_z", "u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s",
            "r_rad_s",
        ];
        let further = self.model.states.iter().map(|s| s.column.clone());
        rigid.iter().map(|name| (*name).to_owned()).chain(further).collect()
    }

    /// Checks that every constant makes sense, that values belong to parameters of the model and not to the
    /// body, and that markers are distinguished by name, of which tables make lists. Markers may share a colour; whether
    /// their places distinguish them is decided where they are observed.
    ///
    /// # Errors
    /// The first key that does not, with its value.
    pub fn validate(&self) -> Result<(), FlightError> {
        let positive = [
            ("mass_kg", self.mass_kg),
            ("inertia_kg_m2[0]", self.inertia_kg_m2[0]),
            ("inertia_kg_m2[1]", self.inertia_kg_m2[1]),
            ("inertia_kg_m2[2]", self.inertia_kg_m2[2]),
            ("environment.air_density_kg_m3", self.environment.air_density_kg_m3),
            ("environment.gravity_m_s2", self.environment.gravity_m_s2),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(FlightError::NotPositive { key: key.to_owned(), value });
            }
        }
        let sum: f64 = self.inertia_kg_m2.iter().sum();
        if self.inertia_kg_m2.iter().any(|i| 2.0 * i > sum * (1.0 + INERTIA_TOLERANCE)) {
            return Err(FlightError::Inertia(self.inertia_kg_m2));
        }
        self.validate_inertia_products()?;
        self.validate_body_stds()?;
        for (section, values) in [("parameters", &self.parameters), ("simulation", &self.simulation)] {
            values.iter().try_for_each(|(name, value)| self.validate_value(section, name, *value))?;
        }
        self.validate_markers()
    }

    fn validate_inertia_products(&self) -> Result<(), FlightError> {
        let ([xx, yy, zz], [xy, xz, yz]) = (self.inertia_kg_m2, self.products_of_inertia_kg_m2);
        for (k, product, limit) in [(0, xy, xx * yy), (1, xz, xx * zz), (2, yz, yy * zz)] {
            if !product.is_finite() || product * product >= limit {
                let key = format!("products_of_inertia_kg_m2[{k}]");
                return Err(FlightError::InertiaProduct { key, value: product, limit: limit.sqrt() });
            }
        }
        Ok(())
    }

    fn validate_body_stds(&self) -> Result<(), FlightError> {
        let own = |k: usize| (self.inertia_std_kg_m2[k], self.inertia_kg_m2[k]);
        let inertia = (0..3).map(|k| (format!("inertia_std_kg_m2[{k}]"), own(k)));
        let mass = ("mass_std_kg".to_owned(), (self.mass_std_kg, self.mass_kg));
        match std::iter::once(mass).chain(inertia).find(|(_, (std, value))| !(0.0..*value).contains(std)) {
            Some((key, (value, max))) => Err(FlightError::OutOfBounds { key, value, min: 0.0, max }),
            None => Ok(()),
        }
    }

    fn validate_value(&self, section: &str, name: &str, value: f64) -> Result<(), FlightError> {
        let Some(k) = self.model.parameter(name) else {
            let near = self.model.near_parameters(name);
            let (name, model) = (name.to_owned(), self.model.name.clone());
            return Err(FlightError::UnknownParameter { section: section.to_owned(), name, model, near });
        };
        // The simulation alone may have a mass of its own.
        if let ("parameters", Some(key)) = (section, BODY_KEYS.get(k)) {
            return Err(FlightError::OfTheBody { name: name.to_owned(), key });
        }
        let p = &self.model.parameters[k];
        if !value.is_finite() || value < p.min || value > p.max {
            let key = format!("{section}.{name}");
            return Err(FlightError::OutOfBounds { key, value, min: p.min, max: p.max });
        }
        Ok(())
    }

    fn validate_markers(&self) -> Result<(), FlightError> {
        if self.marker.len() < 3 {
            return Err(FlightError::TooFewMarkers(self.marker.len()));
        }
        for (k, marker) in self.marker.iter().enumerate() {
            if !(marker.diameter_m.is_finite() && marker.diameter_m > 0.0) {
                let key = format!("marker {}: diameter_m", marker.name);
                return Err(FlightError::NotPositive { key, value: marker.diameter_m });
            }
            if marker.diameter_m > LARGEST_BALL_M {
                return Err(FlightError::BallTooLarge {
                    marker: marker.name.clone(),
                    diameter_m: marker.diameter_m,
                });
            }
            if let Some(&value) = marker.position_m.iter().find(|v| !v.is_finite()) {
                let key = format!("marker {}: position_m", marker.name);
                return Err(FlightError::NotFinite { key, value });
            }
            if marker.name.is_empty() || marker.name.contains(char::is_whitespace) {
                return Err(FlightError::MarkerName(marker.name.clone()));
            }
            if let Some(first) = self.marker[..k].iter().position(|other| other.name == marker.name) {
                let (first, second) = (first + 1, k + 1);
                return Err(FlightError::DuplicateMarker { first, second, name: marker.name.clone() });
            }
        }
        let places = self.marker.iter().map(|m| Vector3::from(m.position_m));
        rigid_fit(places.map(|p| (p, p))).map_err(FlightError::MarkerPlaces)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
