//! A fit from its first guess to its end: steps of Gauss-Newton, and a new layout and background wherever the
//! ball has moved.

use super::background::{Background, Planes};
use super::constants::{LEAST_CONTRAST, NOISE_STD, SAME_PLACE_PX};
use super::guess::{Start, distance_px, first_guess, prior, with_margin, within};
use super::layout::Layout;
use super::linearized::Linearized;
use super::model::{BALL, COUNT, EDGE, Model, Parameters, RADIUS};
use super::normal::Solved;
use super::outcome::{CentreFit, End, LEAST_TRUSTED, NoFit, contrast};
use super::policy::FitPolicy;
use super::samples::{Noise, grain_variance};
use super::stages::Stages;
use super::trust::Trust;
use super::weighted::{Left, Weighted};
use crate::Vector2;
use crate::optics::Known;
use crate::patch::Patch;
use pulp::Simd;

/// Times that trust and noise are set before they are kept, so that the steps shrink.
const MOST_WEIGHED: usize = 4;
/// That of the last step: all that is still to come then is a fraction of what noise does to one parameter.
const SMALL_STEP: f64 = 1.0;
/// Times that trust and noise are set at least: first the trust, then the noise too.
const LEAST_WEIGHED: usize = 2;
/// Squared length, in standard deviations over all parameters, of a step whose outcome is predicted from the
/// equations' linear form: as long as that by which two frames' noise sets their parameters apart (2 a
/// parameter; three quarters of all frames).
const NEAR: f64 = 3.0 * COUNT as f64;
/// Change of the noise, as a part of it, at which the claims stand: a twentieth of a standard deviation.
const NOISE_CHANGES: f64 = 0.1;
/// Longest step of a length in pixels, in edge widths w: far from an edge of Gaussian slope, Gauss-Newton
/// goes no further than w √π (the integral of the slope over that of its square). The background is not
/// estimated again before, either, as long as the fit has not come near.
const LONGEST_STEP_EDGES: f64 = 1.772_454;
/// Movement in edge widths up to which the planes of the background serve: what the ball then covers of free
/// pixels is a few hundredths.
const ALIKE_EDGES: f64 = 0.5;
/// Standard deviations that a ball differs from its background, below which a first look at a region ends:
/// its colour is one pixel's and the noise not yet the film's own.
const FAINT: f64 = 0.5 * LEAST_CONTRAST;

/// Fits balls; the largest buffers are reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fitter {
    policy: FitPolicy,
    layout: Layout,
    background: Background,
    linearized: Linearized,
    weighted: Weighted,
}

/// One fit, compiled for each vector unit that a processor may have.
struct Run<'a> {
    fitter: &'a mut Fitter,
    patch: &'a Patch,
    start: &'a Start,
    range_px: (f64, f64),
}

impl pulp::WithSimd for Run<'_> {
    type Output = Result<CentreFit, NoFit>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let search = Search::new(self.patch, self.start, self.range_px);
        self.fitter.run(simd, self.patch, search)
    }
}

/// The part of a step that is taken.
struct Step {
    change: Parameters,
    /// Whether its outcome follows from the equations' linear form.
    is_near: bool,
}

impl Step {
    /// None where it is no number.
    fn of(solved: &Solved, model: &Model) -> Option<Self> {
        let longest = solved.change.fixed_rows::<4>(0).amax();
        let longest_step_px = LONGEST_STEP_EDGES * model.p[EDGE];
        let part = if longest > longest_step_px { longest_step_px / longest } else { 1.0 };
        longest.is_finite().then(|| Self {
            change: solved.change * part,
            is_near: solved.length < NEAR || longest <= SAME_PLACE_PX,
        })
    }
}

/// A fit on its way.
struct Search {
    model: Model,
    prior: [Known; COUNT],
    range_px: (f64, f64),
    trust: Trust,
    noise: Noise,
    /// Where it began, and how far from there it may go.
    start_px: Vector2<f64>,
    reach_px: f64,
    /// Planes of the background, and where the ball was when they were fitted.
    planes: Option<(Planes, Parameters)>,
    /// Whether the last step's outcome follows from the equations' linear form.
    is_near: bool,
    /// Times that trust and noise have been set.
    weighed: usize,
    was_too_large: bool,
}

impl Search {
    #[inline(always)]
    fn new(patch: &Patch, start: &Start, range_px: (f64, f64)) -> Self {
        let model = first_guess(start, range_px);
        let least = grain_variance(patch).max(NOISE_STD * NOISE_STD);
        Self {
            prior: prior(start, &model),
            range_px,
            trust: Trust::new(patch),
            noise: Noise { least, variance: start.followed.map_or(least, |f| f.noise_variance) },
            start_px: start.pixel,
            reach_px: 1.0 + model.unit_px,
            planes: None,
            is_near: false,
            weighed: 0,
            was_too_large: false,
            model,
        }
    }

    /// Movement after which layout and background are formed again.
    fn same_place_px(&self) -> f64 {
        if self.is_near { SAME_PLACE_PX } else { LONGEST_STEP_EDGES * self.model.p[EDGE] }
    }

