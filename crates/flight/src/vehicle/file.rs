//! The vehicle file.

use super::earlier::{Assumption, Rotor, Surroundings};
use super::{Environment, Marker, Vehicle};
use crate::{Color, FlightError};
use mavsight_model::{Model, SHELF};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The content of a vehicle file as it stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleFile {
    /// Name.
    pub name: String,
    /// Mass.
    pub mass_kg: f64,
    /// I_xx, I_yy, I_zz.
    pub inertia_kg_m2: [f64; 3],
    /// I_xy, I_xz, I_yz.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub products_of_inertia_kg_m2: [f64; 3],
    /// Standard deviation of the mass; 0: exact.
    #[serde(default, skip_serializing_if = "is_exact")]
    pub mass_std_kg: f64,
    /// Standard deviations of I_xx, I_yy, I_zz; 0: exact.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub inertia_std_kg_m2: [f64; 3],
    /// Name of a model of the shelf, or the path of a model file beside this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Balls.
    pub marker: Vec<Marker>,
    /// Air and gravity.
    pub environment: Environment,
    /// Values of the model's parameters for this aircraft.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// Values that the simulation alone has.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub simulation: BTreeMap<String, f64>,
    /// Of schema 1.
    #[serde(default, skip_serializing)]
    rotor: Option<Rotor>,
    /// Of schema 1.
    #[serde(default, skip_serializing)]
    assumption: Option<Assumption>,
}

fn is_zero(values: &[f64; 3]) -> bool {
    *values == [0.0; 3]
}

fn is_exact(std: &f64) -> bool {
    *std == 0.0
}

impl VehicleFile {
    /// The vehicle, where `read` gives the text of a model file that is not of the shelf.
    ///
    /// A file of schema 1, which has a rotor, is one of the shelf's coaxial helicopter; one that names no
    /// model is of a rigid body on which gravity acts alone.
    ///
    /// # Errors
    /// [`FlightError::Model`] for a model that is not read or is wrong; [`FlightError::TwoSchemas`].
    pub fn vehicle(mut self, read: impl Fn(&str) -> Result<String, String>) -> Result<Vehicle, FlightError> {
        let rotor = self.rotor.take();
        if let Some(rotor) = &rotor {
            if self.model.is_some() {
                return Err(FlightError::TwoSchemas);
            }
            self.model = Some("coaxial".to_owned());
            let assumption = self.assumption.take().unwrap_or_default();
            let around = Surroundings {
                weight_n: self.mass_kg * self.environment.gravity_m_s2,
                air_density_kg_m3: self.environment.air_density_kg_m3,
            };
            self.parameters = rotor.parameters();
            self.simulation = assumption.simulation(rotor, &around);
        }
        let model = match self.model.as_deref() {
            None => Model::rigid_body(),
            Some(name) => model(name, read)?,
        };
        Ok(Vehicle {
            name: self.name,
            mass_kg: self.mass_kg,
            inertia_kg_m2: self.inertia_kg_m2,
            products_of_inertia_kg_m2: self.products_of_inertia_kg_m2,
            mass_std_kg: self.mass_std_kg,
            inertia_std_kg_m2: self.inertia_std_kg_m2,
            marker: self.marker,
            environment: self.environment,
            model: Arc::new(model),
            parameters: self.parameters,
            simulation: self.simulation,
            is_of_schema_1: rotor.is_some(),
        })
    }
}

fn model(name: &str, read: impl Fn(&str) -> Result<String, String>) -> Result<Model, FlightError> {
    if let Some(model) = Model::shelf(name) {
        return Ok(model);
    }
    let shelf = || SHELF.map(|(name, _)| name).join(", ");
    let wrong = |detail: String| FlightError::Model { name: name.to_owned(), detail, shelf: shelf() };
    let text = read(name).map_err(wrong)?;
    Model::parse(name, &text).map_err(FlightError::ModelFile)
}

impl TryFrom<VehicleFile> for Vehicle {
    type Error = FlightError;

    fn try_from(file: VehicleFile) -> Result<Self, FlightError> {
        file.vehicle(|_| Err("there is no such model on the shelf".to_owned()))
    }
}

impl From<Vehicle> for VehicleFile {
    fn from(vehicle: Vehicle) -> Self {
        let file = vehicle.model.file.clone();
        // A file beside the vehicle's may have a name of the shelf.
        let own = |(known, text): &(&str, &str)| {
            file.strip_suffix(".toml") == Some(known) && *text == vehicle.model.definition
        };
        let shelf = SHELF.iter().find(|entry| own(entry)).map(|(name, _)| *name);
        let model = match shelf {
            Some(name) => Some(name.to_owned()),
            None => (*vehicle.model != Model::rigid_body()).then_some(file),
        };
        Self {
            name: vehicle.name,
            mass_kg: vehicle.mass_kg,
            inertia_kg_m2: vehicle.inertia_kg_m2,
            products_of_inertia_kg_m2: vehicle.products_of_inertia_kg_m2,
            mass_std_kg: vehicle.mass_std_kg,
            inertia_std_kg_m2: vehicle.inertia_std_kg_m2,
            model,
            marker: vehicle.marker,
            environment: vehicle.environment,
            parameters: vehicle.parameters,
            simulation: vehicle.simulation,
            rotor: None,
            assumption: None,
        }
    }
}

/// The aircraft of the paper ([`Vehicle::paper`]).
pub(super) fn paper() -> Vehicle {
    let ball = |name: &str, x: f64, y: f64, color: Color| Marker {
        name: name.to_owned(),
        position_m: [x, y, 0.10],
        diameter_m: 0.05,
        color,
    };
    let rotor = Rotor {
        radius_m: 0.25,
        thrust_coefficient_upper: 7.18e-3,
        thrust_coefficient_lower: 4.98e-3,
        flap_time_lower_s: 0.05,
        flap_time_flybar_s: 3.0,
        swashplate_gain: 0.91,
        flybar_gain: 0.83,
    };
    let environment = Environment { air_density_kg_m3: 1.14, gravity_m_s2: 9.804 };
    let mass_kg = 0.8;
    let around = Surroundings {
        weight_n: mass_kg * environment.gravity_m_s2,
        air_density_kg_m3: environment.air_density_kg_m3,
    };
    Vehicle {
        name: "Lama 400D, modified".to_owned(),
        mass_kg,
        inertia_kg_m2: [6.1e-3, 6.26e-3, 0.93e-3],
        products_of_inertia_kg_m2: [0.0; 3],
        mass_std_kg: 0.0,
        inertia_std_kg_m2: [0.0; 3],
        marker: vec![
            ball("red", 0.225, 0.225, Color::new(0xdb, 0x12, 0x12)),
            ball("green", 0.225, -0.225, Color::new(0x12, 0xa0, 0x2e)),
            ball("blue", -0.225, -0.225, Color::new(0x1c, 0x38, 0xd0)),
            ball("yellow", -0.225, 0.225, Color::new(0xe8, 0xc4, 0x10)),
        ],
        environment,
        model: Arc::new(Model::shelf("coaxial").unwrap_or_default()),
        simulation: Assumption::default().simulation(&rotor, &around),
        parameters: rotor.parameters(),
        is_of_schema_1: false,
    }
}
