//! What is refused of logs, and what to do about it.

use thiserror::Error;

/// A log that cannot be read, or that does not have what is asked of it.
#[derive(Debug, Error)]
pub enum LogError {
    /// The operating system refused.
    #[error("the log cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// A file that no reader knows.
    #[error(
        "it begins with {start}, as no log does that is known (PX4 ULog, ArduPilot DataFlash, Crazyflie usdlog): name a log, or give a table as .csv or .parquet"
    )]
    UnknownFormat {
        /// Its first bytes, hexadecimal.
        start: String,
    },
    /// A header or a definition that cannot be read.
    #[error("byte {offset}: {detail}: the log is damaged there; copy it again from the card")]
    Damaged {
        /// Place in the file, from 0.
        offset: u64,
        /// What is wrong.
        detail: String,
    },
    /// A log without a sample.
    #[error("the log has no samples: record it again, or name another")]
    Empty,
    /// A topic that is not there.
    #[error("the log has no topic {name}{}", offer(.near))]
    MissingTopic {
        /// Name that was asked for.
        name: String,
        /// The topics with the nearest names.
        near: Vec<String>,
    },
    /// An instance of a topic that is not there.
    #[error("{topic} has no instance {instance}; there are: {}", list(.known))]
    MissingInstance {
        /// Topic.
        topic: String,
        /// Instance that was asked for.
        instance: u32,
        /// Those that there are.
        known: Vec<u32>,
    },
    /// A topic of several instances of which none was chosen.
    #[error(
        "{topic} has instances {}: say which is meant, by instance = {first} in a session, or by {topic}:FIELD,instance={first} or beside a preset --instance {first} on the command line",
        list(.known),
        first = .known[0]
    )]
    ManyInstances {
        /// Topic.
        topic: String,
        /// Its instances, two or more.
        known: Vec<u32>,
    },
    /// A field that is not there.
    #[error("{topic} has no field {name}{}", offer(.near))]
    MissingField {
        /// Topic.
        topic: String,
        /// Name that was asked for.
        name: String,
        /// The fields with the nearest names.
        near: Vec<String>,
    },
    /// A field of several topics of which none was chosen.
    #[error("{field} is a field of {}: say which topic is meant, for instance {}:{field}", .known.join(", "), .known[0])]
    ManyTopics {
        /// Field.
        field: String,
        /// Topics that have it, two or more.
        known: Vec<String>,
    },
    /// Samples whose times do not increase.
    #[error(
        "{topic}: {count} of {samples} samples do not come after the one before, the first at {t_s:.6} s after {before_s:.6} s: the log is damaged there or holds two flights; cut it at that place"
    )]
    TimeBackwards {
        /// Topic.
        topic: String,
        /// Such samples.
        count: u64,
        /// All samples.
        samples: u64,
        /// Time of the first of them.
        t_s: f64,
        /// The time before.
        before_s: f64,
    },
}

/// How many names an error offers in place of one that is not there.
const OFFERED: usize = 3;

/// The names that are most like one that there is not.
pub(crate) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut near: Vec<&str> = known.collect();
    near.sort_unstable();
    near.dedup();
    // A part of a long name is closer than another word of the same length.
    near.sort_by_cached_key(|known| (!known.contains(name), strsim::osa_distance(known, name)));
    near.into_iter().take(OFFERED).map(str::to_owned).collect()
}

fn offer(near: &[String]) -> String {
    match near {
        [] => "; there are none".to_owned(),
        some => format!("; the nearest are {}: correct the name", some.join(", ")),
    }
}

fn list(numbers: &[u32]) -> String {
    numbers.iter().map(u32::to_string).collect::<Vec<_>>().join(", ")
}
