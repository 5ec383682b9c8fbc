//! Two cameras, a body that is carried about before them, and pictures of its balls drawn as discs.

use mavsight_flight::Vehicle;
use mavsight_geometry::{
    Camera, ControlPoint, EulerAngles, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, Vector2, Vector3,
    world_from_body,
};
use mavsight_link::{Event, Fix};
use mavsight_live::{CameraSetup, FlightClock, Listener, Listeners, Next, Pace, Setup, Source};
use mavsight_pose::{CameraClock, CameraControl, Rig, calibrate};
use mavsight_vision::Frame;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

pub(crate) const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

pub(crate) fn rig() -> Rig {
    let k = Intrinsics::from_horizontal_fov(SIZE, 30f64.to_radians());
    let side = |i: usize| (i % 3) as f64 * 1.5 - 1.5;
    let points: Vec<Vector3<f64>> =
        (0..27).map(|i| Vector3::new(side(i), side(i / 3), side(i / 9) + 1.5)).collect();
    let control = |(at, name): (Vector3<f64>, &str)| {
        let camera = Camera::looking_at(at, Vector3::new(0.0, 0.0, 1.5), k, SIZE);
        let seen = points.iter().map(|p| ControlPoint {
            name: String::new(),
            point_in_world_m: *p,
            pixel: camera.project(p).expect("as staged").pixel,
            pixel_cov_px2: Matrix2::identity() * 1e-5,
        });
        CameraControl {
            name: name.into(),
            size: SIZE,
            points: seen.collect(),
            ball_radius_m: vec![0.0; 27],
            survey_std_m: vec![0.0; 27],
        }
    };
    let places = [(Vector3::new(4.5, -4.5, 1.5), "cam1"), (Vector3::new(-4.5, -4.5, 2.0), "cam2")];
    calibrate(&places.map(control)).expect("as staged")
}

pub(crate) fn pose(t_s: f64) -> Isometry3<f64> {
    let s = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * t_s + phase).sin();
    let place = Vector3::new(0.15 * s(0.37, 0.0), 0.1 * s(0.43, 1.0), 1.5 + 0.08 * s(0.53, 2.0));
    let angles = EulerAngles {
        phi_rad: 0.1 * s(0.61, 0.4),
        theta_rad: 0.1 * s(0.47, 1.4),
        psi_rad: -0.4 + 0.1 * s(0.23, 0.0),
    };
    world_from_body(place, angles)
}

fn linear(sample: u8) -> f64 {
    (f64::from(sample) / 255.0).powf(2.2)
}

/// What a camera sees: discs of the markers' colours on grey, or grey alone.
pub(crate) fn picture(camera: &Camera, at: Option<&Isometry3<f64>>, index: usize) -> Frame {
    let (width, height) = (SIZE.width_px as usize, SIZE.height_px as usize);
    // A pattern that changes, so that no frame repeats the one before.
    let mut rgb: Vec<u8> =
        (0..width * height * 3).map(|k| 90 + ((k / 3 * 7 + index * 13) % 5) as u8).collect();
    let vehicle = Vehicle::paper();
    for ball in vehicle.marker.iter().filter(|_| at.is_some()) {
        let centre = (at.expect("as staged") * Point3::from(Vector3::from(ball.position_m))).coords;
        let middle = camera.project_ball(&centre, 0.5 * ball.diameter_m).expect("as staged").pixel;
        let depth_m = (camera.cam_from_world * Point3::from(centre)).z;
        let radius = camera.intrinsics.fx_px * 0.5 * ball.diameter_m / depth_m;
        let color = ball.color.rgb();
        let (x0, y0) = ((middle.x - radius - 2.0) as usize, (middle.y - radius - 2.0) as usize);
        for y in y0..y0 + (2.0 * radius) as usize + 5 {
            for x in x0..x0 + (2.0 * radius) as usize + 5 {
                let inside = |k: usize| {
                    let part = Vector2::new((k % 8) as f64, (k / 8) as f64) / 8.0 - Vector2::repeat(0.4375);
                    (Vector2::new(x as f64, y as f64) + part - middle).norm() <= radius
                };
                let share = (0..64).filter(|k| inside(*k)).count() as f64 / 64.0;
                let at = 3 * (y * width + x);
                for (sample, own) in rgb[at..at + 3].iter_mut().zip(&color) {
                    let mixed = linear(*sample) * (1.0 - share) + linear(*own) * share;
                    *sample = (mixed.powf(1.0 / 2.2) * 255.0).round() as u8;
                }
            }
        }
    }
    Frame::from_rgb(SIZE, rgb).expect("as staged")
}

/// Frames of both cameras with their stamps.
pub(crate) fn film(rig: &Rig, frames: usize, rate_hz: f64) -> Vec<Vec<(i64, Frame)>> {
    let of = |camera: usize| {
        let frame = |k: usize| {
            let t_s = k as f64 / rate_hz;
            ((t_s * 1e9).round() as i64, picture(&rig.cameras[camera].camera, Some(&pose(t_s)), k))
        };
        (0..frames).map(frame).collect()
    };
    (0..rig.cameras.len()).map(of).collect()
}

/// Everything that was heard.
#[derive(Default, Clone)]
pub(crate) struct Heard {
    pub(crate) fixes: Arc<Mutex<Vec<Fix>>>,
    pub(crate) events: Arc<Mutex<Vec<Event>>>,
}

impl Listener for Heard {
    fn fix(&mut self, fix: &Fix) {
        self.fixes.lock().expect("as staged").push(fix.clone());
    }

    fn event(&mut self, event: &Event) {
        self.events.lock().expect("as staged").push(event.clone());
    }
}

/// A source that does what a closure says.
pub(crate) struct Scripted<F>(pub(crate) F);

impl<F: FnMut() -> Next + Send> Source for Scripted<F> {
    fn next(&mut self) -> Next {
        (self.0)()
    }
}

pub(crate) fn camera(name: &str, open: mavsight_live::Opener, reopens: bool) -> CameraSetup {
    CameraSetup { name: name.into(), open, reopens, clock: CameraClock::default(), readout: Vector2::y() }
}

/// A flight with one listener.
pub(crate) fn setup<'a>(
    (rig, vehicle): (&'a Rig, &'a Vehicle),
    cameras: Vec<CameraSetup>,
    pace: Pace,
    clock: FlightClock,
) -> (Setup<'a>, Heard) {
    let heard = Heard::default();
    let mut listeners = Listeners::default();
    listeners.waiting = pace == Pace::Fast;
    listeners.add(Box::new(heard.clone())).expect("as staged");
    let setup = Setup {
        name: "test",
        rig,
        vehicle,
        cameras,
        pace,
        clock,
        noise: None,
        listeners,
        taps: Vec::new(),
        recorder: Default::default(),
        inputs: None,
        equations: None,
        enough: 0.05,
        stop: Arc::new(AtomicBool::new(false)),
        for_ns: None,
    };
    (setup, heard)
}
