//! What to mend, most harmful first, each with its remedy.

use crate::output_error::disagreements;
use crate::parameters::{lead, words};
use mavsight_identify::output_error::FILTER_ERROR;
use mavsight_identify::{Estimator, column_words};
use mavsight_session::RunResults;
use serde::Serialize;

/// So many are shown before all else; what is beyond them is among verdicts and notes.
pub(crate) const MOST: usize = 5;
/// Share of instants without a pose from which nothing is worse.
const MANY_UNMEASURED: f64 = 0.1;

/// Something that makes the results worse, and what to do about it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// How bad it is.
    #[serde(skip)]
    pub harm: Harm,
    /// What was found.
    pub what: String,
    /// What to do.
    pub remedy: String,
}

/// How bad something is; the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Harm {
    /// Cameras, recordings or files are wrong: so may be every result.
    Fault,
    /// Parameters are not to be used.
    Misleading,
    /// Part of the flight or of the parameters is missing.
    Missing,
    /// Results are less precise than they could be.
    Imprecise,
}

/// What the results and the notes of a run ask for.
pub(crate) fn of(results: &RunResults, notes: &[String]) -> Vec<Advice> {
    let faults = results.findings.iter().map(|f| Some(fault(&f.note)));
    let is_fault = |note: &&String| results.findings.iter().any(|f| f.note == **note);
    // A note that begins so says what the flight did not give.
    let harm = |note: &str| if note.starts_with("No ") { Harm::Missing } else { Harm::Imprecise };
    let noted = notes.iter().filter(|note| !is_fault(note)).map(|note| advice_of(note, harm(note)));
    let mut all: Vec<Advice> = faults.chain(noted).flatten().collect();
    all.extend(unmeasured(results));
    all.extend(of_equations(results));
    all.extend(of_motion_fits(results));
    all.sort_by_key(|advice| advice.harm);
    all.dedup_by(|a, b| a.what == b.what || takes_in(b, a));
    all
}

/// Whether one finding could take in the next, which says the same of another camera.
fn takes_in(first: &mut Advice, next: &Advice) -> bool {
    let (Some((names, own)), Some((name, of_other))) =
        (first.what.split_once(": "), next.what.split_once(": "))
    else {
        return false;
    };
    let is_alike = own == of_other && first.remedy == next.remedy;
    if is_alike {
        let name = name.strip_prefix("No ").filter(|_| names.starts_with("No ")).unwrap_or(name);
        let name = name.strip_prefix("A ").map_or(name.to_owned(), |ball| format!("a {ball}"));
        first.what = format!("{names}, {name}: {own}");
    }
    is_alike
}

fn unmeasured(results: &RunResults) -> Option<Advice> {
    let (all, missing) = (results.poses.len(), results.poses.iter().filter(|p| p.estimate.is_err()).count());
    let share = missing as f64 / all.max(1) as f64;
    let between = results.poses.split(|p| p.estimate.is_ok()).collect::<Vec<_>>();
    let is_at_the_ends = between.len() > 2 && between[1..between.len() - 1].iter().all(|gap| gap.is_empty());
    let (what, remedy) = if is_at_the_ends {
        (
            format!("{missing} of {all} instants, before the first pose or after the last, have none."),
            "Let all cameras film, with the aircraft in their view, before it flies and until it has landed.",
        )
    } else {
        (
            format!("{missing} of {all} instants have no pose."),
            "Look for what hides the balls, or place a further camera: at each instant three balls must be visible to two \
             cameras, or four to one.",
        )
    };
    (missing > 0).then(|| Advice {
        harm: if share > MANY_UNMEASURED { Harm::Fault } else { Harm::Missing },
        what,
        remedy: remedy.to_owned(),
    })
}

/// Equation error: fits that are not of use, then what the flight does not determine, outputs of one remedy together.
fn of_equations(results: &RunResults) -> Vec<Advice> {
    let Some(identification) = &results.identification else { return vec![] };
    let lead = lead(identification);
    let mut out: Vec<Advice> = Vec::new();
    // Names of the parameters that are not determined, the outputs that lack them, the remedy.
    let mut lacking: Vec<(Vec<String>, Vec<&str>, String)> = Vec::new();
    for fit in identification.fits.iter().filter(|f| Some(f.estimator) == lead) {
        let (what, remedy) = split(&fit.verdict);
        let is_of_time = fit.estimator != Estimator::FrequencyDomain;
        if fit.explains && is_of_time && fit.diagnostics.predicted_r2 <= 0.0 {
            let output = &fit.output;
            let what = format!(
                "What the fit says of {output} does not hold on parts that least squares leaves out."
            );
            let remedy = format!("Use its mean alone, or fly a manoeuvre that moves {output} more.");
            out.push(Advice { harm: Harm::Missing, what, remedy });
        }
        let Some(remedy) = remedy else { continue };
        if !fit.explains {
            out.push(Advice { harm: Harm::Misleading, what, remedy });
            continue;
        }
        let names: Vec<String> = fit
            .parameters
            .iter()
            .filter(|p| !p.identifiable)
            .map(|p| column_words(&p.name).to_owned())
            .collect();
        match lacking.iter_mut().find(|(own, _, r)| *own == names && *r == remedy) {
            Some((_, outputs, _)) => outputs.push(&fit.output),
            None => lacking.push((names, vec![&fit.output], remedy)),
        }
    }
    out.extend(lacking.into_iter().map(|(names, outputs, remedy)| {
        let outputs = outputs.join(", ");
        let what = if names.is_empty() {
            format!("The terms of {outputs} trade against each other.")
        } else {
            let themselves = if names.len() == 1 { "itself" } else { "themselves" };
            format!("Equation error does not determine {} of {outputs} by {themselves}.", names.join(", "))
        };
        Advice { harm: Harm::Missing, what, remedy }
    }));
    out
}

