//! Position and attitude in one filter, and its backward pass.

use crate::smoother::integrator::{
    CHAIN, CORRELATED, Integrator, JerkNoise, Transition, add_process_noise, start_covariance,
};
use crate::smoother::rates::{MeanRate, Rates};
use crate::{MotionCovariance, MotionSample, PoseEstimate};
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::{Isometry3, Matrix3, Matrix6, UnitQuaternion, Vector3};
use nalgebra::{Const, DMatrix, DVector, Dyn, OMatrix, SMatrix, SVector, Translation3, Vector6};

/// Length of the error state: the chain of position, then that of attitude.
pub(crate) const STATE: usize = 2 * CHAIN;
pub(crate) type MatrixS = SMatrix<f64, STATE, STATE>;
pub(crate) type VectorS = SVector<f64, STATE>;
/// Effect of systematic errors on the state, one column for each direction.
pub(crate) type Effects = OMatrix<f64, Const<STATE>, Dyn>;

/// The noise of a flight: what drives the body and what disturbs its measured poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionNoise {
    /// Of position.
    pub translation: JerkNoise,
    /// Of attitude.
    pub rotation: JerkNoise,
}

/// Standard deviation of an attitude, predicted over a gap, up to which its error is a small turn: half a
/// radian, where a turn's sine is 4 % short of it.
const MOST_TURN_RAD: f64 = 0.5;

impl MotionNoise {
    /// Longest time between two poses over which the motion is estimated: white jerk of the attitude's
    /// intensity q makes it uncertain by √(q t⁵/20) (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.3), which
    /// is half a radian there.
    pub fn longest_gap_s(&self) -> f64 {
        (20.0 * MOST_TURN_RAD * MOST_TURN_RAD / self.rotation.intensity).powf(0.2)
    }
}

/// Standard deviations before the first pose: 10 m/s, 100 m/s²; 30 rad/s, 1000 rad/s².
pub(crate) const PRIOR_TRANSLATION: (f64, f64) = (10.0, 100.0);
pub(crate) const PRIOR_ROTATION: (f64, f64) = (30.0, 1000.0);

#[derive(Debug, Clone)]
pub(crate) struct Joint {
    pub(crate) translation: Integrator<Vector3<f64>>,
    pub(crate) rotation: Integrator<UnitQuaternion<f64>>,
    pub(crate) covariance: MatrixS,
    pub(crate) effects: Effects,
}

/// What a measurement of some coordinates did to the state: six of a pose, three of rates.
#[derive(Debug, Clone)]
pub(crate) struct Update<const N: usize = 6> {
    gain: SMatrix<f64, STATE, N>,
    inverse: SMatrix<f64, N, N>,
    pub(crate) innovation: SVector<f64, N>,
    effects: OMatrix<f64, Const<N>, Dyn>,
}

/// What a measurement says beyond the state, and the covariance of that.
struct Innovation<const N: usize> {
    value: SVector<f64, N>,
    covariance: SMatrix<f64, N, N>,
}

/// H, the part of the error state that a measured pose observes: its place, and the correlated error of that.
fn observation() -> SMatrix<f64, 6, STATE> {
    SMatrix::from_fn(|i, j| {
        let at = CHAIN * (i / 3) + i % 3;
        if j == at || j == at + CORRELATED { 1.0 } else { 0.0 }
    })
}

/// Where body rates begin in the error state.
const RATE: usize = CHAIN + 3;

/// H of measured rates.
fn rate_observation() -> SMatrix<f64, 3, STATE> {
    SMatrix::from_fn(|i, j| if j == RATE + i { 1.0 } else { 0.0 })
}

/// The covariance of the random errors of a measurement, position and attitude each by its factor.
pub(crate) fn new_noise(estimate: &PoseEstimate, noise: &MotionNoise) -> Matrix6<f64> {
    let (t, r) = (noise.translation.variance_factor.sqrt(), noise.rotation.variance_factor.sqrt());
    let scale = Vector6::new(t, t, t, r, r, r);
    estimate.own_covariance().component_mul(&(scale * scale.transpose()))
}

