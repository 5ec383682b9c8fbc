//! Values over planes as colours, side by side under one scale, as SVG.

use crate::ReportError;
use crate::chart::bounds;
use crate::svg::{AXIS, Area, Drawn, FONT, WIDTH, svg};
use mavsight_pose::{MapPlane, Volume};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// One plane of values, X to the right.
pub(crate) struct HeatMap {
    title: String,
    y_axis: &'static str,
    x: (f64, f64),
    y: (f64, f64),
    columns: usize,
    rows: usize,
    /// First side first, from the lower left; none is left white with a cross.
    values: Vec<Option<f64>>,
}

impl HeatMap {
    /// The horizontal and the upright plane through a volume's middle, `cells` along each side.
    pub(crate) fn through(
        volume: &Volume,
        cells: usize,
        values: impl Fn(MapPlane) -> Vec<Option<f64>>,
    ) -> [Self; 2] {
        let middle = 0.5 * (volume.low_m + volume.high_m);
        let map = |title: String, y_axis: &'static str, up: usize, plane: MapPlane| Self {
            title,
            y_axis,
            x: (volume.low_m.x, volume.high_m.x),
            y: (volume.low_m[up], volume.high_m[up]),
            columns: cells,
            rows: cells,
            values: values(plane),
        };
        [
            map(format!("horizontal, Z = {:.2} m", middle.z), "Y, m", 1, volume.horizontal()),
            map(format!("upright, Y = {:.2} m", middle.y), "Z, m", 2, volume.vertical()),
        ]
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.values.iter().all(Option::is_none)
    }
}

const HEIGHT: u32 = 400;
const BAR_WIDTH: u32 = 110;
const BAR_STEPS: usize = 64;

/// The colour at a part of the scale, 0 to 1: Cividis (Nuñez, Anderton & Renslow 2018), which rises in
/// lightness and reads the same with red-green blindness.
fn color(part: f64) -> RGBColor {
    let colorous::Color { r, g, b } = colorous::CIVIDIS.eval_continuous(part.clamp(0.0, 1.0));
    RGBColor(r, g, b)
}

/// Draws maps with a common colour bar, whose unit is given, as an SVG element that scales with the page.
pub(crate) fn draw_heat_maps(maps: &[HeatMap], unit: &str) -> Result<String, ReportError> {
    if maps.iter().any(|m| m.values.len() != m.columns * m.rows || m.values.is_empty()) {
        return Err(ReportError::Plot("a map has not as many values as cells"));
    }
    let values = maps.iter().flat_map(|m| &m.values).flatten().copied();
    let (low, high) = bounds(values).ok_or(ReportError::Plot("a map has no finite value"))?;
    // One value everywhere still has a bar.
    let scale = if high > low { (low, high) } else { (0.9 * low, 1.1 * high + f64::MIN_POSITIVE) };
    svg(HEIGHT, |root| {
        let (body, bar) = root.split_horizontally(WIDTH - BAR_WIDTH);
        for (area, map) in body.split_evenly((1, maps.len())).iter().zip(maps) {
            draw_map(area, map, scale)?;
        }
        draw_bar(&bar, scale, unit)
    })
}

fn draw_map(area: &Area<'_>, map: &HeatMap, scale: (f64, f64)) -> Drawn {
    let area = area.titled(&map.title, (FONT, 17))?;
    let mut chart = ChartBuilder::on(&area)
        .margin_right(14)
        .margin_top(6)
        .x_label_area_size(46)
        .y_label_area_size(62)
        .build_cartesian_2d(map.x.0..map.x.1, map.y.0..map.y.1)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .axis_style(AXIS)
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .x_labels(5)
        .y_labels(6)
        .x_desc("X, m")
        .y_desc(map.y_axis)
        .draw()?;
    let step = ((map.x.1 - map.x.0) / map.columns as f64, (map.y.1 - map.y.0) / map.rows as f64);
    let corner =
        |column: usize, row: usize| (map.x.0 + step.0 * column as f64, map.y.0 + step.1 * row as f64);
    for (k, value) in map.values.iter().enumerate() {
        let (column, row) = (k % map.columns, k / map.columns);
        let (low, high) = (corner(column, row), corner(column + 1, row + 1));
        // Cells reach below the next ones, so that no seam shows between them.
        let over = ((high.0 + 0.5 * step.0).min(map.x.1), (high.1 + 0.5 * step.1).min(map.y.1));
        match value.filter(|v| v.is_finite()) {
            Some(v) => {
                let fill = color((v - scale.0) / (scale.1 - scale.0)).filled();
                chart.draw_series([Rectangle::new([low, over], fill)])?;
            }
            None => {
                let line = RGBColor(150, 150, 150).stroke_width(1);
                chart.draw_series([Rectangle::new([low, over], WHITE.filled())])?;
                chart.draw_series([PathElement::new(vec![low, high], line)])?;
            }
        }
    }
    for (k, value) in label_cells(map) {
        let (low, part) = (corner(k % map.columns, k / map.columns), (value - scale.0) / (scale.1 - scale.0));
        let style = TextStyle::from((FONT, 15)).color(if part > 0.55 { &BLACK } else { &WHITE });
        let middle = (low.0 + 0.5 * step.0, low.1 + 0.5 * step.1);
        let style = style.pos(Pos::new(HPos::Center, VPos::Center));
        chart.draw_series([Text::new(three_digits(value), middle, style)])?;
    }
    Ok(())
}

