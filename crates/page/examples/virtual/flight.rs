//! A flight that never was: an aircraft that circles in a room before two cameras, is hidden now and then,
//! and is identified on the way.
//!
//! Only what the page needs to be tried: no estimator runs here.

use mavsight_link::{
    CameraState, CameraView, DetectedBall, Event, MarkerView, Parameter, PoseEvent, Scene, Tracking,
};
use mavsight_random::Random;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// Instants a second.
pub(crate) const RATE_HZ: f64 = 60.0;
const WIDTH_PX: u32 = 640;
const HEIGHT_PX: u32 = 480;
/// Columns and rows of a picture for the page.
pub(crate) const PICTURE_PX: (u32, u32) = (WIDTH_PX / 2, HEIGHT_PX / 2);
const FOCAL_PX: f64 = 800.0;

/// A camera that looks at a point.
struct Eye {
    name: &'static str,
    centre: Point3<f64>,
    world_from_cam: Matrix3<f64>,
}

impl Eye {
    fn new(name: &'static str, centre: [f64; 3], target: [f64; 3]) -> Self {
        let forward = (Point3::from(target) - Point3::from(centre)).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        Self { name, centre: centre.into(), world_from_cam: Matrix3::from_columns(&[right, down, forward]) }
    }

    /// Column, row and distance along the axis.
    fn project(&self, point: &Point3<f64>) -> (f64, f64, f64) {
        let in_cam = self.world_from_cam.transpose() * (point - self.centre);
        let (u_px, v_px) = (FOCAL_PX * in_cam.x / in_cam.z, FOCAL_PX * in_cam.y / in_cam.z);
        (u_px + f64::from(WIDTH_PX - 1) / 2.0, v_px + f64::from(HEIGHT_PX - 1) / 2.0, in_cam.z)
    }

    fn ray(&self, u_px: f64, v_px: f64) -> Vector3<f64> {
        let x = (u_px - f64::from(WIDTH_PX - 1) / 2.0) / FOCAL_PX;
        let y = (v_px - f64::from(HEIGHT_PX - 1) / 2.0) / FOCAL_PX;
        self.world_from_cam * Vector3::new(x, y, 1.0)
    }
}

/// The flight.
pub(crate) struct VirtualFlight {
    eyes: [Eye; 2],
    backgrounds: [Vec<[u8; 3]>; 2],
    random: Random,
    /// Whether the aircraft leaves the view now and then, and the second camera stalls.
    pub(crate) has_losses: bool,
    /// Without such losses: whether it is out of view now.
    pub(crate) is_hidden: bool,
    last_seen_s: f64,
    found_s: f64,
}

const MARKERS: [(&str, [u8; 3], [f64; 3]); 4] = [
    ("red", [219, 18, 18], [0.225, 0.225, 0.1]),
    ("green", [20, 170, 60], [0.225, -0.225, 0.1]),
    ("blue", [30, 70, 220], [-0.225, -0.225, 0.1]),
    ("yellow", [235, 200, 30], [-0.225, 0.225, 0.02]),
];
const DIAMETER_M: f64 = 0.05;

impl VirtualFlight {
    pub(crate) fn new(has_losses: bool) -> Self {
        let eyes = [
            Eye::new("cam1", [-2.4, -2.2, 2.0], [0.2, 0.2, 0.95]),
            Eye::new("cam2", [2.7, -2.3, 2.1], [0.2, 0.2, 0.95]),
        ];
        let backgrounds = [background(&eyes[0]), background(&eyes[1])];
        Self {
            eyes,
            backgrounds,
            random: Random::new(1, 0),
            has_losses,
            is_hidden: false,
            last_seen_s: f64::NEG_INFINITY,
            found_s: 0.0,
        }
    }

    pub(crate) fn scene(&self) -> Event {
        let (w, h) = (f64::from(WIDTH_PX) - 0.5, f64::from(HEIGHT_PX) - 0.5);
        let cameras = self.eyes.iter().map(|eye| CameraView {
            name: eye.name.to_owned(),
            width_px: WIDTH_PX,
            height_px: HEIGHT_PX,
            centre_m: eye.centre.coords.into(),
            corners: [(-0.5, -0.5), (w, -0.5), (w, h), (-0.5, h)]
                .map(|(u_px, v_px)| eye.ray(u_px, v_px).into()),
        });
        let markers = MARKERS.map(|(name, rgb, in_body_m)| MarkerView {
            name: name.to_owned(),
            rgb,
            in_body_m,
            diameter_m: DIAMETER_M,
        });
        Event::Scene(Scene {
            name: "virtual room".to_owned(),
            cameras: cameras.collect(),
            markers: markers.into(),
            volume_m: [[-2.0, -1.5, 0.0], [2.0, 2.0, 2.2]],
        })
    }

