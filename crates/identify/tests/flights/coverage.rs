//! Intervals against the truth of many simulated flights.

use crate::aircraft::{Flown, fly};
use crate::{PRODUCTS, longitudinal_multisine};
use mavsight_flight::{Scenario, Vehicle, hover_rotor_speed_rad_s, model_coefficients};
use mavsight_identify::{Bandwidth, Estimator, FitOptions, Model, Options, coefficients, identify_with};

struct Tally {
    name: String,
    truth: f64,
    runs: f64,
    held: f64,
    error: f64,
    square: f64,
    predicted: f64,
}

fn tally(flown: &Flown, text: Option<&str>, truth: &[(&str, &str, f64)], runs: usize) -> Vec<Tally> {
    let estimators = vec![
        Estimator::LeastSquares,
        Estimator::TotalLeastSquares,
        Estimator::TotalLeastSquaresByRow,
        Estimator::FrequencyDomain,
    ];
    let mut out: Vec<Tally> = Vec::new();
    let bandwidth =
        std::env::var("BAND").ok().and_then(|b| b.parse().ok()).map_or(Bandwidth::Automatic, Bandwidth::Hz);
    let options =
        Options { bandwidth, model: text.map(|t| Model::parse(t).expect("a model")), ..Options::default() };
    let mut seed = 5;
    for _ in 0..runs {
        let motion = flown.noisy_motion(&mut seed);
        let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &options).expect("a table");
        let choice = FitOptions { estimators: estimators.clone(), ..FitOptions::default() };
        let found = identify_with(&table, &choice).expect("fits");
        if runs < 12 {
            println!(
                "{:.2} {:.2} {:?}",
                motion.translation_bandwidth_hz,
                motion.rotation_bandwidth_hz,
                table.outputs.iter().map(|o| o.bandwidth_hz).collect::<Vec<_>>()
            );
        }
        for estimator in &estimators {
            for (output, name, truth) in truth {
                let fit = found.fit(output, *estimator).expect("a fit");
                let p = fit.parameters.iter().find(|p| p.name == *name).expect("a parameter");
                let (Some(value), Some(std)) = (p.value, p.std) else { continue };
                let key = format!("{:4} {output},{name}", estimator.name());
                let at = out.iter().position(|t| t.name == key).unwrap_or_else(|| {
                    let (name, truth) = (key.clone(), *truth);
                    out.push(Tally {
                        name,
                        truth,
                        runs: 0.0,
                        held: 0.0,
                        error: 0.0,
                        square: 0.0,
                        predicted: 0.0,
                    });
                    out.len() - 1
                });
                let t = &mut out[at];
                if std::env::var("SHOW").is_ok_and(|k| k == key) {
                    println!(
                        "RUN {:+.2} {:.2} {:.2}",
                        100.0 * (value / truth - 1.0),
                        100.0 * std / truth.abs(),
                        motion.rotation_bandwidth_hz
                    );
                }
                t.runs += 1.0;
                t.error += value - truth;
                t.square += (value - truth).powi(2);
                t.predicted += std * std;
                if p.ci_low.expect("an interval") <= *truth && *truth <= p.ci_high.expect("an interval") {
                    t.held += 1.0;
                }
            }
        }
    }
    for t in &out {
        let bias = t.error / t.runs;
        let spread = (t.square / t.runs - bias * bias).max(0.0).sqrt();
        println!(
            "{:28} truth {:+.3e} bias {:+6.2} % = {:+5.2} std, spread {:5.2} %, predicted/achieved {:.2}, held {:5.1} %",
            t.name,
            t.truth,
            100.0 * bias / t.truth.abs(),
            bias / spread,
            100.0 * spread / t.truth.abs(),
            (t.predicted / t.runs).sqrt() / spread,
            100.0 * t.held / t.runs
        );
    }
    out
}

#[test]
#[ignore = "200 flights: minutes"]
fn two_hundred_flights() {
    let runs = std::env::var("RUNS").ok().and_then(|r| r.parse().ok()).unwrap_or(200);
    let vehicle = Vehicle::paper();
    let c = model_coefficients(&vehicle, hover_rotor_speed_rad_s(&vehicle));
    let truth = [
        ("C_X", "alpha_u", c.cx_alpha_u),
        ("C_X", "alpha_l", c.cx_alpha_l),
        ("C_m", "alpha_u", c.cm_alpha_u),
        ("C_m", "alpha_l", c.cm_alpha_l),
        ("C_m", "q", c.cm_q),
    ];
    let paper = fly(&Scenario::paper(), vehicle);
    println!("--- paper's manoeuvre, equation 3");
    tally(&paper, None, &truth, runs);
    let flown = fly(&longitudinal_multisine(), Vehicle::paper());
    let largest = flown.states.iter().map(|s| s.attitude.theta_rad.abs()).fold(0.0, f64::max);
    println!("--- multisine, pitch up to {:.1} degrees, products", largest.to_degrees());
    let truth = [
        ("C_X", "kappa_u*alpha_u", c.cx_alpha_u),
        ("C_X", "kappa_l*alpha_l", c.cx_alpha_l),
        ("C_Z", "kappa_u", c.cx_alpha_u),
        ("C_Z", "kappa_l", c.cx_alpha_l),
        ("C_m", "kappa_u*alpha_u", c.cm_alpha_u),
        ("C_m", "kappa_l*alpha_l", c.cm_alpha_l),
        ("C_m", "q", c.cm_q),
    ];
    tally(&flown, Some(PRODUCTS), &truth, runs);
}