/// Fits of the equations of motion: those that are not of use, and what they hold or hardly determine.
fn of_motion_fits(results: &RunResults) -> Vec<Advice> {
    let mut out: Vec<Advice> = Vec::new();
    for (name, fit) in results.output_error.named() {
        if let Some(ahead) = fit.ahead.as_ref().filter(|ahead| !crate::output_error::is_of_use(ahead)) {
            let what = format!(
                "{} predicts the part held out no better than motion that goes on as it is, {} s ahead.",
                sentence_case(words(name)),
                ahead.horizon_s
            );
            let remedy =
                "Do not use its parameters; fly a livelier manoeuvre or choose another model.".to_owned();
            out.push(Advice { harm: Harm::Misleading, what, remedy });
        }
        let adequacy = &results.output_error.adequacy;
        let is_doubted = match name {
            FILTER_ERROR => adequacy.refuted.is_some(),
            _ => adequacy.contradiction.is_some(),
        };
        // No manoeuvre helps a fit that is not to be used.
        if is_doubted {
            continue;
        }
        let weak: Vec<&str> =
            fit.parameters.iter().filter(|p| !p.identifiable).map(|p| p.name.as_str()).collect();
        if !weak.is_empty() {
            let what = format!("{} hardly determines {}.", sentence_case(words(name)), weak.join(", "));
            let remedy = "Fly a manoeuvre that moves more of what they act on, or hold them at values known otherwise.";
            out.push(Advice { harm: Harm::Missing, what, remedy: remedy.to_owned() });
        }
    }
    let remedy = "Trust filter error more, whose intervals allow for what the model lacks, and look at the residuals for what \
                  that is.";
    out.extend(disagreements(results).map(|what| Advice {
        harm: Harm::Misleading,
        what: sentence_case(&what),
        remedy: remedy.to_owned(),
    }));
    out.extend(
        crate::output_error::held(&results.output_error).and_then(|held| advice_of(&held, Harm::Missing)),
    );
    out
}

pub(crate) fn sentence_case(text: &str) -> String {
    let mut rest = text.chars();
    rest.next().map_or_else(String::new, |first| first.to_uppercase().collect::<String>() + rest.as_str())
}

/// A fault; one that names several causes alike has no remedy of its own.
fn fault(note: &str) -> Advice {
    let (what, remedy) = split(note);
    let one_by_one = || "Mend what it names one by one, until the finding is gone.".to_owned();
    Advice { harm: Harm::Fault, what, remedy: remedy.unwrap_or_else(one_by_one) }
}

/// A text that says what to do.
fn advice_of(text: &str, harm: Harm) -> Option<Advice> {
    let (what, remedy) = split(text);
    Some(Advice { harm, what, remedy: remedy? })
}

/// With these words a remedy begins.
const IMPERATIVES: [&str; 40] = [
    "Add",
    "Ask",
    "Calibrate",
    "Check",
    "Choose",
    "Clean",
    "Close",
    "Come",
    "Correct",
    "Cover",
    "Do",
    "Exchange",
    "Film",
    "Fix",
    "Fly",
    "Focus",
    "Give",
    "Look",
    "Lower",
    "Measure",
    "Move",
    "Name",
    "Open",
    "Paint",
    "Place",
    "Put",
    "Raise",
    "Record",
    "Remove",
    "Repeat",
    "Run",
    "Set",
    "Shorten",
    "Switch",
    "Take",
    "To",
    "Turn",
    "Use",
    "Widen",
    "Write",
];

