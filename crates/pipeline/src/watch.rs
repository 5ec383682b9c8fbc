//! What happened to the cameras, and how well they see.

use crate::{CameraHealth, MarkerHealth};
use mavsight_pose::{MovedCamera, Rig};
use mavsight_vision::{BallHealth, Tracker};

/// Watches one camera while it is tracked.
pub(crate) struct CameraWatch {
    pub(crate) health: CameraHealth,
    balls: Vec<BallHealth>,
    /// When the camera went dark, for as long as it is.
    dark_since_ns: Option<i64>,
    last_ns: i64,
    /// Spans in which it was dark: the first ones, which is all that anybody reads.
    spans_ns: Vec<(i64, i64)>,
}

/// Spans that are kept: beyond them the count of frames says enough.
const MOST_SPANS: usize = 8;

impl CameraWatch {
    pub(crate) fn new(camera: String) -> Self {
        let health = CameraHealth { camera, ..CameraHealth::default() };
        Self { health, balls: Vec::new(), dark_since_ns: None, last_ns: 0, spans_ns: Vec::new() }
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
        self.balls = tracker.health().to_vec();
        self
    }

    /// The health with the shares of frames in which each marker was identified, and notes on the dark.
    pub(crate) fn report(mut self, of_marker: &[usize], seen: &[usize]) -> (CameraHealth, Vec<String>) {
        let frames = self.health.frames.max(1) as f64;
        let marker = |(color, n): (&usize, &usize)| {
            let ball = self.balls.get(*color).copied().unwrap_or_default();
            MarkerHealth { seen: *n as f64 / frames, ball }
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
        let notes = self.spans_ns.iter().map(note).collect();
        (self.health, notes)
    }
}

/// A note on each camera that was moved.
pub(crate) fn moved_notes(rig: &Rig, moved: &[MovedCamera]) -> Vec<String> {
    moved
        .iter()
        .map(|m| {
            format!(
                "{} was moved at {:.3} s: the aircraft is shifted in its image by {:.1} px against the other cameras and where it \
                 flew. It is left out from then on; fix it and calibrate again to use what it filmed.",
                rig.cameras.get(m.camera).map_or("a camera", |c| c.name.as_str()),
                m.t_ns as f64 * 1e-9,
                m.shift_px.norm()
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_vision::{BallColor, Frame, ImageSize};

    const SIZE: ImageSize = ImageSize { width_px: 32, height_px: 24 };

    #[test]
    fn the_dark_is_noted_with_its_time_from_its_first_frame_on() {
        let red = BallColor { name: "red".into(), rgb: [200, 40, 40] };
        let mut tracker = Tracker::new(&[red], 3.0..=10.0).unwrap();
        let mut watch = CameraWatch::new("cam2".into());
        for k in 0..20 {
            let light = if (5..9).contains(&k) || k >= 15 { 8 } else { 120 };
            let frame = Frame::from_rgb(SIZE, vec![light; 3 * SIZE.area_px()]).unwrap();
            tracker.update(&frame);
            watch.saw(k * 100_000_000, tracker.is_dark());
        }
        let (health, notes) = watch.finish(&tracker).report(&[0], &[4]);
        assert_eq!((health.frames, health.dark, health.markers[0].seen), (20, 9, 0.2));
        assert!(notes.len() == 2 && notes.iter().all(|n| n.starts_with("cam2 is dark")), "{notes:?}");
        assert!(notes[0].contains("0.500 s") && notes[1].contains("1.500 s to 1.900 s"), "{notes:?}");
    }

    #[test]
    fn nothing_seen_is_nothing_noted() {
        let red = BallColor { name: "red".into(), rgb: [200, 40, 40] };
        let tracker = Tracker::new(&[red], 3.0..=10.0).unwrap();
        let (health, notes) = CameraWatch::new("cam1".into()).finish(&tracker).report(&[0], &[0]);
        assert!(notes.is_empty() && health.markers[0].seen == 0.0);
    }
}
