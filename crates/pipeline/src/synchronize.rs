//! Cameras of any rate and clock, brought to common instants as their frames come.

use crate::stream::{Frames, Stream};
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_pose::{CameraClock, PixelPath, TrackedDetection};
use std::collections::{BTreeMap, VecDeque};

/// A camera whose frames are nearer together by this factor than those of all before it gives the instants.
const FASTER: f64 = 0.95;

/// Where the leading camera has no frame, another's is an instant if it is this part of its interval from
/// any other.
const APART_INTERVALS: f64 = 0.75;

/// A camera whose frames are further apart than the instants by this factor lends a detection to more than
/// one of them.
const SLOWER: f64 = 1.05;

/// Frames whose times differ by less are of one instant; the same as for a path's detections
/// ([`PixelPath::at`]).
const SAME_NS: i64 = 10_000;

/// How far beyond an instant a camera that is not in step must have seen before the instant is joined, in
/// frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lookahead {
    /// To its next frame: as little as shows which of its detections is the nearest, and between which it
    /// lies.
    NextFrame = 1,
    /// As far as its path's cubic reaches: three beyond the nearest detection, which may itself be beyond the
    /// instant.
    WholePath = 4,
}

/// What the join must know of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraTiming {
    /// Size of its images.
    pub size: ImageSize,
    /// Its clock.
    pub clock: CameraClock,
    /// Unit vector in the image along which a rolling shutter goes.
    pub readout: Vector2<f64>,
    /// Median time between its frames.
    pub interval_s: f64,
}

/// Brings what cameras see to common instants, frame by frame, for recordings and running cameras alike.
///
/// The instants are the frames of the camera with the most frames a second (of cameras of about one rate
/// the first), and where it has no frame those of the others. A camera's detection is moved to an instant
/// along its own path ([`PixelPath::at`]); a detection that a slow camera lends to several instants counts
/// for one in all. Cameras in step go through untouched, and without waiting. What is kept is what the
/// paths need: it does not grow.
#[derive(Debug)]
pub struct Synchronizer {
    cameras: Vec<Incoming>,
    /// Indices of the cameras, the one that gives the instants first.
    order: Vec<usize>,
    step_s: f64,
    ahead: Lookahead,
    /// Instants with the rank of the camera that gave each, in order of time: those to come, and before
    /// them the latest handed out.
    instants: VecDeque<(i64, usize)>,
    handed_ns: i64,
    seen: Vec<TrackedDetection>,
}

/// One camera.
#[derive(Debug)]
struct Incoming {
    about: CameraTiming,
    middle: Vector2<f64>,
    /// What was followed, by number.
    tracks: BTreeMap<u32, Track>,
    /// Times of its latest frames.
    frames_ns: VecDeque<i64>,
    /// Those of which it is not yet known whether they are instants.
    undecided_ns: VecDeque<i64>,
    /// Up to when nothing more of it is waited for, but for what has come.
    gone_ns: i64,
}

/// One track of a camera: its path, and the detection at each point of it.
#[derive(Debug)]
struct Track {
    path: PixelPath,
    detections: Vec<TrackedDetection>,
}

impl Synchronizer {
    /// A join of cameras, in the order of the rig.
    pub fn new(cameras: &[CameraTiming], ahead: Lookahead) -> Self {
        let interval_s = |k: usize| cameras[k].interval_s;
        let faster = |lead, k| if interval_s(k) < FASTER * interval_s(lead) { k } else { lead };
        let lead = (0..cameras.len()).reduce(faster).unwrap_or(0);
        let mut order: Vec<usize> = (0..cameras.len()).collect();
        if lead > 0 {
            order.swap(0, lead);
        }
        Self {
            step_s: cameras.get(lead).map_or(0.0, |c| c.interval_s),
            cameras: cameras.iter().map(Incoming::of).collect(),
            order,
            ahead,
            instants: VecDeque::new(),
            handed_ns: i64::MIN,
            seen: Vec::new(),
        }
    }

    /// Takes what a camera saw in its next frame. One that is not later than an instant handed out serves
    /// paths only, one that is not later than the camera's last is passed over.
    pub fn push(&mut self, camera: usize, stamp_ns: i64, seen: &[TrackedDetection]) {
        let Some(own) = self.cameras.get_mut(camera) else { return };
        let t_ns = own.about.clock.time_ns(stamp_ns);
        if own.frames_ns.back().is_some_and(|last| t_ns <= *last) {
            return;
        }
        own.push(stamp_ns, seen);
        own.frames_ns.push_back(t_ns);
        if t_ns > self.handed_ns {
            own.undecided_ns.push_back(t_ns);
        }
        self.decide();
    }

