//! Refusals of measured distances.

use thiserror::Error;

/// Distances from which no points follow.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DistanceRefusal {
    /// A measured distance that is none.
    #[error("the distance {between}: {detail}")]
    Bad {
        /// What was measured.
        between: String,
        /// What is wrong with it, and what to do.
        detail: String,
    },
    /// A network of distances in which points can move.
    #[error(
        "the measured distances do not hold the points together: {more} more at least are needed, to points such as {loose}; measure every distance between the balls"
    )]
    Loose {
        /// Points that can move most.
        loose: String,
        /// Motions that no measurement holds.
        more: usize,
    },
    /// A network of distances so near to one plane that these do not show on which side of it a point is.
    #[error(
        "the points are nearly in one plane: {:.0} mm out of it, uncertain by {:.0} mm; hang some balls further out of it, or \
         measure with less than {:.1} mm of standard deviation", 1e3 * thickness_m, 1e3 * std_m, 1e3 * tape_std_m
    )]
    Flat {
        /// How far the points are out of their plane, root mean square.
        thickness_m: f64,
        /// Standard deviation of that direction.
        std_m: f64,
        /// Of a distance, as stated.
        tape_std_m: f64,
    },
    /// Distances that contradict each other.
    #[error(
        "the measured distances contradict each other, by {ratio:.1} times their standard deviations: {}{worst}; measure these again, or state a larger standard deviation", if *is_one_of { "it may be any of " } else { "the largest residuals are " }
    )]
    Contradictory {
        /// Root of chi-square over its degrees of freedom.
        ratio: f64,
        /// Measurements with their residuals.
        worst: String,
        /// Whether dropping any one of them lets the others agree.
        is_one_of: bool,
    },
}
