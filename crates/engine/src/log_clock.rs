//! The aircraft's own log beside the poses: its clock, its inputs on theirs, and its gyroscope in the motion.

use crate::means::{MEANS_S, mean_sensors};
use crate::{EngineError, Flight};
use mavsight_flight::{InputSeries, SensorSeries};
use mavsight_inertial::{GyroscopeSeries, InertialError, LogAlignment, align_log};
use mavsight_pipeline::PipelineError;
use mavsight_pose::{Motion, PoseSample, RateSeries};
use mavsight_session::logs::LogGyroscope;

/// What the gyroscope of a log has made of the flight.
#[derive(Default)]
pub(crate) struct LogBesidePoses {
    /// How the log lies beside the poses; none where that could not be found.
    pub(crate) alignment: Option<LogAlignment>,
    /// The motion from poses and gyroscope; none where they disagree.
    pub(crate) motion: Option<Motion>,
    /// What a user should know.
    pub(crate) notes: Vec<String>,
}

impl LogBesidePoses {
    /// Of a flight with a log whose clock is not known; none of another. `smooth` makes motion of the poses and rates.
    pub(crate) fn of(
        poses: &[PoseSample],
        flight: &Flight<'_>,
        smooth: impl FnOnce(&RateSeries) -> Result<Motion, PipelineError>,
    ) -> Option<Self> {
        let gyroscope = flight.gyroscope.filter(|_| flight.options.lag_s.is_none() && !poses.is_empty())?;
        let (alignment, series) = match aligned(poses, gyroscope) {
            Ok(found) => found,
            Err(refusal) => {
                let note = format!(
                    "The log's clock is not known by the poses', so the log gives no inputs: {refusal}; or give --lag if both \
                     clocks are known."
                );
                return Some(Self { notes: vec![note], ..Self::default() });
            }
        };
        let mut notes = vec![words(&alignment, &gyroscope.source)];
        let rates = alignment.body_rates(&series);
        let motion =
            rates.map_err(|why| why.to_string()).and_then(|r| smooth(&r).map_err(|why| why.to_string()));
        notes.push(match &motion {
            Ok(_) => "Attitude and rates of the motion follow the log's gyroscope too; equation error has the motion from \
                      the poses alone, whose band it knows."
                .to_owned(),
            Err(why) => format!("The motion is that of the poses alone: {why}."),
        });
        Some(Self { alignment: Some(alignment), motion: motion.ok(), notes })
    }

    /// Inputs on the clock of the poses; none where that is not known.
    pub(crate) fn moved(&mut self, inputs: &InputSeries) -> Option<InputSeries> {
        let found = self.alignment.as_ref()?;
        match inputs.at_times(|log_s| found.pose_s(log_s)) {
            Ok(moved) => Some(moved),
            Err(why) => {
                self.notes.push(why.to_string());
                None
            }
        }
    }
}

/// The log's sensors on the clock of the poses, fast ones as means; none where the flight has none, or where the clock of
/// the log is not known.
///
/// # Errors
/// Times that no longer increase.
pub(crate) fn sensors_of_log(
    log: Option<&LogAlignment>,
    flight: &Flight<'_>,
    notes: &mut Vec<String>,
) -> Result<Option<SensorSeries>, EngineError> {
    let Some(sensors) = flight.log_sensors else { return Ok(None) };
    let moved = match (log, flight.options.lag_s) {
        (Some(found), _) => mean_sensors(sensors)?.at_times(|log_s| found.pose_s(log_s))?,
        (None, Some(lag_s)) => mean_sensors(sensors)?.at_times(|log_s| log_s + lag_s)?,
        (None, None) => {
            notes.push(
                "The log's sensors are not used: without a gyroscope its clock is not known by the poses'; give --lag if it is."
                    .to_owned(),
            );
            return Ok(None);
        }
    };
    notes.push(format!(
        "Output error has the log's sensors too ({}); samples nearer than {:.0} ms count as their means.",
        sensors.columns().join(", "),
        1e3 * MEANS_S
    ));
    Ok(Some(moved))
}

fn aligned(
    poses: &[PoseSample],
    gyroscope: &LogGyroscope,
) -> Result<(LogAlignment, GyroscopeSeries), InertialError> {
    let series = GyroscopeSeries::new(gyroscope.times_ns.clone(), gyroscope.rates_rad_s.clone())?;
    align_log(poses, &series).map(|found| (found, series))
}

/// Standard deviation of an attitude that is not shown: a third of the right angle that is presumed before the flight.
const UNKNOWN_RAD: f64 = std::f64::consts::FRAC_PI_6;

fn words(found: &LogAlignment, source: &str) -> String {
    let std = |k: usize| found.covariance[(k, k)].sqrt();
    let turn_std_rad = (2..5).map(std).fold(0.0, f64::max);
    let attitude = if turn_std_rad > UNKNOWN_RAD {
        "the flight does not show about every axis how the gyroscope is turned in the body".to_owned()
    } else {
        let turned_rad = found.body_from_sensor.angle();
        format!(
            "the gyroscope is turned by {:.1} ± {:.1}° in the body",
            turned_rad.to_degrees(),
            turn_std_rad.to_degrees()
        )
    };
    format!(
        "The log's clock by its gyroscope ({source}): at {:.1} s of the poses it shows {:.4} s ± {:.2} ms, and it gains {:.0} ± {:.0} ppm; \
         {attitude}. The inputs are on the clock of the poses.",
        found.at_s,
        found.at_s + found.offset_s,
        1e3 * std(0),
        1e6 * found.drift,
        1e6 * std(1)
    )
}
