//! The body among balls that nothing predicts.

use super::associator::{Association, Associator, DECISIVE_LOG_ODDS, MOST_SIZE_RATIO, observations, refused};
use super::belief::Belief;
use crate::{PoseError, PoseEstimate, PoseSample, TrackedDetection};
use mavsight_geometry::{ImagePoint, Isometry3, Matrix2, Matrix3, Matrix6, Vector3, rigid_fit, triangulate};

/// Bounds of the work of an instant: balls in space, assignments tried, choices in one camera.
const MOST_SPOTS: usize = 96;
const MOST_TRIED: usize = 200;
const MOST_CHOICES: usize = 16;
/// Normal quantile of the gates on lengths, 99.9 % on both sides.
const GATE: f64 = 3.29;
/// Two poses whose markers are nearer than this share of the body's size are one.
const SAME_POSE: f64 = 0.1;

/// A ball that two cameras see.
struct Spot {
    color: usize,
    pair: [usize; 2],
    is_static: bool,
    at_m: Vector3<f64>,
    covariance_m2: Matrix3<f64>,
}

struct Trial {
    log_odds: f64,
    estimate: PoseEstimate,
    pairs: Vec<(usize, usize)>,
}

impl Associator {
    /// The pose that the candidates support by themselves.
    pub(super) fn acquire(&self, t_ns: i64, candidates: &[TrackedDetection]) -> Association {
        let mut trials: Vec<Trial> = Vec::new();
        let mut tried = 0;
        if let Some(pairs) = self.only_choice(candidates) {
            tried += 1;
            trials.extend(self.weighed(t_ns, candidates, pairs));
        }
        if !trials.iter().any(|t| t.estimate.left_out.is_empty() && t.log_odds > DECISIVE_LOG_ODDS) {
            let spots = self.spots(candidates);
            let in_space = |m: &usize| spots.iter().any(|s| s.color == self.colors[*m]);
            if (0..self.colors.len()).filter(in_space).count() > 2 {
                self.try_triangles(t_ns, candidates, &spots, (&mut trials, &mut tried));
            } else {
                self.try_one_view(t_ns, candidates, (&mut trials, &mut tried));
            }
        }
        trials.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
        let needed = DECISIVE_LOG_ODDS + f64::from(tried.max(1)).ln();
        let few = || {
            let markers = self.colors.len();
            let seen = (0..markers).filter(|m| candidates.iter().any(|c| c.color == self.colors[*m])).count();
            PoseError::TooFewMarkers { seen, markers, observations: candidates.len() }
        };
        let Some(best) = trials.first() else { return refused(t_ns, few()) };
        if best.log_odds < needed {
            let (balls, log_odds) = (candidates.len(), best.log_odds);
            return refused(t_ns, PoseError::UnconvincingPose { balls, log_odds, needed });
        }
        let markers = (0..self.colors.len()).collect();
        let apart = |t: &&Trial| {
            let (a, b) = (&t.estimate.world_from_body, &best.estimate.world_from_body);
            self.estimator.apart_m(markers, a, b) > SAME_POSE * self.size_m
        };
        if let Some(next) = trials.iter().find(apart)
            && best.log_odds - next.log_odds < DECISIVE_LOG_ODDS
        {
            let lead = best.log_odds - next.log_odds;
            return refused(t_ns, PoseError::AmbiguousIdentity { balls: candidates.len(), lead });
        }
        let best = trials.swap_remove(0);
        Association { sample: PoseSample { t_ns, estimate: Ok(best.estimate) }, pairs: best.pairs }
    }

    /// The assignment, where every colour is one marker's and no camera sees two balls of it.
    fn only_choice(&self, candidates: &[TrackedDetection]) -> Option<Vec<(usize, usize)>> {
        let mut pairs = Vec::with_capacity(candidates.len());
        for (index, candidate) in candidates.iter().enumerate() {
            let rival = |c: &TrackedDetection| c.camera == candidate.camera && c.color == candidate.color;
            let mut owners = (0..self.colors.len()).filter(|m| self.colors[*m] == candidate.color);
            let marker = owners.next()?;
            if owners.next().is_some() || candidates[..index].iter().any(rival) {
                return None;
            }
            pairs.push((index, marker));
        }
        pairs.sort_unstable_by_key(|(c, m)| (candidates[*c].camera, *m));
        Some(pairs)
    }

