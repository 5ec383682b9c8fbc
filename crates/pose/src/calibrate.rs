//! From control points and moved objects to a rig of cameras with their uncertainty.

mod adjust;
mod alike;
mod choose;
mod disagree;
mod equations;
#[cfg(test)]
mod fault_tests;
mod layout;
mod link;
mod model;
mod moved;
#[cfg(test)]
mod object_tests;
mod objects;
mod pair;
mod plane;
mod problem;
mod rig;
mod snoop;
mod solve;
mod start;
#[cfg(test)]
pub(crate) mod test_sets;
#[cfg(test)]
mod tests;

pub use model::{CameraModel, Lens, Pixels};
pub use moved::{MovedObject, ObjectDoubt, ObjectImages, ObjectLags};
pub use rig::{ByFlight, CameraControl, ControlResidual, ImagesUsed, LeftOut, LeftOutReason, Rig, RigCamera};
pub use solve::{calibrate, calibrate_with, predict_calibration};
