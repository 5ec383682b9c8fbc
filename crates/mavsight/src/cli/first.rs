//! What may be typed of `new`, `check` and `pick`.

use clap::Args;
use std::path::PathBuf;

/// `new`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  mavsight new my-flight --from cam1.mp4 cam2.mp4        (asks for the rest)\n  \
mavsight new my-flight --from cam1.mp4 cam2.mp4 --model coaxial --mass 0.8 --inertia 6.1e-3,6.26e-3,0.93e-3 \\\n    \
--ball-diameter 50 --ball red,225,225,100 --ball green,225,-225,100 --ball blue,-225,-225,100 \\\n    \
--inputs inputs.csv --distances distances.csv --control-diameter 60\n\n\
Nothing is asked where standard input is not a terminal: then all flags that are missing are named.\n\
Lengths of --ball, --ball-diameter, --control-diameter and --tape-std are millimetres; those of distances metres."
)]
pub(crate) struct New {
    /// Folder for session.toml, vehicle.toml and control_points.csv
    #[arg(value_name = "DIR")]
    pub(crate) dir: PathBuf,
    /// The videos of the flight, one for each camera
    #[arg(long, value_name = "VIDEO", num_args = 1..)]
    pub(crate) from: Vec<PathBuf>,
    /// Images of the control balls, in the order of the videos [default: the image beside each video whose name begins
    /// with the video's]
    #[arg(long, value_name = "IMAGE", num_args = 1..)]
    pub(crate) still: Vec<PathBuf>,
    /// Flight model: a name of the shelf, a model file, or none
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: Option<String>,
    /// Mass, kg
    #[arg(long, value_name = "KG")]
    pub(crate) mass: Option<String>,
    /// Moments of inertia about forward, right and down, kg m²
    #[arg(long, value_name = "XX,YY,ZZ")]
    pub(crate) inertia: Option<String>,
    /// Diameter of the balls on the aircraft, mm
    #[arg(long, value_name = "MM")]
    pub(crate) ball_diameter: Option<String>,
    /// A ball on the aircraft: its colour, and its place forward, right and down of the centre of gravity, mm; the
    /// colour as picked from a picture may follow (`red,225,225,100,#d02a2a`)
    #[arg(long, value_name = "COLOUR,X,Y,Z", allow_hyphen_values = true)]
    pub(crate) ball: Vec<String>,
    /// Table of the recorded inputs, or none
    #[arg(long, value_name = "FILE")]
    pub(crate) inputs: Option<String>,
    /// Table of control points whose places are surveyed
    #[arg(long, value_name = "FILE", conflicts_with_all = ["distances", "distance"])]
    pub(crate) control: Option<PathBuf>,
    /// Table of distances between the control balls: from,to,distance_m and, where one is known, std_m
    #[arg(long, value_name = "FILE", conflicts_with = "distance")]
    pub(crate) distances: Option<PathBuf>,
    /// A distance between two control balls, m: `red,green,3.002`; a height: `red,floor,0.031`; a plumb line:
    /// `violet,yellow,plumb`, the upper one first
    #[arg(long, value_name = "FROM,TO,M")]
    pub(crate) distance: Vec<String>,
    /// Diameter of the control balls, mm
    #[arg(long, value_name = "MM")]
    pub(crate) control_diameter: Option<String>,
    /// Colour of a control ball as picked from a picture: `orange=#b05020` [default: as it is called]
    #[arg(long, value_name = "NAME=#RRGGBB")]
    pub(crate) control_color: Vec<String>,
    /// Standard deviation of a distance by the tape measure, mm [default: 2]
    #[arg(long, value_name = "MM")]
    pub(crate) tape_std: Option<String>,
}

/// `check`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight check my-flight/session.toml\n\n\
Looks at some frames of each camera by the chain that `run` uses, and says what to mend first, the most harmful at the\n\
top. Exit status 1 where something must be mended.")]
pub(crate) struct Check {
    /// The session file, or the folder that holds it
    #[arg(value_name = "SESSION.toml")]
    pub(crate) session: PathBuf,
    /// The page to write [default: check.html beside the session file]
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
}

/// `pick`
#[cfg(feature = "page")]
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight pick my-flight/session.toml\n\n\
Serves a page on which one click on a ball names it, as a control point in a still or as a marker in a frame of the\n\
flight. Control points: the centre is fitted as in a run, the calibration is solved again after each click, and the point\n\
that disagrees is named; Save writes control_pixels.csv, the balls' colours in the table of control points, and\n\
`observations` in the session. Markers: the colour is that of the picture, and the page shows what is found by it; Save\n\
writes it into the vehicle file. What was there is kept as .bak.")]
pub(crate) struct Pick {
    /// The session file, or the folder that holds it
    #[arg(value_name = "SESSION.toml")]
    pub(crate) session: PathBuf,
    /// Address of the page [default: 127.0.0.1:8751]
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub(crate) serve: Option<std::net::SocketAddr>,
}
