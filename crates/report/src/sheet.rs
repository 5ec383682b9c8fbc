//! A sheet to print in its true size, as SVG and as PDF.

use crate::symbols::escaped;
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use std::fmt::Write;

/// Points of PDF in a millimetre.
const PT_PER_MM: f64 = 72.0 / 25.4;
/// Width of lines.
const LINE_MM: f64 = 0.25;
/// How far the control points of a quarter of a circle are along its tangents, of the radius: the Bézier curve through the
/// circle at 0°, 45° and 90°, which errs by 0.03 % at most.
const QUARTER: f64 = 0.552_284_75;
/// Mean width of a letter of English text in Helvetica, of the font size, with a tenth to spare.
const LETTER_WIDTH: f64 = 0.54;
/// From line to line, of the font size.
const LEADING: f64 = 1.5;
/// Font size of running text.
const TEXT_MM: f64 = 3.2;
/// Titles.
const TITLE_MM: f64 = 5.5;
/// Left edge of text.
const LEFT_MM: f64 = 15.0;
/// Length of the ruler.
const RULER_MM: f64 = 100.0;

/// What is on a sheet; places are from the upper left corner, right and down.
#[derive(Debug, Clone, PartialEq)]
enum Shape {
    /// Black rectangles (left, top, width, height) as one path, so that neighbours have no seam.
    Blocks(Vec<[f64; 4]>),
    Disc {
        centre_mm: [f64; 2],
        radius_mm: f64,
        rgb: [u8; 3],
    },
    Circle {
        centre_mm: [f64; 2],
        radius_mm: f64,
    },
    Line([f64; 2], [f64; 2]),
    Words {
        at_mm: [f64; 2],
        height_mm: f64,
        text: String,
    },
}

/// A sheet of paper with black lines and text, and coloured discs; in millimetres from its upper left corner, x to the right
/// and y down.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    title: String,
    size_mm: [f64; 2],
    shapes: Vec<Shape>,
}

impl Sheet {
    /// A white sheet, its ruler at the bottom left.
    pub(crate) fn new(title: &str, size_mm: [f64; 2]) -> Self {
        let mut sheet = Self { title: title.to_owned(), size_mm, shapes: Vec::new() };
        sheet.ruler([LEFT_MM, size_mm[1] - 9.0]);
        sheet
    }

    /// Width and height, mm.
    pub fn size_mm(&self) -> [f64; 2] {
        self.size_mm
    }

    pub(crate) fn blocks(&mut self, blocks: Vec<[f64; 4]>) {
        self.shapes.push(Shape::Blocks(blocks));
    }

    /// A filled disc with an outline, which shows it whatever its colour.
    pub(crate) fn disc(&mut self, centre_mm: [f64; 2], radius_mm: f64, rgb: [u8; 3]) {
        self.shapes.push(Shape::Disc { centre_mm, radius_mm, rgb });
        self.circle(centre_mm, radius_mm);
    }

    pub(crate) fn circle(&mut self, centre_mm: [f64; 2], radius_mm: f64) {
        self.shapes.push(Shape::Circle { centre_mm, radius_mm });
    }

    pub(crate) fn line(&mut self, from_mm: [f64; 2], to_mm: [f64; 2]) {
        self.shapes.push(Shape::Line(from_mm, to_mm));
    }

    /// A line of running text; its left end on the base line is given.
    pub(crate) fn words(&mut self, at_mm: [f64; 2], text: impl Into<String>) {
        self.shapes.push(Shape::Words { at_mm, height_mm: TEXT_MM, text: text.into() });
    }

    /// The title, and paragraphs below it from margin to margin; the height below which the sheet is still white.
    pub(crate) fn heading(&mut self, title: &str, paragraphs: &[&str]) -> f64 {
        self.shapes.push(Shape::Words {
            at_mm: [LEFT_MM, 17.0],
            height_mm: TITLE_MM,
            text: title.to_owned(),
        });
        self.paragraphs(26.0, paragraphs)
    }

    /// Paragraphs from margin to margin, the first base line at a height; the height of the next one.
    pub(crate) fn paragraphs(&mut self, mut y_mm: f64, paragraphs: &[&str]) -> f64 {
        let most = ((self.size_mm[0] - 2.0 * LEFT_MM) / (TEXT_MM * LETTER_WIDTH)) as usize;
        for paragraph in paragraphs {
            let mut line = String::new();
            for word in paragraph.split(' ') {
                if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > most {
                    self.words([LEFT_MM, y_mm], std::mem::take(&mut line));
                    y_mm += LEADING * TEXT_MM;
                }
                if !line.is_empty() {
                    line.push(' ');
                }
                line += word;
            }
            self.words([LEFT_MM, y_mm], line);
            y_mm += LEADING * TEXT_MM;
        }
        y_mm
    }

    fn ruler(&mut self, [x, y]: [f64; 2]) {
        self.line([x, y], [x + RULER_MM, y]);
        for k in 0..=10 {
            let at = x + 0.1 * RULER_MM * f64::from(k);
            self.line([at, y], [at, y - if k % 5 == 0 { 3.0 } else { 1.5 }]);
        }
        self.words([x + RULER_MM + 3.0, y], "100 mm: print at 100 %, then measure this line");
    }

