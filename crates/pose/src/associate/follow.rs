//! The association of one instant: near a predicted pose, and otherwise by all that the detections support.

use super::associator::{Association, Associator, DECISIVE_LOG_ODDS, refused};
use super::frame::{Frame, Pairs};
use super::history::{Belief, LEAST_DEGREES};
use crate::{PoseError, PoseEstimate, PoseSample, TrackedDetection};

/// Twice the logarithm of the odds, 99 to 1, below which a ball that two markers claim is left to neither.
const DOUBTFUL_CHI_SQUARE: f64 = 9.19;

/// A detection that may be a marker's image.
struct Claim {
    index: usize,
    camera: usize,
    marker: usize,
    /// Squared distance in standard deviations.
    square: f64,
}

impl Claim {
    fn excludes(&self, other: &Self) -> bool {
        let is_one = self.index == other.index && self.marker == other.marker;
        let in_its_place = self.marker == other.marker && self.camera == other.camera;
        !is_one && (self.index == other.index || in_its_place)
    }
}

impl Associator {
    /// What the candidates of the next instant are, and the pose they give.
    pub fn associate(&mut self, t_ns: i64, candidates: &[TrackedDetection]) -> Association {
        let frame = Frame { t_ns, seen: candidates };
        self.watch_stillness(frame);
        self.watch_reconciliation(frame);
        let predicted = self.history.predicted(t_ns, self.size_m);
        let in_use = |k: usize| self.is_in_use(&candidates[k]);
        if !candidates.is_empty() && candidates.iter().all(|seen| self.is_stale(seen.camera)) {
            return refused(t_ns, self.repeated_image(frame));
        }
        if let Some(reason) = self.all_left_out(frame) {
            return refused(t_ns, reason);
        }
        let mut out = self.associated_by(frame, predicted.as_ref(), in_use);
        if let Some(belief) = predicted.as_ref().filter(|_| !self.is_sound(&out, frame)) {
            let rest = self.without_detections(frame, belief).or_else(|| self.without_one(frame, belief));
            let again = |out: &Association| {
                let lost = out.sample.estimate.is_err();
                lost.then(|| self.associated_by(frame, None, in_use)).filter(|a| a.sample.estimate.is_ok())
            };
            // An image that is repeated may be of another time: what it contradicts is not known then.
            let may_be_old = out.pairs.iter().any(|pair| self.is_repeated(candidates[pair.0].camera));
            let whole = |out| if may_be_old { refused(t_ns, self.repeated_image(frame)) } else { out };
            out = rest.or_else(|| again(&out)).unwrap_or_else(|| whole(out));
        }
        if let Some(belief) = &predicted {
            self.watch_returns(frame, &out, belief);
        }
        if let Some(belief) = &predicted
            && self.watch_cameras(frame, &out, belief)
        {
            let rest = self.associated_by(frame, Some(belief), |k| self.is_in_use(&candidates[k]));
            out = if rest.sample.estimate.is_ok() { rest } else { out };
        }
        if out.sample.estimate.is_ok() {
            self.note_agreement(frame, &out);
        }
        if let Ok(estimate) = &out.sample.estimate {
            self.history.push(t_ns, estimate, predicted.as_ref());
            let (squares, degrees) = self.misfit(estimate, frame, &out.pairs);
            self.noise.learn(estimate, squares, degrees);
            // What does not even touch the place of a marker that was left out is another object.
            let pose = &estimate.world_from_body;
            let touches = |seen: &TrackedDetection, marker: usize| {
                let at = self.expected(pose, seen.camera, marker);
                at.is_some_and(|e| (e.pixel - seen.pixel).norm() <= 0.5 * e.diameter_px)
            };
            out.pairs.retain(|(k, m)| !estimate.left_out.contains(*m) || touches(&candidates[*k], *m));
        }
        out
    }

    /// Whether two cameras or more see balls, and each of them was found to be moved.
    fn all_left_out(&self, frame: Frame) -> Option<PoseError> {
        let sees = |camera: usize| frame.seen.iter().any(|ball| ball.camera == camera);
        let seeing = || (0..self.cameras.len()).filter(|camera| sees(*camera));
        let cameras = seeing().count();
        (cameras > 1 && seeing().all(|camera| self.watch.is_moved(camera)))
            .then_some(PoseError::AllLeftOut { cameras })
    }

    /// Markers that cameras which see some of the body should see, and of which they have nothing there.
    pub(super) fn missed(&self, belief: &Belief, frame: Frame, pairs: &Pairs) -> f64 {
        let mut missed = 0;
        for camera in 0..self.cameras.len() {
            let own = || pairs.iter().filter(|p| frame.seen[p.0].camera == camera);
            if own().next().is_none() {
                continue;
            }
            missed += (0..self.colors.len())
                .filter(|m| !own().any(|p| p.1 == *m))
                .filter_map(|m| self.expected(&belief.pose, camera, m))
                .filter(|e| self.cameras[camera].size.contains(&e.pixel, 0.5 * e.diameter_px))
                .count();
        }
        missed as f64
    }

