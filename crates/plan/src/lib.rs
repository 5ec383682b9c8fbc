//! What to expect before flying: where to put cameras, and which manoeuvre to fly.
//!
//! Nothing here measures: covariances are predicted by the estimators' own equations (`mavsight-pose`,
//! `mavsight-identify`) at cameras, poses and motions that are only planned.

mod centre;
mod error;
mod layout;
mod load;
mod manoeuvre;
mod multisine;
mod place;
mod room;
mod search;
mod solid;
mod study;

pub use centre::{CentreNoise, CentreStd};
pub use error::PlanError;
pub use layout::{Placed, Planner, PosePrecision, Prediction, ViewLimit};
pub use manoeuvre::{FlightLimits, FlightPlanner, PlannedManoeuvre, true_model};
pub use multisine::{MultisineOptions, Optimality};
pub use room::{CameraType, ControlSection, Criterion, EXAMPLE, ROOM_SCHEMA, Room, VolumeSection, Weights};
pub use search::{Ranked, SearchOptions};
pub use solid::Solid;
pub use study::{CameraPair, StudyRow};
