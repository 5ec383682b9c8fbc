//! What may be typed of `targets`.

use super::WrongCall;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// `targets`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  mavsight targets print\n  \
mavsight targets print --paper a3 --columns 10 --rows 7 --dictionary DICT_5X5_100 --square 32\n\n\
Writes charuco, chessboard, wand, colors and control-frame, each as .pdf and .svg, and distances.csv, a form that\n\
`mavsight new --distances` reads once its numbers are filled in. Print at 100 %, without fitting to the page, and\n\
measure the line of 100 mm. Fix boards to something flat.")]
pub(crate) struct Targets {
    /// Folder for the sheets
    #[arg(value_name = "DIR")]
    pub(crate) dir: PathBuf,
    /// Paper
    #[arg(long, value_enum, default_value_t = Paper::A4)]
    pub(crate) paper: Paper,
    /// Inner corners along a row of the boards
    #[arg(long, value_name = "COUNT", default_value_t = 8, value_parser = clap::value_parser!(u16).range(2..=100))]
    pub(crate) columns: u16,
    /// Rows of inner corners
    #[arg(long, value_name = "COUNT", default_value_t = 5, value_parser = clap::value_parser!(u16).range(2..=100))]
    pub(crate) rows: u16,
    /// Side of a square, mm [default: the largest whole number that the paper has room for]
    #[arg(long, value_name = "MM", value_parser = length_mm)]
    pub(crate) square: Option<f64>,
    /// Side of a marker of the ChArUco board with its black border, mm [default: three quarters of a square]
    #[arg(long, value_name = "MM", value_parser = length_mm)]
    pub(crate) marker: Option<f64>,
    /// What OpenCV calls the markers of the ChArUco board
    #[arg(long, value_name = "NAME", default_value = "DICT_4X4_50")]
    pub(crate) dictionary: String,
    /// Diameter of the wand's balls, mm
    #[arg(long, value_name = "MM", default_value = "40", value_parser = length_mm)]
    pub(crate) wand_ball: f64,
}

/// A format of paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Paper {
    /// 210 × 297 mm
    A4,
    /// 297 × 420 mm
    A3,
    /// 8.5 × 11 inches
    Letter,
}

/// A length above zero, mm.
fn length_mm(text: &str) -> Result<f64, WrongCall> {
    let value = text.trim().parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| WrongCall(format!("{text:?} is no length above zero in millimetres")))
}
