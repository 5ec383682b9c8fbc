//! What is shown of the fits: figures of merit, tables, plots.

use crate::figures::{curve, figure, figure_over};
use crate::summary::Summary;
use anyhow::Result;
use mavsight_identify::{Clocks, Estimator, Identification, OutputFit};
use mavsight_report::{Figure, Panel, Role, Table};
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
        summary.add("fit", "lag_s", "motion behind the inputs' clock", json!(lag.lag_s), shown);
        summary.add("fit", "lag_std_s", "", json!(lag.std_s), String::new());
    }
    let Some(identification) = &results.identification else { return };
    if let Some(lead) = lead(identification) {
        summary.add("fit", "estimator", "estimator", json!(lead.name()), words(lead).to_owned());
    }
    for fit in lead_fits(identification) {
        figures_of_merit(summary, fit);
        summary.verdicts.push(fit.verdict.clone());
    }
    for fit in &identification.fits {
        for p in fit.parameters.iter().filter(|p| p.identifiable) {
            let (Some(value), Some(std)) = (p.value, p.std) else { continue };
            let label = format!("{},{} ({})", fit.output, p.name, fit.estimator.name());
            let key = format!("{}_{}_{}", fit.estimator.name(), fit.output, p.name);
            let shown = format!("{value:+.3e} ± {std:.1e}");
            summary.add("parameters", key, label, json!({"value": value, "std": std}), shown);
        }
    }
}

fn figures_of_merit(summary: &mut Summary, fit: &OutputFit) {
    let (name, d) = (&fit.output, &fit.diagnostics);
    summary.number("fit", format!("{name}_r2"), format!("{name} R²"), fit.r2, "");
    let label = format!("{name} R² of instants left out (PRESS)");
    summary.number("fit", format!("{name}_predicted_r2"), label, d.predicted_r2, "");
    let mut hidden = |key: &str, value| summary.add("fit", format!("{name}_{key}"), "", value, String::new());
    hidden("theil", json!(d.fit.theil));
    hidden("condition", json!(fit.condition));
    hidden("columns", json!(d.columns));
    hidden("singular_values", json!(d.collinearity.singular_values.as_slice()));
    hidden("variance_inflation", json!(d.collinearity.variance_inflation.as_slice()));
    let rows: Vec<Vec<f64>> = d.correlations.row_iter().map(|r| r.iter().copied().collect()).collect();
    hidden("correlations", json!(rows));
    hidden("residual_autocorrelations", json!(d.autocorrelations));
    let shown = format!("{:.2e}", fit.max_residual);
    let label = format!("{name} largest residual");
    summary.add("fit", format!("{name}_max_residual"), label, json!(fit.max_residual), shown);
    let shown = format!("{} of {}, {:.0}", fit.rank, fit.parameters.len(), fit.condition);
    summary.add("fit", format!("{name}_rank"), format!("{name} rank, condition"), json!(fit.rank), shown);
    if let Some(held) = &d.held_out {
        summary.number(
            "fit",
            format!("{name}_held_out_r2"),
            format!("{name} R² of what was held out"),
            held.r2,
            "",
        );
        let label = format!("{name} Theil's coefficient of it");
        summary.number("fit", format!("{name}_held_out_theil"), label, held.theil, "");
    }
}

/// Table 3 of the paper, one for each estimator, and what the flight could tell apart.
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
    tables.extend(lead_fits(identification).map(told_apart));
    tables
}

fn parameter_rows(fit: &OutputFit) -> Vec<Vec<String>> {
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

/// The same for a terminal.
pub(crate) fn parameter_text(results: &RunResults) -> String {
    let mut rows: Vec<Vec<String>> = results
        .identification
        .iter()
        .flat_map(|i| &i.fits)
        .flat_map(|fit| {
            parameter_rows(fit).into_iter().map(|row| [vec![fit.estimator.name().to_owned()], row].concat())
        })
        .collect();
    rows.extend(crate::motion_fits::text_rows(results));
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

/// Singular values, variance inflation and correlations of one output's columns.
fn told_apart(fit: &OutputFit) -> Table {
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
            "{}: what its independent columns can tell apart, each scaled to length one. Condition indices above 30 are \
             entangled columns.",
            fit.output
        ),
        header: std::iter::once(String::new()).chain(d.columns.clone()).collect(),
        rows,
    }
}

/// Figure 12, and what the fit leaves.
pub(crate) fn figures(results: &RunResults) -> Result<Vec<Figure>> {
    let (Some(table), Some(identification)) = (&results.coefficients, &results.identification) else {
        return Ok(vec![]);
    };
    let (mut panels, mut left, mut echoes) = (Vec::new(), Vec::new(), Vec::new());
    for fit in lead_fits(identification) {
        let Some(output) = table.outputs.iter().find(|o| o.name == fit.output) else { continue };
        let fitted: Vec<f64> = (0..table.t_s.len()).map(|row| fit.line.at(output, row)).collect();
        let inside = |t: f64| t >= table.window_s.0 && t <= table.window_s.1;
        let in_window = |values: Vec<f64>| -> Vec<(f64, f64)> {
            table.t_s.iter().copied().zip(values).filter(|p| inside(p.0)).collect()
        };
        panels.push(Panel {
            axis: output.name.clone(),
            curves: vec![
                curve("from the motion", Role::Estimate, in_window(output.values.clone()).into_iter()),
                curve(words(fit.estimator), Role::Model, in_window(fitted.clone()).into_iter()),
            ],
        });
        let residual = output.values.iter().zip(&fitted).map(|(a, b)| a - b).collect();
        left.push(Panel {
            axis: format!("Δ {}", output.name),
            curves: vec![curve("residual", Role::Estimate, in_window(residual).into_iter())],
        });
        let lags = fit.diagnostics.autocorrelations.iter().enumerate();
        let bound = 1.96 / (fit.diagnostics.fit.count.max(1) as f64).sqrt();
        let last_s = table.sample_interval_s * fit.diagnostics.autocorrelations.len() as f64;
        let level = |v: f64| [(0.0, v), (last_s, v), (last_s, f64::NAN)];
        echoes.push(Panel {
            axis: format!("r({})", output.name),
            curves: vec![
                curve(
                    "autocorrelation of residuals",
                    Role::Estimate,
                    lags.map(|(k, r)| (table.sample_interval_s * (k + 1) as f64, *r)),
                ),
                curve("95 % of white ones", Role::Truth, level(bound).into_iter().chain(level(-bound))),
            ],
        });
    }
    if panels.is_empty() {
        return Ok(vec![]);
    }
    Ok(vec![
        figure(
            "Figure 12: coefficients from the motion and from the fitted model, inside the window that is fitted.",
            panels,
        )?,
        figure("Residuals of figure 12.", left)?,
        figure_over(
            "lag, s",
            "Autocorrelations of those residuals over lags of up to two periods of the low-pass. What passes a low-pass is \
             never white: intervals allow for it.",
            echoes,
        )?,
    ])
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
