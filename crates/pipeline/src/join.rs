//! Cameras of any rate and clock, brought to common instants.

use crate::stream::Stream;
use mavsight_geometry::ImageSize;
use mavsight_pose::{CameraClock, Candidate, PixelPath};
use std::collections::HashMap;

/// A camera whose frames are nearer together by this factor than those of all before it gives the instants.
const FASTER: f64 = 0.95;

/// Where the leading camera has no frame, another's is an instant if it is this part of its interval from any other.
const APART_INTERVALS: f64 = 0.75;

/// A camera whose frames are further apart than the instants by this factor lends a sight to more than one of them.
const SLOWER: f64 = 1.05;

/// One camera for the join.
struct Joined {
    /// What was followed, by when it came into sight.
    things: Vec<Thing>,
    /// How many of those have come so far, and which of them have not yet gone.
    come: usize,
    here: Vec<usize>,
    times_ns: Vec<i64>,
    interval_s: f64,
}

/// One thing that a camera followed: its path, and what goes with each sight of it.
struct Thing {
    color: usize,
    path: PixelPath,
    from_s: f64,
    to_s: f64,
    diameters_px: Vec<f64>,
    stays: Vec<bool>,
}

/// Hands what all cameras saw at each instant of a flight to `each`. The instants are those of the camera with the most frames a
/// second (of cameras of about one rate the first), and where it has no frames those of the others. A camera's sight is moved to
/// an instant along its own path ([`PixelPath::at`]); a sight that a slow camera lends to several instants counts for one in all.
pub(crate) fn instants(
    streams: Vec<Stream>,
    sizes: &[ImageSize],
    clocks: &[CameraClock],
    mut each: impl FnMut(i64, &[Candidate]),
) {
    let mut cameras: Vec<Joined> =
        streams.into_iter().enumerate().map(|(k, s)| Joined::of(&s, sizes[k], &clocks[k])).collect();
    let times_ns = times(&cameras);
    let steps: Vec<f64> = times_ns.windows(2).map(|w| (w[1] - w[0]) as f64 * 1e-9).collect();
    let step_s = median(steps).unwrap_or(0.0);
    let mut seen = Vec::new();
    for t_ns in times_ns {
        seen.clear();
        for (camera, joined) in cameras.iter_mut().enumerate() {
            joined.at(camera, t_ns as f64 * 1e-9, step_s, &mut seen);
        }
        each(t_ns, &seen);
    }
}

impl Joined {
    fn of(stream: &Stream, size: ImageSize, clock: &CameraClock) -> Self {
        let interval_s = stream.interval_s();
        let mut things: Vec<Thing> = Vec::new();
        let mut of_id: HashMap<u32, usize> = HashMap::new();
        let middle = mavsight_pose::image_middle(size);
        for sight in &stream.sights {
            let rows_px = stream.readout.dot(&(sight.pixel - middle));
            let t_s = clock.time_s(sight.stamp_ns, rows_px);
            let index = *of_id.entry(sight.id).or_insert_with(|| {
                things.push(Thing::new(sight.color, interval_s, t_s));
                things.len() - 1
            });
            let thing = &mut things[index];
            if thing.path.push(t_s, sight.pixel, sight.covariance_px2) {
                thing.to_s = t_s;
                thing.diameters_px.push(sight.diameter_px);
                thing.stays.push(sight.stays);
            }
        }
        things.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        let times_ns = stream.stamps_ns.iter().map(|t| clock.time_ns(*t)).collect();
        Self { things, come: 0, here: Vec::new(), times_ns, interval_s }
    }

