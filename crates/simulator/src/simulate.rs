//! Integration of the equations of motion.

use crate::{SimulatorError, true_coefficients};
use differential_equations::prelude::{ExplicitRungeKutta, IVP, ODE};
use mavsight_flight::{
    Airframe, Coefficients, FLIGHT_STATES, FlapState, HelicopterInput, InputSeries, StateVector, Vehicle,
};
use mavsight_geometry::{EulerAngles, Isometry3, world_from_body};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Relative and absolute tolerance of the integrator, far below what cameras can see (1e-10 m, 1e-10 rad).
const TOLERANCE: f64 = 1e-10;
/// Samples and output times nearer than this are one.
const SAME_TIME_S: f64 = 1e-9;
/// Names of the entries of a [`StateVector`].
const STATE_NAMES: [&str; FLIGHT_STATES] = [
    "x_m",
    "y_m",
    "z_m",
    "the attitude",
    "the attitude",
    "the attitude",
    "the attitude",
    "u_m_s",
    "v_m_s",
    "w_m_s",
    "p_rad_s",
    "q_rad_s",
    "r_rad_s",
    "alpha_l_rad",
    "beta_l_rad",
    "alpha_f_rad",
    "beta_f_rad",
];

/// Where a flight begins.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InitialState {
    /// Body origin in the world, metres.
    pub position_in_world_m: Vector3<f64>,
    /// Attitude.
    pub attitude: EulerAngles,
    /// Velocity in body axes, m/s.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// Flapping.
    pub flap: FlapState,
}

impl InitialState {
    /// The state as the equations of motion take it, in the order of [`mavsight_flight::FLIGHT_STATES`].
    pub fn packed(&self) -> StateVector {
        let (p, v, w, f) = (self.position_in_world_m, self.velocity_in_body_m_s, self.rates_rad_s, self.flap);
        let q = self.attitude.level_from_body();
        #[rustfmt::skip]
        let packed = [
            p.x, p.y, p.z, q.w, q.i, q.j, q.k, v.x, v.y, v.z, w.x, w.y, w.z,
            f.alpha_l_rad, f.beta_l_rad, f.alpha_f_rad, f.beta_f_rad,
        ];
        packed
    }
}

/// The aircraft at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FlightState {
    /// Time.
    pub t_s: f64,
    /// Body origin in the world, metres.
    pub position_in_world_m: Vector3<f64>,
    /// Attitude.
    pub attitude: EulerAngles,
    /// u, v, w.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// Flapping.
    pub flap: FlapState,
    /// u̇, v̇, ẇ.
    pub velocity_rate_m_s2: Vector3<f64>,
    /// ṗ, q̇, ṙ.
    pub angular_acceleration_rad_s2: Vector3<f64>,
}

impl FlightState {
    /// The pose of the body in the world.
    pub fn pose(&self) -> Isometry3<f64> {
        world_from_body(self.position_in_world_m, self.attitude)
    }

    /// The state without its time and accelerations: where another flight may begin.
    pub fn as_start(&self) -> InitialState {
        let Self { position_in_world_m, attitude, velocity_in_body_m_s, rates_rad_s, flap, .. } = *self;
        InitialState { position_in_world_m, attitude, velocity_in_body_m_s, rates_rad_s, flap }
    }
}

/// The equations of motion of one vehicle.
struct Model {
    airframe: Airframe,
    coefficients: Coefficients,
}

struct Segment<'a> {
    model: &'a Model,
    input: HelicopterInput,
    end_s: f64,
}

impl ODE<f64, StateVector> for Segment<'_> {
    fn diff(&self, _t: f64, y: &StateVector, dydt: &mut StateVector) {
        *dydt = self.model.airframe.derivative(&self.model.coefficients, &self.input, y);
    }
}

/// Flies the vehicle through the inputs and reports its state at increasing `times_s`, the first of which is
/// the start.
///
/// Integrates [`Airframe::derivative`] with [`true_coefficients`]. The inputs step at their samples, so each
/// stretch between a sample or an output time and the next is integrated by itself (Dormand-Prince 8(5,3),
/// adaptive, tolerance 1e-10; Hairer, Nørsett & Wanner 1993, section II.5).
///
/// # Errors
/// A vehicle that is not valid, a start that is not finite, times that do not increase, inputs that do not
/// cover them, a state that diverges.
pub fn simulate(
    vehicle: &Vehicle,
    inputs: &InputSeries,
    start: &InitialState,
    times_s: &[f64],
) -> Result<Vec<FlightState>, SimulatorError> {
    let mut out = Vec::with_capacity(times_s.len());
    let Some(&first_s) = times_s.first() else { return Ok(out) };
    let mut y = start.packed();
    if let Some(k) = y.iter().position(|v| !v.is_finite()) {
        return Err(SimulatorError::StartNotFinite { what: STATE_NAMES[k], value: y[k] });
    }
    let airframe = Airframe::of_vehicle(vehicle)?;
    let coefficients = true_coefficients(vehicle, airframe.reference_speed_rad_s());
    let model = Model { airframe, coefficients };
    let series = HelicopterInput::series(inputs)?;
    let mut input = HelicopterInput::require(&series, inputs, first_s)?;
    // Samples before this are past.
    let mut next = series.partition_point(|s| s.t_s <= first_s + SAME_TIME_S);
    out.push(model.state_at(&input, &y));
    for pair in times_s.windows(2) {
        if pair[1] <= pair[0] || pair[1].is_nan() {
            return Err(SimulatorError::OutputTimes { t_s: pair[1], before_s: pair[0] });
        }
        let end = HelicopterInput::require(&series, inputs, pair[1])?;
        let ahead = &series[next..];
        let before_end = ahead.iter().take_while(|s| s.t_s < pair[1] - SAME_TIME_S).count();
        for knot in ahead[..before_end].iter().copied().chain([end]) {
            y = Segment { model: &model, input, end_s: knot.t_s }.advance(y)?;
            input = knot;
        }
        let at_end = ahead[before_end..].iter().take_while(|s| s.t_s <= pair[1] + SAME_TIME_S).count();
        next += before_end + at_end;
        out.push(model.state_at(&input, &y));
    }
    Ok(out)
}

