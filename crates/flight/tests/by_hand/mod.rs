//! The coaxial helicopter's equations of motion written by hand, with exact derivatives: a check of the model
//! file and of its derivatives.

#![allow(dead_code, missing_docs, unreachable_pub, unused_imports)]

mod linearise;

pub use linearise::Linearisation;

use mavsight_flight::Vehicle;
use mavsight_geometry::Vector3;
use nalgebra::Quaternion;

/// The inputs of the coaxial helicopter at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HelicopterInput {
    pub omega_u_rad_s: f64,
    pub omega_l_rad_s: f64,
    pub delta_lon_rad: f64,
    pub delta_lat_rad: f64,
}

/// States: position in the world (3), level_from_body as w, x, y, z (4), velocity in body axes (3), rates
/// (3), and the flapping angles alpha_l, beta_l, alpha_f, beta_f.
pub const FLIGHT_STATES: usize = 17;

/// A packed state, in the order of [`FLIGHT_STATES`].
pub type StateVector = [f64; FLIGHT_STATES];

macro_rules! coefficients {
    ($($(#[$doc:meta])* $variant:ident = $name:literal,)*) => {
        /// A coefficient of the model. Forces are made dimensionless by ½ρπR⁴ω², moments by ½ρπR⁵ω²; what a
        /// rotor does by the square of its own speed, everything else by that of the reference speed.
        ///
        /// Roll and side force follow from pitch and longitudinal force by the symmetry of the rotors about
        /// their shaft.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Coefficient { $($(#[$doc])* $variant,)* }

        impl Coefficient {
            /// All coefficients, in the order of [`Coefficients::values`].
            pub const ALL: [Self; COEFFICIENTS] = [$(Self::$variant,)*];

            /// The name in tables.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }
        }
    };
}

/// Number of coefficients.
pub const COEFFICIENTS: usize = 26;

coefficients! {
    /// X per radian of the upper disc; Y per radian to the right is minus this.
    CxAlphaU = "C_X,alpha_u",
    /// X per radian of the lower disc.
    CxAlphaL = "C_X,alpha_l",
    /// Z of the upper rotor.
    CzU = "C_Z,u",
    /// Z of the lower rotor.
    CzL = "C_Z,l",
    /// Pitch moment per radian of the upper disc; roll moment per radian to the right.
    CmAlphaU = "C_m,alpha_u",
    /// Pitch moment per radian of the lower disc.
    CmAlphaL = "C_m,alpha_l",
    /// Moment per radian of either disc that does not grow with its thrust: hub stiffness at the reference
    /// speed.
    CmHub = "C_m,hub",
    /// Roll moment per roll rate, s.
    ClP = "C_l,p",
    /// Pitch moment per pitch rate, s.
    CmQ = "C_m,q",
    /// Yaw moment per yaw rate, s.
    CnR = "C_n,r",
    /// Pitch moment per forward speed, s/m; roll moment per speed to the right is minus this.
    CmU = "C_m,u",
    /// Pitch moment per speed downwards, s/m.
    CmW = "C_m,w",
    /// Torque of the upper rotor.
    CnUpper = "C_n,u",
    /// Torque of the lower rotor.
    CnLower = "C_n,l",
    /// Drag per speed along x and y, N s/m.
    DragXy = "d_xy",
    /// Drag per speed along z, N s/m.
    DragZ = "d_z",
    /// Constant force forward.
    Cx0 = "C_X,0",
    /// Constant force to the right.
    Cy0 = "C_Y,0",
    /// Constant force downwards.
    Cz0 = "C_Z,0",
    /// Constant roll moment.
    Cl0 = "C_l,0",
    /// Constant pitch moment.
    Cm0 = "C_m,0",
    /// Constant yaw moment.
    Cn0 = "C_n,0",
    /// Flapping time constant of the lower rotor, s.
    TauLower = "tau_l",
    /// Flapping time constant of the fly-bar, s.
    TauFlybar = "tau_f",
    /// Linkage from swash-plate to lower rotor.
    SwashplateGain = "K_b",
    /// Linkage from fly-bar to upper rotor.
    FlybarGain = "K_u",
}

/// One value of each [`Coefficient`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficients {
    /// Values in the order of [`Coefficient::ALL`].
    pub values: [f64; COEFFICIENTS],
}

impl Default for Coefficients {
    fn default() -> Self {
        let mut c = Self { values: [0.0; COEFFICIENTS] };
        c.set(Coefficient::TauLower, 1.0);
        c.set(Coefficient::TauFlybar, 1.0);
        c
    }
}

impl Coefficients {
    /// One value.
    pub fn get(&self, which: Coefficient) -> f64 {
        self.values[which as usize]
    }

    /// By what a state acts: the upper disc is K_u times the fly-bar.
    fn disc_per_state(&self, state: usize) -> f64 {
        if matches!(state, 15 | 16) { self.get(Coefficient::FlybarGain) } else { 1.0 }
    }

    /// Changes one value.
    pub fn set(&mut self, which: Coefficient, value: f64) {
        self.values[which as usize] = value;
    }
}

/// What turns coefficients into accelerations: mass, inertia, size, air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Airframe {
    mass_kg: f64,
    inertia_kg_m2: Vector3<f64>,
    radius_m: f64,
    gravity_m_s2: f64,
    force_per_speed2: f64,
    reference_speed_rad_s: f64,
}

/// Adds `per_unit` times a coefficient, times a state where there is one, to the rate of a velocity or rate.
#[derive(Debug, Clone, Copy)]
struct Effect {
    row: usize,
    which: Coefficient,
    state: Option<usize>,
    per_unit: f64,
}

