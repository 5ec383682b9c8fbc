//! Many flights of one manoeuvre that differ in the noise of the cameras: how far estimates stray, and how
//! far they say so.

use crate::aircraft::Flown;
use mavsight_identify::{
    Bandwidth, EquationFile, Estimator, FitOptions, Options, coefficients, identify_with,
};
use mavsight_random::Random;

/// One parameter by one estimator over all flights.
pub(crate) struct Tally {
    pub(crate) estimator: Estimator,
    pub(crate) output: String,
    pub(crate) parameter: String,
    pub(crate) truth: f64,
    estimates: Vec<(f64, f64)>,
    held: usize,
}

impl Tally {
    fn runs(&self) -> f64 {
        self.estimates.len() as f64
    }

    /// Share of the 95 % intervals that hold the truth.
    pub(crate) fn coverage(&self) -> f64 {
        self.held as f64 / self.runs()
    }

    pub(crate) fn bias(&self) -> f64 {
        self.estimates.iter().map(|(value, _)| value - self.truth).sum::<f64>() / self.runs()
    }

    pub(crate) fn spread(&self) -> f64 {
        let mean = self.truth + self.bias();
        let squares: f64 = self.estimates.iter().map(|(value, _)| (value - mean).powi(2)).sum();
        (squares / (self.runs() - 1.0)).sqrt()
    }

    /// Predicted over achieved standard deviation.
    pub(crate) fn ratio(&self) -> f64 {
        let predicted = self.estimates.iter().map(|(_, std)| std * std).sum::<f64>() / self.runs();
        predicted.sqrt() / self.spread()
    }
}

/// Flies `runs` times by every estimator; `truth` is by output and parameter.
pub(crate) fn tally(
    flown: &Flown,
    model: &str,
    truth: &[(&str, &str, f64)],
    estimators: &[Estimator],
    runs: u64,
) -> Vec<Tally> {
    let equations = Some(EquationFile::parse("products.toml", model).expect("equations"));
    let options = Options { equations, bandwidth: Bandwidth::Automatic, ..Options::default() };
    let choice = FitOptions { estimators: estimators.to_vec(), ..FitOptions::default() };
    let fly = |run: u64| {
        let motion = flown.noisy_motion(&mut Random::new(5, run));
        let table = coefficients(&motion, &flown.inputs, &flown.vehicle, &options).expect("a table");
        identify_with(&table, &choice).expect("fits")
    };
    let half = |first: u64| (first..runs).step_by(2).map(fly).collect::<Vec<_>>();
    let flights = std::thread::scope(|scope| {
        let other = scope.spawn(|| half(1));
        let mut flights = half(0);
        flights.extend(other.join().expect("a thread that ends"));
        flights
    });
    let mut tallies = Vec::new();
    for estimator in estimators {
        for (output, parameter, truth) in truth {
            let mut tally = Tally {
                estimator: *estimator,
                output: (*output).to_owned(),
                parameter: (*parameter).to_owned(),
                truth: *truth,
                estimates: Vec::new(),
                held: 0,
            };
            for found in &flights {
                let fit = found.fit(output, *estimator).expect("a fit");
                let p = fit.parameters.iter().find(|p| p.name == *parameter).expect("a parameter");
                tally.estimates.push((p.value.expect("a value"), p.std.expect("a deviation")));
                let (low, high) = (p.ci_low.expect("an interval"), p.ci_high.expect("an interval"));
                tally.held += usize::from(low <= *truth && *truth <= high);
            }
            tallies.push(tally);
        }
    }
    tallies
}

/// Prints one line a parameter.
pub(crate) fn print(tallies: &[Tally]) {
    println!(
        "estimator,parameter,truth,bias_percent,spread_percent,predicted_over_achieved,coverage_percent"
    );
    for t in tallies {
        let percent = |v: f64| 100.0 * v / t.truth.abs();
        println!(
            "{},{}:{},{:.4e},{:+.2},{:.2},{:.2},{:.1}",
            t.estimator.name(),
            t.output,
            t.parameter,
            t.truth,
            percent(t.bias()),
            percent(t.spread()),
            t.ratio(),
            100.0 * t.coverage()
        );
    }
}
