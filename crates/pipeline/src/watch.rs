//! What happened to the cameras, and how well they see.

use crate::{CameraHealth, Cause, Finding, MarkerHealth, TimedFrame, sharpness};
use mavsight_pose::{MovedCamera, Rig, median};
use mavsight_vision::{BallHealth, Frame, Tracker};

/// Watches one camera while it is tracked.
pub(crate) struct CameraWatch {
    pub(crate) health: CameraHealth,
    balls: Vec<BallHealth>,
    /// When the camera went dark, for as long as it is.
    dark_since_ns: Option<i64>,
    last_ns: i64,
    /// Spans in which it was dark: the first ones, which is all that anybody reads.
    spans_ns: Vec<(i64, i64)>,
    /// Blur of the room's edges in some frames.
    sharpness_px: Vec<f64>,
    /// Number of the frame in the middle of the recording, where its length is announced.
    middle: Option<usize>,
    /// One frame from about the middle of the flight, for pictures.
    pub(crate) picture: Option<TimedFrame>,
}

/// Frames whose sharpness is looked at, and from one to the next.
const SHARPNESS_LOOKS: usize = 5;
const SHARPNESS_EVERY: usize = 8;

/// Spans that are kept: beyond them the count of frames says enough.
const MOST_SPANS: usize = 8;

impl CameraWatch {
    pub(crate) fn new(camera: String, announced: Option<usize>) -> Self {
        let health = CameraHealth { camera, ..CameraHealth::default() };
        Self {
            health,
            balls: Vec::new(),
            dark_since_ns: None,
            last_ns: 0,
            spans_ns: Vec::new(),
            sharpness_px: Vec::new(),
            middle: announced.map(|frames| frames / 2),
            picture: None,
        }
    }

    /// Looks how sharp a frame is, of the first and some more of them, and keeps one for pictures: the middle one, or where
    /// the length is not known the last whose number is a power of two, which is in the second half.
    pub(crate) fn looks_at(&mut self, t_ns: i64, frame: &Frame) {
        let number = self.health.frames;
        if number == 0 || self.middle.map_or(number.is_power_of_two(), |middle| number == middle) {
            self.picture = Some(TimedFrame { t_ns, frame: frame.clone() });
        }
        if self.sharpness_px.len() < SHARPNESS_LOOKS && self.health.frames.is_multiple_of(SHARPNESS_EVERY) {
            self.sharpness_px.extend(sharpness::edge_px(frame));
        }
    }

    /// Takes note of the frame that the tracker has just seen.
    pub(crate) fn saw(&mut self, t_ns: i64, is_dark: bool) {
        self.health.frames += 1;
        self.last_ns = t_ns;
        if is_dark {
            self.health.dark += 1;
            self.dark_since_ns.get_or_insert(t_ns);
        } else {
            self.end_span();
        }
    }

    fn end_span(&mut self) {
        if let Some(from_ns) = self.dark_since_ns.take()
            && self.spans_ns.len() < MOST_SPANS
        {
            self.spans_ns.push((from_ns, self.last_ns));
        }
    }

    /// Ends the watch.
    pub(crate) fn finish(mut self, tracker: &Tracker) -> Self {
        self.end_span();
        self.health.edge_px = tracker.edge_px();
        self.health.room_edge_px = median(std::mem::take(&mut self.sharpness_px));
        self.balls = tracker.health().to_vec();
        self
    }

    /// The health with the shares of frames in which each marker was identified, and findings on the dark.
    pub(crate) fn report(
        mut self,
        camera: usize,
        of_marker: &[usize],
        seen: &[f64],
    ) -> (CameraHealth, Vec<Finding>) {
        let marker = |(color, seen): (&usize, &f64)| {
            let ball = self.balls.get(*color).copied().unwrap_or_default();
            MarkerHealth { seen: *seen, ball }
        };
        self.health.markers = of_marker.iter().zip(seen).map(marker).collect();
        let name = &self.health.camera;
        let note = |(from_ns, to_ns): &(i64, i64)| {
            format!(
                "{name} is dark from {:.3} s to {:.3} s: nothing of it is used then. Check its power, its shutter and what stands \
                 before its lens.",
                *from_ns as f64 * 1e-9,
                *to_ns as f64 * 1e-9
            )
        };
        let dark = |span: &(i64, i64)| Finding::of(Cause::CameraDark, Some(camera), note(span));
        let findings = self.spans_ns.iter().map(dark).collect();
        (self.health, findings)
    }
}

