//! Plan and elevation of a room with its cameras, as SVG.

use crate::ReportError;
use crate::chart::{FONT, WIDTH, scalable};
use plotters::prelude::*;

/// What a box is; decides how it is drawn, so that no reader depends on hue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoxRole {
    /// Walls: black outline.
    Room,
    /// Where cameras may stand: grey fill.
    Stand,
    /// Where none may stand: vermilion diagonals.
    KeepOut,
    /// What blocks the view: dark fill.
    Block,
    /// Where the aircraft flies: green outline and light fill.
    Volume,
}

/// A box in the room.
#[derive(Debug, Clone)]
pub struct DrawnBox {
    /// How it is drawn.
    pub role: BoxRole,
    /// Corner of the least coordinates, m.
    pub low_m: [f64; 3],
    /// Corner of the largest.
    pub high_m: [f64; 3],
}

/// A camera in the room.
#[derive(Debug, Clone)]
pub struct DrawnCamera {
    /// Beside it.
    pub name: String,
    /// Projection centre.
    pub centre_m: [f64; 3],
    /// Far ends of its field of view in the plan: left and right.
    pub across_m: [[f64; 3]; 2],
    /// In the elevation: up and down.
    pub upright_m: [[f64; 3]; 2],
}

/// A room.
#[derive(Debug, Clone)]
pub struct RoomDrawing {
    /// Boxes, drawn in order; the first gives the extent.
    pub boxes: Vec<DrawnBox>,
    /// Cameras.
    pub cameras: Vec<DrawnCamera>,
    /// Control points.
    pub points_m: Vec<[f64; 3]>,
}

const BLUE: RGBColor = RGBColor(0, 114, 178);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const GREY: RGBColor = RGBColor(120, 120, 120);
/// Space for labels.
const LEFT: u32 = 62;
const RIGHT: u32 = 24;
const BELOW: u32 = 46;
const ABOVE: u32 = 34;
const LEGEND: u32 = 34;
const MARGIN_M: f64 = 0.3;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

/// Draws plan (X to the right, Y up) above elevation (X to the right, Z up), both to one scale, as an SVG
/// element that scales with the page.
///
/// # Errors
/// [`ReportError::Plot`] without a first box of some size, or when the plotting library refuses.
pub fn draw_room(room: &RoomDrawing) -> Result<String, ReportError> {
    let failed = |e: String| ReportError::Plot(e);
    let extent = room.boxes.first().filter(|b| (0..3).all(|k| b.high_m[k] - b.low_m[k] > 0.0));
    let extent = extent.ok_or_else(|| failed("a room has no size".to_owned()))?;
    let side = |k: usize| extent.high_m[k] - extent.low_m[k] + 2.0 * MARGIN_M;
    let per_m = f64::from(WIDTH - LEFT - RIGHT) / side(0);
    let height = |k: usize| (per_m * side(k)).round() as u32 + BELOW + ABOVE;
    let whole = height(1) + height(2) + LEGEND;
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (WIDTH, whole)).into_drawing_area();
        root.fill(&WHITE).map_err(|e| failed(e.to_string()))?;
        let (legend, rest) = root.split_vertically(LEGEND);
        let (plan, elevation) = rest.split_vertically(height(1));
        draw_legend(&legend).map_err(|e| failed(e.to_string()))?;
        draw_view(&plan, room, extent, 1, "Plan, from above").map_err(|e| failed(e.to_string()))?;
        draw_view(&elevation, room, extent, 2, "Elevation, towards +Y").map_err(|e| failed(e.to_string()))?;
        root.present().map_err(|e| failed(e.to_string()))?;
    }
    Ok(scalable(&svg, whole))
}

/// One view: X against the axis `up`.
fn draw_view<'a>(
    area: &Area<'a>,
    room: &RoomDrawing,
    extent: &DrawnBox,
    up: usize,
    title: &str,
) -> Drawn<'a> {
    let area = area.titled(title, (FONT, 17))?;
    let range = |k: usize| extent.low_m[k] - MARGIN_M..extent.high_m[k] + MARGIN_M;
    let mut chart = ChartBuilder::on(&area)
        .margin_right(RIGHT)
        .x_label_area_size(BELOW)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(range(0), range(up))?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(232, 232, 232))
        .axis_style(GREY)
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .x_labels(9)
        .y_labels(6)
        .x_desc("X, m")
        .y_desc(if up == 1 { "Y, m" } else { "Z, m" })
        .draw()?;
    for solid in &room.boxes {
        let (low, high) = ((solid.low_m[0], solid.low_m[up]), (solid.high_m[0], solid.high_m[up]));
        let outline = |color: RGBColor, width| Rectangle::new([low, high], color.stroke_width(width));
        match solid.role {
            BoxRole::Room => drop(chart.draw_series([outline(BLACK, 2)])?),
            BoxRole::Stand => {
                chart.draw_series([Rectangle::new([low, high], GREY.mix(0.18).filled())])?;
            }
            BoxRole::Block => {
                chart.draw_series([Rectangle::new([low, high], RGBColor(60, 60, 60).filled())])?;
            }
            BoxRole::Volume => {
                chart.draw_series([Rectangle::new([low, high], GREEN.mix(0.15).filled())])?;
                chart.draw_series([outline(GREEN, 2)])?;
            }
            BoxRole::KeepOut => {
                let thin = VERMILION.stroke_width(1);
                chart.draw_series([outline(VERMILION, 1)])?;
                chart.draw_series([
                    PathElement::new(vec![low, high], thin),
                    PathElement::new(vec![(low.0, high.1), (high.0, low.1)], thin),
                ])?;
            }
        }
    }
    chart.draw_series(room.points_m.iter().map(|p| Cross::new((p[0], p[up]), 4, BLACK.stroke_width(1))))?;
    for camera in &room.cameras {
        let at = (camera.centre_m[0], camera.centre_m[up]);
        let ends = if up == 1 { camera.across_m } else { camera.upright_m };
        for end in ends {
            let line = PathElement::new(vec![at, (end[0], end[up])], BLUE.mix(0.7).stroke_width(1));
            chart.draw_series([line])?;
        }
        chart.draw_series([Circle::new(at, 6, BLUE.filled())])?;
        let style = TextStyle::from((FONT, 16)).color(&BLACK);
        let label = EmptyElement::at(at) + Text::new(camera.name.clone(), (9, -18), style);
        chart.draw_series([label])?;
    }
    Ok(())
}

