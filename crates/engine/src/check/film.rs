//! Some frames of each camera, and what was seen in them.

use mavsight_flight::Vehicle;
use mavsight_geometry::{ImageSize, Vector2};
use mavsight_pipeline::{CameraFeed, TimedFrame, Tracked, usual_interval_ns};
use mavsight_pose::{Rig, TrackedDetection};
use mavsight_vision::{Frame, linear_light};
use std::sync::{Arc, Mutex, PoisonError};

/// Frames of a camera that are kept.
const SHOTS: usize = 12;
/// Of each of these, the next one is kept too where smear is measured: more frames, smaller errors.
const KEPT: usize = 4 * SHOTS;

/// How much of each film is looked at, from its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// What is decoded and tracked in about a second. It is enough where there is nothing to say of it.
    First,
    /// What is decoded and tracked in about fifteen seconds, to find what is wrong.
    Long,
}

impl Part {
    /// Pixels of a camera: 3.3 s and 65 s of 640×480 at 30 frames/s.
    fn most_px(self) -> usize {
        match self {
            Self::First => 30_000_000,
            Self::Long => 600_000_000,
        }
    }

    /// Frames of a size.
    pub(crate) fn frames(self, size: ImageSize) -> usize {
        // The slowest of the motions that clocks are found by takes a second.
        const LEAST: usize = 45;
        (self.most_px() / size.area_px().max(1)).max(LEAST)
    }

    pub(super) fn of(self, feed: CameraFeed<'static>, size: ImageSize) -> CameraFeed<'static> {
        let most = self.frames(size);
        let announced = feed.announced.map(|n| n.min(most));
        CameraFeed { announced, frames: Box::new(feed.frames.take(most)), ..feed }
    }
}

/// A frame with what was detected where and as what.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Time stamp, ns.
    pub t_ns: i64,
    /// The image.
    pub frame: Frame,
    /// Detections, and markers that were not detected where their pose has them.
    pub spots: Vec<Spot>,
}

/// A detection, or a marker that was not detected.
#[derive(Debug, Clone, PartialEq)]
pub struct Spot {
    /// Centre.
    pub pixel: Vector2<f64>,
    /// Apparent diameter.
    pub diameter_px: f64,
    /// The marker as which it was identified; none of a detection that is no marker.
    pub marker: Option<usize>,
    /// Mean colour of the disc, sRGB-coded.
    pub rgb: [u8; 3],
    /// Whether it was detected; otherwise it is where the pose has the marker.
    pub is_detected: bool,
}

/// A detection at an instant.
pub(super) struct Seen {
    pub(super) t_ns: i64,
    pub(super) detection: TrackedDetection,
    pub(super) marker: Option<usize>,
}

/// What one camera's frames left behind.
#[derive(Debug, Clone, Default)]
pub(super) struct Taken {
    pub(super) stamps_ns: Vec<i64>,
    pub(super) frames: Vec<(i64, Frame)>,
}

impl Taken {
    /// Frames a second, and the longest interval over the usual one.
    pub(super) fn rate(&self) -> (f64, f64) {
        let Some(step_ns) = usual_interval_ns(self.stamps_ns.iter().copied()).filter(|s| *s > 0) else {
            return (0.0, 0.0);
        };
        let longest = self.stamps_ns.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(step_ns);
        (1e9 / step_ns as f64, longest as f64 / step_ns as f64)
    }
}

/// Keeps some of the frames that pass.
#[derive(Debug, Clone, Default)]
pub(super) struct Tap(Arc<Mutex<Taken>>);

