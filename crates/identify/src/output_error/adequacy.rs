//! Whether a flight model is good enough for output error.

use super::flight::{FILTER_ERROR, FlightFits, OUTPUT_ERROR};
use super::result::OutputErrorFit;
use super::structure::{ScoreTest, TriedTerm};
use crate::IdentifyError;

/// Chance that a fit is doubted whose model lacks nothing.
const LEVEL: f64 = 0.01;

impl FlightFits {
    /// Says where the model lacks something.
    ///
    /// Where filter error contradicts output error, output error has taken what the model lacks for its parameters, and
    /// none of them is determined. There, and where residuals of output error are correlated, a note names the model's
    /// candidates that the residuals ask for, which `ask` finds.
    pub(super) fn doubt(&mut self, ask: impl FnOnce() -> Result<Vec<TriedTerm>, IdentifyError>) {
        let all = self.comparisons(None);
        let pair = (OUTPUT_ERROR.to_owned(), FILTER_ERROR.to_owned());
        let apart = all.into_iter().find(|c| c.between == pair && c.test.p_value < LEVEL);
        let is_correlated = |fit: &OutputErrorFit| fit.systematic.is_some() || fit.correlated_instants > 0;
        if apart.is_none() && !self.poses.as_ref().is_some_and(is_correlated) {
            return;
        }
        let missing = match (ask(), &apart) {
            (Ok(asked), None) if asked.is_empty() => return,
            (Ok(asked), Some(_)) if asked.is_empty() => {
                "No candidate of the model's file passes a score test.".to_owned()
            }
            (Ok(asked), _) => {
                let terms: Vec<String> = asked.iter().map(asked_for).collect();
                format!("The residuals ask for {}: --search tries it.", terms.join(", "))
            }
            (Err(why), _) => format!("The model's candidates were not tried: {why}"),
        };
        let doubt = apart.as_ref().map(|c| {
            format!(
                "Do not use its parameters: filter error contradicts them (chi-square {:.0} of {} parameters), so the \
                 model lacks something.",
                c.test.chi_square, c.test.degrees
            )
        });
        for fit in [&mut self.poses, &mut self.image].into_iter().flatten() {
            fit.parameters.iter_mut().for_each(|p| p.identifiable &= doubt.is_none());
            fit.notes.splice(0..0, doubt.iter().cloned().chain([missing.clone()]));
        }
    }
}

fn asked_for(term: &TriedTerm) -> String {
    let test = term
        .test
        .map_or(String::new(), |ScoreTest { chi_square, .. }| format!(" (chi-square {chi_square:.0})"));
    format!("{}, {}{test}", term.name, term.explains)
}
