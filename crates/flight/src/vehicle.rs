//! What is known of the aircraft: mass, markers, rotors, air; and, labelled as such, what is assumed.

use crate::FlightError;
use mavsight_geometry::{Vector3, rigid_fit};
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;

/// An sRGB colour, written `#rrggbb`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Color {
    r: u8,
    g: u8,
    b: u8,
}

impl Color {
    /// From 8-bit sRGB components.
    pub const fn new(r: u8, g: u8, b: u8) -> Self {
        Self { r, g, b }
    }

    /// Reads `#rrggbb`.
    ///
    /// # Errors
    /// [`FlightError::UnknownColor`] for anything else.
    pub fn parse(text: &str) -> Result<Self, FlightError> {
        let unknown = || FlightError::UnknownColor(text.to_owned());
        let digits = text.trim().strip_prefix('#').ok_or_else(unknown)?;
        if digits.len() != 6 || !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(unknown());
        }
        let value = u32::from_str_radix(digits, 16).map_err(|_| unknown())?;
        let [_, r, g, b] = value.to_be_bytes();
        Ok(Self { r, g, b })
    }

    /// 8-bit sRGB components.
    pub const fn rgb(&self) -> [u8; 3] {
        [self.r, self.g, self.b]
    }

    /// Linear-light components in 0..=1 (IEC 61966-2-1).
    pub fn to_linear(&self) -> [f64; 3] {
        self.rgb().map(|c| {
            let s = f64::from(c) / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        })
    }
}

impl TryFrom<String> for Color {
    type Error = FlightError;
    fn try_from(text: String) -> Result<Self, FlightError> {
        Self::parse(&text)
    }
}

impl From<Color> for String {
    fn from(color: Color) -> Self {
        color.to_string()
    }
}

impl std::fmt::Display for Color {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.r, self.g, self.b)
    }
}

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

/// Rotors and fly-bar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotor {
    /// Rotor radius R.
    pub radius_m: f64,
    /// C_Tu of T_u = C_Tu ρ π R⁴ ω_u² (equation 5).
    pub thrust_coefficient_upper: f64,
    /// C_Tl.
    pub thrust_coefficient_lower: f64,
    /// Flapping time constant of the lower rotor, τ_f,l.
    pub flap_time_lower_s: f64,
    /// Flapping time constant of the fly-bar, τ_f,f.
    pub flap_time_flybar_s: f64,
    /// Linkage from swash-plate to lower rotor, K_b.
    pub swashplate_gain: f64,
    /// Linkage from fly-bar to upper rotor, K_u: alpha_u = K_u alpha_f. The paper does not give it.
    pub flybar_gain: f64,
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

/// What the paper leaves open. Each value is an assumption, read by the simulation alone, never by an
/// estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, SmartDefault)]
#[serde(deny_unknown_fields, default)]
pub struct Assumption {
    /// Height of the upper hub above the centre of gravity: the lower hub's plus the 80 mm of section 4.1.
    #[default(0.20)]
    pub height_upper_m: f64,
    /// Height of the lower hub above the centre of gravity: measured off figure 5, to a few centimetres.
    #[default(0.12)]
    pub height_lower_m: f64,
    /// Hub stiffness of each rotor: a teetering rotor has none.
    pub hub_stiffness_n_m_rad: f64,
    /// C_Qu of Q_u = C_Qu ρ π R⁵ ω_u²: induced power C_T^1.5/√2 at a figure of merit of one half.
    #[default(8.6e-4)]
    pub torque_coefficient_upper: f64,
    /// C_Ql; equal to the upper so that hover at equal speeds does not turn.
    #[default(8.6e-4)]
    pub torque_coefficient_lower: f64,
    /// Roll moment per roll rate.
    #[default(-0.002)]
    pub roll_damping_n_m_s_rad: f64,
    /// Pitch moment per pitch rate.
    #[default(-0.002)]
    pub pitch_damping_n_m_s_rad: f64,
    /// Yaw moment per yaw rate.
    #[default(-0.002)]
    pub yaw_damping_n_m_s_rad: f64,
    /// Drag per speed: an indoor flight is slow.
    pub drag_n_s_m: f64,
}