/// A finding on each camera that does not stand, or does not film, as it did.
///
/// Where something else is found that puts a camera's view off, a camera that was left out for it is not said to
/// have been moved.
pub(crate) fn standing(rig: &Rig, moved: &[MovedCamera], found: &[Finding]) -> Vec<Finding> {
    let is_other = |f: &Finding| {
        let views = [Cause::ClockOffset, Cause::FrameRate, Cause::BodyScale, Cause::ColorsExchanged];
        f.causes.iter().any(|c| views.contains(c))
    };
    let is_explained = found.iter().any(is_other);
    let name = |camera: usize| rig.cameras.get(camera).map_or("a camera", |c| c.name.as_str());
    let of = |m: &MovedCamera| {
        let (name, other) = (name(m.camera), m.or.map(name));
        let t_s = m.t_ns as f64 * 1e-9;
        match m.still_since_ns {
            Some(still_ns) => {
                let note = format!(
                    "{name} froze: its balls stand still in its images since {:.3} s, while the aircraft moves by {:.1} px by the \
                     other cameras until {t_s:.3} s. It is left out from then on. Check its cable, its bandwidth and its driver.",
                    still_ns as f64 * 1e-9,
                    m.shift_px.norm()
                );
                Finding::of(Cause::CameraFrozen, Some(m.camera), note)
            }
            None if is_explained => {
                let shift_px = m.shift_px.norm();
                let note = format!(
                    "{name} is left out from {t_s:.3} s on, as its view is off by {shift_px:.1} px: what else is said of the recording \
                     explains that."
                );
                Finding { causes: vec![], camera: Some(m.camera), note }
            }
            None if other.is_some() => {
                let note = format!(
                    "{name} or {} was moved, at {t_s:.3} s or while the aircraft was hidden before: it is shifted by {:.1} px in the image of \
                     one against that of the other, and the flight does not show in which. Both are left out from then on; fix them \
                     and calibrate again to use what they filmed.",
                    other.unwrap_or_default(),
                    m.shift_px.norm()
                );
                Finding::of(Cause::CameraMoved, None, note)
            }
            None => {
                let note = format!(
                    "{name} was moved at {t_s:.3} s: the aircraft is shifted in its image by {:.1} px against the other cameras and \
                     where it flew. It is left out from then on; fix it and calibrate again to use what it filmed.",
                    m.shift_px.norm()
                );
                Finding::of(Cause::CameraMoved, Some(m.camera), note)
            }
        }
    };
    // Of two that may have been moved the first stands for both.
    let is_first = |(k, m): &(usize, &MovedCamera)| !moved[..*k].iter().any(|n| Some(n.camera) == m.or);
    moved.iter().enumerate().filter(is_first).map(|(_, m)| of(m)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_vision::{BallColor, ImageSize};

    const SIZE: ImageSize = ImageSize { width_px: 32, height_px: 24 };

    #[test]
    fn the_dark_is_noted_with_its_time_from_its_first_frame_on() {
        let red = BallColor { name: "red".into(), rgb: [200, 40, 40] };
        let mut tracker = Tracker::new(&[red], 3.0..=10.0).unwrap();
        let mut watch = CameraWatch::new("cam2".into(), None);
        for k in 0..20 {
            let light = if (5..9).contains(&k) || k >= 15 { 8 } else { 120 };
            let frame = Frame::from_rgb(SIZE, vec![light; 3 * SIZE.area_px()]).unwrap();
            tracker.update(&frame);
            watch.saw(k * 100_000_000, tracker.is_dark());
        }
        let (health, findings) = watch.finish(&tracker).report(1, &[0], &[0.2]);
        assert_eq!((health.frames, health.dark, health.markers[0].seen), (20, 9, 0.2));
        let is_dark = |f: &Finding| f.cause() == Some(Cause::CameraDark) && f.camera == Some(1);
        assert!(findings.len() == 2 && findings.iter().all(is_dark), "{findings:?}");
        assert!(findings[0].note.starts_with("cam2 is dark from 0.500 s"), "{findings:?}");
        assert!(findings[1].note.contains("1.500 s to 1.900 s"), "{findings:?}");
    }

    #[test]
    fn one_frame_is_kept_from_about_the_middle() {
        let kept = |announced: Option<usize>, frames: usize| {
            let mut watch = CameraWatch::new("cam1".into(), announced);
            for k in 0..frames {
                let frame = Frame::from_rgb(SIZE, vec![100; 3 * SIZE.area_px()]).unwrap();
                watch.looks_at(k as i64, &frame);
                watch.saw(k as i64, false);
            }
            watch.picture.map(|picture| picture.t_ns)
        };
        assert_eq!((kept(Some(300), 300), kept(Some(300), 20)), (Some(150), Some(0)));
        assert_eq!((kept(None, 300), kept(None, 1), kept(None, 0)), (Some(256), Some(0), None));
    }

    #[test]
    fn nothing_seen_is_nothing_noted() {
        let red = BallColor { name: "red".into(), rgb: [200, 40, 40] };
        let tracker = Tracker::new(&[red], 3.0..=10.0).unwrap();
        let (health, findings) =
            CameraWatch::new("cam1".into(), None).finish(&tracker).report(0, &[0], &[0.0]);
        assert!(findings.is_empty() && health.markers[0].seen == 0.0);
    }
}
