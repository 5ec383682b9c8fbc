//! Small logs of each format, written by their documented layouts.

pub(crate) mod crazyflie;
pub(crate) mod dataflash;
pub(crate) mod ulog;

/// A small log of each format, with the name of its reader.
#[allow(dead_code)]
pub(crate) fn small_logs() -> [(&'static str, Vec<u8>); 3] {
    [("ulog", ulog::small()), ("dataflash", dataflash::small()), ("crazyflie", crazyflie::small())]
}