    /// The sheet as SVG in its true size.
    pub fn svg(&self) -> String {
        let [width, height] = self.size_mm;
        let shapes: Vec<String> = self.shapes.iter().map(svg_of).collect();
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} \
             {height}\"><title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n{}\n</svg>\n",
            escaped(&self.title),
            shapes.join("\n")
        )
    }

    /// The sheet as a PDF of one page in its true size, which asks the viewer not to scale it.
    pub fn pdf(&self) -> Vec<u8> {
        let [catalogue, pages, page, font, content, about] = [1, 2, 3, 4, 5, 6].map(Ref::new);
        let mut pdf = Pdf::new();
        let mut root = pdf.catalog(catalogue);
        root.pages(pages)
            .viewer_preferences()
            .display_doc_title(true)
            .pair(Name(b"PrintScaling"), Name(b"None"));
        root.finish();
        pdf.document_info(about).title(TextStr(&self.title));
        pdf.pages(pages).kids([page]).count(1);
        let [width, height] = self.size_mm.map(pt);
        let mut leaf = pdf.page(page);
        leaf.media_box(Rect::new(0.0, 0.0, width, height)).parent(pages).contents(content);
        leaf.resources().fonts().pair(Name(b"F"), font);
        leaf.finish();
        pdf.type1_font(font).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
        let mut drawn = Content::new();
        drawn.set_line_width(pt(LINE_MM));
        self.shapes.iter().for_each(|shape| self.draw(shape, &mut drawn));
        pdf.stream(content, &drawn.finish());
        pdf.finish()
    }

    fn draw(&self, shape: &Shape, page: &mut Content) {
        let up = |y_mm: f64| pt(self.size_mm[1] - y_mm);
        let fill = |page: &mut Content, rgb: [u8; 3]| {
            let [r, g, b] = rgb.map(|v| f32::from(v) / 255.0);
            page.set_fill_rgb(r, g, b);
        };
        match shape {
            Shape::Blocks(blocks) => {
                fill(page, [0; 3]);
                for [x, y, width, height] in blocks {
                    page.rect(pt(*x), up(y + height), pt(*width), pt(*height));
                }
                page.fill_nonzero();
            }
            Shape::Disc { centre_mm, radius_mm, rgb } => {
                fill(page, *rgb);
                self.circle_path(*centre_mm, *radius_mm, page);
                page.fill_nonzero();
            }
            Shape::Circle { centre_mm, radius_mm } => {
                self.circle_path(*centre_mm, *radius_mm, page);
                page.stroke();
            }
            Shape::Line([x, y], [to_x, to_y]) => {
                page.move_to(pt(*x), up(*y)).line_to(pt(*to_x), up(*to_y)).stroke();
            }
            Shape::Words { at_mm: [x, y], height_mm, text } => {
                fill(page, [0; 3]);
                // Letters of Latin-1 have their numbers in the font's encoding too.
                let letters: Vec<u8> =
                    text.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')).collect();
                page.begin_text().set_font(Name(b"F"), pt(*height_mm)).next_line(pt(*x), up(*y));
                page.show(Str(&letters)).end_text();
            }
        }
    }

    fn circle_path(&self, [x, y]: [f64; 2], radius_mm: f64, page: &mut Content) {
        let at = |dx: f64, dy: f64| [pt(x + radius_mm * dx), pt(self.size_mm[1] - y + radius_mm * dy)];
        let [x0, y0] = at(1.0, 0.0);
        page.move_to(x0, y0);
        let mut from = [1.0, 0.0];
        for to in [[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]] {
            let [x1, y1] = at(from[0] + QUARTER * to[0], from[1] + QUARTER * to[1]);
            let [x2, y2] = at(to[0] + QUARTER * from[0], to[1] + QUARTER * from[1]);
            let [x3, y3] = at(to[0], to[1]);
            page.cubic_to(x1, y1, x2, y2, x3, y3);
            from = to;
        }
        page.close_path();
    }
}

/// Millimetres as points.
fn pt(mm: f64) -> f32 {
    (mm * PT_PER_MM) as f32
}

fn svg_of(shape: &Shape) -> String {
    let stroke = format!("stroke=\"#000\" stroke-width=\"{LINE_MM}\" fill=\"none\"");
    match shape {
        Shape::Blocks(blocks) => {
            let mut path = String::new();
            for [x, y, width, height] in blocks {
                // Writing to a text does not fail.
                let _ = write!(path, "M{x:.4} {y:.4}H{:.4}V{:.4}H{x:.4}Z", x + width, y + height);
            }
            format!("<path d=\"{path}\"/>")
        }
        Shape::Disc { centre_mm: [x, y], radius_mm, rgb: [r, g, b] } => {
            format!(
                "<circle cx=\"{x:.4}\" cy=\"{y:.4}\" r=\"{radius_mm:.4}\" fill=\"#{r:02x}{g:02x}{b:02x}\"/>"
            )
        }
        Shape::Circle { centre_mm: [x, y], radius_mm } => {
            format!("<circle cx=\"{x:.4}\" cy=\"{y:.4}\" r=\"{radius_mm:.4}\" {stroke}/>")
        }
        Shape::Line([x, y], [to_x, to_y]) => {
            format!("<path d=\"M{x:.4} {y:.4}L{to_x:.4} {to_y:.4}\" {stroke}/>")
        }
        Shape::Words { at_mm: [x, y], height_mm, text } => format!(
            "<text x=\"{x:.4}\" y=\"{y:.4}\" font-size=\"{height_mm}\" font-family=\"Helvetica, Arial, sans-serif\">{}</text>",
            escaped(text)
        ),
    }
}
