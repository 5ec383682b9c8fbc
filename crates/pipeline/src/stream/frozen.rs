//! Cameras that repeat one image, sample by sample or before an encoder that adds noise of its own.

use super::Stream;
use crate::{Cause, Finding};
use mavsight_geometry::Vector2;
use mavsight_pose::{BallPlaces, Displacement, LONGEST_APART_NS, STILL_IMAGES, TrackedDetection, is_far};

/// Copies in a row from which a camera is frozen: what changes a rate repeats an image once or, from 24 to 60 a
/// second, twice.
const FROZEN_COPIES: usize = 4;

/// Balls by which movement is seen.
const LEAST_BALLS: usize = 3;

impl Stream {
    /// Runs of copies that are too long for a converter's: first and last stamp, and how many.
    pub(super) fn frozen_runs(&self) -> Vec<(i64, i64, usize)> {
        let is_new_between = |from_ns: i64, to_ns: i64| {
            let next = self.stamps_ns.partition_point(|t| *t <= from_ns);
            self.stamps_ns.get(next).is_some_and(|t| *t < to_ns)
        };
        let runs = self.faults.copies_ns.chunk_by(|a, b| !is_new_between(*a, *b));
        let long = runs.filter(|run| run.len() >= FROZEN_COPIES);
        long.filter_map(|run| Some((*run.first()?, *run.last()?, run.len()))).collect()
    }

    /// That the camera repeated one image for long.
    pub(crate) fn frozen(&self) -> Option<Finding> {
        let runs = self.frozen_runs();
        let (from_ns, to_ns, _) = *runs.first()?;
        let count: usize = runs.iter().map(|r| r.2).sum();
        let more =
            if runs.len() > 1 { format!(", and {} more times", runs.len() - 1) } else { String::new() };
        let note = format!(
            "{} froze: it repeats one image from {:.3} s to {:.3} s{more}, {count} frame(s) in all, sample by sample: they are \
             left out. Check its cable, its bandwidth and its driver.",
            self.name,
            from_ns as f64 * 1e-9,
            to_ns as f64 * 1e-9
        );
        Some(Finding::of(Cause::CameraFrozen, Some(self.camera), note))
    }

    /// The frames, and whether they end with a camera that stands still.
    fn still_end(&self) -> Option<StillEnd> {
        let (mut places, mut seen) = (BallPlaces::default(), Vec::new());
        let mut end = StillEnd::default();
        for (k, (stamp_ns, own)) in self.frames().enumerate() {
            seen.clear();
            seen.extend(own.iter().map(|s| s.detection(self.camera, stamp_ns)));
            let by = places.displaced(self.camera, &seen);
            match by.filter(Displacement::is_still) {
                Some(by) => (end.images, end.variance_px2) = (end.images + 1, by.variance_px2),
                // What hides some of the balls, or spoils their detections, does not move those that are left.
                None if by.is_none() && end.images > 1 && places.are_where_they_were(self.camera, &seen) => {}
                None => {
                    end = StillEnd { from: k, images: 1, variance_px2: 0.0 };
                    places.take(&seen);
                }
            }
        }
        (end.images >= STILL_IMAGES).then_some(end)
    }

    /// How this camera sees the body move within a time, by what the noise of neither camera explains.
    fn movement(&self, (from_ns, to_ns): (i64, i64), still_px2: f64) -> Option<Movement> {
        let (mut places, mut seen) = (BallPlaces::default(), Vec::<TrackedDetection>::new());
        // By how much it had moved when the tracks that are followed began, and since, with the variances.
        let (mut before, mut since) = ((Vector2::zeros(), still_px2), (Vector2::zeros(), 0.0));
        let (mut first, mut found) = (None, None);
        for (stamp_ns, own) in self.frames() {
            let t_ns = self.clock.clock.time_ns(stamp_ns);
            if !(from_ns..=to_ns).contains(&t_ns) {
                continue;
            }
            seen.clear();
            seen.extend(own.iter().map(|s| s.detection(self.camera, stamp_ns)));
            let Some(by) = places.displaced(self.camera, &seen) else {
                if own.len() >= LEAST_BALLS {
                    before = (before.0 + since.0, before.1 + since.1);
                    since = (Vector2::zeros(), 0.0);
                    places.take(&seen);
                }
                continue;
            };
            since = (by.mean_px, by.variance_px2);
            let (px, variance_px2) = (before.0 + since.0, before.1 + since.1);
            if !is_far(px, variance_px2) {
                continue;
            }
            let (first_px, first_ns) = *first.get_or_insert((px, t_ns));
            // What leaps once was pushed itself.
            if is_far(px - first_px, variance_px2) {
                let is_long = t_ns - first_ns >= LONGEST_APART_NS;
                found = Some(Movement { camera: self.camera, by_px: px.norm(), t_ns, is_long });
                if is_long {
                    break;
                }
            }
        }
        found
    }
}