    /// Where the aircraft is: an ellipse with harmonics, nose along it, and a pitching and rolling that
    /// excites the parameters.
    fn truth(t_s: f64) -> (Point3<f64>, [f64; 3]) {
        let angle = 0.55 * t_s;
        let position =
            Point3::new(0.2 + 0.85 * angle.cos(), 0.2 + 0.65 * angle.sin(), 1.0 + 0.2 * (0.7 * t_s).sin());
        let yaw = angle.sin().atan2(angle.cos()) + 0.1 * (1.3 * t_s).sin();
        // Towards X the nose has psi = 0, and psi > 0 turns it towards -Y.
        let psi = -(yaw + std::f64::consts::FRAC_PI_2);
        let psi = psi.sin().atan2(psi.cos());
        (position, [0.12 * (1.9 * t_s).sin(), 0.1 * (2.3 * t_s + 0.4).sin(), psi])
    }

    fn attitude([phi, theta, psi]: [f64; 3]) -> UnitQuaternion<f64> {
        let level_from_body = Rotation3::from_euler_angles(phi, theta, psi);
        let world_from_level = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        UnitQuaternion::from_rotation_matrix(&(world_from_level * level_from_body))
    }

    /// Whether a camera sees a ball, as somebody walks by and one lens is dark for a while.
    fn is_seen(&self, camera: usize, marker: usize, t_s: f64) -> bool {
        if !self.has_losses {
            return !self.is_hidden;
        }
        let phase = t_s.rem_euclid(24.0);
        let is_hidden = (13.0..15.2).contains(&phase);
        let is_behind_another = camera == 1 && marker == 2 && (t_s * 1.7).sin() > 0.85;
        !is_hidden && !is_behind_another && !self.is_stalled(camera, t_s)
    }

    fn is_stalled(&self, camera: usize, t_s: f64) -> bool {
        self.has_losses && camera == 1 && (19.0..20.5).contains(&t_s.rem_euclid(24.0))
    }

    /// All events of one instant; `captured_ns` is the time of day.
    pub(crate) fn step(&mut self, sequence: u64, captured_ns: i64) -> Vec<Event> {
        let t_s = sequence as f64 / RATE_HZ;
        let (position, angles) = Self::truth(t_s);
        let attitude = Self::attitude(angles);
        let mut events = Vec::new();
        let mut pairs = 0;
        let mut sum_px2 = 0.0;
        for camera in 0..2 {
            let mut seen = Vec::new();
            for (marker, (_, _, in_body)) in MARKERS.iter().enumerate() {
                if !self.is_seen(camera, marker, t_s) {
                    continue;
                }
                let (u_px, v_px, depth_m) =
                    self.eyes[camera].project(&(position + attitude * Vector3::from(*in_body)));
                let residual_px = [0.08 * self.random.normal(), 0.08 * self.random.normal()];
                sum_px2 += residual_px.iter().map(|r| r * r).sum::<f64>();
                pairs += 1;
                seen.push(DetectedBall {
                    u_px: u_px + residual_px[0],
                    v_px: v_px + residual_px[1],
                    diameter_px: FOCAL_PX * DIAMETER_M / depth_m,
                    marker: Some(marker),
                    residual_px: Some(residual_px),
                });
            }
            if camera == 0 {
                // A decoy.
                let (u_px, v_px, _) = self.eyes[0].project(&Point3::new(1.2, 1.9, 0.6));
                seen.push(DetectedBall { u_px, v_px, diameter_px: 18.0, marker: None, residual_px: None });
            }
            if !self.is_stalled(camera, t_s) {
                events.push(Event::Detections { camera, t_s, seen });
            }
        }
        let residual_px = (pairs > 3).then(|| (sum_px2 / f64::from(2 * pairs)).sqrt());
        events.push(Event::Pose(Box::new(self.pose(sequence, captured_ns, residual_px))));
        if sequence.is_multiple_of(15) {
            events.push(Self::parameters(t_s));
        }
        if sequence.is_multiple_of(30) {
            events.extend((0..2).map(|camera| self.camera(camera, t_s)));
        }
        events
    }