/// Cells on a grid of three by three that bear their value.
fn label_cells(map: &HeatMap) -> Vec<(usize, f64)> {
    let places = |n: usize| [n / 6, n / 2, n - 1 - n / 6];
    let cells =
        places(map.rows).into_iter().flat_map(|row| places(map.columns).map(|c| row * map.columns + c));
    let mut out: Vec<(usize, f64)> =
        cells.filter_map(|k| Some((k, map.values[k].filter(|v| v.is_finite())?))).collect();
    out.dedup_by_key(|cell| cell.0);
    out
}

fn three_digits(value: f64) -> String {
    match value.abs() {
        v if v >= 99.5 => format!("{value:.0}"),
        v if v >= 9.95 => format!("{value:.1}"),
        v if v >= 0.995 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

fn draw_bar(area: &Area<'_>, scale: (f64, f64), unit: &str) -> Drawn {
    let area = area.titled(unit, (FONT, 17))?;
    let mut chart = ChartBuilder::on(&area)
        .margin_top(6)
        .margin_right(18)
        .margin_bottom(46)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..1.0, scale.0..scale.1)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .axis_style(AXIS)
        .label_style((FONT, 15))
        .y_labels(6)
        .y_label_formatter(&|v| three_digits(*v))
        .draw()?;
    let part = |k: usize| k as f64 / BAR_STEPS as f64;
    let at = |k: usize| scale.0 + (scale.1 - scale.0) * part(k);
    chart.draw_series((0..BAR_STEPS).map(|k| {
        let to = if k + 2 < BAR_STEPS { k + 2 } else { BAR_STEPS };
        Rectangle::new([(0.0, at(k)), (1.0, at(to))], color(part(k) + 0.5 / BAR_STEPS as f64).filled())
    }))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: Vec<Option<f64>>) -> HeatMap {
        HeatMap {
            title: "z = 1.5 m".to_owned(),
            y_axis: "Y, m",
            x: (-1.5, 1.5),
            y: (-1.5, 1.5),
            columns: 2,
            rows: values.len() / 2,
            values,
        }
    }

    #[test]
    fn the_least_and_the_largest_have_the_ends_of_the_scale_and_the_unseen_none() {
        let svg =
            draw_heat_maps(&[map(vec![Some(1.0), Some(3.0), None, Some(f64::NAN)])], "mm").expect("a map");
        assert!(svg.contains("#002051") && svg.contains("#FDE945"), "{svg}");
        assert_eq!(svg.matches("#969696").count(), 2, "two cells are crossed out");
        assert!(svg.contains("mm") && svg.contains("1.00") && svg.contains("3.00") && !svg.contains("NaN"));
    }

    #[test]
    fn one_value_has_a_bar_and_none_or_too_few_are_refused() {
        assert!(draw_heat_maps(&[map(vec![Some(2.0), Some(2.0)])], "mm").is_ok());
        assert!(matches!(draw_heat_maps(&[map(vec![None, None])], "mm"), Err(ReportError::Plot(_))));
        let mut short = map(vec![Some(1.0), Some(2.0)]);
        short.rows = 2;
        assert!(matches!(draw_heat_maps(&[short], "mm"), Err(ReportError::Plot(_))));
    }

    #[test]
    fn the_scale_rises_in_lightness() {
        let lightness = |part: f64| {
            let RGBColor(r, g, b) = color(part);
            0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
        };
        assert!((0..20).all(|k| lightness(f64::from(k + 1) / 20.0) > lightness(f64::from(k) / 20.0)));
    }
}
