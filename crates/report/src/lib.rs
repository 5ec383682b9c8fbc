//! The report of a run: figures, tables, plots and the self-contained HTML file.
//!
//! [`Summary`] collects every figure of a run and [`write_report`] writes `report.html`. [`Report`] and
//! [`render`] make a file of any tables and plots ([`draw`], [`draw_heat_maps`], [`draw_room`]).

mod camera_tables;
mod chart;
mod drawing;
mod equation_error;
mod figures;
mod flight_report;
mod heatmap;
mod html;
mod output_error;
mod parameters;
mod plan_report;
mod sections;
mod summary;
mod svg;

pub use chart::{Chart, Curve, Panel, Role, draw};
pub use drawing::{BoxRole, DrawnBox, DrawnCamera, RoomDrawing, draw_room};
pub use flight_report::{FlightReport, write_report};
pub use heatmap::{HeatMap, draw_heat_maps};
pub use html::{Figure, Report, ReportError, Table, render};
pub use parameters::parameter_text;
pub use plan_report::{CameraPlan, angle_deg, least, write_plan_report};
pub use summary::{Row, Summary};
