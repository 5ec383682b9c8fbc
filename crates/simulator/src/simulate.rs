//! Integration of the equations of motion.

use crate::packed::{Packed, Short};
use crate::{FlightState, InitialState, SimulatorError, simulated_values};
use differential_equations::prelude::{ExplicitRungeKutta, IVP, ODE};
use mavsight_flight::{FlightError, InputSeries, Vehicle};
use mavsight_model::{Dynamics, Evaluation, Start};
use std::cell::RefCell;
use std::sync::Arc;

/// Relative and absolute tolerance of the integrator, far below what cameras can see (1e-10 m, 1e-10 rad).
const TOLERANCE: f64 = 1e-10;
/// Samples and output times nearer than this are one.
const SAME_TIME_S: f64 = 1e-9;
/// A motion with a time constant below this is named as the cause where an integration breaks down.
const SHORTEST_S: f64 = 1e-3;

/// The equations of motion of a vehicle, ready for any number of flights.
#[derive(Debug, Clone)]
pub struct Simulator {
    model: Arc<mavsight_model::Model>,
    values: Vec<f64>,
    dynamics: Dynamics,
    state_columns: Vec<String>,
}

/// Flies the vehicle through the inputs and reports its state at increasing `times_s`, the first of which is
/// the start.
///
/// Integrates the vehicle's flight model with [`simulated_values`]. The inputs, columns of the series by the
/// model's names, step at their samples, so each stretch between a sample or an output time and the next is
/// integrated by itself (Dormand-Prince 8(5,3), adaptive, tolerance 1e-10; Hairer, Nørsett & Wanner 1993,
/// section II.5).
///
/// # Errors
/// A vehicle that is not valid, inputs that lack a column, a start that is not finite or of another model,
/// times that do not increase, inputs that do not cover them, a state that diverges.
pub fn simulate(
    vehicle: &Vehicle,
    inputs: &InputSeries,
    start: &InitialState,
    times_s: &[f64],
) -> Result<Vec<FlightState>, SimulatorError> {
    Simulator::new(vehicle)?.fly(inputs, start, times_s)
}

impl Simulator {
    /// Prepares the equations of a vehicle.
    ///
    /// # Errors
    /// A vehicle that is not valid.
    pub fn new(vehicle: &Vehicle) -> Result<Self, SimulatorError> {
        vehicle.validate()?;
        let values = simulated_values(vehicle);
        Ok(Self {
            dynamics: Dynamics::new(&vehicle.model, &values, &[]),
            values,
            state_columns: vehicle.state_columns(),
            model: Arc::clone(&vehicle.model),
        })
    }

    /// Flies, as [`simulate`] does.
    ///
    /// # Errors
    /// Those of [`simulate`].
    pub fn fly(
        &self,
        inputs: &InputSeries,
        start: &InitialState,
        times_s: &[f64],
    ) -> Result<Vec<FlightState>, SimulatorError> {
        let Some(&first_s) = times_s.first() else { return Ok(Vec::new()) };
        let y = self.checked(start)?;
        let columns: Vec<&str> = self.model.inputs.iter().map(|i| i.column.as_str()).collect();
        let inputs = inputs.select(&columns)?;
        let begin = Start { inputs: inputs.require(first_s)?.to_vec(), state: y };
        let motion = Motion::of(&self.dynamics);
        let flown = match Short::of(&begin.state) {
            Some(y) => Flight { y, t_s: first_s, motion }.through(&inputs, times_s),
            None => Flight { y: begin.state.clone(), t_s: first_s, motion }.through(&inputs, times_s),
        };
        flown.map_err(|error| self.explained(error, &begin))
    }

    /// Why an integration broke down, where that shows at its start: what is not finite there, or too fast.
    fn explained(&self, error: SimulatorError, begin: &Start) -> SimulatorError {
        if !matches!(error, SimulatorError::Integration { .. }) {
            return error;
        }
        let (model, values) = (&self.model, &self.values);
        let cause = model.check(values, begin);
        let cause = cause.and_then(|()| model.check_speed(values, begin, SHORTEST_S));
        cause.map_or_else(|cause| FlightError::ModelFile(cause).into(), |()| error)
    }

    fn checked(&self, start: &InitialState) -> Result<Vec<f64>, SimulatorError> {
        let (given, needed) = (start.further.len(), self.model.states.len());
        if given != needed {
            return Err(SimulatorError::FurtherStates { model: self.model.name.clone(), given, needed });
        }
        let y = start.packed();
        let Some(k) = y.iter().position(|v| !v.is_finite()) else { return Ok(y) };
        let is_attitude = (3..7).contains(&k);
        let what = if is_attitude { "the attitude".to_owned() } else { self.state_columns[k].clone() };
        Err(SimulatorError::StartNotFinite { what, value: y[k] })
    }
}