    /// Adds what the camera saw at a time, which must not be before that of the call before.
    fn at(&mut self, camera: usize, t_s: f64, step_s: f64, seen: &mut Vec<Candidate>) {
        let lent = if step_s > 0.0 { self.interval_s / step_s } else { 1.0 };
        // A path lends its ends to instants that are no more than its interval off.
        let reach_s = 2.0 * self.interval_s;
        while self.things.get(self.come).is_some_and(|t| t.from_s <= t_s + reach_s) {
            self.here.push(self.come);
            self.come += 1;
        }
        self.here.retain(|k| self.things[*k].to_s >= t_s - reach_s);
        for thing in self.here.iter().map(|k| &self.things[*k]) {
            let Some(at) = thing.path.at(t_s) else { continue };
            let covariance_px2 = if lent > SLOWER { at.covariance_px2 * lent } else { at.covariance_px2 };
            seen.push(Candidate {
                camera,
                color: thing.color,
                pixel: at.pixel,
                covariance_px2,
                diameter_px: thing.diameters_px[at.sight],
                stays: thing.stays[at.sight],
            });
        }
    }
}

impl Thing {
    fn new(color: usize, interval_s: f64, from_s: f64) -> Self {
        let path = PixelPath::new(interval_s);
        Self { color, path, from_s, to_s: from_s, diameters_px: Vec::new(), stays: Vec::new() }
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

    /// Each instant's time and what was seen then.
    fn joined(streams: &[Stream], clocks: &[CameraClock]) -> Vec<(i64, Vec<Candidate>)> {
        let mut out = Vec::new();
        let sizes = vec![SIZE; streams.len()];
        instants(streams.to_vec(), &sizes, clocks, |t_ns, seen| out.push((t_ns, seen.to_vec())));
        out
    }

    /// Root mean square of where markers are seen against where they are, in standard deviations claimed.
    fn misfit(instants: &[(i64, Vec<Candidate>)]) -> f64 {
        let (rig, vehicle) = (rig(), Vehicle::paper());
        let (mut sum, mut count) = (0.0, 0.0);
        for (t_ns, o) in instants.iter().flat_map(|(t, seen)| seen.iter().map(move |o| (*t, o))) {
            let ball = &vehicle.marker[o.color];
            let centre = (pose(t_ns as f64 * 1e-9) * Point3::from(Vector3::from(ball.position_m))).coords;
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
            assert_eq!(instant.0, streams[0].stamps_ns[k]);
            let own = [0, 1].map(|c| &streams[c].sights[4 * k..4 * k + 4]);
            for (o, s) in instant.1.iter().zip(own.into_iter().flatten()) {
                assert!(o.pixel == s.pixel && o.covariance_px2 == s.covariance_px2 && o.color == s.color);
            }
            assert_eq!(instant.1.len(), 8);
        }
    }

    #[test]
    fn a_late_camera_is_brought_to_the_instants_with_a_true_covariance() {
        for offset_s in [13.7e-3, -9e-3, 0.4] {
            let streams = [stream(0, late(0.0), 30.0, 0..90), stream(1, late(offset_s), 30.0, 0..100)];
            let got = joined(&streams, &[late(0.0), late(offset_s)]);
            assert!((0.9..1.15).contains(&misfit(&got)), "{offset_s}: {}", misfit(&got));
            let both = got.iter().filter(|i| i.1.len() == 8).count();
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
        let of = |k: usize, camera: usize| got[k].1.iter().find(|o| o.camera == camera).unwrap();
        assert!((of(20, 0).covariance_px2.trace() / of(20, 1).covariance_px2.trace() - 2.0).abs() < 0.01);
        assert!(misfit(&got) < 1.1);
    }

    #[test]
    fn where_the_first_camera_has_a_gap_the_others_give_the_instants() {
        let exact = late(0.0);
        let whole = stream(0, exact, 30.0, 0..60);
        let mut gappy = whole;
        gappy.stamps_ns.retain(|t| !(700_000_000..900_000_000).contains(t));
        gappy.sights.retain(|s| !(700_000_000..900_000_000).contains(&s.stamp_ns));
        let streams = [gappy, stream(1, exact, 30.0, 0..60)];
        let got = joined(&streams, &[exact, exact]);
        assert_eq!(got.len(), 60);
        let alone: Vec<usize> = (0..60).filter(|k| got[*k].1.len() == 4).collect();
        assert_eq!(alone, [21, 22, 23, 24, 25, 26]);
    }
}
