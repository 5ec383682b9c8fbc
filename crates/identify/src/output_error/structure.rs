//! Which of the terms that a model's file marks as candidates a flight asks for.

mod asked;
mod held_out;
mod score;

use super::assemble::{Solved, assemble};
use super::disagreement::chi_square_tail;
use super::fit::{output_error, solve};
use super::fitter::Recorded;
use super::measure::Measurements;
use super::model::{FlightModel, ModelParameter};
use super::options::OutputErrorOptions;
use super::result::{FittedParameter, OutputErrorFit};
use crate::IdentifyError;
pub use asked::AskedFor;
pub(super) use asked::terms_asked_for;
use held_out::{Found, Parts, STRONG};
use mavsight_flight::InputSeries;
use score::score_tests;

/// Chance, over all candidates together, that a term which is not missing passes the score tests.
const LEVEL: f64 = 0.01;

/// The test of a term that a fit does not have, at that fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreTest {
    /// Squared score over its variance, correlated residuals allowed for.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees: usize,
    /// Probability of as much or more without the term, of this candidate by itself.
    pub p_value: f64,
    /// What the parameter would move by, were the equations linear in it.
    pub step: f64,
}

/// A term that was added.
#[derive(Debug, Clone, PartialEq)]
pub struct AddedTerm {
    /// Its estimate in the final fit.
    pub fitted: FittedParameter,
    /// What the model's file says that it explains.
    pub explains: String,
    /// The test that led to it.
    pub test: ScoreTest,
    /// By how much it lowered the deviance of the held-out part, minus twice the logarithm of its likelihood.
    pub held_out_gain: f64,
}

/// Why a term was not added.
#[derive(Debug, Clone, PartialEq)]
pub enum NotAdded {
    /// The score test gives no reason to.
    NoEvidence,
    /// What is free can do all that it does.
    NotDistinguished,
    /// It was added, and terms added after it took its place.
    Replaced,
    /// The fit with it was refused.
    Refused(String),
    /// It changed the deviance of the held-out part by this: it raised it, or lowered it too little.
    HeldOut(f64),
}

/// A term that was tried and not added.
#[derive(Debug, Clone, PartialEq)]
pub struct TriedTerm {
    /// The parameter.
    pub parameter: ModelParameter,
    /// Name of the parameter.
    pub name: String,
    /// Its unit; empty where it has none, or none is declared.
    pub unit: String,
    /// What the model's file says that it would explain.
    pub explains: String,
    /// Its last test; none where it is not distinguished from what is free.
    pub test: Option<ScoreTest>,
    /// Why.
    pub reason: NotAdded,
}

/// The answer of [`search_structure`].
#[derive(Debug, Clone, PartialEq)]
pub struct StructureSearch {
    /// The fit of the whole flight, with the terms that were added.
    pub fit: OutputErrorFit,
    /// The model with what is free in that fit, at the values before it.
    pub model: FlightModel,
    /// Terms that were added, in this order.
    pub added: Vec<AddedTerm>,
    /// Terms that were tried and not added, in the order of the model.
    pub not_added: Vec<TriedTerm>,
}

/// Fits the free parameters of a model by [`super::output_error`], and adds those of its candidate terms
/// ([`mavsight_model::Parameter::candidate`]) for which the flight gives evidence.
///
/// Two thirds of the flight are fitted; of pieces of two seconds every third is held out. At the fit each further candidate
/// is judged by a score test (Rao 1948), a chi-square of one degree whose variance allows for residuals that hang together
/// (Newey & West 1987). If the strongest passes at the level of 1 % over all candidates that are left (Holm 1979), it is
/// freed, fitted, and kept if it lowers the deviance of the held-out part by 6 (Kass & Raftery 1995), flown in pieces whose
/// starts are found anew. Terms that an addition makes idle are held again. This repeats until no candidate passes; what
/// was chosen is then fitted to the whole flight. Intervals do not allow for the choice.
///
/// Sensors take no part in the choice, but in the final fit.
///
/// Further states that begin elsewhere than the model says imitate a missing term: where that may be, choose
/// [`super::InitialStates::Free`].
///
/// # Errors
/// Those of [`super::output_error`] for the model as it is on the fitted part, and for the final fit. A
/// candidate whose own fit is refused is not added.
pub fn search_structure(
    model: &FlightModel,
    inputs: &InputSeries,
    measurements: &Measurements,
    options: &OutputErrorOptions,
) -> Result<StructureSearch, IdentifyError> {
    if model.free().is_empty() {
        return Err(IdentifyError::NothingFree);
    }
    measurements.check()?;
    let inputs_read = &model.inputs_of(inputs)?;
    let parts = &Parts::of(measurements.seen());
    let recorded = Recorded { inputs: inputs_read, measurements: &parts.fitted };
    let (open, added) = (candidates(model), Vec::new());
    let (seen, of_outputs) = model.clone().without_outputs();
    let mut search = Search { parts, recorded, options, model: seen, open, added, closed: Vec::new() };
    search.run()?;
    let Search { mut model, open, added, closed, .. } = search;
    of_outputs.into_iter().for_each(|parameter| model.make_free(parameter));
    let fit = output_error(&model, inputs, measurements, options)?;
    let added = added.into_iter().filter_map(|a| added_term(&model, &fit, a)).collect();
    let mut not_added: Vec<TriedTerm> = open.into_iter().chain(closed).collect();
    not_added.sort_by_key(|t| model.model().parameter(&t.name));
    Ok(StructureSearch { fit, model, added, not_added })
}

