//! Which of the balls that the cameras see are which markers: what the rigid body and all cameras together support.
//!
//! Near a predicted pose each ball is given to the marker whose image it may be; without one, triangles of balls that two
//! cameras see are compared with those of the body. A pose that nothing predicted is believed where the odds for it,
//! against balls that lie in the images by chance and against any other pose, are 999 to 1.

mod acquire;
mod belief;
mod symmetry;
mod watch;

use crate::{MarkerObservation, PoseError, PoseEstimator, PoseSample, Rig, TrackedDetection};
use belief::{Belief, Expected, History};
use mavsight_geometry::{Camera, Matrix3, Matrix6, Vector3};
use nalgebra::{Cholesky, Const};
use std::f64::consts::PI;
pub use watch::MovedCamera;
use watch::Watch;

/// Logarithm of the odds at which an assignment is believed: 999 to 1.
const DECISIVE_LOG_ODDS: f64 = 6.907;
/// Twice the logarithm of the odds, 99 to 1, below which a ball that two markers claim is left to neither.
const DOUBTFUL_CHI_SQUARE: f64 = 9.19;
/// Largest ratio between the diameter seen and the one expected: a ball half hidden still shows more.
const MOST_SIZE_RATIO: f64 = 1.6;

/// Redundancy from which one instant tells how large its noise is: three markers in two cameras.
const LEAST_DEGREES: f64 = 6.0;
/// Weight of the noise known before against one instant's, in degrees of freedom: as much as four markers in two cameras
/// have.
const CLAIM_DEGREES: f64 = 10.0;
/// Logarithm of the share of balls that are hidden by something else than what hides all of them: one in ten.
const LOG_MISSED: f64 = -2.303;
/// Share of what is known of the noise that lasts from frame to frame: some seconds of video.
const NOISE_MEMORY: f64 = 0.99;

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
    /// An associator for the body of an estimator, whose markers have the given colours (equal numbers for equal colours) and
    /// were placed with a standard deviation.
    ///
    /// # Errors
    /// [`PoseError::SymmetricMarkers`] where markers of one colour can change places so that the body looks the same.
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
        let mut out = self.told_by(t_ns, candidates, predicted.as_ref(), in_use);
        if let Some(belief) = predicted.as_ref().filter(|_| !self.is_sound(&out, candidates)) {
            let rest = self.without_sights(t_ns, candidates, belief);
            if let Some(rest) = rest.or_else(|| self.without_one(t_ns, candidates, belief)) {
                out = rest;
            } else if out.sample.estimate.is_none() {
                let anew = self.told_by(t_ns, candidates, None, in_use);
                out = if anew.sample.estimate.is_some() { anew } else { out };
            }
        }
        if let Some(belief) = &predicted
            && self.watch_cameras(t_ns, candidates, (&out, belief))
        {
            let rest = self.told_by(t_ns, candidates, Some(belief), |k| self.is_in_use(&candidates[k]));
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
            let factor = self.sight_covariance(&expected, candidate).cholesky();
            squares += factor.map_or(0.0, |f| error.dot(&f.solve(&error)));
            n += 2.0;
        }
        (squares, n - 6.0)
    }

    /// Takes from markers that were left out what does not even touch their place: another thing.
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
                // What agrees with little else than the prediction is believed where that leaves no room for another ball.
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
                // What nobody else claims is taken all the same; the rest stays with neither.
                break;
            }
            pairs.push((index, marker));
            self.narrow(&mut belief, &candidates[index], marker);
        }
        pairs.sort_unstable_by_key(|(c, m)| (candidates[*c].camera, *m));
    }

    /// Odds, as their logarithm, of the body where the estimate says against other things of the markers' colours: the
    /// evidence of the sights by Laplace's approximation (MacKay 1992), for poses as predicted, or uniform over room and
    /// rotations, with the noise scaled as the flight so far, or these residuals, ask for. Other things lie anywhere in an image, or anywhere in the room where two
    /// cameras see them, whichever explains the sights better.
    fn log_odds(
        &self,
        estimate: &crate::PoseEstimate,
        candidates: &[TrackedDetection],
        pairs: &[(usize, usize)],
        predicted: Option<&Belief>,
    ) -> f64 {
        let belief = Belief::of(estimate);
        let mut normal = Matrix6::zeros();
        let mut things = vec![Thing::default(); self.colors.len()];
        for (index, marker) in pairs.iter().filter(|p| estimate.markers_used.contains(p.1)) {
            let candidate = &candidates[*index];
            let Some(expected) = self.expected(&belief.pose, candidate.camera, *marker) else { continue };
            let Some(factor) = self.sight_covariance(&expected, candidate).cholesky() else { continue };
            normal += expected.jacobian.transpose() * factor.solve(&expected.jacobian);
            let alike = |c: &&TrackedDetection| c.camera == candidate.camera && c.color == candidate.color;
            let rivals = candidates.iter().filter(alike).count() as f64;
            let area_px2 = self.cameras[candidate.camera].size.area_px() as f64;
            things[*marker].add(&expected, candidate, &factor, (rivals, area_px2));
        }
        let n: usize = things.iter().map(|t| t.sights).sum();
        if n < 3 {
            return f64::NEG_INFINITY;
        }
        let squares: f64 = things.iter().map(|t| t.square).sum();
        let (scale, log_misfit) = self.noise.misfit(squares, (2 * n).saturating_sub(6) as f64);
        let apart = |t: &Thing| t.log_spread(scale) - t.log_chance(scale, self.volume_m3);
        let log_missed = LOG_MISSED * self.missed(&belief, candidates, pairs);
        let of_things: f64 = log_missed + log_misfit + things.iter().map(apart).sum::<f64>();
        let log_prior = match predicted {
            Some(predicted) => -predicted.log_density(&belief),
            None => (self.volume_m3 * 8.0 * PI * PI).ln(),
        };
        let log_posterior = 3.0 * (2.0 * PI * scale).ln() - 0.5 * normal.determinant().ln();
        let odds = of_things - log_prior + log_posterior;
        if odds.is_nan() { f64::NEG_INFINITY } else { odds }
    }
}