    fn pose(&mut self, sequence: u64, captured_ns: i64, residual_px: Option<f64>) -> PoseEvent {
        let t_s = sequence as f64 / RATE_HZ;
        let valid = residual_px.is_some();
        let was_lost = t_s - self.last_seen_s > 0.2;
        if valid && was_lost {
            self.found_s = t_s;
        }
        let tracking = match (valid, self.last_seen_s.is_finite()) {
            (false, false) => Tracking::Acquiring,
            (false, true) if was_lost => Tracking::Lost,
            (true, _) if self.found_s > 1.0 && t_s - self.found_s < 1.0 => Tracking::Reacquired,
            _ => Tracking::Tracking,
        };
        if valid {
            self.last_seen_s = t_s;
        }
        let (position, angles) = Self::truth(t_s);
        let attitude = Self::attitude(angles);
        let step_s = 1e-4;
        let later = Self::attitude(Self::truth(t_s + step_s).1);
        let rates = (attitude.inverse() * later).scaled_axis() / step_s;
        let velocity = attitude.inverse() * (Self::truth(t_s + step_s).0 - position) / step_s;
        // Worse along the cameras' depth, and where one marker is hidden.
        let position_std_m = 1.0e-3 * (1.0 + 0.5 * (0.3 * t_s).sin());
        let mut covariance = [0.0; 21];
        let diagonal = [1.0, 2.2, 0.7].map(|f: f64| (f * position_std_m).powi(2));
        let turns = [5e-3_f64, 5e-3, 3e-3].map(|std| std * std);
        for (at, value) in [0, 6, 11, 15, 18, 20].into_iter().zip(diagonal.into_iter().chain(turns)) {
            covariance[at] = value;
        }
        covariance[1] = 0.6 * (diagonal[0] * diagonal[1]).sqrt();
        let mut noise = || self.random.normal();
        let shaken = position + Vector3::from_fn(|i, _| diagonal[i].sqrt() * noise());
        let euler = [0, 1, 2].map(|i| angles[i] + turns[i].sqrt() * noise());
        let rates = [0, 1, 2].map(|i| rates[i] + 0.02 * noise());
        let reported = Self::attitude(euler).into_inner().coords;
        PoseEvent {
            t_s,
            sequence,
            captured_ns,
            valid,
            tracking,
            position_m: valid.then(|| shaken.coords.into()),
            attitude: valid.then(|| [reported.w, reported.x, reported.y, reported.z]),
            euler_rad: valid.then_some(euler),
            covariance: valid.then_some(covariance),
            velocity_in_body_m_s: valid.then(|| velocity.into()),
            velocity_std_m_s: valid.then_some([0.01; 3]),
            rates_rad_s: valid.then_some(rates),
            rates_std_rad_s: valid.then_some([0.02; 3]),
            residual_px,
            latency_ms: 0.7 + 0.1 * noise().abs(),
            reason: (!valid).then(|| "no marker is seen by two cameras".to_owned()),
        }
    }

    fn camera(&self, camera: usize, t_s: f64) -> Event {
        let stalled = self.is_stalled(camera, t_s);
        let frames = RATE_HZ as usize;
        let markers = (0..MARKERS.len()).map(|marker| {
            let seen =
                (0..frames).filter(|&k| self.is_seen(camera, marker, t_s - k as f64 / RATE_HZ)).count();
            seen as f64 / frames as f64
        });
        Event::Camera {
            camera,
            state: if stalled { CameraState::Stalled } else { CameraState::Running },
            rate_hz: if stalled { 0.0 } else { RATE_HZ },
            latency_ms: 0.5 + 0.1 * camera as f64,
            missing: 0,
            dropped: if camera == 1 { (t_s / 9.0) as u64 } else { 0 },
            markers: markers.collect(),
            reason: stalled.then(|| "No frame for two intervals: look at its cable.".to_owned()),
        }
    }