/// What a search has come to.
struct Search<'a> {
    parts: &'a Parts,
    /// The part that is fitted.
    recorded: Recorded<'a>,
    options: &'a OutputErrorOptions,
    /// The model with what has been added.
    model: FlightModel,
    open: Vec<TriedTerm>,
    added: Vec<Addition>,
    /// Terms with evidence that were refused all the same.
    closed: Vec<TriedTerm>,
}

struct Addition {
    parameter: ModelParameter,
    test: ScoreTest,
    held_out_gain: f64,
}

impl<'a> Search<'a> {
    fn run(&mut self) -> Result<(), IdentifyError> {
        if self.open.is_empty() {
            return Ok(());
        }
        let mut next = Some(solve(&self.model, self.recorded, self.options)?);
        while let Some(solved) = next {
            let found = Found::of(&solved);
            let parameters: Vec<ModelParameter> = self.open.iter().map(|c| c.parameter).collect();
            for (term, test) in self.open.iter_mut().zip(score_tests(solved, &parameters)?) {
                term.test = test;
                term.reason = if test.is_some() { NotAdded::NoEvidence } else { NotAdded::NotDistinguished };
            }
            next = self.add(&found).map(|solved| self.pruned(solved)).transpose()?;
        }
        Ok(())
    }

    /// Frees the strongest of the open terms that passes both tests; the fit with it.
    fn add(&mut self, found: &Found) -> Option<Solved<'a>> {
        while let Some((place, test)) = self.strongest() {
            let mut term = self.open.remove(place);
            match self.with(term.parameter, found) {
                Ok((model, solved, gain)) if gain > STRONG => {
                    self.model = model;
                    self.added.push(Addition { parameter: term.parameter, test, held_out_gain: gain });
                    return Some(solved);
                }
                Ok((_, _, gain)) => term.reason = NotAdded::HeldOut(-gain),
                Err(why) => term.reason = NotAdded::Refused(why.to_string()),
            }
            self.closed.push(term);
        }
        None
    }

    /// A fit without the terms that are no longer needed beside later ones: a first choice may stand for a term
    /// that was added after it.
    fn pruned(&mut self, mut solved: Solved<'a>) -> Result<Solved<'a>, IdentifyError> {
        while let Some(place) = self.idle(&assemble(&solved)?) {
            let Addition { parameter, test, .. } = self.added.remove(place);
            let terms = candidates(&self.model.clone().with_free(&[])?).into_iter();
            let own = terms.filter(|t| t.parameter == parameter);
            self.closed.extend(own.map(|t| TriedTerm { test: Some(test), reason: NotAdded::Replaced, ..t }));
            let left = self.model.free().iter().filter(|p| **p != parameter);
            let names: Vec<&str> = left.map(|p| self.model.name(*p)).collect();
            self.model = self.model.clone().with_free(&names)?;
            solved = solve(&self.model, self.recorded, self.options)?;
        }
        Ok(solved)
    }

    /// The added term that is nearest to the value at which it would be held, by its standard deviation, if it
    /// is not away from it at the level of all candidates.
    fn idle(&self, fit: &OutputErrorFit) -> Option<usize> {
        let away = |addition: &Addition| {
            let p = fit.parameters.iter().find(|p| p.parameter == addition.parameter)?;
            Some(((p.value - self.model.value(p.parameter)) / p.std).powi(2))
        };
        let all = self.added.iter().enumerate().filter_map(|(k, a)| Some((k, away(a)?)));
        let (place, chi_square) = all.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let count = self.added.len() + self.open.len() + self.closed.len();
        (chi_square_tail(chi_square, 1) * count as f64 > LEVEL).then_some(place)
    }

    /// The open term of the largest chi-square, if it passes at the level of all that are open.
    fn strongest(&self) -> Option<(usize, ScoreTest)> {
        let tests = self.open.iter().enumerate().filter_map(|(k, term)| Some((k, term.test?)));
        let best = tests.max_by(|a, b| a.1.chi_square.total_cmp(&b.1.chi_square))?;
        (best.1.p_value * self.open.len() as f64 <= LEVEL).then_some(best)
    }

    /// The model with one more term, its fit, and by how much this lowers the deviance of the held-out part.
    fn with(
        &self,
        parameter: ModelParameter,
        found: &Found,
    ) -> Result<(FlightModel, Solved<'a>, f64), IdentifyError> {
        let names: Vec<&str> =
            self.model.free().iter().chain([&parameter]).map(|p| self.model.name(*p)).collect();
        let model = self.model.clone().with_free(&names)?;
        let solved = solve(&model, self.recorded, self.options)?;
        let gain = self.parts.gain(self.recorded.inputs, &found.model, &Found::of(&solved))?;
        Ok((model, solved, gain))
    }
}

