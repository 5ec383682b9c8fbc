//! Cameras of any rate and clock, brought to common instants.

use crate::stream::Stream;
use mavsight_geometry::ImageSize;
use mavsight_pose::{CameraClock, MarkerObservation, PixelPath};

/// A camera whose frames are nearer together by this factor than those of all before it gives the instants.
const FASTER: f64 = 0.95;

/// Where the leading camera has no frame, another's is an instant if it is this part of its interval from any other.
const APART_INTERVALS: f64 = 0.75;

/// A camera whose frames are further apart than the instants by this factor lends a sight to more than one of them.
const SLOWER: f64 = 1.05;

/// What all cameras saw at one instant.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Instant {
    pub(crate) t_ns: i64,
    pub(crate) observations: Vec<MarkerObservation>,
    pub(crate) diameters_px: Vec<f64>,
}

/// One camera for the join.
struct Joined {
    paths: Vec<PixelPath>,
    diameters_px: Vec<Vec<f64>>,
    times_ns: Vec<i64>,
    interval_s: f64,
}

/// The instants of a flight: those of the camera with the most frames a second (of cameras of about one rate the first), and where
/// it has no frames those of the others. A camera's sight is moved to an instant along its own path ([`PixelPath::at`]); a sight
/// that a slow camera lends to several instants counts for one in all.
pub(crate) fn instants(
    streams: &[Stream],
    sizes: &[ImageSize],
    clocks: &[CameraClock],
    markers: usize,
) -> Vec<Instant> {
    let cameras: Vec<Joined> = streams
        .iter()
        .enumerate()
        .map(|(k, s)| Joined::of(s, sizes[k], &clocks[k], markers))
        .collect();
    let times_ns = times(&cameras);
    let steps: Vec<f64> = times_ns.windows(2).map(|w| (w[1] - w[0]) as f64 * 1e-9).collect();
    let step_s = median(steps).unwrap_or(0.0);
    times_ns.into_iter().map(|t_ns| instant(&cameras, t_ns, step_s)).collect()
}

impl Joined {
    fn of(stream: &Stream, size: ImageSize, clock: &CameraClock, markers: usize) -> Self {
        let interval_s = stream.interval_s();
        let mut paths = vec![PixelPath::new(interval_s); markers];
        let mut diameters_px = vec![Vec::new(); markers];
        let middle = mavsight_pose::image_middle(size);
        for (sight, diameter_px) in stream.sights.iter().zip(&stream.diameters_px) {
            let rows_px = stream.readout.dot(&(sight.pixel - middle));
            let t_s = clock.time_s(sight.stamp_ns, rows_px);
            if paths[sight.marker].push(t_s, sight.pixel, sight.covariance_px2) {
                diameters_px[sight.marker].push(*diameter_px);
            }
        }
        let times_ns = stream.stamps_ns.iter().map(|t| clock.time_ns(*t)).collect();
        Self { paths, diameters_px, times_ns, interval_s }
    }
}

fn times(cameras: &[Joined]) -> Vec<i64> {
    let mut order: Vec<usize> = (0..cameras.len()).collect();
    let mut lead = 0;
    for k in 1..cameras.len() {
        if cameras[k].interval_s < FASTER * cameras[lead].interval_s {
            lead = k;
        }
    }
    order.swap(0, lead);
    let mut times_ns: Vec<i64> = Vec::new();
    for k in order {
        let apart_ns = (APART_INTERVALS * cameras[k].interval_s * 1e9) as i64;
        let free = |t: &i64| {
            let after = times_ns.partition_point(|other| other < t);
            let far = |other: Option<&i64>| other.is_none_or(|o| (o - t).abs() >= apart_ns);
            far(times_ns.get(after)) && far(after.checked_sub(1).and_then(|k| times_ns.get(k)))
        };
        let more: Vec<i64> = cameras[k].times_ns.iter().copied().filter(free).collect();
        times_ns.extend(more);
        times_ns.sort_unstable();
    }
    times_ns
}

fn instant(cameras: &[Joined], t_ns: i64, step_s: f64) -> Instant {
    let mut out = Instant { t_ns, observations: Vec::new(), diameters_px: Vec::new() };
    for (camera, seen) in cameras.iter().enumerate() {
        let lent = if step_s > 0.0 { seen.interval_s / step_s } else { 1.0 };
        for (marker, path) in seen.paths.iter().enumerate() {
            let Some(at) = path.at(t_ns as f64 * 1e-9) else { continue };
            let covariance_px2 =
                if lent > SLOWER { at.covariance_px2 * lent } else { at.covariance_px2 };
            out.observations.push(MarkerObservation { t_ns, camera, marker, pixel: at.pixel, covariance_px2 });
            out.diameters_px.push(seen.diameters_px[marker][at.sight]);
        }
    }
    out
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
