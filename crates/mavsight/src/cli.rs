//! What may be typed.

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Videos of a small aircraft in, its motion and flight-dynamics parameters out.
#[derive(Debug, Parser)]
#[command(name = "mavsight", version, arg_required_else_help = true, propagate_version = true)]
#[command(after_help = "Example:\n  mavsight demo\n  mavsight run session.toml --out results\n\n\
Results go to standard output, progress and messages to standard error.\n\
Exit status: 0 success, 1 the work failed, 2 the call was wrong.")]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The whole chain, or one stage of it.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly, film, calibrate, track, identify and report a virtual aircraft, and score it against truth
    Demo(Demo),
    /// Run the whole chain on a recorded session
    Run(Run),
    /// Fly a virtual aircraft: writes inputs.csv, truth.csv and vehicle.toml
    Simulate(Simulate),
    /// Film a flight that `simulate` wrote: writes a session that `run` takes
    Film(Film),
    /// Solve for the cameras of a session: writes rig.toml
    Calibrate(Stage),
    /// Detect, track and reconstruct with the rig of `calibrate`: writes markers.csv, pose.csv and motion.csv
    Track(Stage),
    /// Fit the flight model to a table of poses and the recorded inputs
    Identify(Identify),
    /// Make report.html from the result files in a folder
    Report(Stage),
}

/// `demo`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight demo --out my-demo --seed 7")]
pub struct Demo {
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "mavsight-demo")]
    pub out: PathBuf,
    /// Seed of the image noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Vehicle file; the paper's helicopter where left out
    #[arg(long, value_name = "FILE")]
    pub vehicle: Option<PathBuf>,
    /// Scenario file; the paper's doublet where left out
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
}

/// `run`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight run paper-flight/session.toml --out results")]
pub struct Run {
    /// The session file
    #[arg(value_name = "SESSION.toml")]
    pub session: PathBuf,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `calibrate`, `track` and `report`
#[derive(Debug, Args)]
#[command(after_help = "Example, the chain in steps:\n  mavsight calibrate session.toml --out results\n  \
mavsight track session.toml --out results\n  \
mavsight identify --pose results/pose.csv --inputs inputs.csv --vehicle vehicle.toml --out results\n  \
mavsight report session.toml --out results")]
pub struct Stage {
    /// The session file
    #[arg(value_name = "SESSION.toml")]
    pub session: PathBuf,
    /// Folder with the results of the stages before, and for those of this one
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `simulate`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight simulate --out flight\n  mavsight film flight --out flight\n  \
mavsight run flight/session.toml --out results\n\n\
A scenario file says where the flight starts and what is done, for instance the paper's:\n  \
mavsight simulate --print-scenario > scenario.toml")]
pub struct Simulate {
    /// Folder for the flight
    #[arg(long, value_name = "DIR", required_unless_present_any = ["print_scenario", "print_vehicle"])]
    pub out: Option<PathBuf>,
    /// Vehicle file; the paper's helicopter where left out
    #[arg(long, value_name = "FILE")]
    pub vehicle: Option<PathBuf>,
    /// Scenario file; the paper's doublet where left out
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Print the paper's scenario as a file to start from
    #[arg(long)]
    pub print_scenario: bool,
    /// Print the paper's vehicle, with its assumptions, as a file to start from
    #[arg(long)]
    pub print_vehicle: bool,
}

/// `film`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight simulate --out flight\n  mavsight film flight --out flight\n  \
mavsight film flight --out flight --video     (MP4 by the ffmpeg program in place of PNG frames)")]
pub struct Film {
    /// Folder that `simulate` wrote
    #[arg(value_name = "FLIGHT")]
    pub flight: PathBuf,
    /// Folder for the session
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Write MP4 videos (needs the ffmpeg program) in place of PNG frames
    #[arg(long)]
    pub video: bool,
    /// Seed of the image noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// `identify`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight identify --pose pose.csv --inputs inputs.csv --vehicle vehicle.toml --out results")]
pub struct Identify {
    /// Table of poses, from `track` or from any other system, in the columns of pose.csv
    #[arg(long, value_name = "FILE")]
    pub pose: PathBuf,
    /// Recorded inputs
    #[arg(long, value_name = "FILE")]
    pub inputs: PathBuf,
    /// Vehicle file
    #[arg(long, value_name = "FILE")]
    pub vehicle: PathBuf,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// The call itself was wrong: a file that is not there or does not say what it must.
#[derive(Debug)]
pub struct WrongCall(pub String);

impl std::fmt::Display for WrongCall {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WrongCall {}