/// The terms that the file marks as candidates and that are not free.
fn candidates(model: &FlightModel) -> Vec<TriedTerm> {
    let all = model.model().parameters.iter().enumerate();
    let open = all.filter_map(|(k, p)| {
        let (parameter, explains) = (ModelParameter::Parameter(k), p.candidate.clone()?);
        let (name, test, reason) = (p.label.clone(), None, NotAdded::NoEvidence);
        let unit = model.unit(parameter);
        (!model.free().contains(&parameter)).then_some(TriedTerm {
            parameter,
            name,
            unit,
            explains,
            test,
            reason,
        })
    });
    open.collect()
}

fn added_term(model: &FlightModel, fit: &OutputErrorFit, addition: Addition) -> Option<AddedTerm> {
    let Addition { parameter, test, held_out_gain } = addition;
    let ModelParameter::Parameter(k) = parameter else { return None };
    let explains = model.model().parameters[k].candidate.clone()?;
    let fitted = fit.parameters.iter().find(|p| p.parameter == parameter)?.clone();
    Some(AddedTerm { fitted, explains, test, held_out_gain })
}

impl StructureSearch {
    /// A model with the terms that were added free as well.
    pub(super) fn extended(&self, model: FlightModel) -> Result<FlightModel, IdentifyError> {
        let added = self.added.iter().map(|a| a.fitted.name.clone());
        let names: Vec<String> =
            model.free().iter().map(|p| model.name(*p).to_owned()).chain(added).collect();
        model.with_free(&names.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// The final fit, whose notes begin with what was added and what was not.
    pub(super) fn into_fit(self) -> OutputErrorFit {
        let mut notes = self.notes();
        let mut fit = self.fit;
        notes.append(&mut fit.notes);
        OutputErrorFit { notes, ..fit }
    }

    /// What was added and what was not, in sentences.
    pub fn notes(&self) -> Vec<String> {
        if self.added.is_empty() && self.not_added.is_empty() {
            return vec![
                "The model's file marks no further term as a candidate: nothing was searched.".to_owned(),
            ];
        }
        let mut out: Vec<String> = self.added.iter().map(ToString::to_string).collect();
        if !self.not_added.is_empty() {
            let all: Vec<String> = self.not_added.iter().map(ToString::to_string).collect();
            out.push(format!("Not added: {}.", all.join("; ")));
        }
        out
    }
}

impl std::fmt::Display for AddedTerm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let FittedParameter { name, value, std, unit, .. } = &self.fitted;
        let ScoreTest { chi_square, degrees, .. } = self.test;
        write!(
            f,
            "Added {name}, {}: {value:.3e} ± {std:.1e}{}{unit}; chi-square {chi_square:.0} ({degrees}), held-out deviance lower by {:.0}.",
            self.explains,
            if unit.is_empty() { "" } else { " " },
            self.held_out_gain
        )
    }
}

impl std::fmt::Display for TriedTerm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {}: ", self.name, self.explains)?;
        if let Some(ScoreTest { chi_square, degrees, .. }) = self.test {
            write!(f, "chi-square {chi_square:.1} ({degrees})")?;
        }
        match &self.reason {
            NotAdded::NoEvidence => Ok(()),
            NotAdded::NotDistinguished => f.write_str("free parameters do the same"),
            NotAdded::Replaced => f.write_str(" at first, not needed beside what was added later"),
            NotAdded::HeldOut(by) => {
                write!(f, ", but held-out deviance changes by {by:+.1} (-{STRONG} counts)")
            }
            NotAdded::Refused(why) => write!(f, ", but {why}"),
        }
    }
}
