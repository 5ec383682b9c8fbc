//! One target of `mavsight_hostile::TARGETS`, by its name in `MAVSIGHT_TARGET`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mavsight_hostile::{TARGETS, Target};
use std::sync::LazyLock;

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("MAVSIGHT_TARGET").unwrap_or_default();
    TARGETS.iter().find(|target| target.name == name).expect("MAVSIGHT_TARGET is the name of a target")
});

fuzz_target!(|bytes: &[u8]| {
    match TARGET.repair {
        Some(repair) => drop((TARGET.run)(&repair(bytes.to_vec()))),
        None => drop((TARGET.run)(bytes)),
    }
});
