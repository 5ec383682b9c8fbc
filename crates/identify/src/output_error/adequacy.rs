//! Whether a flight model is good enough for output error.

use super::flight::{FILTER_ERROR, FlightFits, OUTPUT_ERROR};
use super::model::ModelParameter;
use super::structure::{AskedFor, ScoreTest, TriedTerm};
use super::{Disagreement, OutputErrorFit};
use crate::IdentifyError;

/// Chance that a fit is doubted whose model lacks nothing.
pub(super) const LEVEL: f64 = 0.01;
/// Signals that are named: one fault often shows in a force and in a moment, or along two axes.
const SIGNALS_SAID: usize = 3;

/// What speaks against a flight model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Adequacy {
    /// That filter error contradicts output error: what the model lacks has gone into its parameters.
    pub contradiction: Option<Disagreement>,
    /// That filter error contradicts output error, but explains the flight worse than errors of the measurements alone: by how
    /// much its [criterion](super::OutputErrorFit::criterion) is larger.
    pub refuted: Option<f64>,
    /// What the residuals of output error ask for; an error of the fit that would have said it.
    pub asked_for: Option<Result<AskedFor, IdentifyError>>,
}

impl Adequacy {
    /// Whether the flight shows that the model lacks something: a test at the level of 1 % fails, of the contradiction, of
    /// the model's candidates, or of terms that follow a signal.
    pub fn lacks_something(&self) -> bool {
        self.contradiction.is_some() || is_asked(self.asked_for.as_ref())
    }

    /// Inputs that act late, where the residuals ask for that most of all: the term that filter error, whose process noise
    /// is white, cannot allow for.
    fn late_inputs(&self) -> Option<&TriedTerm> {
        let asked = self.asked_for.as_ref()?.as_ref().ok()?;
        asked.signals.first().filter(|term| term.parameter == ModelParameter::InputLag)
    }

    /// What a reader should know, in sentences.
    fn words(&self) -> Vec<String> {
        let doubt = self.contradiction.map(|test| {
            format!(
                "Do not use its parameters: filter error contradicts them (chi-square {:.0} of {} parameters), so the model \
                 lacks something.",
                test.chi_square, test.degrees
            )
        });
        let asked = self.asked_for.as_ref().and_then(|asked| match asked {
            Ok(asked) if asked.is_empty() => {
                doubt.is_some().then(|| "No term that was tried passes a score test.".to_owned())
            }
            Ok(asked) => Some(asked.words()),
            Err(why) => Some(format!("What the model lacks was not tried: {why}")),
        });
        doubt.into_iter().chain(asked).collect()
    }
}

/// Whether the residuals ask for a term.
fn is_asked(asked_for: Option<&Result<AskedFor, IdentifyError>>) -> bool {
    asked_for.is_some_and(|asked| asked.as_ref().is_ok_and(|asked| !asked.is_empty()))
}

impl FlightFits {
    /// Looks for what speaks against the model, and says so in the notes of output error.
    ///
    /// Where filter error contradicts output error, one of them is wrong: output error has taken what the model lacks for its
    /// parameters, or filter error has taken errors of the measurements that last for forces. None is determined of the one
    /// that explains the flight worse, and of neither where that is filter error though the residuals ask for terms that the
    /// model lacks. Where the residuals ask most for inputs that act late, none of filter error is either; where they ask for a
    /// scale or an offset of a sensor, none of any.
    pub(super) fn doubt(&mut self, asked_for: Option<Result<AskedFor, IdentifyError>>) {
        let pair = (OUTPUT_ERROR.to_owned(), FILTER_ERROR.to_owned());
        let all = self.comparisons(None);
        let apart = all.into_iter().find(|c| c.between == pair && c.test.p_value < LEVEL);
        let worse_by = apart.as_ref().and_then(|_| self.filter_is_worse_by());
        let asks = is_asked(asked_for.as_ref());
        let contradiction = apart.filter(|_| worse_by.is_none() || asks).map(|c| c.test);
        self.adequacy = Adequacy { contradiction, refuted: worse_by, asked_for };
        let words = self.adequacy.words();
        let is_contradicted = self.adequacy.contradiction.is_some();
        let late = self.adequacy.late_inputs().map(|term| {
            format!(
                "Do not use its parameters: {} ({}); give the model a state for a servo or motor that follows its input with a lag, \
                 or, for clocks that differ, leave the lag free (without --lag).",
                term.explains,
                term.test.map_or(String::new(), |t| format!(
                    "about {:.1} ms, chi-square {:.0}",
                    1e3 * t.step,
                    t.chi_square
                ))
            )
        });
        let asked = self.adequacy.asked_for.as_ref().and_then(|asked| asked.as_ref().ok());
        let sensors = asked.and_then(AskedFor::sensor_words);
        for fit in [&mut self.poses, &mut self.image].into_iter().flatten() {
            if is_contradicted || late.is_some() || sensors.is_some() {
                fit.withhold();
            }
            fit.notes.splice(0..0, words.iter().cloned());
        }
        let refuted = worse_by.map(|by| {
            format!(
                "Do not use its parameters: errors of the poses alone, as output error finds them, explain the flight better than \
                 forces that the model lacks (Schwarz' criterion less by {by:.0})."
            )
        });
        let Some(filter) = &mut self.filter else { return };
        for why in late.into_iter().chain(sensors).chain(refuted) {
            filter.withhold();
            filter.notes.insert(0, why);
        }
    }

    /// By how much the criterion of filter error is larger than that of output error, which has the same unknowns; none where
    /// it is not.
    fn filter_is_worse_by(&self) -> Option<f64> {
        let (output, filter) = (self.poses.as_ref()?, self.filter.as_ref()?);
        let names = |fit: &OutputErrorFit| fit.parameters.iter().map(|p| p.parameter).collect::<Vec<_>>();
        let by = filter.criterion - output.criterion;
        (names(output) == names(filter) && by > 0.0).then_some(by)
    }
}

impl AskedFor {
    /// That sensors do not show what the file says: what they err by is in the parameters.
    fn sensor_words(&self) -> Option<String> {
        (!self.sensors.is_empty()).then(|| {
            format!(
                "Do not use its parameters: of scales and offsets of sensors, the residuals ask most for {}; calibrate that sensor, or \
                 give it a free parameter in [outputs].",
                strongest(&self.sensors)
            )
        })
    }

    fn words(&self) -> String {
        let term = |t: &TriedTerm| format!("{}, {}{}", t.name, t.explains, chi_square(t));
        let mut words = Vec::new();
        if !self.candidates.is_empty() {
            let terms: Vec<String> = self.candidates.iter().map(term).collect();
            words.push(format!("The residuals ask for {}: --search tries it.", terms.join(", ")));
        }
        if !self.signals.is_empty() {
            words.push(format!(
                "Of a lag of the inputs and of forces and moments that follow one signal, the residuals ask most for {}.",
                strongest(&self.signals)
            ));
        }
        words.extend(self.sensor_words());
        words.join(" ")
    }
}

/// The strongest terms, with their sizes.
fn strongest(terms: &[TriedTerm]) -> String {
    let words = |t: &TriedTerm| {
        let step = t.test.map_or(String::new(), |test| format!(", about {:+.2e} {}", test.step, t.unit));
        format!("{}{}{}", t.explains, step.trim_end(), chi_square(t))
    };
    terms.iter().take(SIGNALS_SAID).map(words).collect::<Vec<_>>().join("; ")
}

fn chi_square(term: &TriedTerm) -> String {
    term.test.map_or(String::new(), |ScoreTest { chi_square, .. }| format!(" (chi-square {chi_square:.0})"))
}
