//! Plan and elevation of a room with its cameras, as SVG.

use crate::ReportError;
use crate::svg::{AXIS, Area, BLUE, Drawn, FONT, GREEN, VERMILION, WIDTH, svg};
use plotters::prelude::*;

/// What a box is; decides how it is drawn, so that no reader depends on hue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BoxRole {
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

pub(crate) struct DrawnBox {
    pub role: BoxRole,
    pub low_m: [f64; 3],
    pub high_m: [f64; 3],
}

pub(crate) struct DrawnCamera {
    pub name: String,
    pub centre_m: [f64; 3],
    /// Far ends of its field of view in the plan: left and right.
    pub across_m: [[f64; 3]; 2],
    /// In the elevation: up and down.
    pub upright_m: [[f64; 3]; 2],
}

pub(crate) struct RoomDrawing {
    /// Drawn in order; the first gives the extent.
    pub boxes: Vec<DrawnBox>,
    pub cameras: Vec<DrawnCamera>,
    /// Control points.
    pub points_m: Vec<[f64; 3]>,
}

const LEFT: u32 = 62;
const RIGHT: u32 = 24;
const BELOW: u32 = 46;
const ABOVE: u32 = 34;
const LEGEND: u32 = 34;
const MARGIN_M: f64 = 0.3;

impl BoxRole {
    fn styles(self) -> [Option<ShapeStyle>; 2] {
        match self {
            Self::Room => [None, Some(BLACK.stroke_width(2))],
            Self::Stand => [Some(AXIS.mix(0.18).filled()), None],
            Self::KeepOut => [None, Some(VERMILION.stroke_width(1))],
            Self::Block => [Some(RGBColor(60, 60, 60).filled()), None],
            Self::Volume => [Some(GREEN.mix(0.15).filled()), Some(GREEN.stroke_width(2))],
        }
    }

    fn rectangles<C: Copy>(self, corners: [C; 2]) -> impl Iterator<Item = Rectangle<C>> {
        self.styles().into_iter().flatten().map(move |style| Rectangle::new(corners, style))
    }
}

/// Draws plan (X to the right, Y up) above elevation (X to the right, Z up), both to one scale, as an SVG
/// element that scales with the page.
pub(crate) fn draw_room(room: &RoomDrawing) -> Result<String, ReportError> {
    let extent = room.boxes.first().filter(|b| (0..3).all(|k| b.high_m[k] - b.low_m[k] > 0.0));
    let extent = extent.ok_or(ReportError::Plot("a room has no size"))?;
    let side = |k: usize| extent.high_m[k] - extent.low_m[k] + 2.0 * MARGIN_M;
    let per_m = f64::from(WIDTH - LEFT - RIGHT) / side(0);
    let height = |k: usize| (per_m * side(k)).round() as u32 + BELOW + ABOVE;
    svg(height(1) + height(2) + LEGEND, |root| {
        let (legend, rest) = root.split_vertically(LEGEND);
        let (plan, elevation) = rest.split_vertically(height(1));
        draw_legend(&legend)?;
        draw_view(&plan, room, extent, 1)?;
        draw_view(&elevation, room, extent, 2)
    })
}

fn draw_view(area: &Area<'_>, room: &RoomDrawing, extent: &DrawnBox, up: usize) -> Drawn {
    let (title, y_axis) =
        if up == 1 { ("Plan, from above", "Y, m") } else { ("Elevation, towards +Y", "Z, m") };
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
        .axis_style(AXIS)
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .x_labels(9)
        .y_labels(6)
        .x_desc("X, m")
        .y_desc(y_axis)
        .draw()?;
    let place = |p: &[f64; 3]| (p[0], p[up]);
    let line = |ends: [(f64, f64); 2], style: ShapeStyle| PathElement::new(ends.to_vec(), style);
    for solid in &room.boxes {
        let (low, high) = (place(&solid.low_m), place(&solid.high_m));
        chart.draw_series(solid.role.rectangles([low, high]))?;
        if solid.role == BoxRole::KeepOut {
            let diagonals = [[low, high], [(low.0, high.1), (high.0, low.1)]];
            chart.draw_series(diagonals.map(|ends| line(ends, VERMILION.stroke_width(1))))?;
        }
    }
    chart.draw_series(room.points_m.iter().map(|p| Cross::new(place(p), 4, BLACK.stroke_width(1))))?;
    for camera in &room.cameras {
        let at = place(&camera.centre_m);
        let ends = if up == 1 { camera.across_m } else { camera.upright_m };
        let style = BLUE.mix(0.7).stroke_width(1);
        chart.draw_series(ends.map(|end| line([at, place(&end)], style)))?;
        chart.draw_series([Circle::new(at, 6, BLUE.filled())])?;
        let style = TextStyle::from((FONT, 16)).color(&BLACK);
        let label = EmptyElement::at(at) + Text::new(camera.name.clone(), (9, -18), style);
        chart.draw_series([label])?;
    }
    Ok(())
}

fn draw_legend(area: &Area<'_>) -> Drawn {
    let style = TextStyle::from((FONT, 15)).color(&BLACK);
    let left = |at: i32| LEFT as i32 + at;
    let label = |text: &str, x: i32| area.draw(&Text::new(text.to_owned(), (x + 22, 10), style.clone()));
    label("camera and its field", left(0))?;
    area.draw(&Circle::new((left(8), 17), 6, BLUE.filled()))?;
    for (text, at, role) in [
        ("flight volume", 172, BoxRole::Volume),
        ("may stand", 306, BoxRole::Stand),
        ("keep out", 416, BoxRole::KeepOut),
        ("blocks the view", 518, BoxRole::Block),
    ] {
        let corners = [(left(at), 10), (left(at) + 16, 24)];
        role.rectangles(corners).try_for_each(|r| area.draw(&r))?;
        if role == BoxRole::KeepOut {
            area.draw(&PathElement::new(corners.to_vec(), VERMILION.stroke_width(1)))?;
        }
        label(text, left(at))?;
    }
    label("control point", left(660))?;
    area.draw(&Cross::new((left(668), 17), 4, BLACK.stroke_width(1)))
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
