//! What is held of each instant of a flight.

#[allow(dead_code)]
mod long_flight;

use long_flight::{instants, rig};
use mavsight_flight::Vehicle;
use mavsight_pipeline::{Quiet, motion_of, reconstruct};
use mavsight_pose::{MarkerObservation, MotionSample};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Two cameras see four markers each: an hour of 108 000 instants may hold 180 MB beside the program, its frames and its decoders,
/// which is 1666 bytes an instant.
#[test]
fn an_hour_of_poses_and_motion_is_within_its_bound() {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let held = |count: usize| {
        let region = Region::new(COUNTED);
        let tracked = reconstruct(&rig, &vehicle, instants(&rig, count)).unwrap();
        let motion = motion_of(&tracked, &vehicle, &Quiet).unwrap();
        let change = region.change();
        assert_eq!((tracked.poses.len(), motion.samples.len()), (count, count));
        // Each list doubles its room when it is full, which at powers of two is just before.
        (change.bytes_allocated - change.bytes_deallocated) as f64
    };
    let bytes_an_instant = (held(512) - held(256)) / 256.0;
    println!("{bytes_an_instant:.0} bytes an instant");
    assert!(bytes_an_instant < 1666.0, "{bytes_an_instant} bytes an instant");
    assert!(size_of::<MotionSample>() <= 384 && size_of::<MarkerObservation>() <= 72);
}
