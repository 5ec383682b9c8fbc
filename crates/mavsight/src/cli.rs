//! What may be typed.

mod convert;
mod first;
mod live;
mod log;
mod out;
mod plan;
mod targets;

pub(crate) use convert::{Convert, Format, Up};
#[cfg(feature = "page")]
pub(crate) use first::Pick;
pub(crate) use first::{Check, New};
pub(crate) use live::Live;
pub(crate) use log::{LogMapping, ReadLog};
pub(crate) use out::{Completions, Man, Overlay};
pub(crate) use plan::{Campaign, Criterion, Plan, PlanCameras, PlanManoeuvre};
pub(crate) use targets::{Paper, Targets};

use clap::{Args, Parser, Subcommand, ValueEnum};
use mavsight_geometry::ImageSize;
use std::path::PathBuf;
use std::time::Duration;

/// Videos of a small aircraft in, its motion and flight-dynamics parameters out.
#[derive(Debug, Parser)]
#[command(name = "mavsight", version, arg_required_else_help = true, propagate_version = true)]
#[command(after_help = "Example:\n  mavsight demo\n  mavsight run session.toml --out results\n\n\
Results go to standard output, progress and messages to standard error.\n\
Exit status: 0 success, 1 the work failed, 2 the call was wrong.")]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The whole chain, or one stage of it.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Fly, film, calibrate, track, identify and report a virtual aircraft, and score it against truth
    Demo(Demo),
    /// Make sheets to print: boards, a wand, marker colours, the plan of a control frame with a form for measured distances
    Targets(Targets),
    /// Begin a session: looks at the videos, asks for what it cannot see, writes session.toml, vehicle.toml and control_points.csv
    New(New),
    /// Look at a session before it is run: what is ready, and what to mend first
    Check(Check),
    /// Click on the balls of a session in the browser: control points in the stills, markers in the flight
    #[cfg(feature = "page")]
    Pick(Pick),
    /// Run the whole chain on a recorded session
    Run(Run),
    /// Fly with running cameras, a replayed session or the virtual room: poses as they happen
    Live(Live),
    /// Fly a virtual aircraft: writes inputs.csv, truth.csv, vehicle.toml and, where the model has [outputs], sensors.csv
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
    /// Make a video of what was found in the cameras' pictures: balls, pose, path, residuals and their ellipses
    Overlay(Overlay),
    /// Turn cameras, trajectories, tracked points and tables into other programs' formats, and back
    Convert(Convert),
    /// List what the aircraft's own log holds: topics, rates, gaps, units, and what they can serve as
    Log(ReadLog),
    /// Fly a rig many times on paper: do the 95 % intervals hold the truth?
    Selftest(Selftest),
    /// What to expect before flying: where to put cameras, which manoeuvre to fly
    #[command(subcommand)]
    Plan(Plan),
    /// Fly thousands of simulated flights over a grid of rigs, noise and manoeuvres
    Campaign(Campaign),
    /// Print a script by which a shell completes commands and options
    Completions(Completions),
    /// Write the manual's pages, one for each command
    Man(Man),
}

/// `demo`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight demo --out my-demo --seed 7")]
pub(crate) struct Demo {
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "mavsight-demo")]
    pub(crate) out: PathBuf,
    /// Seed of the image noise
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Vehicle file; the paper's helicopter where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) vehicle: Option<PathBuf>,
    /// Scenario file; the paper's doublet where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) scenario: Option<PathBuf>,
    /// Print every figure, verdict and note, in place of one screen
    #[arg(long)]
    pub(crate) verbose: bool,
}

/// `run`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight run paper-flight/session.toml --out results\n  \
mavsight run monday.toml tuesday.toml --out results     (each in a folder of its own, and parameters over both)")]
pub(crate) struct Run {
    /// The session file; of several flights of one aircraft each
    #[arg(value_name = "SESSION.toml", required = true)]
    pub(crate) sessions: Vec<PathBuf>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Leave out output error from the poses and from the images
    #[arg(long)]
    pub(crate) equation_error_only: bool,
    /// A part of the flight that is not fitted but predicted, s
    #[arg(long, value_name = "FROM..TO", value_parser = interval)]
    pub(crate) hold_out: Option<(f64, f64)>,
    /// What to add to the inputs' times; estimated, and said, where left out
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub(crate) lag: Option<f64>,
    /// Search, by output error, the terms that the flight model marks as candidates
    #[arg(long, conflicts_with = "equation_error_only")]
    pub(crate) search: bool,
    /// Print every figure, verdict and note, in place of one screen
    #[arg(long)]
    pub(crate) verbose: bool,
}

