//! The chain on cameras that are running.
//!
//! Each camera has a thread that fetches frames and one that tracks, with a queue between that drops its oldest frame rather than
//! grow; one thread joins what they see ([`mavsight_pipeline::Synchronizer`]), tells the balls apart, estimates poses and filters them: the
//! very code of a batch run. Listeners have queues of their own, so that none holds the chain up. Nothing is handed on that was not
//! measured.

mod camera;
mod chain;
mod clock;
mod error;
mod events;
mod fly;
mod latency;
mod listener;
mod motion;
mod parameters;
mod priority;
mod queue;
mod record;
mod seat;
mod source;
mod state;

pub use chain::{LiveChain, Told};
pub use clock::FlightClock;
pub use error::LiveError;
pub use fly::{CameraSetup, Flown, Pace, Setup, Tap, fly};
pub use latency::Latencies;
pub use listener::{Listener, Listeners};
pub use motion::MotionFilter;
pub use parameters::{InputSource, Recorded};
pub use priority::give_way;
pub use queue::{Popped, Queue};
pub use record::{RecordedSession, Recorder, RecorderSlot};
pub use source::{CameraFile, Interrupt, Next, Opener, Replay, RunningCamera, Source};
pub use state::{CameraStates, TrackingState};