/// No rotor answers within a millisecond: a blade of centimetres flaps some tens of times a second.
const SHORTEST_FLAP_TIME_S: f64 = 1e-3;
/// Moments of inertia that were measured may break the triangle's law by their errors.
const INERTIA_TOLERANCE: f64 = 0.05;

/// The aircraft: the content of a vehicle file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Name.
    pub name: String,
    /// Mass m.
    pub mass_kg: f64,
    /// Moments of inertia I_xx, I_yy, I_zz about the body axes, which are taken as principal.
    pub inertia_kg_m2: [f64; 3],
    /// Balls.
    pub marker: Vec<Marker>,
    /// Rotors.
    pub rotor: Rotor,
    /// Air and gravity.
    pub environment: Environment,
    /// What is assumed.
    #[serde(default)]
    pub assumption: Assumption,
}

impl Vehicle {
    /// The modified Lama 400D of the paper: table 2 and section 3; I_xx, I_zz, K_u and where the square hangs
    /// are assumptions.
    pub fn paper() -> Self {
        let ball = |name: &str, x: f64, y: f64, color: Color| Marker {
            name: name.to_owned(),
            position_m: [x, y, 0.10],
            diameter_m: 0.05,
            color,
        };
        Self {
            name: "Lama 400D, modified".to_owned(),
            mass_kg: 0.8,
            inertia_kg_m2: [6.1e-3, 6.26e-3, 0.93e-3],
            marker: vec![
                ball("red", 0.225, 0.225, Color::new(0xdb, 0x12, 0x12)),
                ball("green", 0.225, -0.225, Color::new(0x12, 0xa0, 0x2e)),
                ball("blue", -0.225, -0.225, Color::new(0x1c, 0x38, 0xd0)),
                ball("yellow", -0.225, 0.225, Color::new(0xe8, 0xc4, 0x10)),
            ],
            rotor: Rotor {
                radius_m: 0.25,
                thrust_coefficient_upper: 7.18e-3,
                thrust_coefficient_lower: 4.98e-3,
                flap_time_lower_s: 0.05,
                flap_time_flybar_s: 3.0,
                swashplate_gain: 0.91,
                flybar_gain: 0.83,
            },
            environment: Environment { air_density_kg_m3: 1.14, gravity_m_s2: 9.804 },
            assumption: Assumption::default(),
        }
    }

    /// Checks that every constant makes sense and that markers are distinguished by name, of which tables
    /// make lists. Markers may share a colour; whether their places distinguish them is decided where they
    /// are observed.
    ///
    /// # Errors
    /// The first key that does not, with its value.
    pub fn validate(&self) -> Result<(), FlightError> {
        let r = &self.rotor;
        let positive = [
            ("mass_kg", self.mass_kg),
            ("inertia_kg_m2[0]", self.inertia_kg_m2[0]),
            ("inertia_kg_m2[1]", self.inertia_kg_m2[1]),
            ("inertia_kg_m2[2]", self.inertia_kg_m2[2]),
            ("rotor.radius_m", r.radius_m),
            ("rotor.thrust_coefficient_upper", r.thrust_coefficient_upper),
            ("rotor.thrust_coefficient_lower", r.thrust_coefficient_lower),
            ("rotor.flap_time_lower_s", r.flap_time_lower_s),
            ("rotor.flap_time_flybar_s", r.flap_time_flybar_s),
            ("environment.air_density_kg_m3", self.environment.air_density_kg_m3),
            ("environment.gravity_m_s2", self.environment.gravity_m_s2),
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(FlightError::NotPositive { key: key.to_owned(), value });
            }
        }
        for (key, value) in [
            ("rotor.flap_time_lower_s", r.flap_time_lower_s),
            ("rotor.flap_time_flybar_s", r.flap_time_flybar_s),
        ] {
            if value < SHORTEST_FLAP_TIME_S {
                return Err(FlightError::FlapTime { key: key.to_owned(), value });
            }
        }
        let sum: f64 = self.inertia_kg_m2.iter().sum();
        if self.inertia_kg_m2.iter().any(|i| 2.0 * i > sum * (1.0 + INERTIA_TOLERANCE)) {
            return Err(FlightError::Inertia(self.inertia_kg_m2));
        }
        let a = &self.assumption;
        let finite = [
            ("rotor.swashplate_gain", r.swashplate_gain),
            ("rotor.flybar_gain", r.flybar_gain),
            ("assumption.height_upper_m", a.height_upper_m),
            ("assumption.height_lower_m", a.height_lower_m),
            ("assumption.hub_stiffness_n_m_rad", a.hub_stiffness_n_m_rad),
            ("assumption.torque_coefficient_upper", a.torque_coefficient_upper),
            ("assumption.torque_coefficient_lower", a.torque_coefficient_lower),
            ("assumption.roll_damping_n_m_s_rad", a.roll_damping_n_m_s_rad),
            ("assumption.pitch_damping_n_m_s_rad", a.pitch_damping_n_m_s_rad),
            ("assumption.yaw_damping_n_m_s_rad", a.yaw_damping_n_m_s_rad),
            ("assumption.drag_n_s_m", a.drag_n_s_m),
        ];
        for (key, value) in finite {
            if !value.is_finite() {
                return Err(FlightError::NotFinite { key: key.to_owned(), value });
            }
        }
        self.validate_markers()
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
mod tests {
    use super::*;

