//! The smoothed motion.

use mavsight_geometry::{EulerAngles, Isometry3, Matrix3, Matrix6, Vector3};
use nalgebra::{SMatrix, SVector};

/// State of motion at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSample {
    /// Time of the pose it belongs to.
    pub t_ns: i64,
    /// Smoothed pose.
    pub world_from_body: Isometry3<f64>,
    /// u, v, w.
    pub velocity_in_body_m_s: Vector3<f64>,
    /// p, q, r.
    pub rates_rad_s: Vector3<f64>,
    /// What an accelerometer at the body's origin reads: a_x = u̇ + q w - r v + g sin θ; (0, 0, -g) in level
    /// hover.
    pub specific_force_m_s2: Vector3<f64>,
    /// ṗ, q̇, ṙ.
    pub angular_acceleration_rad_s2: Vector3<f64>,
    /// Covariance, systematic errors included.
    pub covariance: MotionCovariance,
}

impl MotionSample {
    /// Whether all numbers are finite, also those of the covariance.
    pub(crate) fn is_finite(&self) -> bool {
        let place = &self.world_from_body;
        let vectors = [
            &place.translation.vector,
            &self.velocity_in_body_m_s,
            &self.rates_rad_s,
            &self.specific_force_m_s2,
            &self.angular_acceleration_rad_s2,
        ];
        let mut values = vectors.into_iter().flatten().chain(&place.rotation.coords);
        values.all(|x| x.is_finite()) && self.covariance.is_finite()
    }

    /// The difference from another, in the coordinates of the covariance.
    pub(crate) fn minus(&self, other: &Self) -> SVector<f64, 18> {
        let (own, from) = (&self.world_from_body, &other.world_from_body);
        let parts = [
            own.translation.vector - from.translation.vector,
            (from.rotation.inverse() * own.rotation).scaled_axis(),
            self.velocity_in_body_m_s - other.velocity_in_body_m_s,
            self.rates_rad_s - other.rates_rad_s,
            self.specific_force_m_s2 - other.specific_force_m_s2,
            self.angular_acceleration_rad_s2 - other.angular_acceleration_rad_s2,
        ];
        SVector::from_fn(|k, _| parts[k / 3][k % 3])
    }
}

/// What is kept of the covariance of a state of motion, 18 coordinates in threes: position (world axes), turn
/// (body axes, R exp δ), velocity (body), rates, specific force, angular acceleration. SI units.
///
/// Kept in single precision are the 6×6 of the pose, the 6×6 of velocity and rates, and the 3×3 of each of
/// the accelerations. The default is zero: exact.
///
/// Beside them are variances of velocity and rates as errors of poses and the jerk of the whole flight have them. Where the
/// aircraft is moved more or less than that the smoother errs more or less, and inputs that pass the same low-pass err by the
/// same: estimators that compare the two weight by [`Self::noise_variance`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionCovariance {
    six: [[f32; 21]; 2],
    three: [[f32; 6]; 2],
    noise: [f32; 6],
}

/// The upper triangle of a square block, by columns.
fn packed<const N: usize>(of: impl Fn(usize, usize) -> f64) -> [f32; N] {
    let (mut i, mut j) = (0, 0);
    std::array::from_fn(|_| {
        let value = of(i, j) as f32;
        (i, j) = if i == j { (0, j + 1) } else { (i + 1, j) };
        value
    })
}

fn unpacked<const N: usize>(triangle: &[f32]) -> SMatrix<f64, N, N> {
    SMatrix::from_fn(|i, j| {
        let (low, high) = (i.min(j), i.max(j));
        f64::from(triangle[high * (high + 1) / 2 + low])
    })
}

impl MotionCovariance {
    /// What is kept of all; the matrix is taken as symmetric.
    pub fn of(all: &SMatrix<f64, 18, 18>) -> Self {
        Self {
            six: [0, 6].map(|at| packed(|i, j| all[(at + i, at + j)])),
            three: [12, 15].map(|at| packed(|i, j| all[(at + i, at + j)])),
            noise: std::array::from_fn(|k| all[(6 + k, 6 + k)] as f32),
        }
    }

    /// This covariance with other variances of velocity and rates as the whole flight has them.
    #[must_use]
    pub fn with_noise(self, noise: [f32; 6]) -> Self {
        Self { noise, ..self }
    }

    pub(crate) fn with_noise_of(self, other: &Self) -> Self {
        self.with_noise(other.noise)
    }

    /// The variance of a coordinate of velocity (0 to 2) or rates (3 to 5) as errors of poses and the jerk of the whole flight
    /// have it.
    pub fn noise_variance(&self, coordinate: usize) -> f64 {
        f64::from(self.noise[coordinate])
    }

    fn is_finite(&self) -> bool {
        let blocks = self.six.iter().flatten().chain(self.three.iter().flatten());
        blocks.chain(&self.noise).all(|x| x.is_finite())
    }

    /// Position, then turn.
    pub fn pose(&self) -> Matrix6<f64> {
        unpacked(&self.six[0])
    }

