//! check.html: what each camera sees before the flight is run.

use anyhow::Result;
use mavsight_engine::{CameraCheck, CheckItem, Harm, SessionCheck, Shot};
use mavsight_flight::Color;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_report::{Figure, Report, ReportSection, Table, escaped, picture_address, render};
use mavsight_session::write_whole;
use mavsight_vision::{Frame, hue};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

/// Width at which pictures are stored: those of a page's width, and those of a mosaic.
const STILL_PX: u32 = 1280;
const SHOT_PX: u32 = 480;
/// Pictures beside each other in a mosaic.
const ACROSS: usize = 3;

/// Writes the page; `by_click` says what of the list a click may mend.
pub(super) fn write(path: &Path, found: &SessionCheck, by_click: Option<&str>) -> Result<()> {
    let mend: Vec<&CheckItem> = found.items.iter().filter(|i| i.harm != Harm::Remark).collect();
    let lead = match mend.len() {
        0 if found.is_filmed() => {
            "All is ready: the cameras are calibrated, and the markers are found and identified.".to_owned()
        }
        0 => "The cameras are calibrated; without a recording no markers were looked for.".to_owned(),
        1 => "Mend first: one fault.".to_owned(),
        more => format!("Mend first: {more} faults."),
    };
    let mut report = Report {
        title: format!("mavsight check: {}", found.name),
        lead: vec![lead],
        headline: headline(found),
        ..Report::default()
    };
    let row = |(k, item): (usize, &&CheckItem)| {
        let causes: Vec<&str> = item.causes.iter().map(|c| c.words()).collect();
        let cause = if causes.is_empty() { "not known".to_owned() } else { causes.join(" or ") };
        vec![(k + 1).to_string(), cause, item.text.clone()]
    };
    if !mend.is_empty() {
        let rows = mend.iter().enumerate().map(row).collect();
        let caption = "The most harmful at the top. A cause is named where undoing it mends the recording and nothing else that \
                       was tried does.";
        let table = Table::new(caption, ["", "cause", "what was seen, and the remedy"], rows);
        report.sections.push(ReportSection {
            heading: "Mend this first".to_owned(),
            tables: vec![table],
            texts: by_click.map(str::to_owned).into_iter().collect(),
            ..ReportSection::default()
        });
    }
    report.add("Cameras", vec![cameras(found)], vec![]);
    for camera in &found.cameras {
        report.add(&camera.name, vec![], pictures(camera, found)?);
    }
    let remarks: Vec<String> =
        found.items.iter().filter(|i| i.harm == Harm::Remark).map(|i| i.text.clone()).collect();
    if !remarks.is_empty() {
        report.sections.push(ReportSection {
            heading: "Remarks".to_owned(),
            texts: remarks,
            ..ReportSection::default()
        });
    }
    write_whole(path, render(&report)?.as_bytes())?;
    Ok(())
}

fn headline(found: &SessionCheck) -> Vec<(String, String)> {
    let mut all = Vec::new();
    if let Some((position_std_m, angle_std_rad)) = found.pose_std {
        all.push((
            "a coordinate of a position, standard deviation".into(),
            format!("{:.1} mm", 1e3 * position_std_m),
        ));
        all.push(("an angle, standard deviation".into(), format!("{:.2}°", angle_std_rad.to_degrees())));
    }
    let (measured, instants) = found.instants;
    if instants > 0 {
        all.push(("instants with a pose".into(), format!("{measured} of {instants}")));
    }
    all
}

fn cameras(found: &SessionCheck) -> Table {
    let line = |what: &str, of: &dyn Fn(&CameraCheck) -> Option<String>| {
        let cells = found.cameras.iter().map(|c| of(c).unwrap_or_else(|| "—".to_owned()));
        std::iter::once(what.to_owned()).chain(cells).collect::<Vec<String>>()
    };
    let mut rows = vec![
        line("size", &|c| c.size.map(|s| format!("{}×{} px", s.width_px, s.height_px))),
        line("residual of the calibration", &|c| c.calibration_rms_px.map(|px| format!("{px:.2} px"))),
        line("frames", &|c| (c.frames > 0).then(|| format!("{} at {:.2}/s", c.frames, c.rate_hz))),
        line("longest step", &|c| (c.frames > 1).then(|| format!("{:.1} frames", c.longest_step))),
        line("blur of edges", &|c| c.edge_px.map(|px| format!("{px:.1} px"))),
        line("time of exposure", &|c| {
            c.exposure.map(|e| format!("{:.0} ± {:.0} ms", 1e3 * e.exposure_s, 1e3 * e.std_s))
        }),
        line("smear of quick balls", &|c| c.exposure.map(|e| format!("{:.1} px", e.smear_px()))),
        line("clock", &|c| Some(c.clock.clone()).filter(|words| !words.is_empty())),
    ];
    for (k, (name, _)) in found.markers.iter().enumerate() {
        let seen = |c: &CameraCheck| c.seen.get(k).map(|s| format!("{:.0} %", 100.0 * s));
        rows.push(line(&format!("frames with {name}"), &seen));
    }
    let header = std::iter::once(String::new()).chain(found.cameras.iter().map(|c| c.name.clone()));
    Table::new("What each camera does.", header, rows)
}

