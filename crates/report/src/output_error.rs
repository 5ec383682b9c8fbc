//! Output error: figures, the estimators side by side, whether they disagree.

use crate::Table;
use crate::html::row;
use crate::parameters::{lead, motion_rows, parameter_table, with_unit, words};
use crate::summary::Summary;
use mavsight_identify::Agreement;
use mavsight_identify::output_error::{
    AheadErrors, Comparison, Extent, FILTER_ERROR, FlightFits, OutputErrorFit, PoseErrors, Prediction,
};
use mavsight_session::RunResults;
use serde_json::json;

pub(crate) fn summarise(summary: &mut Summary, results: &RunResults) {
    let fits = &results.output_error;
    for (name, fit) in fits.named() {
        let mut section = summary.section_of("fit", name, &format!("{}:", words(name)));
        section.hidden("iterations", fit.iterations);
        section.hidden("reduced_chi_square", fit.reduced_chi_square);
        if let Some(correlated) = fit.systematic {
            let (share, extent) = (correlated.share, &correlated.extent);
            let (key_of_extent, value) = match extent {
                Extent::Time(time_s) => ("time_s", time_s),
                Extent::Path(path_px) => ("path_px", path_px),
            };
            let value = json!({"share": share, key_of_extent: value});
            let shown = format!("{:.0} % for {extent}", 100.0 * share);
            section.add("correlated", "correlated part of the errors", value, shown);
        }
        let ahead = fit.ahead.iter().flat_map(|a| [("ahead", a.model), ("held_ahead", Some(a.held))]);
        for (what, e) in ahead.filter_map(|(what, e)| Some((what, e?))) {
            section.hidden(format!("{what}_position_rms"), e.position_m);
            section.hidden(format!("{what}_attitude_rms"), e.attitude_rad);
        }
        for (noise, root) in &fit.process_noise {
            section.hidden(format!("process_noise_{}", noise.replace(' ', "_")), *root);
        }
        if let Some(held) = &fit.held_out {
            for (coordinate, a) in Prediction::COORDINATES.iter().zip(&held.agreements) {
                for (what, value) in [("r2", a.r2), ("theil", a.theil), ("rms", a.rms)] {
                    section.hidden(format!("held_out_{coordinate}_{what}"), value);
                }
            }
            summary.verdicts.push(prediction(name, held));
        }
        summary.verdicts.extend(fit.ahead.iter().map(|ahead| ahead_of(name, ahead)));
        let mut section = summary.section("parameters");
        for p in fit.parameters.iter().filter(|p| p.identifiable) {
            let label = format!("{} ({name})", with_unit(&p.name, &p.unit));
            let shown = format!("{:+.3e} ± {:.1e}", p.value, p.std);
            let value = json!({"value": p.value, "std": p.std});
            section.add(format!("{name}_{}", p.name.replace(',', "_")), label, value, shown);
        }
        summary.verdicts.extend(fit.notes.iter().map(|note| format!("{}: {note}", words(name))));
    }
    summary.verdicts.extend(held(fits));
    let asks = fits.adequacy.lacks_something();
    for c in comparisons(results) {
        let (first, second) = &c.between;
        summary.section("fit").hidden(format!("{first}_against_{second}_p_value"), c.test.p_value);
        summary.verdicts.push(sentence(&c, asks));
    }
}

/// R² against the mean of a coordinate that hardly moves says nothing: differences come first.
fn prediction(name: &str, held: &Prediction) -> String {
    let [x, y, z, phi, theta, psi] = &held.agreements;
    let r2 = |part: &[(&str, &Agreement)]| {
        part.iter().map(|(name, a)| format!("{name} {:.3}", a.r2)).collect::<Vec<_>>().join(", ")
    };
    let rms = |of: [&Agreement; 3]| of.iter().map(|a| a.rms * a.rms).sum::<f64>().sqrt();
    format!(
        "{} predicts the part held out ({:.2} to {:.2} s, of which only the start is found) to {:.1} mm and {:.2}°; R² of {}.",
        words(name),
        held.span_s.0,
        held.span_s.1,
        1e3 * rms([x, y, z]),
        rms([phi, theta, psi]).to_degrees(),
        r2(&[("x", x), ("y", y), ("z", z), ("roll", phi), ("pitch", theta), ("yaw", psi)])
    )
}

