//! Virtual laboratories: cameras, control frame, vehicle and the noise of observations.

use crate::ScoreError;
use mavsight_flight::{Color, Vehicle};
use mavsight_geometry::{Camera, ImageSize, Intrinsics, Matrix2, Vector3};
use mavsight_pipeline::{ControlPointRow, Tracked, body_markers, usual_interval_ns};
use mavsight_pose::{PoseError, PoseEstimator, Rig};

/// A camera of a virtual laboratory.
#[derive(Debug, Clone)]
pub struct VirtualCamera {
    /// Name.
    pub name: String,
    /// Pose, lens and image size.
    pub camera: Camera,
    /// By row of the control table: whether it is seen.
    pub sees: Vec<bool>,
    /// Standard deviation of one pixel coordinate of a control point.
    pub control_std_px: f64,
}

/// Noise of the observations of one marker in one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationNoise {
    /// Stated covariances of its centre; each observation draws one of them. Empty: never seen.
    pub stated_px2: Vec<Matrix2<f64>>,
    /// Part of the frames in which it is not seen.
    pub lost_share: f64,
}

/// A laboratory.
#[derive(Debug, Clone)]
pub struct VirtualLab {
    /// Cameras, at least two.
    pub cameras: Vec<VirtualCamera>,
    /// Control frame.
    pub control: Vec<ControlPointRow>,
    /// Aircraft.
    pub vehicle: Vehicle,
    /// Camera by camera, each with one entry a marker.
    pub observations: Vec<ObservationNoise>,
    /// Ratio of the true to the stated standard deviation of the centres' noise.
    pub noise_over_stated: f64,
    /// Standard deviation of a centre's systematic error, each coordinate.
    pub bias_px: f64,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// Whether the cameras are refined from each flight.
    pub refines: bool,
    /// Middle of the places where flights begin.
    pub middle_m: Vector3<f64>,
    /// Half the spread of these places.
    pub around_m: Vector3<f64>,
}

/// Flights begin within this part of the control frame's half-width about its middle.
const START_SHARE: f64 = 0.1;

/// Centres of balls in the flights and stills of the built-in laboratories: what is typical of balls of 5 to
/// 10 px in compressed video and of stills.
const CENTRE_STD_PX: f64 = 0.15;
const CONTROL_STD_PX: f64 = 0.1;

/// Share of the observations that are lost in the built-in laboratories.
const LOST_SHARE: f64 = 0.05;

impl VirtualLab {
    /// Section 3 of the paper: two cameras of 640×480 and 53° across, 6.36 m from the middle of a control
    /// frame of 3 m with a ball of 6 cm at each corner; their axes cross there at a right angle.
    pub fn paper() -> Self {
        let cameras = at(&[[4.5, -4.5, 1.5], [-4.5, -4.5, 1.5]]);
        Self::built_in(cameras, corners(0.0))
    }

    /// Two wide lenses of 77° with barrel distortion on 1920×1080, near and at unlike heights; sixteen points
    /// that a tape measured to 1 mm.
    pub fn wide() -> Self {
        let size = ImageSize { width_px: 1920, height_px: 1080 };
        let mut lens = Intrinsics::from_horizontal_fov(size, 77_f64.to_radians());
        (lens.cx_px, lens.cy_px) = (lens.cx_px + 18.0, lens.cy_px - 11.0);
        let cameras = [[3.6, -2.9, 2.4], [-3.4, -3.2, 1.1]].map(|centre| {
            let mut camera = Camera::looking_at(Vector3::from(centre), TARGET, lens, size);
            (camera.distortion.k1, camera.distortion.k2) = (-0.24, 0.07);
            camera
        });
        let mut control = corners(0.001);
        let inner = corners(0.001).into_iter().map(|row| {
            let [x, y, z] = row.position_m;
            let position_m = [0.6 * y, 0.1 - 0.5 * x, 0.3 + 0.75 * z];
            ControlPointRow { name: format!("inner {}", row.name), position_m, ..row }
        });
        control.extend(inner);
        Self::built_in(cameras.into(), control)
    }

    /// Three cameras of 640×480 and 53° around the paper's control frame, which has four balls more within.
    pub fn three() -> Self {
        let cameras = at(&[[4.5, -4.5, 1.5], [-4.5, -4.5, 2.5], [0.5, 6.0, 3.0]]);
        let mut control = corners(0.0);
        let within = [[0.7, 0.2, 1.1], [-0.6, 0.4, 2.1], [0.1, -0.8, 1.7], [-0.2, 0.5, 0.6]];
        for (row, position_m) in corners(0.0).into_iter().zip(within) {
            control.push(ControlPointRow { name: format!("inner {}", row.name), position_m, ..row });
        }
        Self::built_in(cameras, control)
    }

    fn built_in(cameras: Vec<Camera>, control: Vec<ControlPointRow>) -> Self {
        let vehicle = Vehicle::paper();
        let one = ObservationNoise {
            stated_px2: vec![Matrix2::identity() * CENTRE_STD_PX * CENTRE_STD_PX],
            lost_share: LOST_SHARE,
        };
        Self {
            observations: vec![one; cameras.len() * vehicle.marker.len()],
            cameras: cameras
                .into_iter()
                .enumerate()
                .map(|(k, camera)| VirtualCamera {
                    name: format!("cam{}", k + 1),
                    camera,
                    sees: vec![true; control.len()],
                    control_std_px: CONTROL_STD_PX,
                })
                .collect(),
            control,
            vehicle,
            noise_over_stated: 1.0,
            bias_px: 0.0,
            refines: false,
            frame_rate_hz: 30.0,
            middle_m: TARGET,
            around_m: Vector3::repeat(1.5 * START_SHARE),
        }
    }

