//! Sheets beside the boards: a wand, marker colours, the plan of a control frame with a form for its distances.

use crate::sheet::Sheet;
use std::fmt::Write;

/// White that printers leave at the edges, and some more.
const MARGIN_MM: f64 = 15.0;
/// What stands in place of a ball's name where its height is measured, as [`mavsight_session::DistanceTable`] reads it.
const FLOOR: &str = "floor";

/// A colour by the word that people use for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedColor {
    /// The word.
    pub name: &'static str,
    /// Nominal colour, sRGB.
    pub rgb: [u8; 3],
}

/// The longest wand, mm, in whole centimetres, that a sheet shows in its true size.
pub fn wand_length_mm(ball_mm: f64, sheet_mm: [f64; 2]) -> f64 {
    10.0 * ((sheet_mm[0] - 2.0 * MARGIN_MM - ball_mm) / 10.0).floor()
}

/// The two balls of a wand in their true places, a template to drill and glue by, and what a session must say of it.
pub fn wand_sheet(balls: [NamedColor; 2], ball_mm: f64, section: &[&str], sheet_mm: [f64; 2]) -> Sheet {
    let mut sheet = Sheet::new("Wand", sheet_mm);
    let length_mm = wand_length_mm(ball_mm, sheet_mm);
    let above = sheet.heading(
        "Wand: two balls on a straight stick",
        &[
            "Lay the stick along the line and glue the balls where the circles are. A longer wand is better: this one is as long as \
             the sheet allows. Measure the distance between the centres once the glue is dry, and write it into the session; \
             `length_std_m` says how well it is known.",
        ],
    );
    let (y, left) = (above + 12.0 + 0.5 * ball_mm, 0.5 * (sheet_mm[0] - length_mm));
    sheet.line([left - 0.5 * ball_mm, y], [left + length_mm + 0.5 * ball_mm, y]);
    for (x, ball) in [left, left + length_mm].into_iter().zip(balls) {
        sheet.circle([x, y], 0.5 * ball_mm);
        sheet.line([x, y - 0.5 * ball_mm - 4.0], [x, y + 0.5 * ball_mm + 4.0]);
        sheet.words([x + 2.0, y + 0.5 * ball_mm + 5.0], ball.name);
    }
    sheet.paragraphs(y + 0.5 * ball_mm + 18.0, section);
    sheet
}

/// Discs of colours that a marker may have, in the order of their hues, each with its word and code.
pub fn color_sheet(colors: &[NamedColor], sheet_mm: [f64; 2]) -> Sheet {
    let mut sheet = Sheet::new("Marker colours", sheet_mm);
    let top = sheet.heading(
        "Marker colours, in the order of their hues",
        &[
            "Balls are identified by hue, not by brightness. Film this sheet in the light of the flight, and choose colours that the \
             film keeps apart and that nothing in the room has: neighbours here, the last and the first too, are the hardest to keep \
             apart. Matt paint is best. The words are those that `mavsight new` takes.",
        ],
    );
    let columns = colors.len().div_ceil(2).max(1);
    let step = [(sheet_mm[0] - 2.0 * MARGIN_MM) / columns as f64, 0.5 * (sheet_mm[1] - top - 18.0)];
    let radius_mm = (0.36 * step[0]).min(0.5 * (step[1] - 14.0));
    for (k, NamedColor { name, rgb: [r, g, b] }) in colors.iter().enumerate() {
        let left = MARGIN_MM + step[0] * (k % columns) as f64;
        let centre = [left + 0.5 * step[0], top + step[1] * (k / columns) as f64 + radius_mm];
        sheet.disc(centre, radius_mm, [*r, *g, *b]);
        sheet.words(
            [centre[0] - radius_mm, centre[1] + radius_mm + 6.0],
            format!("{name}  #{r:02x}{g:02x}{b:02x}"),
        );
    }
    sheet
}

/// Where eight balls hang on four strings, and lines on which to write the measured distances. Counter-clockwise as seen from
/// above, the first four are the lower ones, the others above them.
pub fn control_frame_sheet(balls: &[NamedColor; 8], sheet_mm: [f64; 2]) -> Sheet {
    let mut sheet = Sheet::new("Control frame", sheet_mm);
    let [first, second, third] = [0, 1, 2].map(|k| balls[k].name);
    let top = sheet.heading("Control frame: eight balls on four strings", &[]);
    // An oblique view: x right, y away, z up, a unit being half a side of the frame.
    let origin = [0.5 * sheet_mm[0], top + 65.0];
    let place =
        |[x, y, z]: [f64; 3]| [origin[0] + 42.0 * x + 18.0 * y, origin[1] + 8.0 * x - 12.0 * y - 24.0 * z];
    const AROUND: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    for (k, [x, y]) in AROUND.into_iter().enumerate() {
        let [next_x, next_y] = AROUND[(k + 1) % 4];
        for z in [0.0, 2.0] {
            sheet.line(place([x, y, z]), place([next_x, next_y, z]));
        }
        sheet.line(place([x, y, 2.0]), place([x, y, 0.0]));
    }
    for (k, [x, y]) in AROUND.into_iter().enumerate() {
        for (z, ball) in [(0.25, k), (1.75, k + 4)] {
            let [u, v] = place([x, y, z]);
            sheet.disc([u, v], 2.5, balls[ball].rgb);
            sheet.words([u + 4.0, v + 1.0], format!("{} {}", ball + 1, balls[ball].name));
        }
    }
    let order = format!(
        "The strings stand around the volume of the flight, all balls in view of all cameras, not all in one plane. Seen from above, \
         {first}, {second}, {third} go counter-clockwise. Balls of other colours will do: rename them in distances.csv too."
    );
    let top = sheet.paragraphs(
        origin[1] + 28.0,
        &[
            &order,
            "A distance is between centres: measure from surface to surface and add one diameter. A height is from the floor to the \
             underside and half a diameter more. Measure all 28 distances, 18 at the very least, and three heights or more. Leave \
             empty what could not be measured.",
            "Diameter of the balls: ______________ mm",
            "Standard deviation of a distance: ______________ mm (2 where nothing is said)",
        ],
    );
    let pairs = pairs(&balls.map(|b| b.name));
    let (top, rows) = (top + 5.0, pairs.len().div_ceil(3));
    let step = [(sheet_mm[0] - 2.0 * MARGIN_MM) / 3.0, ((sheet_mm[1] - top - 17.0) / rows as f64).min(9.0)];
    for (k, (from, to)) in pairs.iter().enumerate() {
        let [x, y] = [MARGIN_MM + step[0] * (k / rows) as f64, top + step[1] * (k % rows) as f64];
        sheet.words([x, y], format!("{from} - {to}"));
        sheet.line([x + 30.0, y + 0.5], [x + 51.0, y + 0.5]);
        sheet.words([x + 52.0, y], "m");
    }
    sheet
}

/// The same form as the table that [`mavsight_session::DistanceTable`] reads, once numbers are in it.
pub fn distance_form(balls: &[NamedColor; 8]) -> String {
    let mut form = "from,to,distance_m,std_m\n".to_owned();
    for (from, to) in pairs(&balls.map(|b| b.name)) {
        // Writing to a text does not fail.
        let _ = writeln!(form, "{from},{to},,");
    }
    form
}

/// All pairs of balls, and their heights.
fn pairs(balls: &[&'static str]) -> Vec<(&'static str, &'static str)> {
    let between = balls.iter().enumerate().flat_map(|(k, from)| balls[k + 1..].iter().map(|to| (*from, *to)));
    between.chain(balls.iter().map(|ball| (*ball, FLOOR))).collect()
}
