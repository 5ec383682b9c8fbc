//! The association of one instant: near a predicted pose, and otherwise by all that the detections support.

use super::associator::{Association, Associator, DECISIVE_LOG_ODDS, observations, refused};
use super::belief::Belief;
use super::noise::LEAST_DEGREES;
use crate::{PoseError, PoseEstimate, PoseSample, TrackedDetection};

/// Twice the logarithm of the odds, 99 to 1, below which a ball that two markers claim is left to neither.
const DOUBTFUL_CHI_SQUARE: f64 = 9.19;

impl Associator {
    /// What the candidates of the next instant are, and the pose they give.
    pub fn associate(&mut self, t_ns: i64, candidates: &[TrackedDetection]) -> Association {
        let predicted = self.history.predicted(t_ns, self.size_m);
        let in_use = |k: usize| self.is_in_use(&candidates[k]);
        let mut out = self.associated_by(t_ns, candidates, predicted.as_ref(), in_use);
        if let Some(belief) = predicted.as_ref().filter(|_| !self.is_sound(&out, candidates)) {
            let rest = self.without_detections(t_ns, candidates, belief);
            if let Some(rest) = rest.or_else(|| self.without_one(t_ns, candidates, belief)) {
                out = rest;
            } else if out.sample.estimate.is_err() {
                let anew = self.associated_by(t_ns, candidates, None, in_use);
                out = if anew.sample.estimate.is_ok() { anew } else { out };
            }
        }
        if let Some(belief) = &predicted
            && self.watch_cameras(t_ns, candidates, (&out, belief))
        {
            let rest = self.associated_by(t_ns, candidates, Some(belief), |k| self.is_in_use(&candidates[k]));
            out = if rest.sample.estimate.is_ok() { rest } else { out };
        }
        if let Ok(estimate) = &out.sample.estimate {
            self.history.push(t_ns, estimate, predicted.as_ref());
            let (squares, degrees) = self.misfit(estimate, candidates, &out.pairs);
            self.noise.learn(estimate, squares, degrees);
            self.drop_strangers(estimate, candidates, &mut out.pairs);
        }
        out
    }

    /// Markers that cameras which see some of the body should see, and of which they have nothing there.
    pub(super) fn missed(
        &self,
        belief: &Belief,
        candidates: &[TrackedDetection],
        pairs: &[(usize, usize)],
    ) -> f64 {
        let mut missed = 0;
        for camera in 0..self.cameras.len() {
            let own = |p: &&(usize, usize)| candidates[p.0].camera == camera;
            if !pairs.iter().any(|p| own(&p)) {
                continue;
            }
            missed += (0..self.colors.len())
                .filter(|m| !pairs.iter().filter(own).any(|p| p.1 == *m))
                .filter_map(|m| self.expected(&belief.pose, camera, m))
                .filter(|e| self.cameras[camera].size.contains(&e.pixel, 0.5 * e.diameter_px))
                .count();
        }
        missed as f64
    }

    /// Squared whitened residuals of the markers used, and their redundancy.
    pub(super) fn misfit(
        &self,
        estimate: &PoseEstimate,
        candidates: &[TrackedDetection],
        pairs: &[(usize, usize)],
    ) -> (f64, f64) {
        let (mut squares, mut n) = (0.0, 0.0);
        for (index, marker) in pairs.iter().filter(|p| estimate.markers_used.contains(p.1)) {
            let candidate = &candidates[*index];
            let at = self.expected(&estimate.world_from_body, candidate.camera, *marker);
            let Some(expected) = at else { continue };
            let error = candidate.pixel - expected.pixel;
            let factor = self.detection_covariance(&expected, candidate).cholesky();
            squares += factor.map_or(0.0, |f| error.dot(&f.solve(&error)));
            n += 2.0;
        }
        (squares, n - 6.0)
    }

