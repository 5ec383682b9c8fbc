//! From an image to marker observations: colour model, segmentation, sub-pixel centre, track.
//!
//! A pixel coordinate counts from the centre of the first pixel: column right, row down, the first pixel is
//! (0, 0).

mod board;
mod centre;
mod coded;
mod color;
mod colored;
mod detect;
mod error;
mod frame;
mod health;
mod optics;
mod outline;
mod patch;
mod segment;
mod track;
mod window;

pub use board::{BoardCorner, CodedBoard, CodedBoardError, MarkerDictionary, find_board, find_coded_board};
pub use centre::MODEL_STD;
pub use color::{BallColor, LEAST_CHROMA, LEAST_HUE_APART_DEG, hue, linear_light};
pub use detect::{Detection, Detector};
pub use error::VisionError;
pub use frame::{Frame, Pixels, YuvMatrix};
pub use health::BallHealth;
use mavsight_geometry::Vector3;
pub use mavsight_geometry::{ImageSize, Matrix2, Vector2};
pub use track::{Track, Tracker};
