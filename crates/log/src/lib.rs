//! Logs that an aircraft has written itself: named streams, each with its own times, columns with units, and
//! what they can serve as.
//!
//! A log is read from end to end once, through a window of bounded size; of its samples only those of the
//! fields that are wanted are kept, and of the others their count, rate and gaps. Nothing is resampled. What
//! a file says of lengths and counts is believed only as far as the file itself has the bytes.

mod crazyflie;
mod dataflash;
mod error;
mod layout;
mod log;
mod recorder;
mod roles;
mod statistics;
mod topic;
mod ulog;
mod values;
mod window;

pub use error::LogError;
pub use log::{Column, Log, Stream, Wanted};
pub use roles::{Role, Serves};
pub use topic::{Field, Gap, LogFormat, Topic};
