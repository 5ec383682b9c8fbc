//! The filter as poses arrive: the forward pass of the smoother.

use crate::smoother::state::{Joint, MotionNoise, PRIOR_ROTATION, PRIOR_TRANSLATION, Update};
use crate::{MotionSample, PoseError, PoseSample};

/// Factors on the intensity of the jerk between which the filter chooses: a manoeuvre exceeds a calm hover by decades.
const JERK_FACTORS: [f64; 4] = [1.0, 1e1, 1e2, 1e3];
/// Poses after which a misfit has faded to 1/e: thirty coordinates, of which a factor of ten in the jerk changes the likelihood
/// clearly, and less than a fifth of a second at 30 Hz, in which a manoeuvre begins.
const REMEMBERED: f64 = 5.0;
/// Twice the logarithm of the likelihood by which another factor must explain the poses better: the 99.9 % quantile of
/// chi-square with one degree of freedom.
const DISTINCT: f64 = 10.83;
/// Part of the prior's variance below which a velocity or a rate is of the poses.
const OF_POSES: f64 = 0.01;

/// Jerk of a calm hover whose attitude wanders by 1° at 1 Hz, m²/s⁵ and rad²/s⁵: an attitude φ sin ωt turns the thrust, so
/// that the jerk is g φ ω cos ωt, and the angular jerk φ ω³ cos ωt; a variance σ² that lasts for T = 1/ω has the
/// spectral density 2 σ² T.
const HOVER: (f64, f64) = (0.4, 6.0);

impl MotionNoise {
    /// This noise, if it is that of a flight; what was estimated of an aircraft at rest says nothing of its take-off, so that the
    /// jerk is at least that of a calm hover.
    pub fn of_flight(mut self) -> Self {
        self.translation.intensity = self.translation.intensity.max(HOVER.0);
        self.rotation.intensity = self.rotation.intensity.max(HOVER.1);
        self
    }
}

/// Motion from the poses so far, for use while the flight goes on. It is the forward pass of
/// [`crate::smooth`] with the noise given, for example that of an earlier flight by [`crate::motion_noise`].
///
/// Jerk that is stronger than the noise says would leave velocity and rates wrong and their covariance small. So the
/// filter runs at several levels of jerk and gives the motion of the level that explains the last poses clearly best
/// (Bar-Shalom, Li & Kirubarajan 2001, sections 11.2 and 11.6).
///
/// After the first pose, which makes room for its systematic columns, nothing is allocated.
#[derive(Debug, Clone)]
pub struct CausalFilter {
    levels: [Level; JERK_FACTORS.len()],
    gravity_m_s2: f64,
    t_ns: i64,
    seen_ns: i64,
    index: usize,
}

/// The filter with one strength of the jerk.
#[derive(Debug, Clone)]
struct Level {
    noise: MotionNoise,
    longest_gap_s: f64,
    state: Option<(Joint, Update)>,
    /// Minus twice the logarithm of the likelihood of the last poses, fading.
    misfit: f64,
}

impl Level {
    fn new(noise: &MotionNoise, factor: f64) -> Self {
        let mut noise = *noise;
        noise.translation.intensity *= factor;
        noise.rotation.intensity *= factor;
        Self { noise, longest_gap_s: noise.longest_gap_s(), state: None, misfit: 0.0 }
    }

    /// Takes an instant in. `None` where the arithmetic fails: the next pose is its first then.
    fn take(&mut self, sample: &PoseSample, dt_s: f64, unseen_s: f64) -> Option<()> {
        if unseen_s > self.longest_gap_s {
            self.state = None;
        }
        match (&mut self.state, &sample.estimate) {
            (None, Err(_)) => {}
            (None, Ok(first)) => {
                let joint = Joint::start(first, first.systematic_columns(), &self.noise);
                let update = joint.blank_update();
                self.state = Some((joint, update));
                // Its first pose says nothing for it: behind a gap that others cross it has explained none yet.
                self.misfit = 0.0;
            }
            (Some((joint, update)), seen) => {
                joint.predict(dt_s, &self.noise);
                if let Ok(seen) = seen {
                    if joint.update(seen, &self.noise, update).is_none() {
                        self.state = None;
                        return None;
                    }
                    let own = update.chi_square() + update.log_determinant();
                    self.misfit += own - self.misfit / REMEMBERED;
                }
            }
        }
        Some(())
    }
}