/// `calibrate`, `track` and `report`
#[derive(Debug, Args)]
#[command(after_help = "Example, the chain in steps:\n  mavsight calibrate session.toml --out results\n  \
mavsight track session.toml --out results\n  \
mavsight identify results/pose.csv --inputs inputs.csv --vehicle vehicle.toml --out results\n  \
mavsight report session.toml --out results")]
pub(crate) struct Stage {
    /// The session file
    #[arg(value_name = "SESSION.toml")]
    pub(crate) session: PathBuf,
    /// Folder with the results of the stages before, and for those of this one
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// `simulate`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight simulate --out flight\n  mavsight film flight --out flight\n  \
mavsight run flight/session.toml --out results\n\n\
A scenario file says where the flight starts and what is done, for instance the paper's:\n  \
mavsight simulate --print-scenario > scenario.toml")]
pub(crate) struct Simulate {
    /// Folder for the flight
    #[arg(long, value_name = "DIR", required_unless_present_any = ["print_scenario", "print_vehicle"])]
    pub(crate) out: Option<PathBuf>,
    /// Vehicle file; the paper's helicopter where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) vehicle: Option<PathBuf>,
    /// Scenario file; the paper's doublet where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) scenario: Option<PathBuf>,
    /// Recorded inputs to fly in place of the scenario's manoeuvres
    #[arg(long, value_name = "FILE")]
    pub(crate) inputs: Option<PathBuf>,
    /// Carry the aircraft about by hand for as long as the scenario, in place of flying; there are no inputs then
    #[arg(long, conflicts_with = "inputs")]
    pub(crate) carried: bool,
    /// Print the paper's scenario as a file to start from
    #[arg(long)]
    pub(crate) print_scenario: bool,
    /// Print the paper's vehicle, with its assumptions, as a file to start from
    #[arg(long)]
    pub(crate) print_vehicle: bool,
}

/// `film`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight simulate --out flight\n  mavsight film flight --out flight\n  \
mavsight film flight --out flight --video     (MP4 by the ffmpeg program in place of PNG frames)")]
pub(crate) struct Film {
    /// Folder that `simulate` wrote
    #[arg(value_name = "FLIGHT")]
    pub(crate) flight: PathBuf,
    /// Folder for the session
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Write MP4 videos (needs the ffmpeg program) in place of PNG frames
    #[arg(long)]
    pub(crate) video: bool,
    /// Cameras to film with: places, lenses, rates, clocks; the paper's where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) cameras: Option<PathBuf>,
    /// Table of control points to set up; the paper's where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) control: Option<PathBuf>,
    /// Seed of the image noise
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}

/// `identify`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  \
mavsight identify results/pose.csv --inputs inputs.csv --vehicle vehicle.toml --out results\n  \
mavsight identify mocap.csv --inputs log.csv --vehicle quad.toml --model quad-model.toml --hold-out 7..9\n  \
mavsight identify a.csv b.csv c.csv --inputs a-in.csv,b-in.csv,c-in.csv --vehicle vehicle.toml --out flights\n\n\
The table has t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad at any rate, with or without a `_std` column for each, and is\n\
smoothed; or it has all columns of motion.csv and is taken as it is. A row with its time alone was not measured.")]
pub(crate) struct Identify {
    /// Poses or motion, from `track` or from any other system; of several flights of one aircraft each
    #[arg(value_name = "TABLE.csv", required_unless_present = "log")]
    pub(crate) tables: Vec<PathBuf>,
    /// Recorded inputs: one file, or one for each table; needed unless the model has none
    #[arg(long, value_name = "FILES", value_delimiter = ',')]
    pub(crate) inputs: Vec<PathBuf>,
    /// The aircraft's own log in place of inputs; without a table its sensors alone are fitted, which --input names as inputs
    #[arg(long, value_name = "FILE", conflicts_with_all = ["inputs", "sensors"])]
    pub(crate) log: Option<PathBuf>,
    /// Which of its fields are which inputs
    #[command(flatten)]
    pub(crate) mapping: LogMapping,
    /// The part of a log without a table that is fitted, s by its clock; of several one after the other, with commas
    #[arg(long, value_name = "FROM..TO", value_parser = interval, value_delimiter = ',', conflicts_with = "tables")]
    pub(crate) within: Vec<(f64, f64)>,
    /// Vehicle file
    #[arg(long, value_name = "FILE")]
    pub(crate) vehicle: PathBuf,
    /// Samples of the sensors that the flight model's [outputs] describe, for output error: one file, or one for each
    /// table
    #[arg(long, value_name = "FILES", value_delimiter = ',')]
    pub(crate) sensors: Vec<PathBuf>,
    /// Split each flight into this many parts of one length, and fit each by itself
    #[arg(long, value_name = "COUNT", requires = "tables", value_parser = clap::value_parser!(u32).range(2..=100))]
    pub(crate) parts: Option<u32>,
    /// Equations in place of those of the vehicle's model, or another flight model
    #[arg(long, value_name = "FILE")]
    pub(crate) model: Option<PathBuf>,
    /// Estimators, of ols, wls, tls, gtls, fd, oe for output error and fe for filter error from poses
    /// [default: ols,tls,gtls, and oe,fe where no model is given]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) estimator: Vec<String>,
    /// Band of the estimator fd, Hz
    #[arg(long, value_name = "LOW..HIGH", value_parser = interval)]
    pub(crate) band: Option<(f64, f64)>,
    /// Frequency at which one more low-pass of both sides passes one half; found from the data where left out
    #[arg(long, value_name = "HZ")]
    pub(crate) bandwidth: Option<f64>,
    /// A part of the flight that is not fitted but predicted, s
    #[arg(long, value_name = "FROM..TO", value_parser = interval)]
    pub(crate) hold_out: Option<(f64, f64)>,
    /// What to add to the inputs' times; estimated, and said, where left out
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub(crate) lag: Option<f64>,
    /// Search, by output error, the terms that the flight model marks as candidates
    #[arg(long)]
    pub(crate) search: bool,
    /// Choose each output's regressors from the model's, step by step by PRESS
    #[arg(long)]
    pub(crate) stepwise: bool,
    /// Time that each fit by output error or filter error may take; its best values so far are then said
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub(crate) at_most: Option<Duration>,
    /// Folder for the results; printed only where left out
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// `selftest`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  mavsight selftest session.toml\n  mavsight selftest --rig wide --flights 50\n\n\
Each flight draws the control points' noise and calibrates anew, then a manoeuvre, the noise of every centre\n\
and its losses, all as in the session, and goes through the chain that measures flights. Exit status 1 where\n\
intervals of pose, velocity or rates hold less than 92 % or more than 98 % of the truths, or others less than 92 %."
)]
pub(crate) struct Selftest {
    /// The session whose cameras, vehicle, frame rate and noise are tested
    #[arg(value_name = "SESSION.toml", required_unless_present = "rig")]
    pub(crate) session: Option<PathBuf>,
    /// A built-in rig instead
    #[arg(long, value_enum, conflicts_with = "session")]
    pub(crate) rig: Option<BuiltInRig>,
    /// Number of flights [default: 200, or 3 with --film]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub(crate) flights: Option<u64>,
    /// Seed of all that is drawn
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Film each flight in the virtual room and detect the balls, in place of drawing the noise of their
    /// centres: slow
    #[arg(long)]
    pub(crate) film: bool,
    /// Folder for selftest.csv and selftest.json
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// Rigs that need no session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum BuiltInRig {
    /// The paper's two cameras at a right angle
    Paper,
    /// Two wide distorted lenses on 1920×1080
    Wide,
    /// Three cameras around
    Three,
}

/// The call itself was wrong: a file that is not there or does not say what it must.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct WrongCall(pub(crate) String);

/// A time above zero.
fn seconds(text: &str) -> Result<Duration, WrongCall> {
    let time = text.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    time.filter(|t| !t.is_zero())
        .ok_or_else(|| WrongCall(format!("{text:?} is no number of seconds above zero")))
}

/// Two numbers, `FROM..TO`, the second above the first.
fn interval(text: &str) -> Result<(f64, f64), WrongCall> {
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let both = text.split_once("..").and_then(|(from, to)| Some((number(from)?, number(to)?)));
    let wrong = || WrongCall(format!("{text:?} is not two rising numbers: write them as 0.5..3"));
    both.filter(|(from, to)| from < to).ok_or_else(wrong)
}

/// Width and height, `640x480`.
fn size(text: &str) -> Result<ImageSize, WrongCall> {
    let side = |t: &str| t.trim().parse::<u32>().ok().filter(|n| (1..1_000_000).contains(n));
    let sides = text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
    let (width_px, height_px) =
        sides.ok_or_else(|| WrongCall(format!("{text:?} is no size: write it as 640x480")))?;
    Ok(ImageSize { width_px, height_px })
}
