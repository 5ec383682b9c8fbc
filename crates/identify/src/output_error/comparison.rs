//! Whether estimators of one flight disagree.

use super::flight::{FILTER_ERROR, FlightFits, OUTPUT_ERROR};
use super::{Disagreement, Estimates, disagreement};
use crate::{Estimator, Identification};
use nalgebra::{DMatrix, DVector};

/// Two estimates of the same parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Names of the estimators, as in [`FlightFits::named`].
    pub between: (String, String),
    /// What was compared.
    pub parameters: Vec<String>,
    /// The test.
    pub test: Disagreement,
}

struct NamedEstimates {
    estimator: &'static str,
    names: Vec<String>,
    estimates: Estimates,
}

impl FlightFits {
    /// Whether the estimators disagree: each pair of these fits in all they share, and each with equation
    /// error by one estimator in what both call by the same name. Filter error is compared with output error
    /// alone, which it is but for what the model lacks.
    pub fn comparisons(&self, equation_error: Option<(&Identification, Estimator)>) -> Vec<Comparison> {
        let mut all: Vec<NamedEstimates> = equation_error
            .and_then(|(i, e)| of_equations(i, e, &self.equation_over_motion))
            .into_iter()
            .collect();
        all.extend(self.named().map(|(estimator, fit)| NamedEstimates {
            estimator,
            names: fit.parameters.iter().map(|p| p.name.clone()).collect(),
            estimates: Estimates {
                values: fit.parameters.iter().map(|p| p.value).collect::<Vec<f64>>().into(),
                covariance: fit.covariance.clone(),
            },
        }));
        let pairs = (0..all.len()).flat_map(|k| (k + 1..all.len()).map(move |l| (k, l)));
        let is_wanted = |(k, l): &(usize, usize)| {
            let names = [all[*k].estimator, all[*l].estimator];
            !names.contains(&FILTER_ERROR) || names.contains(&OUTPUT_ERROR)
        };
        pairs.filter(is_wanted).filter_map(|(k, l)| compare(&all[k], &all[l])).collect()
    }
}

/// As parameters of the equations of motion. Offsets are left out: equation error's stand for the mean of
/// its window.
fn of_equations(
    identification: &Identification,
    estimator: Estimator,
    equation_over_motion: &[(String, f64)],
) -> Option<NamedEstimates> {
    let (mut names, mut values, mut covariance) = (Vec::new(), Vec::new(), DMatrix::zeros(0, 0));
    for fit in identification.fits.iter().filter(|f| f.estimator == estimator) {
        let (mut columns, mut stds) = (Vec::new(), Vec::new());
        for p in fit.parameters.iter().filter(|p| p.name != "0") {
            let name = format!("{},{}", fit.output, p.name);
            let column = fit.diagnostics.columns.iter().position(|c| *c == p.name);
            let (Some(value), Some(std), Some(column)) = (p.value, p.std, column) else { continue };
            if let Some((_, scale)) = equation_over_motion.iter().find(|(label, _)| *label == name) {
                names.push(name);
                values.push(value / scale);
                columns.push(column);
                stds.push(std / scale);
            }
        }
        let (before, stds) = (covariance.nrows(), DVector::from_vec(stds));
        let correlations = fit.diagnostics.correlations.select_rows(&columns).select_columns(&columns);
        covariance = covariance.resize(names.len(), names.len(), 0.0);
        let own = correlations.component_mul(&(&stds * stds.transpose()));
        covariance.view_mut((before, before), own.shape()).copy_from(&own);
    }
    let estimates = Estimates { values: values.into(), covariance };
    (!names.is_empty()).then_some(NamedEstimates { estimator: estimator.name(), names, estimates })
}

fn compare(first: &NamedEstimates, second: &NamedEstimates) -> Option<Comparison> {
    let place = |name: &String| second.names.iter().position(|n| n == name);
    let shared = first.names.iter().enumerate().filter_map(|(i, name)| Some((i, place(name)?)));
    let (a, b): (Vec<usize>, Vec<usize>) = shared.unzip();
    let part = |e: &Estimates, index: &[usize]| Estimates {
        values: e.values.select_rows(index),
        covariance: e.covariance.select_rows(index).select_columns(index),
    };
    Some(Comparison {
        between: (first.estimator.to_owned(), second.estimator.to_owned()),
        parameters: a.iter().map(|i| first.names[*i].clone()).collect(),
        test: disagreement(&part(&first.estimates, &a), &part(&second.estimates, &b)).ok()?,
    })
}

#[cfg(test)]
mod tests {
    use crate::output_error::FlightModel;
    use mavsight_flight::{InputSeries, Vehicle};

    /// Rotors of a real aircraft seldom hover at one speed: estimators disagreed by a chi-square of 97 000 of
    /// the same flight.
    #[test]
    fn what_a_disc_does_is_the_same_by_the_mean_speed_and_by_its_own() {
        let vehicle = Vehicle::paper();
        let row = [205.0, 227.0, 0.0, 0.0];
        let names: Vec<String> = vehicle.input_columns().iter().map(|n| (*n).to_owned()).collect();
        let inputs = InputSeries::new(names, vec![0.0, 1.0], [row, row].concat()).expect("inputs");
        let model = FlightModel::new(&vehicle, &inputs).expect("a model");
        let of_model = model.model();
        let dynamics = mavsight_model::Dynamics::new(of_model, model.values(), &[]);
        let mut evaluation = dynamics.with(&[]);
        evaluation.set_inputs(&row);
        let mut force_n = |flapping: &str, angle_rad: f64| {
            let mut y = vec![0.0; of_model.state_count()];
            y[3] = 1.0;
            let place = of_model.states.iter().position(|s| s.name == flapping).expect("a state");
            y[mavsight_model::RIGID_STATES + place] = angle_rad;
            let mut rates = y.clone();
            evaluation.rates(&y, &mut rates);
            vehicle.mass_kg * rates[7]
        };
        let (e, radius_m) = (&vehicle.environment, vehicle.parameters["R"]);
        let scale_n = 0.5 * e.air_density_kg_m3 * std::f64::consts::PI * radius_m.powi(4) * 216_f64.powi(2);
        let ratios = of_model.equation_over_motion(model.values(), [row.as_slice()].into_iter());
        for (name, flapping, gain) in
            [("C_X,alpha_u", "alpha_f", vehicle.parameters["K_u"]), ("C_X,alpha_l", "alpha_l", 1.0)]
        {
            let by_mean = (force_n(flapping, 0.01) - force_n(flapping, -0.01)) / (0.02 * gain * scale_n);
            let own = model.value(model.parameter(name).expect("a parameter"));
            let ratio = ratios.iter().find(|(label, _)| label == name).expect("a ratio").1;
            assert!((by_mean / ratio / own - 1.0).abs() < 1e-9, "{name}");
            assert!((by_mean / own - 1.0).abs() > 0.05, "{name}: the speeds are unlike");
        }
    }
}
