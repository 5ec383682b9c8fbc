//! A place driven by white jerk and measured with an error of which a part is correlated.
//!
//! The error state is (δx, δv, δa, b) in threes; for an attitude δx is a turn about body axes, R exp(δx), and
//! v and a are body rates and their derivatives. b is the correlated part of the measurement's error: a
//! first-order Gauss-Markov process (Gelb 1974, section 2.4), in the chart of δx.

use mavsight_geometry::attitude::{matrix_of, right_jacobian};
use mavsight_geometry::{Matrix3, UnitQuaternion, Vector3};
use nalgebra::{DMatrixViewMut, SMatrix};

/// Length of the error state.
pub(crate) const CHAIN: usize = 12;
/// Where b begins.
pub(crate) const CORRELATED: usize = 9;

/// Where the place of one of the six coordinates of a pose is in the error state of both chains; its rate and the rate of that follow in
/// steps of three.
pub(crate) fn chain_of(coordinate: usize) -> usize {
    CHAIN * (coordinate / 3) + coordinate % 3
}

/// Where something is: a position or an attitude.
pub(crate) trait Place: Copy {
    /// This place after a small displacement.
    fn plus(&self, by: &Vector3<f64>) -> Self;
    /// The displacement that leads from `from` to this place.
    fn minus(&self, from: &Self) -> Vector3<f64>;
    /// Derivatives of the displaced place's error with respect to this place's error and to the displacement.
    fn jacobians(by: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>);
}

impl Place for Vector3<f64> {
    fn plus(&self, by: &Vector3<f64>) -> Self {
        self + by
    }
    fn minus(&self, from: &Self) -> Vector3<f64> {
        self - from
    }
    fn jacobians(_: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
        (Matrix3::identity(), Matrix3::identity())
    }
}

impl Place for UnitQuaternion<f64> {
    fn plus(&self, by: &Vector3<f64>) -> Self {
        self * UnitQuaternion::from_scaled_axis(*by)
    }
    fn minus(&self, from: &Self) -> Vector3<f64> {
        (from.inverse() * self).scaled_axis()
    }
    fn jacobians(by: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
        (matrix_of(&UnitQuaternion::from_scaled_axis(-by)), right_jacobian(by))
    }
}

/// The noise of position or of attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JerkNoise {
    /// Spectral density of the jerk: m²/s⁵, or rad²/s⁵ for attitude.
    pub intensity: f64,
    /// Factor on the covariances of the measurements, for the part of their error that is new in each.
    pub variance_factor: f64,
    /// Covariance of the correlated part (m² in world axes; rad² about body axes); zero for none.
    pub correlated: Matrix3<f64>,
    /// Time after which that part has fallen to 1/e.
    pub correlated_s: f64,
}

impl JerkNoise {
    /// White noise only.
    pub fn white(intensity: f64, variance_factor: f64) -> Self {
        Self { intensity, variance_factor, correlated: Matrix3::zeros(), correlated_s: 1.0 }
    }

    fn kept(&self, dt_s: f64) -> f64 {
        (-dt_s.abs() / self.correlated_s).exp()
    }
}

/// A place, its rate, the rate of that, and the correlated part of the measurement's error.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Integrator<P> {
    pub(crate) place: P,
    pub(crate) rate: Vector3<f64>,
    pub(crate) acceleration: Vector3<f64>,
    pub(crate) correlated: Vector3<f64>,
}

/// Derivative of the predicted error state with respect to the one before.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transition {
    keep: Matrix3<f64>,
    turn: Matrix3<f64>,
    dt_s: f64,
    kept: f64,
}

impl<P: Place> Integrator<P> {
    pub(crate) fn at(place: P) -> Self {
        let zero = Vector3::zeros();
        Self { place, rate: zero, acceleration: zero, correlated: zero }
    }

    /// The chain `dt_s` later (earlier, if negative).
    pub(crate) fn predicted(&self, dt_s: f64, noise: &JerkNoise) -> (Self, Transition) {
        let by = self.rate * dt_s + self.acceleration * (0.5 * dt_s * dt_s);
        let (keep, turn) = P::jacobians(&by);
        let kept = noise.kept(dt_s);
        let next = Self {
            place: self.place.plus(&by),
            rate: self.rate + self.acceleration * dt_s,
            acceleration: self.acceleration,
            correlated: self.correlated * kept,
        };
        (next, Transition { keep, turn, dt_s, kept })
    }

    /// What a measured place says beyond the expected one.
    pub(crate) fn innovation(&self, seen: &P) -> Vector3<f64> {
        seen.minus(&self.place) - self.correlated
    }

    /// Moves the chain along its error state.
    pub(crate) fn correct(&mut self, by: &[f64]) {
        let three = |at: usize| Vector3::new(by[at], by[at + 1], by[at + 2]);
        self.place = self.place.plus(&three(0));
        self.rate += three(3);
        self.acceleration += three(6);
        self.correlated += three(CORRELATED);
    }
}

impl Transition {
    /// F times the rows of a chain in each column, of `rows` entries; the chain begins at `at`.
    pub(crate) fn forward(&self, columns: &mut [f64], rows: usize, at: usize) {
        for column in columns.chunks_exact_mut(rows) {
            let c = &mut column[at..at + CHAIN];
            let [x, v, a] = [0, 3, 6].map(|k| Vector3::new(c[k], c[k + 1], c[k + 2]));
            let moved = self.keep * x + self.turn * (v * self.dt_s + a * (0.5 * self.dt_s * self.dt_s));
            for k in 0..3 {
                c[k] = moved[k];
                c[3 + k] += self.dt_s * a[k];
                c[CORRELATED + k] *= self.kept;
            }
        }
    }