/// Frames at a camera's end in which its balls stand still.
#[derive(Default)]
struct StillEnd {
    from: usize,
    images: usize,
    variance_px2: f64,
}

/// Movement of the body in the images of a camera.
struct Movement {
    camera: usize,
    by_px: f64,
    t_ns: i64,
    /// Whether it goes on for longer than clocks are apart.
    is_long: bool,
}

/// That the last camera of a flight repeats one image, noise and all.
fn alone(name: &str, camera: usize, (from_ns, to_ns): (i64, i64)) -> Finding {
    let note = format!(
        "{name} froze: from {:.3} s to its end at {:.3} s its images show the balls in the same places without any noise, and no other \
         camera filmed for as long. It is left out from there on. Check its cable, its bandwidth and its driver.",
        from_ns as f64 * 1e-9,
        to_ns as f64 * 1e-9
    );
    Finding::of(Cause::CameraFrozen, Some(camera), note)
}

/// Leaves out the end of a camera whose balls stand still from a frame on to its last one, with no more than an encoder's
/// noise, while another camera sees the body move and go on moving. Where the other camera sees that for less than a second,
/// a clock may be wrong instead: both causes are listed if the session says that the clocks are known, and nothing is
/// concluded where it does not.
pub(crate) fn leave_out_still(streams: &mut [Stream]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for camera in 0..streams.len() {
        let Some(still) = streams[camera].still_end() else { continue };
        let stream = &streams[camera];
        let t_ns = |frame: usize| stream.stamps_ns.get(frame).map(|t| stream.clock.clock.time_ns(*t));
        let (Some(from_ns), Some(to_ns)) = (t_ns(still.from), t_ns(stream.stamps_ns.len() - 1)) else {
            continue;
        };
        let others = streams.iter().filter(|s| s.camera != camera);
        let seen = others.clone().filter_map(|s| s.movement((from_ns, to_ns), still.variance_px2));
        let movement = seen.max_by_key(|m| m.is_long);
        // Images that nobody can compare and that show nothing anew measure nothing, whatever the clocks are.
        let is_alone = others.map(|s| s.span_ns().1).all(|end_ns| end_ns <= to_ns - LONGEST_APART_NS);
        if is_alone && movement.as_ref().is_none_or(|m| !m.is_long) {
            let finding = alone(&streams[camera].name, camera, (from_ns, to_ns));
            streams[camera].end_before(still.from + 1);
            findings.push(finding);
            continue;
        }
        let Some(movement) = movement else { continue };
        let is_known = |s: &Stream| s.clock.offset_std_s == 0.0;
        let (causes, or) = if movement.is_long {
            (vec![Cause::CameraFrozen], "")
        } else if is_known(stream) && is_known(&streams[movement.camera]) {
            (vec![Cause::CameraFrozen, Cause::ClockOffset], ", or the clock of one of them is wrong")
        } else {
            continue;
        };
        let note = format!(
            "{} froze{or}: its balls stand still in its images from {:.3} s to its end at {:.3} s, while the aircraft moves by {:.1} \
             px in those of {} until {:.3} s. It is left out from there on. Check its cable, its bandwidth and its driver.",
            stream.name,
            from_ns as f64 * 1e-9,
            to_ns as f64 * 1e-9,
            movement.by_px,
            streams[movement.camera].name,
            movement.t_ns as f64 * 1e-9
        );
        streams[camera].end_before(still.from + 1);
        findings.push(Finding { causes, camera: Some(camera), note });
    }
    findings
}
