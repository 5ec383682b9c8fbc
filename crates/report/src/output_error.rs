//! Output error: figures, the estimators side by side, whether they disagree.

use crate::Table;
use crate::equation_error::{lead, parameter_rows, words as words_of};
use crate::summary::Summary;
use mavsight_identify::Agreement;
use mavsight_identify::output_error::{Comparison, Extent, FlightFits, OutputErrorFit, Prediction};
use mavsight_session::RunResults;
use serde_json::json;

/// Adds the figures of the fits, and the verdicts.
pub(crate) fn summarise(summary: &mut Summary, results: &RunResults) {
    let fits = &results.output_error;
    for (name, fit) in fits.named() {
        let key = |what: &str| format!("{name}_{what}");
        let mut section = summary.section("fit");
        section.hidden(key("iterations"), fit.iterations);
        section.hidden(key("reduced_chi_square"), fit.reduced_chi_square);
        if let Some(correlated) = fit.systematic {
            let (share, extent) = (correlated.share, &correlated.extent);
            let (key_of_extent, value) = match extent {
                Extent::Time(time_s) => ("time_s", time_s),
                Extent::Path(path_px) => ("path_px", path_px),
            };
            let label = format!("{}: correlated part of the errors", words(name));
            let value = json!({"share": share, key_of_extent: value});
            section.add(key("correlated"), label, value, format!("{:.0} % for {extent}", 100.0 * share));
        }
        if let Some(held) = &fit.held_out {
            for (coordinate, a) in Prediction::COORDINATES.iter().zip(&held.agreements) {
                for (what, value) in [("r2", a.r2), ("theil", a.theil), ("rms", a.rms)] {
                    section.hidden(key(&format!("held_out_{coordinate}_{what}")), value);
                }
            }
            summary.verdicts.push(prediction(name, held));
        }
        let mut section = summary.section("parameters");
        for p in fit.parameters.iter().filter(|p| p.identifiable) {
            let label = format!("{} ({name})", with_unit(p.name));
            let shown = format!("{:+.3e} ± {:.1e}", p.value, p.std);
            let value = json!({"value": p.value, "std": p.std});
            section.add(key(&p.name.replace(',', "_")), label, value, shown);
        }
        summary.verdicts.extend(fit.notes.iter().map(|note| format!("{}: {note}", words(name))));
    }
    summary.verdicts.extend(held(fits));
    for c in comparisons(results) {
        let (first, second) = &c.between;
        summary.section("fit").hidden(format!("{first}_against_{second}_p_value"), c.test.p_value);
        summary.verdicts.push(sentence(&c));
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

fn comparisons(results: &RunResults) -> Vec<Comparison> {
    let equations = results.identification.as_ref().and_then(|i| Some((i, lead(i)?)));
    results.output_error.comparisons(equations)
}

fn sentence(c: &Comparison) -> String {
    let (first, second) = &c.between;
    let verdict = if c.test.is_significant() {
        "disagree by more than their uncertainties allow: the model of one of them lacks something"
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

fn held(fits: &FlightFits) -> Option<String> {
    let any = fits.named().next().is_some() && !fits.held.is_empty();
    let names: Vec<&str> = fits.held.iter().map(|p| p.name()).collect();
    any.then(|| {
        format!(
            "Output error holds {} at the vehicle file's values: the flight does not move what would determine them, and of \
             thrusts and torques only the sums C_Z,0 and C_n,0 are seen. To free them, move each rotor's speed by itself and \
             the lateral swash-plate.",
            names.join(", ")
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
        Some(with_std(p.value?, p.std?))
    };
    let mut header = vec!["parameter".to_owned()];
    header.extend(equations.map(|(_, estimator)| words_of(estimator).to_owned()));
    header.extend(fits.iter().map(|(name, _)| words(name).to_owned()));
    let rows = first.parameters.iter().map(|p| {
        let mut row = vec![with_unit(p.name)];
        row.extend(equations.map(|_| of_equations(p.name).unwrap_or_default()));
        row.extend(
            fits.iter()
                .map(|(_, fit)| fit.parameter(p.name).map_or(String::new(), |p| with_std(p.value, p.std))),
        );
        row
    });
    let side_by_side = Table {
        caption: "Estimators side by side: value ± standard deviation. Equation error takes the flapping times from the \
                  vehicle file, output error finds them."
            .to_owned(),
        header,
        rows: rows.collect(),
    };
    std::iter::once(side_by_side).chain(fits.iter().map(|(name, fit)| parameters(name, fit))).collect()
}

/// A parameter's name for people: flapping times have a unit that their names do not show.
fn with_unit(name: &str) -> String {
    if name.starts_with("tau_") { format!("{name}, s") } else { name.to_owned() }
}

fn with_std(value: f64, std: f64) -> String {
    format!("{value:+.4e} ± {std:.1e}")
}

fn parameters(name: &str, fit: &OutputErrorFit) -> Table {
    let show = |v: f64| format!("{v:+.3e}");
    Table {
        caption: format!("{}: parameters with standard deviation and 95 % interval.", words(name)),
        header: ["parameter", "value", "std", "95 % from", "to", "verdict"].map(str::to_owned).to_vec(),
        rows: rows(fit)
            .map(|(name, values, verdict)| {
                [vec![name], values.map(show).to_vec(), vec![verdict.to_owned()]].concat()
            })
            .collect(),
    }
}

fn rows(fit: &OutputErrorFit) -> impl Iterator<Item = (String, [f64; 4], &'static str)> {
    fit.parameters.iter().map(|p| {
        let verdict = if p.identifiable { "" } else { "hardly determined" };
        (with_unit(p.name), [p.value, p.std, p.ci_low, p.ci_high], verdict)
    })
}

/// The parameters of all fits as aligned text: value, standard deviation, interval, verdict. Empty where
/// there are none.
pub fn parameter_text(results: &RunResults) -> String {
    let show = |v: f64| format!("{v:+.3e}");
    let equations = results.identification.iter().flat_map(|i| &i.fits).flat_map(|fit| {
        parameter_rows(fit).into_iter().map(|row| [vec![fit.estimator.name().to_owned()], row].concat())
    });
    let motion = results.output_error.named().flat_map(|(estimator, fit)| {
        rows(fit).map(move |(name, values, verdict)| {
            [vec![estimator.to_owned(), name], values.map(show).to_vec(), vec![verdict.to_owned()]].concat()
        })
    });
    let rows: Vec<Vec<String>> = equations.chain(motion).collect();
    if rows.is_empty() {
        return String::new();
    }
    let width = |k: usize| rows.iter().map(|r| r[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..rows.first().map_or(0, Vec::len)).map(width).collect();
    let mut text = String::from("\nParameters: value, standard deviation, 95 % interval\n");
    for row in rows {
        let mut line = String::from("  ");
        for (cell, width) in row.iter().zip(&widths) {
            line += cell;
            line += &" ".repeat(width - cell.chars().count() + 2);
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}

fn words(name: &str) -> &str {
    match name {
        "oe" => "output error from the poses",
        "image" => "output error straight from the images",
        other => mavsight_identify::Estimator::from_name(other).map_or(other, |e| words_of(e)),
    }
}
