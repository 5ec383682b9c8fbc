//! Tables and words for fitted parameters, whichever estimator found them.

use crate::Table;
use mavsight_identify::output_error::{FILTER_ERROR, OUTPUT_ERROR, OutputErrorFit};
use mavsight_identify::{Estimator, Identification, OutputFit};
use mavsight_session::RunResults;

/// The estimator that verdicts and plots are of: total least squares where it was asked for, else the first.
pub(crate) fn lead(identification: &Identification) -> Option<Estimator> {
    let all = || identification.fits.iter().map(|f| f.estimator);
    all().find(|e| *e == Estimator::TotalLeastSquares).or_else(|| all().next())
}

/// A fit for people, by the name that result files give it.
pub(crate) fn words(name: &str) -> &str {
    match (name, Estimator::from_name(name)) {
        (OUTPUT_ERROR, _) => "output error from the poses",
        (FILTER_ERROR, _) => "filter error",
        ("image", _) => "output error straight from the images",
        (_, Some(Estimator::LeastSquares)) => "least squares",
        (_, Some(Estimator::WeightedLeastSquares)) => "weighted least squares",
        (_, Some(Estimator::TotalLeastSquares)) => "total least squares with exact columns",
        (_, Some(Estimator::TotalLeastSquaresByRow)) => {
            "total least squares, each instant with its own covariance"
        }
        (_, Some(Estimator::FrequencyDomain)) => "least squares in the frequency domain",
        (other, None) => other,
    }
}

/// A parameter's name for people, with its unit if it has one.
pub(crate) fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") }
}

/// Rows of equally many cells as lines of aligned text; empty where there are none.
pub(crate) fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let width = |k: usize| rows.iter().map(|r| r[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let padded = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}  "));
        format!("  {}", padded.collect::<String>()).trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}

/// Which errors the intervals of an estimator cover.
fn covered(estimator: &str) -> &'static str {
    match estimator {
        OUTPUT_ERROR => {
            "of errors of the poses; of what the model lacks only as far as the residuals show it"
        }
        FILTER_ERROR => "of errors of the poses, and of what the model lacks as far as that is white noise",
        "image" => {
            "of errors of the image, the cameras and the markers; of what the model lacks only as far as the residuals show it"
        }
        _ => "of errors of the motion; of what the equation lacks only as far as the residuals show it",
    }
}

/// A table of an estimator's rows from [`equation_rows`] or [`motion_rows`].
pub(crate) fn parameter_table(of: &str, estimator: &str, rows: Vec<Vec<String>>) -> Table {
    let caption =
        format!("{of}: parameters with standard deviation and 95 % interval, {}.", covered(estimator));
    Table::new(caption, ["parameter", "value", "std", "95 % from", "to", "verdict"], rows)
}

fn cells(name: String, numbers: [Option<f64>; 4], verdict: &str) -> Vec<String> {
    let numbers = numbers.map(|v| v.map_or(String::new(), |v| format!("{v:+.3e}")));
    [vec![name], numbers.to_vec(), vec![verdict.to_owned()]].concat()
}

/// Parameters and determined combinations of equation error: name, value, deviation, interval, verdict.
pub(crate) fn equation_rows(fit: &OutputFit) -> impl Iterator<Item = Vec<String>> {
    let parameters = fit.parameters.iter().map(|p| {
        let verdict = if p.identifiable { "" } else { "only in a combination" };
        cells(format!("{},{}", fit.output, p.name), [p.value, p.std, p.ci_low, p.ci_high], verdict)
    });
    let combinations = fit
        .combinations
        .iter()
        .map(|c| cells(c.text.clone(), [c.value, c.std, c.ci_low, c.ci_high].map(Some), "determined"));
    parameters.chain(combinations)
}

pub(crate) fn motion_rows(fit: &OutputErrorFit) -> impl Iterator<Item = Vec<String>> {
    let parameters = fit.parameters.iter().map(|p| {
        let verdict = if p.identifiable { "" } else { "hardly determined" };
        cells(with_unit(&p.name, &p.unit), [p.value, p.std, p.ci_low, p.ci_high].map(Some), verdict)
    });
    let derived = fit.derived.iter().map(|d| {
        let verdict = if d.identifiable { "derived" } else { "hardly determined" };
        cells(with_unit(&d.name, &d.unit), [d.value, d.std, d.ci_low, d.ci_high].map(Some), verdict)
    });
    parameters.chain(derived)
}

/// The parameters of all fits as aligned text: value, standard deviation, interval, verdict. Empty where
/// there are none.
pub fn parameter_text(results: &RunResults) -> String {
    let with = |estimator: &str, row: Vec<String>| [vec![estimator.to_owned()], row].concat();
    let equations = results.identification.iter().flat_map(|i| &i.fits);
    let equations = equations.flat_map(|f| equation_rows(f).map(|row| with(f.estimator.name(), row)));
    let motion =
        results.output_error.named().flat_map(|(name, f)| motion_rows(f).map(move |r| with(name, r)));
    let rows: Vec<Vec<String>> = equations.chain(motion).collect();
    if rows.is_empty() {
        return String::new();
    }
    "\nParameters: value, standard deviation, 95 % interval\n".to_owned() + &aligned(&rows)
}
