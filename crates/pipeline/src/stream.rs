//! What one camera saw, by its own clock, and what was wrong with its frames.

use crate::PipelineError;
use crate::feed::{Clap, usual_interval_ns};
use crate::markers::MarkerColors;
use mavsight_geometry::{Matrix2, Vector2};
use mavsight_pose::{CameraStream, ClockPrior, GAP_INTERVALS, TrackedDetection, informative_stretches_ns};

mod checked;
mod frozen;
mod gaps;
mod order;
mod standing;

pub(crate) use frozen::leave_out_still;

/// Interval of a camera whose rate is unknown: thirty frames a second.
pub const PRESUMED_INTERVAL_S: f64 = 1.0 / 30.0;

/// Faults that are noted one by one; of more, the number.
const MOST_NOTED: usize = 3;

/// A detection without its time and camera, in half as many bytes: pixels exact, the rest to seven digits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StoredDetection {
    pub(crate) pixel: Vector2<f64>,
    /// uu, uv, vv.
    covariance_px2: [f32; 3],
    diameter_px: f32,
    track_id: u32,
    color: u16,
    is_static: bool,
    is_preferred: bool,
}

impl StoredDetection {
    fn of(s: &TrackedDetection) -> Self {
        let c = &s.covariance_px2;
        Self {
            pixel: s.pixel,
            covariance_px2: [c[(0, 0)], c[(0, 1)], c[(1, 1)]].map(|v| v as f32),
            diameter_px: s.diameter_px as f32,
            track_id: s.track_id,
            color: u16::try_from(s.color).unwrap_or(u16::MAX),
            is_static: s.is_static,
            is_preferred: s.is_preferred,
        }
    }

    pub(crate) fn color(&self) -> usize {
        self.color.into()
    }

    /// Variance of a coordinate, in the mean of both.
    pub(crate) fn variance_px2(&self) -> f64 {
        0.5 * f64::from(self.covariance_px2[0] + self.covariance_px2[2])
    }

    /// The detection in a frame of a camera.
    pub(crate) fn detection(&self, camera: usize, t_ns: i64) -> TrackedDetection {
        let [uu, uv, vv] = self.covariance_px2.map(f64::from);
        TrackedDetection {
            t_ns,
            camera,
            track_id: self.track_id,
            color: self.color.into(),
            pixel: self.pixel,
            covariance_px2: Matrix2::new(uu, uv, uv, vv),
            diameter_px: self.diameter_px.into(),
            is_static: self.is_static,
            is_preferred: self.is_preferred,
        }
    }
}

/// Room of so many detections is given back at a time.
const GIVEN_BACK: usize = 1 << 15;

/// A camera's frames, of which each is let go when the next is asked for.
pub(crate) struct Frames {
    /// With its detections in reverse.
    stream: Stream,
    at: usize,
    seen: Vec<TrackedDetection>,
}

impl Frames {
    /// Time stamp of the next frame.
    pub(crate) fn peek(&self) -> Option<i64> {
        self.stream.stamps_ns.get(self.at).copied()
    }

    /// The next frame.
    pub(crate) fn next(&mut self) -> Option<(i64, &[TrackedDetection])> {
        let stamp_ns = self.peek()?;
        let stored = &mut self.stream.detections;
        let rest = stored.len().saturating_sub(self.stream.counts[self.at].into());
        self.seen.clear();
        self.seen.extend(stored.drain(rest..).rev().map(|s| s.detection(self.stream.camera, stamp_ns)));
        if stored.capacity() > rest + GIVEN_BACK {
            stored.shrink_to_fit();
        }
        self.at += 1;
        Some((stamp_ns, &self.seen))
    }
}

