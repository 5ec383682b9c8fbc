//! Cameras that no longer stand as they were calibrated.

use super::associator::{Association, Associator, DECISIVE_LOG_ODDS};
use super::frame::Frame;
use super::history::{Belief, FITTING_INSTANTS, LEAST_DEGREES, MovedCamera};
use crate::TrackedDetection;
use mavsight_geometry::{Matrix2, Vector2};
use nalgebra::Matrix2x6;

/// Share of a shift within which all balls have it in common.
const COMMON: f64 = 0.25;

/// Detections of one instant that may be off while the rest is believed: two balls, one before the other.
const MOST_OFF: usize = 2;

/// Instants at which the cameras agree that make a prediction theirs: it is by two poses.
const AGREED: usize = 2;

/// By how much a camera's view of the body is off.
pub(super) struct Shift {
    pub(super) mean_px: Vector2<f64>,
    /// Inverse of its covariance, scaled by the residuals so far.
    pub(super) information: Matrix2<f64>,
    is_common: bool,
}

impl Shift {
    /// Whether it is the shift of the instant before: in the whole, or within what both leave open.
    fn is_alike(&self, before_px: Vector2<f64>) -> bool {
        let apart_px = self.mean_px - before_px;
        let square = 0.5 * apart_px.dot(&(self.information * apart_px));
        apart_px.norm() <= 2.0 * COMMON * before_px.norm() || square <= 2.0 * DECISIVE_LOG_ODDS
    }

    /// In standard deviations.
    fn square(&self) -> f64 {
        self.mean_px.dot(&(self.information * self.mean_px))
    }

    /// Logarithm of the odds that the camera stands right against its being shifted as it was once.
    fn log_odds_against(&self, shift_px: Vector2<f64>) -> f64 {
        let apart_px = self.mean_px - shift_px;
        0.5 * (apart_px.dot(&(self.information * apart_px)) - self.square())
    }
}

impl Associator {
    /// Lets a camera that was found to be moved take part again when it fits again: a clock that was set and is
    /// right again has the same effect.
    pub fn let_cameras_return(&mut self) {
        self.watch.may_return = true;
    }

    /// Leaves out a camera of which other evidence shows that it was moved; nothing changes where it is left out already.
    pub fn leave_out_moved(&mut self, camera: usize, t_ns: i64, shift_px: Vector2<f64>) {
        if !self.watch.is_moved(camera) {
            let found = MovedCamera { camera, t_ns, shift_px, still_since_ns: None, or: None };
            self.watch.leave_out(found);
        }
    }

    /// Cameras that were found to be moved; they take no part from then on, or until they fit again.
    pub fn moved_cameras(&self) -> &[MovedCamera] {
        &self.watch.moved
    }

    /// What the candidates that are wanted, by their index, say.
    pub(super) fn associated_by(
        &self,
        frame: Frame,
        predicted: Option<&Belief>,
        wanted: impl Fn(usize) -> bool,
    ) -> Association {
        let mut kept = Vec::with_capacity(frame.seen.len());
        kept.extend((0..frame.seen.len()).filter(|k| wanted(*k)));
        let seen: Vec<TrackedDetection> = kept.iter().map(|k| frame.seen[*k]).collect();
        let own = Frame { seen: &seen, ..frame };
        let mut out = predicted.map_or_else(|| self.acquire(own), |p| self.follow(own, p));
        out.pairs.iter_mut().for_each(|pair| pair.0 = kept[pair.0]);
        out
    }

    pub(super) fn is_in_use(&self, candidate: &TrackedDetection) -> bool {
        !self.watch.is_out(candidate.camera) && !self.is_stale(candidate.camera)
    }

    /// The pose without one or two detections of balls before each other, where all together make no sense.
    pub(super) fn without_detections(&self, frame: Frame, predicted: &Belief) -> Option<Association> {
        let mut out = Vec::with_capacity(MOST_OFF);
        for _ in 0..MOST_OFF {
            let is_left = |k: usize| !out.contains(&k) && self.is_in_use(&frame.seen[k]);
            let without = |k: usize| {
                let found = self.associated_by(frame, Some(predicted), |i| i != k && is_left(i));
                let estimate = found.sample.estimate.as_ref().ok()?;
                let (squares, degrees) = self.misfit(estimate, frame, &found.pairs);
                (degrees >= LEAST_DEGREES).then_some((squares / degrees, k, found))
            };
            let tried = (0..frame.seen.len()).filter(|k| is_left(*k)).filter_map(without);
            let (_, k, found) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
            if self.is_sound(&found, frame) {
                return Some(found);
            }
            out.push(k);
        }
        None
    }