impl CausalFilter {
    /// A filter before its first pose.
    ///
    /// # Errors
    /// [`PoseError::BadPose`] for a noise or gravity that is not finite or not positive.
    pub fn new(noise: MotionNoise, gravity_m_s2: f64) -> Result<Self, PoseError> {
        let sound = [noise.translation, noise.rotation].iter().all(|n| {
            [n.intensity, n.variance_factor, n.correlated_s].iter().all(|x| x.is_finite() && *x > 0.0)
                && n.correlated.iter().all(|x| x.is_finite())
                && n.correlated.diagonal().iter().all(|x| *x >= 0.0)
        });
        if !sound || !gravity_m_s2.is_finite() {
            return Err(PoseError::BadPose { index: 0, what: "the noise or gravity" });
        }
        let levels = JERK_FACTORS.map(|factor| Level::new(&noise, factor));
        Ok(Self { levels, gravity_m_s2, t_ns: i64::MIN, seen_ns: i64::MIN, index: 0 })
    }

    /// Takes one instant in, measured or not: the motion then, or nothing until the poses say velocity and rates, and half of
    /// [`MotionNoise::longest_gap_s`] after the last pose; beyond the whole of it the filter begins again.
    ///
    /// # Errors
    /// [`PoseError::TimeNotIncreasing`]; [`PoseError::BadPose`], after which a filter whose own covariance is
    /// none any more begins again with the next pose.
    pub fn push(&mut self, sample: &PoseSample) -> Result<Option<MotionSample>, PoseError> {
        if sample.t_ns <= self.t_ns {
            let t_s = sample.t_ns as f64 * 1e-9;
            return Err(PoseError::TimeNotIncreasing { index: self.index, t_s });
        }
        check_pose(self.index, sample)?;
        let since_s = |t_ns: i64| sample.t_ns.saturating_sub(t_ns) as f64 * 1e-9;
        let (dt_s, unseen_s) = (since_s(self.t_ns), since_s(self.seen_ns));
        let is_seen = sample.estimate.is_ok();
        (self.t_ns, self.index) = (sample.t_ns, self.index + 1);
        if is_seen {
            self.seen_ns = sample.t_ns;
        }
        let taken = self.levels.each_mut().map(|level| level.take(sample, dt_s, unseen_s));
        let used = self.best_level();
        let unsound = PoseError::BadPose { index: self.index - 1, what: "the filter's covariance" };
        taken[used].ok_or(unsound.clone())?;
        let level = &mut self.levels[used];
        let Some((joint, _)) =
            level.state.as_ref().filter(|_| is_seen || unseen_s <= 0.5 * level.longest_gap_s)
        else {
            return Ok(None);
        };
        let motion = joint.sample(sample.t_ns, self.gravity_m_s2);
        if motion.is_none() {
            level.state = None;
        }
        motion.map(|motion| is_of_poses(&motion).then_some(motion)).ok_or(unsound)
    }

    /// The level of the given noise, unless another explains the last poses clearly better.
    fn best_level(&self) -> usize {
        let misfit = |k: usize| {
            let Level { state, misfit, .. } = &self.levels[k];
            if state.is_none() { f64::INFINITY } else { misfit + if k > 0 { DISTINCT } else { 0.0 } }
        };
        (0..self.levels.len()).min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap_or(0)
    }
}

/// Whether poses have said velocity and rates, which the prior before the first pose does not.
fn is_of_poses(motion: &MotionSample) -> bool {
    [(6, PRIOR_TRANSLATION.0), (9, PRIOR_ROTATION.0)].into_iter().all(|(at, prior_std)| {
        (at..at + 3).all(|k| motion.covariance.variance(k) < OF_POSES * prior_std * prior_std)
    })
}