    /// Takes a step; false where it leads too far away, or the ball is too large and still grows.
    fn take(&mut self, step: &Step) -> bool {
        self.is_near = step.is_near;
        self.model.p = within(self.model.p + step.change, self.range_px);
        let is_too_large = self.model.p[RADIUS] >= self.range_px.1;
        let remains_too_large = is_too_large && (self.was_too_large || step.is_near);
        self.was_too_large = is_too_large;
        (self.model.p.xy() - self.start_px).norm() <= self.reach_px && !remains_too_large
    }

    /// Forms layout and background where the ball is now; None where nothing is known of the background.
    #[inline(always)]
    fn around<S: Simd>(
        &mut self,
        simd: S,
        patch: &Patch,
        policy: FitPolicy,
        (layout, background): (&mut Layout, &mut Background),
    ) -> Option<()> {
        self.model.shade_here();
        layout.form(simd, patch, &self.model);
        let p = self.model.p;
        self.trust.glare.reach(patch, &p, (&layout.covered, &layout.depth));
        self.trust.forget_dazzled(patch);
        let noise_variance = self.noise.variance;
        let is_close = |from: &Parameters| distance_px(from, &p) < ALIKE_EDGES * p[EDGE];
        if !self.planes.is_some_and(|(_, from)| is_close(&from)) {
            let planes = Planes::new(simd, patch, (layout, &p), noise_variance)?;
            self.planes = Some((planes, p));
        }
        let (planes, _) = self.planes?;
        background.form(simd, patch, (layout, planes, p[EDGE]), (noise_variance, policy))
    }

    /// Sets trust and, once that has been set without it, noise from what a step leaves: whether the noise is
    /// about what it was.
    #[inline(always)]
    fn weigh(&mut self, stages: &Stages<'_>, weighted: &Weighted, left: &Left) -> Result<bool, NoFit> {
        let before = self.noise;
        self.weighed += 1;
        weighted.set_trust(stages, left, &mut self.trust);
        if self.weighed >= LEAST_WEIGHED {
            self.noise.variance = weighted.noise_variance(stages, left, &self.trust, &before);
            if self.trust.believed(stages) < LEAST_TRUSTED {
                return Err(NoFit::Hidden);
            }
        }
        Ok((self.noise.variance / before.variance).ln().abs() < NOISE_CHANGES)
    }
}

impl Fitter {
    pub(crate) fn new(policy: FitPolicy) -> Self {
        Self { policy, ..Self::default() }
    }

    /// Fits the ball in the patch: a disc with a radius in `radius_px` that stands out and is mostly visible.
    ///
    /// # Errors
    /// Why there is none.
    pub(crate) fn fit(
        &mut self,
        patch: &Patch,
        radius_px: (f64, f64),
        start: &Start,
    ) -> Result<CentreFit, NoFit> {
        if !patch.is_whole() {
            return Err(NoFit::Cut);
        }
        let start = &Start { pixel: start.pixel - patch.corner(), ..*start };
        let range_px = with_margin(radius_px);
        pulp::Arch::new().dispatch(Run { fitter: self, patch, start, range_px })
    }

    #[inline(always)]
    fn run<S: Simd>(&mut self, simd: S, patch: &Patch, mut search: Search) -> Result<CentreFit, NoFit> {
        let policy = self.policy;
        let Self { layout, background, .. } = self;
        let mut seen_from = None;
        for _ in 0..policy.most_steps {
            let same_place_px = search.same_place_px();
            if !seen_from.is_some_and(|from| distance_px(&from, &search.model.p) <= same_place_px) {
                let around = (&mut *layout, &mut *background);
                search.around(simd, patch, policy, around).ok_or(NoFit::NoBackground)?;
                seen_from = Some(search.model.p);
            }
            let model = search.model;
            let linearized =
                std::mem::take(&mut self.linearized).at(simd, patch, (&*layout, &*background), &model);
            let stages = Stages { patch, layout, background, linearized: &linearized };
            let weighted = std::mem::take(&mut self.weighted)
                .form(simd, &stages, &search.trust, &search.noise)
                .ok_or(NoFit::Undetermined)?;
            let solved = weighted.solve(simd, &stages, &model, &search.prior).ok_or(NoFit::Undetermined)?;
            let step = Step::of(&solved, &model).ok_or(NoFit::Undetermined)?;
            let linear = [0, 1, 2].map(|c| model.p[BALL + c]);
            if search.weighed == 0 && contrast(&stages, search.noise.variance, &linear) < FAINT {
                return Err(NoFit::Faint);
            }
            if !search.take(&step) {
                return Err(NoFit::Lost);
            }
            if step.is_near {
                let left = weighted.left(simd, &stages, &step.change);
                let mut has_converged = search.weighed >= LEAST_WEIGHED;
                if search.weighed < MOST_WEIGHED {
                    has_converged &= search.weigh(&stages, &weighted, &left)?;
                }
                if solved.length < SMALL_STEP && has_converged {
                    let Search { trust, prior, noise, range_px, .. } = &search;
                    let (noise, p) = (*noise, search.model.p);
                    let end = End { stages, trust, noise, solved: &solved, left: &left, p };
                    return end.summarize(prior, *range_px);
                }
            }
            (self.linearized, self.weighted) = (linearized, weighted);
        }
        Err(NoFit::NotConverged)
    }
}
