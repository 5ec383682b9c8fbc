//! Parameters with the intervals of all estimators drawn beside each other.

use crate::chart::bounds;
use crate::digits::Digits;
use crate::parameters::{lead, words};
use crate::symbols;
use mavsight_flight::Vehicle;
use mavsight_identify::OutputFit;
use mavsight_identify::output_error::{FILTER_ERROR, OUTPUT_ERROR, OutputErrorFit};
use mavsight_session::RunResults;
use serde::Serialize;

/// The fits of the equations of motion, the one whose intervals allow for most errors of the measurements first.
const MOTION_FITS: [&str; 3] = ["image", OUTPUT_ERROR, FILTER_ERROR];

/// One estimate of a parameter.
#[derive(Debug, Clone)]
struct Estimate {
    value: f64,
    std: f64,
    interval: (f64, f64),
    is_determined: bool,
}

/// A parameter by all estimators that have it.
#[derive(Debug, Clone)]
struct Parameter {
    name: String,
    unit: String,
    is_derived: bool,
    /// Which estimator, and its estimate.
    by: Vec<(usize, Estimate)>,
}

/// All parameters of a run. Where equations of motion were fitted, the parameters are theirs, and those of the
/// equations beside them; else those of the equations.
pub(crate) struct Estimates {
    estimators: Vec<String>,
    parameters: Vec<Parameter>,
    /// Number of parameters of the equations without a value, where there are no others.
    without_value: usize,
}

impl Estimates {
    pub(crate) fn of(results: &RunResults) -> Self {
        let fits = MOTION_FITS.iter().filter_map(|n| results.output_error.named().find(|(own, _)| own == n));
        let fits: Vec<(&str, &OutputErrorFit)> = fits.collect();
        let equations = results.identification.as_ref().and_then(|i| Some((i, lead(i)?)));
        let mut estimators: Vec<String> = fits.iter().map(|(name, _)| (*name).to_owned()).collect();
        let mut all = Self { estimators: vec![], parameters: vec![], without_value: 0 };
        for (k, (_, fit)) in fits.iter().enumerate() {
            all.add_motion_fit(k, fit);
        }
        if let Some((identification, estimator)) = equations {
            for fit in identification.fits.iter().filter(|f| f.estimator == estimator) {
                all.add_equation(estimators.len(), fit, fits.is_empty());
            }
            estimators.push(estimator.name().to_owned());
        }
        Self { estimators, ..all }
    }

    fn add_motion_fit(&mut self, k: usize, fit: &OutputErrorFit) {
        for p in &fit.parameters {
            let (interval, is_determined) = ((p.ci_low, p.ci_high), p.identifiable);
            let own = self.parameter(&p.name, &p.unit, false);
            own.by.push((k, Estimate { value: p.value, std: p.std, interval, is_determined }));
        }
        for d in &fit.derived {
            let (interval, is_determined) = ((d.ci_low, d.ci_high), d.identifiable);
            let own = self.parameter(&d.name, &d.unit, true);
            own.by.push((k, Estimate { value: d.value, std: d.std, interval, is_determined }));
        }
    }

    /// The parameters of an equation: all, or those only that are there already.
    fn add_equation(&mut self, k: usize, fit: &OutputFit, is_alone: bool) {
        for p in &fit.parameters {
            let name = format!("{},{}", fit.output, p.name);
            let (Some((value, std)), Some(interval)) = (p.value.zip(p.std), p.ci_low.zip(p.ci_high)) else {
                self.without_value += usize::from(is_alone);
                continue;
            };
            if is_alone || self.parameters.iter().any(|own| own.name == name) {
                let estimate = Estimate { value, std, interval, is_determined: p.identifiable };
                self.parameter(&name, "", false).by.push((k, estimate));
            }
        }
    }

    /// The parameter of a name, which is added where there is none.
    fn parameter(&mut self, name: &str, unit: &str, is_derived: bool) -> &mut Parameter {
        let own = self.parameters.iter().position(|p| p.name == name).unwrap_or(self.parameters.len());
        if own == self.parameters.len() {
            let (name, unit) = (name.to_owned(), unit.to_owned());
            self.parameters.push(Parameter { name, unit, is_derived, by: vec![] });
        }
        &mut self.parameters[own]
    }

