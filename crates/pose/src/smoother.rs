//! From measured poses to motion.
//!
//! Position and attitude are each driven by white jerk (`integrator`) and estimated together (`state`): a
//! Kalman filter forward ([`CausalFilter`] is its use in flight), and the backward pass of Bryson & Frazier
//! (1963) in the form of Bierman (1977), which inverts no predicted covariance ([`smooth()`]). The noise of a
//! flight is that of greatest likelihood of the innovations (`noise`; Harvey 1989, section 3.4). Another
//! smoother does what [`smooth()`] does: poses in, a [`Motion`] out.

mod believed;
mod causal;
mod density;
mod hidden;
mod integrator;
mod jumps;
mod motion;
mod noise;
mod passes;
mod rates;
mod smooth;
mod state;
mod whittaker;
mod wider;

pub use causal::CausalFilter;
pub use integrator::JerkNoise;
pub use motion::{Doubts, Motion, MotionCovariance, MotionSample, covariance_from_std, euler_std};
pub use noise::motion_noise;
pub use passes::EffectsOf;
pub use rates::{RateError, RateSeries};
pub use smooth::{smooth, smooth_with_effects, smooth_with_rates};
pub use state::MotionNoise;
pub use whittaker::lowpass_like;
