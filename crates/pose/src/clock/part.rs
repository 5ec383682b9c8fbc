//! The parts of a clock that are estimated.

use super::types::{CameraClock, ClockPrior};

/// One part of one clock that is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Offset,
    Drift,
    LineTime,
}

impl Part {
    /// Change of a centre's pixel with this part, over its velocity.
    pub(super) fn factor(self, t_s: f64, rows_px: f64) -> f64 {
        match self {
            Self::Offset => 1.0,
            Self::Drift => t_s,
            Self::LineTime => -rows_px,
        }
    }

    pub(super) fn of(self, clock: &mut CameraClock) -> &mut f64 {
        match self {
            Self::Offset => &mut clock.offset_s,
            Self::Drift => &mut clock.drift,
            Self::LineTime => &mut clock.line_time_s,
        }
    }

    /// Standard deviation beforehand, and how far a clock is from the start.
    pub(super) fn prior(self, prior: &ClockPrior, clock: &CameraClock) -> (f64, f64) {
        let (mut now, mut start) = (*clock, prior.clock);
        let std = match self {
            Self::Offset => prior.offset_std_s,
            Self::Drift => prior.drift_std,
            Self::LineTime => prior.line_time_std_s,
        };
        (std, *self.of(&mut now) - *self.of(&mut start))
    }
}
