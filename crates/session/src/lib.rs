//! What is on disk: session files, tables, video and image sources, and the results of a run.

mod atomic;
pub mod config;
mod error;
pub mod foreign;
pub mod results;
pub mod scenario;
mod session_file;
mod session_rig;
mod table;
pub mod tables;
mod toml_file;
pub mod video;

pub use atomic::{make_folder, write_whole};
pub use config::{Session, load_model, load_vehicle};
pub use error::SessionError;
pub use results::{
    FlightTable, MarkerAsBuilt, RESULTS_SCHEMA, RunResults, has_assumed_std, read_body, read_flight_table,
    read_markers, read_motion, read_poses, read_rig, read_summary, write_markers, write_markers_early,
    write_results, write_rig,
};
pub use scenario::{write_control_points, write_inputs, write_numbers, write_session, write_vehicle};
pub use session_file::{
    BoardSection, ControlSection, Estimate, FieldOrder, LineTime, LiveSection, RefineSection, RefusedKey,
    RigSection, SESSION_SCHEMA, SessionCamera, SessionFile, WandBall, WandSection,
};
pub use session_rig::cameras_of;
pub use table::{Row, Table, csv_cell};
pub use tables::read_control_points;
pub use toml_file::read_toml;
pub use video::{FrameSource, LiveVideo, Y4mWriter, ffmpeg_program, find_clap, read_image, write_png};

/// Seconds as the nearest nanoseconds.
pub fn ns_from_s(t_s: f64) -> i64 {
    (t_s * 1e9).round() as i64
}

/// Nanoseconds as seconds.
pub fn s_from_ns(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}
