//! What may be typed.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

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
    /// Run the whole chain on a recorded session
    Run(Run),
    /// Fly with running cameras, a replayed session or the virtual room: poses as they happen
    Live(Live),
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
    /// Turn cameras, trajectories, tracked points and tables into other programs' formats, and back
    Convert(Convert),
    /// Fly a rig many times on paper: do the 95 % intervals hold the truth?
    Selftest(Selftest),
    /// What to expect before flying: where to put cameras, which manoeuvre to fly
    #[command(subcommand)]
    Plan(Plan),
    /// Fly thousands of simulated flights over a grid of rigs, noise and manoeuvres
    Campaign(Campaign),
}

/// `live`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  mavsight live session.toml --json\n  mavsight live session.toml --replay\n  \
mavsight live --virtual --record flight\n\n\
A camera of the session is what its `live` names. Poses that were not measured are not sent. See docs/live.md."
)]
pub(crate) struct Live {
    /// The session; none with --virtual
    #[arg(value_name = "SESSION.toml", required_unless_present = "virtual_room")]
    pub(crate) session: Option<PathBuf>,
    /// Replay the session's recordings at their own pace
    #[arg(long, conflicts_with = "virtual_room")]
    pub(crate) replay: bool,
    /// Film the virtual room, flown by a pilot
    #[arg(long = "virtual", conflicts_with = "session")]
    pub(crate) virtual_room: bool,
    /// As fast as it goes, nothing dropped; with --replay or --virtual
    #[arg(long)]
    pub(crate) fast: bool,
    /// Length of the flight
    #[arg(long = "for", value_name = "SECONDS", allow_negative_numbers = true)]
    pub(crate) seconds: Option<f64>,
    /// Events as JSON on standard output, one a line
    #[arg(long)]
    pub(crate) json: bool,
    /// Record what is received, detected and sent: a session that `run` takes
    #[arg(long, value_name = "DIR")]
    pub(crate) record: Option<PathBuf>,
    /// Folder for live.json, the figures of the flight
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// MAVLink ODOMETRY by UDP, to an address where one is given; otherwise the session's [live.mavlink]
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) mavlink: Option<Option<String>>,
    /// NatNet 3.1, asked for at an address
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) natnet: Option<Option<String>>,
    /// VRPN, asked for at an address
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) vrpn: Option<Option<String>>,
    /// Events as lines to who connects to an address by TCP
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1)]
    pub(crate) lines: Option<Option<String>>,
    /// Events by Zenoh, on an endpoint such as tcp/127.0.0.1:7447; in a build with the feature `zenoh`
    #[arg(long, value_name = "ENDPOINT", num_args = 0..=1)]
    pub(crate) zenoh: Option<Option<String>>,
    /// A page in the browser; of this machine alone (127.0.0.1:8750) where no address is given
    #[cfg(feature = "page")]
    #[arg(long, value_name = "IP:PORT", num_args = 0..=1)]
    pub(crate) serve: Option<Option<std::net::SocketAddr>>,
    /// Frames a second of the virtual room
    #[arg(long, value_name = "HZ", default_value_t = 60.0)]
    pub(crate) rate: f64,
    /// Size of the virtual room's images, such as 1920x1080
    #[arg(long, value_name = "WxH", default_value = "640x480")]
    pub(crate) size: String,
    /// Seed of the virtual room
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}

/// `campaign`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight campaign campaign.toml --out campaign\n\n\
Writes flights.csv, with every estimate of every flight, and summary.json. A campaign that was killed goes on where it was,\n\
and ends with the same table.")]
pub(crate) struct Campaign {
    /// Rigs, noise, manoeuvres
    #[arg(value_name = "CAMPAIGN.toml")]
    pub(crate) campaign: PathBuf,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Threads; all cores where left out
    #[arg(long, value_name = "N")]
    pub(crate) threads: Option<usize>,
}