/// A camera's detections.
#[cfg_attr(test, derive(Clone))]
pub(crate) struct Stream {
    camera: usize,
    pub(crate) name: String,
    /// Time stamps of the frames that were looked at, rising.
    pub(crate) stamps_ns: Vec<i64>,
    /// How many detections there were in each.
    counts: Vec<u16>,
    /// Those, in order of time.
    pub(crate) detections: Vec<StoredDetection>,
    pub(crate) clock: ClockPrior,
    pub(crate) readout: Vector2<f64>,
    /// Mean brightness of the frames, where a flash is looked for.
    pub(crate) brightness: Option<Vec<f32>>,
    /// The clap in its sound, where one is listened for.
    pub(crate) clap: Option<Clap>,
    /// Whether the encoder may have predicted frames from those before and after them.
    pub(crate) may_be_reordered: bool,
    faults: Faults,
}

/// What was wrong with the frames.
#[derive(Default)]
#[cfg_attr(test, derive(Clone))]
struct Faults {
    /// Stamps of frames that repeat the one before.
    copies_ns: Vec<i64>,
    /// Stamps of frames that are not later than the one before.
    backward_ns: Vec<i64>,
    /// What the source said, and the stamp of the frame before it.
    broken: Vec<(i64, String)>,
    /// Detections that are no measurement, and the first one's stamp.
    spoilt: Option<(usize, i64)>,
}

impl Stream {
    pub(crate) fn new(camera: usize, name: String, clock: ClockPrior, readout: Vector2<f64>) -> Self {
        Self {
            camera,
            name,
            stamps_ns: Vec::new(),
            counts: Vec::new(),
            detections: Vec::new(),
            clock,
            readout,
            brightness: None,
            clap: None,
            may_be_reordered: false,
            faults: Faults::default(),
        }
    }

    /// Starts the estimation of this clock from what the first camera and this one noticed together, at
    /// their own times: what it was, where it is more precise than what is known. None where it is not.
    pub(crate) fn start_clock(
        &mut self,
        first: &Self,
        what: &str,
        here_s: f64,
        there_s: f64,
        std_s: f64,
    ) -> Option<String> {
        if std_s >= self.clock.offset_std_s {
            return None;
        }
        let offset_s = there_s - first.clock.clock.time_s((here_s * 1e9).round() as i64, 0.0);
        (self.clock.clock.offset_s, self.clock.offset_std_s) = (offset_s, std_s);
        Some(format!(
            "The {what}, in {} at {here_s:.3} s, puts {} {:.1} ± {:.1} ms late: the estimation starts from there.",
            first.name,
            self.name,
            1e3 * offset_s,
            1e3 * std_s
        ))
    }

    /// Whether a frame with a stamp not after those before it came so many intervals before a frame, to within a part of one.
    pub(crate) fn has_backward(&self, frame: usize, intervals: usize, within: f64) -> bool {
        let interval_ns = self.interval_s() * 1e9;
        let (Some(at_ns), Some(before_ns)) =
            (self.stamps_ns.get(frame), frame.checked_sub(1).and_then(|k| self.stamps_ns.get(k)))
        else {
            return false;
        };
        let expected_ns = *at_ns as f64 - intervals as f64 * interval_ns;
        let is_there = |t: &i64| *t <= *before_ns && (*t as f64 - expected_ns).abs() < within * interval_ns;
        self.faults.backward_ns.iter().any(is_there)
    }

    /// Leaves out all frames from one on.
    pub(crate) fn end_before(&mut self, frame: usize) {
        let kept: usize = self.counts.iter().take(frame).map(|n| usize::from(*n)).sum();
        self.stamps_ns.truncate(frame);
        self.counts.truncate(frame);
        self.detections.truncate(kept);
        self.brightness.iter_mut().for_each(|all| all.truncate(frame));
    }

    /// Moves the time stamps from a frame on, which keeps them rising.
    pub(crate) fn move_stamps(&mut self, from: usize, by_ns: i64) {
        let Some(from_ns) = self.stamps_ns.get(from).copied() else { return };
        let moved = |t: &i64| if *t >= from_ns { *t + by_ns } else { *t };
        self.faults.copies_ns.iter_mut().for_each(|t| *t = moved(t));
        self.stamps_ns.iter_mut().for_each(|t| *t = moved(t));
    }

