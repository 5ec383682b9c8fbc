//! The rigid pose of one instant from the markers that the cameras saw.

mod bias;
mod components;
mod estimator;
mod fit;
mod gates;
mod instant;
mod p3p;
mod sample;
mod solve;
mod start;
mod systematic;
#[cfg(test)]
mod tests;
mod types;

pub use estimator::PoseEstimator;
pub use fit::ReprojectionFit;
pub(crate) use gates::chi_square_gate as chi_square_quantile;
pub use sample::{MarkerSet, PoseEstimate};
pub use types::{BodyMarker, PoseSample, PredictedObservation};
