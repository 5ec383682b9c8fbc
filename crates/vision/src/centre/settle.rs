//! The end of a fit: trust, noise, and what they ask for, with derivatives that there are.

use super::equations::Asked;
use super::model::{COUNT, EDGE, Model, Parameters};
use super::vectorized::{Form, Observe, Reweigh, Solve, SolveFor};
use super::{Fitter, LEAST_TRUSTED, MOST_WEIGHED, PIXEL_STD_PX, SMALL_STEP, is_sharpest, longest};
use crate::optics::Known;
use crate::patch::Patch;

/// Change of the noise, as the logarithm of its ratio, up to which equations that were formed with the one before weigh what is known
/// besides as they should: half as much again.
const NOISE_KEEPS: f64 = 0.4;
/// What the linear form may leave of a step before residuals are taken anew, in standard deviations of the centre. Of a step s it leaves
/// s²/2 over the width of an edge, on opposite sides of opposite signs, so that it is the radius that takes most of it.
const LEFT_STDS: f64 = 0.25;

/// Where a fit ends: by what step from its last residuals, where samples have not been weighed by that or one next to it, how much wider
/// its covariance is than that of its equations, and whether it is where these were formed.
pub(super) struct End {
    pub(super) p: Parameters,
    pub(super) unweighed: Option<Parameters>,
    pub(super) gain: f64,
    pub(super) is_near: bool,
}

impl Fitter {
    /// Goes on from a step by its derivatives, which hold as long as the ball is as near as that to where they were formed: trust is
    /// set, and what that asks for is solved with the factor that there is (Huber & Dutter 1974), until nothing is left to find. The
    /// factor is made anew where it is not that of the equations any more, where samples turn out not to be the ball's, where noise is
    /// another, and for the last time that trust is set, so that what comes of it is their solution. On noise alone each time leaves
    /// a sixth of what it asks for, as the biweight's mean slope is 0.83 there; where samples come and go it need not end by itself.
    pub(super) fn settle(
        &mut self,
        patch: &Patch,
        (formed, prior): (&Model, &[Known; COUNT]),
        (mut step, is_formed, near_px): (Parameters, bool, f64),
    ) -> Option<End> {
        let mut from = *formed;
        if 0.5 * longest(&step).powi(2) > LEFT_STDS * formed.p[EDGE] * self.centre_std_px() {
            (from.p, step) = (from.p + step, Parameters::zeros());
            let equations = &mut self.equations;
            pulp::Arch::new().dispatch(Observe { equations, patch, model: &from });
        }
        let mut noise_formed = self.equations.noise_variance();
        let mut is_formed_again = false;
        for round in 1..=MOST_WEIGHED {
            let mut asked = self.weigh(patch, &step, true);
            if self.equations.trusted() < LEAST_TRUSTED {
                return None;
            }
            let mut noise = self.equations.noise_variance() / noise_formed;
            let is_other = (round == 1 && !is_formed)
                || noise.ln().abs() > NOISE_KEEPS
                || (asked.is_spoiled && !is_formed_again);
            if is_other || round == MOST_WEIGHED {
                asked = Asked { pull: asked.pull / noise, believed: 1.0, ..asked };
                let equations = (&mut self.equations, &mut self.normal);
                let form = Form::Again { noise, pull: &asked.pull };
                pulp::Arch::new().dispatch(Solve { equations, patch, model: formed, prior, form })?;
                (noise_formed, noise) = (self.equations.noise_variance(), 1.0);
                is_formed_again = true;
            }
            let (change, length) = self.solve_for(&asked.pull, (&from, &step), prior);
            step += change;
            if length < SMALL_STEP || round == MOST_WEIGHED {
                let p = from.p + step;
                let is_near = longest(&(p - formed.p)) <= near_px;
                let end = End { p, unweighed: None, gain: noise / asked.believed, is_near };
                return (p[EDGE] >= PIXEL_STD_PX).then_some(end);
            }
        }
        None
    }

    /// Standard deviation of the centre, by the equations that were solved last.
    fn centre_std_px(&self) -> f64 {
        let [[x_px2, _], [_, y_px2]] = self.normal.covariance([0, 1]);
        x_px2.max(y_px2).sqrt()
    }

    /// Sets trust, and the noise if that is asked for, from what a step leaves.
    pub(super) fn weigh(&mut self, patch: &Patch, step: &Parameters, with_noise: bool) -> Asked {
        let equations = &mut self.equations;
        pulp::Arch::new().dispatch(Reweigh { equations, patch, step, with_noise })
    }

    /// What samples ask for behind a step, with what is known besides.
    pub(super) fn solve_for(
        &self,
        pull: &Parameters,
        (from, step): (&Model, &Parameters),
        prior: &[Known; COUNT],
    ) -> (Parameters, f64) {
        let mut pull = *pull;
        for (i, known) in prior.iter().enumerate() {
            pull[i] += (known.mean - from.p[i] - step[i]) / known.variance;
        }
        if is_sharpest(from) {
            pull[EDGE] = 0.0;
        }
        pulp::Arch::new().dispatch(SolveFor { normal: &self.normal, pull: &pull })
    }
}