/// Refuses a pose that is not finite or whose covariance, less its systematic part, is not positive definite.
pub(crate) fn check_pose(index: usize, sample: &PoseSample) -> Result<(), PoseError> {
    let Ok(estimate) = &sample.estimate else { return Ok(()) };
    let pose = &estimate.world_from_body;
    if !pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite()) {
        return Err(PoseError::BadPose { index, what: "the pose" });
    }
    let own = estimate.own_covariance();
    if !own.iter().all(|x| x.is_finite()) || own.cholesky().is_none() {
        return Err(PoseError::BadPose { index, what: "the covariance" });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{JerkNoise, PoseEstimate, smoother::smooth::forward_samples};
    use mavsight_geometry::{Isometry3, Matrix6, UnitQuaternion, Vector3};
    use mavsight_random::Random;
    use nalgebra::{Matrix6xX, Translation3};

    const GRAVITY: f64 = 9.81;

    fn noise() -> MotionNoise {
        MotionNoise { translation: JerkNoise::white(0.3, 1.2), rotation: JerkNoise::white(4.0, 0.8) }
    }

    fn flight(count: i64) -> Vec<PoseSample> {
        let mut random = Random::new(5, 0);
        (0..count)
            .map(|k| {
                let t = k as f64 / 30.0;
                let shift = Vector3::from(random.normals()) * 1e-3;
                let turn = Vector3::from(random.normals()) * 2e-3;
                let place = Vector3::new(t.sin(), 0.2 * t, (0.7 * t).cos()) + shift;
                let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.2 * t.sin(), 0.1, 0.4 * t))
                    * UnitQuaternion::from_scaled_axis(turn);
                let mut covariance = Matrix6::identity() * 1e-6;
                (3..6).for_each(|i| covariance[(i, i)] = 4e-6);
                covariance[(0, 4)] = 1e-6;
                covariance[(4, 0)] = 1e-6;
                let systematic =
                    Matrix6xX::from_fn(3, |i, j| (1e-4 * (i as f64 + 1.0) * (t + j as f64).cos()) as f32);
                let pose = Isometry3::from_parts(Translation3::from(place), rotation);
                let estimate = PoseEstimate::new(pose, &covariance).with_systematic(&systematic);
                let measured = k > 1 && !(60..70).contains(&k);
                PoseSample {
                    t_ns: k * 33_333_333,
                    estimate: measured.then_some(estimate).ok_or(PoseError::NotMeasured),
                }
            })
            .collect()
    }

    #[test]
    fn it_is_the_forward_pass_of_the_smoother() {
        let poses = flight(400);
        let batch = forward_samples(&poses[2..], &noise(), GRAVITY);
        let mut filter = CausalFilter::new(noise(), GRAVITY).unwrap();
        let causal: Vec<_> = poses.iter().map(|p| filter.push(p).unwrap()).collect();
        // Two instants are not measured, and poses must say velocity and rates.
        let first = causal.iter().position(Option::is_some).unwrap();
        assert!((4..8).contains(&first), "{first}");
        // The smoother's start knows a ten-thousandth of the whole record; that is forgotten.
        for (a, b) in causal[2..].iter().zip(&batch).filter_map(|(a, b)| Some((a.as_ref()?, b))).skip(250) {
            assert!(
                (a.world_from_body.translation.vector - b.world_from_body.translation.vector).norm() < 1e-9
            );
            assert!(a.world_from_body.rotation.angle_to(&b.world_from_body.rotation) < 1e-9);
            assert!((a.velocity_in_body_m_s - b.velocity_in_body_m_s).norm() < 1e-9);
            assert!((a.rates_rad_s - b.rates_rad_s).norm() < 1e-9);
            let (a, b) = (a.covariance.variances(), b.covariance.variances());
            assert!((a - b).component_div(&b).amax() < 2e-7);
        }
        let early = causal[first].as_ref().unwrap();
        assert!(early.covariance.variance(6) > 10.0 * causal[50].as_ref().unwrap().covariance.variance(6));
    }

    #[test]
    fn what_it_cannot_take_is_refused_and_changes_nothing() {
        let poses = flight(40);
        let mut filter = CausalFilter::new(noise(), GRAVITY).unwrap();
        let mut other = filter.clone();
        for p in &poses {
            let want = other.push(p).unwrap();
            let mut bad = p.clone();
            if let Ok(e) = &mut bad.estimate {
                *e = PoseEstimate::new(e.world_from_body, &Matrix6::zeros());
                assert!(matches!(filter.push(&bad), Err(PoseError::BadPose { what: "the covariance", .. })));
            }
            assert_eq!(filter.push(p).unwrap(), want);
            assert!(matches!(filter.push(p), Err(PoseError::TimeNotIncreasing { .. })));
        }
        let mut unsound = noise();
        unsound.rotation.intensity = -1.0;
        assert!(CausalFilter::new(unsound, GRAVITY).is_err());
        assert!(CausalFilter::new(noise(), f64::NAN).is_err());
    }

    /// Noise and poses may be finite and the variances that follow from them not. It gave these as motion.
    #[test]
    fn a_covariance_beyond_all_numbers_is_refused_and_the_filter_begins_again() {
        let vast = JerkNoise::white(1e303, 1e304);
        let sized = [noise(), MotionNoise { translation: vast, ..noise() }];
        for (noise, shift) in sized.into_iter().zip([1e150, 0.0]) {
            let mut filter = CausalFilter::new(noise, GRAVITY).unwrap();
            let mut refused = 0;
            for (k, mut sample) in flight(60).into_iter().enumerate() {
                if let (20, Ok(estimate)) = (k, &mut sample.estimate) {
                    estimate.world_from_body.translation.vector.y = shift;
                }
                match filter.push(&sample) {
                    Ok(Some(motion)) => {
                        assert!(motion.covariance.variances().iter().all(|v| v.is_finite() && *v > 0.0));
                        assert!(motion.velocity_in_body_m_s.iter().all(|v| v.is_finite()));
                    }
                    Ok(None) => assert!(k < 8 || (20..30).contains(&k), "{k}"),
                    Err(PoseError::BadPose { what: "the filter's covariance", .. }) => refused += 1,
                    Err(error) => panic!("{error}"),
                }
            }
            // The pose that is far off, and the one behind it at most; all poses of a noise without bounds.
            assert!(if shift > 0.0 { (1..=2).contains(&refused) } else { refused == 58 }, "{refused}");
        }
    }

    /// Its noise was that of an aircraft at rest, and velocities were wrong by thousands of standard deviations from take-off on.
    #[test]
    fn a_flight_that_begins_at_rest_has_true_velocities() {
        let (rest_s, rate_hz) = (10.0, 30.0);
        let mut random = Random::new(62, 1);
        let place = |t_s: f64| {
            let t = (t_s - rest_s).max(0.0);
            Vector3::new(0.4 * (1.0 - (2.0 * t).cos()), 0.3 * t * t / (1.0 + t), 1.5 * t * t / (1.0 + t))
        };
        let turn = |t_s: f64| {
            let t = (t_s - rest_s).max(0.0);
            UnitQuaternion::from_scaled_axis(Vector3::new(
                0.3 * (1.0 - (3.0 * t).cos()),
                0.0,
                0.2 * t * t / (1.0 + t),
            ))
        };
        let poses: Vec<PoseSample> = (0..600)
            .map(|k| {
                let t_s = f64::from(k) / rate_hz;
                let place = place(t_s) + Vector3::from(random.normals()) * 1e-3;
                let turn =
                    turn(t_s) * UnitQuaternion::from_scaled_axis(Vector3::from(random.normals()) * 2e-3);
                let mut covariance = Matrix6::identity() * 1e-6;
                (3..6).for_each(|i| covariance[(i, i)] = 4e-6);
                let estimate = PoseEstimate::new(Isometry3::from_parts(place.into(), turn), &covariance);
                PoseSample { t_ns: (t_s * 1e9) as i64, estimate: Ok(estimate) }
            })
            .collect();
        let at_rest = crate::motion_noise(&poses[..(rest_s * rate_hz) as usize]).unwrap().of_flight();
        let mut filter = CausalFilter::new(at_rest, GRAVITY).unwrap();
        let (mut squares, mut worst, mut count) = (0.0, 0.0_f64, 0.0);
        for pose in &poses {
            let Some(motion) = filter.push(pose).unwrap() else { continue };
            let (t_s, h) = (pose.t_ns as f64 * 1e-9, 1e-5);
            let velocity = turn(t_s).inverse() * ((place(t_s + h) - place(t_s - h)) / (2.0 * h));
            let rates = (turn(t_s - h).inverse() * turn(t_s + h)).scaled_axis() / (2.0 * h);
            let away = |error: Vector3<f64>, at: usize| {
                error.component_div(&motion.covariance.quantity(at).diagonal().map(f64::sqrt)).amax()
            };
            let away =
                away(motion.velocity_in_body_m_s - velocity, 2).max(away(motion.rates_rad_s - rates, 3));
            worst = worst.max(away);
            squares += away * away;
            count += 1.0;
        }
        // At once by a third of the weight, the start shows in the poses three instants later.
        let mean = squares / count;
        assert!(count > 550.0 && worst < 10.0 && (0.5..4.0).contains(&mean), "{worst}, {mean}");
    }

    /// It went on along the last acceleration, and took the first pose afterwards for some turns more.
    #[test]
    fn behind_a_long_gap_it_begins_anew() {
        let mut filter = CausalFilter::new(noise(), GRAVITY).unwrap();
        let gap = 300..1200;
        let mut last = None;
        for (k, mut sample) in flight(1500).into_iter().enumerate() {
            if gap.contains(&k) {
                sample.estimate = Err(PoseError::NotMeasured);
            }
            let motion = filter.push(&sample).unwrap();
            let unseen_s = (k as f64 - 299.0) / 30.0;
            if gap.contains(&k) && unseen_s > 0.6 * noise().longest_gap_s() {
                assert!(motion.is_none(), "frame {k}");
            }
            last = motion;
        }
        let (motion, t) = (last.unwrap(), 1499.0 / 30.0);
        let before =
            UnitQuaternion::from_scaled_axis(Vector3::new(0.2 * (t - 1e-4_f64).sin(), 0.1, 0.4 * (t - 1e-4)));
        let after =
            UnitQuaternion::from_scaled_axis(Vector3::new(0.2 * (t + 1e-4_f64).sin(), 0.1, 0.4 * (t + 1e-4)));
        let rates = (before.inverse() * after).scaled_axis() / 2e-4;
        let std = motion.covariance.quantity(3).diagonal().map(f64::sqrt);
        let away = (motion.rates_rad_s - rates).component_div(&std);
        assert!(away.amax() < 4.0, "{} for {rates}: {away}", motion.rates_rad_s);
    }
}
