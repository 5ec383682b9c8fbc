//! A ball whose fit is made ready before its frame is there.
//!
//! Which samples the ball touches where it is expected, their derivatives, covariance and sums, and with what weights what is behind
//! it follows from what is beside it: none of that depends on the frame but by what it shows there that the frame before did not.
//! Whoever waits for the centre waits for the samples' residuals and what these ask for. Forming what a template needs before the image
//! comes is inverse compositional alignment (Baker & Matthews 2004).

use super::equations::Seen;
use super::model::{COUNT, EDGE, Model, Parameters};
use super::settle::End;
use super::vectorized::{Foresee, Form, Look, Solve};
use super::{Fit, Fitter, SAME_PLACE_PX, Start, first_guess, longest, prior, with_margin, within};
use crate::optics::Known;
use crate::patch::Patch;
use crate::{Frame, Vector2};

/// How far from where it was expected a ball is fitted with what was made ready for, at most: an acceleration of 1 m/s² moves it so far
/// from where its velocity would have it a thirtieth of a second later (1.1 mm), 2 m away with a focal length of 700 px.
const FARTHEST_PX: f64 = 0.35;
/// The same in root mean squares of what it was off before, which come of a few frames: of a Gaussian in the plane next to nothing
/// lies beyond.
const FARTHEST_STDS: f64 = 4.0;
/// How far beyond that a first step may go, all samples believed: what is not the ball's draws it, and is found out after.
const LONGEST_BEYOND_PX: f64 = 2.0 * SAME_PLACE_PX;

/// How far from where derivatives were formed they serve, in edge widths: those of a Gaussian edge that is s away are correlated with the
/// edge's own by exp(-s²/4), so that a centre found by them has exp(s²/2) times the least variance, here 3 % more.
const STALE_EDGES: f64 = 0.25;

/// The same in pixels.
fn near_px(model: &Model) -> f64 {
    (STALE_EDGES * model.p[EDGE]).max(SAME_PLACE_PX)
}

/// The fit of one ball in the next frame; reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Foreseen {
    fitter: Fitter,
    patch: Patch,
    ready: Option<Ready>,
}

#[derive(Debug, Clone)]
struct Ready {
    model: Model,
    prior: [Known; COUNT],
    range_px: (f64, f64),
    middle: Vector2<f64>,
    reach_px: f64,
    farthest_px: f64,
}

impl Foreseen {
    /// Makes ready for the next frame, of a size and layout like this one's; nothing where the ball was not followed.
    /// `off_px`: how far it has been from where it was expected of late, root mean square, where known.
    pub(crate) fn prepare(
        &mut self,
        like: &Frame,
        radius_px: (f64, f64),
        start: &Start,
        (reach_px, off_px): (f64, Option<f64>),
    ) {
        self.ready = None;
        let Some(followed) = start.followed else { return };
        self.patch.fill(like, start.pixel, reach_px);
        if !self.patch.is_whole() {
            return;
        }
        let (range_px, middle) = (with_margin(radius_px), start.pixel);
        let start = &Start { pixel: start.pixel - self.patch.corner(), ..*start };
        let model = first_guess(start, range_px);
        let prior = prior(start, &model);
        let farthest_px =
            off_px.map_or(FARTHEST_PX, |off_px| (FARTHEST_STDS * off_px).clamp(SAME_PLACE_PX, FARTHEST_PX));
        // In the same place no more samples are touched.
        let margin_px = farthest_px - SAME_PLACE_PX;
        let Fitter { equations, normal } = &mut self.fitter;
        let (patch, seen) = (&self.patch, (&followed.background, followed.noise_variance));
        let foresee =
            Foresee { equations: (equations, normal), patch, model: &model, margin_px, prior: &prior, seen };
        if pulp::Arch::new().dispatch(foresee).is_some() {
            self.ready = Some(Ready { model, prior, range_px, middle, reach_px, farthest_px });
        }
    }

    /// Fits the ball in the frame, once. Where it is not what was expected it is to be fitted as any other: from where it seems to be,
    /// if that is known.
    pub(crate) fn fit(&mut self, frame: &Frame) -> Result<Fit, Option<Vector2<f64>>> {
        let Ready { mut model, prior, range_px, middle, reach_px, farthest_px } =
            self.ready.take().ok_or(None)?;
        let window = self.patch.window();
        self.patch.fill(frame, middle, reach_px);
        if self.patch.window() != window || !self.patch.is_whole() {
            return Err(None);
        }
        let look = Look { equations: &mut self.fitter.equations, patch: &self.patch, model: &model };
        let (pull, seen) = pulp::Arch::new().dispatch(look).ok_or(None)?;
        let (mut step, _) = self.fitter.solve_for(&pull, (&model, &Parameters::zeros()), &prior);
        let longest_px = longest(&step);
        if longest_px.is_nan() || longest_px > farthest_px + LONGEST_BEYOND_PX {
            return Err(None);
        }
        let expected = model.p;
        let mut is_formed = seen == Seen::AsExpected;
        let near_px = near_px(&model);
        if longest_px > near_px || seen == Seen::OtherColors {
            model.p = within(model.p + step, range_px);
            (step, is_formed) = (self.form_there(&model, &prior).ok_or(None)?, true);
        }
        let mut end =
            self.fitter.settle(&self.patch, (&model, &prior), (step, is_formed, near_px)).ok_or(None)?;
        let is_within = |end: &End| longest(&(end.p - expected)) <= farthest_px;
        if !end.is_near && is_within(&end) {
            model.p = within(end.p, range_px);
            step = self.form_there(&model, &prior).ok_or(None)?;
            end = self.fitter.settle(&self.patch, (&model, &prior), (step, true, near_px)).ok_or(None)?;
        }
        if !end.is_near || !is_within(&end) {
            return Err(Some(end.p.xy() + self.patch.corner()));
        }
        self.fitter.summarize(&self.patch, &prior, range_px, &end).ok_or(None)
    }

    /// Forms the equations anew where the ball is in the frame, and the step that they ask for.
    fn form_there(&mut self, model: &Model, prior: &[Known; COUNT]) -> Option<Parameters> {
        let equations = (&mut self.fitter.equations, &mut self.fitter.normal);
        let (patch, form) = (&self.patch, Form::There);
        pulp::Arch::new().dispatch(Solve { equations, patch, model, prior, form }).map(|(step, _)| step)
    }
}
