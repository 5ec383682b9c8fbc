//! Parameters of several flights: text, and a page with a forest plot.

use crate::parameters::{aligned, with_unit, words};
use crate::svg::{AXIS, Area, BLUE, Drawn, FONT, VERMILION, svg};
use crate::{Figure, Report, ReportError, Table, render};
use mavsight_identify::{Pooled, PooledParameter};
use mavsight_session::{results::names, write_whole};
use plotters::prelude::*;
use std::path::Path;

const LABEL_PX: u32 = 200;
const ROW_PX: u32 = 22;
const HEAD_PX: u32 = 30;
const FOOT_PX: u32 = 30;

/// Pooled parameters as aligned text: mean, standard deviation, 95 % interval, standard deviation between flights, and
/// whether flights differ. Says so where no parameter was determined by two flights.
pub fn pooled_text(flights: &[String], parameters: &[PooledParameter]) -> String {
    let mut text = format!("\nOver {} flights: {}\n", flights.len(), flights.join(", "));
    if parameters.is_empty() {
        text += "  No parameter is determined by two of them.\n";
        return text;
    }
    text += "  mean, standard deviation, 95 % interval, standard deviation between flights, flights\n";
    text + &aligned(&parameters.iter().map(cells).collect::<Vec<_>>())
}

fn cells(p: &PooledParameter) -> Vec<String> {
    let Pooled { mean, std, ci_low, ci_high, between_std, heterogeneity } = p.pooled;
    let number = |v: f64| if v == 0.0 { "0".to_owned() } else { format!("{v:+.3e}") };
    let numbers = [mean, std, ci_low, ci_high, between_std].map(number);
    let verdict = if heterogeneity.is_significant() {
        format!("flights differ (chi-square {:.1} of {})", heterogeneity.chi_square, heterogeneity.degrees)
    } else {
        String::new()
    };
    [
        vec![p.estimator.clone(), with_unit(&p.name, &p.unit)],
        numbers.to_vec(),
        vec![p.flights.len().to_string(), verdict],
    ]
    .concat()
}

/// Writes `flights.html`: for each estimator a table of pooled parameters and a forest plot.
///
/// # Errors
/// A plot that cannot be drawn, or what the file system refuses.
pub fn write_flights_report(
    title: &str,
    flights: &[String],
    parameters: &[PooledParameter],
    out: &Path,
) -> Result<(), ReportError> {
    let differing = parameters.iter().filter(|p| p.pooled.heterogeneity.is_significant()).count();
    let mut report = Report {
        title: format!("mavsight: {title}, {} flights", flights.len()),
        lead: vec![format!(
            "{}. A mean is over flights like these: its 95 % interval covers what differs from flight to flight, not what is \
             wrong alike in all.",
            flights.join(", ")
        )],
        headline: vec![
            ("Flights".into(), flights.len().to_string()),
            ("Parameters pooled".into(), parameters.len().to_string()),
            ("Flights differ in".into(), differing.to_string()),
        ],
        ..Report::default()
    };
    for own in parameters.chunk_by(|a, b| a.estimator == b.estimator) {
        let header =
            ["parameter", "mean", "std", "95 % from", "to", "std between flights", "flights", "verdict"];
        let rows = own.iter().map(|p| cells(p).split_off(1)).collect();
        let name = words(&own[0].estimator);
        let table = Table::new(format!("{name}: means over flights."), header, rows);
        let plots = own.iter().map(|p| {
            let caption = format!(
                "{}: 95 % interval of each flight by {name}, and of the mean (diamond); the shaded band reaches one standard \
                 deviation between flights to either side.",
                with_unit(&p.name, &p.unit)
            );
            Ok(Figure::new(caption, forest(p, flights)?))
        });
        report.add(name, vec![table], plots.collect::<Result<_, ReportError>>()?);
    }
    Ok(write_whole(&out.join(names::FLIGHTS), render(&report)?.as_bytes())?)
}

