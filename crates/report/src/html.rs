//! One HTML file that opens anywhere.

use base64::Engine;
use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, Value, context};
use plotters::drawing::DrawingAreaErrorKind;
use serde::Serialize;
use thiserror::Error;

/// Why a report could not be made.
#[derive(Debug, Error)]
pub enum ReportError {
    /// Nothing to draw.
    #[error("a plot could not be drawn: {0}")]
    Plot(&'static str),
    /// The plotting library's words.
    #[error("a plot could not be drawn: {0}")]
    Plotters(#[from] DrawingAreaErrorKind<std::io::Error>),
    /// A picture of another size than its pixels.
    #[error("a picture of the report could not be encoded")]
    Picture,
    /// What the file system refused.
    #[error(transparent)]
    File(#[from] mavsight_session::SessionError),
    /// A placement that gives no rig.
    #[error(transparent)]
    Rig(#[from] mavsight_pose::PoseError),
    /// The template library's words.
    #[error("the report could not be put together: {0}")]
    Template(#[from] minijinja::Error),
}

/// A table of text cells.
#[derive(Debug, Clone, Serialize)]
pub struct Table {
    /// Above it.
    pub caption: String,
    /// First row.
    pub header: Vec<String>,
    /// Rows.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table of a caption, a first row and rows.
    pub fn new<H: Into<String>>(
        caption: impl Into<String>,
        header: impl IntoIterator<Item = H>,
        rows: Vec<Vec<String>>,
    ) -> Self {
        Self { caption: caption.into(), header: header.into_iter().map(Into::into).collect(), rows }
    }
}

pub(crate) fn row<C: Into<String>>(
    first: impl Into<String>,
    cells: impl IntoIterator<Item = C>,
) -> Vec<String> {
    std::iter::once(first.into()).chain(cells.into_iter().map(Into::into)).collect()
}

/// A picture with its caption.
#[derive(Debug, Clone, Serialize)]
pub struct Figure {
    /// Below it.
    pub caption: String,
    /// SVG or `<img>` markup, made by this crate.
    pub markup: String,
}

/// What a report shows, in order.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    /// Heading.
    pub title: String,
    /// One paragraph under it.
    pub lead: String,
    /// The figures that matter most: label and value.
    pub headline: Vec<(String, String)>,
    /// Verdicts on identifiability, a paragraph each.
    pub verdicts: Vec<String>,
    /// What could not be had, and why.
    pub notes: Vec<String>,
    /// Sections, in order.
    pub sections: Vec<ReportSection>,
}

/// A part of a report under a heading of its own.
#[derive(Debug, Clone, Serialize)]
pub struct ReportSection {
    /// Heading.
    pub heading: String,
    /// Tables, before the figures.
    pub tables: Vec<Table>,
    /// Figures.
    pub figures: Vec<Figure>,
}

impl Report {
    /// Adds a section; one without tables and figures is left out.
    pub fn add(&mut self, heading: &str, tables: Vec<Table>, figures: Vec<Figure>) {
        if !tables.is_empty() || !figures.is_empty() {
            self.sections.push(ReportSection { heading: heading.to_owned(), tables, figures });
        }
    }
}

pub(crate) fn data_address(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(png))
}

pub(crate) fn image(png: &[u8]) -> String {
    format!("<img alt=\"\" src=\"{}\">", data_address(png))
}

/// Renders a report as one file: no script, no font, no picture from elsewhere.
///
/// # Errors
/// [`ReportError::Template`].
pub fn render(report: &Report) -> Result<String, ReportError> {
    let mut environment = Environment::new();
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    environment.add_template("report", include_str!("report.html"))?;
    Ok(environment.get_template("report")?.render(context! { r => Value::from(Serde(report)) })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_nothing_is_loaded_from_elsewhere() {
        let mut report = Report {
            title: "flight <script>".to_owned(),
            verdicts: vec!["C_m & C_X".to_owned()],
            ..Report::default()
        };
        let table = Table::new("t", ["a"], vec![vec!["1 < 2".into()]]);
        report.add(
            "Motion",
            vec![table],
            vec![Figure { caption: "a picture".into(), markup: image(b"not really") }],
        );
        let html = render(&report).expect("a report");
        assert!(html.contains("flight &lt;script&gt;") && !html.contains("<script"));
        assert!(html.contains("C_m &amp; C_X") && html.contains("1 &lt; 2"));
        assert!(html.contains("data:image/png;base64,bm90IHJlYWxseQ=="));
        assert!(!html.contains("http:") && !html.contains("https:"));
    }
}
