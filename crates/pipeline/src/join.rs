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
    let cameras: Vec<Joined> =
        streams.iter().enumerate().map(|(k, s)| Joined::of(s, sizes[k], &clocks[k], markers)).collect();
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
            let covariance_px2 = if lent > SLOWER { at.covariance_px2 * lent } else { at.covariance_px2 };
            out.observations.push(MarkerObservation {
                t_ns,
                camera,
                marker,
                pixel: at.pixel,
                covariance_px2,
            });
            out.diameters_px.push(seen.diameters_px[marker][at.sight]);
        }
    }
    out
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{SIZE, pose, rig, stream};
    use mavsight_flight::Vehicle;
    use mavsight_geometry::{Point3, Vector3};

    fn late(offset_s: f64) -> CameraClock {
        CameraClock { offset_s, ..CameraClock::default() }
    }

    fn joined(streams: &[Stream], clocks: &[CameraClock]) -> Vec<Instant> {
        instants(streams, &vec![SIZE; streams.len()], clocks, 4)
    }

    /// Root mean square of where markers are seen against where they are, in standard deviations claimed.
    fn misfit(instants: &[Instant]) -> f64 {
        let (rig, vehicle) = (rig(), Vehicle::paper());
        let (mut sum, mut count) = (0.0, 0.0);
        for o in instants.iter().flat_map(|i| &i.observations) {
            let ball = &vehicle.marker[o.marker];
            let centre = (pose(o.t_ns as f64 * 1e-9) * Point3::from(Vector3::from(ball.position_m))).coords;
            let true_px =
                rig.cameras[o.camera].camera.project_ball(&centre, ball.diameter_m / 2.0).unwrap().pixel;
            sum += (o.pixel - true_px).norm_squared() / o.covariance_px2.trace();
            count += 1.0;
        }
        f64::sqrt(sum / count)
    }

    #[test]
    fn cameras_in_step_go_through_as_they_are() {
        let exact = late(0.0);
        let streams = [stream(0, exact, 30.0, 0..60), stream(1, exact, 30.0, 0..60)];
        let got = joined(&streams, &[exact, exact]);
        assert_eq!(got.len(), 60);
        for (k, instant) in got.iter().enumerate() {
            assert_eq!(instant.t_ns, streams[0].stamps_ns[k]);
            let own = [0, 1].map(|c| &streams[c].sights[4 * k..4 * k + 4]);
            for (o, s) in instant.observations.iter().zip(own.into_iter().flatten()) {
                assert!(o.pixel == s.pixel && o.covariance_px2 == s.covariance_px2 && o.marker == s.marker);
            }
            assert_eq!((instant.observations.len(), instant.diameters_px.len()), (8, 8));
        }
    }

    #[test]
    fn a_late_camera_is_brought_to_the_instants_with_a_true_covariance() {
        for offset_s in [13.7e-3, -9e-3, 0.4] {
            let streams = [stream(0, late(0.0), 30.0, 0..90), stream(1, late(offset_s), 30.0, 0..100)];
            let got = joined(&streams, &[late(0.0), late(offset_s)]);
            assert!((0.9..1.15).contains(&misfit(&got)), "{offset_s}: {}", misfit(&got));
            let both = got.iter().filter(|i| i.observations.len() == 8).count();
            assert!(both >= 75, "{offset_s}: {both}");
            // Taken as in step it would be far off.
            assert!(misfit(&joined(&streams, &[late(0.0), late(0.0)])) > 5.0);
        }
    }

    #[test]
    fn the_fastest_camera_leads_and_a_slow_one_lends_without_counting_twice() {
        let exact = late(0.0);
        let streams = [stream(0, exact, 25.0, 0..50), stream(1, exact, 50.0, 0..100)];
        let got = joined(&streams, &[exact, exact]);
        assert_eq!(got.len(), 100);
        let of = |k: usize, camera: usize| got[k].observations.iter().find(|o| o.camera == camera).unwrap();
        assert!((of(20, 0).covariance_px2.trace() / of(20, 1).covariance_px2.trace() - 2.0).abs() < 0.01);
        assert!(misfit(&got) < 1.1);
    }

    #[test]
    fn where_the_first_camera_has_a_gap_the_others_give_the_instants() {
        let exact = late(0.0);
        let whole = stream(0, exact, 30.0, 0..60);
        let mut gappy = whole;
        gappy.stamps_ns.retain(|t| !(700_000_000..900_000_000).contains(t));
        let mut k = 0;
        gappy.sights.retain(|s| !(700_000_000..900_000_000).contains(&s.stamp_ns));
        gappy.diameters_px.retain(|_| {
            k += 1;
            k <= 4 * 54
        });
        let streams = [gappy, stream(1, exact, 30.0, 0..60)];
        let got = joined(&streams, &[exact, exact]);
        assert_eq!(got.len(), 60);
        let alone: Vec<usize> = (0..60).filter(|k| got[*k].observations.len() == 4).collect();
        assert_eq!(alone, [21, 22, 23, 24, 25, 26]);
    }
}
