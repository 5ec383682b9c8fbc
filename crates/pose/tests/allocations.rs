//! The loop over frames allocates only what it returns.

#[allow(dead_code)]
mod simulated;

use mavsight_pose::{CausalFilter, PoseEstimator, motion_noise};
use simulated::{Random, flight, observed, poses, rigs, square, true_cameras};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// A pose holds a list of markers and the systematic columns, which are formed in double precision first; the
/// whitened observations are a fourth. A frame whose residuals are suspect is tried without each marker,
/// which needs lists of the rest. The filter, once it has had a pose, needs nothing.
#[test]
fn a_frame_allocates_its_pose_and_its_observations() {
    let (_, rig) = rigs().into_iter().next().unwrap();
    let mut random = Random::new(3, 0);
    let states = flight(&mut random);
    let seen = observed(&true_cameras(&rig, &mut random), &square(), &states, &mut random);
    let estimator = PoseEstimator::new(&rig, &square()).with_centre_bias(0.05).unwrap();
    let measured = poses(&estimator, &states, &seen);
    let (mut frames, mut lean) = (0, 0);
    for (seen, known) in seen.iter().zip(&measured).filter(|(_, p)| p.estimate.is_ok()) {
        let region = Region::new(COUNTED);
        let pose = estimator.estimate(known.t_ns, seen, None);
        let change = region.change();
        assert!(pose.is_ok());
        frames += 1;
        lean += u32::from(change.allocations + change.reallocations <= 4);
    }
    assert!(frames == 180 && lean > 150, "{lean} of {frames}");
    let mut filter = CausalFilter::new(motion_noise(&measured).unwrap(), 9.8).unwrap();
    filter.push(&measured[0]).unwrap();
    let region = Region::new(COUNTED);
    for pose in &measured[1..] {
        filter.push(pose).unwrap();
    }
    assert_eq!(region.change().allocations, 0);
}
