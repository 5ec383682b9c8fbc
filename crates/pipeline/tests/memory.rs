//! What is held of each instant of a flight.

mod carried;

use carried::{LARGE, TWO, inputs, instants, rig_at};
use mavsight_flight::Vehicle;
use mavsight_pipeline::{IdentifyOptions, NoProgress, body_markers, identify_motion, motion_of, reconstruct};
use mavsight_pose::{MotionSample, PoseSample};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Two cameras see four markers each: of an hour of 108 000 instants, observations, poses and motion may
/// hold 119 MB, which is 1100 bytes an instant; and when the observations are gone, coefficients and fits
/// of six outputs 49 MB, which is 450.
#[test]
fn an_hour_is_within_its_bound() {
    let (rig, vehicle) = (rig_at(&TWO, LARGE, 0.1), Vehicle::paper());
    let body = body_markers(&vehicle);
    let held = |count: usize| {
        let region = Region::new(COUNTED);
        let tracked = reconstruct(&rig, &vehicle, instants(&rig, &body, count)).unwrap();
        let motion = motion_of(&tracked, None, &vehicle, &NoProgress).unwrap();
        let bytes = || {
            let change = region.change();
            (change.bytes_allocated - change.bytes_deallocated) as f64
        };
        // Each list doubles its room when it is full, which at powers of two is just before.
        let seen = bytes();
        assert_eq!((tracked.poses.len(), motion.samples.len()), (count, count));
        let options = IdentifyOptions { lag_s: Some(0.0), ..IdentifyOptions::default() };
        let flown = inputs(count);
        let before = bytes();
        let solution = identify_motion(&motion, &flown, &vehicle, &options, &NoProgress).unwrap();
        assert_eq!(solution.coefficients.outputs.len(), 6);
        (seen, bytes() - before)
    };
    let (few, many) = (held(512), held(1024));
    let per_instant = |few: f64, many: f64| (many - few) / 512.0;
    let (seen, fitted) = (per_instant(few.0, many.0), per_instant(few.1, many.1));
    println!("an instant: {seen:.0} bytes seen and measured, {fitted:.0} of coefficients and fits");
    assert!(seen < 1100.0 && fitted < 450.0, "an instant: {seen} and {fitted} bytes");
    assert!(size_of::<MotionSample>() <= 408 && size_of::<PoseSample>() <= 304);
}