    /// Fᵀ times the rows, as in [`Self::forward`].
    pub(crate) fn backward(&self, columns: &mut [f64], rows: usize, at: usize) {
        for column in columns.chunks_exact_mut(rows) {
            let c = &mut column[at..at + CHAIN];
            let x = Vector3::new(c[0], c[1], c[2]);
            let (kept, turned) = (self.keep.transpose() * x, self.turn.transpose() * x);
            for k in 0..3 {
                c[6 + k] += self.dt_s * c[3 + k] + 0.5 * self.dt_s * self.dt_s * turned[k];
                c[3 + k] += self.dt_s * turned[k];
                c[k] = kept[k];
                c[CORRELATED + k] *= self.kept;
            }
        }
    }
}

/// Covariance of one coordinate's (x, v, a) after an interval of white jerk of unit intensity (Bar-Shalom,
/// Li & Kirubarajan 2001, section 6.2.3).
pub(crate) fn white_jerk(dt_s: f64) -> Matrix3<f64> {
    let (s, sign) = (dt_s.abs(), dt_s.signum());
    let (xx, xv, xa) = (s.powi(5) / 20.0, sign * s.powi(4) / 8.0, s.powi(3) / 6.0);
    let (vv, va) = (s.powi(3) / 3.0, sign * s * s / 2.0);
    Matrix3::new(xx, xv, xa, xv, vv, va, xa, va, s)
}

/// Covariance of a chain just after its first measurement with new errors of covariance `first`. What is not
/// known yet scales with the noise, so that the factor's likelihood has a closed form. `prior_std`: rate,
/// acceleration.
pub(crate) fn start_covariance(
    first: &Matrix3<f64>,
    noise: &JerkNoise,
    prior_std: (f64, f64),
) -> SMatrix<f64, CHAIN, CHAIN> {
    let mut out = SMatrix::<f64, CHAIN, CHAIN>::zeros();
    let mut put = |row: usize, column: usize, block: Matrix3<f64>| {
        out.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
    };
    put(0, 0, first + noise.correlated);
    put(0, CORRELATED, -noise.correlated);
    put(CORRELATED, 0, -noise.correlated);
    put(CORRELATED, CORRELATED, noise.correlated);
    put(3, 3, Matrix3::identity() * prior_std.0.powi(2) * noise.variance_factor);
    put(6, 6, Matrix3::identity() * prior_std.1.powi(2) * noise.variance_factor);
    out
}

/// Adds what an interval makes uncertain to the chain's block of a covariance of `rows` rows.
pub(crate) fn add_process_noise(
    covariance: &mut [f64],
    rows: usize,
    at: usize,
    dt_s: f64,
    noise: &JerkNoise,
) {
    let mut all = DMatrixViewMut::from_slice(covariance, rows, rows);
    let jerk = white_jerk(dt_s) * noise.intensity;
    for k in 0..3 {
        let mut own = all.view_with_steps_mut((at + k, at + k), (3, 3), (2, 2));
        own += jerk;
    }
    let mut own = all.fixed_view_mut::<3, 3>(at + CORRELATED, at + CORRELATED);
    own += noise.correlated * (1.0 - noise.kept(dt_s).powi(2));
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;

    #[test]
    fn the_transition_matches_numeric_differences_and_its_transpose() {
        let chain = Integrator {
            place: UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.0, 0.3)),
            rate: Vector3::new(2.0, -3.0, 1.0),
            acceleration: Vector3::new(-4.0, 5.0, 9.0),
            correlated: Vector3::new(0.1, 0.2, -0.1),
        };
        let noise = JerkNoise { correlated_s: 0.2, ..JerkNoise::white(1.0, 1.0) };
        let (dt, h) = (0.1, 1e-6);
        let (_, transition) = chain.predicted(dt, &noise);
        let mut matrix = SMatrix::<f64, CHAIN, CHAIN>::identity();
        transition.forward(matrix.as_mut_slice(), CHAIN, 0);
        for k in 0..CHAIN {
            let moved = |step: f64| {
                let (mut c, mut by) = (chain, [0.0; CHAIN]);
                by[k] = step;
                c.correct(&by);
                c.predicted(dt, &noise).0
            };
            let (a, b) = (moved(h), moved(-h));
            let column = matrix.column(k);
            assert!((a.place.minus(&b.place) / (2.0 * h) - column.fixed_rows::<3>(0)).norm() < 1e-7);
            assert!(((a.rate - b.rate) / (2.0 * h) - column.fixed_rows::<3>(3)).norm() < 1e-7);
            assert!(
                ((a.acceleration - b.acceleration) / (2.0 * h) - column.fixed_rows::<3>(6)).norm() < 1e-7
            );
            assert!(
                ((a.correlated - b.correlated) / (2.0 * h) - column.fixed_rows::<3>(CORRELATED)).norm()
                    < 1e-7
            );
        }
        let mut transposed = SMatrix::<f64, CHAIN, CHAIN>::identity();
        transition.backward(transposed.as_mut_slice(), CHAIN, 0);
        assert!((transposed - matrix.transpose()).norm() < 1e-12);
    }
}