/// `plan`
#[derive(Debug, Subcommand)]
pub(crate) enum Plan {
    /// Find the placements of cameras with the least predicted error of pose
    Cameras(PlanCameras),
    /// Compare what manoeuvres tell of the parameters, and find a multisine that tells more
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
    /// Largest angle of the swash-plate, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 5.0)]
    pub(crate) max_deflection: f64,
    /// Largest bank and pitch, degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 25.0)]
    pub(crate) max_tilt: f64,
    /// Parameters that the multisine is optimised for
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ' ',
        default_value = "C_m,0 C_m,alpha_u C_m,alpha_l C_m,q"
    )]
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
    /// Folder for plan.html, plan.json, placements.csv and a session to start from; printed only where left out
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
}

/// `run`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight run paper-flight/session.toml --out results")]
pub(crate) struct Run {
    /// The session file
    #[arg(value_name = "SESSION.toml")]
    pub(crate) session: PathBuf,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Leave out output error from the poses and from the images
    #[arg(long)]
    pub(crate) equation_error_only: bool,
    /// A part of the flight that is not fitted but predicted, s
    #[arg(long, value_name = "FROM..TO")]
    pub(crate) hold_out: Option<Interval>,
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
    /// Carry the aircraft about by hand for as long as the scenario, in place of flying
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
mavsight identify mocap.csv --inputs log.csv --vehicle quad.toml --model quad-model.toml --hold-out 7..9\n\n\
The table has t_s,x_m,y_m,z_m,phi_rad,theta_rad,psi_rad at any rate, with or without a `_std` column for each, and is\n\
smoothed; or it has all columns of motion.csv and is taken as it is. A row with its time alone was not measured.")]
pub(crate) struct Identify {
    /// Poses or motion, from `track` or from any other system
    #[arg(value_name = "TABLE.csv")]
    pub(crate) table: PathBuf,
    /// Recorded inputs
    #[arg(long, value_name = "FILE")]
    pub(crate) inputs: PathBuf,
    /// Vehicle file
    #[arg(long, value_name = "FILE")]
    pub(crate) vehicle: PathBuf,
    /// Output equations; those of equation 3 where left out
    #[arg(long, value_name = "FILE")]
    pub(crate) model: Option<PathBuf>,
    /// Estimators, of ols, wls, tls, gtls, fd, and oe for output error from poses [default: ols,tls,gtls, and oe
    /// where no model is given]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) estimator: Vec<String>,
    /// Band of the estimator fd, Hz
    #[arg(long, value_name = "LOW..HIGH")]
    pub(crate) band: Option<Interval>,
    /// Frequency at which one more low-pass of both sides passes one half; found from the data where left out
    #[arg(long, value_name = "HZ")]
    pub(crate) bandwidth: Option<f64>,
    /// A part of the flight that is not fitted but predicted, s
    #[arg(long, value_name = "FROM..TO")]
    pub(crate) hold_out: Option<Interval>,
    /// What to add to the inputs' times; estimated, and said, where left out
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub(crate) lag: Option<f64>,
    /// Choose each output's regressors from the model's, step by step by PRESS
    #[arg(long)]
    pub(crate) stepwise: bool,
    /// Folder for the results; printed only where left out
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
}

/// Two numbers, `FROM..TO`, the second above the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval(pub(crate) f64, pub(crate) f64);

impl std::str::FromStr for Interval {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not two rising numbers: write them as 0.5..3");
        let (from, to) = text.split_once("..").ok_or_else(wrong)?;
        let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong);
        let (from, to) = (number(from)?, number(to)?);
        if from < to { Ok(Self(from, to)) } else { Err(wrong()) }
    }
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
    /// Film each flight in the virtual room and detect the balls, in place of drawing the noise of their centres: slow
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

/// `convert`
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  mavsight convert results/rig.toml calib-DLTcoefs.csv
  mavsight convert calibration.yml rig.toml --size 1920x1080
  mavsight convert results/pose.csv flight.tum --frame enu
  mavsight convert capture.c3d pose.csv --vehicle vehicle.toml     (then: mavsight identify pose.csv ...)
  mavsight convert results/motion.csv motion.parquet

