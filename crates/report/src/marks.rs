//! Marks over a frame: SVG in the page, pixels in a film.

use crate::symbols::escaped;
use embedded_graphics::mono_font::{MonoTextStyle, iso_8859_1::FONT_10X20};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use std::convert::Infallible;
use tiny_skia::{Color, LineCap, LineJoin, Paint, PathBuilder, PixmapMut, Stroke, Transform};

/// Width of the dark line below each mark, and how dark it is.
const HALO_WIDTH: f64 = 6.0;
const HALO_OPACITY: f32 = 0.55;
/// Of the letters of a film, px.
pub(crate) const LETTER_PX: [i32; 2] = [10, 20];

/// What a mark stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A ball as it was detected.
    Detected,
    /// A ball as the pose puts it.
    Predicted,
    /// An axis of the body: x, y, z.
    Axis(usize),
    /// The body origin's path.
    Path,
    /// A residual, or what is to be compared with it.
    Enlarged,
}

impl Kind {
    /// Colours that eyes of all kinds distinguish, on dark and on light, over the halo.
    pub(crate) fn rgb(self) -> [u8; 3] {
        match self {
            Self::Detected | Self::Path => [255, 255, 255],
            Self::Predicted => [255, 255, 0],
            Self::Axis(0) => [0xff, 0x6b, 0x57],
            Self::Axis(1) => [0x5e, 0xe0, 0x8c],
            Self::Axis(_) => [0x6f, 0xb7, 0xff],
            Self::Enlarged => [0xff, 0x9d, 0xf0],
        }
    }

    fn width(self) -> f64 {
        match self {
            Self::Detected => 3.0,
            Self::Predicted | Self::Enlarged => 2.5,
            Self::Axis(_) => 3.5,
            Self::Path => 1.8,
        }
    }

    fn class(self) -> &'static str {
        match self {
            Self::Detected => "detected",
            Self::Predicted => "predicted",
            Self::Axis(0) => "axis-x",
            Self::Axis(1) => "axis-y",
            Self::Axis(_) => "axis-z",
            Self::Path => "path",
            Self::Enlarged => "enlarged",
        }
    }
}

/// One mark, at places of the picture that it is drawn on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Mark {
    /// Lines from point to point.
    Lines(Kind, Vec<Vec<[f64; 2]>>),
    /// A circle: its centre and its radius.
    Ring(Kind, [f64; 2], f64),
    /// Words to the right of a place.
    Words([f64; 2], String),
}

impl Mark {
    /// An upright cross.
    pub(crate) fn cross(kind: Kind, [x, y]: [f64; 2], half: f64) -> Self {
        Self::Lines(kind, vec![vec![[x - half, y], [x + half, y]], vec![[x, y - half], [x, y + half]]])
    }

    /// As SVG, in a drawing of the class `overlay`.
    pub(crate) fn svg(&self) -> String {
        let stroke = |kind: Kind, tag: &str, shape: &str| {
            let ([r, g, b], width) = (kind.rgb(), kind.width());
            let class = kind.class();
            format!(
                "<{tag} {shape} fill=\"none\" stroke=\"#000\" stroke-opacity=\"{HALO_OPACITY}\" stroke-width=\"{HALO_WIDTH}\"/>\
                 <{tag} class=\"{class}\" {shape} fill=\"none\" stroke=\"#{r:02x}{g:02x}{b:02x}\" stroke-width=\"{width}\"/>"
            )
        };
        match self {
            Self::Lines(kind, lines) => {
                let d = lines.iter().map(|line| {
                    let points = line.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect::<Vec<_>>();
                    format!("M{}", points.join("L"))
                });
                stroke(*kind, "path", &format!("d=\"{}\"", d.collect::<String>()))
            }
            Self::Ring(kind, [x, y], radius) => {
                stroke(*kind, "circle", &format!("cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\""))
            }
            Self::Words([x, y], words) => {
                format!("<text class=\"mark\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>", escaped(words))
            }
        }
    }