fn ahead_of(name: &str, errors: &AheadErrors) -> String {
    let shown =
        |e: &PoseErrors| format!("{:.1} mm and {:.2}°", 1e3 * e.position_m, e.attitude_rad.to_degrees());
    let verdict = if is_of_use(errors) { "" } else { ": do not use its parameters" };
    let counted =
        |count: usize, what: &str| if count == 0 { String::new() } else { format!(" ({count} {what})") };
    let ran_away = counted(errors.ran_away, "of them ran away");
    let not_started = counted(errors.not_started, "more had no state to start from");
    format!(
        "{} predicts the part held out {} s ahead, {} times{ran_away}{not_started}, to {}; holding velocity and rates, to {}{verdict}.",
        words(name),
        errors.horizon_s,
        errors.count,
        errors.model.as_ref().map_or("nowhere".to_owned(), shown),
        shown(&errors.held)
    )
}

/// Whether a fit predicts better than motion that goes on as it is.
pub(crate) fn is_of_use(errors: &AheadErrors) -> bool {
    let is_better = |model: &PoseErrors| {
        model.position_m < errors.held.position_m && model.attitude_rad < errors.held.attitude_rad
    };
    errors.ran_away == 0 && errors.model.as_ref().is_some_and(is_better)
}

/// Which estimators contradict each other.
pub(crate) fn disagreements(results: &RunResults) -> impl Iterator<Item = String> {
    comparisons(results).into_iter().filter(|c| c.test.is_significant()).map(|c| sentence(&c, false))
}

fn comparisons(results: &RunResults) -> Vec<Comparison> {
    let equations = results.identification.as_ref().and_then(|i| Some((i, lead(i)?)));
    let mut all = results.output_error.comparisons(equations);
    // What is refuted contradicts nothing, as its own note says.
    let is_refuted = results.output_error.adequacy.refuted.is_some();
    all.retain(|c| !is_refuted || c.between.1 != FILTER_ERROR);
    all
}

/// A comparison in words, where the residuals ask for terms that the model lacks or do not.
fn sentence(c: &Comparison, asks: bool) -> String {
    let (first, second) = &c.between;
    let verdict = if c.test.is_significant() && second == FILTER_ERROR {
        "disagree by more than their uncertainties allow: the model lacks something; filter error allows for forces and moments \
         that change, not for steady ones"
    } else if c.test.is_significant() {
        "disagree by more than their uncertainties allow: the model of one of them lacks something"
    } else if asks && second == FILTER_ERROR {
        "agree within their uncertainties, which says little where the residuals ask for terms that the model lacks"
    } else {
        "agree within their uncertainties"
    };
    format!(
        "{} and {} {verdict} (chi-square {:.1} of {} parameters: {}; p = {:.2}).",
        words(first),
        words(second),
        c.test.chi_square,
        c.test.degrees,
        c.parameters.join(", "),
        c.test.p_value
    )
}

pub(crate) fn held(fits: &FlightFits) -> Option<String> {
    let any = fits.named().next().is_some() && !fits.held.is_empty();
    any.then(|| {
        format!(
            "Output error holds {} at the values of the vehicle's files: the flight does not move the inputs that would \
             determine them, each by itself. To free them, fly a manoeuvre that does.",
            fits.held.join(", ")
        )
    })
}

/// All estimators side by side, and the numbers of each fit of the equations of motion.
pub(crate) fn tables(results: &RunResults) -> Vec<Table> {
    let fits: Vec<(&str, &OutputErrorFit)> = results.output_error.named().collect();
    let Some((_, first)) = fits.first() else { return vec![] };
    let equations = results.identification.as_ref().and_then(|i| Some((i, lead(i)?)));
    let of_equations = |name: &str| {
        let (identification, estimator) = equations?;
        let (output, parameter) = name.split_once(',')?;
        let fit = identification.fit(output, estimator)?;
        let p = fit.parameters.iter().find(|p| p.name == parameter && p.identifiable)?;
        Some((p.value?, p.std?))
    };
    let show = |p: Option<(f64, f64)>| p.map_or(String::new(), |(v, std)| format!("{v:+.4e} ± {std:.1e}"));
    let names = equations.iter().map(|(_, e)| e.name()).chain(fits.iter().map(|(name, _)| *name));
    let rows = first.parameters.iter().map(|p| {
        let equations = equations.iter().map(|_| of_equations(&p.name));
        let motion = fits.iter().map(|(_, fit)| fit.parameter(&p.name).map(|p| (p.value, p.std)));
        row(with_unit(&p.name, &p.unit), equations.chain(motion).map(show))
    });
    let caption = "Estimators side by side: value ± standard deviation. Equation error takes the flapping times from the \
                   vehicle file, output error finds them.";
    let side_by_side = Table::new(caption, row("parameter", names.map(words)), rows.collect());
    let each = fits.iter().map(|(name, fit)| parameter_table(words(name), name, motion_rows(fit).collect()));
    std::iter::once(side_by_side).chain(each).collect()
}
