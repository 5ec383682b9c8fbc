//! The virtual room: shapes, light, camera sensor, frames.
//!
//! A film is made in two layers. The room is rendered once for each camera, with soft shadows, into linear
//! light. The aircraft before it, or the control frame of a still, is rendered into the pixels that it may
//! touch, over the exposure. Lens blur, shot and read noise and the 8-bit coding come last, over all pixels.

mod aircraft;
mod film;
mod light;
mod occluders;
mod outline;
mod render;
mod room;
mod sensor;
mod shapes;
mod stream;
mod tree;
mod visibility;

pub use aircraft::{Aircraft, ControlFrame, PaintedBall};
pub use film::Film;
pub use occluders::{Occluders, Person, Veil};
pub use room::Room;
pub use sensor::Sensor;
pub use stream::FilmStream;
