//! Flights of the simulated aircraft, as exact motion and as noisy poses behind the smoother.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{UnitQuaternion, Vector3, world_from_body};
use mavsight_pose::{Motion, MotionSample, PoseEstimate, PoseSample, smooth};
use mavsight_random::Random;
use mavsight_simulator::{FlightState, Maneuver, Scenario, simulate, true_values};
use nalgebra::{Matrix6, Translation3};

pub(crate) struct Flown {
    pub(crate) vehicle: Vehicle,
    pub(crate) inputs: InputSeries,
    pub(crate) states: Vec<FlightState>,
}

pub(crate) fn fly(scenario: &Scenario, vehicle: Vehicle) -> Flown {
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let start = scenario.start(&vehicle).expect("a start");
    let states = simulate(&vehicle, &inputs, &start, &scenario.frame_times_s()).expect("a flight");
    Flown { vehicle, inputs, states }
}

/// A multisine of its own harmonics on each named channel, so that no input is another's combination.
pub(crate) fn multisine(channels: &[(&str, f64)]) -> Scenario {
    let maneuver = channels
        .iter()
        .enumerate()
        .map(|(k, (channel, amplitude))| Maneuver::Multisine {
            channel: (*channel).to_owned(),
            start_s: 0.0,
            length_s: 10.0,
            harmonics: (0..8).map(|i| 2 + k as u32 + 4 * i).collect(),
            amplitude: *amplitude,
        })
        .collect();
    Scenario { maneuver, ..Scenario::paper() }
}

/// Equation 3 with thrusts as the forces have them: products of rotor speed and flapping angle.
pub(crate) const PRODUCTS: &str = r#"
schema = 1
name = "tipped discs"
[[output]]
name = "C_X"
measured = "force_x"
scale = "rotor"
regressors = ["1", "kappa_u*alpha_u", "kappa_l*alpha_l"]
[[output]]
name = "C_Z"
measured = "force_z"
scale = "rotor"
regressors = ["kappa_u", "kappa_l"]
[[output]]
name = "C_m"
measured = "moment_y"
scale = "rotor"
regressors = ["1", "kappa_u*alpha_u", "kappa_l*alpha_l", "q"]
"#;

pub(crate) fn longitudinal_multisine() -> Scenario {
    multisine(&[("delta_lon", 3.0), ("omega_u", 2.0), ("omega_l", 2.0)])
}

/// Coefficients of the simulation, as equation 3 has them.
pub(crate) struct Coefficients {
    pub(crate) cx_alpha_u: f64,
    pub(crate) cx_alpha_l: f64,
    pub(crate) cz_hover: f64,
    pub(crate) cm_alpha_u: f64,
    pub(crate) cm_alpha_l: f64,
    pub(crate) cm_q: f64,
    pub(crate) cn_l: f64,
}

impl Coefficients {
    pub(crate) fn of(vehicle: &Vehicle) -> Self {
        let truth = true_values(vehicle);
        Self {
            cx_alpha_u: truth["C_X,alpha_u"],
            cx_alpha_l: truth["C_X,alpha_l"],
            cz_hover: truth["C_Z,u"] + truth["C_Z,l"],
            cm_alpha_u: truth["C_m,alpha_u"] + truth["C_m,hub"],
            cm_alpha_l: truth["C_m,alpha_l"] + truth["C_m,hub"],
            cm_q: truth["C_m,q"],
            cn_l: truth["C_n,l"],
        }
    }
}

/// What the model of [`PRODUCTS`] is in truth, by output and parameter.
pub(crate) fn multisine_truth(vehicle: &Vehicle) -> [(&'static str, &'static str, f64); 7] {
    let c = Coefficients::of(vehicle);
    [
        ("C_X", "kappa_u*alpha_u", c.cx_alpha_u),
        ("C_X", "kappa_l*alpha_l", c.cx_alpha_l),
        ("C_Z", "kappa_u", c.cx_alpha_u),
        ("C_Z", "kappa_l", c.cx_alpha_l),
        ("C_m", "kappa_u*alpha_u", c.cm_alpha_u),
        ("C_m", "kappa_l*alpha_l", c.cm_alpha_l),
        ("C_m", "q", c.cm_q),
    ]
}

impl Flown {
    /// The states as a smoother without error would give them.
    pub(crate) fn exact_motion(&self) -> Motion {
        let gravity_m_s2 = self.vehicle.environment.gravity_m_s2;
        let sample = |s: &FlightState| {
            let gravity_in_body =
                s.attitude.level_from_body().inverse() * Vector3::new(0.0, 0.0, gravity_m_s2);
            MotionSample {
                t_ns: (s.t_s * 1e9).round() as i64,
                world_from_body: world_from_body(s.position_in_world_m, s.attitude),
                velocity_in_body_m_s: s.velocity_in_body_m_s,
                rates_rad_s: s.rates_rad_s,
                specific_force_m_s2: s.velocity_rate_m_s2 + s.rates_rad_s.cross(&s.velocity_in_body_m_s)
                    - gravity_in_body,
                angular_acceleration_rad_s2: s.angular_acceleration_rad_s2,
                covariance: mavsight_pose::MotionCovariance::default(),
            }
        };
        Motion {
            samples: self.states.iter().map(sample).collect(),
            unknown_ns: Vec::new(),
            doubts: mavsight_pose::Doubts::default(),
            // Beyond any sampling rate: nothing was low-passed.
            translation_bandwidth_hz: 1e6,
            rotation_bandwidth_hz: 1e6,
            sample_interval_s: self.states[1].t_s - self.states[0].t_s,
        }
    }

    /// Poses with white noise, as the cameras of the paper leave it: 0.6 mm and 0.08 degrees an axis by
    /// default.
    pub(crate) fn poses(
        &self,
        position_std_m: f64,
        turn_std_rad: f64,
        random: &mut Random,
    ) -> Vec<PoseSample> {
        let mut covariance = Matrix6::zeros();
        for k in 0..3 {
            covariance[(k, k)] = position_std_m.powi(2);
            covariance[(3 + k, 3 + k)] = turn_std_rad.powi(2);
        }
        let mut error = |std: f64| Vector3::from_fn(|_, _| std * random.normal());
        self.states
            .iter()
            .map(|s| {
                let mut pose = world_from_body(s.position_in_world_m, s.attitude);
                pose.translation = Translation3::from(pose.translation.vector + error(position_std_m));
                pose.rotation *= UnitQuaternion::from_scaled_axis(error(turn_std_rad));
                PoseSample {
                    t_ns: (s.t_s * 1e9).round() as i64,
                    estimate: Ok(PoseEstimate::new(pose, &covariance)),
                }
            })
            .collect()
    }

    pub(crate) fn noisy_motion(&self, random: &mut Random) -> Motion {
        let poses = self.poses(0.4e-3, 1.4e-3, random);
        smooth(&poses, self.vehicle.environment.gravity_m_s2).expect("a motion")
    }
}