fn pictures(camera: &CameraCheck, found: &SessionCheck) -> Result<Vec<Figure>> {
    let mut figures = Vec::new();
    if let Some(markup) = still(camera)? {
        let caption = "The control points: circles are where the calibration has them, dashed where they were not found.";
        figures.push(Figure::new(caption, markup));
    }
    if !camera.shots.is_empty() {
        let caption = "Frames of the flight. A circle is a ball identified as the marker that is named, a square another ball of \
                       a marker's colour, a dashed circle a marker that was not detected where the pose has it. The pictures are cut around the aircraft.";
        figures.push(Figure::new(caption, mosaic(&camera.shots, found)?));
        let caption = "Hues of the balls. Each dot is a ball in a frame, in its own colour; a line is the colour that the vehicle file gives \
                       the marker. Dots of a marker lie about its line, and lines lie apart, where colours do their work.";
        figures.push(Figure::new(caption, hues(&camera.shots, found)));
    }
    Ok(figures)
}

/// A mark over a picture: white on black, so that it shows on anything.
fn mark(shape: &str, is_dashed: bool, stroke_px: f64) -> String {
    let dash = if is_dashed {
        format!(" stroke-dasharray=\"{} {}\"", 4.0 * stroke_px, 3.0 * stroke_px)
    } else {
        String::new()
    };
    let line = |color: &str, width_px: f64| {
        format!("<{shape} fill=\"none\" stroke=\"{color}\" stroke-width=\"{width_px:.2}\"{dash}/>")
    };
    line("#000", 2.2 * stroke_px) + &line("#fff", stroke_px)
}

fn label(x: f64, y: f64, size_px: f64, text: &str) -> String {
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" font-family=\"sans-serif\" font-size=\"{size_px:.1}\" fill=\"#fff\" stroke=\"#000\" \
         stroke-width=\"{:.2}\" paint-order=\"stroke\">{}</text>",
        0.2 * size_px,
        escaped(text)
    )
}

/// The still with its control points; none without one.
fn still(camera: &CameraCheck) -> Result<Option<String>> {
    let Some((frame, balls)) = &camera.still else { return Ok(None) };
    let (width, height) = (f64::from(frame.size.width_px), f64::from(frame.size.height_px));
    let unit = width / 640.0;
    let mut out = format!(
        "<svg role=\"img\" viewBox=\"0 0 {width} {height}\"><image width=\"{width}\" height=\"{height}\" href=\"{}\"/>",
        picture_address(frame, STILL_PX)?
    );
    for ball in balls {
        // The middle of the first pixel is half a pixel from the corner.
        let (x, y, r) = (ball.pixel.x + 0.5, ball.pixel.y + 0.5, 0.5 * ball.diameter_px + 3.0 * unit);
        let shape = format!("circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r:.1}\"");
        out += &mark(&shape, ball.residual_px.is_none(), 1.2 * unit);
        let text = match ball.residual_px {
            Some(px) if ball.is_used => format!("{} {px:.2} px", ball.name),
            Some(_) => format!("{} left out", ball.name),
            None => format!("{} not found", ball.name),
        };
        out += &label(x + r + 2.0 * unit, y + 4.0 * unit, 11.0 * unit, &text);
    }
    Ok(Some(out + "</svg>"))
}

/// Frames beside and below each other, each as far as its balls are.
fn mosaic(shots: &[Shot], found: &SessionCheck) -> Result<String> {
    let Some(size) = shots.first().map(|s| s.frame.size) else { return Ok(String::new()) };
    let (width, height) = (f64::from(size.width_px), f64::from(size.height_px));
    let rows = shots.len().div_ceil(ACROSS);
    let (whole_x, whole_y) = (width * ACROSS as f64, height * rows as f64);
    let mut out = format!("<svg role=\"img\" viewBox=\"0 0 {whole_x} {whole_y}\">");
    for (k, shot) in shots.iter().enumerate() {
        let (x, y) = (width * (k % ACROSS) as f64, height * (k / ACROSS) as f64);
        let cut = Cut::around(shot);
        let [left, top, cut_width, cut_height] = cut.0.map(|v| v as f64);
        let unit = cut_width / 640.0;
        write!(
            out,
            "<svg x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" viewBox=\"{left} {top} {cut_width} {cut_height}\">\
             <image x=\"{left}\" y=\"{top}\" width=\"{cut_width}\" height=\"{cut_height}\" preserveAspectRatio=\"none\" href=\"{}\"/>",
            picture_address(&cut.of(&shot.frame), SHOT_PX)?
        )?;
        for spot in &shot.spots {
            let (x, y, r) = (spot.pixel.x + 0.5, spot.pixel.y + 0.5, 0.5 * spot.diameter_px + 4.0 * unit);
            let name = spot.marker.and_then(|m| found.markers.get(m)).map(|(name, _)| name.as_str());
            let shape = match name {
                Some(_) => format!("circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r:.1}\""),
                None => {
                    format!(
                        "rect x=\"{:.1}\" y=\"{:.1}\" width=\"{2:.1}\" height=\"{2:.1}\"",
                        x - r,
                        y - r,
                        2.0 * r
                    )
                }
            };
            out += &mark(&shape, !spot.is_detected, 2.0 * unit);
            out += &label(x + r, y - r, 26.0 * unit, name.unwrap_or(""));
        }
        let time = format!("{:.2} s", shot.t_ns as f64 * 1e-9);
        out += &label(left + 8.0 * unit, top + cut_height - 12.0 * unit, 26.0 * unit, &time);
        out += "</svg>";
    }
    Ok(out + "</svg>")
}