impl Segment<'_> {
    fn advance(&self, y: StateVector) -> Result<StateVector, SimulatorError> {
        let (from_s, to_s) = (self.input.t_s, self.end_s);
        let broken = |detail: String| SimulatorError::Integration { t_s: from_s, detail };
        let solution = IVP::ode(self, from_s, to_s, y)
            .method(ExplicitRungeKutta::dop853().rtol(TOLERANCE).atol(TOLERANCE).h0(to_s - from_s))
            .solve()
            .map_err(|e| broken(format!("{e:?}").chars().take(80).collect()))?;
        let end = solution.y.last().copied().ok_or_else(|| broken("no step".to_owned()))?;
        if end.iter().all(|v| v.is_finite()) {
            Ok(end)
        } else {
            Err(broken("the state is not finite".to_owned()))
        }
    }
}

impl Model {
    fn state_at(&self, input: &HelicopterInput, y: &StateVector) -> FlightState {
        let rates = self.airframe.derivative(&self.coefficients, input, y);
        let level_from_body = UnitQuaternion::from_quaternion(Quaternion::new(y[3], y[4], y[5], y[6]));
        let vector =
            |values: &StateVector, at: usize| Vector3::new(values[at], values[at + 1], values[at + 2]);
        FlightState {
            t_s: input.t_s,
            position_in_world_m: vector(y, 0),
            attitude: EulerAngles::from_level_from_body(&level_from_body),
            velocity_in_body_m_s: vector(y, 7),
            rates_rad_s: vector(y, 10),
            flap: FlapState { alpha_l_rad: y[13], beta_l_rad: y[14], alpha_f_rad: y[15], beta_f_rad: y[16] },
            velocity_rate_m_s2: vector(&rates, 7),
            angular_acceleration_rad_s2: vector(&rates, 10),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use approx::assert_relative_eq;
    use mavsight_flight::{FlightError, hover_rotor_speed_rad_s};

    fn hover_inputs(vehicle: &Vehicle, end_s: f64) -> InputSeries {
        let omega = hover_rotor_speed_rad_s(vehicle);
        let sample =
            |t_s| HelicopterInput { t_s, omega_u_rad_s: omega, omega_l_rad_s: omega, ..Default::default() };
        HelicopterInput::recorded(&[sample(0.0), sample(end_s)]).expect("valid")
    }

    #[test]
    fn hover_stands_still() {
        let vehicle = Vehicle::paper();
        let end = simulate(&vehicle, &hover_inputs(&vehicle, 20.0), &InitialState::default(), &[0.0, 20.0])
            .expect("a flight")[1];
        assert!(end.position_in_world_m.norm() < 1e-8, "{}", end.position_in_world_m);
        assert!(end.rates_rad_s.norm() < 1e-9);
    }

    #[test]
    fn falls_as_galileo_says_when_the_rotors_stop() {
        let vehicle = Vehicle::paper();
        let still = |t_s| HelicopterInput { t_s, ..Default::default() };
        let inputs = HelicopterInput::recorded(&[still(0.0), still(1.0)]).expect("valid");
        let end = simulate(&vehicle, &inputs, &InitialState::default(), &[0.0, 1.0]).expect("a flight")[1];
        assert_relative_eq!(end.position_in_world_m.z, -9.804 / 2.0, epsilon = 1e-9);
    }

    #[test]
    fn a_free_body_keeps_its_angular_momentum() {
        let mut vehicle = Vehicle::paper();
        vehicle.assumption.roll_damping_n_m_s_rad = 0.0;
        vehicle.assumption.pitch_damping_n_m_s_rad = 0.0;
        vehicle.assumption.yaw_damping_n_m_s_rad = 0.0;
        let still = |t_s| HelicopterInput { t_s, ..Default::default() };
        let inputs = HelicopterInput::recorded(&[still(0.0), still(3.0)]).expect("valid");
        let start = InitialState { rates_rad_s: Vector3::new(2.0, 3.0, 4.0), ..Default::default() };
        let states = simulate(&vehicle, &inputs, &start, &[0.0, 1.3, 3.0]).expect("a flight");
        let momentum = |s: &FlightState| {
            s.attitude.level_from_body() * Vector3::from(vehicle.inertia_kg_m2).component_mul(&s.rates_rad_s)
        };
        for s in &states[1..] {
            assert_relative_eq!(momentum(s), momentum(&states[0]), epsilon = 1e-9);
        }
    }

    #[test]
    fn flybar_and_rotor_decay_with_their_time_constants() {
        let mut vehicle = Vehicle::paper();
        vehicle.rotor.thrust_coefficient_upper = 1e-12;
        vehicle.rotor.thrust_coefficient_lower = 1e-12;
        let still =
            |t_s| HelicopterInput { t_s, omega_u_rad_s: 1.0, omega_l_rad_s: 1.0, ..Default::default() };
        let inputs = HelicopterInput::recorded(&[still(0.0), still(1.0)]).expect("valid");
        let flap = FlapState { alpha_l_rad: 0.1, beta_l_rad: -0.1, alpha_f_rad: 0.2, beta_f_rad: 0.05 };
        let start = InitialState { flap, ..Default::default() };
        let end = simulate(&vehicle, &inputs, &start, &[0.0, 0.1]).expect("a flight")[1].flap;
        assert_relative_eq!(end.alpha_l_rad, 0.1 * (-0.1_f64 / 0.05).exp(), epsilon = 1e-8);
        assert_relative_eq!(end.beta_l_rad, -0.1 * (-0.1_f64 / 0.05).exp(), epsilon = 1e-8);
        assert_relative_eq!(end.alpha_f_rad, 0.2 * (-0.1_f64 / 3.0).exp(), epsilon = 1e-8);
        assert_relative_eq!(end.beta_f_rad, 0.05 * (-0.1_f64 / 3.0).exp(), epsilon = 1e-8);
    }

    #[test]
    fn the_papers_doublet_pitches_and_travels() {
        let vehicle = Vehicle::paper();
        let scenario = Scenario::paper();
        let inputs = scenario.inputs(&vehicle).expect("inputs");
        let states =
            simulate(&vehicle, &inputs, &scenario.start(), &scenario.frame_times_s()).expect("a flight");
        assert_eq!(states.len(), 300);
        let least = states.iter().map(|s| s.attitude.theta_rad).fold(f64::MAX, f64::min);
        assert!(least < -0.05, "swash-plate forward lowers the nose: {least}");
        assert!(
            states.iter().all(|s| s.attitude.phi_rad.abs() < 1e-9),
            "longitudinal motion remains longitudinal"
        );
    }

    #[test]
    fn inputs_that_end_early_are_refused() {
        let vehicle = Vehicle::paper();
        let refused = simulate(&vehicle, &hover_inputs(&vehicle, 1.0), &InitialState::default(), &[0.0, 2.0]);
        assert!(
            matches!(refused, Err(SimulatorError::Flight(FlightError::InputsDoNotCover { .. }))),
            "{refused:?}"
        );
    }

    #[test]
    fn a_start_that_is_no_number_is_refused_by_name() {
        let vehicle = Vehicle::paper();
        let inputs = hover_inputs(&vehicle, 2.0);
        let mut starts = [InitialState::default(); 3];
        starts[0].rates_rad_s.y = f64::NAN;
        starts[1].attitude.theta_rad = f64::NAN;
        starts[2].flap.beta_f_rad = f64::INFINITY;
        for (start, part) in starts.iter().zip(["q_rad_s", "the attitude", "beta_f_rad"]) {
            let refused = simulate(&vehicle, &inputs, start, &[0.0, 1.0]);
            assert!(
                matches!(refused, Err(SimulatorError::StartNotFinite { what, .. }) if what == part),
                "{part}: {refused:?}"
            );
        }
    }

    #[test]
    fn samples_between_output_times_act_once_each() {
        let vehicle = Vehicle::paper();
        let omega = hover_rotor_speed_rad_s(&vehicle);
        let sample = |k: usize| HelicopterInput {
            t_s: 0.01 * k as f64,
            omega_u_rad_s: omega,
            omega_l_rad_s: omega,
            delta_lon_rad: 0.05 * (0.2 * k as f64).sin(),
            delta_lat_rad: 0.0,
        };
        let samples: Vec<HelicopterInput> = (0..=200).map(sample).collect();
        let inputs = HelicopterInput::recorded(&samples).expect("valid");
        let fine: Vec<f64> = (0..=400).map(|k| 0.005 * k as f64).collect();
        let fly = |t_s: &[f64]| {
            let states = simulate(&vehicle, &inputs, &InitialState::default(), t_s).expect("a flight");
            *states.last().expect("an end")
        };
        let (all, few) = (fly(&fine), fly(&[0.0, 0.0333, 1.2345, 2.0]));
        assert_relative_eq!(all.position_in_world_m, few.position_in_world_m, epsilon = 1e-9);
        assert_relative_eq!(all.rates_rad_s, few.rates_rad_s, epsilon = 1e-8);
    }
}
