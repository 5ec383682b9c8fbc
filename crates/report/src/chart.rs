//! Stacked panels over one time axis, as SVG.

use crate::ReportError;
use crate::svg::{AXIS, Area, BLUE, Drawn, FONT, SKY, VERMILION, svg};
use crate::symbols;
use plotters::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::ops::Range;

/// What a curve shows; decides its colour, width and dashes together, so that no reader depends on hue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Known truth: black, dashed.
    Truth,
    /// Single measurements: small dots.
    Measured,
    /// The estimate: blue, solid.
    Estimate,
    /// A fitted model, or a second quantity: vermilion, solid, thin.
    Model,
}

impl Role {
    /// The name by which the page's script and its style know it.
    fn name(self) -> &'static str {
        match self {
            Self::Truth => "truth",
            Self::Measured => "measured",
            Self::Estimate => "estimate",
            Self::Model => "model",
        }
    }

    fn color(self) -> RGBColor {
        match self {
            Self::Truth => BLACK,
            Self::Measured => SKY,
            Self::Estimate => BLUE,
            Self::Model => VERMILION,
        }
    }
}

/// One curve; points that are not finite break it.
#[derive(Debug, Clone)]
pub(crate) struct Curve {
    pub label: String,
    pub role: Role,
    /// Time in seconds and value.
    pub points: Vec<(f64, f64)>,
    /// Half the width of the band around each point; empty for none.
    pub half_width: Vec<f64>,
}

impl Curve {
    /// The curve with no more points than its plot can show: of each column the first and the last point, the lowest and
    /// the highest edge, and a break where there is one. Unchanged if it has fewer.
    pub(crate) fn thinned(self) -> Self {
        let times = || self.points.iter().map(|p| p.0);
        let Some((start, end)) = bounds(times()).filter(|(start, end)| end > start) else { return self };
        let columns = COLUMNS;
        if self.points.len() <= MOST_OF_A_COLUMN * columns {
            return self;
        }
        let half = |k: usize| self.half_width.get(k).copied().unwrap_or(0.0);
        let column = |k: usize| ((self.points[k].0 - start) / (end - start) * columns as f64) as usize;
        let indices: Vec<usize> = (0..self.points.len()).collect();
        let mut kept = Vec::new();
        for own in indices.chunk_by(|a, b| column(*a) == column(*b)) {
            let edge = |k: usize, side: f64| self.points[k].1 + side * half(k);
            let sound = || own.iter().copied().filter(|k| edge(*k, 1.0).is_finite());
            let low = sound().min_by(|a, b| edge(*a, -1.0).total_cmp(&edge(*b, -1.0)));
            let high = sound().max_by(|a, b| edge(*a, 1.0).total_cmp(&edge(*b, 1.0)));
            let broken = own.iter().copied().find(|k| !self.points[*k].1.is_finite());
            let ends = [own.first().copied(), own.last().copied()];
            kept.extend(BTreeSet::from_iter(ends.into_iter().chain([low, high, broken]).flatten()));
        }
        let half_width =
            if self.half_width.is_empty() { vec![] } else { kept.iter().map(|k| half(*k)).collect() };
        let points = kept.iter().map(|k| self.points[*k]).collect();
        Self { points, half_width, label: self.label, role: self.role }
    }
}

/// Columns of a plot, and points of one beyond which a curve is thinned, so that the page of an hour is small.
const COLUMNS: usize = 250;
const MOST_OF_A_COLUMN: usize = 5;

pub(crate) struct Panel {
    /// Quantity and unit, beside the axis.
    pub axis: String,
    pub curves: Vec<Curve>,
}

pub(crate) struct Chart {
    /// Quantity and unit of that, below the last.
    pub axis: &'static str,
    pub panels: Vec<Panel>,
}

const PANEL_HEIGHT: u32 = 200;
const LEGEND_HEIGHT: u32 = 34;
const BAND_OPACITY: f64 = 0.22;

/// Draws a chart as an SVG element that scales with the page.
pub(crate) fn draw(chart: &Chart) -> Result<String, ReportError> {
    let points = chart.panels.iter().flat_map(|p| &p.curves).flat_map(|c| &c.points);
    let (start, end) = bounds(points.map(|p| p.0)).ok_or(ReportError::Plot("a chart has no finite point"))?;
    let height = LEGEND_HEIGHT + PANEL_HEIGHT * chart.panels.len() as u32 + 24;
    let drawn = svg(height, |root| {
        let (head, body) = root.split_vertically(LEGEND_HEIGHT);
        legend(&head, chart)?;
        let areas = body.split_evenly((chart.panels.len(), 1));
        for (k, (area, panel)) in areas.iter().zip(&chart.panels).enumerate() {
            let last = k + 1 == chart.panels.len();
            draw_panel(area, panel, start..end, last.then_some(chart.axis))?;
        }
        Ok(())
    });
    Ok(dotted_and_dashed(&drawn?))
}

