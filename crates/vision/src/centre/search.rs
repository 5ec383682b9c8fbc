//! A fit from its first guess to its end: steps of Gauss-Newton, and a look at what is behind the ball wherever that has moved.

use super::equations::Covariance;
use super::model::{BALL, COUNT, EDGE, Model, Parameters, RADIUS};
use super::settle::End;
use super::surroundings::Clutter;
use super::vectorized::{Begin, Form, LookAround, Solve};
use super::{
    Fit, Fitter, LEAST_CONTRAST, LEAST_TRUSTED, MOST_WEIGHED, SAME_PLACE_PX, SMALL_STEP, Start, distance_px,
    first_guess, longest, prior, with_margin, within,
};
use crate::Vector2;
use crate::optics::Known;
use crate::patch::Patch;
use std::ops::ControlFlow;

/// Steps after which a fit is given up, and in a still.
const MOST_STEPS: usize = 16;
const MOST_STEPS_IN_STILL: usize = 24;
/// Times that trust and noise are set at least: first the trust, then the noise too. A ball that is followed brings its noise along.
const LEAST_WEIGHED: usize = 2;
const LEAST_WEIGHED_FOLLOWED: usize = 1;
/// Squared length, in standard deviations over all parameters, of a step whose outcome may be foreseen from the equations'
/// linear form: as long as that by which two frames' noise sets their parameters apart (2 a parameter; three quarters of all
/// frames).
const NEAR: f64 = 3.0 * COUNT as f64;
/// Change of the noise, as a part of it, at which the claims stand: a twentieth of a standard deviation.
const NOISE_CHANGES: f64 = 0.1;
/// Longest step of a length in pixels, in edge widths w: far from an edge of Gaussian slope, Gauss-Newton goes no further than w √π
/// (the integral of the slope over that of its square). The background is not estimated again before, either, as long as the fit has
/// not come near.
const LONGEST_STEP_EDGES: f64 = 1.772_454;
/// Standard deviations that a ball differs from its background, below which a first look at a region ends: its colour is one pixel's and the noise not yet the film's own.
const FAINT: f64 = 0.5 * LEAST_CONTRAST;

/// A step of Gauss-Newton: the change, its squared length in standard deviations, whether all of it could be taken, and whether its
/// outcome may be foreseen.
struct Step {
    change: Parameters,
    length: f64,
    is_whole: bool,
    is_near: bool,
}

/// A fit on its way.
struct Search {
    model: Model,
    prior: [Known; COUNT],
    range_px: (f64, f64),
    /// Where it began, and how far from there it may go.
    start_px: Vector2<f64>,
    reach_px: f64,
    /// Where the background was looked at last, how it was treated, and the movement after which it is looked at again.
    seen_from: Option<Parameters>,
    clutter: Clutter,
    same_place_px: f64,
    /// Whether the samples' covariance is to be set anew.
    covariance: Covariance,
    /// Times that trust and noise have been set, and that they are set at least.
    weighed: usize,
    least_weighed: usize,
    was_too_large: bool,
}

impl Search {
    fn new(start: &Start, range_px: (f64, f64), in_still: bool) -> Self {
        let model = first_guess(start, range_px);
        Self {
            prior: prior(start, &model),
            range_px,
            start_px: start.pixel,
            reach_px: 1.0 + model.unit_px,
            seen_from: None,
            // Lines are followed for three times the work, and only once it is clear where the ball is. The rest is predicted at
            // once: a fit that takes a dark hull behind half of the ball for noise may draw the hull into the ball.
            clutter: if in_still { Clutter::AsNoise } else { Clutter::Predicted },
            same_place_px: SAME_PLACE_PX,
            covariance: Covariance::Anew,
            weighed: 0,
            least_weighed: if start.followed.is_some() { LEAST_WEIGHED_FOLLOWED } else { LEAST_WEIGHED },
            was_too_large: false,
            model,
        }
    }

    /// Takes a step; None where it leads too far away, or the ball is too large and still grows.
    fn take(&mut self, step: &Step) -> Option<()> {
        self.covariance = Covariance::Kept;
        let far_px = LONGEST_STEP_EDGES * self.model.p[EDGE];
        self.same_place_px = if step.is_near { SAME_PLACE_PX } else { far_px };
        self.model.p = within(self.model.p + step.change, self.range_px);
        let is_too_large = self.model.p[RADIUS] >= self.range_px.1;
        let stays_too_large = is_too_large && (self.was_too_large || step.is_near);
        self.was_too_large = is_too_large;
        let is_within = (self.model.p.xy() - self.start_px).norm() <= self.reach_px;
        (is_within && !stays_too_large).then_some(())
    }

    /// Whether the fit has come near enough for samples to be weighed. Once it has with clutter taken as noise, that is predicted.
    fn has_come_near(&mut self, step: &Step) -> bool {
        if self.clutter == Clutter::Predicted {
            return step.is_near;
        }
        if step.is_near && step.is_whole {
            (self.clutter, self.seen_from) = (Clutter::Predicted, None);
        }
        false
    }
}

