//! How good each ball's centres in each camera are, from the residuals of a flight.

use super::PoseEstimator;
use super::gates::CLAIM_DEGREES;
use super::solve::Sight;
use crate::{Observations, PoseError, PoseSample};
use mavsight_geometry::camera::d_pixel_d_pose;

impl PoseEstimator {
    /// Factors on the claimed covariances of the centres, camera by camera and marker by marker: a ball in front of a window is
    /// worse than its pixels tell, all the while.
    ///
    /// One step of the estimation of variance components: the sum of a group's squared residuals over the sum of its
    /// redundancies (Foerstner 1979; Rao 1971), with the claim counting as much as one frame. Below one is set to one, since the
    /// claim is the least that the pixels permit.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`].
    pub fn centre_factors(
        &self,
        observations: &Observations,
        poses: &[PoseSample],
    ) -> Result<Vec<f64>, PoseError> {
        let mut sums = vec![(CLAIM_DEGREES, CLAIM_DEGREES); self.cameras.len() * self.markers.len()];
        let mut seen = Vec::new();
        for pose in poses {
            observations.at(pose.t_ns, &mut seen);
            let Some(estimate) = &pose.estimate else { continue };
            let used = seen.iter().filter(|o| estimate.markers_used.contains(o.marker));
            let sights = used.map(|o| self.sight(o)).collect::<Result<Vec<Sight>, _>>()?;
            let Ok(solution) = self.at_pose(&sights, &estimate.world_from_body) else { continue };
            let Some(inverse) = solution.normal.cholesky().map(|c| c.inverse()) else { continue };
            for s in &sights {
                let Ok(at) = self.projected(s, &estimate.world_from_body) else { continue };
                let place = &self.markers[s.marker].marker_in_body_m;
                let jacobian = s.whitener * d_pixel_d_pose(&at, &estimate.world_from_body, place);
                let (square, redundancy) = &mut sums[s.camera * self.markers.len() + s.marker];
                *square += (s.whitener * (s.pixel - at.pixel)).norm_squared();
                *redundancy += 2.0 - (jacobian * inverse * jacobian.transpose()).trace();
            }
        }
        Ok(sums.iter().map(|(square, redundancy)| (square / redundancy).max(1.0)).collect())
    }
}