/// A drawing with each run of small circles as one path, and with truth dashed: an element for each dot and each dash would
/// be ten times the text.
fn dotted_and_dashed(svg: &str) -> String {
    let (mut out, mut dots) = (String::with_capacity(svg.len()), String::new());
    let number = |line: &str, key: &str| Some(line.split_once(key)?.1.split_once('"')?.0.to_owned());
    for line in svg.lines() {
        let dot = line.starts_with("<circle").then(|| Some((number(line, "cx=\"")?, number(line, "cy=\"")?)));
        if let Some((x, y)) = dot.flatten() {
            dots += &format!("M{x} {y}h0");
            continue;
        }
        out += &dot_path(&std::mem::take(&mut dots));
        if line.starts_with("<polyline") && line.contains("stroke=\"#000000\"") {
            out += &line.replacen("<polyline", "<polyline stroke-dasharray=\"7 5\"", 1);
        } else {
            out += line;
        }
        out.push('\n');
    }
    out
}

fn dot_path(dots: &str) -> String {
    let RGBColor(r, g, b) = Role::Measured.color();
    let style = format!("stroke=\"#{r:02X}{g:02X}{b:02X}\" stroke-width=\"4\" stroke-linecap=\"round\"");
    if dots.is_empty() { String::new() } else { format!("<path d=\"{dots}\" {style}/>\n") }
}

/// The numbers of a chart for the page's script: panels with their curves, each with times `t`, values `v` and half the
/// widths `h` of its band; where a curve is broken, nulls.
pub(crate) fn data(chart: &Chart) -> Value {
    let points = || chart.panels.iter().flat_map(|p| &p.curves).flat_map(|c| &c.points);
    let time = Rounding::of(points().map(|p| p.0));
    let panel = |panel: &Panel| {
        let edges = panel.curves.iter().flat_map(band).flat_map(|(_, low, high)| [low, high]);
        let value = Rounding::of(panel.curves.iter().flat_map(|c| &c.points).map(|p| p.1).chain(edges));
        let curve = |curve: &Curve| {
            // Where time itself is not known there is nothing to draw.
            let known = || (0..curve.points.len()).filter(|k| curve.points[*k].0.is_finite());
            let half = |k: usize| curve.half_width.get(k).map(|half| value.json(*half));
            json!({
                "label": curve.label, "role": curve.role.name(),
                "t": known().map(|k| time.json(curve.points[k].0)).collect::<Vec<_>>(),
                "v": known().map(|k| value.json(curve.points[k].1)).collect::<Vec<_>>(),
                "h": known().filter_map(half).collect::<Vec<_>>(),
            })
        };
        let curves: Vec<Value> = panel.curves.iter().map(curve).collect();
        json!({"axis": symbols::html(&panel.axis), "curves": curves})
    };
    json!({"axis": chart.axis, "panels": chart.panels.iter().map(panel).collect::<Vec<_>>()})
}

/// Numbers to a hundred-thousandth of their span: finer than any screen, with few digits.
#[derive(Clone, Copy)]
struct Rounding(i32);

impl Rounding {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let span =
            bounds(values).map_or(1.0, |(low, high)| (high - low).max(1e-5 * high.abs().max(low.abs())));
        Self(if span > 0.0 { 5 - span.log10().floor() as i32 } else { 5 })
    }

    fn json(self, value: f64) -> Value {
        if !value.is_finite() {
            return Value::Null;
        }
        // Through text, so that the number is the nearest to its digits and is written with these.
        let decimals = usize::try_from(self.0.clamp(0, 30)).unwrap_or(0);
        format!("{value:.decimals$}").parse::<f64>().map_or(Value::Null, |v| json!(v))
    }
}

fn legend(area: &Area<'_>, chart: &Chart) -> Drawn {
    let mut seen: Vec<&str> = Vec::new();
    let mut x = 96;
    for curve in chart.panels.iter().flat_map(|p| &p.curves) {
        if seen.contains(&curve.label.as_str()) {
            continue;
        }
        seen.push(&curve.label);
        let y = 16;
        stroke(area, curve.role, &[(x, y), (x + 32, y)])?;
        area.draw(&Text::new(curve.label.clone(), (x + 40, y - 8), (FONT, 17)))?;
        x += 64 + 9 * i32::try_from(curve.label.chars().count()).unwrap_or(20);
    }
    Ok(())
}

