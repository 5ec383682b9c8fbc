//! The filter as poses arrive: the forward pass of the smoother.

use crate::smoother::state::{Joint, MotionNoise, Update};
use crate::{MotionSample, PoseError, PoseSample};

/// Motion from the poses so far, for use while the flight goes on. It is the forward pass of
/// [`crate::smooth`] with the noise given, for example that of an earlier flight by [`crate::motion_noise`].
///
/// After the first pose, which makes room for its systematic columns, nothing is allocated.
#[derive(Debug, Clone)]
pub struct CausalFilter {
    noise: MotionNoise,
    gravity_m_s2: f64,
    t_ns: i64,
    seen_ns: i64,
    longest_gap_s: f64,
    index: usize,
    state: Option<(Joint, Update)>,
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
        let (t_ns, longest_gap_s) = (i64::MIN, noise.longest_gap_s());
        Ok(Self { noise, gravity_m_s2, t_ns, seen_ns: t_ns, longest_gap_s, index: 0, state: None })
    }

    /// Takes one instant in, measured or not: the motion then, or nothing before the first pose and half of
    /// [`MotionNoise::longest_gap_s`] after the last; beyond the whole of it the filter begins again.
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
        let unseen_s = sample.t_ns.saturating_sub(self.seen_ns) as f64 * 1e-9;
        if unseen_s > self.longest_gap_s {
            self.state = None;
        }
        let unsound = PoseError::BadPose { index: self.index, what: "the filter's covariance" };
        match (&mut self.state, &sample.estimate) {
            (None, Err(_)) => {}
            (None, Ok(first)) => {
                let joint = Joint::start(first, first.systematic_columns(), &self.noise);
                let update = joint.blank_update();
                self.state = Some((joint, update));
            }
            (Some((joint, update)), seen) => {
                joint.predict((sample.t_ns - self.t_ns) as f64 * 1e-9, &self.noise);
                if let Ok(seen) = seen
                    && joint.update(seen, &self.noise, update).is_none()
                {
                    self.state = None;
                    return Err(unsound);
                }
            }
        }
        let is_seen = sample.estimate.is_ok();
        let known = self.state.as_ref().filter(|_| is_seen || unseen_s <= 0.5 * self.longest_gap_s);
        let motion = known.map(|(joint, _)| joint.sample(sample.t_ns, self.gravity_m_s2).ok_or(unsound));
        if let Some(Err(unsound)) = motion {
            self.state = None;
            return Err(unsound);
        }
        self.t_ns = sample.t_ns;
        self.index += 1;
        if is_seen {
            self.seen_ns = sample.t_ns;
        }
        motion.transpose()
    }
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
        assert!(causal[0].is_none() && causal[1].is_none() && causal[2].is_some());
        // The smoother's start knows a ten-thousandth of the whole record; that is forgotten.
        for (a, b) in causal.iter().flatten().zip(&batch).skip(250) {
            assert!(
                (a.world_from_body.translation.vector - b.world_from_body.translation.vector).norm() < 1e-9
            );
            assert!(a.world_from_body.rotation.angle_to(&b.world_from_body.rotation) < 1e-9);
            assert!((a.velocity_in_body_m_s - b.velocity_in_body_m_s).norm() < 1e-9);
            assert!((a.rates_rad_s - b.rates_rad_s).norm() < 1e-9);
            let (a, b) = (a.covariance.variances(), b.covariance.variances());
            assert!((a - b).component_div(&b).amax() < 2e-7);
        }
        let early = causal[4].as_ref().unwrap();
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
                    Ok(None) => assert!(k < 2),
                    Err(PoseError::BadPose { what: "the filter's covariance", .. }) => refused += 1,
                    Err(error) => panic!("{error}"),
                }
            }
            // The pose that is far off, and the one behind it at most; all poses of a noise without bounds.
            assert!(if shift > 0.0 { (1..=2).contains(&refused) } else { refused == 58 }, "{refused}");
        }
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
