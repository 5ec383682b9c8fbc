//! What may be typed after `plan` and `campaign`.

use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// `campaign`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  mavsight campaign campaign.toml --out campaign\n  \
mavsight campaign --faults --flights 500 --out faults\n\n\
Writes flights.csv, with every estimate of every flight, and summary.json. A campaign that was killed goes on where it was,\n\
and ends with the same table.")]
pub(crate) struct Campaign {
    /// Rigs, noise, manoeuvres
    #[arg(value_name = "CAMPAIGN.toml", required_unless_present = "faults", conflicts_with = "faults")]
    pub(crate) campaign: Option<PathBuf>,
    /// Flies in the laboratories of `selftest`, with faults of cameras and recordings, each alone and in pairs
    #[arg(long)]
    pub(crate) faults: bool,
    /// Flights with faults
    #[arg(long, value_name = "N", default_value_t = 2000, requires = "faults", value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    pub(crate) flights: u64,
    /// Seed of all that is drawn of them
    #[arg(long, value_name = "N", default_value_t = 1, requires = "faults")]
    pub(crate) seed: u64,
    /// One fault alone, such as clock-step
    #[arg(long, value_name = "FAULT", requires = "faults")]
    pub(crate) only: Option<String>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Threads; all cores where left out
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<u16>,
}

/// `plan`
#[derive(Debug, Subcommand)]
pub(crate) enum Plan {
    /// Find the placements of cameras with the least predicted error of pose
    Cameras(PlanCameras),
    /// Compare the information of manoeuvres on the parameters, and find a multisine that has more
    Manoeuvre(PlanManoeuvre),
}

/// `plan manoeuvre`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  mavsight plan manoeuvre room/room.toml --cameras plan/plan.json --out plan\n\n\
Each manoeuvre is flown as large as the limits allow, in the middle of the room file's volume. Standard deviations are\n\
those of output error from poses, Cramér-Rao bounds through cameras, poses and equations of motion."
)]
pub(crate) struct PlanManoeuvre {
    /// Room, flight volume, cameras, obstacles
    #[arg(value_name = "ROOM.toml")]
    pub(crate) room: PathBuf,
    /// plan.json of `plan cameras`, whose best placement is taken; searched for where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) cameras: Option<PathBuf>,
    /// A scenario of your own to compare; may be repeated
    #[arg(long, value_name = "FILE")]
    pub(crate) scenario: Vec<PathBuf>,
    /// Length of the built-in manoeuvres' flights, s
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    pub(crate) duration: f64,
    /// Inputs of the vehicle's model that are moved: the first by the built-in manoeuvres, all by the
    /// optimised multisine. Where left out, the first angle that may go as far to either side, or the
    /// model's first input
    #[arg(long, value_name = "NAMES", value_delimiter = ' ')]
    pub(crate) input: Vec<String>,
    /// Largest change of an input that is an angle, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 5.0)]
    pub(crate) max_deflection: f64,
    /// Largest bank and pitch, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 25.0)]
    pub(crate) max_tilt: f64,
    /// Parameters that the multisine is optimised for; where left out, C_m,0 C_m,alpha_u C_m,alpha_l C_m,q of
    /// a coaxial helicopter, and all that are free of another aircraft
    #[arg(long, value_name = "NAMES", value_delimiter = ' ')]
    pub(crate) parameters: Vec<String>,
    /// Least determinant of their covariance (d), or least sum of relative variances (a)
    #[arg(long, value_enum, default_value_t = Criterion::D)]
    pub(crate) criterion: Criterion,
    /// Rounds of the search for the multisine
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub(crate) generations: usize,
    /// Seed of that search
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Folder for manoeuvres.csv, manoeuvres.json and a scenario file of each
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// Criterion of an optimal input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Criterion {
    /// Determinant
    D,
    /// Sum of relative variances
    A,
}

/// `plan cameras`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight plan cameras --example room\n  \
mavsight plan cameras room/room.toml --out plan --study\n\n\
Errors are predicted by the equations that estimate poses and calibrate cameras. Each marker must be seen by two cameras,\n\
large enough and sharp, everywhere in the volume.")]
pub(crate) struct PlanCameras {
    /// Room, flight volume, cameras, obstacles
    #[arg(value_name = "ROOM.toml", required_unless_present = "example")]
    pub(crate) room: Option<PathBuf>,
    /// Folder for plan.html, plan.json, placements.csv and a session to start from; printed only where left
    /// out
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Distance between the places that are tried before the best are refined
    #[arg(long, value_name = "METRES", default_value_t = 0.75)]
    pub(crate) step: f64,
    /// Cameras may look beside the middle of the volume
    #[arg(long)]
    pub(crate) free_aim: bool,
    /// Placements in the ranking
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub(crate) best: usize,
    /// Also predict error against angle and distance of two cameras of the first type
    #[arg(long)]
    pub(crate) study: bool,
    /// Write the paper's room into a folder, as files to start from
    #[arg(long, value_name = "DIR")]
    pub(crate) example: Option<PathBuf>,
}