fn stroke(area: &Area<'_>, role: Role, points: &[(i32, i32); 2]) -> Drawn {
    let style = role.color().stroke_width(if role == Role::Model { 2 } else { 3 });
    match role {
        Role::Measured => {
            for k in 0..4 {
                area.draw(&Circle::new((points[0].0 + 4 + 8 * k, points[0].1), 2, role.color().filled()))?;
            }
            Ok(())
        }
        Role::Truth | Role::Estimate | Role::Model => area.draw(&PathElement::new(points.to_vec(), style)),
    }
}

fn draw_panel(area: &Area<'_>, panel: &Panel, times: Range<f64>, axis: Option<&str>) -> Drawn {
    let edges = panel.curves.iter().flat_map(band).flat_map(|(_, low, high)| [low, high]);
    let values = panel.curves.iter().flat_map(|c| &c.points).map(|p| p.1).chain(edges);
    let (low, high) = bounds(values).unwrap_or((-1.0, 1.0));
    // A constant gets an axis of a thousandth of its size, so that its ticks differ.
    let floor = 1e-9_f64.max(2e-3 * low.abs().max(high.abs()));
    let margin = if high > low { 0.08 * (high - low) } else { floor };
    let mut chart = ChartBuilder::on(area)
        .margin_right(18)
        .margin_top(8)
        .x_label_area_size(if axis.is_some() { 44 } else { 12 })
        .y_label_area_size(96)
        .build_cartesian_2d(times, (low - margin)..(high + margin))?;
    let span = high - low + 2.0 * margin;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(222, 222, 222))
        .axis_style(AXIS)
        .label_style((FONT, 16))
        .axis_desc_style((FONT, 17))
        .x_labels(11)
        .y_labels(5)
        .x_desc(axis.unwrap_or(""))
        .y_desc(panel.axis.as_str())
        .x_label_formatter(&|x| {
            if axis.is_some() {
                format!("{x:.4}").trim_end_matches('0').trim_end_matches('.').to_owned()
            } else {
                String::new()
            }
        })
        .y_label_formatter(&|y| tick(*y, span))
        .draw()?;
    for curve in &panel.curves {
        let edges: Vec<_> = band(curve).collect();
        for run in edges.split(|(t, low, high)| !(t + low + high).is_finite()).filter(|r| r.len() > 1) {
            let below = run.iter().map(|(t, low, _)| (*t, *low));
            let above = run.iter().rev().map(|(t, _, high)| (*t, *high));
            let fill = curve.role.color().mix(BAND_OPACITY).filled();
            chart.draw_series([Polygon::new(below.chain(above).collect::<Vec<_>>(), fill)])?;
        }
    }
    for curve in &panel.curves {
        let style = curve.role.color().stroke_width(if curve.role == Role::Model { 1 } else { 2 });
        for run in curve.points.split(|p| !(p.0.is_finite() && p.1.is_finite())).filter(|r| !r.is_empty()) {
            match curve.role {
                Role::Measured => {
                    chart.draw_series(run.iter().map(|p| Circle::new(*p, 2, curve.role.color().filled())))?;
                }
                Role::Truth | Role::Estimate | Role::Model => {
                    chart.draw_series(LineSeries::new(run.iter().copied(), style))?;
                }
            }
        }
    }
    Ok(())
}

/// Time, lower and upper edge of a curve's band.
fn band(curve: &Curve) -> impl Iterator<Item = (f64, f64, f64)> {
    curve.points.iter().zip(&curve.half_width).map(|((t, value), half)| (*t, value - half, value + half))
}

/// A tick's label with as many digits as the axis' span asks for.
fn tick(value: f64, span: f64) -> String {
    if value.abs() < 1e-9 * span {
        return "0".to_owned();
    }
    if !(1e-2..=1e5).contains(&span) {
        // As many digits as distinguish neighbouring ticks, a tenth of the span apart.
        let digits = (value.abs().log10().floor() - span.log10().floor() + 1.0).clamp(1.0, 6.0) as usize;
        return format!("{value:.digits$e}");
    }
    let digits = (1.0 - span.log10().floor()).clamp(0.0, 5.0) as usize;
    format!("{value:.digits$}")
}

