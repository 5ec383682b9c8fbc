//! What can be wrong with frames and marker colours.

use thiserror::Error;

/// Errors of this crate. Every message names the offending values and a remedy.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum VisionError {
    /// A plane of a frame has the wrong number of bytes.
    #[error(
        "the {plane} plane of a {width_px} x {height_px} frame has {bytes} bytes instead of {wanted}: \
         pass tightly packed rows, or check the size"
    )]
    FrameLength {
        /// Which plane.
        plane: &'static str,
        /// Columns of the frame.
        width_px: u32,
        /// Rows of the frame.
        height_px: u32,
        /// Bytes given.
        bytes: usize,
        /// Bytes needed.
        wanted: usize,
    },
    /// Two markers have colours of the same hue.
    #[error(
        "the colours of markers '{first}' and '{second}' are {apart_deg:.1} degrees of hue apart and at least \
         {needed_deg:.1} are needed to distinguish them: give one of them another colour"
    )]
    ColorsTooClose {
        /// One marker.
        first: String,
        /// The other marker.
        second: String,
        /// Angle between the hues, in linear light.
        apart_deg: f64,
        /// Smallest angle that is accepted.
        needed_deg: f64,
    },
    /// A marker is grey, black or white.
    #[error(
        "the colour of marker '{name}' is {purity:.2} saturated in linear light and at least {needed:.2} is needed \
         to find it by colour: choose a purer colour"
    )]
    ColorTooGrey {
        /// The marker.
        name: String,
        /// One less the ratio of the weakest to the strongest channel.
        purity: f64,
        /// Smallest value that is accepted.
        needed: f64,
    },
    /// The range of apparent diameters holds no ball that can be measured.
    #[error(
        "the expected apparent diameter {smallest_px:.3} to {largest_px:.3} px is not a range of positive numbers that \
         reaches {needed_px} px: give all lengths in metres, come closer, or use a longer lens or larger balls"
    )]
    DiameterRange {
        /// Lower end.
        smallest_px: f64,
        /// Upper end.
        largest_px: f64,
        /// Smallest diameter whose centre can be measured.
        needed_px: f64,
    },
    /// There is nothing to look for.
    #[error("no marker colours were given: at least one is needed")]
    NoMarkers,
}