    /// Velocity, then rates.
    pub fn velocity_and_rates(&self) -> Matrix6<f64> {
        unpacked(&self.six[1])
    }

    /// One of the six quantities: 0 position, 1 turn, 2 velocity, 3 rates, 4 specific force, 5 angular
    /// acceleration (the last for any number beyond).
    pub fn quantity(&self, index: usize) -> Matrix3<f64> {
        match index {
            0..=3 => {
                let six: Matrix6<f64> = unpacked(&self.six[index / 2]);
                six.fixed_view::<3, 3>(3 * (index % 2), 3 * (index % 2)).into_owned()
            }
            _ => unpacked(&self.three[usize::from(index > 4)]),
        }
    }

    /// The variance of one of the 18 coordinates.
    pub fn variance(&self, coordinate: usize) -> f64 {
        self.quantity(coordinate / 3)[(coordinate % 3, coordinate % 3)]
    }

    /// Variances of all coordinates.
    pub fn variances(&self) -> SVector<f64, 18> {
        SVector::from_fn(|k, _| self.variance(k))
    }

    /// This covariance and the square of an error.
    pub(crate) fn plus_square(&self, error: &SVector<f64, 18>) -> Self {
        let square = |at: usize, i: usize, j: usize| error[at + i] * error[at + j];
        let six = [0, 6].map(|at| packed(|i, j| square(at, i, j)));
        let three = [12, 15].map(|at| packed(|i, j| square(at, i, j)));
        self.plus(&Self { six, three, noise: [0.0; 6] })
    }

    /// The covariance of the sum of two independent errors, with this one's variances as the whole flight has them.
    pub(crate) fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        let own = sum.six.iter_mut().flatten().chain(sum.three.iter_mut().flatten());
        let others = other.six.iter().flatten().chain(other.three.iter().flatten());
        own.zip(others).for_each(|(own, other)| *own += other);
        sum
    }

    /// This covariance times a factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let by = |value: f32| (f64::from(value) * factor) as f32;
        let (six, three) = (self.six.map(|t| t.map(by)), self.three.map(|t| t.map(by)));
        Self { six, three, noise: self.noise.map(by) }
    }
}

/// What of the measured poses the smoother has not believed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Doubts {
    /// Times of poses that are left out: they disagree with all others.
    pub left_out_ns: Vec<i64>,
    /// Times of the last pose before and the first behind each gap that the motion does not cross: the poses
    /// behind it contradict those before it.
    pub severed_ns: Vec<(i64, i64)>,
    /// Times of the last pose before and the first behind each gap that the motion crosses but in which it is not known: the
    /// flight shows the gap's length too seldom to say how lively an aircraft is for as long.
    pub hidden_ns: Vec<(i64, i64)>,
}

impl Doubts {
    /// What a reader should know, a sentence each.
    pub fn words(&self) -> Vec<String> {
        let seconds = |t_ns: i64| t_ns as f64 * 1e-9;
        let mut words = Vec::new();
        if let Some(first) = self.left_out_ns.first() {
            words.push(format!(
                "{} pose(s) are left out of the motion, the first at {:.3} s: they disagree with all others more than \
                 one in a thousand flights has by chance.",
                self.left_out_ns.len(),
                seconds(*first)
            ));
        }
        if let Some((from, to)) = self.severed_ns.first() {
            words.push(format!(
                "The motion is not known across {} gap(s) between poses, the first from {:.3} to {:.3} s: the poses \
                 behind it contradict those before it at the jerk that the rest of the flight shows.",
                self.severed_ns.len(),
                seconds(*from),
                seconds(*to)
            ));
        }
        if let Some((from, to)) = self.hidden_ns.first() {
            words.push(format!(
                "The motion is not known in {} gap(s) between poses, the first from {:.3} to {:.3} s: they are longer than a \
                 ninth of what was seen, and may hide a manoeuvre. Fly for longer, or where two cameras see the aircraft.",
                self.hidden_ns.len(),
                seconds(*from),
                seconds(*to)
            ));
        }
        words
    }
}

/// A smoothed flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// One per pose sample, measured or not, but for instants at which the motion is not known.
    pub samples: Vec<MotionSample>,
    /// Those instants, in order.
    pub unknown_ns: Vec<i64>,
    /// Poses and gaps that were not believed.
    pub doubts: Doubts,
    /// Frequency at which the smoother passes one half of a position: H = 1/(1 + (f/fc)⁶).
    pub translation_bandwidth_hz: f64,
    /// Frequency at which it passes one half of a rotation.
    pub rotation_bandwidth_hz: f64,
    /// Median interval of the samples.
    pub sample_interval_s: f64,
}

impl Motion {
    /// Longest time from one sample to the next over which the motion can still be read: two usual ones and
    /// half a period of the smoother.
    pub fn longest_step_s(&self) -> f64 {
        let hz = self.translation_bandwidth_hz.min(self.rotation_bandwidth_hz);
        (2.5 * self.sample_interval_s).max(0.5 / hz)
    }
}

