//! What may be typed after `convert`.

use super::log::LogMapping;
use super::size;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use mavsight_geometry::ImageSize;
use mavsight_session::foreign::{frames::AxesOf, pixels::PixelOrigin};
use std::path::PathBuf;

/// `convert`
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  mavsight convert results/rig.toml calib-DLTcoefs.csv
  mavsight convert calibration.yml rig.toml --size 1920x1080
  mavsight convert results/pose.csv flight.tum --frame enu
  mavsight convert capture.c3d pose.csv --vehicle vehicle.toml     (then: mavsight identify pose.csv ...)
  mavsight convert results/motion.csv motion.parquet
  mavsight convert flight.ulg inputs.csv --preset px4-motors
  mavsight convert flight.bin inputs.csv --input omega_1_rad_s=ESC:RPM,instance=0 --vehicle quad.toml
  mavsight convert vehicle.toml new/vehicle.toml     (a vehicle file of schema 1, with a [rotor])

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
  log        *.ulg, *.bin, usdlog    the aircraft's own log: an inputs table, by --preset and --input
  csv, parquet   *.csv, *.parquet    any table
  vehicle    *.toml with a [rotor]   a vehicle file of schema 1, which is written as schema 2
  equations  *.toml with [[output]]  an equation file of schema 1: [[equation]] sections for a flight model

Poses become marker paths, and paths poses, where --vehicle gives the markers. More in docs/formats.md.")]
pub(crate) struct Convert {
    /// File to read
    #[arg(value_name = "IN")]
    pub(crate) input: PathBuf,
    /// File to write
    #[arg(value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Format of IN, where its name or content does not show it
    #[arg(long, value_name = "FORMAT", value_enum, hide_possible_values = true)]
    pub(crate) from: Option<Format>,
    /// Format of OUT, where its name does not show it
    #[arg(long, value_name = "FORMAT", value_enum, hide_possible_values = true)]
    pub(crate) to: Option<Format>,
    /// Vehicle file, for its markers
    #[arg(long, value_name = "FILE")]
    pub(crate) vehicle: Option<PathBuf>,
    /// Axes of the foreign trajectory: this program's, the same world with the body forward-left-up, PX4's,
    /// or ROS'
    #[arg(long, value_parser = axes_parser(), default_value = "world")]
    pub(crate) frame: AxesOf,
    /// Which axis of foreign marker paths is up
    #[arg(long, value_enum, default_value_t = Up::Z)]
    pub(crate) up: Up,
    /// Image size where the file does not say it: 640x480, or one a camera with commas between
    #[arg(long, value_name = "WxH", value_delimiter = ',', value_parser = size)]
    pub(crate) size: Vec<ImageSize>,
    /// Where DLTdv's and Argus' pixels are counted from; read from coefficients where left out
    #[arg(long, value_parser = origin_parser())]
    pub(crate) origin: Option<PixelOrigin>,
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
    #[command(flatten)]
    pub(crate) log: LogMapping,
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
    Vehicle,
    Equations,
    Log,
}

/// Which way is up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    Y,
    Z,
}

fn axes_parser() -> impl TypedValueParser<Value = AxesOf> {
    PossibleValuesParser::new(["world", "world-flu", "ned", "enu"]).map(|name| match name.as_str() {
        "world-flu" => AxesOf::WorldFlu,
        "ned" => AxesOf::Ned,
        "enu" => AxesOf::Enu,
        _ => AxesOf::World,
    })
}

fn origin_parser() -> impl TypedValueParser<Value = PixelOrigin> {
    PossibleValuesParser::new(["zero", "dltdv8", "dltdv5", "argus"]).map(|name| match name.as_str() {
        "dltdv8" => PixelOrigin::Dltdv8,
        "dltdv5" => PixelOrigin::Dltdv5,
        "argus" => PixelOrigin::Argus,
        _ => PixelOrigin::TopLeftZero,
    })
}
