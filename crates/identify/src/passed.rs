//! Which low-passes a signal has passed: all that stands in one equation must have passed the same.

use mavsight_model::Axis;
use mavsight_model::regression::{Regressor, StateResponse};

/// Which of the smoother's low-passes a signal has passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Passed {
    pub(crate) translation: bool,
    pub(crate) rotation: bool,
}

impl Passed {
    pub(crate) const TRANSLATION: Self = Self { translation: true, rotation: false };
    pub(crate) const ROTATION: Self = Self { translation: false, rotation: true };

    pub(crate) fn and(self, other: Self) -> Self {
        Self { translation: self.translation || other.translation, rotation: self.rotation || other.rotation }
    }

    /// What the measured side passes: a specific force is an acceleration and the weight, which the attitude
    /// tips.
    pub(crate) fn by_measured(measured: Axis) -> Self {
        match measured {
            Axis::Moment(_) => Self::ROTATION,
            Axis::Force(_) => Self::TRANSLATION.and(Self::ROTATION),
        }
    }

    pub(crate) fn by_regressor(regressor: &Regressor, states: &[StateResponse]) -> Self {
        let mut passed = Self::default();
        for motion in &regressor.motion {
            let is_of = |s: &&StateResponse| motion.states.iter().any(|term| term.state == s.state);
            let own = [(motion.velocity, motion.rates)].into_iter();
            for (velocity, rates) in own.chain(states.iter().filter(is_of).map(|s| (s.velocity, s.rates))) {
                passed.translation |= velocity != [0.0; 3];
                passed.rotation |= rates != [0.0; 3];
            }
        }
        passed
    }
}
