//! Streams that are none.

use super::Stream;
use crate::PipelineError;

/// The least time between frames: 100 000 a second, more than any camera films.
const LEAST_INTERVAL_NS: i64 = 10_000;

impl Stream {
    /// The stream, where it has frames at times that a camera may have.
    ///
    /// # Errors
    /// [`PipelineError::NoFrames`]; [`PipelineError::StampsTooDense`].
    pub(crate) fn checked(self) -> Result<Self, PipelineError> {
        let interval_ns = (self.interval_s() * 1e9).round() as i64;
        if self.stamps_ns.is_empty() {
            Err(PipelineError::NoFrames { camera: self.name })
        } else if interval_ns < LEAST_INTERVAL_NS {
            let (camera, least_ns) = (self.name, LEAST_INTERVAL_NS);
            Err(PipelineError::StampsTooDense { camera, interval_ns, least_ns })
        } else {
            Ok(self)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::stream;
    use mavsight_pose::CameraClock;

    /// Stamps in another unit left the search for clocks without an end.
    #[test]
    fn stamps_in_another_unit_are_refused() {
        let sound = || stream(0, CameraClock::default(), 30.0, 0..20);
        assert!(sound().checked().is_ok());
        let mut dense = sound();
        dense.stamps_ns = (0..20).collect();
        let refused = dense.checked().err();
        assert!(matches!(refused, Some(PipelineError::StampsTooDense { interval_ns: 1, .. })), "{refused:?}");
    }
}
