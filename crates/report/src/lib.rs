//! Plots, tables and the self-contained HTML report.
//!
//! Knows nothing of where numbers come from: a caller fills a [`Report`] and gets one page.

mod chart;
mod page;

pub use chart::{Chart, Curve, Panel, Role, draw};
pub use page::{Figure, Report, ReportError, Table, png_figure, render};
