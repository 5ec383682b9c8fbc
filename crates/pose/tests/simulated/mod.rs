//! Flights that are known exactly, seen by rigs that are known only as well as a calibration knows them.

pub(crate) mod ruler;

use mavsight_flight::Vehicle;
use mavsight_geometry::{
    Camera, ControlPoint, ImageSize, Intrinsics, Isometry3, Matrix2, Point3, Vector2, Vector3,
    world_from_body,
};
use mavsight_pose::{
    BodyMarker, CameraControl, MarkerObservation, PoseEstimator, PoseSample, Rig, calibrate,
};
pub(crate) use mavsight_random::Random;
use mavsight_simulator::{FlightState, Maneuver, Scenario, simulate};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// Standard deviation of a ball's centre in a frame of flight, and of a control point's in a still of 0.5 px
/// blur.
pub(crate) const PIXEL_STD: f64 = 0.15;
const CONTROL_STD: f64 = 0.1;
const SIZE: ImageSize = ImageSize { width_px: 640, height_px: 480 };

/// The paper's pair at 90°, an oblique pair at 60°, three cameras around.
pub(crate) fn rigs() -> [(&'static str, Rig); 3] {
    let at = |centres: &[[f64; 3]]| {
        let k = Intrinsics::from_horizontal_fov(SIZE, 53f64.to_radians());
        let target = Vector3::new(0.0, 0.0, 1.5);
        uncertain(centres.iter().map(|c| Camera::looking_at(Vector3::from(*c), target, k, SIZE)).collect())
    };
    [
        ("pair at 90 degrees", at(&[[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]])),
        ("oblique pair at 60 degrees", at(&[[2.9, -5.0, 2.6], [-2.9, -5.0, 2.6]])),
        ("three cameras", at(&[[4.5, -4.5, 1.5], [-4.5, -4.5, 2.5], [0.5, 6.0, 3.0]])),
    ]
}

fn frame() -> Vec<Vector3<f64>> {
    let side = |i: usize| (i % 3) as f64 * 1.5 - 1.5;
    (0..27).map(|i| Vector3::new(side(i), side(i / 3), side(i / 9) + 1.5)).collect()
}

/// A rig with the covariance that a least-squares fit of eleven parameters to the control frame leaves.
fn uncertain(cameras: Vec<Camera>) -> Rig {
    let controls: Vec<CameraControl> = cameras
        .iter()
        .enumerate()
        .map(|(i, camera)| CameraControl {
            name: format!("cam{}", i + 1),
            size: SIZE,
            points: frame()
                .iter()
                .map(|p| ControlPoint {
                    name: String::new(),
                    point_in_world_m: *p,
                    pixel: camera.project(p).expect("in view").pixel,
                    pixel_cov_px2: Matrix2::identity() * CONTROL_STD * CONTROL_STD,
                })
                .collect(),
            ball_radius_m: vec![0.0; 27],
            survey_std_m: vec![0.0; 27],
        })
        .collect();
    let mut rig = calibrate(&controls).expect("a rig");
    rig.uncertainty = DMatrix::zeros(16 * cameras.len(), 11 * cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        rig.cameras[i].camera = *camera;
        let mut information = SMatrix::<f64, 11, 11>::zeros();
        for point in frame() {
            let j = camera.d_pixel_d_camera(&point).expect("in view").fixed_columns::<11>(0) / CONTROL_STD;
            information += j.transpose() * j;
        }
        let inverse = information.try_inverse().expect("a determined camera");
        let root = ((inverse + inverse.transpose()) * 0.5).cholesky().expect("a covariance").l();
        rig.uncertainty.view_mut((16 * i, 11 * i), (11, 11)).copy_from(&root);
    }
    rig
}

/// The paper's square of four balls, and where they are.
pub(crate) fn square() -> Vec<BodyMarker> {
    [[0.225, 0.225], [0.225, -0.225], [-0.225, -0.225], [-0.225, 0.225]]
        .iter()
        .enumerate()
        .map(|(i, p)| BodyMarker {
            name: format!("m{i}"),
            marker_in_body_m: Vector3::new(p[0], p[1], 0.1),
            radius_m: 0.025,
        })
        .collect()
}

/// Hover with doublets and a 3-2-1-1 in the swash-plate and the rotor speeds, at random times.
pub(crate) fn flight(random: &mut Random) -> Vec<FlightState> {
    let mut maneuver = Vec::new();
    for (input, largest) in [("delta_lon", 5.0), ("delta_lat", 4.0), ("omega_u", 1.5)] {
        let channel = input.to_owned();
        let amplitude = largest * random.between(-1.0, 1.0);
        let start_s = random.between(0.5, 3.0);
        maneuver.push(Maneuver::Doublet { channel, start_s, pulse_s: random.between(0.3, 0.8), amplitude });
    }
    let amplitude = random.between(-2.0, 2.0);
    maneuver.push(Maneuver::ThreeTwoOneOne {
        channel: "delta_lon".to_owned(),
        start_s: 3.0,
        unit_s: 0.25,
        amplitude,
    });
    let scenario = Scenario {
        duration_s: 6.0,
        heading_deg: random.between(0.0, 360.0),
        position_m: [random.between(-0.3, 0.3), random.between(-0.3, 0.3), 1.5],
        maneuver,
        ..Scenario::paper()
    };
    let vehicle = Vehicle::paper();
    let inputs = scenario.inputs(&vehicle).expect("inputs");
    let start = scenario.start(&vehicle).expect("a start");
    simulate(&vehicle, &inputs, &start, &scenario.frame_times_s()).expect("a flight")
}

pub(crate) fn pose_of(state: &FlightState) -> Isometry3<f64> {
    world_from_body(state.position_in_world_m, state.attitude)
}

/// The cameras with one draw of the rig's uncertainty.
pub(crate) fn true_cameras(rig: &Rig, random: &mut Random) -> Vec<Camera> {
    let along = DVector::from_fn(rig.uncertainty.ncols(), |_, _| random.normal());
    let change = &rig.uncertainty * along;
    let moved = |(i, c): (usize, &mavsight_pose::RigCamera)| {
        c.camera.moved(&change.fixed_rows::<16>(16 * i).into_owned())
    };
    rig.cameras.iter().enumerate().map(moved).collect()
}

/// Observations by the cameras, of which a twentieth is missing.
pub(crate) fn observed(
    cameras: &[Camera],
    markers: &[BodyMarker],
    flight: &[FlightState],
    random: &mut Random,
) -> Vec<Vec<MarkerObservation>> {
    let mut out = Vec::with_capacity(flight.len());
    for state in flight {
        let pose = pose_of(state);
        let mut seen = Vec::new();
        for (camera, view) in cameras.iter().enumerate() {
            for (marker, ball) in markers.iter().enumerate() {
                let centre = (pose * Point3::from(ball.marker_in_body_m)).coords;
                let Ok(projection) = view.project_ball(&centre, ball.radius_m) else { continue };
                let noise = Vector2::new(random.normal(), random.normal()) * PIXEL_STD;
                let lost = random.uniform() < 0.05;
                if !lost && view.size.contains(&projection.pixel, 3.0) {
                    seen.push(MarkerObservation {
                        t_ns: (state.t_s * 1e9).round() as i64,
                        camera,
                        marker,
                        pixel: projection.pixel + noise,
                        covariance_px2: Matrix2::identity() * PIXEL_STD * PIXEL_STD,
                    });
                }
            }
        }
        out.push(seen);
    }
    out
}

/// Poses of all instants, each with the one before as a hint.
pub(crate) fn poses(
    estimator: &PoseEstimator,
    flight: &[FlightState],
    observed: &[Vec<MarkerObservation>],
) -> Vec<PoseSample> {
    let mut previous: Option<Isometry3<f64>> = None;
    let one = |(state, seen): (&FlightState, &Vec<MarkerObservation>)| {
        let t_ns = (state.t_s * 1e9).round() as i64;
        let estimate = estimator.estimate(t_ns, seen, previous.as_ref());
        previous = estimate.as_ref().ok().map(|e| e.world_from_body).or(previous);
        PoseSample { t_ns, estimate }
    };
    flight.iter().zip(observed).map(one).collect()
}

/// Errors of a motion sample: position, turn, velocity, rates, specific force, angular acceleration.
pub(crate) fn error(
    sample: &mavsight_pose::MotionSample,
    truth: &FlightState,
    gravity: f64,
) -> SVector<f64, 18> {
    let pose = pose_of(truth);
    let (v, w) = (truth.velocity_in_body_m_s, truth.rates_rad_s);
    let force = truth.velocity_rate_m_s2 + w.cross(&v) + pose.rotation.inverse() * Vector3::z() * gravity;
    let parts = [
        sample.world_from_body.translation.vector - pose.translation.vector,
        (pose.rotation.inverse() * sample.world_from_body.rotation).scaled_axis(),
        sample.velocity_in_body_m_s - v,
        sample.rates_rad_s - w,
        sample.specific_force_m_s2 - force,
        sample.angular_acceleration_rad_s2 - truth.angular_acceleration_rad_s2,
    ];
    SVector::from_fn(|i, _| parts[i / 3][i % 3])
}

/// Shares of truths inside the 95 % intervals and mean normalised errors squared per coordinate (1 is exact).
#[derive(Debug, Default, Clone)]
pub(crate) struct Tally {
    inside: [f64; 7],
    nees: [f64; 7],
    squares: [f64; 7],
    count: [f64; 7],
    unmeasured: usize,
}

/// What a tally has, in this order.
pub(crate) const ROWS: [&str; 7] = [
    "single pose, position m",
    "single pose, attitude rad",
    "position m",
    "attitude rad",
    "velocity m/s",
    "rates rad/s",
    "specific force m/s2",
];

impl Tally {
    fn add(&mut self, row: usize, error: &Vector3<f64>, covariance: &nalgebra::Matrix3<f64>) {
        for k in 0..3 {
            self.inside[row] += f64::from(error[k].abs() <= 1.959_964 * covariance[(k, k)].sqrt());
        }
        let solved = covariance.cholesky().map_or(f64::NAN, |c| error.dot(&c.solve(error)));
        self.nees[row] += solved;
        self.squares[row] += error.norm_squared();
        self.count[row] += 3.0;
    }

    pub(crate) fn share(&self, row: usize) -> f64 {
        self.inside[row] / self.count[row]
    }

    pub(crate) fn nees(&self, row: usize) -> f64 {
        self.nees[row] / self.count[row]
    }

    pub(crate) fn rms(&self, row: usize) -> f64 {
        (self.squares[row] / self.count[row]).sqrt()
    }

    pub(crate) fn unmeasured(&self) -> usize {
        self.unmeasured
    }

    /// One flight seen by one draw of a rig; eight frames in a row are lost.
    pub(crate) fn film(&mut self, rig: &Rig, random: &mut Random) {
        self.film_with_bias(rig, 0.0, random);
    }

    /// [`Tally::film`] with a constant error of each centre; returns the standard deviation of those that the
    /// flight shows.
    pub(crate) fn film_with_bias(&mut self, rig: &Rig, bias_px: f64, random: &mut Random) -> f64 {
        let gravity = Vehicle::paper().environment.gravity_m_s2;
        let states = flight(random);
        let cameras = true_cameras(rig, random);
        let mut seen = observed(&cameras, &square(), &states, random);
        let lost = (random.uniform() * (states.len() - 8) as f64) as usize;
        seen[lost..lost + 8].iter_mut().for_each(Vec::clear);
        let mut estimator = PoseEstimator::new(rig, &square());
        let mut measured = poses(&estimator, &states, &seen);
        let mut found_px = 0.0;
        if bias_px > 0.0 {
            let bias: Vec<Vector2<f64>> = (0..4 * cameras.len())
                .map(|_| Vector2::new(random.normal(), random.normal()) * bias_px)
                .collect();
            seen.iter_mut().flatten().for_each(|o| o.pixel += bias[4 * o.camera + o.marker]);
            measured = poses(&estimator, &states, &seen);
            found_px = estimator.centre_bias_px(&seen.concat().iter().collect(), &measured).expect("a bias");
            estimator = estimator.with_centre_bias(found_px).expect("a bias");
            measured = poses(&estimator, &states, &seen);
        }
        self.count_film(&measured, &states, gravity);
        found_px
    }

    fn count_film(&mut self, poses: &[PoseSample], states: &[FlightState], gravity: f64) {
        let motion = mavsight_pose::smooth(poses, gravity).expect("a motion");
        for ((pose, sample), truth) in poses.iter().zip(&motion.samples).zip(states) {
            let smoothed = error(sample, truth, gravity);
            if let Ok(e) = &pose.estimate {
                let mut single = sample.clone();
                single.world_from_body = e.world_from_body;
                let err = error(&single, truth, gravity);
                for k in 0..2 {
                    self.add(
                        k,
                        &err.fixed_rows::<3>(3 * k).into_owned(),
                        &e.covariance().fixed_view::<3, 3>(3 * k, 3 * k).into_owned(),
                    );
                }
            } else {
                self.unmeasured += 1;
            }
            for k in 0..5 {
                self.add(
                    2 + k,
                    &smoothed.fixed_rows::<3>(3 * k).into_owned(),
                    &sample.covariance.quantity(k),
                );
            }
        }
    }
}