    /// The pose without one camera, where all together make no sense and it is clear which one to leave out. Images that are
    /// repeated say nothing against one that is new.
    pub(super) fn without_one(&self, frame: Frame, predicted: &Belief) -> Option<Association> {
        let without = |camera: usize| {
            let is_left = |k: usize| frame.seen[k].camera != camera && self.is_in_use(&frame.seen[k]);
            let found = self.associated_by(frame, Some(predicted), is_left);
            let estimate = found.sample.estimate.as_ref().ok().filter(|_| self.is_sound(&found, frame))?;
            Some((self.log_odds(estimate, frame, &found.pairs, Some(predicted)), found))
        };
        let cameras = (0..self.cameras.len()).filter(|c| !self.watch.is_out(*c) && !self.is_stale(*c));
        let mut found: Vec<(f64, Association)> = cameras.filter_map(without).collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let next = found.get(1).map_or(f64::NEG_INFINITY, |f| f.0);
        let (odds, best) = found.into_iter().next()?;
        let is_new = best.pairs.iter().any(|pair| !self.is_repeated(frame.seen[pair.0].camera));
        (is_new && odds - next >= DECISIVE_LOG_ODDS).then_some(best)
    }

    /// Whether there is a pose whose residuals are what they have been.
    pub(super) fn is_sound(&self, found: &Association, frame: Frame) -> bool {
        let Ok(estimate) = &found.sample.estimate else { return false };
        let (squares, degrees) = self.misfit(estimate, frame, &found.pairs);
        let gate = |scale: f64| scale * crate::estimate::chi_square_quantile(degrees as usize);
        self.noise.scale().is_none_or(|scale| degrees < 1.0 || squares <= gate(scale))
    }

    /// Looks for cameras whose view of the body is shifted as a whole against the prediction and the other
    /// cameras. Such a camera is suspected and left out; twice in a row alike, it was moved. Whether anyone
    /// is newly suspected.
    pub(super) fn watch_cameras(&mut self, frame: Frame, found: &Association, predicted: &Belief) -> bool {
        let before = std::mem::take(&mut self.watch.suspects);
        for camera in 0..self.cameras.len() {
            if self.watch.is_moved(camera) {
                continue;
            }
            let Some(belief) = self.by_others(camera, frame, found, predicted) else { continue };
            let Some(shift) = self.shift(camera, frame, &belief) else { continue };
            let still_since_ns = self.watch.still_since_ns(camera, (frame.t_ns, frame.seen), shift.mean_px);
            // Balls that are seen anew in a place where they stand are no frozen image's.
            let still_since_ns = still_since_ns.filter(|_| self.is_repeated(camera));
            if !self.watch.is_beyond_usual(camera, shift.square()) || !shift.is_common {
                continue;
            }
            let (t_ns, shift_px) = (frame.t_ns, shift.mean_px);
            match before.iter().find(|s| s.camera == camera) {
                Some(s) if shift.is_alike(s.shift_px) => {
                    self.watch.leave_out(MovedCamera { still_since_ns, ..*s });
                }
                Some(_) => {}
                None => {
                    let or = self.only_other(camera, frame, found);
                    let or = or.filter(|other| !self.is_clearly_of(camera, *other, frame, predicted));
                    self.watch.suspects.push(MovedCamera { camera, t_ns, shift_px, still_since_ns, or });
                }
            }
        }
        self.weigh_suspects(frame, found);
        self.watch.suspects.iter().any(|s| s.or.is_none())
    }

    /// The camera that alone sees the body beside another one.
    fn only_other(&self, camera: usize, frame: Frame, found: &Association) -> Option<usize> {
        let mut cameras = of_others(camera, frame, found).map(|p| frame.seen[p.0].camera);
        let first = cameras.next()?;
        cameras.all(|other| other == first).then_some(first)
    }

    /// Where all cameras are shifted it is the aircraft that moved, if all together see it somewhere; of two that contradict each
    /// other one was moved.
    fn weigh_suspects(&mut self, frame: Frame, found: &Association) {
        if self.watch.suspects.len() < 2 {
            return;
        }
        let is_two = (0..self.cameras.len()).filter(|c| !self.watch.is_moved(*c)).count() == 2;
        if !is_two || self.is_sound(found, frame) {
            self.watch.suspects.clear();
        } else if self.watch.suspects.iter().any(|s| s.or.is_none()) {
            self.watch.suspects.retain(|s| s.or.is_none());
        }
    }

