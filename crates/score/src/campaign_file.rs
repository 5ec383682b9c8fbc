//! The campaign file.

use mavsight_plan::CentreStd;
use serde::Deserialize;
use std::path::PathBuf;

/// Version of the campaign file.
pub const CAMPAIGN_SCHEMA: u32 = 1;

/// A campaign; the content of `CAMPAIGN.toml`. Every rig meets every noise and every manoeuvre.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignFile {
    /// Version of this file, [`CAMPAIGN_SCHEMA`].
    pub schema: u32,
    /// Seed of all that is drawn.
    #[serde(default = "one")]
    pub seed: u64,
    /// Flights of each combination.
    pub flights: u64,
    /// Estimator of the parameters.
    #[serde(default)]
    pub fit: FitKind,
    /// Rigs.
    pub rig: Vec<CampaignRig>,
    /// Noise.
    pub noise: Vec<NoiseLevel>,
    /// Manoeuvres.
    pub manoeuvre: Vec<CampaignManoeuvre>,
}

fn one() -> u64 {
    1
}

/// Estimator of parameters from a flight's poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FitKind {
    /// One Gauss-Newton step of output error from the truth, with the planned weights.
    #[default]
    FirstOrder,
    /// The whole fit of output error without truth and noise; takes some hundred times as long.
    OutputError,
}

/// A rig: a room file with cameras at given places.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignRig {
    /// Name.
    pub name: String,
    /// Room file.
    pub room: PathBuf,
    /// Cameras.
    pub camera: Vec<CampaignCamera>,
}

/// A camera of a rig.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignCamera {
    /// Name of its type in the room file.
    #[serde(rename = "type")]
    pub kind: String,
    /// Projection centre.
    pub centre_m: [f64; 3],
    /// Aim point; the middle of the volume where left out.
    pub aim_m: Option<[f64; 3]>,
}

/// Noise, in place of what the room file says; left out: as there.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseLevel {
    /// Name.
    pub name: String,
    /// Of a centre's coordinate, new in each frame; one for all or a list of equally likely ones.
    pub centre_std_px: Option<CentreStd>,
    /// Of a centre's coordinate, the same for a flight.
    pub centre_bias_px: Option<f64>,
    /// Of each coordinate of a marker on the body.
    pub markers_std_m: Option<f64>,
}

/// A manoeuvre.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignManoeuvre {
    /// Name.
    pub name: String,
    /// Scenario file.
    pub scenario: PathBuf,
}