/// Standard deviations of roll, pitch and yaw from the covariance of a small turn about body axes.
///
/// Infinite or very large for roll and yaw near a pitch of ±90°, where they cannot be distinguished.
pub fn euler_std(world_from_body: &Isometry3<f64>, covariance_in_body_rad2: &Matrix3<f64>) -> Vector3<f64> {
    let jacobian = EulerAngles::from_world_from_body(world_from_body).rates_from_body_rates();
    (jacobian * covariance_in_body_rad2 * jacobian.transpose()).diagonal().map(|v| v.max(0.0).sqrt())
}

/// Covariance of position (world axes) and of a small turn about body axes, from standard deviations of x, y,
/// z, roll, pitch and yaw that are independent.
///
/// At a pitch of ±90° the angles say nothing about the turn: they are then taken as the turn itself.
pub fn covariance_from_std(world_from_body: &Isometry3<f64>, stds: &[f64; 6]) -> Matrix6<f64> {
    let var = stds.map(|s| s * s);
    let mut covariance = Matrix6::from_diagonal(&var.into());
    let euler = Matrix3::from_diagonal(&Vector3::new(var[3], var[4], var[5]));
    let rates = EulerAngles::from_world_from_body(world_from_body).rates_from_body_rates();
    let turn = rates.try_inverse().map(|j| j * euler * j.transpose());
    let turn = turn.filter(|t| t.iter().all(|x| x.is_finite())).unwrap_or(euler);
    covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    covariance
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_geometry::{UnitQuaternion, world_from_body};
    use mavsight_random::Random;

    #[test]
    fn what_is_kept_of_a_covariance_comes_back_to_seven_digits() {
        let all = SMatrix::<f64, 18, 18>::from_fn(|i, j| {
            (1.0 + (i * j) as f64 / 7.0 + (i + j) as f64) * 10_f64.powi(-((i / 3 + j / 3) as i32))
        });
        let kept = MotionCovariance::of(&all);
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-7;
        let two = [kept.pose(), kept.velocity_and_rates()];
        for (k, got) in two.iter().enumerate() {
            assert!(
                (0..36).all(|n| close(got[(n / 6, n % 6)], all[(6 * k + n / 6, 6 * k + n % 6)])),
                "{got}"
            );
        }
        for k in 0..6 {
            let got = kept.quantity(k);
            assert!(
                (0..9).all(|n| close(got[(n / 3, n % 3)], all[(3 * k + n / 3, 3 * k + n % 3)])),
                "{k}: {got}"
            );
        }
        for k in 0..18 {
            assert!(close(kept.variance(k), all[(k, k)]) && kept.variance(k) == kept.variances()[k], "{k}");
            assert!(close(kept.scaled(4.0).variance(k), 4.0 * all[(k, k)]));
        }
        for k in 0..6 {
            assert!(close(kept.noise_variance(k), all[(6 + k, 6 + k)]));
            assert!(close(kept.scaled(4.0).noise_variance(k), 4.0 * all[(6 + k, 6 + k)]));
        }
    }

    #[test]
    fn euler_std_is_the_spread_of_many_turns() {
        let angles = EulerAngles { phi_rad: 0.5, theta_rad: -0.8, psi_rad: 2.0 };
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), angles);
        let std = Vector3::new(0.01, 0.02, 0.005);
        let claimed = euler_std(&pose, &Matrix3::from_diagonal(&std.component_mul(&std)));
        let (mut random, trials) = (Random::new(3, 0), 20_000);
        let mut sum = Vector3::zeros();
        for _ in 0..trials {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()).component_mul(&std));
            let turned = Isometry3::from_parts(pose.translation, pose.rotation * turn);
            let got = EulerAngles::from_world_from_body(&turned);
            let error = Vector3::new(
                got.phi_rad - angles.phi_rad,
                got.theta_rad - angles.theta_rad,
                got.psi_rad - angles.psi_rad,
            );
            sum += error.component_mul(&error);
        }
        let spread = (sum / f64::from(trials)).map(f64::sqrt);
        assert!(((spread - claimed).component_div(&claimed)).amax() < 0.03, "{spread} against {claimed}");
    }

    #[test]
    fn standard_deviations_survive_the_way_there_and_back() {
        let stds = [1e-3, 2e-3, 3e-3, 0.01, 0.02, 0.005];
        let angles = EulerAngles { phi_rad: 0.5, theta_rad: -0.8, psi_rad: 2.0 };
        let pose = world_from_body(Vector3::new(1.0, 2.0, 3.0), angles);
        let covariance = covariance_from_std(&pose, &stds);
        assert!((0..3).all(|k| (covariance[(k, k)].sqrt() - stds[k]).abs() < 1e-12));
        let back = euler_std(&pose, &covariance.fixed_view::<3, 3>(3, 3).into_owned());
        assert!((0..3).all(|k| (back[k] - stds[3 + k]).abs() < 1e-12), "{back}");
        let upright = EulerAngles { theta_rad: std::f64::consts::FRAC_PI_2, ..angles };
        let level = covariance_from_std(&world_from_body(Vector3::zeros(), upright), &stds);
        assert!(level.iter().all(|x| x.is_finite()));
    }
}
