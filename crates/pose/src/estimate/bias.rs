//! Systematic errors of the centres: how large they are, from residuals that do not average out.

use super::estimator::PoseEstimator;
use crate::{MarkerObservation, Observations, PoseError, PoseEstimate, PoseSample};
use nalgebra::{Matrix6xX, Vector2};
use std::collections::VecDeque;

/// Lags over which residuals are compared: what is still there after up to a second counts as systematic.
const LONGEST_LAG_S: f64 = 1.0;

/// Frames at which the shares of the known errors are computed: they change as slowly as the aircraft moves.
const SAMPLED_FRAMES: usize = 40;

impl PoseEstimator {
    /// States a constant error of centres: `std_px` for each coordinate of each marker in each camera,
    /// independent of each other. Light from one side, colours that shade into each other and lenses do that.
    /// What a ball that was not measured leaves open of the centre of one that it touches then counts too.
    ///
    /// # Errors
    /// [`PoseError::BadBias`] for what is not finite or negative.
    pub fn with_centre_bias(mut self, std_px: f64) -> Result<Self, PoseError> {
        if !(std_px.is_finite() && std_px >= 0.0) {
            return Err(PoseError::BadBias { std_px });
        }
        self.errors.bias_px = Some(std_px);
        Ok(self)
    }

    /// The standard deviation that [`PoseEstimator::with_centre_bias`] was given; 0 without.
    pub fn bias_std_px(&self) -> f64 {
        self.errors.bias_px.unwrap_or(0.0)
    }

    /// What each direction of systematic error does to a pose, in double precision: its systematic columns
    /// from the observations that it was estimated from, of which those of markers that it did not use are
    /// passed over. `None` where they do not determine it.
    pub fn systematic_effects(
        &self,
        seen: &[MarkerObservation],
        estimate: &PoseEstimate,
    ) -> Option<Matrix6xX<f64>> {
        let views = self.views_of(seen, estimate).ok()?;
        let fit = self.at_pose(&views, &estimate.world_from_body).ok()?;
        let fit = self.bounded_from(&views, fit);
        let inverse = fit.normal.cholesky()?.inverse();
        Some(self.systematic(&views, &fit, &inverse).0)
    }

    /// Standard deviation of the systematic part of the centres' errors, px, from the residuals of a flight's
    /// poses.
    ///
    /// The products of an observation's residuals at two times, up to a second apart, have the mean square of
    /// the systematic part, as far as the pose has not taken it up; new noise has a mean of zero. What the
    /// uncertainty of cameras and marker positions explains is taken off, unless that is what a fit to these
    /// observations left. Zero where nothing is left or there is no redundancy.
    ///
    /// # Errors
    /// [`PoseError::BadObservation`].
    pub fn centre_bias_px(
        &self,
        observations: &Observations,
        poses: &[PoseSample],
    ) -> Result<f64, PoseError> {
        let of_bias = |std_px: f64| self.clone().with_centre_bias(std_px);
        let (without, unit) = (of_bias(0.0)?, of_bias(1.0)?);
        let every = (poses.len() / SAMPLED_FRAMES).max(1);
        // Sum and number of the products, and the residuals of the longest lag.
        let (mut product, mut pairs, mut recent) = (0.0, 0.0, VecDeque::new());
        let (mut explained, mut by_unit, mut sampled) = (0.0, 0.0, 0.0);
        let mut seen = Vec::new();
        for (k, pose) in poses.iter().enumerate() {
            observations.at(pose.t_ns, &mut seen);
            let mut row = vec![None; self.offsets_px.len()];
            if let Ok(estimate) = &pose.estimate {
                let views = self.views_of(&seen, estimate)?;
                for o in &views {
                    let at = self.scene().at(o, &estimate.world_from_body).ok();
                    row[o.camera * self.markers.len() + o.point] = at.map(|at| at.whitened);
                }
                if k % every == 0
                    && let Ok(fit) = self.at_pose(&views, &estimate.world_from_body)
                    && let Some(factor) = fit.normal.cholesky()
                {
                    let inverse = factor.inverse();
                    let known = without.systematic(&views, &fit, &inverse).1;
                    explained += known;
                    by_unit += unit.systematic(&views, &fit, &inverse).1 - known;
                    sampled += views.len() as f64;
                }
            }
            let is_old = |before: &Residuals| (pose.t_ns - before.t_ns) as f64 * 1e-9 > LONGEST_LAG_S;
            while recent.front().is_some_and(is_old) {
                recent.pop_front();
            }
            let both = recent.iter().flat_map(|before: &Residuals| before.whitened.iter().zip(&row));
            for (a, b) in both.filter_map(|(a, b)| a.zip(*b)) {
                product += a.dot(&b);
                pairs += 1.0;
            }
            recent.push_back(Residuals { t_ns: pose.t_ns, whitened: row });
        }
        if self.errors.is_fitted {
            explained = 0.0;
        }
        if pairs < 1.0 || by_unit <= 0.0 {
            return Ok(0.0);
        }
        Ok(((product / pairs * sampled - explained) / by_unit).max(0.0).sqrt())
    }
}

/// Whitened residuals of one instant, camera by camera.
struct Residuals {
    t_ns: i64,
    whitened: Vec<Option<Vector2<f64>>>,
}
