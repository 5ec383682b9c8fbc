//! The reader of ArduPilot's DataFlash, from behind the first bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mavsight_log::Log;

fuzz_target!(|rest: &[u8]| {
    let bytes = [&b"\xa3\x95"[..], rest].concat();
    drop(Log::read(&mut &bytes[..], &|_, _, _| true));
});
