//! The pipeline on running cameras.
//!
//! Each camera has a thread that fetches frames and one that tracks, with a queue between that drops its
//! oldest frame when it is full. One thread joins the detections ([`mavsight_pipeline::Synchronizer`]),
//! associates them with markers, estimates poses and filters them by the code of a batch run. Listeners have
//! queues of their own, so that none delays the pipeline. Nothing is reported that was not measured.

mod camera;
mod clock;
mod clock_steps;
mod error;
mod events;
mod fly;
mod latency;
mod listener;
mod motion;
mod parameters;
mod pipeline;
mod queue;
mod record;
mod setup;
mod source;
mod stamps;
mod status;
mod tracking;
mod worker;

pub use clock::FlightClock;
pub use error::LiveError;
pub use events::marker_views;
pub use fly::fly;
pub use latency::Latencies;
pub use listener::{Listener, Listeners};
pub use parameters::{InputSource, Recorded};
pub use pipeline::{InstantEstimate, LivePipeline};
pub use record::{RecordedSession, Recorder, RecorderSlot};
pub use setup::{CameraSetup, FlightSummary, Pace, Setup, Tap};
pub use source::{Interrupt, Next, Opener, RunningCamera, Source};
