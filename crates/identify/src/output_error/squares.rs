//! Squares of errors, and how many of them the measurements decide.

/// Squares of one kind of error over a flight.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Squares {
    /// Of errors over their variances.
    pub(super) sum: f64,
    /// Number of errors.
    pub(super) count: f64,
    /// The same less what the fit took from them, or what no measurement says of them.
    pub(super) decided: f64,
}

impl Squares {
    /// Adds a square of which a share is decided.
    pub(super) fn add(&mut self, square: f64, share: f64) {
        self.sum += square;
        self.count += 1.0;
        self.decided += share.max(0.0);
    }

    /// What the variance is, over the one that the squares were divided by.
    pub(super) fn factor(&self) -> f64 {
        self.sum / self.decided
    }

    pub(super) fn total(all: &[Self]) -> Self {
        all.iter().fold(Self::default(), |a, b| Self {
            sum: a.sum + b.sum,
            count: a.count + b.count,
            decided: a.decided + b.decided,
        })
    }
}