    /// Number of parameters that are determined, and of all; derived quantities are not counted.
    pub(crate) fn determined(&self) -> (usize, usize) {
        let own = || self.parameters.iter().filter(|p| !p.is_derived);
        let determined = own().filter(|p| p.best().is_some_and(|(_, e)| e.is_determined)).count();
        (determined, own().count() + self.without_value)
    }

    /// The estimator of the values that are shown; none where there is nothing.
    pub(crate) fn first(&self) -> Option<&str> {
        self.estimators.first().map(String::as_str)
    }

    /// Name and value with standard deviation and unit, as text; those that are not determined say so.
    pub(crate) fn lines(&self) -> Vec<(String, String, &'static str)> {
        let line = |p: &Parameter| {
            let (_, e) = p.best()?;
            let shown = Digits::of(e.value, e.std).with_std(e.value, e.std, &p.unit);
            Some((p.name.clone(), shown, verdict(p, e)))
        };
        self.parameters.iter().filter_map(line).collect()
    }

    /// The table of the report; none without parameters.
    pub(crate) fn table(&self, vehicle: &Vehicle) -> Option<IntervalTable> {
        let rows: Vec<IntervalRow> = self.parameters.iter().filter_map(|p| self.row(p, vehicle)).collect();
        let key = self.estimators.iter().enumerate();
        let key = key.map(|(k, name)| (mark(k, 8.0, 7.0), words(name).to_owned())).collect();
        (!rows.is_empty()).then_some(IntervalTable { key, rows })
    }

    fn row(&self, p: &Parameter, vehicle: &Vehicle) -> Option<IntervalRow> {
        let (k, e) = p.best()?;
        let digits = Digits::of(e.value, e.std);
        let unit = format!("{} {}", digits.factor(), p.unit).trim().to_owned();
        let text = vehicle.model.parameters.iter().find(|own| own.label == p.name || own.name == p.name);
        Some(IntervalRow {
            symbol: symbols::name(&p.name, &p.unit),
            text: text.map_or(String::new(), |own| own.text.clone()),
            value: format!("{} ± {}", digits.text(e.value), digits.text(e.std)),
            whole: digits.with_std(e.value, e.std, &p.unit),
            interval: format!("{} to {}", digits.text(e.interval.0), digits.text(e.interval.1)),
            unit,
            markup: drawn(p, e, &self.estimators),
            verdict: match (verdict(p, e), k) {
                ("", 0) => String::new(),
                ("", k) => format!("by {}", words(&self.estimators[k])),
                (verdict, _) => verdict.to_owned(),
            },
            is_determined: e.is_determined,
        })
    }
}

fn verdict(p: &Parameter, e: &Estimate) -> &'static str {
    match (e.is_determined, p.is_derived) {
        (false, _) => "hardly determined",
        (true, true) => "derived",
        (true, false) => "",
    }
}

impl Parameter {
    /// The first estimate that is determined, or the first.
    fn best(&self) -> Option<(usize, &Estimate)> {
        let all = || self.by.iter().map(|(k, e)| (*k, e));
        all().find(|(_, e)| e.is_determined).or_else(|| all().next())
    }
}

/// Parameters with their intervals.
#[derive(Debug, Clone, Serialize)]
pub struct IntervalTable {
    /// The mark of each estimator, as SVG, and its words.
    key: Vec<(String, String)>,
    rows: Vec<IntervalRow>,
}

/// One parameter of the table.
#[derive(Debug, Clone, Serialize)]
struct IntervalRow {
    /// HTML.
    symbol: String,
    text: String,
    value: String,
    /// The value with its power of ten and unit, for a narrow screen.
    whole: String,
    interval: String,
    unit: String,
    /// The intervals, as SVG.
    markup: String,
    verdict: String,
    is_determined: bool,
}

const WIDTH: f64 = 240.0;
const MARGIN: f64 = 8.0;
const LINE: f64 = 11.0;
/// Intervals are drawn as far as so many half intervals from the shown one: beyond they are cut off.
const FARTHEST: f64 = 4.0;

