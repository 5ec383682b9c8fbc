//! Equation error: figures of merit, tables, plots.

use crate::figures::{curve, figure, figure_over};
use crate::summary::{Section, Summary};
use crate::{Figure, Panel, ReportError, Role, Table};
use mavsight_identify::{Clocks, Estimator, Identification, OutputFit};
use mavsight_session::RunResults;
use serde_json::json;

/// The estimator that verdicts and plots are of: total least squares where it was asked for, else the first.
pub(crate) fn lead(identification: &Identification) -> Option<Estimator> {
    let all = || identification.fits.iter().map(|f| f.estimator);
    all().find(|e| *e == Estimator::TotalLeastSquares).or_else(|| all().next())
}

fn lead_fits(identification: &Identification) -> impl Iterator<Item = &OutputFit> {
    let lead = lead(identification);
    identification.fits.iter().filter(move |f| Some(f.estimator) == lead)
}

/// Adds the figures of the fits, and the verdicts.
pub(crate) fn summarise(summary: &mut Summary, results: &RunResults) {
    if let Some(Clocks::Lag(lag)) = &results.clocks {
        let shown = format!("{:+.1} ± {:.1} ms", 1e3 * lag.lag_s, 1e3 * lag.std_s);
        let mut section = summary.section("fit");
        section.add("lag_s", "motion behind the inputs' clock", lag.lag_s, shown);
        section.hidden("lag_std_s", lag.std_s);
    }
    let Some(identification) = &results.identification else { return };
    if let Some(lead) = lead(identification) {
        summary.section("fit").add("estimator", "estimator", lead.name(), words(lead));
    }
    for fit in lead_fits(identification) {
        figures_of_merit(&mut summary.section("fit"), fit);
        summary.verdicts.push(fit.verdict.clone());
    }
    let mut section = summary.section("parameters");
    for fit in &identification.fits {
        let estimator = fit.estimator.name();
        for p in fit.parameters.iter().filter(|p| p.identifiable) {
            let (Some(value), Some(std)) = (p.value, p.std) else { continue };
            let label = format!("{},{} ({estimator})", fit.output, p.name);
            let key = format!("{estimator}_{}_{}", fit.output, p.name);
            let shown = format!("{value:+.3e} ± {std:.1e}");
            section.add(key, label, json!({"value": value, "std": std}), shown);
        }
    }
}

fn figures_of_merit(section: &mut Section<'_>, fit: &OutputFit) {
    let (name, d) = (&fit.output, &fit.diagnostics);
    section.number(format!("{name}_r2"), format!("{name} R²"), fit.diagnostics.fit.r2, "");
    let label = format!("{name} R² of instants left out (PRESS)");
    section.number(format!("{name}_predicted_r2"), label, d.predicted_r2, "");
    let rows: Vec<Vec<f64>> = d.correlations.row_iter().map(|r| r.iter().copied().collect()).collect();
    for (key, value) in [
        ("theil", json!(d.fit.theil)),
        ("condition", json!(fit.condition)),
        ("columns", json!(d.columns)),
        ("singular_values", json!(d.collinearity.singular_values.as_slice())),
        ("variance_inflation", json!(d.collinearity.variance_inflation.as_slice())),
        ("correlations", json!(rows)),
        ("residual_autocorrelations", json!(d.autocorrelations)),
    ] {
        section.hidden(format!("{name}_{key}"), value);
    }
    let label = format!("{name} largest residual");
    section.add(
        format!("{name}_max_residual"),
        label,
        fit.diagnostics.fit.max,
        format!("{:.2e}", fit.diagnostics.fit.max),
    );
    let shown = format!("{} of {}, {:.0}", fit.rank, fit.parameters.len(), fit.condition);
    section.add(format!("{name}_rank"), format!("{name} rank, condition"), fit.rank, shown);
    if let Some(held) = &d.held_out {
        section.number(format!("{name}_held_out_r2"), format!("{name} R² of the hold-out"), held.r2, "");
        let label = format!("{name} Theil's coefficient of it");
        section.number(format!("{name}_held_out_theil"), label, held.theil, "");
    }
}

/// Table 3 of the paper, one for each estimator, and how far the flight separates the columns.
pub(crate) fn tables(results: &RunResults) -> Vec<Table> {
    let Some(identification) = &results.identification else { return vec![] };
    let lead = lead(identification);
    let mut fits: Vec<&OutputFit> = identification.fits.iter().collect();
    fits.sort_by_key(|f| Some(f.estimator) != lead);
    let mut tables: Vec<Table> = Vec::new();
    for fit in fits {
        let caption = format!(
            "Table 3, {}: parameters with standard deviation and 95 % interval.",
            words(fit.estimator)
        );
        if !tables.iter().any(|t| t.caption == caption) {
            let header =
                ["parameter", "value", "std", "95 % from", "to", "verdict"].map(str::to_owned).to_vec();
            tables.push(Table { caption: caption.clone(), header, rows: vec![] });
        }
        if let Some(table) = tables.iter_mut().find(|t| t.caption == caption) {
            table.rows.extend(parameter_rows(fit));
        }
    }
    tables.extend(lead_fits(identification).map(separation));
    tables
}