    /// Room for so many frames with so many detections each.
    pub(crate) fn reserve(&mut self, frames: usize, detections: usize) {
        // What a file announces may be wrong by any factor: a day at 30 frames a second is the most that is
        // believed.
        let frames = frames.min(30 * 86_400);
        self.stamps_ns.reserve(frames);
        self.counts.reserve(frames);
        self.detections.reserve(frames * detections);
    }

    /// Notes a frame that repeats the one before.
    pub(crate) fn add_copy(&mut self, stamp_ns: i64) {
        self.faults.copies_ns.push(stamp_ns);
    }

    /// Notes a frame that is not later than the one before.
    pub(crate) fn add_backward(&mut self, stamp_ns: i64) {
        self.faults.backward_ns.push(stamp_ns);
    }

    /// Notes so many detections of a frame that are no measurement.
    pub(crate) fn add_spoilt(&mut self, stamp_ns: i64, count: usize) {
        if count > 0 {
            let (before, first_ns) = self.faults.spoilt.unwrap_or((0, stamp_ns));
            self.faults.spoilt = Some((before + count, first_ns));
        }
    }

    /// Adds what was seen in a frame later than all before it, and how bright it was where a flash is
    /// looked for.
    pub(crate) fn add(&mut self, stamp_ns: i64, seen: &[TrackedDetection], brightness: Option<f32>) {
        self.stamps_ns.push(stamp_ns);
        let count = u16::try_from(seen.len()).unwrap_or(u16::MAX);
        self.counts.push(count);
        self.detections.extend(seen.iter().take(count.into()).map(StoredDetection::of));
        if let (Some(all), Some(own)) = (&mut self.brightness, brightness) {
            all.push(own);
        }
    }

    /// Frame by frame, its time stamp and what was seen in it.
    pub(crate) fn frames(&self) -> impl Iterator<Item = (i64, &[StoredDetection])> {
        let mut rest = self.detections.as_slice();
        self.stamps_ns.iter().zip(&self.counts).map(move |(stamp_ns, count)| {
            let (own, later) = rest.split_at((*count).into());
            rest = later;
            (*stamp_ns, own)
        })
    }

