//! Identifiability in words.

use crate::dependence::Dependence;
use crate::fit::{Combination, Parameter};
use crate::regressors::Output;

/// The condition number from which columns are entangled enough to say so (Belsley, Kuh & Welsch 1980, section 3.2).
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

/// What a flight has told about one output.
pub(crate) fn words(
    output: &Output,
    dependence: &Dependence,
    parameters: &[Parameter],
    combinations: &[Combination],
    condition: f64,
) -> String {
    let names = |wanted: &dyn Fn(&Parameter) -> bool| {
        let list: Vec<&str> = parameters.iter().filter(|p| wanted(p)).map(|p| p.name.as_str()).collect();
        list.join(", ")
    };
    let significant = |p: &Parameter| p.ci_low.zip(p.ci_high).is_some_and(|(a, b)| a > 0.0 || b < 0.0);
    let mut text = format!(
        "{}: {} of {} parameters are determined by themselves.",
        output.name,
        parameters.iter().filter(|p| p.identifiable).count(),
        parameters.len()
    );
    let clear = names(&|p| p.identifiable && significant(p));
    if !clear.is_empty() {
        text += &format!(" Different from zero at 95 %: {clear}.");
    }
    let unclear = names(&|p| p.identifiable && !significant(p));
    if !unclear.is_empty() {
        text += &format!(" Not told from zero: {unclear}.");
    }
    if !dependence.dependent.is_empty() {
        let idle: Vec<&str> =
            dependence.dependent.iter().map(|(j, _)| output.columns[*j].name.as_str()).collect();
        text += &format!(
            " The flight cannot tell {} from the terms before: it did not move them by themselves.",
            idle.join(" and ")
        );
        for c in combinations {
            text += &format!(" Determined is only {} = {:.3e} ± {:.1e}.", c.text, c.value, c.std);
        }
        if idle.iter().any(|name| name.starts_with("T_")) {
            text += " To separate them, move the rotor speeds, each by itself.";
        }
    }
    if condition > ENTANGLED {
        text += &format!(
            " The remaining columns are entangled (condition {condition:.0}, above {ENTANGLED:.0}): single values may trade against each other; \
             trust their intervals, and fly a manoeuvre with more frequencies to part them."
        );
    }
    text
}
