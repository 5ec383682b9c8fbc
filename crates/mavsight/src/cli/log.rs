//! What may be typed after `log`.

use clap::Args;
use std::path::PathBuf;

/// `log`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight log flight.ulg\n  mavsight log flight.bin --topic IMU\n  \
mavsight log log10 --json\n\n\
Logs of PX4 (ULog), ArduPilot (DataFlash .bin) and the Crazyflie's card, and tables (.csv, .parquet). A gap is an\n\
interval of more than three times the median. More in docs/logs.md.")]
pub(crate) struct ReadLog {
    /// The log
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Show every field of these topics, with its unit
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) topic: Vec<String>,
    /// Print all topics and fields as JSON
    #[arg(long)]
    pub(crate) json: bool,
}
