//! Which of the balls that the cameras see are which markers: what the rigid body and all cameras
//! together support.
//!
//! Near a predicted pose each ball is given to the marker whose image it may be; without one, triangles
//! of balls that two cameras see are compared with those of the body. A pose that nothing predicted is
//! believed where the odds for it, against balls that lie in the images by chance and against any other
//! pose, are 999 to 1.

mod acquire;
mod belief;
mod evidence;
mod symmetry;
mod watch;

use crate::{MarkerObservation, PoseError, PoseEstimator, PoseSample, Rig, TrackedDetection};
use belief::{Belief, History};
use evidence::Noise;
use mavsight_geometry::{Camera, Vector3};
pub use watch::MovedCamera;
use watch::Watch;

/// Logarithm of the odds at which an assignment is believed: 999 to 1.
const DECISIVE_LOG_ODDS: f64 = 6.907;
/// Twice the logarithm of the odds, 99 to 1, below which a ball that two markers claim is left to neither.
const DOUBTFUL_CHI_SQUARE: f64 = 9.19;
/// Largest ratio between the diameter seen and the one expected: a ball half hidden still shows more.
const MOST_SIZE_RATIO: f64 = 1.6;

/// Redundancy from which one instant shows how large its noise is: three markers in two cameras.
const LEAST_DEGREES: f64 = 6.0;

/// What one instant's candidates are.
#[derive(Debug, Clone, PartialEq)]
pub struct Association {
    /// The pose, or why there is none.
    pub sample: PoseSample,
    /// Index of the candidate and of its marker, by camera and marker; none without a pose.
    pub pairs: Vec<(usize, usize)>,
}

/// Gives balls to markers, instant by instant.
#[derive(Debug, Clone)]
pub struct Associator {
    estimator: PoseEstimator,
    cameras: Vec<Camera>,
    colors: Vec<usize>,
    markers_std_m: f64,
    /// Room in which the body may be.
    volume_m3: f64,
    /// Root mean square distance of the markers from their middle.
    size_m: f64,
    history: History,
    noise: Noise,
    watch: Watch,
}

impl Associator {
    /// An associator for the body of an estimator, whose markers have the given colours (equal numbers
    /// for equal colours) and were placed with a standard deviation.
    ///
    /// # Errors
    /// [`PoseError::SymmetricMarkers`] where markers of one colour can change places so that the body
    /// looks the same.
    pub fn new(
        estimator: PoseEstimator,
        rig: &Rig,
        colors: &[usize],
        markers_std_m: f64,
    ) -> Result<Self, PoseError> {
        let markers = estimator.markers();
        let mut colors = colors.to_vec();
        colors.resize(markers.len(), usize::MAX);
        symmetry::refuse_symmetric(markers, &colors, markers_std_m)?;
        let n = markers.len().max(1) as f64;
        let middle = markers.iter().map(|m| m.marker_in_body_m).sum::<Vector3<f64>>() / n;
        let square = |m: &crate::BodyMarker| (m.marker_in_body_m - middle).norm_squared();
        let size_m = (markers.iter().map(square).sum::<f64>() / n).sqrt().max(1e-3);
        let cameras: Vec<Camera> = rig.cameras.iter().map(|c| c.camera).collect();
        let volume_m3 = room_m3(rig, &cameras);
        let (history, noise, watch) = Default::default();
        Ok(Self { estimator, cameras, colors, markers_std_m, volume_m3, size_m, history, noise, watch })
    }

    /// The estimator of poses.
    pub fn estimator(&self) -> &PoseEstimator {
        &self.estimator
    }

    /// Ends the associations and keeps the estimator.
    pub fn into_estimator(self) -> PoseEstimator {
        self.estimator
    }

