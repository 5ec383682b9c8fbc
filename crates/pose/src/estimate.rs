//! The rigid pose of one instant from the markers that the cameras saw.

mod bias;
mod components;
mod estimator;
mod gates;
mod hidden;
mod instant;
mod sample;
mod solve;
mod start;
mod systematic;
#[cfg(test)]
mod tests;

pub use estimator::PoseEstimator;
pub(crate) use gates::{CLAIM_DEGREES, chi_square_beyond, chi_square_gate as chi_square_quantile};
pub use instant::ReprojectionFit;
pub use sample::{BodyMarker, MarkerSet, PoseEstimate, PoseSample, PredictedObservation};
