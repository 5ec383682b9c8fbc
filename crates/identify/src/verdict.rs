//! Identifiability in words.

use crate::dependence::Dependence;
use crate::fit::{Estimator, OutputFit, Parameter};
use crate::model::factors;
use crate::table::Output;

/// The condition number from which columns are entangled enough to say so (Belsley, Kuh & Welsch 1980,
/// section 3.2).
const ENTANGLED: f64 = 30.0;

/// The combination of parameters that stands behind an independent column, such as `C_X,0 + 4.631·C_X,T_u`.
pub(crate) fn combination(output: &Output, dependence: &Dependence, position: usize) -> String {
    let own = &output.columns[dependence.independent[position]].name;
    let mut text = format!("{},{own}", output.name);
    for (column, factors) in &dependence.dependent {
        let factor = factors[position];
        if factor != 0.0 {
            let sign = if factor < 0.0 { '-' } else { '+' };
            text += &format!(" {sign} {:.4}·{},{}", factor.abs(), output.name, output.columns[*column].name);
        }
    }
    text
}

/// The verdict on one output.
pub(crate) fn words(output: &Output, dependence: &Dependence, fit: &OutputFit) -> String {
    let mut text = determined(output, fit);
    // The frequency domain leaves constants out on purpose.
    if fit.estimator != Estimator::FrequencyDomain && !dependence.dependent.is_empty() {
        let idle: Vec<&str> =
            dependence.dependent.iter().map(|(j, _)| output.columns[*j].name.as_str()).collect();
        text += &format!(
            " The flight cannot distinguish {} from the terms listed before: it did not move {} by {}.",
            listed(&idle),
            if idle.len() == 1 { "it" } else { "them" },
            if idle.len() == 1 { "itself" } else { "themselves" }
        );
        for c in &fit.combinations {
            text += &format!(" Determined is only {} = {:.3e} ± {:.1e}.", c.text, c.value, c.std);
        }
        text += &sum_of_stiffness(output, fit, &idle);
        for advice in idle.iter().filter_map(|name| manoeuvre(&[name])).fold(Vec::new(), once) {
            text += &format!(" To separate them, {advice}.");
        }
    }
    text += &entangled(fit);
    if fit.left_out > 0 {
        text += &format!(" {} instants in gaps of the poses were left out.", fit.left_out);
    }
    if let Some(held) = &fit.diagnostics.held_out {
        text += &format!(
            " It predicts the {} instants held out with R² {:.3} and Theil's coefficient {:.3}.",
            held.count, held.r2, held.theil
        );
    }
    text
}

fn determined(output: &Output, fit: &OutputFit) -> String {
    let significant = |p: &Parameter| p.ci_low.zip(p.ci_high).is_some_and(|(a, b)| a > 0.0 || b < 0.0);
    let names = |wanted: &dyn Fn(&Parameter) -> bool| {
        let list: Vec<&str> = fit.parameters.iter().filter(|p| wanted(p)).map(|p| p.name.as_str()).collect();
        list.join(", ")
    };
    let mut text = format!(
        "{}: {} of {} parameters are determined by themselves.",
        output.name,
        fit.parameters.iter().filter(|p| p.identifiable).count(),
        fit.parameters.len()
    );
    let clear = names(&|p| p.identifiable && significant(p));
    if !clear.is_empty() {
        text += &format!(" Different from zero at 95 %: {clear}.");
    }
    let unclear = names(&|p| p.identifiable && !significant(p));
    if !unclear.is_empty() {
        text += &format!(" Not distinguished from zero: {unclear}.");
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
fn entangled(fit: &OutputFit) -> String {
    if fit.condition <= ENTANGLED {
        return String::new();
    }
    let mut text = format!(
        " The remaining columns are entangled (condition {:.0}, above {ENTANGLED:.0}): trust their intervals.",
        fit.condition
    );
    let groups = fit.diagnostics.collinearity.entangled(ENTANGLED);
    for group in &groups {
        let names: Vec<&str> = group.iter().map(|j| fit.diagnostics.columns[*j].as_str()).collect();
        text += &format!(" {} trade against each other", listed(&names));
        text += &match manoeuvre(&names) {
            Some(advice) => format!("; to separate them, {advice}."),
            None => "; fly a manoeuvre with more frequencies to part them.".to_owned(),
        };
    }
    text
}

/// What moves regressors apart: at least so many names, one of which has one of these signals.
const MANOEUVRES: [(usize, &[&str], &str); 6] = [
    (
        1,
        &["T_u", "T_l", "omega_u", "omega_l", "kappa_u", "kappa_l", "kappa_d"],
        "move the rotor speeds, each by itself, with a multisine or a doublet",
    ),
    (
        2,
        &["delta_lon"],
        "move the longitudinal swash-plate faster than the rotor follows: short steps, 3-2-1-1 or a multisine",
    ),
    (
        2,
        &["delta_lat"],
        "move the lateral swash-plate faster than the rotor follows: short steps, 3-2-1-1 or a multisine",
    ),
    (
        1,
        &["alpha_u", "alpha_l", "q", "u", "w", "delta_lon"],
        "move the longitudinal swash-plate with a multisine from slow, as the fly-bar, to fast, as the rotor",
    ),
    (
        1,
        &["beta_u", "beta_l", "p", "v", "delta_lat"],
        "move the lateral swash-plate with a multisine from slow, as the fly-bar, to fast, as the rotor",
    ),
    (1, &["r"], "turn about the vertical with a doublet of the rotors' speed difference"),
];

/// The manoeuvre that moves the named regressors apart.
fn manoeuvre(names: &[&str]) -> Option<&'static str> {
    let has = |signals: &[&str]| names.iter().any(|n| factors(n).any(|f| signals.contains(&f)));
    let fits = |(count, signals, _): &&(usize, &[&str], &str)| names.len() >= *count && has(signals);
    MANOEUVRES.iter().find(fits).map(|(_, _, advice)| *advice)
}

fn once<'a>(mut seen: Vec<&'a str>, next: &'a str) -> Vec<&'a str> {
    if !seen.contains(&next) {
        seen.push(next);
    }
    seen
}

fn listed(names: &[&str]) -> String {
    names.join(" and ")
}
