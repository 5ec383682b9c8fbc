//! Parameters of several flights of one aircraft, or of several parts of one flight.

use crate::output_error::FlightFits;
use crate::{FlightEstimate, Identification, Pooled, pooled};

/// What the fits of one flight found.
#[derive(Debug, Clone, Copy)]
pub struct FittedFlight<'a> {
    /// Equation error, where there is any.
    pub equations: Option<&'a Identification>,
    /// Fits of the equations of motion.
    pub motion: &'a FlightFits,
}

/// One parameter by one estimator, over the flights that determine it.
#[derive(Debug, Clone, PartialEq)]
pub struct PooledParameter {
    /// Name of the estimator in `parameters.csv`.
    pub estimator: String,
    /// Label of the parameter, such as `C_X,alpha_u`.
    pub name: String,
    /// Unit; empty where it has none, or none is declared.
    pub unit: String,
    /// Number of the flight and its estimate.
    pub flights: Vec<(usize, FlightEstimate)>,
    /// Their mean.
    pub pooled: Pooled,
}

/// Pools each parameter that at least two flights determine ([`pooled`]), estimator by estimator, in the order in which
/// they appear. Flights are independent and take part with the parameters that they call determined. A parameter by
/// itself is pooled: correlations between parameters are not used.
pub fn pooled_parameters(flights: &[FittedFlight<'_>]) -> Vec<PooledParameter> {
    pooled_by_name(flights.iter().map(|flight| determined(flight).collect()))
}

fn pooled_by_name(flights: impl Iterator<Item = Vec<(Named, FlightEstimate)>>) -> Vec<PooledParameter> {
    let mut all: Vec<(Named, Vec<(usize, FlightEstimate)>)> = Vec::new();
    for (k, flight) in flights.enumerate() {
        for (named, estimate) in flight {
            match all.iter_mut().find(|(own, _)| *own == named) {
                Some((_, estimates)) => estimates.push((k, estimate)),
                None => all.push((named, vec![(k, estimate)])),
            }
        }
    }
    // Estimators in the order of the first flight; a parameter that a later flight alone determines goes with its own.
    let mut estimators: Vec<&'static str> = Vec::new();
    all.iter().for_each(|(named, _)| {
        if !estimators.contains(&named.estimator) {
            estimators.push(named.estimator);
        }
    });
    let place = |named: &Named| estimators.iter().position(|e| *e == named.estimator);
    all.sort_by_key(|(named, _)| place(named));
    let parameters = all.into_iter().filter_map(|(named, flights)| {
        let estimates: Vec<FlightEstimate> = flights.iter().map(|f| f.1).collect();
        let pooled = pooled(&estimates).ok()?;
        let Named { estimator, name, unit } = named;
        Some(PooledParameter { estimator: estimator.to_owned(), name, unit, flights, pooled })
    });
    parameters.collect()
}

#[derive(PartialEq)]
struct Named {
    estimator: &'static str,
    name: String,
    unit: String,
}

fn determined<'a>(flight: &FittedFlight<'a>) -> impl Iterator<Item = (Named, FlightEstimate)> + 'a {
    let equations = flight.equations.into_iter().flat_map(|i| &i.fits).flat_map(|fit| {
        fit.parameters.iter().filter(|p| p.identifiable).filter_map(|p| {
            let name = format!("{},{}", fit.output, p.name);
            let named = Named { estimator: fit.estimator.name(), name, unit: String::new() };
            let (value, std, ci_low, ci_high) = (p.value?, p.std?, p.ci_low?, p.ci_high?);
            Some((named, FlightEstimate { value, std, ci_low, ci_high }))
        })
    });
    let motion = flight.motion.named().flat_map(|(estimator, fit)| {
        let named = move |name: &str, unit: &str| Named { estimator, name: name.into(), unit: unit.into() };
        let parameters = fit.parameters.iter().filter(|p| p.identifiable).map(move |p| {
            let estimate =
                FlightEstimate { value: p.value, std: p.std, ci_low: p.ci_low, ci_high: p.ci_high };
            (named(&p.name, &p.unit), estimate)
        });
        let derived = fit.derived.iter().filter(|d| d.identifiable).map(move |d| {
            let estimate =
                FlightEstimate { value: d.value, std: d.std, ci_low: d.ci_low, ci_high: d.ci_high };
            (named(&d.name, &d.unit), estimate)
        });
        parameters.chain(derived)
    });
    equations.chain(motion)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parameter_is_pooled_over_the_flights_that_determine_it() {
        let of = |estimator, name: &str, value| {
            let named = Named { estimator, name: name.to_owned(), unit: String::new() };
            (named, FlightEstimate { value, std: 0.1, ci_low: value - 0.2, ci_high: value + 0.2 })
        };
        let flights = [
            vec![of("ols", "C_m,q", 1.0), of("oe", "C_m,q", 5.0)],
            vec![of("ols", "C_m,r", 9.0)],
            vec![of("ols", "C_m,q", 2.0), of("oe", "C_m,q", 5.05), of("ols", "C_m,r", 9.0)],
        ];
        let found = pooled_by_name(flights.into_iter());
        let names: Vec<_> = found.iter().map(|p| (p.estimator.as_str(), p.name.as_str())).collect();
        assert_eq!(names, [("ols", "C_m,q"), ("ols", "C_m,r"), ("oe", "C_m,q")]);
        let differs: Vec<bool> = found.iter().map(|p| p.pooled.heterogeneity.is_significant()).collect();
        assert_eq!(differs, [true, false, false]);
        assert!((found[0].pooled.mean - 1.5).abs() < 1e-12 && found[0].flights[1].0 == 2);
    }
}