    /// The laboratory of a session: its calibrated cameras, its control points where they were seen, its
    /// vehicle and frame rate, and the stated covariances, noise, systematic errors and losses of its
    /// observations.
    ///
    /// # Errors
    /// [`ScoreError::TooFew`] without tracked frames or control points.
    pub fn of_session(
        rig: &Rig,
        control: Vec<ControlPointRow>,
        vehicle: Vehicle,
        tracked: &Tracked,
    ) -> Result<Self, ScoreError> {
        let few = |what, found, needed| ScoreError::TooFew { what, found, needed };
        let interval_ns = usual_interval_ns(tracked.poses.iter().map(|p| p.t_ns)).filter(|n| *n > 0);
        let interval_ns = interval_ns.ok_or_else(|| few("frames", tracked.poses.len(), 2))?;
        let volume = mavsight_pose::control_volume(rig).ok_or_else(|| few("control points", 0, 6))?;
        let estimator = PoseEstimator::new(rig, &body_markers(&vehicle));
        let bias_px = estimator.centre_bias_px(&tracked.observations, &tracked.poses)?;
        let cameras = rig.cameras.iter().map(|c| {
            let seen = |row: &ControlPointRow| c.points.iter().any(|p| p.used && p.name == row.name);
            VirtualCamera {
                name: c.name.clone(),
                camera: c.camera,
                sees: control.iter().map(seen).collect(),
                control_std_px: c.sigma_px,
            }
        });
        Ok(Self {
            cameras: cameras.collect(),
            control: control.clone(),
            observations: noise_of(tracked, rig.cameras.len(), vehicle.marker.len()),
            noise_over_stated: noise_over_stated(&estimator, tracked, bias_px)?,
            bias_px,
            refines: false,
            frame_rate_hz: 1e9 / interval_ns as f64,
            middle_m: 0.5 * (volume.low_m + volume.high_m),
            around_m: 0.5 * START_SHARE * (volume.high_m - volume.low_m),
            vehicle,
        })
    }

    /// Root mean square of the stated standard deviations of one coordinate of a centre.
    pub fn stated_std_px(&self) -> f64 {
        let all = self.observations.iter().flat_map(|s| &s.stated_px2);
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), c| (sum + c.trace() / 2.0, n + 1.0));
        (sum / f64::max(n, 1.0)).sqrt()
    }
}

const TARGET: Vector3<f64> = Vector3::new(0.0, 0.0, 1.5);

fn at(centres: &[[f64; 3]]) -> Vec<Camera> {
    let size = ImageSize { width_px: 640, height_px: 480 };
    let lens = Intrinsics::from_horizontal_fov(size, 53_f64.to_radians());
    centres.iter().map(|c| Camera::looking_at(Vector3::from(*c), TARGET, lens, size)).collect()
}

/// The control frame of 3 m with a 6 cm ball at each corner.
fn corners(std_m: f64) -> Vec<ControlPointRow> {
    let ball = |name: &str, position_m: [f64; 3], color: [u8; 3]| ControlPointRow {
        name: name.to_owned(),
        position_m,
        diameter_m: 0.06,
        std_m,
        color: Color::new(color[0], color[1], color[2]),
    };
    vec![
        ball("red", [-1.5, -1.5, 0.0], [0xd8, 0x1c, 0x1c]),
        ball("green", [1.5, -1.5, 0.0], [0x1c, 0xa0, 0x34]),
        ball("blue", [1.5, 1.5, 0.0], [0x24, 0x3c, 0xd4]),
        ball("yellow", [-1.5, 1.5, 0.0], [0xe6, 0xc8, 0x18]),
        ball("magenta", [-1.5, -1.5, 3.0], [0xc8, 0x20, 0x90]),
        ball("cyan", [1.5, -1.5, 3.0], [0x18, 0xa8, 0xb4]),
        ball("orange", [1.5, 1.5, 3.0], [0xe0, 0x6a, 0x14]),
        ball("violet", [-1.5, 1.5, 3.0], [0x7a, 0x30, 0xc0]),
    ]
}

fn noise_of(tracked: &Tracked, cameras: usize, markers: usize) -> Vec<ObservationNoise> {
    let of = |camera: usize, marker: usize| {
        let own = tracked.observations.iter().filter(|o| o.camera == camera && o.marker == marker);
        let stated_px2: Vec<Matrix2<f64>> = own.map(|o| o.covariance_px2).collect();
        let lost_share = 1.0 - stated_px2.len() as f64 / tracked.poses.len().max(1) as f64;
        ObservationNoise { stated_px2, lost_share: lost_share.max(0.0) }
    };
    (0..cameras).flat_map(|c| (0..markers).map(move |m| of(c, m))).collect()
}

/// Ratio of the centres' noise that the residuals of the poses show to the stated noise; 1 without
/// redundancy.
fn noise_over_stated(estimator: &PoseEstimator, tracked: &Tracked, bias_px: f64) -> Result<f64, PoseError> {
    let factors = estimator.centre_factors(&tracked.observations, &tracked.poses)?;
    let markers = estimator.markers().len();
    let (mut noise_px2, mut stated_px2) = (0.0, 0.0);
    for o in tracked.observations.iter() {
        let own_px2 = o.covariance_px2.diagonal();
        noise_px2 += own_px2.dot(&factors[o.camera * markers + o.marker]) / 2.0 - bias_px * bias_px;
        stated_px2 += own_px2.sum() / 2.0;
    }
    Ok(if stated_px2 > 0.0 { (noise_px2 / stated_px2).max(0.01).sqrt() } else { 1.0 })
}
