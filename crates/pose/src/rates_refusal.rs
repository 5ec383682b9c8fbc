//! Refusals of a gyroscope's rates.

use thiserror::Error;

/// Rates of a gyroscope that the smoother cannot use.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RatesRefusal {
    /// Rates of a gyroscope that are none.
    #[error("rate {index} of the gyroscope {what}: leave it out, or sort the rates by time")]
    Bad {
        /// Row.
        index: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// An alignment of a gyroscope whose covariance is none.
    #[error(
        "the covariance of the gyroscope's alignment with the poses is not positive definite: the flight does not determine it; \
         turn about all three axes, or leave the log out"
    )]
    BadAlignment,
    /// Too few rates of a gyroscope during the poses.
    #[error("{found} rates of the gyroscope lie within the poses, and their noise needs at least {needed}")]
    TooFew {
        /// Rates found.
        found: usize,
        /// Rates needed.
        needed: usize,
    },
    /// A gyroscope that makes the measured poses less likely.
    #[error(
        "the gyroscope contradicts the poses: each pose differs from what the rates and the earlier poses say of it by {with:.1} \
         squared standard deviations of 6, and by {without:.1} without the rates, and the poses are less likely by a factor of \
         exp({loss:.0}); is it the log of this flight, and does the sensor sit firmly in the body?"
    )]
    Disagree {
        /// Mean normalised square of a pose's innovation with the rates.
        with: f64,
        /// And without.
        without: f64,
        /// Loss of log likelihood of all poses.
        loss: f64,
    },
}
