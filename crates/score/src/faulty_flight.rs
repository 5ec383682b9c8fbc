//! Flights in a virtual laboratory with faults in what its cameras deliver.

use crate::fault::{Fault, Injection};
use crate::{ScoreError, VirtualLab};
use mavsight_geometry::camera_parameters::{CENTRE, TURN};
use mavsight_geometry::{Camera, CameraChange, Matrix2, Point3, Vector2, Vector3};
use mavsight_pipeline::{DetectedFrame, DetectionFeed, NoProgress, Tracked, motion_of, track_detections};
use mavsight_pose::{CameraClock, ClockPrior, MarkerObservation, Motion, TrackedDetection, calibrate};
use mavsight_random::Random;
use mavsight_simulator::FlightState;

/// A flight with faults, and what is made of it.
#[derive(Debug)]
pub(crate) struct FaultyFlight {
    pub(crate) truth: Vec<FlightState>,
    pub(crate) injections: Vec<Injection>,
    /// What was tracked and its motion; what the pipeline refuses.
    pub(crate) measured: Result<(Tracked, Option<Motion>), mavsight_pipeline::PipelineError>,
    /// Number of the frame at which a camera was left out, of the first that was.
    pub(crate) left_out_at: Option<usize>,
}

/// Frames without a detection after which a tracker gives up a ball: the same ball has another number then.
const MOST_MISSED: usize = 5;

/// A ball that is not a marker has a number from here on.
const DECOY: u32 = 10_000;

