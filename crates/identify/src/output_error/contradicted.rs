//! What a fit was held to against the flight, and which of its results hang on that.

use super::adequacy::LEVEL;
use super::determined::SEEN_SIZES;
use super::disagreement::chi_square_tail;
use super::fitter::Fitter;
use super::model::ModelParameter;
use super::result::{DerivedQuantity, FittedParameter};
use super::shooting::ParameterPrior;
use crate::inverse::inverse;
use nalgebra::{DMatrix, DVector};

/// A parameter this near to a bound, in standard deviations, was stopped by it: steps towards a bound go a part of the way.
const STOPPED: f64 = 1e-2;

/// What a fit says of its free parameters.
pub(super) struct Found<'a> {
    /// Of their covariance, the inverse of the information.
    pub(super) bound: &'a DMatrix<f64>,
    /// As stated, for residuals as they are.
    pub(super) covariance: &'a DMatrix<f64>,
    /// What they would still move by, bounds left aside.
    pub(super) step: &'a DVector<f64>,
    /// [`super::determined::typical_sizes`].
    pub(super) sizes: &'a [f64],
}

/// A prior that the flight contradicts.
struct ContradictedPrior {
    prior: ParameterPrior,
    /// How far the estimate, bounds left aside, is from the prior's value.
    off: f64,
    /// What the flight says without the prior.
    without: (f64, f64),
    /// Of one degree of freedom.
    chi_square: f64,
}

/// Bounds and priors that the flight contradicts, and what hangs on them.
pub(super) struct Contradicted {
    /// Places of the parameters that a bound has stopped.
    pub(super) stopped: Vec<usize>,
    /// The strongest first.
    priors: Vec<ContradictedPrior>,
    /// What each free parameter would move by without the bounds that have stopped some, and without those priors.
    pub(super) moves: DVector<f64>,
}

impl Contradicted {
    /// Tests each prior at the level of 1 % over all of them. Without the bounds the parameters would go where the next step of
    /// the fit leads.
    pub(super) fn new(fitter: &Fitter<'_>, found: &Found<'_>) -> Self {
        let (given, model) = (&fitter.problem.parameter_priors, &fitter.point.model);
        let value = |prior: &ParameterPrior| model.value(model.free()[prior.place]);
        let tested = given.iter().filter_map(|prior| ContradictedPrior::test(*prior, value(prior), found));
        let is_beyond =
            |c: &ContradictedPrior| chi_square_tail(c.chi_square, 1) * given.len() as f64 <= LEVEL;
        let mut priors: Vec<ContradictedPrior> = tested.filter(is_beyond).collect();
        priors.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
        let is_stopped = |(k, parameter): (usize, &ModelParameter)| {
            let std = found.covariance[(k, k)].sqrt();
            (model.to_bound(*parameter) < STOPPED * std).then_some(k)
        };
        let stopped: Vec<usize> = model.free().iter().enumerate().filter_map(is_stopped).collect();
        let mut moves = moves_without(&priors, found.bound);
        // Away from bounds the step is what the iteration has left, less than a tenth of a standard deviation.
        if !stopped.is_empty() {
            moves += found.step;
        }
        Self { stopped, priors, moves }
    }

    /// Parameters that would move by more than a standard deviation are not determined: what they are off by is then no
    /// longer less than what chance does.
    pub(super) fn withhold(&self, parameters: &mut [FittedParameter]) {
        parameters.iter_mut().zip(&self.moves).for_each(|(p, by)| p.identifiable &= by.abs() <= p.std);
    }

    /// What a reader should know, in sentences.
    pub(super) fn words(&self, parameters: &[FittedParameter], derived: &[DerivedQuantity]) -> Vec<String> {
        let prior = |c: &ContradictedPrior| {
            let ((value, std), FittedParameter { name, unit, .. }) = (c.without, &parameters[c.prior.place]);
            let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
            format!(
                "The flight contradicts what was given of {name}: {:.3e} ± {:.1e}{unit}, against {value:.3e} ± {std:.1e}{unit} from \
                 the flight without it (chi-square {:.0}). Check that value, give it a larger standard deviation (prior_std, \
                 mass_std_kg, inertia_std_kg_m2) or none, or the model lacks something.",
                c.prior.value, c.prior.std, c.chi_square
            )
        };
        let moving = parameters.iter().zip(&self.moves).filter(|(p, by)| p.identifiable && by.abs() > p.std);
        let names: Vec<&str> = moving
            .map(|(p, _)| p.name.as_str())
            .chain(derived.iter().filter(|d| !d.identifiable).map(|d| d.name.as_str()))
            .collect();
        let hang = (!names.is_empty()).then(|| {
            format!(
                "Not determined, since they would move by more than a standard deviation without that: {}.",
                names.join(", ")
            )
        });
        self.stopped_words(parameters).into_iter().chain(self.priors.iter().map(prior)).chain(hang).collect()
    }

    fn stopped_words(&self, parameters: &[FittedParameter]) -> Option<String> {
        let names: Vec<&str> = self.stopped.iter().map(|k| parameters[*k].name.as_str()).collect();
        (!names.is_empty()).then(|| {
            format!(
                "At a bound of the model's file, beyond which the flight asks for: {}. The interval of none of them holds, and the \
                 model lacks something or the bound is too narrow: widen it.",
                names.join(", ")
            )
        })
    }
}

impl ContradictedPrior {
    /// Compares a prior with what the flight and the other priors say without it.
    ///
    /// With s² the prior's variance, b the bound on that of the estimate and d its distance from the prior, the flight alone is
    /// at d s²/(s² - b) with the bound b s²/(s² - b) (the test of an observation's own residual; Baarda 1968). Its variance is
    /// that of residuals as they are. None where the flight says nothing of the parameter.
    fn test(prior: ParameterPrior, value: f64, found: &Found<'_>) -> Option<Self> {
        let k = prior.place;
        let (given, bound) = (prior.std * prior.std, found.bound[(k, k)]);
        let gain = given / (given - bound);
        let is_seen = gain > 0.0 && bound * gain < (SEEN_SIZES * found.sizes[k]).powi(2);
        let off = value + found.step[k] - prior.value;
        let variance = gain * gain * (found.covariance[(k, k)] - bound * bound / given);
        let chi_square = (gain * off).powi(2) / (variance + given);
        let without = (prior.value + gain * off, variance.sqrt());
        (is_seen && chi_square.is_finite()).then_some(Self { prior, off, without, chi_square })
    }
}

/// What free parameters would move by without some priors; infinite where the flight does not determine them then.
fn moves_without(priors: &[ContradictedPrior], bound: &DMatrix<f64>) -> DVector<f64> {
    if priors.is_empty() {
        return DVector::zeros(bound.nrows());
    }
    let places: Vec<usize> = priors.iter().map(|c| c.prior.place).collect();
    let given = DMatrix::from_diagonal(&DVector::from_iterator(
        priors.len(),
        priors.iter().map(|c| c.prior.std.powi(2)),
    ));
    let off = DVector::from_iterator(priors.len(), priors.iter().map(|c| c.off));
    let by = bound.select_columns(&places);
    let left = inverse(&(given - by.select_rows(&places)));
    left.map_or_else(|| DVector::from_element(bound.nrows(), f64::INFINITY), |left| by * left * off)
}