/// A forest plot (Lewis & Clarke 2001): a line for each flight's interval, a diamond for that of the mean.
fn forest(p: &PooledParameter, flights: &[String]) -> Result<String, ReportError> {
    let edges = p.flights.iter().flat_map(|(_, e)| [e.ci_low, e.ci_high]);
    let Pooled { mean, ci_low, ci_high, between_std, .. } = p.pooled;
    // The interval of a mean of two flights is wide: what it needs beyond three times the flights is cut off.
    let (low, high) = crate::chart::bounds(edges).ok_or(ReportError::Plot("a forest plot has no flight"))?;
    let (low, high) = (ci_low.max(2.0 * low - high).min(low), ci_high.min(2.0 * high - low).max(high));
    let margin = 0.03 * (high - low);
    let rows = p.flights.len() as u32 + 1;
    svg(HEAD_PX + ROW_PX * rows + FOOT_PX, |root| {
        let style = (FONT, 16).into_font().color(&BLACK);
        root.draw(&Text::new(with_unit(&p.name, &p.unit), (12, 8), (FONT, 17)))?;
        let mut chart = ChartBuilder::on(root)
            .margin_top(HEAD_PX)
            .margin_right(18)
            .x_label_area_size(FOOT_PX)
            .y_label_area_size(LABEL_PX)
            .build_cartesian_2d(low - margin..high + margin, 0.0..f64::from(rows))?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .disable_y_axis()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(222, 222, 222))
            .axis_style(AXIS)
            .label_style((FONT, 15))
            .x_labels(7)
            .x_label_formatter(&|x| format!("{x:.3e}"))
            .draw()?;
        let (from, to) = (mean - between_std, mean + between_std);
        let band = [(from.max(low - margin), 0.0), (to.min(high + margin), f64::from(rows))];
        chart.draw_series([Rectangle::new(band, BLUE.mix(0.12).filled())])?;
        for (k, (flight, e)) in p.flights.iter().enumerate() {
            let y = f64::from(rows) - 0.5 - k as f64;
            let line = vec![(e.ci_low, y), (e.ci_high, y)];
            chart.draw_series([PathElement::new(line, BLUE.stroke_width(3))])?;
            chart.draw_series([Circle::new((e.value, y), 4, BLUE.filled())])?;
            name_row(root, &flights[*flight], k, &style)?;
        }
        let diamond =
            [(ci_low.max(low - margin), 0.5), (mean, 0.8), (ci_high.min(high + margin), 0.5), (mean, 0.2)];
        chart.draw_series([Polygon::new(diamond.to_vec(), VERMILION.filled())])?;
        name_row(root, "mean", p.flights.len(), &style)
    })
}

fn name_row(area: &Area<'_>, name: &str, row: usize, style: &TextStyle<'_>) -> Drawn {
    let y = HEAD_PX as i32 + ROW_PX as i32 * row as i32 + 3;
    area.draw(&Text::new(name.to_owned(), (12, y), style.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_identify::{FlightEstimate, pooled};

    fn parameter(values: &[f64]) -> PooledParameter {
        let estimate = |v: &f64| FlightEstimate { value: *v, std: 0.1, ci_low: *v - 0.4, ci_high: *v + 0.4 };
        let estimates: Vec<FlightEstimate> = values.iter().map(estimate).collect();
        PooledParameter {
            estimator: "oe".to_owned(),
            name: "tau_f".to_owned(),
            unit: "s".to_owned(),
            pooled: pooled(&estimates).expect("a mean"),
            flights: estimates.into_iter().enumerate().collect(),
        }
    }

    #[test]
    fn a_forest_has_a_line_for_each_flight_and_a_diamond_for_the_mean() {
        let names = ["one", "two", "three"].map(str::to_owned);
        let svg = forest(&parameter(&[3.0, 3.1, 2.9]), &names).expect("a plot");
        assert_eq!(svg.matches("<circle").count(), 3);
        assert_eq!(svg.matches("<polygon").count(), 1);
        assert!(["one", "two", "three", "mean", "tau_f, s"].iter().all(|name| svg.contains(name)));
    }

    #[test]
    fn what_differs_between_flights_is_said() {
        let names = ["one", "two"].map(str::to_owned);
        let text = pooled_text(&names, &[parameter(&[3.0, 4.0]), parameter(&[3.0, 3.05])]);
        assert_eq!(text.matches("flights differ (chi-square 50.0 of 1)").count(), 1, "{text}");
        assert!(pooled_text(&names, &[]).contains("No parameter is determined by two"));
    }
}
