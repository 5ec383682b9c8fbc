//! One HTML file that opens anywhere.

use crate::findings::Advice;
use crate::intervals::IntervalTable;
use crate::symbols;
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
#[derive(Debug, Clone, Default, Serialize)]
pub struct Figure {
    /// Below it.
    pub caption: String,
    /// SVG or `<img>` markup, made by this crate.
    pub markup: String,
    /// Its name in the page, by which others may show the same.
    pub id: Option<String>,
    /// The figure that this one shows again.
    pub same_as: Option<String>,
    /// The numbers of a chart, with which the page's script draws it so that it can be zoomed and read out.
    pub data: Option<serde_json::Value>,
}

impl Figure {
    /// A figure whose caption also describes it to those who do not see it.
    pub fn new(caption: impl Into<String>, markup: String) -> Self {
        let caption = caption.into();
        let label = symbols::escaped(&caption);
        let markup = markup
            .replacen("<svg role=\"img\"", &format!("<svg role=\"img\" aria-label=\"{label}\""), 1)
            .replacen("<img alt=\"\"", &format!("<img alt=\"{label}\""), 1);
        Self { caption, markup, ..Self::default() }
    }

    /// A chart, which has its number as a name.
    pub(crate) fn chart(caption: &str, markup: String, data: serde_json::Value) -> Self {
        let own = Self::new(caption, markup);
        let number = caption.strip_prefix("Figure ").and_then(|rest| rest.split_once(':'));
        let Some(id) = number.map(|(number, _)| format!("figure-{number}")) else {
            return Self { data: Some(data), ..own };
        };
        let markup = own.markup.replacen("<svg", &format!("<svg id=\"{id}\""), 1);
        Self { markup, id: Some(id), data: Some(data), ..own }
    }

    /// The same figure at another place under another caption; the page holds it once.
    pub(crate) fn again(&self, caption: &str) -> Self {
        let Some(id) = &self.id else { return Self { caption: caption.to_owned(), ..self.clone() } };
        let view = self.markup.split_once("viewBox=\"").and_then(|(_, rest)| rest.split_once('"'));
        let label = symbols::escaped(caption);
        let markup = format!(
            "<svg role=\"img\" aria-label=\"{label}\" viewBox=\"{}\"><use href=\"#{id}\"/></svg>",
            view.map_or("", |(view, _)| view)
        );
        Self { caption: caption.to_owned(), markup, same_as: Some(id.clone()), ..Self::default() }
    }
}

/// What a report shows, in order.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Report {
    /// Heading.
    pub title: String,
    /// Under it, a few sentences.
    pub lead: Vec<String>,
    /// The figures that matter most: label and value.
    pub headline: Vec<(String, String)>,
    /// Pictures that fill the first screen together with the heading and the sentences.
    pub overview: Vec<Figure>,
    /// The film that lies beside the page, or may.
    pub film: Option<Film>,
    /// Parameters with their intervals drawn.
    pub parameters: Option<IntervalTable>,
    /// What to mend, most harmful first.
    pub advice: Vec<Advice>,
    /// Sections, in order.
    pub sections: Vec<ReportSection>,
}

/// A film beside a report, which the page plays where it is there.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Film {
    /// Its file, in the folder of the report.
    pub file: String,
    /// The command that makes it.
    pub command: String,
    /// Whether it was there when the page was written; otherwise the page loads it when it is asked for.
    pub is_there: bool,
}

/// A part of a report under a heading of its own.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ReportSection {
    /// Heading.
    pub heading: String,
    /// Paragraphs, before all else.
    pub texts: Vec<String>,
    /// Tables, before the figures.
    pub tables: Vec<Table>,
    /// Figures.
    pub figures: Vec<Figure>,
    /// Whether only its heading is seen until it is opened.
    pub is_folded: bool,
}

impl Report {
    /// Adds a section; one without tables and figures is left out.
    pub fn add(&mut self, heading: &str, tables: Vec<Table>, figures: Vec<Figure>) {
        self.push(ReportSection { heading: heading.to_owned(), tables, figures, ..ReportSection::default() });
    }

    /// Adds a section that is folded; an empty one is left out.
    pub(crate) fn fold(
        &mut self,
        heading: &str,
        texts: Vec<String>,
        tables: Vec<Table>,
        figures: Vec<Figure>,
    ) {
        self.push(ReportSection { heading: heading.to_owned(), texts, tables, figures, is_folded: true });
    }

    /// Whether there is something for the page's script to do.
    fn is_live(&self) -> bool {
        let has_chart = |s: &ReportSection| s.is_folded || s.figures.iter().any(|f| f.data.is_some());
        !self.overview.is_empty() || self.film.is_some() || self.sections.iter().any(has_chart)
    }

    fn push(&mut self, section: ReportSection) {
        if !(section.texts.is_empty() && section.tables.is_empty() && section.figures.is_empty()) {
            self.sections.push(section);
        }
    }
}

/// Renders a report as one file: nothing in it comes from elsewhere, but for a film that lies beside it.
///
/// # Errors
/// [`ReportError::Template`].
pub fn render(report: &Report) -> Result<String, ReportError> {
    let mut environment = Environment::new();
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    environment.add_filter("symbols", |text: &str| Value::from_safe_string(symbols::html(text)));
    // A script ends at the first "</": JSON has another way to write it.
    environment.add_filter("json", |data: Serde<serde_json::Value>| {
        Value::from_safe_string(data.0.to_string().replace('<', "\\u003c"))
    });
    environment.add_template("report", include_str!("page/report.html"))?;
    let parts = context! {
        r => Value::from(Serde(report)),
        is_live => report.is_live(),
        licence => Value::from_safe_string(include_str!("uplot/LICENSE").to_owned()),
        style => Value::from_safe_string(concat!(include_str!("uplot/uPlot.min.css"), include_str!("page/report.css")).to_owned()),
        script => Value::from_safe_string(concat!(include_str!("uplot/uPlot.iife.min.js"), "\n", include_str!("page/report.js")).to_owned()),
    };
    Ok(environment.get_template("report")?.render(parts)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_nothing_is_loaded_from_elsewhere() {
        let mut report = Report {
            title: "flight <script>".to_owned(),
            lead: vec!["a & b".to_owned()],
            ..Report::default()
        };
        let table = Table::new("t", ["a"], vec![vec!["1 < 2".into()]]);
        let data = Some(serde_json::json!({"axis": "</script><script>bad()", "panels": []}));
        let figure =
            Figure { data, ..Figure::new("a \"picture\"", "<img alt=\"\" src=\"data:,x\">".to_owned()) };
        report.add("Motion", vec![table], vec![figure]);
        report.fold("Verdict", vec!["C_m & <b>".to_owned()], vec![], vec![]);
        let html = render(&report).expect("a report");
        assert!(html.contains("flight &lt;script&gt;") && !html.contains("<script>bad"));
        assert!(html.contains("<var>C</var><sub>m</sub> &amp; &lt;b&gt;"));
        assert!(html.contains("a &amp; b") && html.contains("1 &lt; 2"));
        assert!(html.contains("alt=\"a &quot;picture&quot;\""));
        for elsewhere in ["src=\"http", "href=\"http", "url(", "@import", "<link", "src=\"//"] {
            assert!(!html.contains(elsewhere), "{elsewhere}");
        }
        assert!(html.contains("default-src 'none'"), "a browser loads nothing else either");
        let still = render(&Report::default()).expect("a report");
        assert!(!still.contains("<script"), "a page without charts has no script");
    }
}