    /// No frame of a camera up to a time, by the common clock, is waited for any longer; i64::MAX: none at
    /// all. What comes of it later is taken again.
    pub fn go_without(&mut self, camera: usize, until_ns: i64) {
        if let Some(own) = self.cameras.get_mut(camera) {
            own.gone_ns = own.gone_ns.max(until_ns);
        }
        self.decide();
    }

    /// A camera is back for which was not waited: it is waited for again.
    pub fn wait_again(&mut self, camera: usize) {
        if let Some(own) = self.cameras.get_mut(camera) {
            own.gone_ns = own.frames_ns.back().copied().unwrap_or(i64::MIN);
        }
    }

    /// The instant that comes next, where it is known, whether it can be handed out or not.
    pub fn waiting_ns(&self) -> Option<i64> {
        self.instants.iter().map(|i| i.0).find(|t| *t > self.handed_ns)
    }

    /// Whether an instant waits for a camera.
    pub fn waits_for(&self, camera: usize, t_ns: i64) -> bool {
        self.cameras.get(camera).is_some_and(|c| !c.is_ready(t_ns, self.ahead))
    }

    /// The next instant for which all that it needs has come: its time, and what all cameras saw then, by
    /// camera and number.
    pub fn next_instant(&mut self) -> Option<(i64, &[TrackedDetection])> {
        let t_ns = self.waiting_ns()?;
        let earlier = |c: &Incoming| c.undecided_ns.front().is_some_and(|t| *t < t_ns);
        if self.cameras.iter().any(|c| earlier(c) || !c.is_ready(t_ns, self.ahead)) {
            return None;
        }
        self.handed_ns = t_ns;
        self.seen.clear();
        for (camera, own) in self.cameras.iter_mut().enumerate() {
            own.at(camera, t_ns, self.step_s, &mut self.seen);
        }
        let longest_s = self.cameras.iter().map(|c| c.about.interval_s).fold(0.0, f64::max);
        let kept_ns = t_ns.saturating_sub((longest_s * 1e9) as i64);
        while self.instants.front().is_some_and(|i| i.0 < kept_ns) {
            self.instants.pop_front();
        }
        Some((t_ns, &self.seen))
    }

    /// Decides which of the frames that came are instants.
    fn decide(&mut self) {
        for rank in 0..self.order.len() {
            let camera = self.order[rank];
            let apart_ns = (APART_INTERVALS * self.cameras[camera].about.interval_s * 1e9) as i64;
            while let Some(&t_ns) = self.cameras[camera].undecided_ns.front() {
                let near = |i: &(i64, usize)| i.1 < rank && (i.0 - t_ns).abs() < apart_ns;
                let is_free = !self.instants.iter().any(near);
                if is_free && t_ns > self.handed_ns {
                    let until_ns = t_ns.saturating_add(apart_ns);
                    if self.order[..rank].iter().any(|c| !self.cameras[*c].is_decided_until(until_ns)) {
                        break;
                    }
                    let at = self.instants.partition_point(|i| i.0 < t_ns);
                    // Of two frames at one time the first camera's is the instant.
                    if self.instants.get(at).is_none_or(|i| i.0 != t_ns) {
                        self.instants.insert(at, (t_ns, rank));
                    }
                }
                self.cameras[camera].undecided_ns.pop_front();
            }
        }
    }
}

impl Incoming {
    fn of(about: &CameraTiming) -> Self {
        Self {
            about: *about,
            middle: mavsight_pose::image_middle(about.size),
            tracks: BTreeMap::new(),
            frames_ns: VecDeque::new(),
            undecided_ns: VecDeque::new(),
            gone_ns: i64::MIN,
        }
    }

    /// Whether no instant up to a time can come of it any more.
    fn is_decided_until(&self, t_ns: i64) -> bool {
        let has_come = self.frames_ns.back().is_some_and(|last| *last >= t_ns) || self.gone_ns >= t_ns;
        has_come && self.undecided_ns.front().is_none_or(|t| *t > t_ns)
    }

    /// Whether all has come that an instant needs of it.
    fn is_ready(&self, t_ns: i64, ahead: Lookahead) -> bool {
        if self.gone_ns >= t_ns {
            return true;
        }
        let after = self.frames_ns.iter().rev().take_while(|f| **f > t_ns + SAME_NS).count();
        let is_in_step = self.about.clock.line_time_s == 0.0 || ahead == Lookahead::NextFrame;
        let has_own = || self.frames_ns.iter().rev().any(|f| (f - t_ns).abs() <= SAME_NS);
        after >= ahead as usize || (is_in_step && has_own())
    }