    #[test]
    fn colors_survive_the_round_trip() {
        let color = Color::parse("#db1203").expect("a colour");
        assert_eq!(color.rgb(), [0xdb, 0x12, 0x03]);
        assert_eq!(color.to_string(), "#db1203");
        assert!((Color::new(188, 188, 188).to_linear()[0] - 0.5).abs() < 0.005, "sRGB 188 is half the light");
    }

    #[test]
    fn a_colour_that_is_none_is_named() {
        for text in ["reddish", "#12345", "#gg0000", "", "#1234567", "#éé00"] {
            assert_eq!(Color::parse(text), Err(FlightError::UnknownColor(text.to_owned())));
        }
    }

    #[test]
    fn the_papers_vehicle_is_valid_and_each_constant_is_checked() {
        assert_eq!(Vehicle::paper().validate(), Ok(()));
        let mut vehicle = Vehicle::paper();
        vehicle.mass_kg = f64::NAN;
        assert!(matches!(vehicle.validate(), Err(FlightError::NotPositive { key, .. }) if key == "mass_kg"));
        let mut vehicle = Vehicle::paper();
        vehicle.marker[2].color = vehicle.marker[0].color;
        assert_eq!(vehicle.validate(), Ok(()));
        vehicle.marker[2].name = vehicle.marker[0].name.clone();
        assert!(matches!(vehicle.validate(), Err(FlightError::DuplicateMarker { first: 1, second: 3, .. })));
        vehicle.marker[2].name = "left red".into();
        assert!(matches!(vehicle.validate(), Err(FlightError::MarkerName { .. })));
        let mut vehicle = Vehicle::paper();
        vehicle.inertia_kg_m2 = [1e-3, 1.0, 1e-3];
        assert!(matches!(vehicle.validate(), Err(FlightError::Inertia { .. })));
        let mut vehicle = Vehicle::paper();
        vehicle.rotor.flap_time_lower_s = 1e-4;
        assert!(
            matches!(vehicle.validate(), Err(FlightError::FlapTime { key, .. }) if key.contains("lower"))
        );
        let mut vehicle = Vehicle::paper();
        vehicle.marker.iter_mut().for_each(|m| m.position_m = [m.position_m[0], 0.5, 0.0]);
        assert!(matches!(vehicle.validate(), Err(FlightError::MarkerPlaces(_))));
        let mut vehicle = Vehicle::paper();
        vehicle.assumption.drag_n_s_m = f64::INFINITY;
        assert!(
            matches!(vehicle.validate(), Err(FlightError::NotFinite { key, .. }) if key.ends_with("drag_n_s_m"))
        );
        let mut vehicle = Vehicle::paper();
        vehicle.marker.truncate(2);
        assert_eq!(vehicle.validate(), Err(FlightError::TooFewMarkers(2)));
    }
}