impl Fitter {
    /// Fits the ball in the patch.
    ///
    /// None if it does not converge to a disc with a radius in `radius_px` that stands out and is mostly visible, or is too large
    /// and still grows.
    pub(crate) fn fit(&mut self, patch: &Patch, radius_px: (f64, f64), start: &Start) -> Option<Fit> {
        if !patch.is_whole() {
            return None;
        }
        let start = &Start { pixel: start.pixel - patch.corner(), ..*start };
        let noise_variance = start.followed.map(|f| f.noise_variance);
        pulp::Arch::new().dispatch(Begin { equations: &mut self.equations, patch, noise_variance });
        let in_still = self.equations.in_still();
        let mut search = Search::new(start, with_margin(radius_px), in_still);
        for _ in 0..if in_still { MOST_STEPS_IN_STILL } else { MOST_STEPS } {
            self.look_around(patch, &mut search)?;
            let step = self.step(patch, &search.model, &search.prior, search.covariance)?;
            let formed = search.model;
            let linear = [0, 1, 2].map(|c| formed.p[BALL + c]);
            if search.weighed == 0 && self.equations.contrast(patch, &linear) < FAINT {
                return None;
            }
            search.take(&step)?;
            if !search.has_come_near(&step) {
                continue;
            }
            let mut has_settled = search.weighed >= search.least_weighed;
            if search.weighed < MOST_WEIGHED {
                match self.weigh_anew(patch, &mut search, (&formed, &step))? {
                    ControlFlow::Break(end) => {
                        return self.summarize(patch, &search.prior, search.range_px, &end);
                    }
                    ControlFlow::Continue(is_noise_kept) => has_settled &= is_noise_kept,
                }
            }
            if step.length < SMALL_STEP && has_settled {
                let (p, unweighed) = (search.model.p, Some(step.change));
                let end = End { p, unweighed, gain: 1.0, is_near: true };
                return self.summarize(patch, &search.prior, search.range_px, &end);
            }
        }
        None
    }

    /// Looks at what is behind the ball, where it has moved.
    fn look_around(&mut self, patch: &Patch, search: &mut Search) -> Option<()> {
        let has_moved = |from: Parameters| distance_px(&from, &search.model.p) > search.same_place_px;
        if search.seen_from.is_none_or(has_moved) {
            search.model.shade_here();
            let (equations, model, clutter) = (&mut self.equations, &search.model, search.clutter);
            pulp::Arch::new().dispatch(LookAround { equations, patch, model, clutter })?;
            (search.seen_from, search.covariance) = (Some(search.model.p), Covariance::Anew);
        }
        Some(())
    }

    /// Sets trust and noise behind a step from where the equations were formed, in films as often as it takes: the end, or whether the
    /// noise is about what it was. None where too little is believed.
    fn weigh_anew(
        &mut self,
        patch: &Patch,
        search: &mut Search,
        (formed, step): (&Model, &Step),
    ) -> Option<ControlFlow<End, bool>> {
        search.weighed += 1;
        search.covariance = Covariance::Anew;
        let (with_noise, mut is_noise_kept) = (search.weighed >= search.least_weighed, true);
        if with_noise && !self.equations.in_still() && step.is_whole {
            let taken = (search.model.p - formed.p, true, SAME_PLACE_PX);
            if let Some(end) = self.settle(patch, (formed, &search.prior), taken) {
                if end.is_near {
                    return Some(ControlFlow::Break(end));
                }
                search.model.p = end.p;
            }
        } else {
            let noise_before = self.equations.noise_variance();
            self.weigh(patch, &step.change, with_noise);
            is_noise_kept = (self.equations.noise_variance() / noise_before).ln().abs() < NOISE_CHANGES;
        }
        let is_lost = with_noise && self.equations.trusted() < LEAST_TRUSTED;
        (!is_lost).then_some(ControlFlow::Continue(is_noise_kept))
    }

    /// One step of Gauss-Newton.
    fn step(
        &mut self,
        patch: &Patch,
        model: &Model,
        prior: &[Known; COUNT],
        covariance: Covariance,
    ) -> Option<Step> {
        let equations = (&mut self.equations, &mut self.normal);
        let (mut change, length) = pulp::Arch::new().dispatch(Solve {
            equations,
            patch,
            model,
            prior,
            form: Form::Anew(covariance),
        })?;
        let longest = longest(&change);
        if !longest.is_finite() {
            return None;
        }
        let longest_step_px = LONGEST_STEP_EDGES * model.p[EDGE];
        let is_whole = longest <= longest_step_px;
        if !is_whole {
            change *= longest_step_px / longest;
        }
        Some(Step { change, length, is_whole, is_near: length < NEAR || longest <= SAME_PLACE_PX })
    }
}
