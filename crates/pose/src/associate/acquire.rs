//! The body among balls that nothing predicts.

use super::NORMAL_GATE;
use super::associator::{Association, Associator, DECISIVE_LOG_ODDS, refused};
use super::frame::{Frame, Pairs};
use super::history::Belief;
use crate::{PoseError, PoseEstimate, PoseSample, TrackedDetection};
use mavsight_geometry::{ImagePoint, Isometry3, Matrix2, Matrix6, Triangulation, rigid_fit, triangulate};

/// Bounds of the work of an instant: balls in space, assignments tried, choices in one camera.
const MOST_SPOTS: usize = 96;
const MOST_TRIED: usize = 200;
const MOST_CHOICES: usize = 16;
/// Two poses whose markers are nearer than this share of the body's size are one.
const SAME_POSE: f64 = 0.1;

/// A ball that two cameras see.
struct Spot {
    color: usize,
    pair: [usize; 2],
    is_static: bool,
    met: Triangulation,
}

struct Trial {
    log_odds: f64,
    estimate: PoseEstimate,
    pairs: Pairs,
}

/// Assignments that gave a pose, and how many were tried.
#[derive(Default)]
struct Trials {
    found: Vec<Trial>,
    tried: usize,
}

impl Associator {
    /// The pose that the candidates support by themselves.
    pub(super) fn acquire(&self, frame: Frame) -> Association {
        let mut trials = Trials::default();
        if let Some(pairs) = self.only_choice(frame) {
            trials.tried += 1;
            trials.found.extend(self.weighed(frame, pairs));
        }
        let is_clear = |t: &Trial| t.estimate.left_out.is_empty() && t.log_odds > DECISIVE_LOG_ODDS;
        if !trials.found.iter().any(is_clear) {
            let spots = self.spots(frame);
            let in_space = |color: &&usize| spots.iter().any(|s| s.color == **color);
            if self.colors.iter().filter(in_space).count() > 2 {
                self.try_triangles(frame, &spots, &mut trials);
            } else {
                self.try_one_view(frame, &mut trials);
            }
        }
        match self.decided(frame, trials) {
            Ok(Trial { estimate, pairs, .. }) => {
                Association { sample: PoseSample { t_ns: frame.t_ns, estimate: Ok(estimate) }, pairs }
            }
            Err(reason) => refused(frame.t_ns, reason),
        }
    }

    /// The best trial, if it is beyond chance and distinguished from other poses.
    fn decided(&self, frame: Frame, Trials { mut found, tried }: Trials) -> Result<Trial, PoseError> {
        let balls = frame.seen.len();
        found.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
        let needed = DECISIVE_LOG_ODDS + (tried.max(1) as f64).ln();
        let Some(best) = found.first() else {
            let seen =
                self.colors.iter().filter(|color| frame.seen.iter().any(|c| c.color == **color)).count();
            return Err(PoseError::TooFewMarkers { seen, markers: self.colors.len(), observations: balls });
        };
        if best.log_odds < needed {
            return Err(PoseError::UnconvincingPose { balls, log_odds: best.log_odds, needed });
        }
        let markers = (0..self.colors.len()).collect();
        let is_other = |t: &&Trial| {
            let (a, b) = (&t.estimate.world_from_body, &best.estimate.world_from_body);
            self.estimator.apart_m(markers, a, b) > SAME_POSE * self.size_m
        };
        let lead = found.iter().find(is_other).map_or(f64::INFINITY, |next| best.log_odds - next.log_odds);
        if lead < DECISIVE_LOG_ODDS {
            return Err(PoseError::AmbiguousIdentity { balls, lead });
        }
        Ok(found.swap_remove(0))
    }

    /// The assignment, where every colour is one marker's and no camera sees two balls of it.
    fn only_choice(&self, frame: Frame) -> Option<Pairs> {
        let mut pairs = Pairs::with_capacity(frame.seen.len());
        for (index, candidate) in frame.seen.iter().enumerate() {
            let rival = |c: &TrackedDetection| c.camera == candidate.camera && c.color == candidate.color;
            let mut owners = (0..self.colors.len()).filter(|m| self.colors[*m] == candidate.color);
            let marker = owners.next()?;
            if owners.next().is_some() || frame.seen[..index].iter().any(rival) {
                return None;
            }
            pairs.push((index, marker));
        }
        frame.sort(&mut pairs);
        Some(pairs)
    }