impl Tap {
    pub(super) fn tapped(&self, feed: CameraFeed<'static>) -> CameraFeed<'static> {
        let mut every = (feed.announced.unwrap_or(KEPT) / KEPT).max(1);
        let from = every / 2;
        let taken = Arc::clone(&self.0);
        let frames = feed.frames.enumerate().map(move |(k, item)| {
            if let Ok(TimedFrame { t_ns, frame }) = &item {
                let mut taken = taken.lock().unwrap_or_else(PoisonError::into_inner);
                taken.stamps_ns.push(*t_ns);
                if k % every == from {
                    taken.frames.push((*t_ns, frame.clone()));
                }
                // A film may be longer than it announces, or announce nothing.
                if taken.frames.len() > 2 * KEPT {
                    let mut place = 0;
                    taken.frames.retain(|_| {
                        place += 1;
                        place % 2 == 1
                    });
                    every *= 2;
                }
            }
            item
        });
        CameraFeed { frames: Box::new(frames), ..feed }
    }

    pub(super) fn finish(self) -> Taken {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// All cameras, tracked.
pub(super) struct Film {
    pub(super) tracked: Tracked,
    pub(super) seen: Vec<Seen>,
    pub(super) taps: Vec<Taken>,
}

impl Film {
    /// The instant of a camera's time stamp.
    pub(super) fn time_ns(&self, camera: usize, stamp_ns: i64) -> i64 {
        self.tracked.clocks.get(camera).map_or(stamp_ns, |c| c.clock.time_ns(stamp_ns))
    }

    /// Detections of a camera within half a frame of an instant.
    fn near(&self, camera: usize, t_ns: i64, within_ns: i64) -> impl Iterator<Item = &Seen> {
        self.seen.iter().filter(move |s| s.detection.camera == camera && (s.t_ns - t_ns).abs() <= within_ns)
    }

    /// Diameter of the detection at a place of a camera at an instant.
    pub(super) fn diameter_near(&self, camera: usize, pixel: Vector2<f64>, t_ns: i64) -> Option<f64> {
        let seen = self.near(camera, t_ns, self.half_step_ns(camera));
        let away = |s: &&Seen| (s.detection.pixel - pixel).norm();
        let nearest = seen.min_by(|a, b| away(a).total_cmp(&away(b)))?;
        (away(&nearest) < nearest.detection.diameter_px).then_some(nearest.detection.diameter_px)
    }

    /// Half of the usual interval of a camera's frames.
    pub(super) fn half_step_ns(&self, camera: usize) -> i64 {
        usual_interval_ns(self.taps[camera].stamps_ns.iter().copied()).unwrap_or(0) / 2
    }

    /// Centre and diameter of a marker where the pose of an instant has it; none without a pose.
    pub(super) fn predicted(
        &self,
        camera: usize,
        marker: usize,
        t_ns: i64,
        vehicle: &Vehicle,
        rig: &Rig,
    ) -> Option<(Vector2<f64>, f64)> {
        let within_ns = self.half_step_ns(camera);
        let sample = self.tracked.poses.iter().find(|p| (p.t_ns - t_ns).abs() <= within_ns)?;
        let pose = sample.estimate.as_ref().ok()?.world_from_body;
        let own = &vehicle.marker[marker];
        let at = (pose * mavsight_geometry::Point3::from(own.position_m)).coords;
        let camera = &rig.cameras.get(camera)?.camera;
        let pixel = camera.project(&at).ok()?.pixel;
        let away_m = (at - camera.centre_in_world()).norm();
        let focal_px = (camera.intrinsics.fx_px * camera.intrinsics.fy_px).abs().sqrt();
        Some((pixel, focal_px * own.diameter_m / away_m))
    }

    /// A dozen frames of a camera with what was seen in them.
    pub(super) fn shots(&self, camera: usize, vehicle: &Vehicle, rig: &Rig) -> Vec<Shot> {
        let (frames, half_ns) = (&self.taps[camera].frames, self.half_step_ns(camera));
        let every = frames.len().div_ceil(SHOTS).max(1);
        let shot = |(stamp_ns, frame): &(i64, Frame)| {
            let t_ns = self.time_ns(camera, *stamp_ns);
            let mut spots: Vec<Spot> = Vec::new();
            for seen in self.near(camera, t_ns, half_ns) {
                let (pixel, diameter_px) = (seen.detection.pixel, seen.detection.diameter_px);
                let rgb = disc_rgb(frame, pixel, diameter_px);
                spots.push(Spot { pixel, diameter_px, marker: seen.marker, rgb, is_detected: true });
            }
            for marker in 0..vehicle.marker.len() {
                if spots.iter().any(|s| s.marker == Some(marker)) {
                    continue;
                }
                if let Some((pixel, diameter_px)) = self.predicted(camera, marker, t_ns, vehicle, rig) {
                    let rgb = disc_rgb(frame, pixel, diameter_px);
                    spots.push(Spot { pixel, diameter_px, marker: Some(marker), rgb, is_detected: false });
                }
            }
            Shot { t_ns: *stamp_ns, frame: frame.clone(), spots }
        };
        frames.iter().step_by(every).map(shot).collect()
    }
}

/// sRGB code of linear light.
pub(crate) fn coded(light: f64) -> u8 {
    let s = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.max(0.0).powf(1.0 / 2.4) - 0.055 };
    (255.0 * s).round().clamp(0.0, 255.0) as u8
}

/// Mean linear light between two distances from a place; none where the frame has no pixel there.
pub(super) fn ring_light(frame: &Frame, at: Vector2<f64>, from_px: f64, to_px: f64) -> Option<[f64; 3]> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    let reach = to_px.ceil() as i64;
    let (cx, cy) = (at.x.round() as i64, at.y.round() as i64);
    for y in (cy - reach).max(0)..(cy + reach + 1).min(i64::from(frame.size.height_px)) {
        for x in (cx - reach).max(0)..(cx + reach + 1).min(i64::from(frame.size.width_px)) {
            let away_px = (x as f64 - at.x).hypot(y as f64 - at.y);
            if away_px >= from_px && away_px <= to_px {
                let rgb = frame.rgb(x as usize, y as usize);
                for (sum, code) in sum.iter_mut().zip(rgb) {
                    *sum += linear_light(code);
                }
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum.map(|s| s / count))
}

/// Mean colour of a disc without its rim, sRGB-coded.
pub(super) fn disc_rgb(frame: &Frame, at: Vector2<f64>, diameter_px: f64) -> [u8; 3] {
    let inside_px = (0.5 * diameter_px - 1.0).max(1.0);
    ring_light(frame, at, 0.0, inside_px).map_or([0; 3], |light| light.map(coded))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_film_that_announces_no_length_leaves_few_frames_evenly_spread() {
        let size = ImageSize { width_px: 2, height_px: 2 };
        let frame = move |k: i64| {
            let frame = Frame::from_rgb(size, vec![0; 12]).unwrap();
            Ok(TimedFrame { t_ns: k, frame })
        };
        let tap = Tap::default();
        let feed = tap.tapped(CameraFeed::new("a", None, Box::new((0..5000).map(frame))));
        assert_eq!(feed.frames.count(), 5000);
        let taken = tap.finish();
        let at: Vec<i64> = taken.frames.iter().map(|(t_ns, _)| *t_ns).collect();
        assert!((KEPT..=2 * KEPT).contains(&at.len()) && at[at.len() - 1] > 4800, "{at:?}");
        assert!(at.windows(2).all(|pair| pair[1] - pair[0] == at[1] - at[0]), "{at:?}");
        assert_eq!(taken.stamps_ns.len(), 5000);
    }
}