pub(crate) fn bounds(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|v| v.is_finite()).fold(None, |b, v| match b {
        None => Some((v, v)),
        Some((low, high)) => Some((f64::min(low, v), f64::max(high, v))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<(f64, f64)>) -> Chart {
        let curve = Curve { label: "a <b>".to_owned(), role: Role::Estimate, points, half_width: vec![] };
        Chart { axis: "time, s", panels: vec![Panel { axis: "x, m".to_owned(), curves: vec![curve] }] }
    }

    #[test]
    fn what_is_not_finite_breaks_the_line_and_never_reaches_the_page() {
        let svg = draw(&chart(vec![(0.0, 1.0), (1.0, 2.0), (2.0, f64::NAN), (3.0, 1.0), (4.0, 1.5)]))
            .expect("a plot");
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg.matches("stroke=\"#0072B2\"").count(), 3, "two runs and the legend");
        assert!(svg.contains("a &lt;b&gt;") && svg.contains("viewBox"));
    }

    #[test]
    fn a_long_curve_keeps_its_edges_its_band_and_its_breaks() {
        let points: Vec<(f64, f64)> = (0..100_000)
            .map(|k| {
                let t = f64::from(k) / 30.0;
                let value = if k == 70_000 { 50.0 } else { (0.01 * t).sin() };
                (t, if (20_000..20_400).contains(&k) { f64::NAN } else { value })
            })
            .collect();
        let half_width = (0..100_000).map(|k| if k == 40_000 { 9.0 } else { 0.1 }).collect();
        let long = Curve { label: "long".to_owned(), role: Role::Estimate, points, half_width };
        let thin = long.clone().thinned();
        assert!(thin.points.len() <= MOST_OF_A_COLUMN * (COLUMNS + 1), "{}", thin.points.len());
        assert_eq!(thin.points.len(), thin.half_width.len());
        let at = |k: usize| thin.points.iter().position(|p| *p == long.points[k]);
        assert!(at(0).is_some() && at(99_999).is_some() && at(70_000).is_some());
        assert_eq!(at(40_000).map(|k| thin.half_width[k]), Some(9.0));
        assert!(thin.points.iter().any(|p| p.1.is_nan()));
        assert!(thin.points.windows(2).all(|w| w[0].0 < w[1].0));
        let short = Curve { points: long.points[..1200].to_vec(), half_width: vec![], ..long };
        assert_eq!(short.clone().thinned().points.len(), 1200);
    }

    #[test]
    fn neighbouring_ticks_of_a_small_span_differ() {
        let labels: Vec<String> = (0..5).map(|k| tick(-0.0243 - 2e-6 * f64::from(k), 1e-5)).collect();
        assert!(labels.windows(2).all(|pair| pair[0] != pair[1]), "{labels:?}");
    }

    #[test]
    fn a_band_breaks_with_its_curve() {
        let mut banded = chart(vec![(0.0, 1.0), (1.0, 2.0), (2.0, f64::NAN), (3.0, 1.0), (4.0, 1.5)]);
        assert!(!draw(&banded).expect("a plot").contains("<polygon"));
        banded.panels[0].curves[0].half_width = vec![0.5; 5];
        let svg = draw(&banded).expect("a plot");
        assert_eq!(svg.matches("<polygon").count(), 2);
        assert!(!svg.contains("NaN"));
    }

    /// A page has about forty curves, and fewer than three megabytes.
    #[test]
    fn an_hour_of_a_curve_is_small_both_drawn_and_as_numbers() {
        for role in [Role::Measured, Role::Estimate, Role::Truth] {
            let mut hour = chart((0..108_000).map(|k| (f64::from(k) / 30.0, f64::from(k).sin())).collect());
            let curve = &mut hour.panels[0].curves[0];
            curve.role = role;
            curve.half_width = if role == Role::Estimate { vec![0.1; 108_000] } else { vec![] };
            *curve = curve.clone().thinned();
            let bytes = draw(&hour).expect("a plot").len() + data(&hour).to_string().len();
            assert!(bytes < 75_000, "{role:?}: {bytes}");
        }
    }

    #[test]
    fn the_numbers_of_a_chart_are_those_of_its_curves_and_breaks_are_nulls() {
        let mut banded = chart(vec![(0.0, 1e-5), (1.0 / 3.0, 2e-5), (1.0, f64::NAN), (f64::NAN, 1.0)]);
        banded.panels[0].curves[0].half_width = vec![1e-6, 2e-6, f64::INFINITY, 0.0];
        let data = data(&banded);
        let curve = &data["panels"][0]["curves"][0];
        assert_eq!(curve["t"], json!([0.0, 0.33333, 1.0]));
        assert_eq!(curve["v"].as_array().map(Vec::len), Some(3));
        assert!((curve["v"][1].as_f64().expect("a value") - 2e-5).abs() < 1e-9 && curve["v"][2].is_null());
        assert!(curve["h"][2].is_null() && curve["role"] == "estimate");
    }

    #[test]
    fn a_constant_and_a_single_point_have_axes_and_nothing_is_an_error() {
        assert!(draw(&chart(vec![(0.0, 5.0), (1.0, 5.0)])).is_ok());
        assert!(matches!(draw(&chart(vec![(f64::NAN, 1.0)])), Err(ReportError::Plot(_))));
    }
}