    fn weighed(&self, frame: Frame, pairs: Pairs) -> Option<Trial> {
        let estimate = self.estimator.estimate(frame.t_ns, &frame.observations(&pairs), None).ok()?;
        let log_odds = self.log_odds(&estimate, frame, &pairs, None);
        Some(Trial { log_odds, estimate, pairs })
    }

    /// Every triangle of balls in space that is one of the body's.
    fn try_triangles(&self, frame: Frame, spots: &[Spot], trials: &mut Trials) {
        for three in self.triangles(spots) {
            let is_given = |t: &Trial, (m, s): &(usize, usize)| {
                spots[*s].pair.iter().all(|index| t.pairs.contains(&(*index, *m)))
            };
            if trials.found.iter().any(|t| three.iter().all(|label| is_given(t, label))) {
                continue;
            }
            if trials.tried >= MOST_TRIED {
                return;
            }
            trials.tried += 1;
            trials.found.extend(self.completed(frame, spots, three));
        }
    }

    /// Three balls each, with their markers, whose distances are the body's.
    fn triangles(&self, spots: &[Spot]) -> Vec<[(usize, usize); 3]> {
        let labels: Vec<(usize, usize)> = (0..self.colors.len())
            .flat_map(|m| (0..spots.len()).map(move |s| (m, s)))
            .filter(|(m, s)| self.colors[*m] == spots[*s].color)
            .collect();
        let is_side = |a: (usize, usize), b: (usize, usize)| a.0 != b.0 && self.is_length(spots, a, b);
        let mut out = Vec::new();
        for (k, first) in labels.iter().enumerate() {
            let near: Vec<_> = labels[k + 1..].iter().filter(|l| is_side(*first, **l)).collect();
            for (j, second) in near.iter().enumerate() {
                let closing = near[j + 1..].iter().filter(|l| is_side(**second, ***l));
                out.extend(closing.map(|third| [*first, **second, **third]));
            }
        }
        out
    }

    /// Whether two balls are as far apart as two markers.
    fn is_length(&self, spots: &[Spot], (first, a): (usize, usize), (second, b): (usize, usize)) -> bool {
        if spots[a].pair.iter().any(|index| spots[b].pair.contains(index)) {
            return false;
        }
        let markers = self.estimator.markers();
        let wanted_m = (markers[first].marker_in_body_m - markers[second].marker_in_body_m).norm();
        let way = spots[a].met.point_in_world_m - spots[b].met.point_in_world_m;
        let length_m = way.norm();
        let along = way / length_m.max(1e-9);
        let spread = spots[a].met.covariance_m2 + spots[b].met.covariance_m2;
        let variance = along.dot(&(spread * along)) + 2.0 * self.markers_std_m.powi(2);
        // The centre of a ball in part hidden is off by a share of its radius.
        let hidden_m = 0.5 * markers[first].radius_m.max(markers[second].radius_m);
        (length_m - wanted_m).abs() <= NORMAL_GATE * variance.sqrt() + hidden_m
    }

    fn spots(&self, frame: Frame) -> Vec<Spot> {
        let mut spots = Vec::new();
        for (i, a) in frame.seen.iter().enumerate() {
            for (j, b) in frame.seen.iter().enumerate().skip(i + 1) {
                if a.camera != b.camera && a.color == b.color {
                    spots.extend(self.spot([a, b], [i, j]));
                }
            }
        }
        spots.sort_by_key(|s| s.is_static);
        spots.truncate(MOST_SPOTS);
        spots
    }