Formats, and the names by which they are known:
  rig        rig.toml                cameras of this program
  dlt        *DLTcoefs.csv, *dlt-coefficients.csv   cameras of DLTdv and Argus
  argus      *profile.txt            lenses of Argus
  opencv     *.yml                   cameras of OpenCV
  ros        *camera_info*.yaml      one camera of ROS; {camera} in the name of OUT writes all
  kalibr     *camchain*.yaml         cameras of Kalibr
  pose       pose.csv, motion.csv    poses of this program
  tum        *.tum, *tum*.txt        poses of the TUM benchmark, quaternion x y z w
  euroc      *euroc*.csv             poses of the EuRoC benchmark, quaternion w x y z
  paths      *positions.csv          markers in space: t_s,marker,x_m,y_m,z_m
  trc, c3d   *.trc, *.c3d            markers in space of motion-capture systems
  xyzpts     *xyzpts.csv, .tsv       points in space of DLTdv
  markers    markers.csv             markers in the images
  xypts      *xypts.csv, .tsv        points in the images of DLTdv
  control    control_points.csv      control points of this program
  object     *object*.csv            control object of DLTdv
  offsets    *offsets.csv, .tsv      offsets of DLTdv: lines for session.toml
  csv, parquet   *.csv, *.parquet    any table

Poses become marker paths, and paths poses, where --vehicle tells the markers. More in docs/formats.md.")]
pub(crate) struct Convert {
    /// File to read
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// File to write
    #[arg(value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Format of IN, where its name or content does not tell
    #[arg(long, value_name = "FORMAT", value_enum, hide_possible_values = true)]
    pub(crate) from: Option<Format>,
    /// Format of OUT, where its name does not tell
    #[arg(long, value_name = "FORMAT", value_enum, hide_possible_values = true)]
    pub(crate) to: Option<Format>,
    /// Vehicle file, for its markers
    #[arg(long, value_name = "FILE")]
    pub(crate) vehicle: Option<PathBuf>,
    /// Axes of the foreign trajectory: this program's, the same world with the body forward-left-up, PX4's, or ROS'
    #[arg(long, value_enum, default_value_t = Frame::World)]
    pub(crate) frame: Frame,
    /// Which axis of foreign marker paths is up
    #[arg(long, value_enum, default_value_t = Up::Z)]
    pub(crate) up: Up,
    /// Image size where the file does not say it: 640x480, or one a camera with commas between
    #[arg(long, value_name = "WxH", value_delimiter = ',')]
    pub(crate) size: Vec<Size>,
    /// Where DLTdv's and Argus' pixels are counted from; read from coefficients where left out
    #[arg(long, value_enum)]
    pub(crate) origin: Option<Origin>,
    /// Rows a second of DLTdv's tables
    #[arg(long, value_name = "HZ")]
    pub(crate) rate: Option<f64>,
    /// Standard deviation of digitised points, px
    #[arg(long, value_name = "PX", default_value_t = 1.0)]
    pub(crate) std: f64,
    /// Names of the cameras
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) cameras: Vec<String>,
    /// Names of the points
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) points: Vec<String>,
    /// The camera that a format for one camera is to hold
    #[arg(long, value_name = "NAME")]
    pub(crate) camera: Option<String>,
    /// Leave out skew where the format has no place for it
    #[arg(long)]
    pub(crate) drop_skew: bool,
}

/// A format of `convert`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    Rig,
    Dlt,
    Argus,
    Opencv,
    Ros,
    Kalibr,
    Pose,
    Tum,
    Euroc,
    Paths,
    Trc,
    C3d,
    Xyzpts,
    Markers,
    Xypts,
    Control,
    Object,
    Offsets,
    Csv,
    Parquet,
}

/// Axes of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Frame {
    World,
    WorldFlu,
    Ned,
    Enu,
}

/// Which way is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    Y,
    Z,
}

/// Origin of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Origin {
    Zero,
    Dltdv8,
    Dltdv5,
    Argus,
}

/// Width and height, `640x480`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Size(pub(crate) mavsight_geometry::ImageSize);

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is no size: write it as 640x480");
        let (w, h) = text.split_once('x').ok_or_else(wrong)?;
        let side =
            |t: &str| t.trim().parse::<u32>().ok().filter(|n| (1..1_000_000).contains(n)).ok_or_else(wrong);
        Ok(Self(mavsight_geometry::ImageSize { width_px: side(w)?, height_px: side(h)? }))
    }
}

/// The call itself was wrong: a file that is not there or does not say what it must.
#[derive(Debug)]
pub(crate) struct WrongCall(pub(crate) String);

impl std::fmt::Display for WrongCall {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WrongCall {}