    /// Estimates that come nearer to the truth as the flight goes on; the last is excited late.
    fn parameters(t_s: f64) -> Event {
        let truths = [
            ("C_X.alpha_u", 3.1e-3, 0.5),
            ("C_X.u", -1.25e-2, 0.6),
            ("C_Z.0", -1.216e-2, 0.1),
            ("C_Z.w", -2.4e-2, 0.7),
            ("C_m.alpha_l", 1.9e-3, 0.9),
            ("C_m.q", -0.42, 1.6),
            ("flap_time_flybar_s", 3.02, 2.2),
            ("C_m.u", 7.3e-4, 4.0),
        ];
        let parameters: Vec<Parameter> = truths
            .iter()
            .enumerate()
            .map(|(k, (name, truth, difficulty))| {
                let known = t_s > 1.5 * difficulty;
                let relative = difficulty / (1.0 + 0.8 * t_s);
                let off = 0.45 * relative * (0.2 * t_s + k as f64).sin();
                Parameter {
                    name: (*name).to_owned(),
                    value: known.then_some(truth * (1.0 + off)),
                    half_width: known.then_some((truth * relative).abs()),
                    enough: known && relative < 0.05,
                }
            })
            .collect();
        let enough = parameters.iter().all(|parameter| parameter.enough);
        Event::Parameters { t_s, parameters, enough }
    }

    /// What a camera's picture of an instant, of half its columns and rows, shows: sRGB of a column and row.
    pub(crate) fn picture(&self, camera: usize, t_s: f64) -> impl Fn(usize, usize) -> [u8; 3] {
        let eye = &self.eyes[camera];
        let (position, angles) = Self::truth(t_s);
        let attitude = Self::attitude(angles);
        let mut balls: Vec<(f64, f64, f64, [u8; 3])> = MARKERS
            .iter()
            .enumerate()
            .filter(|(marker, _)| self.is_seen(camera, *marker, t_s))
            .map(|(_, (_, rgb, in_body))| {
                let (u_px, v_px, depth_m) = eye.project(&(position + attitude * Vector3::from(*in_body)));
                (u_px, v_px, FOCAL_PX * DIAMETER_M / 2.0 / depth_m, *rgb)
            })
            .collect();
        if camera == 0 {
            let (u_px, v_px, _) = eye.project(&Point3::new(1.2, 1.9, 0.6));
            balls.push((u_px, v_px, 9.0, [200, 40, 40]));
        }
        let background = &self.backgrounds[camera];
        move |x, y| {
            let (u_px, v_px) = (2.0 * x as f64 + 0.5, 2.0 * y as f64 + 0.5);
            for &(ball_u, ball_v, radius, rgb) in &balls {
                let (du, dv) = ((u_px - ball_u) / radius, (v_px - ball_v) / radius);
                let square = du * du + dv * dv;
                if square < 1.0 {
                    let shade = 0.55 + 0.45 * ((1.0 - square).sqrt() - 0.4 * dv).clamp(0.0, 1.0);
                    return rgb.map(|channel| (f64::from(channel) * shade) as u8);
                }
            }
            background[y * PICTURE_PX.0 as usize + x]
        }
    }
}

/// What a camera sees of the empty room.
fn background(eye: &Eye) -> Vec<[u8; 3]> {
    let (columns, rows) = PICTURE_PX;
    let pixels = (0..rows)
        .flat_map(|y| (0..columns).map(move |x| (2.0 * f64::from(x) + 0.5, 2.0 * f64::from(y) + 0.5)));
    pixels.map(|(u_px, v_px)| room(&eye.centre, &eye.ray(u_px, v_px))).collect()
}

/// The floor with its boards, or a wall.
fn room(centre: &Point3<f64>, ray: &Vector3<f64>) -> [u8; 3] {
    let to_floor = -centre.z / ray.z;
    let to_wall = if ray.y > 0.0 { (3.0 - centre.y) / ray.y } else { f64::INFINITY };
    if to_floor > 0.0 && to_floor < to_wall {
        let at = centre + ray * to_floor;
        let is_dark = (at.x.floor() + at.y.floor()).rem_euclid(2.0) < 1.0;
        return if is_dark { [96, 92, 86] } else { [112, 107, 100] };
    }
    let at = centre + ray * to_wall.min(20.0);
    let light = 150.0 + 14.0 * at.z.clamp(0.0, 3.0);
    [light as u8, light as u8, (light * 1.02) as u8]
}