    /// Takes from markers that were left out what does not even touch their place: another object.
    fn drop_strangers(
        &self,
        estimate: &PoseEstimate,
        candidates: &[TrackedDetection],
        pairs: &mut Vec<(usize, usize)>,
    ) {
        pairs.retain(|(index, marker)| {
            let candidate = &candidates[*index];
            !estimate.left_out.contains(*marker)
                || self
                    .expected(&estimate.world_from_body, candidate.camera, *marker)
                    .is_some_and(|e| (e.pixel - candidate.pixel).norm() <= 0.5 * e.diameter_px)
        });
    }

    pub(super) fn follow(
        &self,
        t_ns: i64,
        candidates: &[TrackedDetection],
        predicted: &Belief,
    ) -> Association {
        let mut pairs = Vec::new();
        self.assign(candidates, *predicted, &mut pairs);
        let seen = observations(t_ns, candidates, &pairs);
        match self.estimator.estimate(t_ns, &seen, Some(&predicted.pose)) {
            Ok(estimate) => {
                let square = predicted.distance(&Belief::of(&estimate));
                if square > crate::estimate::chi_square_quantile(6) {
                    return refused(t_ns, PoseError::UnlikelyPose { times: (square / 6.0).sqrt() });
                }
                let log_odds = self.log_odds(&estimate, candidates, &pairs, Some(predicted));
                let (_, degrees) = self.misfit(&estimate, candidates, &pairs);
                // What agrees with little else than the prediction is believed where that leaves no room for
                // another ball.
                let largest_m = self.estimator.markers().iter().map(|m| 2.0 * m.radius_m).fold(0.0, f64::max);
                let vague = degrees < LEAST_DEGREES && predicted.shift_m > largest_m;
                if vague || log_odds < DECISIVE_LOG_ODDS {
                    let (balls, needed) = (candidates.len(), DECISIVE_LOG_ODDS);
                    return refused(t_ns, PoseError::UnconvincingPose { balls, log_odds, needed });
                }
                Association { sample: PoseSample { t_ns, estimate: Ok(estimate) }, pairs }
            }
            Err(refusal) => refused(t_ns, refusal),
        }
    }

    /// Gives candidates to markers, the least doubtful first; each narrows the belief for those that follow.
    pub(super) fn assign(
        &self,
        candidates: &[TrackedDetection],
        mut belief: Belief,
        pairs: &mut Vec<(usize, usize)>,
    ) {
        let markers = self.colors.len();
        let gate = crate::estimate::chi_square_quantile(2);
        let mut options: Vec<(usize, usize, f64)> = Vec::with_capacity(candidates.len());
        loop {
            options.clear();
            for (index, candidate) in candidates.iter().enumerate() {
                if pairs.iter().any(|(c, _)| *c == index) {
                    continue;
                }
                for marker in (0..markers).filter(|m| self.colors[*m] == candidate.color) {
                    let taken =
                        |(c, m): &(usize, usize)| *m == marker && candidates[*c].camera == candidate.camera;
                    if pairs.iter().any(taken) {
                        continue;
                    }
                    if let Some(square) = self.distance(&belief, candidate, marker).filter(|d| *d <= gate) {
                        options.push((index, marker, square));
                    }
                }
            }
            let rivals = |a: &(usize, usize, f64), b: &(usize, usize, f64)| {
                (a.0, a.1) != (b.0, b.1)
                    && (a.0 == b.0 || (a.1 == b.1 && candidates[a.0].camera == candidates[b.0].camera))
            };
            let margin = |a: &(usize, usize, f64)| {
                options.iter().filter(|b| rivals(a, b)).map(|b| b.2 - a.2).fold(f64::INFINITY, f64::min)
            };
            if options.iter().all(|a| margin(a) == f64::INFINITY) {
                pairs.extend(options.iter().map(|o| (o.0, o.1)));
                break;
            }
            let clear = options
                .iter()
                .map(|o| (margin(o), o))
                .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.2.total_cmp(&a.1.2)));
            let Some((margin, &(index, marker, _))) = clear else { break };
            if margin < DOUBTFUL_CHI_SQUARE {
                // What nobody else claims is taken all the same; the rest goes to neither.
                break;
            }
            pairs.push((index, marker));
            self.narrow(&mut belief, &candidates[index], marker);
        }
        pairs.sort_unstable_by_key(|(c, m)| (candidates[*c].camera, *m));
    }
}