impl VirtualLab {
    /// A flight as in [`VirtualLab::fly`] from detections without identity, with faults.
    pub(crate) fn fly_with(&self, faults: &[Fault], random: &mut Random) -> Result<FaultyFlight, ScoreError> {
        let rig = calibrate(&self.control_observations(random))?;
        let truth = self.flight(random)?;
        let length = (truth.len(), self.frame_rate_hz);
        let mut injections: Vec<Injection> =
            faults.iter().map(|fault| Injection::draw(*fault, self.cameras.len(), length, random)).collect();
        // A session says of every other flight's clocks that they are in step.
        let clock = match random.uniform() < 0.5 {
            true => ClockPrior::known(CameraClock::default()),
            false => ClockPrior::unknown(),
        };
        let view = |camera: usize, frame: usize| self.view(camera, frame, &injections);
        let observed = self.draw_observations(&truth, view, random);
        let mut cameras = self.frames(&truth, &observed);
        for injection in &mut injections {
            self.inject(injection, &truth, &mut cameras);
        }
        let feeds = cameras.into_iter().enumerate().map(|(k, frames)| DetectionFeed {
            name: self.cameras[k].name.clone(),
            clock: if k == 0 { ClockPrior::known(CameraClock::default()) } else { clock },
            frames,
        });
        let mut left_out_at = None;
        let each = |instant: &mavsight_pipeline::Instant<'_>| {
            if !instant.moved.is_empty() && left_out_at.is_none() {
                left_out_at = Some((instant.t_ns as f64 * 1e-9 * self.frame_rate_hz).round() as usize);
            }
        };
        let tracked = track_detections(feeds.collect(), &rig, &self.vehicle, each);
        let measured = tracked.map(|tracked| {
            let motion = motion_of(&tracked, None, &self.vehicle, &NoProgress).ok();
            (tracked, motion)
        });
        Ok(FaultyFlight { truth, injections, measured, left_out_at })
    }

    /// Where a camera stands at a frame.
    fn view(&self, camera: usize, frame: usize, injections: &[Injection]) -> Camera {
        let pushed = |i: &&Injection| {
            i.fault == Fault::CameraBumped && i.camera == camera && i.frames.contains(&frame)
        };
        injections.iter().filter(pushed).fold(self.cameras[camera].camera, |camera, i| {
            let mut change = CameraChange::zeros();
            let turn = i.along * i.between(0.1, 3.0).to_radians();
            change.fixed_rows_mut::<3>(TURN).copy_from(&turn);
            change.fixed_rows_mut::<3>(CENTRE).copy_from(&(i.along.yzx() * i.between(1e-3, 3e-2)));
            camera.moved(&change)
        })
    }

    /// The frames of each camera: what was observed, as a tracker hands it out.
    fn frames(
        &self,
        truth: &[FlightState],
        observed: &[(i64, Vec<MarkerObservation>)],
    ) -> Vec<Vec<DetectedFrame>> {
        let markers = self.vehicle.marker.len();
        let of_camera = |camera: usize| {
            // When each ball was seen last, and how often it had been lost by then.
            let mut last = vec![(0, 0); markers];
            let frame = |(k, (t_ns, seen)): (usize, &(i64, Vec<MarkerObservation>))| {
                let own = seen.iter().filter(|o| o.camera == camera).map(|o| {
                    let (at, lost) = &mut last[o.marker];
                    *lost += u32::from(k > *at + MOST_MISSED);
                    *at = k;
                    let track_id = o.marker as u32 + *lost * markers as u32;
                    self.detection(o, track_id, &truth[k])
                });
                DetectedFrame { stamp_ns: *t_ns, seen: own.collect() }
            };
            observed.iter().enumerate().map(frame).collect()
        };
        (0..self.cameras.len()).map(of_camera).collect()
    }

    fn detection(&self, o: &MarkerObservation, track_id: u32, state: &FlightState) -> TrackedDetection {
        let ball = &self.vehicle.marker[o.marker];
        let centre = (state.pose() * Point3::from(Vector3::from(ball.position_m))).coords;
        TrackedDetection {
            t_ns: o.t_ns,
            camera: o.camera,
            track_id,
            color: o.marker,
            pixel: o.pixel,
            covariance_px2: o.covariance_px2,
            diameter_px: diameter_px(&self.cameras[o.camera].camera, &centre, ball.diameter_m),
            is_static: false,
            is_preferred: true,
        }
    }

    fn inject(&self, injection: &mut Injection, truth: &[FlightState], cameras: &mut [Vec<DetectedFrame>]) {
        let own = injection.camera.min(cameras.len() - 1);
        match injection.fault {
            Fault::FramesDropped => dropped(injection, &mut cameras[own]),
            Fault::FramesDuplicated => duplicated(injection, &mut cameras[own]),
            Fault::FramesLate => late(injection, &mut cameras[own]),
            Fault::FramesReordered => reordered(injection, &mut cameras[own]),
            Fault::ClockStep => stepped(injection, &mut cameras[own]),
            Fault::CameraDead => cameras[own].truncate(injection.frames.start),
            Fault::CameraFrozen => frozen(injection, &mut cameras[own]),
            // It is in where the camera stands.
            Fault::CameraBumped => {}
            Fault::ThreeVisible | Fault::TwoVisible | Fault::OneVisible | Fault::NoneVisible => {
                hidden(injection, cameras, self.vehicle.marker.len());
            }
            Fault::ColorsExchanged => exchanged(injection, cameras, self.vehicle.marker.len()),
            Fault::Decoy => self.decoy(injection, truth, cameras),
            Fault::NotANumber => not_numbers(injection, &mut cameras[own]),
        }
    }

    /// A ball that is carried past the aircraft, as all cameras see it.
    fn decoy(&self, injection: &mut Injection, truth: &[FlightState], cameras: &mut [Vec<DetectedFrame>]) {
        let markers = self.vehicle.marker.len();
        let color = ((injection.random.uniform() * markers as f64) as usize).min(markers - 1);
        let diameter_m = self.vehicle.marker[color].diameter_m;
        let (start, end) = (injection.frames.start, injection.frames.end.min(truth.len()));
        let Some(middle) = truth.get((start + end) / 2) else { return };
        // From a tenth of a metre to one past the aircraft, at the speed of a walk.
        let past_m = injection.along * injection.between(0.1, 1.0);
        let across = Vector3::from(injection.random.normals());
        let velocity_m_s = (across - injection.along * across.dot(&injection.along)).normalize()
            * injection.random.between(0.1, 1.5);
        for (camera, frames) in cameras.iter_mut().enumerate() {
            let view = &self.cameras[camera].camera;
            let std_px = self.stated_std_px();
            for (k, frame) in frames.iter_mut().enumerate().take(end).skip(start) {
                let since_s = truth[k].t_s - middle.t_s;
                let at = middle.position_in_world_m + past_m + velocity_m_s * since_s;
                let Ok(seen) = view.project_ball(&at, 0.5 * diameter_m) else { continue };
                if !view.size.contains(&seen.pixel, 3.0) {
                    continue;
                }
                let noise = Vector2::new(injection.random.normal(), injection.random.normal()) * std_px;
                frame.seen.push(TrackedDetection {
                    t_ns: frame.stamp_ns,
                    camera,
                    track_id: DECOY,
                    color,
                    pixel: seen.pixel + noise,
                    covariance_px2: Matrix2::identity() * std_px * std_px,
                    diameter_px: diameter_px(view, &at, diameter_m),
                    is_static: false,
                    is_preferred: !frame.seen.iter().any(|s| s.color == color),
                });
            }
        }
    }
}

fn diameter_px(view: &Camera, at: &Vector3<f64>, diameter_m: f64) -> f64 {
    let focal_px = (view.intrinsics.fx_px * view.intrinsics.fy_px).abs().sqrt();
    focal_px * diameter_m / (at - view.centre_in_world()).norm()
}

fn within(injection: &Injection, frames: &[DetectedFrame]) -> std::ops::Range<usize> {
    injection.frames.start.min(frames.len())..injection.frames.end.min(frames.len())
}

