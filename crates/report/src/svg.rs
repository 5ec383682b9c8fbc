//! What all drawings share: the SVG element around them, its width and its fonts.

use crate::ReportError;
use plotters::coord::Shift;
use plotters::prelude::*;

pub(crate) const WIDTH: u32 = 860;
pub(crate) const FONT: &str = "sans-serif";
pub(crate) const AXIS: RGBColor = RGBColor(120, 120, 120);
// Okabe & Ito (2008).
pub(crate) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(crate) const GREEN: RGBColor = RGBColor(0, 158, 115);
pub(crate) const SKY: RGBColor = RGBColor(86, 180, 233);
pub(crate) const VERMILION: RGBColor = RGBColor(213, 94, 0);

pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(crate) type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Draws on white and makes an SVG element whose width the page chooses.
pub(crate) fn svg(height: u32, draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<String, ReportError> {
    let mut out = String::new();
    {
        let root = SVGBackend::with_string(&mut out, (WIDTH, height)).into_drawing_area();
        root.fill(&WHITE)?;
        draw(&root)?;
        root.present()?;
    }
    Ok(out.replacen(&format!("<svg width=\"{WIDTH}\" height=\"{height}\""), "<svg role=\"img\"", 1))
}
