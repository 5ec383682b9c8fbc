//! Allocations of the loop over instants: a pose with its lists, all freed again.

#[allow(dead_code)]
#[path = "flights/common.rs"]
mod common;
#[path = "flights/detections.rs"]
mod detections;

use common::{pose, rig};
use detections::detections;
use mavsight_flight::Vehicle;
use mavsight_live::LivePipeline;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Instants until every list has its size, and instants that are counted.
const WARM: i64 = 120;
const COUNT: i64 = 240;

#[test]
fn an_instant_allocates_its_pose_and_leaves_nothing_behind() {
    let (rig, vehicle) = (rig(), Vehicle::paper());
    let mut pipeline = LivePipeline::new(&rig, &vehicle, &[]).expect("a pipeline");
    let (mut counts, mut measured, mut kept_bytes) = (Vec::new(), 0, 0);
    for k in 0..WARM + COUNT {
        let stamp_ns = k * 16_666_667;
        let seen: Vec<_> = (0..2)
            .map(|c| detections((&rig, &vehicle), c, stamp_ns, &pose(stamp_ns as f64 * 1e-9)))
            .collect();
        let region = Region::new(COUNTED);
        for (camera, seen) in seen.iter().enumerate() {
            pipeline.push(camera, stamp_ns, seen);
        }
        while let Some(instant) = pipeline.next_instant() {
            measured += i64::from(instant.association.sample.estimate.is_ok());
        }
        let change = region.change();
        if k >= WARM {
            counts.push(change.allocations + change.reallocations);
            // What a reallocation adds or frees is counted in these already.
            kept_bytes += change.bytes_allocated as i64 - change.bytes_deallocated as i64;
        }
    }
    assert!(measured > WARM + COUNT - 20, "{measured} poses");
    counts.sort_unstable();
    let (median, most) = (counts[counts.len() / 2], counts[counts.len() - 1]);
    println!("{median} allocations an instant, {most} at most; {kept_bytes} bytes kept of {COUNT} instants");
    assert!(most <= 14, "{most} allocations an instant");
    assert!(kept_bytes.abs() < 4096, "{kept_bytes} bytes");
}