    /// Squared whitened residuals of the markers used, and their redundancy.
    pub(super) fn misfit(&self, estimate: &PoseEstimate, frame: Frame, pairs: &Pairs) -> (f64, f64) {
        let (mut squares, mut n) = (0.0, 0.0);
        for (index, marker) in pairs.iter().filter(|p| estimate.markers_used.contains(p.1)) {
            let candidate = &frame.seen[*index];
            let at = self.expected(&estimate.world_from_body, candidate.camera, *marker);
            let Some(expected) = at else { continue };
            let error = candidate.pixel - expected.pixel;
            let factor = self.detection_covariance(&expected, candidate).cholesky();
            squares += factor.map_or(0.0, |f| error.dot(&f.solve(&error)));
            n += 2.0;
        }
        (squares, n - 6.0)
    }

    /// The pose near a predicted one.
    pub(super) fn follow(&self, frame: Frame, predicted: &Belief) -> Association {
        let mut pairs = Pairs::new();
        self.assign(frame, *predicted, &mut pairs);
        match self.believed(frame, &pairs, predicted) {
            Ok(estimate) => {
                Association { sample: PoseSample { t_ns: frame.t_ns, estimate: Ok(estimate) }, pairs }
            }
            Err(reason) => refused(frame.t_ns, reason),
        }
    }

    fn believed(&self, frame: Frame, pairs: &Pairs, predicted: &Belief) -> Result<PoseEstimate, PoseError> {
        let seen = frame.observations(pairs);
        let estimate = self.estimator.estimate(frame.t_ns, &seen, Some(&predicted.pose))?;
        let square = predicted.distance(&Belief::of(&estimate));
        if square > crate::estimate::chi_square_quantile(6) {
            return Err(PoseError::UnlikelyPose { times: (square / 6.0).sqrt() });
        }
        let log_odds = self.log_odds(&estimate, frame, pairs, Some(predicted));
        let (_, degrees) = self.misfit(&estimate, frame, pairs);
        // What agrees with little else than the prediction is believed where that leaves no room for another
        // ball.
        let largest_m = self.estimator.markers().iter().map(|m| 2.0 * m.radius_m).fold(0.0, f64::max);
        let is_vague = degrees < LEAST_DEGREES && predicted.shift_m > largest_m;
        if is_vague || log_odds < DECISIVE_LOG_ODDS {
            let (balls, needed) = (frame.seen.len(), DECISIVE_LOG_ODDS);
            return Err(PoseError::UnconvincingPose { balls, log_odds, needed });
        }
        Ok(estimate)
    }

    /// Gives candidates to markers, the least doubtful first; each narrows the belief for those that follow.
    pub(super) fn assign(&self, frame: Frame, mut belief: Belief, pairs: &mut Pairs) {
        loop {
            let claims = self.claims(frame, &belief, pairs);
            let margin = |a: &Claim| {
                let rivals = claims.iter().filter(|b| a.excludes(b));
                rivals.map(|b| b.square - a.square).fold(f64::INFINITY, f64::min)
            };
            if claims.iter().all(|a| margin(a) == f64::INFINITY) {
                pairs.extend(claims.iter().map(|c| (c.index, c.marker)));
                break;
            }
            let clearest = claims
                .iter()
                .map(|c| (margin(c), c))
                .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.square.total_cmp(&a.1.square)));
            // Where even that is doubtful the rest goes to nobody.
            let Some((_, claim)) = clearest.filter(|c| c.0 >= DOUBTFUL_CHI_SQUARE) else { break };
            pairs.push((claim.index, claim.marker));
            self.narrow(&mut belief, &frame.seen[claim.index], claim.marker);
        }
        frame.sort(pairs);
    }

    /// Detections near markers' images, of those that are not given away.
    fn claims(&self, frame: Frame, belief: &Belief, pairs: &Pairs) -> Vec<Claim> {
        let gate = crate::estimate::chi_square_quantile(2);
        let mut out = Vec::with_capacity(frame.seen.len());
        for (index, candidate) in frame.seen.iter().enumerate() {
            if pairs.iter().any(|(k, _)| *k == index) {
                continue;
            }
            let camera = candidate.camera;
            for marker in (0..self.colors.len()).filter(|m| self.colors[*m] == candidate.color) {
                let is_taken = pairs.iter().any(|(k, m)| *m == marker && frame.seen[*k].camera == camera);
                let square = if is_taken { None } else { self.distance(belief, candidate, marker) };
                let near = square.filter(|d| *d <= gate);
                out.extend(near.map(|square| Claim { index, camera, marker, square }));
            }
        }
        out
    }
}
