//! The reader of PX4's ULog, from behind the first bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mavsight_log::Log;

fuzz_target!(|rest: &[u8]| {
    let bytes = [&b"ULog\x01\x12\x35\x01"[..], rest].concat();
    drop(Log::read(&mut &bytes[..], &|_, _, _| true));
});
