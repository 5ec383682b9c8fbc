//! Videos of a small aircraft in, its motion and flight-dynamics parameters out.
//!
//! The facade of the workspace: each module is one crate of it. [`engine`] carries a recorded session through
//! all stages; [`pipeline`] has the stages alone, without files.
//! `cargo run --release -p mavsight --example quickstart -- flight/session.toml` runs this:
//!
//! ```no_run
#![doc = include_str!("../examples/quickstart.rs")]
//! ```
//!
//! `engine::run` does the same in one call, and [`report`] writes the figures and `report.html`.

mod cli;
mod commands;
pub mod lab;
mod out;
mod program;
mod progress;

pub use program::command_line;

pub use mavsight_engine as engine;
pub use mavsight_flight as flight;
pub use mavsight_geometry as geometry;
pub use mavsight_identify as identify;
pub use mavsight_inertial as inertial;
pub use mavsight_link as link;
pub use mavsight_live as live;
pub use mavsight_log as log;
#[cfg(feature = "page")]
pub use mavsight_page as page;
pub use mavsight_pipeline as pipeline;
pub use mavsight_plan as plan;
pub use mavsight_pose as pose;
pub use mavsight_random as random;
pub use mavsight_report as report;
pub use mavsight_scene as scene;
pub use mavsight_score as score;
pub use mavsight_session as session;
pub use mavsight_simulator as simulator;
pub use mavsight_vision as vision;