/// The equations of motion under the inputs that are set.
struct Motion<'a>(RefCell<Evaluation<'a>>);

impl<'a> Motion<'a> {
    fn of(dynamics: &'a Dynamics) -> Self {
        Self(RefCell::new(dynamics.with(&[])))
    }

    fn set_inputs(&self, inputs: &[f64]) {
        self.0.borrow_mut().set_inputs(inputs);
    }
}

impl<Y: Packed> ODE<f64, Y> for Motion<'_> {
    fn diff(&self, _t: f64, y: &Y, dydt: &mut Y) {
        self.0.borrow_mut().rates(y.values(), dydt.values_mut());
    }
}

/// A flight on its way.
struct Flight<'a, Y> {
    t_s: f64,
    y: Y,
    motion: Motion<'a>,
}

impl<Y: Packed> Flight<'_, Y> {
    /// Flies through inputs of the model's columns and reports at increasing times, the first of which is its
    /// own.
    fn through(mut self, inputs: &InputSeries, times_s: &[f64]) -> Result<Vec<FlightState>, SimulatorError> {
        let mut out = Vec::with_capacity(times_s.len());
        self.motion.set_inputs(inputs.require(self.t_s)?);
        let samples_s = inputs.times_s();
        // Samples before this are past.
        let mut next = samples_s.partition_point(|t_s| *t_s <= self.t_s + SAME_TIME_S);
        out.push(self.state());
        for pair in times_s.windows(2) {
            let (before_s, end_s) = (pair[0], pair[1]);
            if end_s <= before_s || end_s.is_nan() {
                return Err(SimulatorError::OutputTimes { t_s: end_s, before_s });
            }
            let held = inputs.require(end_s)?;
            while let Some(&sample_s) = samples_s.get(next).filter(|t_s| **t_s < end_s - SAME_TIME_S) {
                self.advance(sample_s)?;
                self.motion.set_inputs(inputs.row(next));
                next += 1;
            }
            self.advance(end_s)?;
            self.motion.set_inputs(held);
            next += samples_s[next..].iter().take_while(|t_s| **t_s <= end_s + SAME_TIME_S).count();
            out.push(self.state());
        }
        Ok(out)
    }

    /// Flies on to a time with the inputs that are set.
    fn advance(&mut self, to_s: f64) -> Result<(), SimulatorError> {
        let from_s = self.t_s;
        let broken = |detail: String| SimulatorError::Integration { t_s: from_s, detail };
        let mut solution = IVP::ode(&self.motion, from_s, to_s, self.y.clone())
            .method(ExplicitRungeKutta::dop853().rtol(TOLERANCE).atol(TOLERANCE).h0(to_s - from_s))
            .solve()
            .map_err(|e| broken(format!("{e:?}").chars().take(80).collect()))?;
        self.y = solution.y.pop().ok_or_else(|| broken("no step".to_owned()))?;
        self.t_s = to_s;
        if self.y.values().iter().all(|v| v.is_finite()) {
            Ok(())
        } else {
            Err(broken("the state is not finite".to_owned()))
        }
    }

    fn state(&self) -> FlightState {
        let y = self.y.values();
        let mut rates = vec![0.0; y.len()];
        self.motion.0.borrow_mut().rates(y, &mut rates);
        FlightState::unpacked(self.t_s, y, &rates)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use approx::assert_relative_eq;
    use mavsight_model::Model;
    use nalgebra::Vector3;
    use std::collections::BTreeMap;

    fn inputs(vehicle: &Vehicle, times_s: &[f64], row: impl Fn(usize) -> Vec<f64>) -> InputSeries {
        let names: Vec<String> = vehicle.input_columns().into_iter().map(str::to_owned).collect();
        InputSeries::new(names, times_s.to_vec(), (0..times_s.len()).flat_map(row).collect()).expect("valid")
    }

    fn hover_inputs(vehicle: &Vehicle, end_s: f64) -> InputSeries {
        inputs(vehicle, &[0.0, end_s], |_| vehicle.trim())
    }

    fn still_inputs(vehicle: &Vehicle, end_s: f64) -> InputSeries {
        inputs(vehicle, &[0.0, end_s], |_| vec![0.0; vehicle.model.inputs.len()])
    }

    fn at_rest(vehicle: &Vehicle) -> InitialState {
        InitialState::at_rest(vehicle, &vehicle.trim())
    }

    #[test]
    fn hover_stands_still() {
        let vehicle = Vehicle::paper();
        let states = simulate(&vehicle, &hover_inputs(&vehicle, 20.0), &at_rest(&vehicle), &[0.0, 20.0]);
        let end = &states.expect("a flight")[1];
        assert!(end.position_in_world_m.norm() < 1e-8, "{}", end.position_in_world_m);
        assert!(end.rates_rad_s.norm() < 1e-9);
    }

    #[test]
    fn falls_as_galileo_says_when_the_rotors_stop() {
        let vehicle = Vehicle::paper();
        let inputs = still_inputs(&vehicle, 1.0);
        let end = &simulate(&vehicle, &inputs, &at_rest(&vehicle), &[0.0, 1.0]).expect("a flight")[1];
        assert_relative_eq!(end.position_in_world_m.z, -9.804 / 2.0, epsilon = 1e-9);
    }

    #[test]
    fn a_free_body_keeps_its_angular_momentum() {
        let mut vehicle = Vehicle::paper();
        for damping in ["C_l_p", "C_m_q", "C_n_r"] {
            vehicle.simulation.insert(damping.to_owned(), 0.0);
        }
        let inputs = still_inputs(&vehicle, 3.0);
        let start = InitialState { rates_rad_s: Vector3::new(2.0, 3.0, 4.0), ..at_rest(&vehicle) };
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
        let vehicle = Vehicle::paper();
        let inputs = still_inputs(&vehicle, 1.0);
        // alpha_l, beta_l, alpha_f, beta_f.
        let further = vec![0.1, -0.1, 0.2, 0.05];
        let start = InitialState { further, ..InitialState::default() };
        let end = &simulate(&vehicle, &inputs, &start, &[0.0, 0.1]).expect("a flight")[1].further;
        assert_relative_eq!(end[0], 0.1 * (-0.1_f64 / 0.05).exp(), epsilon = 1e-8);
        assert_relative_eq!(end[1], -0.1 * (-0.1_f64 / 0.05).exp(), epsilon = 1e-8);
        assert_relative_eq!(end[2], 0.2 * (-0.1_f64 / 3.0).exp(), epsilon = 1e-8);
        assert_relative_eq!(end[3], 0.05 * (-0.1_f64 / 3.0).exp(), epsilon = 1e-8);
    }

    #[test]
    fn the_papers_doublet_pitches_and_travels() {
        let vehicle = Vehicle::paper();
        let scenario = Scenario::paper();
        let inputs = scenario.inputs(&vehicle).expect("inputs");
        let start = scenario.start(&vehicle).expect("a start");
        let states = simulate(&vehicle, &inputs, &start, &scenario.frame_times_s()).expect("a flight");
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
        let refused = simulate(&vehicle, &hover_inputs(&vehicle, 1.0), &at_rest(&vehicle), &[0.0, 2.0]);
        assert!(
            matches!(refused, Err(SimulatorError::Flight(FlightError::InputsDoNotCover { .. }))),
            "{refused:?}"
        );
    }

    #[test]
    fn a_start_that_is_no_number_is_refused_by_name() {
        let vehicle = Vehicle::paper();
        let inputs = hover_inputs(&vehicle, 2.0);
        let mut starts = [0; 3].map(|_| at_rest(&vehicle));
        starts[0].rates_rad_s.y = f64::NAN;
        starts[1].attitude.theta_rad = f64::NAN;
        starts[2].further[3] = f64::INFINITY;
        for (start, part) in starts.iter().zip(["q_rad_s", "the attitude", "beta_f_rad"]) {
            let refused = simulate(&vehicle, &inputs, start, &[0.0, 1.0]);
            assert!(
                matches!(&refused, Err(SimulatorError::StartNotFinite { what, .. }) if what == part),
                "{part}: {refused:?}"
            );
        }
    }

    #[test]
    fn samples_between_output_times_act_once_each() {
        let vehicle = Vehicle::paper();
        let times_s: Vec<f64> = (0..=200).map(|k| 0.01 * f64::from(k)).collect();
        let inputs = inputs(&vehicle, &times_s, |k| {
            let trim = vehicle.trim();
            vec![trim[0], trim[1], 0.05 * (0.2 * k as f64).sin(), 0.0]
        });
        let fine: Vec<f64> = (0..=400).map(|k| 0.005 * k as f64).collect();
        let fly = |t_s: &[f64]| {
            let states = simulate(&vehicle, &inputs, &at_rest(&vehicle), t_s).expect("a flight");
            states.last().expect("an end").clone()
        };
        let (all, few) = (fly(&fine), fly(&[0.0, 0.0333, 1.2345, 2.0]));
        assert_relative_eq!(all.position_in_world_m, few.position_in_world_m, epsilon = 1e-9);
        assert_relative_eq!(all.rates_rad_s, few.rates_rad_s, epsilon = 1e-8);
    }

    #[test]
    fn a_start_of_another_model_and_inputs_without_a_column_are_refused() {
        let vehicle = Vehicle::paper();
        let inputs = hover_inputs(&vehicle, 2.0);
        let refused =
            simulate(&vehicle, &inputs, &InitialState::default(), &[0.0, 1.0]).expect_err("no discs");
        assert!(matches!(refused, SimulatorError::FurtherStates { given: 0, needed: 4, .. }), "{refused}");
        let some = inputs.select(&["omega_u_rad_s", "delta_lat_rad"]).expect("columns");
        let refused = simulate(&vehicle, &some, &at_rest(&vehicle), &[0.0, 1.0]);
        assert!(matches!(refused, Err(SimulatorError::Flight(FlightError::MissingInput { .. }))));
    }

    fn with_model(text: &str) -> Vehicle {
        let model = Arc::new(Model::parse("test.toml", text).expect("a model"));
        Vehicle { model, parameters: BTreeMap::new(), simulation: BTreeMap::new(), ..Vehicle::paper() }
    }

    /// Quadratic drag: v = v_t tanh(g t/v_t), s = v_t²/g log cosh(g t/v_t).
    #[test]
    fn a_body_without_inputs_falls_to_its_terminal_speed() {
        let vehicle = with_model(
            "schema = 2\nname = \"ball\"\n[parameters]\nk = { unit = \"kg/m\", value = 0.1 }\n\
             [forces]\nx = \"-k*u*abs(u)\"\ny = \"-k*v*abs(v)\"\nz = \"-k*w*abs(w)\"\n",
        );
        let inputs = inputs(&vehicle, &[0.0, 3.0], |_| Vec::new());
        let states = simulate(&vehicle, &inputs, &InitialState::default(), &[0.0, 0.7, 3.0]).expect("a fall");
        let terminal_m_s = (0.8 * 9.804 / 0.1_f64).sqrt();
        for state in &states {
            let share: f64 = 9.804 * state.t_s / terminal_m_s;
            assert_relative_eq!(state.velocity_in_body_m_s.z, terminal_m_s * share.tanh(), epsilon = 1e-9);
            let fallen_m = terminal_m_s.powi(2) / 9.804 * share.cosh().ln();
            assert_relative_eq!(-state.position_in_world_m.z, fallen_m, epsilon = 1e-9);
        }
    }

    /// Lags in a row, of more states than are held in place: the k-th answers a step by the k-th gamma
    /// distribution.
    #[test]
    fn a_model_of_many_states_is_flown_as_one_of_few() {
        let lags = crate::packed::SHORT;
        let chain: String = (1..=lags)
            .map(|k| {
                let before = if k == 1 { "a".to_owned() } else { format!("x_{}", k - 1) };
                format!("x_{k} = {{ derivative = \"({before} - x_{k})/0.1\" }}\n")
            })
            .collect();
        let vehicle = with_model(&format!(
            "schema = 2\nname = \"chain\"\n[inputs]\na = {{}}\n[states]\n{chain}[forces]\nx = \"0*x_{lags}\"\n"
        ));
        let inputs = inputs(&vehicle, &[0.0, 1.0], |_| vec![1.0]);
        let start = InitialState { further: vec![0.0; lags], ..InitialState::default() };
        let end = &simulate(&vehicle, &inputs, &start, &[0.0, 0.8]).expect("a flight")[1];
        let (mut term, mut left) = ((-8.0_f64).exp(), 1.0);
        for (k, x) in end.further.iter().enumerate() {
            left -= term;
            term *= 8.0 / (k + 1) as f64;
            assert_relative_eq!(*x, left, epsilon = 1e-9);
        }
    }

    #[test]
    fn a_state_too_fast_for_the_integrator_is_an_error() {
        let vehicle = with_model(
            "schema = 2\nname = \"stiff\"\n[inputs]\na = {}\n[states]\n\
             fast = { derivative = \"(a - fast)/1e-9\" }\n[forces]\nx = \"fast\"\n",
        );
        let inputs = inputs(&vehicle, &[0.0, 1.0], |_| vec![1.0]);
        let refused = simulate(&vehicle, &inputs, &at_rest(&vehicle), &[0.0, 1.0]).expect_err("too stiff");
        assert!(refused.to_string().starts_with("test.toml, line 6"), "{refused}");
        let vehicle = with_model(
            "schema = 2\nname = \"blown up\"\n[states]\ns = { derivative = \"s^2\", initial = 2 }\n[forces]\nx = \"s\"\n",
        );
        let still = still_inputs(&vehicle, 1.0);
        let refused =
            simulate(&vehicle, &still, &at_rest(&vehicle), &[0.0, 1.0]).expect_err("infinite at 0.5 s");
        assert!(matches!(refused, SimulatorError::Integration { .. }), "{refused}");
    }
}
