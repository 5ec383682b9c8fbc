//! How far a run is.

/// A part of the chain that takes long enough to be watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Finding the control balls and solving for the cameras.
    Calibrate,
    /// Frames through detection, tracking and pose.
    Track,
    /// Smoothing.
    Smooth,
    /// Identification.
    Identify,
}

/// A listener; the default methods ignore everything.
pub trait Progress: Sync {
    /// A stage begins, with its number of steps where that is known.
    fn begin(&self, _stage: Stage, _steps: Option<u64>) {}
    /// One more step of the running stage is done.
    fn step(&self) {}
}

/// A listener that says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoProgress;

impl Progress for NoProgress {}
