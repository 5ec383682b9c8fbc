//! The shelf's coaxial helicopter against the equations written by hand.
use mavsight_flight::{Airframe, Coefficient, Coefficients, FLIGHT_STATES, InputSample, StateVector, Vehicle};
use mavsight_model::{Body, Dynamics, Model};

#[test]
fn the_file_is_the_model_that_was_compiled_in() {
    let text = include_str!("../../model/shelf/coaxial.toml");
    let model = Model::parse("coaxial.toml", text).map_err(|e| e.to_string()).unwrap();
    let vehicle = Vehicle::paper();
    let i = vehicle.inertia_kg_m2;
    let body = Body {
        mass_kg: vehicle.mass_kg,
        inertia_kg_m2: [i[0], i[1], i[2], 0.0, 0.0, 0.0],
        gravity_m_s2: vehicle.environment.gravity_m_s2,
        air_density_kg_m3: vehicle.environment.air_density_kg_m3,
    };
    let airframe = Airframe::of_vehicle(&vehicle).unwrap();
    let mut c = Coefficients::default();
    let mut values = model.values(&body, |_| None);
    let mut free = Vec::new();
    for (k, which) in Coefficient::ALL.into_iter().enumerate() {
        let place = model.parameter(which.name()).unwrap_or_else(|| panic!("{}", which.name()));
        let value = match which {
            Coefficient::TauLower => 0.06,
            Coefficient::TauFlybar => 2.5,
            _ => 0.01 * (k as f64 + 1.0),
        };
        c.set(which, value);
        values[place] = value;
        free.push(place);
    }
    let dynamics = Dynamics::new(&model, &values, &free);
    let start: Vec<f64> = free.iter().map(|k| values[*k]).collect();
    let mut evaluation = dynamics.with(&start);
    let mut random = mavsight_random::Random::new(1, 0);
    let mut worst: f64 = 0.0;
    for _ in 0..1000 {
        let y: StateVector = std::array::from_fn(|k| if k == 3 { 1.0 } else { 0.0 } + 0.3 * random.normal());
        let input = InputSample {
            t_s: 0.0,
            omega_u_rad_s: 200.0 + 10.0 * random.normal(),
            omega_l_rad_s: 210.0 + 10.0 * random.normal(),
            delta_lon_rad: 0.1 * random.normal(),
            delta_lat_rad: 0.1 * random.normal(),
        };
        evaluation.set_inputs(&[input.omega_u_rad_s, input.omega_l_rad_s, input.delta_lon_rad, input.delta_lat_rad]);
        let mut out = [0.0; FLIGHT_STATES];
        evaluation.rates(&y, &mut out);
        let want = airframe.derivative(&c, &input, &y);
        let close = |a: f64, b: f64, size: f64| (a - b).abs() / (size + b.abs());
        for (a, b) in out.iter().zip(want) {
            worst = worst.max(close(*a, b, 1.0));
        }
        evaluation.linearise(&y, &mut out);
        let linear = airframe.linearise(&c, &input, &y);
        let mut by_state = [[0.0; FLIGHT_STATES]; FLIGHT_STATES];
        evaluation.by_state().for_each(|s| by_state[s.row][s.column] = s.value);
        let mut by_parameter = [[0.0; 25]; FLIGHT_STATES];
        evaluation.by_parameter().for_each(|s| by_parameter[s.row][s.column] = s.value);
        for i in 0..FLIGHT_STATES {
            for j in 0..FLIGHT_STATES {
                worst = worst.max(close(by_state[i][j], linear.by_state[i][j], 1.0));
            }
            for j in 0..25 {
                worst = worst.max(close(by_parameter[i][j], linear.by_coefficient[i][j], 1.0));
            }
        }
    }
    println!("{worst:e}");
    assert!(worst < 1e-12, "{worst:e}");
    let y: StateVector = std::array::from_fn(|k| if k == 3 { 1.0 } else { 0.1 });
    let input = InputSample { t_s: 0.0, omega_u_rad_s: 200.0, omega_l_rad_s: 210.0, delta_lon_rad: 0.1, delta_lat_rad: 0.2 };
    let time = |name: &str, f: &mut dyn FnMut()| {
        let t = std::time::Instant::now();
        (0..200_000).for_each(|_| f());
        println!("{name}: {:.0} ns", t.elapsed().as_secs_f64() * 5e3);
    };
    let mut out = [0.0; FLIGHT_STATES];
    let t = std::time::Instant::now();
    let d = Dynamics::new(&model, &values, &free);
    println!("compile {:?} {}", t.elapsed(), d.states());
    time("hand rates", &mut || { std::hint::black_box(airframe.derivative(&c, &input, std::hint::black_box(&y))); });
    time("file rates", &mut || { evaluation.rates(std::hint::black_box(&y), &mut out); });
    time("hand linear", &mut || { std::hint::black_box(airframe.linearise(&c, &input, std::hint::black_box(&y))); });
    time("file linear", &mut || { evaluation.linearise(std::hint::black_box(&y), &mut out); });
}
