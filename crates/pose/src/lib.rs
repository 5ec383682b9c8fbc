//! From observations to motion: calibration of the rig, rigid pose, smoothing.
//!
//! Frames and units are those of `mavsight-geometry`. Nothing here knows where the observations came from.

mod associate;
mod calibrate;
mod clock;
mod detection;
mod distances;
mod error;
mod estimate;
mod moving;
mod observations;
mod precision;
mod rates_refusal;
mod refine;
mod reordered_frames;
mod reprojection;
mod select;
mod smoother;
mod statistics;
#[cfg(test)]
mod testing;
mod three_points;

pub use associate::{
    Association, Associator, BallPlaces, Displacement, LONGEST_APART_NS, MovedCamera, STILL_IMAGES, is_far,
};
pub use calibrate::{
    ByFlight, CameraControl, CameraModel, ControlResidual, ImagesUsed, LeftOut, LeftOutReason, Lens,
    MovedObject, ObjectDoubt, ObjectImages, ObjectLags, Pixels, Rig, RigCamera, calibrate, calibrate_with,
    predict_calibration,
};
pub use clock::{
    CameraClock, CameraStream, ClockEstimate, ClockPrior, ClockVerdict, GAP_INTERVALS, PathPoint,
    PathVelocity, PixelPath, QUARTZ_DRIFT_STD, StampOdds, estimate_clocks, fitting_clocks, image_middle,
    informative_stretches_ns, odds_of_stamps,
};
pub use detection::{MarkerObservation, TrackedDetection};
pub use distances::{
    DistanceRefusal, MeasuredBetween, NetworkMeasurement, PointNetwork, measurement_words,
    points_from_distances,
};
pub use error::PoseError;
pub use estimate::{
    BodyMarker, MarkerSet, PoseEstimate, PoseEstimator, PoseSample, PredictedObservation, ReprojectionFit,
};
pub use observations::Observations;
pub use precision::{
    MapPlane, PrecisionMap, Volume, VolumePrecision, control_volume, precision_map, predicted_covariance_m2,
    volume_precision,
};
pub use rates_refusal::RatesRefusal;
pub use refine::{FlightPrior, HeldOut, RefinedFlight, hold_out, refine_flight};
pub use reordered_frames::displacements_of_reordered_frames;
pub use select::{Selection, select_control_balls};
pub use smoother::{
    CausalFilter, Doubts, EffectsOf, JerkNoise, Motion, MotionCovariance, MotionNoise, MotionSample,
    RateError, RateSeries, covariance_from_std, euler_std, lowpass_like, motion_noise, smooth,
    smooth_with_effects, smooth_with_rates,
};
pub use statistics::{MAD_TO_STD, NORMAL_95, Sampling, median};
