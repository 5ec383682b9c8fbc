//! Options of an output-error fit.

/// What is known of the flapping angles at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InitialFlapping {
    /// The flight starts at rest: lower discs where the swash-plate holds them, fly-bar level.
    Trim,
    /// Anything a disc can do (a standard deviation of 0.2 rad).
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
    pub initial_flapping: InitialFlapping,
    /// The weights.
    pub noise: NoiseModel,
    /// Steps in all.
    pub max_iterations: usize,
}

impl Default for OutputErrorOptions {
    fn default() -> Self {
        Self {
            segment_s: 0.25,
            initial_flapping: InitialFlapping::Trim,
            noise: NoiseModel::Scaled,
            max_iterations: 200,
        }
    }
}
