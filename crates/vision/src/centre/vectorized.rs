//! What is done once a step or once a fit, compiled for each vector unit that a processor may have.

use super::equations::{Asked, Covariance, Equations, Seen};
use super::is_sharpest;
use super::model::{COUNT, EDGE, Model, Parameters, RADIUS, SITING};
use super::normal::Normal;
use super::surroundings::{Background, Clutter};
use crate::optics::Known;
use crate::patch::Patch;

/// How a step's equations are formed: where the model is now, likewise after the background was looked at for a ball that was foreseen
/// elsewhere, or as the last ones with the weights that samples have now, so many times the noise, and what they ask for by that.
#[derive(Clone, Copy)]
pub(super) enum Form<'a> {
    Anew(Covariance),
    There,
    Again { noise: f64, pull: &'a Parameters },
}

/// The forming and solving of one step's equations.
pub(super) struct Solve<'a> {
    pub(super) equations: (&'a mut Equations, &'a mut Normal),
    pub(super) patch: &'a Patch,
    pub(super) model: &'a Model,
    pub(super) prior: &'a [Known; COUNT],
    pub(super) form: Form<'a>,
}

impl pulp::WithSimd for Solve<'_> {
    type Output = Option<(Parameters, f64)>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        let (equations, normal) = self.equations;
        match self.form {
            Form::Anew(covariance) => equations.add_to(simd, self.patch, self.model, covariance, normal)?,
            Form::There => equations.form_there(simd, (self.patch, self.model), normal)?,
            Form::Again { noise, pull } => equations.form_again(simd, (noise, pull), normal),
        }
        solve(normal, self.model, self.prior)
    }
}

/// The forming of equations where a ball is expected.
pub(super) struct Foresee<'a> {
    pub(super) equations: (&'a mut Equations, &'a mut Normal),
    pub(super) patch: &'a Patch,
    pub(super) model: &'a Model,
    pub(super) margin_px: f64,
    pub(super) prior: &'a [Known; COUNT],
    pub(super) seen: (&'a Background, f64),
}

impl pulp::WithSimd for Foresee<'_> {
    type Output = Option<()>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        let (equations, normal) = self.equations;
        equations.foresee(simd, (self.patch, self.model, self.margin_px), self.seen, normal)?;
        solve(normal, self.model, self.prior)?;
        normal.invert();
        Some(())
    }
}

/// Their completion by the frame that was waited for: what its samples ask for, and whether what is behind is what was expected.
pub(super) struct Look<'a> {
    pub(super) equations: &'a mut Equations,
    pub(super) patch: &'a Patch,
    pub(super) model: &'a Model,
}

impl pulp::WithSimd for Look<'_> {
    type Output = Option<(Parameters, Seen)>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        let seen = self.equations.look(simd, (self.patch, self.model))?;
        Some((self.equations.pull(simd), seen))
    }
}

/// Residuals of a model by the derivatives that there are.
pub(super) struct Observe<'a> {
    pub(super) equations: &'a mut Equations,
    pub(super) patch: &'a Patch,
    pub(super) model: &'a Model,
}

impl pulp::WithSimd for Observe<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        self.equations.observe(simd, self.patch, self.model);
    }
}

/// Adds what is known besides and solves.
#[inline(always)]
fn solve(normal: &mut Normal, model: &Model, prior: &[Known; COUNT]) -> Option<(Parameters, f64)> {
    for (i, known) in prior.iter().enumerate() {
        normal.add_known(i, known.variance.recip(), known.mean - model.p[i]);
    }
    if is_sharpest(model) && normal.pull(EDGE) < 0.0 {
        normal.hold(EDGE);
    }
    normal.solve()
}

/// What is done where the ball has moved.
pub(super) struct LookAround<'a> {
    pub(super) equations: &'a mut Equations,
    pub(super) patch: &'a Patch,
    pub(super) model: &'a Model,
    pub(super) clutter: Clutter,
}

impl pulp::WithSimd for LookAround<'_> {
    type Output = Option<()>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        self.equations.look_around(simd, (self.patch, self.model), self.clutter)
    }
}

/// The beginning of a fit.
pub(super) struct Begin<'a> {
    pub(super) equations: &'a mut Equations,
    pub(super) patch: &'a Patch,
    pub(super) noise_variance: Option<f64>,
}

impl pulp::WithSimd for Begin<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        self.equations.begin(simd, self.patch, self.noise_variance);
    }
}

/// The weighing of samples.
pub(super) struct Reweigh<'a> {
    pub(super) equations: &'a mut Equations,
    pub(super) patch: &'a Patch,
    pub(super) step: &'a Parameters,
    pub(super) with_noise: bool,
}

impl pulp::WithSimd for Reweigh<'_> {
    type Output = Asked;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        self.equations.reweigh(simd, self.patch, self.step, self.with_noise)
    }
}

/// What another gradient asks for.
pub(super) struct SolveFor<'a> {
    pub(super) normal: &'a Normal,
    pub(super) pull: &'a Parameters,
}

impl pulp::WithSimd for SolveFor<'_> {
    type Output = (Parameters, f64);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Self::Output {
        self.normal.solve_for(self.pull)
    }
}

/// The covariance of a fit's equations, of the parameters up to the edge's width, the siting's variance, and what the face shows beyond
/// the model: by what a step leaves, or what that has left by which samples were weighed last.
pub(super) struct Tell<'a> {
    pub(super) equations: (&'a mut Equations, &'a Normal),
    pub(super) patch: &'a Patch,
    pub(super) linear: &'a [f64; 3],
    pub(super) unweighed: Option<&'a Parameters>,
}

impl pulp::WithSimd for Tell<'_> {
    type Output = ([[f64; EDGE + 1]; EDGE + 1], f64, f64);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Self::Output {
        let (equations, normal) = self.equations;
        let [[siting_px2]] = normal.covariance([SITING]);
        if let Some(step) = self.unweighed {
            equations.leave(simd, step);
        }
        let texture = equations.texture(self.patch, self.linear);
        (normal.covariance([0, 1, RADIUS, EDGE]), siting_px2, texture)
    }
}