    /// Adds the detections of a frame to their paths.
    fn push(&mut self, stamp_ns: i64, seen: &[TrackedDetection]) {
        let CameraTiming { clock, readout, interval_s, .. } = self.about;
        for detection in seen {
            let rows_px = readout.dot(&(detection.pixel - self.middle));
            let t_s = clock.time_s(stamp_ns, rows_px);
            let new = || Track { path: PixelPath::new(interval_s), detections: Vec::new() };
            let track = self.tracks.entry(detection.track_id).or_insert_with(new);
            if track.path.push(t_s, detection.pixel, detection.covariance_px2) {
                track.detections.push(*detection);
            }
        }
    }

    /// Adds what the camera saw at a time, which must be after that of the call before, and forgets what no
    /// later time needs.
    fn at(&mut self, camera: usize, t_ns: i64, step_s: f64, seen: &mut Vec<TrackedDetection>) {
        let lent = if step_s > 0.0 { self.about.interval_s / step_s } else { 1.0 };
        let t_s = t_ns as f64 * 1e-9;
        self.tracks.retain(|_, track| {
            if let Some(at) = track.path.at(t_s) {
                let covariance_px2 = if lent > SLOWER { at.covariance_px2 * lent } else { at.covariance_px2 };
                let nearest = track.detections[at.index];
                seen.push(TrackedDetection { t_ns, camera, pixel: at.pixel, covariance_px2, ..nearest });
            }
            let gone = track.path.forget_before(t_s);
            track.detections.drain(..gone);
            !track.path.is_empty()
        });
        while self.frames_ns.len() > 1 && self.frames_ns[0] < t_ns - SAME_NS {
            self.frames_ns.pop_front();
        }
    }
}

