//! The report of a run: figures, tables, plots and the self-contained HTML file; before it, targets to print.
//!
//! [`Summary`] collects every figure of a run, [`write_report`] writes `report.html` and
//! [`write_plan_report`] `plan.html`. [`Report`] and [`render`] make a file of any tables and plots.
//! [`board_sheet`] and its neighbours draw sheets to print in their true size.

mod board_sheet;
mod camera_tables;
mod chart;
mod digits;
mod drawing;
mod ellipse;
mod equation_error;
mod figures;
mod findings;
mod flight_report;
mod flights_report;
mod heatmap;
mod html;
mod intervals;
mod marks;
mod output_error;
mod overlay;
mod overlay_film;
mod overview;
mod parameters;
mod picture;
mod plan_report;
mod sections;
mod sheet;
mod space;
mod summary;
mod svg;
mod symbols;
mod target_sheets;
mod terminal;

pub use board_sheet::{BoardSheetError, board_room_mm, board_sheet};
pub use findings::{Advice, Harm};
pub use flight_report::{FlightReport, write_report};
pub use flights_report::{pooled_text, write_flights_report};
pub use html::{Figure, Film, Report, ReportError, ReportSection, Table, render};
pub use intervals::IntervalTable;
pub use overlay_film::{FilmShot, OverlayFilm};
pub use parameters::parameter_text;
pub use picture::picture_address;
pub use plan_report::{CameraPlan, angle_deg, least, write_plan_report};
pub use sections::clocks_in;
pub use sheet::Sheet;
pub use summary::{Row, Summary};
pub use symbols::escaped;
pub use target_sheets::{
    NamedColor, color_sheet, control_frame_sheet, distance_form, wand_length_mm, wand_sheet,
};
pub use terminal::brief;