/// A part of a frame: left, top, width and height, pixels.
#[derive(Clone, Copy)]
struct Cut([u32; 4]);

impl Cut {
    /// Twice as far as the markers spread, a fifth of the frame at least; all of a frame without markers.
    fn around(shot: &Shot) -> Self {
        let (width, height) = (shot.frame.size.width_px, shot.frame.size.height_px);
        let spots: Vec<_> = shot.spots.iter().filter(|s| s.marker.is_some()).collect();
        if spots.is_empty() {
            return Self([0, 0, width, height]);
        }
        let middle = spots.iter().map(|s| s.pixel).sum::<Vector2<f64>>() / spots.len() as f64;
        let spread =
            spots.iter().map(|s| (s.pixel - middle).abs()).fold(Vector2::<f64>::zeros(), |a, b| a.sup(&b));
        let (wide, high) = (f64::from(width), f64::from(height));
        let share = (4.0 * (spread.x / wide).max(spread.y / high)).clamp(0.2, 1.0);
        let (cut_width, cut_height) = ((share * wide) as u32, (share * high) as u32);
        let from = |at: f64, cut: u32, all: u32| {
            (at - 0.5 * f64::from(cut)).clamp(0.0, f64::from(all.saturating_sub(cut))) as u32
        };
        Self([from(middle.x, cut_width, width), from(middle.y, cut_height, height), cut_width, cut_height])
    }

    fn of(self, frame: &Frame) -> Frame {
        let [left, top, width, height] = self.0;
        let places = (top..top + height).flat_map(|y| (left..left + width).map(move |x| (x, y)));
        let rgb = places.flat_map(|(x, y)| frame.rgb(x as usize, y as usize)).collect();
        let size = ImageSize { width_px: width, height_px: height };
        Frame::from_rgb(size, rgb).unwrap_or_else(|_| frame.clone())
    }
}

/// The hue of a colour, as the detection compares colours, over its strongest channel.
fn pure_hue([red, green, blue]: [u8; 3]) -> Option<(f64, f64)> {
    let light = Color::new(red, green, blue).to_linear();
    let most = light.into_iter().fold(0.0, f64::max);
    let own = hue(light) / most;
    (most > 0.0).then_some((own.x, own.y))
}

fn hues(shots: &[Shot], found: &SessionCheck) -> String {
    const R: f64 = 200.0;
    let mut out = format!(
        "<svg role=\"img\" viewBox=\"{0} {0} {1} {1}\" style=\"max-width:30rem\"><circle r=\"{R}\" fill=\"#fff\" stroke=\"#888\"/>",
        -R - 70.0,
        2.0 * R + 140.0
    );
    for (name, nominal) in &found.markers {
        let Some((x, y)) = pure_hue(*nominal) else { continue };
        let angle = y.atan2(x).rem_euclid(TAU);
        let (c, s) = (angle.cos(), -angle.sin());
        let [r, g, b] = nominal;
        out += &format!(
            "<line x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#{r:02x}{g:02x}{b:02x}\" stroke-width=\"3\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" font-family=\"sans-serif\" font-size=\"16\" text-anchor=\"middle\" fill=\"#333\">{}</text>",
            R * c,
            R * s,
            (R + 30.0) * c,
            (R + 30.0) * s + 5.0,
            escaped(name)
        );
    }
    for spot in shots.iter().flat_map(|s| &s.spots).filter(|s| s.is_detected) {
        let Some((x, y)) = pure_hue(spot.rgb) else { continue };
        let [r, g, b] = spot.rgb;
        out += &format!(
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"5\" fill=\"#{r:02x}{g:02x}{b:02x}\" stroke=\"#000\" stroke-width=\"0.7\"/>",
            R * x,
            -R * y
        );
    }
    out + "</svg>"
}