/// Hands what all cameras saw at each instant of a recorded flight to `each`, and lets go of it frame by
/// frame.
pub(crate) fn instants(
    streams: Vec<Stream>,
    sizes: &[ImageSize],
    clocks: &[CameraClock],
    mut each: impl FnMut(i64, &[TrackedDetection]),
) {
    let timing = |(stream, (size, clock)): (&Stream, (&ImageSize, &CameraClock))| CameraTiming {
        size: *size,
        clock: *clock,
        readout: stream.readout,
        interval_s: stream.interval_s(),
    };
    let cameras: Vec<CameraTiming> = streams.iter().zip(sizes.iter().zip(clocks)).map(timing).collect();
    let mut synchronizer = Synchronizer::new(&cameras, Lookahead::WholePath);
    let mut frames: Vec<_> = streams.into_iter().map(Stream::into_frames).collect();
    let next = |frames: &[Frames]| {
        let times = frames.iter().enumerate().filter_map(|(k, f)| Some((clocks[k].time_ns(f.peek()?), k)));
        times.min().map(|(_, k)| k)
    };
    while let Some(camera) = next(&frames) {
        if let Some((stamp_ns, detections)) = frames[camera].next() {
            synchronizer.push(camera, stamp_ns, detections);
        }
        if frames[camera].peek().is_none() {
            synchronizer.go_without(camera, i64::MAX);
        }
        while let Some((t_ns, seen)) = synchronizer.next_instant() {
            each(t_ns, seen);
        }
    }
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
    fn joined(streams: &[Stream], clocks: &[CameraClock]) -> Vec<(i64, Vec<TrackedDetection>)> {
        let mut out = Vec::new();
        let sizes = vec![SIZE; streams.len()];
        instants(streams.to_vec(), &sizes, clocks, |t_ns, seen| out.push((t_ns, seen.to_vec())));
        out
    }

    /// Root mean square of where markers are seen against where they are, in standard deviations claimed.
    fn misfit(instants: &[(i64, Vec<TrackedDetection>)]) -> f64 {
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
            let own = [0, 1].map(|c| &streams[c].detections[4 * k..4 * k + 4]);
            for (o, s) in instant.1.iter().zip(own.into_iter().flatten().map(|s| s.detection(0, 0))) {
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

    /// As they come, with as little ahead as live has: in step the same, bit for bit; out of step nearly as
    /// exact.
    #[test]
    fn frames_that_come_one_by_one_are_joined_alike() {
        let live = |streams: &[Stream], clocks: &[CameraClock]| {
            let about = |k: usize| CameraTiming {
                size: SIZE,
                clock: clocks[k],
                readout: streams[k].readout,
                interval_s: 1.0 / 30.0,
            };
            let mut synchronizer = Synchronizer::new(&[about(0), about(1)], Lookahead::NextFrame);
            let mut frames: Vec<_> = streams.iter().map(|s| s.clone().into_frames()).collect();
            let mut out = Vec::new();
            for _ in 0..streams[1].stamps_ns.len() {
                for (camera, own) in frames.iter_mut().enumerate() {
                    if let Some((stamp_ns, detections)) = own.next() {
                        synchronizer.push(camera, stamp_ns, detections);
                    }
                    while let Some((t_ns, seen)) = synchronizer.next_instant() {
                        out.push((t_ns, seen.to_vec()));
                    }
                }
            }
            let kept =
                synchronizer.cameras.iter().flat_map(|c| c.tracks.values()).map(|t| t.detections.len()).max();
            assert!(kept.unwrap() <= 9 && synchronizer.cameras.iter().all(|c| c.tracks.len() == 4));
            assert!(synchronizer.instants.len() <= 4);
            out
        };
        let exact = late(0.0);
        let streams = [stream(0, exact, 30.0, 0..60), stream(1, exact, 30.0, 0..60)];
        assert_eq!(live(&streams, &[exact, exact]), joined(&streams, &[exact, exact]));
        let streams = [stream(0, exact, 30.0, 0..90), stream(1, late(13.7e-3), 30.0, 0..90)];
        let got = live(&streams, &[exact, late(13.7e-3)]);
        assert!((0.9..1.2).contains(&misfit(&got)) && got.len() >= 88, "{}", misfit(&got));
        assert!(got.iter().filter(|i| i.1.len() == 8).count() >= 85);
    }

    #[test]
    fn a_camera_that_is_not_waited_for_is_left_out_and_taken_again() {
        let exact = late(0.0);
        let streams = [stream(0, exact, 30.0, 0..40), stream(1, exact, 30.0, 0..40)];
        let about = CameraTiming { size: SIZE, clock: exact, readout: Vector2::y(), interval_s: 1.0 / 30.0 };
        let mut synchronizer = Synchronizer::new(&[about, about], Lookahead::NextFrame);
        let mut counts = Vec::new();
        let [mut first, mut second] = streams.clone().map(Stream::into_frames);
        for k in 0..40 {
            let (a, b) = (first.next().unwrap(), second.next().unwrap());
            synchronizer.push(0, a.0, a.1);
            if (10..20).contains(&k) {
                assert_eq!(synchronizer.next_instant().map(|i| i.0), None);
                assert!(synchronizer.waits_for(1, a.0) && synchronizer.waiting_ns() == Some(a.0));
                synchronizer.go_without(1, a.0);
            } else {
                synchronizer.push(1, b.0, b.1);
            }
            let got = synchronizer.next_instant().expect("an instant");
            assert_eq!(got.0, a.0);
            counts.push(got.1.len());
        }
        assert!(counts.iter().enumerate().all(|(k, n)| *n == if (10..20).contains(&k) { 4 } else { 8 }));
        // The leading camera may be the one that is gone; the other's frames are then the instants.
        let mut synchronizer = Synchronizer::new(&[about, about], Lookahead::NextFrame);
        synchronizer.go_without(0, i64::MAX);
        let mut frames = streams[1].clone().into_frames();
        while let Some(b) = frames.next() {
            synchronizer.push(1, b.0, b.1);
            assert_eq!(synchronizer.next_instant().map(|i| (i.0, i.1.len())), Some((b.0, 4)));
        }
        synchronizer.wait_again(0);
        synchronizer.push(1, 2_000_000_000, &[]);
        assert!(synchronizer.next_instant().is_none());
    }

    #[test]
    fn where_the_first_camera_has_a_gap_the_others_give_the_instants() {
        let exact = late(0.0);
        let mut gappy = stream(0, exact, 30.0, 0..0);
        let mut whole = stream(0, exact, 30.0, 0..60).into_frames();
        while let Some((stamp_ns, seen)) = whole.next() {
            if !(700_000_000..900_000_000).contains(&stamp_ns) {
                gappy.add(stamp_ns, seen, None);
            }
        }
        let streams = [gappy, stream(1, exact, 30.0, 0..60)];
        let got = joined(&streams, &[exact, exact]);
        assert_eq!(got.len(), 60);
        let alone: Vec<usize> = (0..60).filter(|k| got[*k].1.len() == 4).collect();
        assert_eq!(alone, [21, 22, 23, 24, 25, 26]);
    }
}
