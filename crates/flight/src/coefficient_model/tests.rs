use super::*;
use crate::dynamics;
use proptest::prelude::*;

fn state(x: &[f64]) -> StateVector {
    std::array::from_fn(|k| match k {
        3 => 0.8 + 0.2 * x[3],
        4..=6 => 0.4 * x[k],
        13..=16 => 0.2 * x[k],
        _ => 2.0 * x[k],
    })
}

fn input() -> InputSample {
    InputSample {
        t_s: 0.0,
        omega_u_rad_s: 205.0,
        omega_l_rad_s: 222.0,
        delta_lon_rad: 0.07,
        delta_lat_rad: -0.04,
    }
}

fn vehicle() -> Vehicle {
    let mut vehicle = Vehicle::paper();
    vehicle.assumption.drag_n_s_m = 0.05;
    vehicle.assumption.hub_stiffness_n_m_rad = 0.3;
    vehicle
}

proptest! {
    #[test]
    fn the_vehicles_coefficients_give_the_vehicles_motion(x in proptest::collection::vec(-1.0..1.0, 17)) {
        let vehicle = vehicle();
        let airframe = Airframe::of_vehicle(&vehicle).expect("a vehicle");
        let c = Coefficients::of_vehicle(&vehicle, airframe.reference_speed_rad_s());
        let y = state(&x);
        let got = airframe.derivative(&c, &input(), &y);
        let want = dynamics::derivative(&vehicle, &input(), &y);
        for (g, w) in got.iter().zip(want) {
            prop_assert!((g - w).abs() < 1e-10 * (1.0 + w.abs()), "{g} is not {w}");
        }
    }

    #[test]
    fn derivatives_match_numeric_ones(x in proptest::collection::vec(-1.0..1.0, 17)) {
        let airframe = Airframe::of_vehicle(&vehicle()).expect("a vehicle");
        let mut c = Coefficients::of_vehicle(&vehicle(), airframe.reference_speed_rad_s());
        for which in [Coefficient::CmU, Coefficient::CmW, Coefficient::Cx0, Coefficient::Cl0, Coefficient::Cm0] {
            c.set(which, 3e-4);
        }
        let y = state(&x);
        let mut exact = Linearisation::zeros();
        airframe.linearise(&c, &input(), &y, &mut exact);
        for k in 0..FLIGHT_STATES {
            let at = |h: f64| { let mut y = y; y[k] += h; airframe.derivative(&c, &input(), &y) };
            let (a, b) = (at(1e-5), at(-1e-5));
            for row in 0..FLIGHT_STATES {
                let numeric = (a[row] - b[row]) / 2e-5;
                let got = exact.by_state[row][k];
                prop_assert!((got - numeric).abs() < 1e-6 * (1.0 + numeric.abs()), "{row} {k}: {got} {numeric}");
                prop_assert!(got == 0.0 || Linearisation::COLUMNS[row].contains(&k), "{row} {k} outside the pattern");
            }
        }
        for which in Coefficient::ALL {
            let h = 1e-4 * c.get(which).abs().max(1e-3);
            let at = |h: f64| { let mut c = c; c.set(which, c.get(which) + h); airframe.derivative(&c, &input(), &y) };
            let (a, b) = (at(h), at(-h));
            for row in 0..FLIGHT_STATES {
                let numeric = (a[row] - b[row]) / (2.0 * h);
                let got = exact.by_coefficient[row][which as usize];
                prop_assert!((got - numeric).abs() < 1e-6 * (1.0 + numeric.abs()), "{} {row}: {got} {numeric}", which.name());
            }
        }
    }
}

#[test]
fn coefficients_are_those_of_the_constant_speed_model() {
    let vehicle = Vehicle::paper();
    let omega = hover_rotor_speed_rad_s(&vehicle);
    let (got, want) = (Coefficients::of_vehicle(&vehicle, omega), crate::model_coefficients(&vehicle, omega));
    for (which, value) in [
        (Coefficient::CxAlphaU, want.cx_alpha_u),
        (Coefficient::CxAlphaL, want.cx_alpha_l),
        (Coefficient::CmAlphaU, want.cm_alpha_u),
        (Coefficient::CmAlphaL, want.cm_alpha_l),
        (Coefficient::CmQ, want.cm_q),
    ] {
        assert!((got.get(which) - value).abs() < 1e-12, "{}", which.name());
    }
    assert!((got.get(Coefficient::CzU) + got.get(Coefficient::CzL) - want.cz_hover).abs() < 1e-12);
}

#[test]
fn a_vehicle_without_mass_is_refused() {
    let mut vehicle = Vehicle::paper();
    vehicle.mass_kg = 0.0;
    assert!(matches!(Airframe::of_vehicle(&vehicle), Err(FlightError::NotPositive { .. })));
}
