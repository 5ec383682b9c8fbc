//! Equations that are formed before a frame is there, where the ball is expected, and completed once it is.

use super::{Covariance, Equations};
use crate::centre::disc;
use crate::centre::model::{Model, Parameters};
use crate::centre::normal::Normal;
use crate::centre::surroundings::Background;
use crate::patch::Patch;
use pulp::Simd;

/// Part of the rim's variances by which they may be other than expected with the sums that there are: the samples' own weights are set
/// right, and what is claimed of the centre is off by less, as the rim's brightness is one of three things that tell it.
const AS_EXPECTED: f32 = 0.33;

/// What is behind a ball that was foreseen: what was expected, as colourful but more or less uncertain, or of other colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::centre) enum Seen {
    AsExpected,
    OtherClutter,
    OtherColors,
}

impl Equations {
    /// Lays out the samples of a ball that is yet to be seen, for any place within a margin, with what is behind it as it last was, and
    /// forms derivatives, covariance and sums. The patch holds the frame before, whose grain is taken for the next's. None where there
    /// is no solution.
    #[inline(always)]
    pub(in crate::centre) fn foresee<S: Simd>(
        &mut self,
        simd: S,
        (patch, model, margin_px): (&Patch, &Model, f64),
        (background, noise_variance): (&Background, f64),
        normal: &mut Normal,
    ) -> Option<()> {
        self.begin(simd, patch, Some(noise_variance));
        self.lay_out(simd, (patch, model), margin_px);
        let (place, seen) = ((patch, &disc(model)), (background, noise_variance));
        let (rim, touched) =
            ((&self.rim[..], &self.by_angle[..]), (&self.touched[..], &self.color_touched[..]));
        self.surroundings.foresee(simd, place, rim, touched, seen)?;
        self.use_pixels(simd, patch, model);
        self.add_to(simd, patch, model, Covariance::Anew, normal)?;
        self.expected_variance.clear();
        for (place, open) in self.open[..self.surroundings.covariance.len()].iter().enumerate() {
            let behind = self.surroundings.covariance.diagonal(place);
            self.expected_variance.push(self.variance[place] + open * open * behind);
        }
        Some(())
    }

    /// Takes the frame that was waited for: what is behind the ball, and what it leaves of all samples. None where too little is free,
    /// where there is clutter and none was expected, or light beside the ball is beyond what can be shown.
    #[inline(always)]
    pub(in crate::centre) fn look<S: Simd>(
        &mut self,
        simd: S,
        (patch, model): (&Patch, &Model),
    ) -> Option<Seen> {
        self.trust_all(patch);
        if self.glare.may_reach() {
            return None;
        }
        let place = (patch, &disc(model));
        let are_colors_as_expected = self.surroundings.look(simd, place, self.noise_variance)?;
        self.light_up(simd, patch);
        let is_as_expected = self.weigh_background();
        self.observe(simd, patch, model);
        Some(match (are_colors_as_expected, is_as_expected) {
            (false, _) => Seen::OtherColors,
            (true, false) => Seen::OtherClutter,
            (true, true) => Seen::AsExpected,
        })
    }

    /// Forms the equations of the frame that was taken where the ball is in it, within the margin.
    #[inline(always)]
    pub(in crate::centre) fn form_there<S: Simd>(
        &mut self,
        simd: S,
        (patch, model): (&Patch, &Model),
        normal: &mut Normal,
    ) -> Option<()> {
        self.surroundings.correlate();
        self.places.decode(simd);
        self.add_to(simd, patch, model, Covariance::Anew, normal)
    }

    /// Sets the weights of the rim's equations right where what is behind is more or less uncertain than was expected, its correlation
    /// being as it was. False where that is much.
    #[inline(always)]
    fn weigh_background(&mut self) -> bool {
        let rim = self.open.iter().zip(&self.variance).zip(&self.expected_variance);
        for (((open, own), expected), (shrunk, deviation)) in
            rim.zip(self.shrunk.iter_mut().zip(self.surroundings.deviation()))
        {
            *shrunk = *expected / (own + open * open * deviation * deviation);
        }
        let (mut apart, mut sum) = (0.0, 0.0);
        for (shrunk, expected) in self.shrunk.iter_mut().zip(&self.expected_variance) {
            apart += (expected / *shrunk - expected).abs();
            sum += expected;
            *shrunk = shrunk.sqrt();
        }
        apart <= AS_EXPECTED * sum
    }

    /// Sets all residuals to those of a model, with the derivatives that there are.
    #[inline(always)]
    pub(in crate::centre) fn observe<S: Simd>(&mut self, simd: S, patch: &Patch, model: &Model) {
        model.values(simd, &self.places, &patch.from_coded, &mut self.values.channels);
        self.find_residuals(patch, model);
        self.whiten_residuals();
    }

    /// What all samples ask for, believed as they are in the equations.
    #[inline(always)]
    pub(in crate::centre) fn pull<S: Simd>(&self, simd: S) -> Parameters {
        let mut pull = super::weighing::Pull::nothing(simd);
        let samples = self.whitened_residuals.iter().zip(&self.shrunk);
        for (row, (residual, shrunk)) in self.whitened.iter().zip(samples) {
            pull.add(simd, row, residual * shrunk);
        }
        pull.sums()
    }

    /// What was behind the ball, for the next frame.
    pub(in crate::centre) fn background(&self) -> Background {
        self.surroundings.background(&self.by_angle)
    }
}