fn draw_legend<'a>(area: &Area<'a>) -> Drawn<'a> {
    let style = TextStyle::from((FONT, 15)).color(&BLACK);
    let entries = [
        ("camera and its field", 0),
        ("flight volume", 172),
        ("may stand", 306),
        ("keep out", 416),
        ("blocks the view", 518),
        ("control point", 660),
    ];
    for (k, (text, at)) in entries.into_iter().enumerate() {
        let x = LEFT as i32 + at;
        let low = [(x, 10), (x + 16, 24)];
        match k {
            0 => area.draw(&Circle::new((x + 8, 17), 6, BLUE.filled()))?,
            1 => {
                area.draw(&Rectangle::new(low, GREEN.mix(0.15).filled()))?;
                area.draw(&Rectangle::new(low, GREEN.stroke_width(2)))?;
            }
            2 => area.draw(&Rectangle::new(low, GREY.mix(0.18).filled()))?,
            3 => {
                area.draw(&Rectangle::new(low, VERMILION.stroke_width(1)))?;
                area.draw(&PathElement::new(low.to_vec(), VERMILION.stroke_width(1)))?;
            }
            4 => area.draw(&Rectangle::new(low, RGBColor(60, 60, 60).filled()))?,
            _ => area.draw(&Cross::new((x + 8, 17), 4, BLACK.stroke_width(1)))?,
        }
        area.draw(&Text::new(text, (x + 22, 10), style.clone()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> RoomDrawing {
        let solid = |role, low_m, high_m| DrawnBox { role, low_m, high_m };
        RoomDrawing {
            boxes: vec![
                solid(BoxRole::Room, [-5.0, -5.0, 0.0], [5.0, 2.0, 3.0]),
                solid(BoxRole::Stand, [-5.0, -5.0, 0.0], [5.0, -4.0, 3.0]),
                solid(BoxRole::KeepOut, [3.0, 0.0, 0.0], [5.0, 2.0, 3.0]),
                solid(BoxRole::Block, [2.0, -1.0, 0.0], [2.3, -0.7, 3.0]),
                solid(BoxRole::Volume, [-1.0, -1.0, 1.0], [1.0, 1.0, 2.0]),
            ],
            cameras: vec![DrawnCamera {
                name: "cam1".to_owned(),
                centre_m: [4.5, -4.5, 1.5],
                across_m: [[0.0, 1.0, 1.5], [-1.0, 0.0, 1.5]],
                upright_m: [[0.0, 0.0, 3.0], [0.0, 0.0, 0.0]],
            }],
            points_m: vec![[1.5, 1.5, 0.0]],
        }
    }

    #[test]
    fn both_views_have_one_scale_and_all_that_was_given() {
        let svg = draw_room(&room()).expect("a drawing");
        assert_eq!(svg.matches("cam1").count(), 2, "the camera is named in both views");
        assert!(svg.contains("Plan") && svg.contains("Elevation") && svg.contains("Z, m"));
        // The volume's outline: as wide in both views, and as high as it is wide in the plan.
        let outlines: Vec<(i32, i32)> = svg
            .lines()
            .filter(|l| l.contains("stroke=\"#009E73\"") && l.contains("<rect"))
            .filter_map(|l| {
                let number =
                    |key: &str| l.split(&format!("{key}=\"")).nth(1)?.split('"').next()?.parse().ok();
                Some((number(" width")?, number(" height")?))
            })
            .collect();
        let [_, plan, elevation] = outlines[..] else { panic!("{outlines:?}") };
        assert!((plan.0 - plan.1).abs() <= 3 && plan.0 == elevation.0, "{outlines:?}");
        assert!((elevation.1 * 2 - elevation.0).abs() <= 5, "{outlines:?}");
    }

    #[test]
    fn a_room_without_size_is_refused() {
        let mut flat = room();
        flat.boxes[0].high_m[2] = 0.0;
        assert!(matches!(draw_room(&flat), Err(ReportError::Plot(_))));
        assert!(draw_room(&RoomDrawing { boxes: vec![], cameras: vec![], points_m: vec![] }).is_err());
    }
}
