//! What a fit may take its time for.

/// How a ball is fitted: in a film many times a second, in a still once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FitPolicy {
    /// Steps after which a fit is given up.
    pub(super) most_steps: usize,
    /// Whether clutter is followed along lines behind the rim, such as a rod that ends at the ball.
    pub(super) clutter_along_lines: bool,
}

impl FitPolicy {
    /// For a ball that is followed through a film.
    pub(crate) const FILM: Self = Self { most_steps: 16, clutter_along_lines: false };
    /// For a still, for three times the work.
    pub(crate) const STILL: Self = Self { most_steps: 24, clutter_along_lines: true };
}

impl Default for FitPolicy {
    fn default() -> Self {
        Self::FILM
    }
}