impl Airframe {
    /// The airframe of a coaxial helicopter, with the rotor speed of its hover as the reference.
    pub fn of_vehicle(vehicle: &Vehicle) -> Self {
        let [radius_m, upper, lower] = ["R", "C_Tu", "C_Tl"].map(|name| vehicle.parameters[name]);
        let environment = &vehicle.environment;
        let force_per_speed2 = 0.5 * environment.air_density_kg_m3 * std::f64::consts::PI * radius_m.powi(4);
        let weight_n = vehicle.mass_kg * environment.gravity_m_s2;
        Self {
            mass_kg: vehicle.mass_kg,
            inertia_kg_m2: Vector3::from(vehicle.inertia_kg_m2),
            radius_m,
            gravity_m_s2: environment.gravity_m_s2,
            force_per_speed2,
            reference_speed_rad_s: (weight_n / (2.0 * (upper + lower) * force_per_speed2)).sqrt(),
        }
    }

    /// Accelerations by all forces and moments; the upper disc is K_u times the fly-bar.
    fn effects(&self, input: &HelicopterInput) -> [Effect; 31] {
        use Coefficient as C;
        let of = |omega_rad_s: f64| self.force_per_speed2 * omega_rad_s * omega_rad_s;
        let (up, lo) = (of(input.omega_u_rad_s), of(input.omega_l_rad_s));
        let re = of(self.reference_speed_rad_s);
        let m = 1.0 / self.mass_kg;
        let i = self.inertia_kg_m2.map(|v| self.radius_m / v);
        let by = |row, which, state, per_unit| Effect { row, which, state: Some(state), per_unit };
        let constant = |row, which, per_unit| Effect { row, which, state: None, per_unit };
        [
            by(7, C::CxAlphaU, 15, m * up),
            by(8, C::CxAlphaU, 16, -m * up),
            by(7, C::CxAlphaL, 13, m * lo),
            by(8, C::CxAlphaL, 14, -m * lo),
            by(7, C::DragXy, 7, -m),
            by(8, C::DragXy, 8, -m),
            by(9, C::DragZ, 9, -m),
            constant(9, C::CzU, m * up),
            constant(9, C::CzL, m * lo),
            constant(7, C::Cx0, m * re),
            constant(8, C::Cy0, m * re),
            constant(9, C::Cz0, m * re),
            by(10, C::CmAlphaU, 16, i.x * up),
            by(11, C::CmAlphaU, 15, i.y * up),
            by(10, C::CmAlphaL, 14, i.x * lo),
            by(11, C::CmAlphaL, 13, i.y * lo),
            by(10, C::CmHub, 14, i.x * re),
            by(10, C::CmHub, 16, i.x * re),
            by(11, C::CmHub, 13, i.y * re),
            by(11, C::CmHub, 15, i.y * re),
            by(10, C::ClP, 10, i.x * re),
            by(11, C::CmQ, 11, i.y * re),
            by(12, C::CnR, 12, i.z * re),
            by(10, C::CmU, 8, -i.x * re),
            by(11, C::CmU, 7, i.y * re),
            by(11, C::CmW, 9, i.y * re),
            constant(12, C::CnUpper, i.z * up),
            constant(12, C::CnLower, i.z * lo),
            constant(10, C::Cl0, i.x * re),
            constant(11, C::Cm0, i.y * re),
            constant(12, C::Cn0, i.z * re),
        ]
    }

    /// Time derivative of a state: Euler's equations for principal axes, flapping after equation 2 of
    /// Mulyanto, Nurhakim, Muhammad (2012).
    ///
    /// The quaternion's length is drawn back to one with a time constant of one second, which does not change
    /// the attitude.
    pub fn derivative(&self, c: &Coefficients, input: &HelicopterInput, y: &StateVector) -> StateVector {
        let q = Quaternion::new(y[3], y[4], y[5], y[6]);
        let n2 = q.norm_squared();
        let velocity = Vector3::new(y[7], y[8], y[9]);
        let rates = Vector3::new(y[10], y[11], y[12]);
        let turned =
            |q: Quaternion<f64>, v: Vector3<f64>| (q * Quaternion::from_imag(v) * q.conjugate()).imag() / n2;
        let p_rate = turned(q, velocity);
        let q_rate = q * Quaternion::from_imag(rates) * 0.5 + q * (1.0 - n2) * 0.5;
        let gravity = turned(q.conjugate(), Vector3::new(0.0, 0.0, self.gravity_m_s2));
        let v_rate = gravity - rates.cross(&velocity);
        let momentum = self.inertia_kg_m2.component_mul(&rates);
        let w_rate = -rates.cross(&momentum).component_div(&self.inertia_kg_m2);
        let (tau_l, tau_f) = (c.get(Coefficient::TauLower), c.get(Coefficient::TauFlybar));
        let kb = c.get(Coefficient::SwashplateGain);
        let mut out = [
            p_rate.x,
            -p_rate.y,
            -p_rate.z,
            q_rate.w,
            q_rate.i,
            q_rate.j,
            q_rate.k,
            v_rate.x,
            v_rate.y,
            v_rate.z,
            w_rate.x,
            w_rate.y,
            w_rate.z,
            (kb * input.delta_lon_rad - y[13]) / tau_l - y[11],
            (kb * input.delta_lat_rad - y[14]) / tau_l - y[10],
            -y[15] / tau_f - y[11],
            -y[16] / tau_f - y[10],
        ];
        for Effect { row, which, state, per_unit } in self.effects(input) {
            out[row] += per_unit * c.get(which) * state.map_or(1.0, |k| c.disc_per_state(k) * y[k]);
        }
        out
    }
}

mod tests;
