//! How good each ball's centres in each camera are, across and down, from the residuals of a flight.

use super::estimator::PoseEstimator;
use super::gates::CLAIM_DEGREES;
use crate::{Observations, PoseError, PoseSample};
use mavsight_geometry::Vector2;

impl PoseEstimator {
    /// Factors on the claimed variances of the centres' columns and rows, camera by camera and marker by
    /// marker: a ball before a window is always worse than its pixels show.
    ///
    /// One step of the estimation of variance components: the sum of a group's squared residuals over the sum
    /// of its redundancies (Foerstner 1979; Rao 1971), with the claim counting as much as one frame. It leads
    /// towards the true components but not beyond. No factor is held at or above one, which would widen the
    /// claims of short flights.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`].
    pub fn centre_factors(
        &self,
        observations: &Observations,
        poses: &[PoseSample],
    ) -> Result<Vec<Vector2<f64>>, PoseError> {
        let claim = Vector2::repeat(0.5 * CLAIM_DEGREES);
        let mut sums = vec![(claim, claim); self.cameras.len() * self.markers.len()];
        let mut seen = Vec::new();
        for pose in poses {
            observations.at(pose.t_ns, &mut seen);
            let Ok(estimate) = &pose.estimate else { continue };
            let views = self.views_of(&seen, estimate)?;
            let Ok(fit) = self.at_pose(&views, &estimate.world_from_body) else { continue };
            let Some(inverse) = fit.normal.cholesky().map(|c| c.inverse()) else { continue };
            for o in &views {
                let Ok(at) = self.scene().at(o, &estimate.world_from_body) else { continue };
                let whitened_px2 = at.by_pose * inverse * at.by_pose.transpose();
                let Some(root) = o.whitener.try_inverse() else { continue };
                let (claimed_px2, pose_px2) = (o.covariance_px2, root * whitened_px2 * root.transpose());
                let (square, redundancy) = &mut sums[o.camera * self.markers.len() + o.point];
                for (k, left_px) in at.residual_px.iter().enumerate() {
                    square[k] += left_px * left_px / claimed_px2[(k, k)];
                    redundancy[k] += 1.0 - pose_px2[(k, k)] / claimed_px2[(k, k)];
                }
            }
        }
        Ok(sums.iter().map(|(square, redundancy)| square.component_div(redundancy)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MarkerObservation;
    use crate::estimate::tests::{body, seen, truth};
    use crate::testing::rig;
    use mavsight_random::Random;

    /// So many frames with noise of 0.1 px, as claimed; only one observation's noise across and down is so
    /// many times that.
    fn flight(
        estimator: &PoseEstimator,
        (frames, spoilt, times): (i64, (usize, usize), Vector2<f64>),
        random: &mut Random,
    ) -> (Vec<MarkerObservation>, Vec<PoseSample>) {
        let (mut views, mut poses) = (Vec::new(), Vec::new());
        for t_ns in 0..frames {
            let mut now = seen(&truth(), 0.1, random);
            for o in &mut now {
                o.t_ns = t_ns;
                if (o.camera, o.marker) == spoilt {
                    let exact = seen(&truth(), 0.0, &mut Random::new(1, 0))
                        .into_iter()
                        .find(|e| (e.camera, e.marker) == spoilt);
                    let pixel = exact.unwrap().pixel;
                    o.pixel = pixel + (o.pixel - pixel).component_mul(&times);
                }
            }
            let estimate = estimator.estimate(t_ns, &now, None);
            poses.push(PoseSample { t_ns, estimate });
            views.extend(now);
        }
        (views, poses)
    }

    /// Marker 2 is three times as noisy in the second camera as it claims, or across half as noisy and down
    /// twice.
    #[test]
    fn factors_show_which_ball_is_worse_or_better_than_it_claims_and_in_which_direction() {
        let estimator = PoseEstimator::new(&rig(), &body());
        for times in [Vector2::new(3.0, 3.0), Vector2::new(0.5, 2.0)] {
            let (mut views, mut poses) = flight(&estimator, (400, (1, 2), times), &mut Random::new(1, 0));
            // Twice, as where a flight is refined: the product nears the variance component.
            let mut total = [Vector2::repeat(1.0); 8];
            for _ in 0..2 {
                let mut scaled: Observations = views.iter().collect();
                let factors = estimator.centre_factors(&scaled, &poses).unwrap();
                total.iter_mut().zip(&factors).for_each(|(t, f)| t.component_mul_assign(f));
                scaled.scale_covariances(|camera, marker| factors[4 * camera + marker]);
                views = scaled.iter().collect();
                for (pose, own) in poses.iter_mut().zip(views.chunks(8)) {
                    pose.estimate = estimator.estimate(pose.t_ns, own, None);
                }
            }
            for (k, factor) in total.iter().enumerate() {
                let want = if k == 6 { times.component_mul(&times) } else { Vector2::repeat(1.0) };
                let times_off = factor.component_div(&want).map(|f| f.max(1.0 / f)).max();
                assert!(times_off < 1.75, "{k}: {factor} for {want}");
            }
        }
    }

    #[test]
    fn claims_of_short_flights_are_not_widened_by_chance() {
        let estimator = PoseEstimator::new(&rig(), &body());
        let (mut random, mut sum, mut count) = (Random::new(43, 0), 0.0, 0.0);
        for _ in 0..300 {
            let (views, poses) = flight(&estimator, (3, (0, 0), Vector2::repeat(1.0)), &mut random);
            for factor in estimator.centre_factors(&views.iter().collect(), &poses).unwrap() {
                sum += factor.sum();
                count += 2.0;
            }
        }
        let mean: f64 = sum / count;
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
    }
}
