//! Plots, tables and the self-contained HTML report.
//!
//! Knows nothing of where numbers come from: a caller fills a [`Report`] and gets one page.

mod chart;
mod drawing;
mod heatmap;
mod page;

pub use chart::{Chart, Curve, Panel, Role, draw};
pub use drawing::{BoxRole, DrawnBox, DrawnCamera, RoomDrawing, draw_room};
pub use heatmap::{HeatMap, draw_heat_maps};
pub use page::{Figure, Report, ReportError, Table, png_figure, render};
