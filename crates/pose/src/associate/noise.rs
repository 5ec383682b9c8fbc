//! The noise of the flight so far against the claimed covariances.

use crate::PoseEstimate;

/// Degrees of freedom of the noise known before against one instant's: four markers in two cameras.
const CLAIM_DEGREES: f64 = 10.0;
/// Share of what is known of the noise that is kept from frame to frame: some seconds of video.
const NOISE_MEMORY: f64 = 0.99;
/// Redundancy from which one instant shows how large its noise is: three markers in two cameras.
pub(super) const LEAST_DEGREES: f64 = 6.0;

/// What the residuals so far show of the claimed covariances.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Noise {
    squares: f64,
    degrees: f64,
}

impl Noise {
    /// The factor on the claims, and the logarithm of the misfit's density: Student's, as the factor is known
    /// as if by [`CLAIM_DEGREES`] (Gelman et al. 2013, section 2.6); where nothing was seen yet and residuals
    /// show more than that, theirs.
    pub(super) fn misfit(&self, squares: f64, degrees: f64) -> (f64, f64) {
        if self.degrees == 0.0 && degrees >= LEAST_DEGREES {
            let scale = (squares / degrees).max(1.0);
            return (scale, -0.5 * squares / scale);
        }
        let scale = self.scale().unwrap_or(1.0);
        (scale, -0.5 * (CLAIM_DEGREES + degrees) * (squares / (CLAIM_DEGREES * scale)).ln_1p())
    }

    /// The factor on the claims, where anything was seen yet.
    pub(super) fn scale(&self) -> Option<f64> {
        (self.degrees > 0.0).then(|| (self.squares / self.degrees).max(1.0))
    }

    pub(super) fn learn(&mut self, estimate: &PoseEstimate, squares: f64, degrees: f64) {
        if estimate.left_out.is_empty() && degrees >= LEAST_DEGREES {
            self.squares = NOISE_MEMORY * self.squares + squares;
            self.degrees = NOISE_MEMORY * self.degrees + degrees;
        }
    }
}