    fn weighed(
        &self,
        t_ns: i64,
        candidates: &[TrackedDetection],
        pairs: Vec<(usize, usize)>,
    ) -> Option<Trial> {
        let seen = observations(t_ns, candidates, &pairs);
        let estimate = self.estimator.estimate(t_ns, &seen, None).ok()?;
        let log_odds = self.log_odds(&estimate, candidates, &pairs, None);
        Some(Trial { log_odds, estimate, pairs })
    }

    /// Every triangle of balls in space that is one of the body's.
    fn try_triangles(
        &self,
        t_ns: i64,
        candidates: &[TrackedDetection],
        spots: &[Spot],
        (trials, tried): (&mut Vec<Trial>, &mut u32),
    ) {
        for three in self.triangles(spots) {
            if self.is_tried(spots, &three, trials) {
                continue;
            }
            if *tried as usize >= MOST_TRIED {
                return;
            }
            *tried += 1;
            trials.extend(self.completed(t_ns, candidates, spots, three));
        }
    }

    /// Three balls each, with their markers, whose distances are the body's.
    fn triangles(&self, spots: &[Spot]) -> Vec<[(usize, usize); 3]> {
        let labels: Vec<(usize, usize)> = (0..self.colors.len())
            .flat_map(|m| (0..spots.len()).map(move |s| (m, s)))
            .filter(|(m, s)| self.colors[*m] == spots[*s].color)
            .collect();
        let mut out = Vec::new();
        let mut near: Vec<(usize, usize)> = Vec::new();
        for (k, first) in labels.iter().enumerate() {
            near.clear();
            near.extend(
                labels[k + 1..].iter().filter(|l| l.0 != first.0 && self.is_length(spots, *first, **l)),
            );
            for (j, second) in near.iter().enumerate() {
                let closes = |l: &&(usize, usize)| l.0 != second.0 && self.is_length(spots, *second, **l);
                out.extend(near[j + 1..].iter().filter(closes).map(|third| [*first, *second, *third]));
            }
        }
        out
    }

    fn is_tried(&self, spots: &[Spot], three: &[(usize, usize); 3], trials: &[Trial]) -> bool {
        let holds = |t: &Trial| {
            three.iter().all(|(m, s)| spots[*s].pair.iter().all(|index| t.pairs.contains(&(*index, *m))))
        };
        trials.iter().any(holds)
    }

    /// Whether two balls are as far apart as two markers.
    fn is_length(&self, spots: &[Spot], (first, a): (usize, usize), (second, b): (usize, usize)) -> bool {
        if spots[a].pair.iter().any(|index| spots[b].pair.contains(index)) {
            return false;
        }
        let markers = self.estimator.markers();
        let wanted_m = (markers[first].marker_in_body_m - markers[second].marker_in_body_m).norm();
        let way = spots[a].at_m - spots[b].at_m;
        let length_m = way.norm();
        let along = way / length_m.max(1e-9);
        let spread = spots[a].covariance_m2 + spots[b].covariance_m2;
        let variance = along.dot(&(spread * along)) + 2.0 * self.markers_std_m.powi(2);
        // The centre of a ball in part hidden is off by a share of its radius.
        let hidden_m = 0.5 * markers[first].radius_m.max(markers[second].radius_m);
        (length_m - wanted_m).abs() <= GATE * variance.sqrt() + hidden_m
    }

    fn spots(&self, candidates: &[TrackedDetection]) -> Vec<Spot> {
        let mut spots = Vec::new();
        for (i, a) in candidates.iter().enumerate() {
            for (j, b) in candidates.iter().enumerate().skip(i + 1) {
                if a.camera != b.camera && a.color == b.color {
                    spots.extend(self.spot([a, b], [i, j]));
                }
            }
        }
        spots.sort_by_key(|s| s.is_static);
        spots.truncate(MOST_SPOTS);
        spots
    }

