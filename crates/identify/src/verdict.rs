//! Identifiability in words.

use crate::dependence::{Dependence, DependentColumn};
use crate::fit::{Estimator, OutputFit, Parameter};
use crate::table::{Column, Output, column_words};

/// The condition number from which columns are entangled enough to say so (Belsley, Kuh & Welsch 1980,
/// section 3.2).
const ENTANGLED: f64 = 30.0;

/// The combination of parameters that stands behind an independent column, such as `C_X,0 + 4.631·C_X,T_u`.
pub(crate) fn combination(output: &Output, dependence: &Dependence, position: usize) -> String {
    let own = &output.columns[dependence.independent[position]].name;
    let mut text = format!("{},{own}", output.name);
    for dependent in &dependence.dependent {
        let factor = dependent.factors[position];
        if factor != 0.0 {
            let (sign, name) = (if factor < 0.0 { '-' } else { '+' }, &output.columns[dependent.column].name);
            text += &format!(" {sign} {:.4}·{},{name}", factor.abs(), output.name);
        }
    }
    text
}

pub(crate) fn words(output: &Output, dependence: &Dependence, fit: &OutputFit) -> String {
    if fit.independent_samples <= fit.rank as f64 {
        return too_few_samples(output, fit);
    }
    let explained = explained(output, fit);
    if !fit.explains {
        return explained + remedy(fit);
    }
    let mut text = explained + &determined(output, fit);
    if fit.left_out > 0 {
        text += &format!(" {} instants in gaps of the poses were left out.", fit.left_out);
    }
    if let Some(held) = &fit.diagnostics.held_out {
        text += &format!(
            " It predicts the {} instants held out with R² {:.3} and Theil's coefficient {:.3}.",
            held.count, held.r2, held.theil
        );
    }
    // The frequency domain leaves constants out on purpose.
    if fit.estimator != Estimator::FrequencyDomain && !dependence.dependent.is_empty() {
        let name = |d: &DependentColumn| output.columns[d.column].name.as_str();
        let idle: Vec<&str> = dependence.dependent.iter().map(name).collect();
        let (it, itself) = if idle.len() == 1 { ("it", "itself") } else { ("them", "themselves") };
        text += &format!(
            " The flight cannot distinguish {} from the terms listed before: it did not move {it} by {itself}.",
            idle.join(" and ")
        );
        for c in &fit.combinations {
            text += &format!(" Determined is only {} = {:.3e} ± {:.1e}.", c.text, c.value, c.std);
        }
        text += &sum_of_stiffness(output, fit, &idle);
        if let Some(advice) = manoeuvre(&dependent_together(output, dependence)) {
            text += &format!(" To separate them, {advice}.");
        }
    }
    text += &entangled(output, fit);
    text
}

/// How much of the measured coefficient the fit explains, and how much least squares of blocks that it leaves out.
fn explained(output: &Output, fit: &OutputFit) -> String {
    let percent = |r2: f64| if r2 > 0.0 { format!("{:.0} %", 100.0 * r2) } else { "nothing".to_owned() };
    let diagnostics = &fit.diagnostics;
    if fit.estimator == Estimator::FrequencyDomain {
        return String::new();
    }
    let own = percent(diagnostics.fit.r2);
    let left_out = percent(diagnostics.predicted_r2);
    format!(
        "The model explains {own} of {}; least squares, {left_out} of parts that it leaves out. ",
        output.name
    )
}

/// What to do where columns fit whatever was measured.
fn too_few_samples(output: &Output, fit: &OutputFit) -> String {
    format!(
        "{}: behind the low-pass (half at {:.2} Hz) the flight has {:.1} independent samples for {} independent columns, which fit \
         whatever was measured: nothing is determined. Fly for longer, or a livelier manoeuvre, of which the smoother keeps more.",
        output.name, output.bandwidth_hz, fit.independent_samples, fit.rank
    )
}

/// What to do where a fit is further from what was measured than the mean is.
fn remedy(fit: &OutputFit) -> &'static str {
    if fit.diagnostics.predicted_r2 > 0.0 {
        "Do not use this fit: it is worse than the mean, and least squares is not. The errors of the regressors are as large \
         as what the flight moves, so that total least squares does not distinguish them. Least squares (ols) and the fits \
         of the equations of motion (oe, fe) bear that; a livelier manoeuvre mends it."
    } else {
        "Do not use this fit: it is worse than the mean, and so is least squares on parts that it leaves out. The \
         regressors of this equation do not explain what was measured: use the fits of the equations of motion (oe, fe), \
         or another model."
    }
}

