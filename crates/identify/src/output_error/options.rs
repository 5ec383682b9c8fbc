//! Options of an output-error fit.

use std::time::Duration;

/// What is known of the model's further states at the start, such as the flapping of a disc.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InitialStates {
    /// What the model's file says of the beginning of a flight.
    AsModelled,
    /// Anything within their usual excursions: the record begins in flight.
    Free,
}

/// How the given covariances of the measurements are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseModel {
    /// As they are.
    Given,
    /// As right but for one factor for each channel, which the residuals show: x, y, z, ..., or u and v of
    /// each marker in each camera.
    Scaled,
}

/// What a user may choose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputErrorOptions {
    /// Length of the segments; infinite for single shooting. A quarter of a second is short against the time
    /// in which a small aircraft runs away, and a few of a camera's intervals.
    pub segment_s: f64,
    /// The start.
    pub initial: InitialStates,
    /// The weights.
    pub noise: NoiseModel,
    /// Steps in all.
    pub max_iterations: usize,
    /// Time after which the fit begins no further step; none: steps alone are counted.
    pub at_most: Option<Duration>,
}

impl Default for OutputErrorOptions {
    fn default() -> Self {
        Self {
            segment_s: 0.25,
            initial: InitialStates::AsModelled,
            noise: NoiseModel::Scaled,
            max_iterations: 200,
            at_most: None,
        }
    }
}
