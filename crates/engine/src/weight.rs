//! Thrust against weight: a mass in another unit than kilograms.

use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::{Vector3, centroid_and_spread};
use mavsight_model::{Dynamics, RIGID_STATES};
use mavsight_pipeline::{Cause, Finding};
use mavsight_pose::{Motion, MotionSample, median};

/// Samples of the motion that are looked at.
const SAMPLED: usize = 100;

/// Grams in a kilogram, and the factor within which the force of a model shows that: thrust coefficients of a
/// data sheet are right to some tens of per cent.
const GRAMS: f64 = 1000.0;
const ABOUT: f64 = 2.0;

/// Factor beyond which the forces of a model are wrong, whatever the cause: coefficients that are guessed are right within half
/// of it.
const FAR: f64 = 2.0 * ABOUT;

/// Least share of the body's size that a radius of gyration has: two thirds of a rod's are 0.29 of its length,
/// and the balls may hang on arms that are longer than what is heavy.
const COMPACT: f64 = 0.05;

/// That the forces of the vehicle's model at the recorded inputs are more than four times too small, or too large, for the mass
/// of the vehicle file; where it is about a thousand times, whether inertia and size say that it is the mass.
///
/// `None` where they are not, and where the model's forces or the specific force are too small to be
/// compared: less than half of gravity.
pub(crate) fn wrong_weight(motion: &Motion, inputs: &InputSeries, vehicle: &Vehicle) -> Option<Finding> {
    let ratio = force_ratio(motion, inputs, vehicle)?;
    if (1.0 / FAR..=FAR).contains(&ratio) {
        return None;
    }
    let is_about = |factor: f64| (factor / ABOUT..=factor * ABOUT).contains(&ratio);
    let factor = [GRAMS, 1.0 / GRAMS].into_iter().find(|f| is_about(*f)).unwrap_or(1.0);
    let places = vehicle.marker.iter().map(|m| Vector3::from(m.position_m));
    let size_m = centroid_and_spread(places.collect::<Vec<_>>().into_iter()).1 * 3f64.sqrt();
    let gyration = |mass_kg: f64| {
        let largest = vehicle.inertia_kg_m2.iter().fold(0.0_f64, |most, i| most.max(*i));
        (largest / mass_kg).sqrt() / size_m
    };
    let (given, instead) = (gyration(vehicle.mass_kg), gyration(vehicle.mass_kg / factor));
    let is_of_a_body = |share: f64| (COMPACT..=1.0 / COMPACT.sqrt()).contains(&share);
    let mass_kg = vehicle.mass_kg;
    let found = format!(
        "At the recorded inputs the model gives {:.3} times the force that carries {mass_kg} kg through the measured motion",
        1.0 / ratio
    );
    Some(if is_of_a_body(instead) && !is_of_a_body(given) {
        let note = format!(
            "{found}, and the moments of inertia are those of a body of {:.4} kg and this size: mass_kg of the vehicle file is in \
             another unit; give it in kilograms.",
            mass_kg / factor
        );
        Finding::of(Cause::Mass, None, note)
    } else {
        let note = format!(
            "{found}: mass_kg, the moments of inertia, the air's density, the model's thrust, the unit of its inputs (rev/min \
             for rad/s makes 91 times of a rotor) or that of the poses' positions is wrong by about that factor; the flight does not \
             show which."
        );
        Finding { causes: vec![], camera: None, note }
    })
}

/// Median over the flight of the measured specific force over that of the model.
fn force_ratio(motion: &Motion, inputs: &InputSeries, vehicle: &Vehicle) -> Option<f64> {
    let columns = vehicle.input_columns();
    let inputs = inputs.select(&columns).ok()?;
    let values = vehicle.values();
    let dynamics = Dynamics::new(&vehicle.model, &values, &[]);
    let gravity_m_s2 = vehicle.environment.gravity_m_s2;
    let mut rates = vec![0.0; dynamics.states()];
    let mut of = |sample: &MotionSample| {
        let own = inputs.at(sample.t_ns as f64 * 1e-9)?;
        let mut state = vec![0.0; RIGID_STATES];
        // Level and without rates: then the rates of the velocities are forces over mass, and gravity.
        state[3] = 1.0;
        state[7..10].copy_from_slice(sample.velocity_in_body_m_s.as_slice());
        state.extend(vehicle.model.initial(&values, own));
        let mut evaluation = dynamics.with(&[]);
        evaluation.set_inputs(own);
        evaluation.rates(&state, &mut rates);
        let modelled = Vector3::new(rates[7], rates[8], rates[9] - gravity_m_s2).norm();
        let measured = sample.specific_force_m_s2.norm();
        (modelled > 0.0 && measured > 0.5 * gravity_m_s2).then_some(measured / modelled)
    };
    let every = (motion.samples.len() / SAMPLED).max(1);
    let mut ratios: Vec<f64> = motion.samples.iter().step_by(every).filter_map(&mut of).collect();
    ratios.retain(|r| r.is_finite());
    median(ratios)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{Isometry3, Vector3};
    use mavsight_pose::{Doubts, MotionCovariance};

    /// The paper's helicopter in hover, with a file that says what `change` makes of it.
    fn found(change: impl Fn(&mut Vehicle)) -> Option<Finding> {
        let mut vehicle = Vehicle::paper();
        let (hover, gravity_m_s2) = (vehicle.trim(), vehicle.environment.gravity_m_s2);
        let sample = |k: i64| MotionSample {
            t_ns: k * 10_000_000,
            world_from_body: Isometry3::identity(),
            velocity_in_body_m_s: Vector3::zeros(),
            rates_rad_s: Vector3::zeros(),
            specific_force_m_s2: Vector3::new(0.0, 0.0, -gravity_m_s2),
            angular_acceleration_rad_s2: Vector3::zeros(),
            covariance: MotionCovariance::default(),
        };
        let motion = Motion {
            samples: (0..50).map(sample).collect(),
            unknown_ns: vec![],
            doubts: Doubts::default(),
            translation_bandwidth_hz: 5.0,
            rotation_bandwidth_hz: 5.0,
            sample_interval_s: 0.01,
        };
        let names = vehicle.input_columns().into_iter().map(str::to_owned).collect::<Vec<_>>();
        let inputs = InputSeries::new(names, vec![0.0, 1.0], [hover.clone(), hover].concat()).unwrap();
        change(&mut vehicle);
        wrong_weight(&motion, &inputs, &vehicle)
    }

    #[test]
    fn a_mass_in_grams_is_named_where_inertia_and_size_say_so() {
        assert_eq!(found(|_| {}), None);
        assert_eq!(found(|v| v.mass_kg *= 1.5), None);
        let grams = found(|v| v.mass_kg *= 1000.0).expect("a finding");
        assert_eq!(grams.cause(), Some(Cause::Mass), "{}", grams.note);
        // All that hangs on the mass in grams: nothing parts it from the air's density.
        let both = found(|v| {
            v.mass_kg *= 1000.0;
            v.inertia_kg_m2 = v.inertia_kg_m2.map(|i| 1000.0 * i);
        });
        assert_eq!(both.map(|f| f.cause()), Some(None));
        let thin = found(|v| v.environment.air_density_kg_m3 *= 1e-3);
        assert_eq!(thin.map(|f| f.cause()), Some(None));
        // Rotor speeds in rev/min for rad/s make 91 times the thrust.
        let fast = found(|v| v.environment.air_density_kg_m3 *= 91.2).expect("a finding");
        assert!(fast.causes.is_empty() && fast.note.contains("rev/min"), "{}", fast.note);
    }
}
