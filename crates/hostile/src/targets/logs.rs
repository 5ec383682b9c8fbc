//! Logs of aircraft.

use crate::Outcome;
use mavsight_log::Log;

/// Small logs of each format, written by their documented layouts.
#[allow(dead_code, unreachable_pub)]
#[path = "../../../log/tests/common/mod.rs"]
pub(super) mod small_logs;

/// Reads a log, and each stream of it.
pub(super) fn log(bytes: &[u8]) -> Outcome {
    let log = Log::read(&mut &bytes[..], &|_, _, _| true);
    if let Ok(log) = &log {
        for topic in &log.topics {
            let Ok(stream) = log.stream(&topic.name, Some(topic.instance)) else { continue };
            assert!(stream.times_ns.is_sorted_by(|a, b| a < b), "times of {}", stream.name);
            for column in &stream.columns {
                assert_eq!(column.values().count(), stream.times_ns.len(), "{}", stream.name);
            }
        }
    }
    log.into()
}

/// Sets the checksum at a log's end right.
pub(super) fn repair_crazyflie(mut bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len().saturating_sub(4);
    let checksum = crc32fast::hash(&bytes[..end]).to_le_bytes();
    bytes.truncate(end);
    bytes.extend(checksum);
    bytes
}