    /// Whether it is decided that of two cameras it is the first one's view that is shifted: where the body was to be by what
    /// both saw before, the other one sees it.
    fn is_clearly_of(&self, camera: usize, other: usize, frame: Frame, predicted: &Belief) -> bool {
        let square = |camera: usize| self.shift(camera, frame, predicted).map(|shift| shift.square());
        let apart = square(camera).zip(square(other)).map(|(own, others)| own - others);
        self.watch.agreed >= AGREED && apart.is_some_and(|apart| apart >= 2.0 * DECISIVE_LOG_ODDS)
    }

    /// Takes note of whether two cameras see the body alike.
    pub(super) fn note_agreement(&mut self, frame: Frame, found: &Association) {
        let own = |camera: usize| found.pairs.iter().filter(|p| frame.seen[p.0].camera == camera).count();
        let seen = (0..self.cameras.len()).filter(|camera| own(*camera) >= 3).count();
        let is_alike = seen >= 2 && self.is_sound(found, frame);
        self.watch.agreed = if is_alike { self.watch.agreed.saturating_add(1) } else { 0 };
    }

    /// Looks whether cameras that were found to be moved fit again.
    pub(super) fn watch_returns(&mut self, frame: Frame, found: &Association, predicted: &Belief) {
        for camera in 0..self.cameras.len() {
            let moved =
                self.watch.moved.iter().find(|m| m.camera == camera).filter(|_| self.watch.may_return);
            let Some(shift_px) = moved.map(|m| m.shift_px) else { continue };
            let belief =
                self.by_others(camera, frame, found, predicted).filter(|_| !self.is_repeated(camera));
            let shift = belief.and_then(|belief| self.shift(camera, frame, &belief));
            let fit = |shift: Shift| (shift.square(), shift.log_odds_against(shift_px));
            self.watch.fits(camera, shift.map(fit));
        }
    }

    /// Looks whether two cameras that contradicted each other, neither of which was believed, see the body alike again.
    pub(super) fn watch_reconciliation(&mut self, frame: Frame) {
        if !self.watch.may_return || self.watch.moved.iter().all(|m| m.or.is_none()) {
            return;
        }
        let together = self.associated_by(frame, None, |_| true);
        self.note_agreement(frame, &together);
        if self.watch.agreed >= FITTING_INSTANTS as usize {
            self.watch.moved.retain(|m| m.or.is_none());
        }
    }

    /// Where the other cameras see the body, where they see three balls or more of it.
    fn by_others(
        &self,
        camera: usize,
        frame: Frame,
        found: &Association,
        predicted: &Belief,
    ) -> Option<Belief> {
        if of_others(camera, frame, found).count() < 3 {
            return None;
        }
        let mut belief = *predicted;
        of_others(camera, frame, found)
            .for_each(|(index, marker)| self.narrow(&mut belief, &frame.seen[*index], *marker));
        Some(belief)
    }

    /// The shift of three balls or more of a camera against a belief.
    pub(super) fn shift(&self, camera: usize, frame: Frame, belief: &Belief) -> Option<Shift> {
        let mut errors: Vec<Vector2<f64>> = Vec::new();
        let (mut jacobian, mut noise) = (Matrix2x6::zeros(), Matrix2::zeros());
        for (marker, color) in self.colors.iter().enumerate() {
            let Some(expected) = self.expected(&belief.pose, camera, marker) else { continue };
            let error = |c: &TrackedDetection| c.pixel - expected.pixel;
            let own = frame.seen.iter().filter(|c| c.camera == camera && c.color == *color);
            let nearest = own.min_by(|a, b| error(a).norm().total_cmp(&error(b).norm()));
            let Some(nearest) = nearest else { continue };
            errors.push(error(nearest));
            jacobian += expected.jacobian;
            noise += self.detection_covariance(&expected, nearest);
        }
        let n = errors.len() as f64;
        if n < 3.0 {
            return None;
        }
        let mean_px = errors.iter().sum::<Vector2<f64>>() / n;
        let about_px = (errors.iter().map(|e| (e - mean_px).norm_squared()).sum::<f64>() / n).sqrt();
        let spread = (jacobian * belief.covariance * jacobian.transpose() + noise) / (n * n);
        let scale = self.noise.scale().unwrap_or(1.0);
        let information = spread.cholesky()?.inverse() / scale;
        Some(Shift { mean_px, information, is_common: about_px < COMMON * mean_px.norm() })
    }
}

/// What the other cameras see of the body, of the markers that were used.
fn of_others<'a>(
    camera: usize,
    frame: Frame<'a>,
    found: &'a Association,
) -> impl Iterator<Item = &'a (usize, usize)> {
    let is_used = |marker| found.sample.estimate.as_ref().map_or(true, |e| e.markers_used.contains(marker));
    found.pairs.iter().filter(move |p| frame.seen[p.0].camera != camera && is_used(p.1))
}