/// What the residuals so far tell of the claimed covariances.
#[derive(Debug, Clone, Copy, Default)]
struct Noise {
    squares: f64,
    degrees: f64,
}

impl Noise {
    /// The factor on the claims, and the logarithm of the misfit's density: Student's, as the factor is known as if by
    /// [`CLAIM_DEGREES`] (Gelman et al. 2013, section 2.6); where nothing was seen yet and residuals tell more than that, theirs.
    fn misfit(&self, squares: f64, degrees: f64) -> (f64, f64) {
        if self.degrees == 0.0 && degrees >= LEAST_DEGREES {
            let scale = (squares / degrees).max(1.0);
            return (scale, -0.5 * squares / scale);
        }
        let scale = self.scale().unwrap_or(1.0);
        (scale, -0.5 * (CLAIM_DEGREES + degrees) * (squares / (CLAIM_DEGREES * scale)).ln_1p())
    }

    /// The factor on the claims, where anything was seen yet.
    fn scale(&self) -> Option<f64> {
        (self.degrees > 0.0).then(|| (self.squares / self.degrees).max(1.0))
    }

    fn learn(&mut self, estimate: &crate::PoseEstimate, squares: f64, degrees: f64) {
        if estimate.left_out.is_empty() && degrees >= LEAST_DEGREES {
            self.squares = NOISE_MEMORY * self.squares + squares;
            self.degrees = NOISE_MEMORY * self.degrees + degrees;
        }
    }
}

/// The sights of one marker, as its own and as those of anything else.
#[derive(Debug, Clone, Default)]
struct Thing {
    sights: usize,
    rivals: f64,
    /// Squared whitened residuals at the pose.
    square: f64,
    /// Σ ln 2π |R|^½.
    log_spread: f64,
    /// Σ ln of rivals over the image's area.
    log_in_images: f64,
    normal: Matrix3<f64>,
    gradient: Vector3<f64>,
}

impl Thing {
    fn add(
        &mut self,
        expected: &Expected,
        candidate: &TrackedDetection,
        factor: &Cholesky<f64, Const<2>>,
        (rivals, area_px2): (f64, f64),
    ) {
        let error = candidate.pixel - expected.pixel;
        let weighted = factor.solve(&error);
        self.sights += 1;
        self.rivals = self.rivals.max(rivals);
        self.square += error.dot(&weighted);
        self.log_spread += (2.0 * PI * factor.determinant().sqrt()).ln();
        self.log_in_images += (rivals / area_px2).ln();
        self.normal += expected.by_point.transpose() * factor.solve(&expected.by_point);
        self.gradient += expected.by_point.transpose() * weighted;
    }

    /// Density of the sights at the pose but for the misfit, with their covariances scaled.
    fn log_spread(&self, scale: f64) -> f64 {
        -self.log_spread - self.sights as f64 * scale.ln()
    }

    /// Density of the sights if they are anything else's.
    fn log_chance(&self, scale: f64, volume_m3: f64) -> f64 {
        let in_space = self.normal.cholesky().filter(|_| self.sights > 1).map(|c| {
            let left = (self.square - self.gradient.dot(&c.solve(&self.gradient))).max(0.0);
            let cloud = 1.5 * (2.0 * PI * scale).ln() - 0.5 * c.determinant().ln();
            (self.rivals / volume_m3).ln() + cloud + self.log_spread(scale) - 0.5 * left / scale
        });
        in_space.map_or(self.log_in_images, |s| s.max(self.log_in_images))
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