impl Joint {
    /// The state at the first measured pose, with room for systematic columns.
    pub(crate) fn start(first: &PoseEstimate, columns: usize, noise: &MotionNoise) -> Self {
        let pose = &first.world_from_body;
        let seen = new_noise(first, noise);
        let mut covariance = MatrixS::zeros();
        let chains = [(&noise.translation, PRIOR_TRANSLATION), (&noise.rotation, PRIOR_ROTATION)];
        for (i, (chain, prior)) in chains.into_iter().enumerate() {
            let (at, other) = (CHAIN * i, CHAIN * (1 - i));
            let own = start_covariance(&seen.fixed_view::<3, 3>(3 * i, 3 * i).into_owned(), chain, prior);
            covariance.fixed_view_mut::<CHAIN, CHAIN>(at, at).copy_from(&own);
            let cross = seen.fixed_view::<3, 3>(3 * i, 3 - 3 * i);
            covariance.fixed_view_mut::<3, 3>(at, other).copy_from(&cross);
        }
        let mut effects = Effects::zeros(columns);
        for c in 0..first.systematic_columns() {
            let known = first.systematic_column(c);
            for i in 0..2 {
                effects.fixed_view_mut::<3, 1>(CHAIN * i, c).copy_from(&known.fixed_rows::<3>(3 * i));
            }
        }
        Self {
            translation: Integrator::at(pose.translation.vector),
            rotation: Integrator::at(pose.rotation),
            covariance,
            effects,
        }
    }

    /// Moves the state on (back, if `dt_s` is negative).
    pub(crate) fn predict(&mut self, dt_s: f64, noise: &MotionNoise) -> [Transition; 2] {
        let (translation, first) = self.translation.predicted(dt_s, &noise.translation);
        let (rotation, second) = self.rotation.predicted(dt_s, &noise.rotation);
        (self.translation, self.rotation) = (translation, rotation);
        let transitions = [first, second];
        let forward = |columns: &mut [f64]| {
            transitions.iter().zip([0, CHAIN]).for_each(|(t, at)| t.forward(columns, STATE, at));
        };
        for _ in 0..2 {
            forward(self.covariance.as_mut_slice());
            self.covariance.transpose_mut();
        }
        add_process_noise(self.covariance.as_mut_slice(), STATE, 0, dt_s, &noise.translation);
        add_process_noise(self.covariance.as_mut_slice(), STATE, CHAIN, dt_s, &noise.rotation);
        forward(self.effects.as_mut_slice());
        transitions
    }

