//! Equation error: figures of merit, tables, plots.

use crate::chart::{Panel, Role};
use crate::figures::{curve, figure, figure_over};
use crate::html::row;
use crate::parameters::{equation_rows, lead, parameter_table, words};
use crate::summary::Summary;
use crate::{Figure, ReportError, Table};
use mavsight_identify::{Clocks, Identification, OutputFit};
use mavsight_pose::NORMAL_95;
use mavsight_session::RunResults;
use serde_json::json;

fn lead_fits(identification: &Identification) -> impl Iterator<Item = &OutputFit> {
    let lead = lead(identification);
    identification.fits.iter().filter(move |f| Some(f.estimator) == lead)
}

pub(crate) fn summarise(summary: &mut Summary, results: &RunResults) {
    if let Some(Clocks::Lag(lag)) = &results.clocks {
        let shown = format!("{:+.1} ± {:.1} ms", 1e3 * lag.lag_s, 1e3 * lag.std_s);
        let mut section = summary.section("fit");
        section.add("lag_s", "motion behind the inputs' clock", lag.lag_s, shown);
        section.hidden("lag_std_s", lag.std_s);
    }
    let Some(identification) = &results.identification else { return };
    if let Some(lead) = lead(identification) {
        summary.section("fit").add("estimator", "estimator", lead.name(), words(lead.name()));
    }
    for fit in lead_fits(identification) {
        figures_of_merit(summary, fit);
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

fn figures_of_merit(summary: &mut Summary, fit: &OutputFit) {
    let mut section = summary.section_of("fit", &fit.output, &fit.output);
    let d = &fit.diagnostics;
    section.number("r2", "R²", d.fit.r2, "");
    section.number("predicted_r2", "R² of instants left out (PRESS)", d.predicted_r2, "");
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
        section.hidden(key, value);
    }
    let shown = format!("{:.2e}", d.fit.max);
    section.add("max_residual", "largest residual", d.fit.max, shown);
    let shown = format!("{} of {}, {:.0}", fit.rank, fit.parameters.len(), fit.condition);
    section.add("rank", "rank, condition", fit.rank, shown);
    if let Some(held) = &d.held_out {
        section.number("held_out_r2", "R² of the hold-out", held.r2, "");
        section.number("held_out_theil", "Theil's coefficient of it", held.theil, "");
    }
}

/// Table 3 of the paper, one for each estimator, and how far the flight separates the columns.
pub(crate) fn tables(results: &RunResults) -> Vec<Table> {
    let Some(identification) = &results.identification else { return vec![] };
    let mut estimators = Vec::from_iter(lead(identification));
    for fit in &identification.fits {
        if !estimators.contains(&fit.estimator) {
            estimators.push(fit.estimator);
        }
    }
    let parameters = estimators.into_iter().map(|estimator| {
        let fits = identification.fits.iter().filter(|f| f.estimator == estimator);
        let title = format!("Table 3, {}", words(estimator.name()));
        parameter_table(&title, estimator.name(), fits.flat_map(equation_rows).collect())
    });
    parameters.chain(lead_fits(identification).map(separation)).collect()
}

/// Singular values, variance inflation and correlations of one output's columns.
fn separation(fit: &OutputFit) -> Table {
    let d = &fit.diagnostics;
    let show = |label: &str, values: &[f64]| row(label, values.iter().map(|v| format!("{v:.3}")));
    let mut rows = vec![
        show("singular values", d.collinearity.singular_values.as_slice()),
        show("condition indices", d.collinearity.condition_indices.as_slice()),
        show("variance inflation", d.collinearity.variance_inflation.as_slice()),
    ];
    for (k, name) in d.columns.iter().enumerate() {
        let correlations: Vec<f64> = d.correlations.row(k).iter().copied().collect();
        rows.push(show(&format!("correlation with {name}"), &correlations));
    }
    let caption = format!(
        "{}: how separate its independent columns are, each scaled to length one. Condition indices above 30 are \
         entangled columns.",
        fit.output
    );
    Table::new(caption, row("", d.columns.clone()), rows)
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
        let drawn = |label: &str, role: Role, values: &[f64]| {
            let points = std::iter::zip(&table.t_s, values).map(|(t, v)| (*t, *v));
            curve(label, role, points.filter(|p| inside(p.0)))
        };
        let residual: Vec<f64> = output.values.iter().zip(&fitted).map(|(a, b)| a - b).collect();
        panels.push(Panel {
            axis: output.name.clone(),
            curves: vec![
                drawn("from the motion", Role::Estimate, &output.values),
                drawn(words(fit.estimator.name()), Role::Model, &fitted),
            ],
        });
        let curves = vec![drawn("residual", Role::Estimate, &residual)];
        residuals.push(Panel { axis: format!("Δ {}", output.name), curves });
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
    let bound = NORMAL_95 / (fit.diagnostics.fit.count.max(1) as f64).sqrt();
    let last_s = interval_s * all.len() as f64;
    let level = |v: f64| curve("95 % of white ones", Role::Truth, [(0.0, v), (last_s, v)].into_iter());
    let points = all.iter().enumerate().map(|(k, r)| (interval_s * (k + 1) as f64, *r));
    Panel {
        axis: format!("r({})", fit.output),
        curves: vec![
            curve("autocorrelation of residuals", Role::Estimate, points),
            level(bound),
            level(-bound),
        ],
    }
}