    /// All that was seen.
    pub(crate) fn detections(&self) -> impl Iterator<Item = TrackedDetection> + '_ {
        self.frames().flat_map(move |(t_ns, own)| own.iter().map(move |s| s.detection(self.camera, t_ns)))
    }

    /// Frame by frame, its time stamp and what was seen in it; what was handed out is let go.
    pub(crate) fn into_frames(mut self) -> Frames {
        self.detections.reverse();
        Frames { stream: self, at: 0, seen: Vec::new() }
    }

    /// Notes an error of the source behind the first frame; one before it is handed back.
    pub(crate) fn add_fault(&mut self, error: PipelineError) -> Result<(), PipelineError> {
        let Some(last_ns) = self.stamps_ns.last() else { return Err(error) };
        let words = match error {
            PipelineError::Source { source, .. } => source.to_string(),
            other => other.to_string(),
        };
        self.faults.broken.push((*last_ns, words));
        Ok(())
    }

    /// First and last frame by the presumed clock.
    pub(crate) fn span_ns(&self) -> (i64, i64) {
        let t_ns = |stamp_ns: Option<&i64>| stamp_ns.map_or(0, |t| self.clock.clock.time_ns(*t));
        (t_ns(self.stamps_ns.first()), t_ns(self.stamps_ns.last()))
    }

    /// Median time between frames; [`PRESUMED_INTERVAL_S`] where there is one frame alone.
    pub(crate) fn interval_s(&self) -> f64 {
        let usual_ns = usual_interval_ns(self.stamps_ns.iter().copied());
        usual_ns.map_or(PRESUMED_INTERVAL_S, |step| step as f64 * 1e-9)
    }

    /// What the estimation of clocks needs, before the detections are associated: of each colour that one
    /// marker alone has, what is most likely that marker.
    ///
    /// Of a long recording these are the detections within some stretches of time.
    pub(crate) fn camera_stream(&self, colors: &MarkerColors, stretches_ns: &[(i64, i64)]) -> CameraStream {
        let is_inside = |stamp_ns: i64| {
            let t_ns = self.clock.clock.time_ns(stamp_ns);
            stretches_ns.iter().any(|(from_ns, to_ns)| (*from_ns..=*to_ns).contains(&t_ns))
        };
        let counts = colors.counts();
        let marker = |color: usize| {
            let own = counts.get(color) == Some(&1);
            colors.of_marker.iter().position(|c| own && *c == color)
        };
        let standing = self.standing();
        let is_likely = |d: &TrackedDetection| d.is_preferred && !standing.contains(&(d.color, d.track_id));
        let likely = self.detections().filter(|d| is_likely(d) && is_inside(d.t_ns));
        let observations = likely.filter_map(|d| Some(d.of_marker(marker(d.color)?))).collect();
        CameraStream { interval_s: self.interval_s(), readout: self.readout, observations, prior: self.clock }
    }

    /// What was wrong, in words.
    pub(crate) fn notes(&self) -> Vec<String> {
        let (name, Faults { copies_ns, backward_ns, broken, spoilt }) = (&self.name, &self.faults);
        let mut notes = Vec::new();
        for (after_ns, words) in broken.iter().take(MOST_NOTED) {
            notes.push(format!("{name}, after {:.3} s: {words}.", *after_ns as f64 * 1e-9));
        }
        if broken.len() > MOST_NOTED {
            notes.push(format!("{name}: {} more faults of this kind.", broken.len() - MOST_NOTED));
        }
        let left_out = |stamps_ns: &[i64], what: &str, why: &str| {
            let (count, first_s) = (stamps_ns.len(), *stamps_ns.first()? as f64 * 1e-9);
            Some(format!("{name}: {count} frame(s) {what} are left out, the first at {first_s:.3} s{why}."))
        };
        let why = ": the camera or a converter put them in";
        let frozen = self.frozen_runs();
        let lone: Vec<i64> = copies_ns
            .iter()
            .copied()
            .filter(|t| !frozen.iter().any(|(from_ns, to_ns, _)| (from_ns..=to_ns).contains(&t)))
            .collect();
        notes.extend(left_out(&lone, "repeat the one before and", why));
        notes.extend(left_out(backward_ns, "with a time stamp not after that of the frame before", ""));
        notes.extend(spoilt.map(|(count, first_ns)| {
            let first_s = first_ns as f64 * 1e-9;
            format!(
                "{name}: {count} detection(s) are not finite, not in the image or without a positive covariance, and are left \
                 out, the first at {first_s:.3} s."
            )
        }));
        notes.extend(self.gaps());
        notes
    }
}

/// Refuses one recording for two cameras, whose observations then lie in the same places: from two places
/// no two cameras see that.
pub(crate) fn refuse_one_recording_twice(streams: &[Stream]) -> Result<(), PipelineError> {
    const SAME_PX: f64 = 0.1;
    const COMPARED: usize = 40;
    for (k, stream) in streams.iter().enumerate() {
        for other in &streams[k + 1..] {
            let pairs = || stream.detections.iter().zip(&other.detections).take(COMPARED);
            if pairs().count() == COMPARED && pairs().all(|(a, b)| (a.pixel - b.pixel).amax() < SAME_PX) {
                let (camera, other) = (stream.name.clone(), other.name.clone());
                return Err(PipelineError::SameRecording { camera, other });
            }
        }
    }
    Ok(())
}

/// What the estimation of clocks needs of all cameras.
pub(crate) fn camera_streams(streams: &[Stream], colors: &MarkerColors) -> Vec<CameraStream> {
    let spans_ns = streams.iter().map(Stream::span_ns);
    let span_ns = spans_ns.reduce(|all, s| (all.0.min(s.0), all.1.max(s.1))).unwrap_or_default();
    let stretches_ns = informative_stretches_ns(span_ns);
    streams.iter().map(|stream| stream.camera_stream(colors, &stretches_ns)).collect()
}

#[cfg(test)]
mod tests;