    /// What a pose says beyond this state, and the covariance of that.
    fn innovation(&self, seen: &PoseEstimate, noise: &MotionNoise) -> (Vector6<f64>, Matrix6<f64>) {
        let pose = &seen.world_from_body;
        let shift = self.translation.innovation(&pose.translation.vector);
        let turn = self.rotation.innovation(&pose.rotation);
        let h = observation();
        let s = new_noise(seen, noise) + h * self.covariance * h.transpose();
        (Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z), (s + s.transpose()) * 0.5)
    }

    /// The squared difference of a pose from this state, which does not contain it, over its covariance:
    /// chi-square with six degrees of freedom.
    pub(crate) fn disagreement(&self, seen: &PoseEstimate, noise: &MotionNoise) -> Option<f64> {
        let (innovation, s) = self.innovation(seen, noise);
        Some(innovation.dot(&s.cholesky()?.solve(&innovation)))
    }

    /// Updates the state by a pose. `None` where the arithmetic fails.
    pub(crate) fn update(
        &mut self,
        seen: &PoseEstimate,
        noise: &MotionNoise,
        out: &mut Update,
    ) -> Option<()> {
        let (value, covariance) = self.innovation(seen, noise);
        let column = |c: usize| (c < seen.systematic_columns()).then(|| seen.systematic_column(c));
        self.take(&observation(), Innovation { value, covariance }, column, out)
    }

    /// Updates the state by a mean of measured rates, whose systematic columns follow `first` others.
    pub(crate) fn update_by_rates(
        &mut self,
        rates: &Rates,
        mean: &MeanRate,
        first: usize,
        out: &mut Update<3>,
    ) -> Option<()> {
        let own = self.covariance.fixed_view::<3, 3>(RATE, RATE);
        let seen = Innovation {
            value: mean.rate_rad_s - self.rotation.rate,
            covariance: own + Matrix3::identity() * mean.variance,
        };
        let acceleration = self.rotation.acceleration;
        let column = |c: usize| {
            let own = c.checked_sub(first).filter(|own| *own < rates.columns())?;
            Some(rates.error(own, mean, &acceleration))
        };
        self.take(&rate_observation(), seen, column, out)
    }

    /// Updates the state by a measurement (Joseph's form, expanded), with its systematic columns where it has them.
    fn take<const N: usize>(
        &mut self,
        h: &SMatrix<f64, N, STATE>,
        seen: Innovation<N>,
        column: impl Fn(usize) -> Option<SVector<f64, N>>,
        out: &mut Update<N>,
    ) -> Option<()> {
        let s = seen.covariance;
        out.innovation = seen.value;
        let rows = h * self.covariance;
        out.inverse = s.cholesky()?.inverse();
        out.gain = rows.transpose() * out.inverse;
        let taken = out.gain * rows;
        let covariance = self.covariance + out.gain * s * out.gain.transpose() - taken - taken.transpose();
        self.covariance = (covariance + covariance.transpose()) * 0.5;
        let by = out.gain * out.innovation;
        self.translation.correct(&by.as_slice()[..CHAIN]);
        self.rotation.correct(&by.as_slice()[CHAIN..]);
        // Column by column, as a product of all would allocate.
        for c in 0..self.effects.ncols() {
            let effect: VectorS = self.effects.column(c).into_owned();
            let mut y = -(h * effect);
            if let Some(own) = column(c) {
                y += own;
            }
            out.effects.set_column(c, &y);
            self.effects.set_column(c, &(effect + out.gain * y));
        }
        Some(())
    }

    /// Widens the covariance for a share of the poses' own covariance that their innovations do not show. Such
    /// errors move as slowly as the motion; spread evenly over the band that the smoother passes, which is
    /// the spectrum of greatest entropy for them, all of their variance passes, of which the smoother takes the
    /// part of white errors. Beside measured `rates` errors of the poses reach the attitude, and not what the rates say.
    pub(crate) fn widen_by_unseen(&mut self, own: &Matrix6<f64>, share: [f64; 2], rates: bool) {
        for (i, share) in share.into_iter().enumerate() {
            let at = CHAIN * i;
            let passed = self.covariance.fixed_view::<3, 3>(at, at).trace();
            let ratio = own.fixed_view::<3, 3>(3 * i, 3 * i).trace() / passed;
            if share > 0.0 && ratio > 1.0 {
                let factor = (1.0 + share * (ratio - 1.0)).sqrt();
                let reached = if rates && i == 1 { 3 } else { CHAIN };
                self.covariance.rows_mut(at, reached).scale_mut(factor);
                self.covariance.columns_mut(at, reached).scale_mut(factor);
            }
        }
    }

    /// The state whose correlated error is that of no measurement yet.
    pub(crate) fn forget_correlated(&mut self, noise: &MotionNoise) {
        let chains = [(0, &noise.translation), (CHAIN, &noise.rotation)];
        for (at, chain) in chains {
            self.covariance.fixed_rows_mut::<3>(at + CORRELATED).fill(0.0);
            self.covariance.fixed_columns_mut::<3>(at + CORRELATED).fill(0.0);
            self.covariance
                .fixed_view_mut::<3, 3>(at + CORRELATED, at + CORRELATED)
                .copy_from(&chain.correlated);
        }
        (self.translation.correlated, self.rotation.correlated) = (Vector3::zeros(), Vector3::zeros());
    }

    pub(crate) fn blank_update<const N: usize>(&self) -> Update<N> {
        Update {
            gain: SMatrix::zeros(),
            inverse: SMatrix::zeros(),
            innovation: SVector::zeros(),
            effects: OMatrix::<f64, Const<N>, Dyn>::zeros(self.effects.ncols()),
        }
    }

    /// The state as body quantities, with the covariance by the Jacobian of that, systematic errors included. `None` where
    /// a number of either is not finite.
    pub(crate) fn sample(&self, t_ns: i64, gravity_m_s2: f64) -> Option<MotionSample> {
        let (translation, rotation) = (&self.translation, &self.rotation);
        let body_from_world = matrix_of(&rotation.place).transpose();
        let velocity = body_from_world * translation.rate;
        let force = body_from_world * (translation.acceleration + Vector3::z() * gravity_m_s2);
        let mut jacobian = SMatrix::<f64, 18, STATE>::zeros();
        let unit = Matrix3::identity();
        let blocks: [(usize, usize, Matrix3<f64>); 8] = [
            (0, 0, unit),
            (3, CHAIN, unit),
            (6, 3, body_from_world),
            (6, CHAIN, velocity.cross_matrix()),
            (9, CHAIN + 3, unit),
            (12, 6, body_from_world),
            (12, CHAIN, force.cross_matrix()),
            (15, CHAIN + 6, unit),
        ];
        for (row, column, block) in blocks {
            jacobian.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        }
        let mut covariance = jacobian * self.covariance * jacobian.transpose();
        for effect in self.effects.column_iter() {
            let on_body = jacobian * effect;
            covariance.ger(1.0, &on_body, &on_body, 1.0);
        }
        let sample = MotionSample {
            t_ns,
            world_from_body: Isometry3::from_parts(Translation3::from(translation.place), rotation.place),
            velocity_in_body_m_s: velocity,
            rates_rad_s: rotation.rate,
            specific_force_m_s2: force,
            angular_acceleration_rad_s2: rotation.acceleration,
            covariance: MotionCovariance::of(&((covariance + covariance.transpose()) * 0.5)),
        };
        sample.is_finite().then_some(sample)
    }
}

