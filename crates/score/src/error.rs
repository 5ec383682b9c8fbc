//! Errors of self-tests and campaigns.

use thiserror::Error;

/// A self-test or a campaign cannot be carried out.
#[derive(Debug, Error)]
pub enum ScoreError {
    /// The cameras do not see where the aircraft would fly.
    #[error(
        "in {share_percent:.0} % of a flight around ({:.2}, {:.2}, {:.2}) m two cameras see three markers: a self-test needs {needed_percent:.0} %; move the cameras or fly elsewhere",
        middle_m[0], middle_m[1], middle_m[2]
    )]
    OutOfView {
        /// Part of the instants in view.
        share_percent: f64,
        /// Part needed.
        needed_percent: f64,
        /// Middle of the flight volume.
        middle_m: [f64; 3],
    },
    /// The session has too little data for a laboratory.
    #[error("the laboratory has {found} {what}, but needs {needed}: check the session")]
    TooFew {
        /// Kind of the data.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number needed.
        needed: usize,
    },
    /// An invalid campaign file.
    #[error("campaign: {key}: {detail}")]
    Campaign {
        /// Key concerned.
        key: String,
        /// Reason and remedy.
        detail: String,
    },
    /// The file of a campaign's pieces.
    #[error("{}: {detail}", path.display())]
    Chunks {
        /// The file.
        path: std::path::PathBuf,
        /// Reason.
        detail: String,
    },
    /// A file that cannot be read.
    #[error(transparent)]
    Session(#[from] mavsight_session::SessionError),
    /// A combination cannot be planned.
    #[error(transparent)]
    Plan(#[from] mavsight_plan::PlanError),
    /// The vehicle does not fly.
    #[error("simulating the vehicle: {0}")]
    Flight(#[from] mavsight_simulator::SimulatorError),
    /// The control points were refused.
    #[error("calibrating the virtual cameras: {0}")]
    Pose(#[from] mavsight_pose::PoseError),
    /// The pipeline failed.
    #[error(transparent)]
    Pipeline(#[from] mavsight_pipeline::PipelineError),
}
