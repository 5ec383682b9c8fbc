//! The values with which the simulation flies: the truth of a simulated flight.

use mavsight_flight::Vehicle;
use mavsight_model::Body;
use std::collections::BTreeMap;

/// The body that flies: the vehicle's, with what its `[simulation]` says otherwise of mass, inertia, gravity
/// and air.
fn simulated_body(vehicle: &Vehicle) -> Body {
    let own = vehicle.body();
    let or = |name: &str, known: f64| vehicle.simulation.get(name).copied().unwrap_or(known);
    let [xx, yy, zz, xy, xz, yz] = own.inertia_kg_m2;
    Body {
        mass_kg: or("mass", own.mass_kg),
        inertia_kg_m2: [
            or("I_xx", xx),
            or("I_yy", yy),
            or("I_zz", zz),
            or("I_xy", xy),
            or("I_xz", xz),
            or("I_yz", yz),
        ],
        gravity_m_s2: or("g", own.gravity_m_s2),
        air_density_kg_m3: or("rho", own.air_density_kg_m3),
    }
}

/// Values of all parameters of the vehicle's model, in its order, with which it is simulated: those of its
/// `[simulation]`, then of its `[parameters]`, then of the model's file. A value that the file computes from
/// others follows these.
///
/// This is the truth of a simulated flight: scoring reads it, no estimator may.
pub fn simulated_values(vehicle: &Vehicle) -> Vec<f64> {
    let given = |section: &BTreeMap<String, f64>, name: &str, label: &str| {
        section.get(name).or_else(|| section.get(label)).copied()
    };
    vehicle.model.values(&simulated_body(vehicle), |p| {
        let own = given(&vehicle.simulation, &p.name, &p.label);
        own.or_else(|| given(&vehicle.parameters, &p.name, &p.label))
    })
}

/// [`simulated_values`] by the labels of the parameters, and the model's derived quantities by their names.
pub fn true_values(vehicle: &Vehicle) -> BTreeMap<String, f64> {
    let (model, values) = (&vehicle.model, simulated_values(vehicle));
    let derived = model.derived_values(&values, &[]);
    let derived = model.derived.iter().zip(derived).map(|(d, (value, _))| (d.name.clone(), value));
    let own = model.parameters.iter().zip(&values).map(|(p, value)| (p.label.clone(), *value));
    derived.chain(own).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use mavsight_model::Model;
    use std::sync::Arc;

    #[test]
    fn the_papers_truth_is_that_of_the_independent_model() {
        let truth = true_values(&Vehicle::paper());
        for (label, value) in [
            ("C_X,alpha_u", -0.01436),
            ("C_X,alpha_l", -0.00996),
            ("C_Z,u", -0.01436),
            ("C_Z,l", -0.00996),
            ("C_m,alpha_u", 0.011488),
            ("C_m,alpha_l", 0.0047808),
            ("C_m,q", -2.480_620_155e-5),
            ("K_u", 0.83),
            ("mass", 0.8),
        ] {
            assert_relative_eq!(truth[label], value, epsilon = 1e-10);
        }
    }

    #[test]
    fn the_simulation_alone_reads_its_values_and_what_is_computed_follows() {
        let text = "schema = 2\nname = \"one\"\n[parameters]\na = { value = 1 }\nb = { label = \"b'\", value = \"2*a + mass\" }\n\
                    [forces]\nx = \"a*b\"\n[derived]\nproduct = \"a*b\"\n";
        let mut vehicle = Vehicle::paper();
        vehicle.model = Arc::new(Model::parse("one.toml", text).expect("a model"));
        vehicle.parameters = BTreeMap::from([("a".into(), 5.0)]);
        vehicle.simulation = BTreeMap::from([("a".into(), 7.0), ("mass".into(), 0.5)]);
        let truth = true_values(&vehicle);
        assert_eq!(truth["mass"], 0.5);
        assert_eq!((truth["a"], truth["b'"], truth["product"]), (7.0, 14.5, 101.5));
        assert_eq!(vehicle.values()[9..], [5.0, 10.8]);
        vehicle.simulation.insert("b'".into(), 1.0);
        assert_eq!(true_values(&vehicle)["product"], 7.0);
    }
}