/// The 95 % intervals of all estimators one below the other, with a line at zero.
fn drawn(p: &Parameter, best: &Estimate, estimators: &[String]) -> String {
    let known = || p.by.iter().map(|(k, e)| (*k, e));
    let (low, high) = best.interval;
    let reach = FARTHEST * 0.5 * (high - low);
    let (from, to) = (best.value - reach, best.value + reach);
    let edges = known().flat_map(|(_, e)| [e.interval.0, e.interval.1]).map(|v| v.clamp(from, to));
    let Some((low, high)) = bounds(edges).filter(|(low, high)| high > low) else { return String::new() };
    let x = |v: f64| MARGIN + (WIDTH - 2.0 * MARGIN) * (v.clamp(low, high) - low) / (high - low);
    let height = LINE * known().count() as f64 + 4.0;
    let mut marks = String::new();
    if low < 0.0 && high > 0.0 {
        marks += &format!("<path class=\"zero\" d=\"M{:.1} 0V{height}\"/>", x(0.0));
    }
    let mut label = Vec::new();
    for (place, (k, e)) in known().enumerate() {
        let y = LINE * (place as f64 + 0.5) + 2.0;
        let faint = if e.is_determined { "" } else { " faint" };
        marks += &format!(
            "<g class=\"by{k}{faint}\"><path d=\"M{:.1} {y}H{:.1}\"/>{}</g>",
            x(e.interval.0),
            x(e.interval.1),
            if (low..=high).contains(&e.value) { mark(k, x(e.value), y) } else { String::new() }
        );
        let digits = Digits::of(e.value, e.std);
        label.push(format!(
            "{} {} to {}{}",
            words(&estimators[k]),
            digits.text(e.interval.0),
            digits.text(e.interval.1),
            digits.factor()
        ));
    }
    let label = symbols::escaped(&label.join("; "));
    format!(
        "<svg role=\"img\" aria-label=\"{label}\" class=\"intervals\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\">{marks}</svg>"
    )
}

/// The mark of an estimator: they differ in shape, so that no reader depends on hue.
fn mark(k: usize, x: f64, y: f64) -> String {
    let at = |dx: f64, dy: f64| format!("{:.1} {:.1}", x + dx, y + dy);
    let corners: &[(f64, f64)] = match k {
        0 => return format!("<circle class=\"mark{k}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\"/>"),
        1 => &[(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)],
        2 => &[(0.0, -5.0), (5.0, 0.0), (0.0, 5.0), (-5.0, 0.0)],
        _ => &[(0.0, -5.0), (5.0, 4.0), (-5.0, 4.0)],
    };
    let corners: Vec<String> = corners.iter().map(|(dx, dy)| at(*dx, *dy)).collect();
    format!("<path class=\"mark{k}\" d=\"M{}Z\"/>", corners.join("L"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(value: f64, std: f64, is_determined: bool) -> Estimate {
        Estimate { value, std, interval: (value - 2.0 * std, value + 2.0 * std), is_determined }
    }

    fn all(by: Vec<(usize, Estimate)>) -> Estimates {
        let parameter = Parameter { name: "C_m,q".into(), unit: "s".into(), is_derived: false, by };
        let estimators = MOTION_FITS.iter().map(|name| (*name).to_owned()).collect();
        Estimates { estimators, parameters: vec![parameter], without_value: 0 }
    }

    #[test]
    fn the_first_estimate_that_is_determined_is_shown_and_all_are_drawn() {
        let by = vec![
            (0, estimate(-1.0, 5.0, false)),
            (1, estimate(-2.0, 0.25, true)),
            (2, estimate(90.0, 0.5, true)),
        ];
        let shown = all(by);
        let table = shown.table(&Vehicle::paper()).expect("a table");
        let row = &table.rows[0];
        assert_eq!((row.value.as_str(), row.interval.as_str()), ("−2.00 ± 0.25", "−2.50 to −1.50"));
        assert_eq!((row.unit.as_str(), row.verdict.as_str()), ("s", "by output error from the poses"));
        assert!(row.text.contains("pitch moment per pitch rate"), "{}", row.text);
        let lines = row.markup.matches("<g class=\"by").count();
        // The value of the last lies beyond what is drawn.
        assert_eq!((lines, row.markup.matches("mark").count()), (3, 2), "{}", row.markup);
        assert_eq!(shown.determined(), (1, 1));
    }

    #[test]
    fn what_is_not_determined_says_so() {
        let weak = all(vec![(0, estimate(1.0, 5.0, false))]);
        assert_eq!(weak.determined(), (0, 1));
        assert_eq!(weak.lines(), [("C_m,q".to_owned(), "1.0 ± 5.0 s".to_owned(), "hardly determined")]);
        assert!(
            Estimates { estimators: vec![], parameters: vec![], without_value: 0 }
                .table(&Vehicle::paper())
                .is_none()
        );
    }
}
