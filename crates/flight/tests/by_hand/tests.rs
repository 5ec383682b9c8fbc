use super::*;
use proptest::prelude::*;

fn state(x: &[f64]) -> StateVector {
    std::array::from_fn(|k| match k {
        3 => 0.8 + 0.2 * x[3],
        4..=6 => 0.4 * x[k],
        13..=16 => 0.2 * x[k],
        _ => 2.0 * x[k],
    })
}

fn input() -> HelicopterInput {
    HelicopterInput { omega_u_rad_s: 205.0, omega_l_rad_s: 222.0, delta_lon_rad: 0.07, delta_lat_rad: -0.04 }
}

/// Values of the size that a small helicopter has, none of them zero.
fn coefficients() -> Coefficients {
    use Coefficient as C;
    let mut c = Coefficients { values: [3e-4; COEFFICIENTS] };
    for (which, value) in [
        (C::CxAlphaU, -0.014),
        (C::CxAlphaL, -0.010),
        (C::CzU, -0.014),
        (C::CzL, -0.010),
        (C::CmAlphaU, 0.011),
        (C::CmAlphaL, 0.005),
        (C::CmHub, 0.002),
        (C::TauLower, 0.05),
        (C::TauFlybar, 3.0),
        (C::SwashplateGain, 0.8),
        (C::FlybarGain, 0.7),
    ] {
        c.set(which, value);
    }
    c
}

proptest! {
    #[test]
    fn derivatives_match_numeric_ones(x in proptest::collection::vec(-1.0..1.0, 17)) {
        let airframe = Airframe::of_vehicle(&Vehicle::paper());
        let c = coefficients();
        let y = state(&x);
        let exact = airframe.linearise(&c, &input(), &y);
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
