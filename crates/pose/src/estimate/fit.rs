//! How well what was seen at one instant fits the rig and the body, whatever the pose.

use super::estimator::PoseEstimator;
use super::sample::MarkerSet;
use crate::{MarkerObservation, PoseError};

/// How far observations lie from where the best pose has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReprojectionFit {
    /// Root mean square residual, all observations counted.
    pub residual_px: f64,
    /// In standard deviations as they are to be expected of centres, cameras and markers: 1 on average.
    pub ratio: f64,
}

impl PoseEstimator {
    /// How well the observations of one instant fit, none left out and none refused; without a number where
    /// no pose was found (`ratio` is infinite then), and `None` for observations that fit anything.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`].
    pub fn reprojection_fit(
        &self,
        observations: &[MarkerObservation],
    ) -> Result<Option<ReprojectionFit>, PoseError> {
        let views = self.views(observations)?;
        let used: MarkerSet = views.iter().map(|s| s.point).collect();
        if used.len() < 3 || 2 * views.len() <= 6 {
            return Ok(None);
        }
        let Ok(fit) = self.solve(&views, used, None) else {
            return Ok(Some(ReprojectionFit { residual_px: f64::INFINITY, ratio: f64::INFINITY }));
        };
        let expected = self.claimed_excess(&views, used, &fit);
        let ratio = (fit.chi_square / fit.redundancy().max(1) as f64 / expected).sqrt();
        Ok(Some(ReprojectionFit { residual_px: fit.residual_px(), ratio }))
    }
}

#[cfg(test)]
mod tests {
    use crate::estimate::tests::{body, seen, truth};
    use crate::testing::rig;
    use crate::{PoseEstimator, ReprojectionFit};

    #[test]
    fn noise_as_claimed_fits_once_and_a_camera_in_the_place_of_another_does_not() {
        let estimator = PoseEstimator::new(&rig(), &body());
        let (mut seed, mut squares, trials) = (5, 0.0, 60);
        for _ in 0..trials {
            let mut now = seen(&truth(), 0.1, &mut seed);
            let fit = estimator.reprojection_fit(&now).unwrap().unwrap();
            squares += fit.ratio.powi(2) / f64::from(trials);
            assert!(fit.residual_px < 0.2, "{fit:?}");
            now.iter_mut().for_each(|o| o.camera = 1 - o.camera);
            let ReprojectionFit { ratio, .. } = estimator.reprojection_fit(&now).unwrap().unwrap();
            assert!(ratio > 20.0, "{ratio}");
        }
        // Mean of a chi-square over its ten degrees of freedom, sixty ratio.
        assert!((squares - 1.0).abs() < 0.2, "{squares}");
        let few = &seen(&truth(), 0.1, &mut seed)[..3];
        assert_eq!(estimator.reprojection_fit(few).unwrap(), None);
    }
}