    /// The ball, where the rays meet and both images are of its size.
    fn spot(&self, seen: [&TrackedDetection; 2], pair: [usize; 2]) -> Option<Spot> {
        let [a, b] = seen.map(|c| self.cameras.get(c.camera));
        let cameras = [a?, b?];
        // A triangulated ball stands where its centre does but for a thousandth of its radius.
        let image = |k: usize| {
            let TrackedDetection { pixel, covariance_px2, .. } = *seen[k];
            ImagePoint { camera: cameras[k], pixel, covariance_px2 }
        };
        let met = triangulate(&[image(0), image(1)]).ok()?;
        let own = self.estimator.markers().iter().zip(&self.colors).filter(|(_, c)| **c == seen[0].color);
        let radius_m = own.map(|(m, _)| m.radius_m).fold(0.0, f64::max);
        let mut reach_px = 0.0_f64;
        for (view, candidate) in cameras.into_iter().zip(seen) {
            let range_m = (met.point_in_world_m - view.centre_in_world()).norm();
            let radius_px = view.intrinsics.fx_px.abs() * radius_m / range_m;
            if !candidate.may_have_diameter(2.0 * radius_px) {
                return None;
            }
            reach_px = reach_px.max(0.5 * radius_px);
        }
        let claim_px = |c: &TrackedDetection| c.covariance_px2.trace().sqrt();
        (met.residual_px <= NORMAL_GATE * claim_px(seen[0]).hypot(claim_px(seen[1])) + reach_px)
            .then(|| Spot { color: seen[0].color, pair, is_static: seen.iter().any(|c| c.is_static), met })
    }

    /// The pose of a triangle, with all else that it finds in its place.
    fn completed(&self, frame: Frame, spots: &[Spot], three: [(usize, usize); 3]) -> Option<Trial> {
        let markers = self.estimator.markers();
        let pose =
            rigid_fit(three.map(|(m, s)| (markers[m].marker_in_body_m, spots[s].met.point_in_world_m)))
                .ok()?;
        let mut pairs: Pairs =
            three.iter().flat_map(|(m, s)| spots[*s].pair.map(|index| (index, *m))).collect();
        let covariance = self.covariance_of(&pose, frame, &pairs)?;
        self.assign(frame, Belief { pose, covariance, shift_m: 0.0 }, &mut pairs);
        self.weighed(frame, pairs)
    }

    /// Covariance of a pose by its detections, each as uncertain as a ball in part hidden.
    fn covariance_of(&self, pose: &Isometry3<f64>, frame: Frame, pairs: &Pairs) -> Option<Matrix6<f64>> {
        let mut normal = Matrix6::zeros();
        for (index, marker) in pairs {
            let candidate = &frame.seen[*index];
            let expected = self.expected(pose, candidate.camera, *marker)?;
            let hidden_px = 0.1 * candidate.diameter_px;
            let spread =
                self.detection_covariance(&expected, candidate) + Matrix2::identity() * hidden_px * hidden_px;
            normal += expected.jacobian.transpose() * spread.cholesky()?.solve(&expected.jacobian);
        }
        normal.cholesky().map(|c| c.inverse())
    }

    /// Poses of one camera's view of four markers or more, where each colour is one marker's.
    fn try_one_view(&self, frame: Frame, trials: &mut Trials) {
        for camera in 0..self.cameras.len() {
            let mut choices: Vec<Pairs> = vec![Pairs::new()];
            for (marker, color) in self.colors.iter().enumerate() {
                let is_own = |k: &usize| frame.seen[*k].camera == camera && frame.seen[*k].color == *color;
                let own: Vec<usize> = (0..frame.seen.len()).filter(is_own).collect();
                let is_shared = self.colors.iter().filter(|c| *c == color).count() > 1;
                if own.is_empty() || is_shared {
                    continue;
                }
                let longer = choices
                    .iter()
                    .flat_map(|start| own.iter().map(|k| [start.as_slice(), &[(*k, marker)]].concat()));
                choices = longer.take(MOST_CHOICES).collect();
            }
            for start in choices.into_iter().filter(|c| c.len() > 3) {
                trials.tried += 1;
                let Some(alone) = self.weighed(frame, start) else { continue };
                let mut pairs = alone.pairs.clone();
                self.assign(frame, Belief::of(&alone.estimate), &mut pairs);
                let all = self.weighed(frame, pairs);
                trials.found.push(all.filter(|a| a.log_odds > alone.log_odds).unwrap_or(alone));
            }
        }
    }
}
