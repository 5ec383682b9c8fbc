//! Which of the balls that the cameras see are which markers.
//!
//! Near a predicted pose each ball is given to the marker whose image it may be; without one, triangles of
//! balls that two cameras see are compared with those of the body. A pose that nothing predicted is believed
//! where the odds for it, against balls by chance and any other pose, are 999 to 1.

mod acquire;
mod associator;
mod evidence;
mod follow;
mod frame;
mod history;
mod shifted_since;
mod stillness;
mod symmetry;
#[cfg(test)]
mod tests;
mod watch;

pub use associator::{Association, Associator};
pub use history::MovedCamera;
pub use stillness::{BallPlaces, Displacement, LONGEST_APART_NS, STILL_IMAGES, is_far};

/// Standard deviations beyond which a normal error is on either side once in a thousand times.
const NORMAL_GATE: f64 = 3.29;