/// What a text says, and the remedy at its end: the last sentences that ask to do something, or what behind a colon or
/// a semicolon does.
fn split(text: &str) -> (String, Option<String>) {
    let is_remedy = |part: &str| {
        let first = part.split([' ', ',', '.']).next().unwrap_or_default();
        IMPERATIVES.iter().any(|verb| verb.eq_ignore_ascii_case(first))
    };
    let ends = text.match_indices(". ").map(|(at, _)| at + 2);
    let starts: Vec<usize> =
        ends.filter(|at| text[*at..].starts_with(|c: char| c.is_uppercase() || c == '`')).collect();
    let remedy = starts.iter().rev().take_while(|at| is_remedy(&text[**at..])).last();
    let last = starts.last().copied().unwrap_or(0);
    let behind = [": ", "; "].iter().flat_map(|mark| text[last..].match_indices(mark));
    let behind = behind
        .map(|(at, mark)| (last + at, last + at + mark.len()))
        .filter(|(_, at)| is_remedy(&text[*at..]) && is_outside_brackets(&text[..*at]));
    match (remedy, behind.min()) {
        (Some(at), _) => (text[..*at].trim_end().to_owned(), Some(ended(&text[*at..]))),
        (None, Some((end, at))) => (ended(&text[..end]), Some(ended(&sentence_case(&text[at..])))),
        (None, None) => (text.to_owned(), None),
    }
}

fn is_outside_brackets(before: &str) -> bool {
    before.matches('(').count() == before.matches(')').count()
}

/// A sentence with its full stop.
fn ended(text: &str) -> String {
    if text.ends_with('.') { text.to_owned() } else { format!("{text}.") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::Isometry3;
    use mavsight_pipeline::{Cause, Finding};
    use mavsight_pose::{PoseError, PoseEstimate, PoseSample};

    #[test]
    fn a_remedy_is_split_from_what_was_found() {
        let of = |text: &str| {
            let (what, remedy) = split(text);
            (what, remedy.unwrap_or_default())
        };
        assert_eq!(
            of("cam1: yellow is overexposed: shorten the exposure or close the iris."),
            ("cam1: yellow is overexposed.".into(), "Shorten the exposure or close the iris.".into())
        );
        assert_eq!(
            of("It froze at 1.5 s. It is left out. Check its cable. Look at T_u."),
            ("It froze at 1.5 s. It is left out.".into(), "Check its cable. Look at T_u.".into())
        );
        assert_eq!(of("cam2 ends at 0.300 s.").1, "");
        assert_eq!(of("Its clock is unknown (1 px/s would do; fly faster).").1, "");
        assert_eq!(
            of("No fit: nothing was excited; fly a manoeuvre"),
            ("No fit: nothing was excited.".into(), "Fly a manoeuvre.".into())
        );
    }

    #[test]
    fn what_two_cameras_have_in_common_is_one_finding() {
        let note = |camera: &str, ball: &str| format!("{camera}: {ball} is overexposed: close the iris.");
        let all =
            of(&RunResults::default(), &[note("cam1", "red"), note("cam2", "red"), note("cam2", "blue")]);
        let what: Vec<&str> = all.iter().map(|a| a.what.as_str()).collect();
        assert_eq!(what, ["cam1, cam2: red is overexposed.", "cam2: blue is overexposed."]);
        let note = |fit: &str| format!("No fit from {fit}: it lacks data; fly again.");
        let all = of(&RunResults::default(), &[note("poses"), note("images")]);
        assert_eq!(all[0].what, "No fit from poses, fit from images: it lacks data.");
    }

    #[test]
    fn the_worst_comes_first_and_nothing_twice() {
        let pose = |t_ns: i64| PoseSample { t_ns, estimate: Err(PoseError::NotMeasured) };
        let note = "cam1 froze. Check its cable.".to_owned();
        let results = RunResults {
            poses: vec![pose(0)],
            findings: vec![Finding::of(Cause::CameraFrozen, Some(0), note.clone())],
            ..RunResults::default()
        };
        let spoilt = "cam1: red is small: come closer.".to_owned();
        let all = of(&results, &[spoilt, note]);
        let what: Vec<&str> = all.iter().map(|a| a.what.as_str()).collect();
        assert_eq!(what, ["cam1 froze.", "1 of 1 instants have no pose.", "cam1: red is small."]);
    }

    /// Where one camera began half a second later, twelve instants had no pose, and the user was to look for what hides the balls.
    #[test]
    fn instants_before_the_first_pose_ask_for_no_other_camera() {
        let estimate = PoseEstimate::new(Isometry3::identity(), &Default::default());
        let of_poses = |known: &[bool]| {
            let one = |(k, known): (usize, &bool)| PoseSample {
                t_ns: k as i64,
                estimate: if *known { Ok(estimate.clone()) } else { Err(PoseError::NotMeasured) },
            };
            let poses = known.iter().enumerate().map(one).collect();
            unmeasured(&RunResults { poses, ..RunResults::default() }).unwrap()
        };
        let at_the_ends = of_poses(&[false, true, true, true, false]);
        assert!(at_the_ends.what.contains("before the first pose"), "{}", at_the_ends.what);
        let inside = of_poses(&[false, true, false, true]);
        assert!(inside.remedy.contains("hides"), "{}", inside.remedy);
    }
}