pub(crate) fn parameter_rows(fit: &OutputFit) -> Vec<Vec<String>> {
    let show = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:+.3e}"));
    let parameters = fit.parameters.iter().map(|p| {
        let verdict = if p.identifiable { "" } else { "only in a combination" };
        let name = format!("{},{}", fit.output, p.name);
        vec![name, show(p.value), show(p.std), show(p.ci_low), show(p.ci_high), verdict.to_owned()]
    });
    let combinations = fit.combinations.iter().map(|c| {
        let [value, std, low, high] = [c.value, c.std, c.ci_low, c.ci_high].map(|v| show(Some(v)));
        vec![c.text.clone(), value, std, low, high, "determined".to_owned()]
    });
    parameters.chain(combinations).collect()
}

/// Singular values, variance inflation and correlations of one output's columns.
fn separation(fit: &OutputFit) -> Table {
    let d = &fit.diagnostics;
    let show = |values: &[f64]| values.iter().map(|v| format!("{v:.3}")).collect::<Vec<_>>();
    let row = |label: &str, values: &[f64]| std::iter::once(label.to_owned()).chain(show(values)).collect();
    let mut rows: Vec<Vec<String>> = vec![
        row("singular values", d.collinearity.singular_values.as_slice()),
        row("condition indices", d.collinearity.condition_indices.as_slice()),
        row("variance inflation", d.collinearity.variance_inflation.as_slice()),
    ];
    for (k, name) in d.columns.iter().enumerate() {
        let correlations: Vec<f64> = d.correlations.row(k).iter().copied().collect();
        rows.push(row(&format!("correlation with {name}"), &correlations));
    }
    Table {
        caption: format!(
            "{}: how separate its independent columns are, each scaled to length one. Condition indices above 30 are \
             entangled columns.",
            fit.output
        ),
        header: std::iter::once(String::new()).chain(d.columns.clone()).collect(),
        rows,
    }
}

/// Figure 12, and the residuals of the fit.
pub(crate) fn figures(results: &RunResults) -> Result<Vec<Figure>, ReportError> {
    let (Some(table), Some(identification)) = (&results.coefficients, &results.identification) else {
        return Ok(vec![]);
    };
    let (mut panels, mut residuals, mut autocorrelations) = (Vec::new(), Vec::new(), Vec::new());
    for fit in lead_fits(identification) {
        let Some(output) = table.outputs.iter().find(|o| o.name == fit.output) else { continue };
        let fitted: Vec<f64> = (0..table.t_s.len()).map(|row| fit.line.at(output, row)).collect();
        let inside = |t: f64| t >= table.window_s.0 && t <= table.window_s.1;
        let panel = |axis: String, curves: &[(&str, Role, Vec<f64>)]| {
            let of = |(label, role, values): &(&str, Role, Vec<f64>)| {
                curve(
                    label,
                    *role,
                    std::iter::zip(&table.t_s, values).map(|(t, v)| (*t, *v)).filter(|p| inside(p.0)),
                )
            };
            Panel { axis, curves: curves.iter().map(of).collect() }
        };
        let residual = output.values.iter().zip(&fitted).map(|(a, b)| a - b).collect();
        let measured = ("from the motion", Role::Estimate, output.values.clone());
        panels.push(panel(output.name.clone(), &[measured, (words(fit.estimator), Role::Model, fitted)]));
        residuals.push(panel(format!("Δ {}", output.name), &[("residual", Role::Estimate, residual)]));
        autocorrelations.push(autocorrelation(fit, table.sample_interval_s));
    }
    if panels.is_empty() {
        return Ok(vec![]);
    }
    Ok(vec![
        figure(
            "Figure 12: coefficients from the motion and from the fitted model, inside the window that is fitted.",
            panels,
        )?,
        figure("Residuals of figure 12.", residuals)?,
        figure_over(
            "lag, s",
            "Autocorrelations of those residuals over lags of up to two periods of the low-pass. What passes a low-pass is \
             never white: intervals allow for it.",
            autocorrelations,
        )?,
    ])
}

/// Autocorrelation of the residuals over their lags, with the bounds of white noise.
fn autocorrelation(fit: &OutputFit, interval_s: f64) -> Panel {
    let all = &fit.diagnostics.autocorrelations;
    let bound = 1.96 / (fit.diagnostics.fit.count.max(1) as f64).sqrt();
    let last_s = interval_s * all.len() as f64;
    let level = |v: f64| [(0.0, v), (last_s, v), (last_s, f64::NAN)];
    let points = all.iter().enumerate().map(|(k, r)| (interval_s * (k + 1) as f64, *r));
    Panel {
        axis: format!("r({})", fit.output),
        curves: vec![
            curve("autocorrelation of residuals", Role::Estimate, points),
            curve("95 % of white ones", Role::Truth, level(bound).into_iter().chain(level(-bound))),
        ],
    }
}

pub(crate) fn words(estimator: Estimator) -> &'static str {
    match estimator {
        Estimator::LeastSquares => "least squares",
        Estimator::WeightedLeastSquares => "weighted least squares",
        Estimator::TotalLeastSquares => "total least squares with exact columns",
        Estimator::TotalLeastSquaresByRow => "total least squares, each instant with its own covariance",
        Estimator::FrequencyDomain => "least squares in the frequency domain",
    }
}
