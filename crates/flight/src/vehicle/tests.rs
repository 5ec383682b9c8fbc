use super::*;

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
    vehicle.marker[1].diameter_m = 50.0;
    assert!(matches!(vehicle.validate(), Err(FlightError::BallTooLarge { diameter_m: 50.0, .. })));
    let mut vehicle = Vehicle::paper();
    vehicle.inertia_kg_m2 = [1e-3, 1.0, 1e-3];
    assert!(matches!(vehicle.validate(), Err(FlightError::Inertia { .. })));
    let mut vehicle = Vehicle::paper();
    vehicle.products_of_inertia_kg_m2 = [0.0, 1.0, 0.0];
    assert!(
        matches!(vehicle.validate(), Err(FlightError::InertiaProduct { key, .. }) if key.contains("[1]"))
    );
    let mut vehicle = Vehicle::paper();
    vehicle.parameters.insert("tau_l".to_owned(), 1e-4);
    assert!(matches!(vehicle.validate(), Err(FlightError::OutOfBounds { key, .. }) if key.contains("tau_l")));
    let mut vehicle = Vehicle::paper();
    vehicle.marker.iter_mut().for_each(|m| m.position_m = [m.position_m[0], 0.5, 0.0]);
    assert!(matches!(vehicle.validate(), Err(FlightError::MarkerPlaces(_))));
    let mut vehicle = Vehicle::paper();
    vehicle.simulation.insert("d_xy".to_owned(), f64::INFINITY);
    assert!(matches!(vehicle.validate(), Err(FlightError::OutOfBounds { key, .. }) if key.ends_with("d_xy")));
    let mut vehicle = Vehicle::paper();
    vehicle.parameters.insert("tau_m".to_owned(), 1.0);
    let refused = vehicle.validate().expect_err("no such parameter").to_string();
    assert!(refused.contains("tau_m") && refused.contains("tau_l"), "{refused}");
    let mut vehicle = Vehicle::paper();
    vehicle.marker.truncate(2);
    assert_eq!(vehicle.validate(), Err(FlightError::TooFewMarkers(2)));
}

#[test]
fn a_body_that_is_not_known_exactly_is_free_in_fits_and_survives_its_file() {
    let mut vehicle = Vehicle::paper();
    assert_eq!(vehicle.model_for_fits().parameters, vehicle.model.parameters);
    (vehicle.mass_std_kg, vehicle.inertia_std_kg_m2) = (0.01, [0.0, 3e-4, 0.0]);
    assert_eq!(vehicle.validate(), Ok(()));
    let model = vehicle.model_for_fits();
    let known: Vec<_> = model.parameters.iter().take(4).map(|p| (p.freedom.clone(), p.prior_std)).collect();
    let (fixed, free) = ((Freedom::Fixed, None), |std| (Freedom::Free, Some(std)));
    assert_eq!(known, [free(0.01), fixed.clone(), free(3e-4), fixed]);
    assert_eq!(vehicle.relative_std(Axis::Force(2)), 0.01 / 0.8);
    let text = toml::to_string(&vehicle).expect("a file");
    assert_eq!(toml::from_str::<Vehicle>(&text).expect("a vehicle"), vehicle);
    for (std, key) in
        [(-1e-4, "inertia_std_kg_m2[1]"), (f64::NAN, "inertia_std_kg_m2[1]"), (7e-3, "inertia_std_kg_m2[1]")]
    {
        vehicle.inertia_std_kg_m2[1] = std;
        assert!(matches!(vehicle.validate(), Err(FlightError::OutOfBounds { key: k, .. }) if k == key));
    }
}

/// Mass, inertia, gravity and density have keys of their own; the simulation alone may have others.
#[test]
fn values_of_the_body_among_the_parameters_are_refused_with_their_keys() {
    for (name, key) in [
        ("mass", "mass_kg"),
        ("I_yy", "inertia_kg_m2[1]"),
        ("I_xz", "products_of_inertia_kg_m2[1]"),
        ("I_yz", "products_of_inertia_kg_m2[2]"),
        ("g", "environment.gravity_m_s2"),
        ("rho", "environment.air_density_kg_m3"),
    ] {
        let mut vehicle = Vehicle::paper();
        vehicle.simulation.insert(name.to_owned(), 0.9);
        assert_eq!(vehicle.validate(), Ok(()));
        vehicle.parameters.insert(name.to_owned(), 0.9);
        assert_eq!(vehicle.validate(), Err(FlightError::OfTheBody { name: name.to_owned(), key }));
    }
}

const SCHEMA_1: &str = r##"
name = "Lama 400D, modified"
mass_kg = 0.8
inertia_kg_m2 = [6.1e-3, 6.26e-3, 0.93e-3]
[[marker]]
name = "red"
position_m = [0.225, 0.225, 0.10]
diameter_m = 0.05
color = "#db1212"
[[marker]]
name = "green"
position_m = [0.225, -0.225, 0.10]
diameter_m = 0.05
color = "#12a02e"
[[marker]]
name = "blue"
position_m = [-0.225, -0.225, 0.10]
diameter_m = 0.05
color = "#1c38d0"
[[marker]]
name = "yellow"
position_m = [-0.225, 0.225, 0.10]
diameter_m = 0.05
color = "#e8c410"
[rotor]
radius_m = 0.25
thrust_coefficient_upper = 7.18e-3
thrust_coefficient_lower = 4.98e-3
flap_time_lower_s = 0.05
flap_time_flybar_s = 3.0
swashplate_gain = 0.91
flybar_gain = 0.83
[environment]
air_density_kg_m3 = 1.14
gravity_m_s2 = 9.804
"##;

#[test]
fn a_file_of_schema_1_is_the_coaxial_helicopter() {
    let vehicle: Vehicle = toml::from_str(SCHEMA_1).expect("a vehicle");
    assert!(vehicle.is_of_schema_1);
    let is_of_schema_1 = false;
    let vehicle = Vehicle { is_of_schema_1, ..vehicle };
    assert_eq!(vehicle, Vehicle::paper());
    let written = toml::to_string(&vehicle).expect("text");
    assert!(written.contains("model = \"coaxial\"") && !written.contains("rotor"), "{written}");
    assert_eq!(toml::from_str::<Vehicle>(&written).expect("a vehicle"), vehicle);
    let both = SCHEMA_1.replace("mass_kg", "model = \"coaxial\"\nmass_kg");
    let refused = toml::from_str::<Vehicle>(&both).expect_err("two schemas").to_string();
    assert!(refused.contains("rotor") && refused.contains("model"), "{refused}");
}

#[test]
fn an_unknown_model_is_refused_with_those_that_there_are() {
    let text = SCHEMA_1
        .split("[rotor]")
        .next()
        .unwrap_or_default()
        .replace("mass_kg", "model = \"glider\"\nmass_kg")
        + "[environment]\nair_density_kg_m3 = 1.2\ngravity_m_s2 = 9.81\n";
    let refused = toml::from_str::<Vehicle>(&text).expect_err("no such model").to_string();
    assert!(refused.contains("glider") && refused.contains("coaxial"), "{refused}");
    let bare = text.replace("model = \"glider\"\n", "");
    let vehicle: Vehicle = toml::from_str(&bare).expect("a rigid body");
    assert_eq!(vehicle.model.state_count(), RIGID_STATES);
    assert_eq!(vehicle.validate(), Ok(()));
}