/// The dependent columns, and those that they depend on.
fn dependent_together<'a>(output: &'a Output, dependence: &Dependence) -> Vec<&'a Column> {
    let mut out = Vec::new();
    for dependent in &dependence.dependent {
        let factors = dependence.independent.iter().zip(&dependent.factors);
        out.extend(factors.filter(|(_, factor)| **factor != 0.0).map(|(column, _)| &output.columns[*column]));
        out.push(&output.columns[dependent.column]);
    }
    out
}

fn determined(output: &Output, fit: &OutputFit) -> String {
    let significant = |p: &Parameter| p.ci_low.zip(p.ci_high).is_some_and(|(a, b)| a > 0.0 || b < 0.0);
    let names = |wanted: &dyn Fn(&Parameter) -> bool| {
        let list: Vec<&str> =
            fit.parameters.iter().filter(|p| wanted(p)).map(|p| column_words(&p.name)).collect();
        list.join(", ")
    };
    let mut text = format!(
        "{}: {} of {} parameters are determined by themselves.",
        output.name,
        fit.parameters.iter().filter(|p| p.identifiable).count(),
        fit.parameters.len()
    );
    for (what, is_clear) in [("Different from zero at 95 %", true), ("Not distinguished from zero", false)] {
        let names = names(&|p| p.identifiable && significant(p) == is_clear);
        if !names.is_empty() {
            text += &format!(" {what}: {names}.");
        }
    }
    if !output.fixed.is_empty() {
        let fixed: Vec<String> = output.fixed.iter().map(|f| format!("{} = {}", f.name, f.value)).collect();
        text += &format!(" Fixed by the model: {}.", fixed.join(", "));
    }
    text
}

/// At one thrust, a disc's moment per radian is the sum of thrust times height and hub stiffness.
fn sum_of_stiffness(output: &Output, fit: &OutputFit, idle: &[&str]) -> String {
    if !matches!(output.name.as_str(), "C_m" | "C_l") {
        return String::new();
    }
    let mut text = String::new();
    for (rotor, discs) in [("u", ["alpha_u", "beta_u"]), ("l", ["alpha_l", "beta_l"])] {
        let thrust = format!("T_{rotor}");
        let seen = fit.parameters.iter().find(|p| p.identifiable && discs.contains(&p.name.as_str()));
        if let Some(p) = seen.filter(|_| idle.contains(&thrust.as_str())) {
            text += &format!(
                " {},{} is {thrust}·h_{rotor} + hub stiffness: at one thrust the sum is seen, not each.",
                output.name, p.name
            );
        }
    }
    text
}

/// Which columns trade against each other, and what would part them.
fn entangled(output: &Output, fit: &OutputFit) -> String {
    if fit.condition <= ENTANGLED {
        return String::new();
    }
    let mut text = format!(
        " The remaining columns are entangled (condition {:.0}, above {ENTANGLED:.0}): trust their intervals.",
        fit.condition
    );
    let groups = fit.diagnostics.collinearity.entangled(ENTANGLED);
    for group in &groups {
        let names = || group.iter().map(|j| fit.diagnostics.columns[*j].as_str());
        let words: Vec<&str> = names().map(column_words).collect();
        text += &format!(" {} trade against each other", words.join(" and "));
        let columns: Vec<&Column> =
            names().filter_map(|name| output.columns.iter().find(|c| c.name == *name)).collect();
        text += &match manoeuvre(&columns) {
            Some(advice) => format!("; to separate them, {advice}."),
            None => "; fly a manoeuvre with more frequencies to part them.".to_owned(),
        };
    }
    text
}

/// The manoeuvre that moves some columns apart: that of the inputs that drive them, each by itself.
fn manoeuvre(columns: &[&Column]) -> Option<String> {
    let mut inputs: Vec<&str> = columns.iter().flat_map(|c| c.inputs.iter().map(String::as_str)).collect();
    inputs.sort_unstable();
    inputs.dedup();
    match inputs.as_slice() {
        [] => None,
        [one] => Some(format!(
            "move {one} with a multisine from slower than the slowest of the model's time constants to faster than the \
             fastest"
        )),
        [all @ .., last] => {
            Some(format!("move {} and {last}, each by itself, with a multisine or a doublet", all.join(", ")))
        }
    }
}
