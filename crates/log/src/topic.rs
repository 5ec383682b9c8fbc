//! What a log holds, without its samples.

use crate::roles::Serves;
use serde::Serialize;

/// A kind of log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// PX4's ULog.
    Ulog,
    /// ArduPilot's DataFlash, `.bin`.
    Dataflash,
    /// The Crazyflie's µSD card, usdlog.
    Crazyflie,
    /// A table, as CSV or Parquet.
    Table,
}

impl std::fmt::Display for LogFormat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Ulog => "PX4 ULog",
            Self::Dataflash => "ArduPilot DataFlash",
            Self::Crazyflie => "Crazyflie usdlog",
            Self::Table => "table",
        })
    }
}

/// A number of a topic.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Field {
    /// Name as the log has it; elements of a list by their index, as `q[0]`.
    pub name: String,
    /// Unit as the log says it, or the documentation of the program that wrote it; `None` where neither does.
    pub unit: Option<String>,
}

/// An interval between two samples that is much longer than others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Gap {
    /// Time of the sample before it, ns on the clock of the log.
    pub at_ns: i64,
    /// Its length, ns.
    pub length_ns: i64,
}

/// A named stream of a log, with what its times show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Topic {
    /// Name as the log has it.
    pub name: String,
    /// Which of several of that name, from 0.
    pub instance: u32,
    /// Its numbers; texts are not among them.
    pub fields: Vec<Field>,
    /// Samples, at least one.
    pub samples: u64,
    /// Time of the first sample, ns on the clock of the log.
    pub first_ns: i64,
    /// Time of the last sample, ns.
    pub last_ns: i64,
    /// Samples a second, gaps apart; `None` of one sample.
    pub rate_hz: Option<f64>,
    /// Intervals of more than three times the median.
    pub gaps: u64,
    /// The longest of them.
    pub longest_gap: Option<Gap>,
    /// Samples that do not come after the one before, and are left out.
    pub left_out: u64,
    /// The first of these: its time and the time before, ns.
    pub first_left_out_ns: Option<[i64; 2]>,
    /// What it can serve as.
    pub serves: Vec<Serves>,
}