impl Update {
    /// The squared innovation over its covariance: chi-square with six degrees of freedom.
    pub(crate) fn chi_square(&self) -> f64 {
        self.innovation.dot(&(self.inverse * self.innovation))
    }

    /// Logarithm of the determinant of the innovation's covariance.
    pub(crate) fn log_determinant(&self) -> f64 {
        -self.inverse.determinant().ln()
    }

    /// Adds what the innovation says of the systematic errors to normal equations of these.
    pub(crate) fn add_information(&self, information: &mut DMatrix<f64>, right: &mut DVector<f64>) {
        let weighted = self.inverse * &self.effects;
        *information += self.effects.tr_mul(&weighted);
        *right += weighted.tr_mul(&self.innovation);
    }
}

/// The information of the later measurements: the adjoint state and its information matrix (Bryson & Frazier
/// 1963 in the form of Bierman 1977, which inverts no predicted covariance).
#[derive(Debug, Clone)]
pub(crate) struct Adjoint {
    pub(crate) vector: VectorS,
    pub(crate) information: MatrixS,
    effects: Effects,
}

impl Adjoint {
    /// After the last instant there is no information.
    pub(crate) fn nothing(columns: usize) -> Self {
        Self { vector: VectorS::zeros(), information: MatrixS::zeros(), effects: Effects::zeros(columns) }
    }

    /// The filtered state with the information of the later measurements.
    pub(crate) fn smoothed(&self, filtered: &Joint) -> Joint {
        let p = &filtered.covariance;
        let by = -(p * self.vector);
        let mut out = filtered.clone();
        out.translation.correct(&by.as_slice()[..CHAIN]);
        out.rotation.correct(&by.as_slice()[CHAIN..]);
        let covariance = p - p * self.information * p;
        out.covariance = (covariance + covariance.transpose()) * 0.5;
        out.effects -= p * &self.effects;
        out
    }

    /// The squared difference between a pose and what all others say of it, over its covariance: chi-square
    /// with six degrees of freedom (deletion residual; de Jong & Penzer 1998). Of the adjoint after the update
    /// by that pose.
    pub(crate) fn disagreement(&self, update: &Update) -> Option<f64> {
        let through = update.gain.tr_mul(&self.vector) + update.inverse * update.innovation;
        let information = update.inverse + update.gain.tr_mul(&self.information) * update.gain;
        let information = (information + information.transpose()) * 0.5;
        Some(through.dot(&information.cholesky()?.solve(&through)))
    }

    /// As [`Self::before_update`]. Rates are many, so here the product with 1 - gain·H is written out.
    pub(crate) fn before_rates(&mut self, update: &Update<3>) {
        let through = update.gain.tr_mul(&self.vector) + update.inverse * update.innovation;
        let mut of_rates = self.vector.fixed_rows_mut::<3>(RATE);
        of_rates -= through;
        let through = update.gain.tr_mul(&self.effects) + update.inverse * &update.effects;
        let mut of_rates = self.effects.fixed_rows_mut::<3>(RATE);
        of_rates -= through;
        // One side after the other: expanded into four terms, the product loses its positive eigenvalues.
        let columns = self.information * update.gain;
        let mut own = self.information.fixed_columns_mut::<3>(RATE);
        own -= columns;
        let rows = update.gain.tr_mul(&self.information);
        let mut own = self.information.fixed_rows_mut::<3>(RATE);
        own -= rows;
        let mut own = self.information.fixed_view_mut::<3, 3>(RATE, RATE);
        own += update.inverse;
    }

    pub(crate) fn before_update(&mut self, update: &Update) {
        let h = observation();
        let through = update.gain.tr_mul(&self.vector) + update.inverse * update.innovation;
        self.vector -= h.tr_mul(&through);
        let through = update.gain.tr_mul(&self.effects) + update.inverse * &update.effects;
        self.effects -= h.tr_mul(&through);
        let kept = MatrixS::identity() - update.gain * h;
        self.information = kept.tr_mul(&self.information) * kept + h.tr_mul(&update.inverse) * h;
    }

    pub(crate) fn before_predict(&mut self, transitions: &[Transition; 2]) {
        let backward = |columns: &mut [f64]| {
            transitions.iter().zip([0, CHAIN]).for_each(|(t, at)| t.backward(columns, STATE, at));
        };
        backward(self.vector.as_mut_slice());
        backward(self.effects.as_mut_slice());
        for _ in 0..2 {
            backward(self.information.as_mut_slice());
            self.information.transpose_mut();
        }
    }
}