    fn spot(&self, seen: [&TrackedDetection; 2], pair: [usize; 2]) -> Option<Spot> {
        let [a, b] = seen.map(|c| self.cameras.get(c.camera));
        let (a, b) = (a?, b?);
        // A triangulated ball stands where its centre does but for a thousandth of its radius.
        let image = |camera, c: &TrackedDetection| ImagePoint {
            camera,
            pixel: c.pixel,
            covariance_px2: c.covariance_px2,
        };
        let met = triangulate(&[image(a, seen[0]), image(b, seen[1])]).ok()?;
        let radius_m = (0..self.colors.len())
            .filter(|m| self.colors[*m] == seen[0].color)
            .map(|m| self.estimator.markers()[m].radius_m)
            .fold(0.0, f64::max);
        let mut reach_px = 0.0_f64;
        for (view, candidate) in [a, b].into_iter().zip(seen) {
            let range_m = (met.point_in_world_m - view.centre_in_world()).norm();
            let radius_px = view.intrinsics.fx_px.abs() * radius_m / range_m;
            let ratio = 0.5 * candidate.diameter_px / radius_px;
            let sized = candidate.diameter_px > 0.0 && radius_px > 0.0;
            if sized && !(1.0 / MOST_SIZE_RATIO..=MOST_SIZE_RATIO).contains(&ratio) {
                return None;
            }
            reach_px = reach_px.max(0.5 * radius_px);
        }
        let claim_px = |c: &TrackedDetection| c.covariance_px2.trace().sqrt();
        (met.residual_px <= GATE * claim_px(seen[0]).hypot(claim_px(seen[1])) + reach_px).then(|| Spot {
            color: seen[0].color,
            pair,
            is_static: seen.iter().any(|c| c.is_static),
            at_m: met.point_in_world_m,
            covariance_m2: met.covariance_m2,
        })
    }

    /// The pose of a triangle, with all else that it finds in its place.
    fn completed(
        &self,
        t_ns: i64,
        candidates: &[TrackedDetection],
        spots: &[Spot],
        three: [(usize, usize); 3],
    ) -> Option<Trial> {
        let markers = self.estimator.markers();
        let pose = rigid_fit(three.map(|(m, s)| (markers[m].marker_in_body_m, spots[s].at_m))).ok()?;
        let mut pairs: Vec<(usize, usize)> =
            three.iter().flat_map(|(m, s)| spots[*s].pair.map(|index| (index, *m))).collect();
        let covariance = self.covariance_of(&pose, candidates, &pairs)?;
        self.assign(candidates, Belief { pose, covariance, shift_m: 0.0 }, &mut pairs);
        self.weighed(t_ns, candidates, pairs)
    }

    /// Covariance of a pose by its detections, each as uncertain as a ball in part hidden.
    fn covariance_of(
        &self,
        pose: &Isometry3<f64>,
        candidates: &[TrackedDetection],
        pairs: &[(usize, usize)],
    ) -> Option<Matrix6<f64>> {
        let mut normal = Matrix6::zeros();
        for (index, marker) in pairs {
            let candidate = &candidates[*index];
            let expected = self.expected(pose, candidate.camera, *marker)?;
            let hidden_px = 0.1 * candidate.diameter_px;
            let spread =
                self.detection_covariance(&expected, candidate) + Matrix2::identity() * hidden_px * hidden_px;
            normal += expected.jacobian.transpose() * spread.cholesky()?.solve(&expected.jacobian);
        }
        normal.cholesky().map(|c| c.inverse())
    }

    /// Poses of one camera's view of four markers or more, where each colour is one marker's.
    fn try_one_view(
        &self,
        t_ns: i64,
        candidates: &[TrackedDetection],
        (trials, tried): (&mut Vec<Trial>, &mut u32),
    ) {
        for camera in 0..self.cameras.len() {
            let mut choices: Vec<Vec<(usize, usize)>> = vec![Vec::new()];
            for (marker, color) in self.colors.iter().enumerate() {
                let own: Vec<usize> = (0..candidates.len())
                    .filter(|c| candidates[*c].camera == camera && candidates[*c].color == *color)
                    .collect();
                let shared = self.colors.iter().filter(|c| *c == color).count() > 1;
                if own.is_empty() || shared {
                    continue;
                }
                choices = choices
                    .iter()
                    .flat_map(|start| own.iter().map(|c| [start.as_slice(), &[(*c, marker)]].concat()))
                    .take(MOST_CHOICES)
                    .collect();
            }
            for start in choices.into_iter().filter(|c| c.len() > 3) {
                *tried += 1;
                let Some(alone) = self.weighed(t_ns, candidates, start) else { continue };
                let mut pairs = alone.pairs.clone();
                self.assign(candidates, Belief::of(&alone.estimate), &mut pairs);
                let all = self.weighed(t_ns, candidates, pairs);
                trials.push(all.filter(|a| a.log_odds > alone.log_odds).unwrap_or(alone));
            }
        }
    }
}
