//! The results of a run on disk: one folder, one file for each kind, written whole or not at all.

pub(crate) mod columns;
mod read;
mod read_motion;
mod rig_file;
mod write;

use mavsight_identify::output_error::FlightFits;
use mavsight_identify::{Clocks, CoefficientTable, Identification};
use mavsight_inertial::LogAlignment;
use mavsight_pipeline::{CameraHealth, CentreQuality, Finding, TimedFrame};
use mavsight_pose::{ClockEstimate, MarkerObservation, Motion, PoseSample, Rig};

pub use read::{MarkerAsBuilt, has_assumed_std, read_body, read_markers, read_poses, read_summary};
pub use read_motion::{FlightTable, read_flight_table, read_motion};
pub use rig_file::{read_rig, write_rig};
pub use write::{EarlyFile, result_tables, write_markers, write_markers_early, write_pooled, write_results};

/// Version of `summary.json` and of the tables in its folder.
pub const RESULTS_SCHEMA: u32 = 1;

/// Names of the files in a folder of results.
pub mod names {
    /// Cameras.
    pub const RIG: &str = "rig.toml";
    /// Marker observations.
    pub const MARKERS: &str = "markers.csv";
    /// Markers as the flight has shown them.
    pub const BODY: &str = "body.csv";
    /// Poses as measured.
    pub const POSE: &str = "pose.csv";
    /// Smoothed motion.
    pub const MOTION: &str = "motion.csv";
    /// Coefficients and regressors.
    pub const COEFFICIENTS: &str = "coefficients.csv";
    /// Parameters.
    pub const PARAMETERS: &str = "parameters.csv";
    /// Every figure, machine-readable.
    pub const SUMMARY: &str = "summary.json";
    /// Parameters over several flights.
    pub const POOLED: &str = "pooled.csv";
    /// The page for people of several flights.
    pub const FLIGHTS: &str = "flights.html";
    /// The page for people.
    pub const REPORT: &str = "report.html";
    /// The film of what was found, where one was made: the report plays it.
    pub const FILM: &str = "flight.mp4";
}

/// Everything that a run found; what a stage did not make is empty and its file is not touched.
#[derive(Debug, Clone, Default)]
pub struct RunResults {
    /// Name of the session.
    pub session: String,
    /// Names of the cameras, in the order of the indices in `markers`.
    pub camera_names: Vec<String>,
    /// Names of the vehicle's markers, in the order of the indices in `markers` and `poses`.
    pub marker_names: Vec<String>,
    /// Cameras.
    pub rig: Option<Rig>,
    /// Every marker seen, or of a long flight some of them where `markers_file` has all.
    pub markers: Vec<MarkerObservation>,
    /// Their table, where it waits next to its place.
    pub markers_file: Option<EarlyFile>,
    /// Markers as the flight has shown them; empty where they were not refined.
    pub body: Vec<MarkerAsBuilt>,
    /// One sample an instant.
    pub poses: Vec<PoseSample>,
    /// Smoothed motion.
    pub motion: Option<Motion>,
    /// Coefficients and regressors.
    pub coefficients: Option<CoefficientTable>,
    /// Fits.
    pub identification: Option<Identification>,
    /// Fits of the equations of motion.
    pub output_error: FlightFits,
    /// The cameras' clocks, in the order of `camera_names`; empty where they were not looked at.
    pub camera_clocks: Vec<ClockEstimate>,
    /// How the aircraft's own log lies beside the poses, where it was aligned.
    pub log: Option<LogAlignment>,
    /// The lag between inputs and motion.
    pub clocks: Option<Clocks>,
    /// How well each camera saw the markers; none where they were seen by others.
    pub camera_health: Vec<CameraHealth>,
    /// How good the markers' centres are; none where the poses come from elsewhere.
    pub centres: Option<CentreQuality>,
    /// A frame of each camera, in the order of `camera_names`, at its time by the common clock; empty where there is no
    /// video. No result file holds them.
    pub pictures: Vec<TimedFrame>,
    /// What is wrong with cameras, recordings and files, and what explains it; each has its note too.
    pub findings: Vec<Finding>,
    /// What could not be had, and why.
    pub notes: Vec<String>,
    /// Figures for `summary.json`: an object, or null for no such file.
    pub summary: serde_json::Value,
}
