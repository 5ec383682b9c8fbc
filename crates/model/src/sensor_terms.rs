//! Terms that no file names: scales and offsets of sensors.

use crate::model::{Model, Parameter};
use crate::unit::Unit;

impl Model {
    /// This model with a scale and an offset of each of its sensors: it shows (1 + scale) times what the file says, plus the
    /// offset, as a sensor does whose calibration is not exact (Klein & Morelli 2006, section 10.2).
    ///
    /// The new parameters come after all others, two a sensor, are fixed at zero, so that the sensors show what they did, and
    /// are candidates ([`Parameter::candidate`]). What the file says already in another way is not left out.
    #[must_use]
    pub fn with_sensor_terms(&self) -> Self {
        let mut out = self.clone();
        for k in 0..out.sensors.len() {
            let term = |what: &str, unit| {
                let explains = format!("{what} of {}", self.sensors[k].name);
                Parameter::of_candidate(explains.clone(), unit, explains)
            };
            let scale = out.add_candidate(term("a scale", Some(Unit::ONE)));
            let offset = out.add_candidate(term("an offset", self.sensors[k].unit));
            let shown = out.nodes.sensors[k];
            let more = out.graph.multiply(scale, shown);
            let scaled = out.graph.add(shown, more);
            out.nodes.sensors[k] = out.graph.add(scaled, offset);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Body, Dynamics};

    #[test]
    fn a_scale_and_an_offset_act_as_they_say_and_at_zero_not_at_all() {
        let text = "schema = 2\nname = \"m\"\n[inputs]\nf = { unit = \"N\" }\n[forces]\nx = \"f\"\n[outputs]\n\
                    gyro = { unit = \"rad/s\", std = 0.01, value = \"q\" }\n";
        let model = Model::parse("m", text).expect("a model");
        let with_terms = model.with_sensor_terms();
        let places = model.parameters.len()..with_terms.parameters.len();
        assert_eq!(places.len(), 2);
        let body = Body {
            mass_kg: 2.0,
            inertia_kg_m2: [0.02, 0.03, 0.04, 0.0, 0.0, 0.0],
            gravity_m_s2: 9.81,
            air_density_kg_m3: 1.2,
        };
        let mut values = with_terms.values(&body, |_| None);
        let mut state = vec![0.0; with_terms.state_count()];
        (state[3], state[11]) = (1.0, 0.5);
        let shown = |values: &[f64]| {
            let dynamics = Dynamics::with_sensors(&with_terms, values, &[]);
            let mut evaluation = dynamics.with(&[]);
            evaluation.set_inputs(&[0.0]);
            let mut out = [0.0];
            evaluation.sense(&state, &mut out);
            out[0]
        };
        let before = shown(&values);
        values[places.start] = 0.02;
        values[places.start + 1] = 0.1;
        let after = shown(&values);
        assert!(before == 0.5 && (after - (1.02 * 0.5 + 0.1)).abs() < 1e-15, "{before} {after}");
    }
}
