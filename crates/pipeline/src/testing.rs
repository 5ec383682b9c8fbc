//! What several tests share: two cameras, and what they see of a body that is carried about.

use crate::body_markers;
use crate::stream::{StoredDetection, Stream};
use carried::{SMALL, TWO, rig_at, seen_by as seen_at_once};
use mavsight_flight::Vehicle;
use mavsight_geometry::{ImageSize, Matrix2, Vector2};
use mavsight_pose::{CameraClock, ClockPrior, MarkerObservation, Rig, TrackedDetection};

#[path = "../tests/carried/mod.rs"]
pub(crate) mod carried;

pub(crate) use carried::pose;

pub(crate) const SIZE: ImageSize = SMALL;

/// Standard deviation of the centres.
pub(crate) const STD_PX: f64 = 0.03;

/// Three cameras, all of them good to a few thousandths of a pixel.
pub(crate) fn rig() -> Rig {
    rig_of_first(3)
}

/// The first cameras of [`rig`].
pub(crate) fn rig_of_first(cameras: usize) -> Rig {
    rig_at(&[TWO[0], [-4.5, -4.5, 2.0], [0.3, 5.5, 2.5]][..cameras], SIZE, 1e-5f64.sqrt())
}

/// What one camera of the rig sees over a time, `frames` of them at a rate, with a clock of its own.
pub(crate) fn stream(
    camera: usize,
    clock: CameraClock,
    rate_hz: f64,
    frames: std::ops::Range<usize>,
) -> Stream {
    let rig = rig();
    let body = body_markers(&Vehicle::paper());
    let mut out = Stream::new(
        camera,
        rig.cameras[camera].name.clone(),
        ClockPrior::known(CameraClock::default()),
        Vector2::y(),
    );
    let mut random = mavsight_random::Random::new(7, camera as u64);
    for k in frames {
        let stamp_ns = (k as f64 / rate_hz * 1e9).round() as i64;
        let at = pose(clock.time_s(stamp_ns, 0.0));
        let track = |o: MarkerObservation| TrackedDetection {
            t_ns: stamp_ns,
            camera,
            track_id: o.marker as u32,
            color: o.marker,
            pixel: o.pixel,
            covariance_px2: o.covariance_px2,
            diameter_px: 6.0,
            is_static: false,
            is_preferred: true,
        };
        let observed = seen_at_once((&rig, camera), (&body, &at), stamp_ns, (STD_PX, &mut random));
        let seen: Vec<TrackedDetection> = observed.into_iter().map(track).collect();
        out.add(stamp_ns, &seen, None);
    }
    out
}

/// A camera of which some frames, by their numbers, did not arrive.
pub(crate) fn with_frames(whole: &Stream, camera: usize, kept: impl Fn(usize) -> bool) -> Stream {
    let mut out = Stream::new(camera, whole.name.clone(), whole.clock, whole.readout);
    for (_, stamp_ns) in whole.stamps_ns.iter().enumerate().filter(|(k, _)| kept(*k)) {
        let seen: Vec<_> = whole.detections().filter(|d| d.t_ns == *stamp_ns).collect();
        out.add(*stamp_ns, &seen, None);
    }
    out
}

/// A camera that did not find some balls, by the numbers of the frame and of the ball.
pub(crate) fn without_balls(whole: &Stream, camera: usize, is_lost: impl Fn(usize, usize) -> bool) -> Stream {
    let mut out = Stream::new(camera, whole.name.clone(), whole.clock, whole.readout);
    for (k, stamp_ns) in whole.stamps_ns.iter().enumerate() {
        let seen: Vec<_> =
            whole.detections().filter(|d| d.t_ns == *stamp_ns && !is_lost(k, d.color)).collect();
        out.add(*stamp_ns, &seen, None);
    }
    out
}

/// The same of a camera without a clock of its own, with its balls identified.
pub(crate) fn seen_by(camera: usize, frames: std::ops::Range<usize>) -> Vec<MarkerObservation> {
    let stream = stream(camera, CameraClock::default(), 30.0, frames);
    let markers = Vehicle::paper().marker.len();
    let identified = |(k, s): (usize, &StoredDetection)| MarkerObservation {
        t_ns: stream.stamps_ns[k / markers],
        camera,
        marker: k % markers,
        pixel: s.pixel,
        covariance_px2: Matrix2::identity() * STD_PX * STD_PX,
    };
    stream.detections.iter().enumerate().map(identified).collect()
}
