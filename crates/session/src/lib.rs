//! What is on disk: session files, tables, video and image sources, and the results of a run.

mod config;
mod decimal;
mod distances;
mod error;
mod files;
pub mod foreign;
pub mod logs;
#[cfg(feature = "parquet")]
mod parquet_headers;
#[cfg(feature = "parquet")]
mod parquet_rows;
pub mod results;
mod session_file;
mod storage;
mod table;
pub mod tables;
pub mod video;

pub use config::{Session, cameras_of, load_equations, load_vehicle, write_vehicle};
pub use distances::DistanceTable;
pub use error::SessionError;
pub use files::{make_folder, read_toml, write_json, write_toml, write_whole};
pub use mavsight_link::LiveSection;
pub use results::{
    FlightTable, MarkerAsBuilt, RESULTS_SCHEMA, RunResults, has_assumed_std, read_body, read_flight_table,
    read_markers, read_motion, read_poses, read_rig, read_summary, result_tables, write_markers,
    write_markers_early, write_pooled, write_results, write_rig,
};
pub use session_file::{
    ControlSection, Estimate, FieldOrder, LineTime, RigSection, SESSION_SCHEMA, SessionCamera, SessionFile,
    WandSection,
};
pub use storage::{Storage, Syncer, sync_folder};
pub use table::{Row, Table, write_csv};
pub use tables::{read_control_points, write_control_points, write_inputs, write_numbers};
pub use video::{
    FrameSource, LiveVideo, VideoWriter, Y4mWriter, ffmpeg_program, find_clap, read_image, write_png,
};

/// Frames or rows a second that a recording may have.
pub const RATES_HZ: std::ops::Range<f64> = 0.01..1e5;

/// Seconds as the nearest nanoseconds.
pub fn ns_from_s(t_s: f64) -> i64 {
    (t_s * 1e9).round() as i64
}

/// Nanoseconds as seconds.
pub fn s_from_ns(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}
