//! A flight whose attitude has a closed form, measured by poses and by a gyroscope with a clock and axes of its own.

use mavsight_geometry::{EulerAngles, Isometry3, Matrix6, UnitQuaternion, Vector2, Vector3, world_from_body};
use mavsight_inertial::{GyroscopeSeries, LogAlignment, align_log};
use mavsight_pose::{PoseError, PoseEstimate, PoseSample};
use mavsight_random::Random;

const POSE_RATE_HZ: f64 = 30.0;
const LOG_RATE_HZ: f64 = 400.0;
const LENGTH_S: f64 = 60.0;
/// Of a pose, about each axis.
const TURN_STD_RAD: f64 = 1e-3;
/// 0.01 deg/s/√Hz, as consumer gyroscopes have.
const RATE_STD_RAD_S: f64 = 0.01 * 0.017_453_3 * 14.1;
/// The log's clock is 1.7 s early and 80 ppm fast.
pub(crate) const OFFSET_S: f64 = -1.7;
pub(crate) const DRIFT: f64 = 8e-5;
const BIAS_RAD_S: [f64; 3] = [0.012, -0.008, 0.02];
const SCALE: [f64; 3] = [0.008, -0.012, 0.005];

fn body_from_sensor() -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(Vector3::new(1.0, 2.0, -1.5).normalize() * 30_f64.to_radians())
}

/// Frequency and phase of the two sines of roll, pitch and yaw.
const SINES: [[(f64, f64); 2]; 3] =
    [[(0.31, 0.0), (1.13, 1.0)], [(0.43, 2.0), (0.97, 0.5)], [(0.23, 1.0), (0.71, 3.0)]];

/// Attitude, and rates about body axes (Euler's kinematic equations).
fn attitude(t_s: f64, size_rad: f64) -> (EulerAngles, Vector3<f64>) {
    let sum = |axis: usize, of: &dyn Fn(f64, f64) -> f64| {
        let each = SINES[axis].iter().map(|(f_hz, phase)| (std::f64::consts::TAU * f_hz, *phase));
        size_rad * each.map(|(omega, phase)| of(omega, omega * t_s + phase)).sum::<f64>()
    };
    let [phi_rad, theta_rad, psi_rad] = [0, 1, 2].map(|axis| sum(axis, &|_, at| at.sin()));
    let [d_phi, d_theta, d_psi] = [0, 1, 2].map(|axis| sum(axis, &|omega, at| omega * at.cos()));
    let rates = Vector3::new(
        d_phi - d_psi * theta_rad.sin(),
        d_theta * phi_rad.cos() + d_psi * theta_rad.cos() * phi_rad.sin(),
        d_psi * theta_rad.cos() * phi_rad.cos() - d_theta * phi_rad.sin(),
    );
    (EulerAngles { phi_rad, theta_rad, psi_rad }, rates)
}

pub(crate) fn poses(size_rad: f64, random: &mut Random) -> Vec<PoseSample> {
    let sample = |k: usize| {
        let t_s = k as f64 / POSE_RATE_HZ;
        let mut pose: Isometry3<f64> = world_from_body(Vector3::zeros(), attitude(t_s, size_rad).0);
        pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * TURN_STD_RAD);
        let covariance = Matrix6::identity() * TURN_STD_RAD.powi(2);
        // Some frames have no pose.
        let estimate =
            if k % 50 == 7 { Err(PoseError::NotMeasured) } else { Ok(PoseEstimate::new(pose, &covariance)) };
        PoseSample { t_ns: (t_s * 1e9).round() as i64, estimate }
    };
    (0..(LENGTH_S * POSE_RATE_HZ) as usize).map(sample).collect()
}

/// The log begins before the film and ends after it.
pub(crate) fn log(size_rad: f64, random: &mut Random) -> GyroscopeSeries {
    let (mut times_ns, mut rates) = (Vec::new(), Vec::new());
    let (bias, scale) = (Vector3::from(BIAS_RAD_S), Vector3::from(SCALE));
    for j in 0..((LENGTH_S + 20.0) * LOG_RATE_HZ) as usize {
        let log_s = OFFSET_S - 10.0 + j as f64 / LOG_RATE_HZ;
        let t_s = (log_s - OFFSET_S) / (1.0 + DRIFT);
        let of_body = attitude(t_s, size_rad).1 / (1.0 + DRIFT);
        let of_sensor = (body_from_sensor().inverse() * of_body).component_div(&scale.add_scalar(1.0));
        rates.push(of_sensor + bias + Vector3::from(random.normals()) * RATE_STD_RAD_S);
        times_ns.push((log_s * 1e9).round() as i64);
    }
    GyroscopeSeries::new(times_ns, rates).unwrap()
}

pub(crate) fn aligned(seed: u64) -> LogAlignment {
    let mut random = Random::new(35, seed);
    let poses = poses(0.25, &mut random);
    align_log(&poses, &log(0.25, &mut random)).unwrap()
}

/// Errors of offset, drift and attitude.
pub(crate) fn errors(found: &LogAlignment) -> ([f64; 2], Vector3<f64>) {
    let offset_s = OFFSET_S + DRIFT * found.at_s;
    let turn = (found.body_from_sensor * body_from_sensor().inverse()).scaled_axis();
    ([found.offset_s - offset_s, found.drift - DRIFT], turn)
}

/// Mean normalised squared errors, of clock (2) and attitude (3), and the largest errors of offset (s), drift and attitude
/// (degrees) over flights.
pub(crate) fn scored(flights: u64) -> ([f64; 2], [f64; 3]) {
    let (mut nees, mut worst) = ([0.0; 2], [0.0_f64; 3]);
    for seed in 0..flights {
        let found = aligned(seed);
        let ([offset_s, drift], turn) = errors(&found);
        let of_clock = Vector2::new(offset_s, drift);
        let inverse = found.covariance.fixed_view::<2, 2>(0, 0).into_owned().try_inverse().unwrap();
        nees[0] += of_clock.dot(&(inverse * of_clock)) / flights as f64;
        let inverse = found.covariance.fixed_view::<3, 3>(2, 2).into_owned().try_inverse().unwrap();
        nees[1] += turn.dot(&(inverse * turn)) / flights as f64;
        let sizes = [offset_s.abs(), drift.abs(), turn.norm().to_degrees()];
        worst = std::array::from_fn(|k| worst[k].max(sizes[k]));
    }
    (nees, worst)
}