    /// What the candidates of the next instant are, and the pose they give.
    pub fn associate(&mut self, t_ns: i64, candidates: &[TrackedDetection]) -> Association {
        let predicted = self.history.predicted(t_ns, self.size_m);
        let in_use = |k: usize| self.is_in_use(&candidates[k]);
        let mut out = self.associated_by(t_ns, candidates, predicted.as_ref(), in_use);
        if let Some(belief) = predicted.as_ref().filter(|_| !self.is_sound(&out, candidates)) {
            let rest = self.without_detections(t_ns, candidates, belief);
            if let Some(rest) = rest.or_else(|| self.without_one(t_ns, candidates, belief)) {
                out = rest;
            } else if out.sample.estimate.is_none() {
                let anew = self.associated_by(t_ns, candidates, None, in_use);
                out = if anew.sample.estimate.is_some() { anew } else { out };
            }
        }
        if let Some(belief) = &predicted
            && self.watch_cameras(t_ns, candidates, (&out, belief))
        {
            let rest = self.associated_by(t_ns, candidates, Some(belief), |k| self.is_in_use(&candidates[k]));
            out = if rest.sample.estimate.is_some() { rest } else { out };
        }
        if let Some(estimate) = &out.sample.estimate {
            self.history.push(t_ns, estimate, predicted.as_ref());
            let (squares, degrees) = self.misfit(estimate, candidates, &out.pairs);
            self.noise.learn(estimate, squares, degrees);
            self.drop_strangers(estimate, candidates, &mut out.pairs);
        }
        out
    }

    /// Markers that cameras which see some of the body should see, and of which they have nothing there.
    fn missed(&self, belief: &Belief, candidates: &[TrackedDetection], pairs: &[(usize, usize)]) -> f64 {
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
    fn misfit(
        &self,
        estimate: &crate::PoseEstimate,
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
        estimate: &crate::PoseEstimate,
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

    /// The pose near a predicted one.
    fn follow(&self, t_ns: i64, candidates: &[TrackedDetection], predicted: &Belief) -> Association {
        let mut pairs = Vec::new();
        self.assign(candidates, *predicted, &mut pairs);
        let seen = observations(t_ns, candidates, &pairs);
        match self.estimator.estimate(t_ns, &seen, Some(&predicted.pose)) {
            Ok(estimate) => {
                let square = predicted.distance(&Belief::of(&estimate));
                if square > crate::estimate::chi_square_quantile(6) {
                    return refused(t_ns, &PoseError::UnlikelyPose { times: (square / 6.0).sqrt() });
                }
                let log_odds = self.log_odds(&estimate, candidates, &pairs, Some(predicted));
                let (_, degrees) = self.misfit(&estimate, candidates, &pairs);
                // What agrees with little else than the prediction is believed where that leaves no room
                // for another ball.
                let largest_m = self.estimator.markers().iter().map(|m| 2.0 * m.radius_m).fold(0.0, f64::max);
                let vague = degrees < LEAST_DEGREES && predicted.shift_m > largest_m;
                if vague || log_odds < DECISIVE_LOG_ODDS {
                    let (balls, needed) = (candidates.len(), DECISIVE_LOG_ODDS);
                    return refused(t_ns, &PoseError::UnconvincingPose { balls, log_odds, needed });
                }
                Association { sample: PoseSample { t_ns, estimate: Some(estimate), reason: None }, pairs }
            }
            Err(refusal) => refused(t_ns, &refusal),
        }
    }

    /// Gives candidates to markers, the least doubtful first; each narrows the belief for those that follow.
    fn assign(&self, candidates: &[TrackedDetection], mut belief: Belief, pairs: &mut Vec<(usize, usize)>) {
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

/// Twice the box around the control points each way, or the cameras' where there are none.
fn room_m3(rig: &Rig, cameras: &[Camera]) -> f64 {
    let mut points = rig.control_points_in_world();
    points.extend(cameras.iter().map(Camera::centre_in_world));
    let low = points.iter().fold(Vector3::repeat(f64::MAX), |a, p| a.inf(p));
    let high = points.iter().fold(Vector3::repeat(f64::MIN), |a, p| a.sup(p));
    (high - low).iter().map(|side| 2.0 * side.clamp(1.0, 1e3)).product()
}

fn refused(t_ns: i64, reason: &PoseError) -> Association {
    Association {
        sample: PoseSample { t_ns, estimate: None, reason: Some(reason.to_string()) },
        pairs: Vec::new(),
    }
}

/// The pairs as observations of markers.
pub(crate) fn observations(
    t_ns: i64,
    candidates: &[TrackedDetection],
    pairs: &[(usize, usize)],
) -> Vec<MarkerObservation> {
    pairs
        .iter()
        .map(|(index, marker)| MarkerObservation { t_ns, ..candidates[*index].of_marker(*marker) })
        .collect()
}

#[cfg(test)]
mod tests;