fn dropped(injection: &mut Injection, frames: &mut Vec<DetectedFrame>) {
    let range = within(injection, frames);
    let share = injection.between(0.1, 1.0);
    let mut k = 0;
    frames.retain(|_| {
        let is_lost = range.contains(&k) && (k == range.start || injection.random.uniform() < share);
        k += 1;
        !is_lost
    });
}

fn duplicated(injection: &mut Injection, frames: &mut [DetectedFrame]) {
    let share = injection.between(0.1, 1.0);
    let mut is_copy = false;
    for k in within(injection, frames) {
        is_copy = k > 0 && !is_copy && (k == injection.frames.start || injection.random.uniform() < share);
        if is_copy {
            frames[k].seen = frames[k - 1].seen.clone();
        }
    }
}

fn late(injection: &mut Injection, frames: &mut [DetectedFrame]) {
    let share = injection.between(0.1, 1.0);
    let mut k = injection.frames.start;
    let range = within(injection, frames);
    while k + 1 < range.end {
        let by = 1 + (injection.random.uniform() * 3.0) as usize;
        let to = (k + by).min(frames.len() - 1);
        if k == range.start || injection.random.uniform() < share {
            frames[k..=to].rotate_left(1);
        }
        k = to + 1;
    }
}

fn reordered(injection: &mut Injection, frames: &mut [DetectedFrame]) {
    let share = injection.between(0.1, 1.0);
    let range = within(injection, frames);
    let mut k = range.start;
    while k + 1 < range.end {
        if k == range.start || injection.random.uniform() < share {
            let (first, second) = frames.split_at_mut(k + 1);
            std::mem::swap(&mut first[k].seen, &mut second[0].seen);
        }
        k += 2;
    }
}

fn stepped(injection: &mut Injection, frames: &mut [DetectedFrame]) {
    let size_ns = (injection.between(5e-3, 0.2) * 1e9) as i64;
    let step_ns = if injection.is_other_kind { size_ns } else { -size_ns };
    let range = within(injection, frames);
    frames[range].iter_mut().for_each(|f| f.stamp_ns += step_ns);
}

fn frozen(injection: &mut Injection, frames: &mut [DetectedFrame]) {
    let range = within(injection, frames);
    let Some(image) = frames.get(range.start).map(|f| f.seen.clone()) else { return };
    for frame in &mut frames[range] {
        frame.seen.clone_from(&image);
        // An encoder that comes after what froze leaves a little of its own.
        if injection.is_other_kind {
            for seen in &mut frame.seen {
                seen.pixel += Vector2::new(injection.random.normal(), injection.random.normal()) * 0.01;
            }
        }
    }
}

fn hidden(injection: &mut Injection, cameras: &mut [Vec<DetectedFrame>], colors: usize) {
    let Some(visible) = injection.fault.visible() else { return };
    for (camera, frames) in cameras.iter_mut().enumerate() {
        // A walker before all cameras at once, or before one.
        if injection.is_other_kind && camera != injection.camera {
            continue;
        }
        let first = injection.random.uniform();
        let (from, range) = ((first * colors as f64) as usize, within(injection, frames));
        for frame in &mut frames[range] {
            frame.seen.retain(|s| (s.color + colors - from) % colors < visible);
        }
    }
}

fn exchanged(injection: &mut Injection, cameras: &mut [Vec<DetectedFrame>], colors: usize) {
    let a = ((injection.random.uniform() * colors as f64) as usize).min(colors - 1);
    let b = (a + 1 + (injection.random.uniform() * (colors - 1) as f64) as usize) % colors;
    for frame in cameras.iter_mut().flatten() {
        for seen in &mut frame.seen {
            seen.color = if seen.color == a {
                b
            } else if seen.color == b {
                a
            } else {
                seen.color
            };
        }
    }
}

fn not_numbers(injection: &mut Injection, frames: &mut [DetectedFrame]) {
    let share = injection.between(0.05, 1.0);
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX];
    let range = within(injection, frames);
    for (k, seen) in frames[range].iter_mut().flat_map(|f| &mut f.seen).enumerate() {
        let (is_spoilt, kind) = (injection.random.uniform() < share, injection.random.uniform());
        if k > 0 && !is_spoilt {
            continue;
        }
        let value = bad[((kind * 40.0) as usize) % 4];
        match (kind * 6.0) as usize {
            0 => seen.pixel.x = value,
            1 => seen.pixel.y = value,
            2 => seen.covariance_px2[(0, 0)] = value,
            3 => seen.covariance_px2 = -seen.covariance_px2,
            4 => seen.covariance_px2 = Matrix2::zeros(),
            _ => seen.diameter_px = value,
        }
    }
}