    /// Draws it onto pixels, with lines so many times as wide as in the page.
    pub(crate) fn draw(&self, pixels: &mut PixmapMut<'_>, scale: f64) {
        match self {
            Self::Lines(kind, lines) => {
                let mut path = PathBuilder::new();
                for line in lines {
                    for (k, [x, y]) in line.iter().enumerate() {
                        let (x, y) = (*x as f32, *y as f32);
                        if k == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
                    }
                }
                stroked(path, *kind, pixels, scale);
            }
            Self::Ring(kind, [x, y], radius) => {
                let mut path = PathBuilder::new();
                path.push_circle(*x as f32, *y as f32, *radius as f32);
                stroked(path, *kind, pixels, scale);
            }
            Self::Words(at, words) => {
                write_words(pixels, at.map(|v| v.round() as i32), words, [255, 255, 255]);
            }
        }
    }
}

fn stroked(path: PathBuilder, kind: Kind, pixels: &mut PixmapMut<'_>, scale: f64) {
    // What is not finite, or nothing, is no path.
    let Some(path) = path.finish() else { return };
    let [r, g, b] = kind.rgb().map(|v| f32::from(v) / 255.0);
    let colour = |[r, g, b]: [f32; 3], opacity| Color::from_rgba(r, g, b, opacity).unwrap_or(Color::WHITE);
    for (colour, width) in
        [(colour([0.0; 3], HALO_OPACITY), HALO_WIDTH), (colour([r, g, b], 1.0), kind.width())]
    {
        let mut paint = Paint { anti_alias: true, ..Paint::default() };
        paint.set_color(colour);
        let (line_cap, line_join) = (LineCap::Round, LineJoin::Round);
        let stroke =
            Stroke { width: (width * scale).max(1.0) as f32, line_cap, line_join, ..Stroke::default() };
        pixels.stroke_path(&path, &paint, &stroke, Transform::identity(), None);
    }
}

/// Writes a line in letters of [`LETTER_PX`], dark around them; its upper left corner is given.
pub(crate) fn write_words(pixels: &mut PixmapMut<'_>, [x, y]: [i32; 2], words: &str, [r, g, b]: [u8; 3]) {
    let mut canvas = Canvas(pixels);
    let mut write = |dx: i32, dy: i32, colour: Rgb888| {
        let style = MonoTextStyle::new(&FONT_10X20, colour);
        let text = Text::with_baseline(words, Point::new(x + dx, y + dy), style, Baseline::Top);
        let _: Result<Point, Infallible> = text.draw(&mut canvas);
    };
    for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1), (1, 1)] {
        write(dx, dy, Rgb888::BLACK);
    }
    write(0, 0, Rgb888::new(r, g, b));
}

/// Pixels as the letters' library wants them.
struct Canvas<'a, 'b>(&'a mut PixmapMut<'b>);

impl OriginDimensions for Canvas<'_, '_> {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas<'_, '_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        let (width, height) = (self.0.width() as usize, self.0.height() as usize);
        let data = self.0.data_mut();
        for Pixel(Point { x, y }, colour) in pixels {
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { continue };
            if x < width && y < height {
                data[4 * (y * width + x)..][..4].copy_from_slice(&[colour.r(), colour.g(), colour.b(), 255]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiny_skia::Pixmap;

    #[test]
    fn a_mark_is_at_its_place_in_svg_and_in_pixels() {
        let mark = Mark::cross(Kind::Predicted, [20.0, 12.0], 8.0);
        assert!(mark.svg().contains("class=\"predicted\"") && mark.svg().contains("M12.0 12.0L28.0 12.0"));
        let mut pixels = Pixmap::new(40, 30).expect("pixels");
        mark.draw(&mut pixels.as_mut(), 1.0);
        let at = |x, y| pixels.pixel(x, y).map(|p| (p.red(), p.green(), p.blue()));
        assert_eq!(at(20, 12), Some((255, 255, 0)));
        assert_eq!(at(1, 1), Some((0, 0, 0)));
    }

    #[test]
    fn words_and_lines_beyond_the_picture_are_cut_off() {
        let mut pixels = Pixmap::new(30, 24).expect("pixels");
        write_words(&mut pixels.as_mut(), [2, 2], "12 ×±", [255, 200, 0]);
        let lines = vec![vec![[-50.0, 5.0], [90.0, 5.0]], vec![[f64::NAN, 0.0], [1.0, 1.0]]];
        Mark::Lines(Kind::Path, lines).draw(&mut pixels.as_mut(), 1.0);
        assert!(pixels.pixels().iter().any(|p| (p.red(), p.green(), p.blue()) == (255, 200, 0)));
    }
}
