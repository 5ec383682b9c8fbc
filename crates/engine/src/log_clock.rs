//! Inputs of a log on the clock of the poses, by the log's gyroscope.

use mavsight_flight::InputSeries;
use mavsight_inertial::{GyroscopeSeries, InertialError, LogAlignment, align_log};
use mavsight_pose::PoseSample;
use mavsight_session::logs::LogGyroscope;

/// What the gyroscope of a log made of its inputs.
pub(crate) struct OnPoseClock {
    /// Moved to the clock of the poses; none where that could not be found.
    pub(crate) inputs: Option<InputSeries>,
    /// What a user should know.
    pub(crate) note: String,
}

/// Moves inputs from the clock of their log to that of the poses.
pub(crate) fn on_clock_of_poses(
    poses: &[PoseSample],
    gyroscope: &LogGyroscope,
    inputs: &InputSeries,
) -> OnPoseClock {
    match aligned(poses, gyroscope) {
        Ok(found) => {
            let moved = inputs.at_times(|log_s| found.pose_s(log_s));
            let note = moved.as_ref().map_or_else(ToString::to_string, |_| words(&found, &gyroscope.source));
            OnPoseClock { inputs: moved.ok(), note }
        }
        Err(refusal) => OnPoseClock {
            inputs: None,
            note: format!(
                "The log's clock is not known by the poses', so the log gives no inputs: {refusal}; or give --lag if both \
                 clocks are known."
            ),
        },
    }
}

fn aligned(poses: &[PoseSample], gyroscope: &LogGyroscope) -> Result<LogAlignment, InertialError> {
    let series = GyroscopeSeries::new(gyroscope.times_ns.clone(), gyroscope.rates_rad_s.clone())?;
    align_log(poses, &series)
}

fn words(found: &LogAlignment, source: &str) -> String {
    let std = |k: usize| found.covariance[(k, k)].sqrt();
    let turn_std_rad = (2..5).map(std).fold(0.0, f64::max);
    format!(
        "The log's clock by its gyroscope ({source}): at {:.1} s of the poses it shows {:.4} s ± {:.2} ms, and it gains {:.0} ± {:.0} ppm; \
         the gyroscope is turned by {:.1} ± {:.1}° in the body. The inputs are on the clock of the poses.",
        found.at_s,
        found.at_s + found.offset_s,
        1e3 * std(0),
        1e6 * found.drift,
        1e6 * std(1),
        found.body_from_sensor.angle().to_degrees(),
        turn_std_rad.to_degrees()
    )
}
