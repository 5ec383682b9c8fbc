//! Recorded inputs over time.

use crate::FlightError;
use std::ops::Range;

/// The inputs at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InputSample {
    /// Time.
    pub t_s: f64,
    /// Speed of the upper rotor.
    pub omega_u_rad_s: f64,
    /// Speed of the lower rotor.
    pub omega_l_rad_s: f64,
    /// Longitudinal angle of the swash-plate, positive tips the lower disc back.
    pub delta_lon_rad: f64,
    /// Lateral angle, positive tips it right.
    pub delta_lat_rad: f64,
}

/// A recorded quantity beside the helicopter's own, such as the speed of one of four rotors.
#[derive(Debug, Clone, PartialEq)]
pub struct InputChannel {
    /// Name, for models.
    pub name: String,
    /// One value a sample.
    pub values: Vec<f64>,
}

/// Inputs at increasing times; each holds until the next, as a command does.
///
/// A quantity that moves smoothly between samples is so taken late by half a sample interval: record at 100
/// Hz or more.
#[derive(Debug, Clone, PartialEq)]
pub struct InputSeries {
    samples: Vec<InputSample>,
    channels: Vec<InputChannel>,
}

/// By how much a time may lie outside the record: what is lost where times are written in microseconds.
const ROUNDING_S: f64 = 1e-6;

impl InputSeries {
    /// Checks and takes the samples.
    ///
    /// # Errors
    /// Fewer than two samples, a number that is not finite, a time that does not increase; rows count from 1.
    pub fn new(samples: Vec<InputSample>) -> Result<Self, FlightError> {
        if samples.len() < 2 {
            return Err(FlightError::TooFewInputs(samples.len()));
        }
        let mut before_s = f64::NEG_INFINITY;
        for (k, sample) in samples.iter().enumerate() {
            let columns = [
                ("t_s", sample.t_s),
                ("omega_u_rad_s", sample.omega_u_rad_s),
                ("omega_l_rad_s", sample.omega_l_rad_s),
                ("delta_lon_rad", sample.delta_lon_rad),
                ("delta_lat_rad", sample.delta_lat_rad),
            ];
            if let Some((column, _)) = columns.into_iter().find(|(_, value)| !value.is_finite()) {
                return Err(FlightError::InputNotFinite { row: k + 1, column });
            }
            if sample.t_s <= before_s {
                return Err(FlightError::TimeNotIncreasing { row: k + 1, t_s: sample.t_s, before_s });
            }
            before_s = sample.t_s;
        }
        Ok(Self { samples, channels: Vec::new() })
    }

    /// This series with more quantities.
    ///
    /// # Errors
    /// [`FlightError::BadChannel`] where one has not a finite value for each sample.
    pub fn with_channels(self, channels: Vec<InputChannel>) -> Result<Self, FlightError> {
        let samples = self.samples.len();
        let sound = |c: &InputChannel| c.values.len() == samples && c.values.iter().all(|v| v.is_finite());
        match channels.iter().find(|c| !sound(c)) {
            Some(bad) => Err(FlightError::BadChannel { name: bad.name.clone(), samples }),
            None => Ok(Self { channels, ..self }),
        }
    }

    /// Quantities beside the helicopter's own.
    pub fn channels(&self) -> &[InputChannel] {
        &self.channels
    }

    /// All samples.
    pub fn samples(&self) -> &[InputSample] {
        &self.samples
    }

    /// Time of the first sample.
    pub fn start_s(&self) -> f64 {
        self.samples[0].t_s
    }

    /// Time of the last sample.
    pub fn end_s(&self) -> f64 {
        self.samples[self.samples.len() - 1].t_s
    }

    /// The inputs at a time; `None` outside the record by more than a microsecond.
    pub fn at(&self, t_s: f64) -> Option<InputSample> {
        if !(t_s >= self.start_s() - ROUNDING_S && t_s <= self.end_s() + ROUNDING_S) {
            return None;
        }
        let after = self.samples.partition_point(|s| s.t_s <= t_s + ROUNDING_S).max(1);
        Some(InputSample { t_s, ..self.samples[after - 1] })
    }

    /// Which of some items in the order of their times, nanoseconds, the record covers.
    pub fn covered_range<T>(&self, items: &[T], t_ns: impl Fn(&T) -> i64) -> Range<usize> {
        let t_s = |item: &T| t_ns(item) as f64 * 1e-9;
        let from = items.partition_point(|item| t_s(item) < self.start_s() - ROUNDING_S);
        let until = items.partition_point(|item| t_s(item) <= self.end_s() + ROUNDING_S);
        from..until.max(from)
    }

    /// The items of [`InputSeries::covered_range`].
    pub fn covered<'a, T>(&self, items: &'a [T], t_ns: impl Fn(&T) -> i64) -> &'a [T] {
        &items[self.covered_range(items, t_ns)]
    }

    /// [`InputSeries::at`], as an error that says what the record covers.
    ///
    /// # Errors
    /// [`FlightError::InputsDoNotCover`].
    pub fn require(&self, t_s: f64) -> Result<InputSample, FlightError> {
        self.at(t_s).ok_or(FlightError::InputsDoNotCover {
            t_s,
            start_s: self.start_s(),
            end_s: self.end_s(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(t_s: f64, delta_lon_rad: f64) -> InputSample {
        InputSample { t_s, delta_lon_rad, ..Default::default() }
    }

    #[test]
    fn a_sample_holds_until_the_next() {
        let series =
            InputSeries::new(vec![sample(0.0, 0.0), sample(1.0, 2.0), sample(3.0, 0.0)]).expect("valid");
        assert_eq!(series.at(0.25).map(|s| s.delta_lon_rad), Some(0.0));
        assert_eq!(series.at(1.0).map(|s| s.delta_lon_rad), Some(2.0));
        assert_eq!(series.at(2.9).map(|s| s.delta_lon_rad), Some(2.0));
        assert_eq!(series.at(3.0).map(|s| s.delta_lon_rad), Some(0.0));
        assert_eq!(series.at(3.1), None);
        let times_ns: Vec<i64> = (-2..10).map(|k| k * 500_000_000).collect();
        assert_eq!(series.covered(&times_ns, |t| *t), &times_ns[2..9]);
        assert!(
            series.covered(&times_ns[..2], |t| *t).is_empty()
                && series.covered(&times_ns[9..], |t| *t).is_empty()
        );
        assert!(matches!(series.require(-1.0), Err(FlightError::InputsDoNotCover { .. })));
    }

    #[test]
    fn channels_have_a_value_a_sample() {
        let series = InputSeries::new(vec![sample(0.0, 0.0), sample(1.0, 2.0)]).expect("valid");
        let channel = |values: &[f64]| vec![InputChannel { name: "omega_3".into(), values: values.to_vec() }];
        let with = series.clone().with_channels(channel(&[1.0, 2.0])).expect("valid");
        assert_eq!(with.channels(), channel(&[1.0, 2.0]));
        for bad in [&[1.0][..], &[1.0, f64::NAN]] {
            let refused = series.clone().with_channels(channel(bad));
            assert_eq!(refused, Err(FlightError::BadChannel { name: "omega_3".into(), samples: 2 }));
        }
    }

    #[test]
    fn bad_rows_are_named() {
        let nan = InputSeries::new(vec![sample(0.0, 0.0), sample(1.0, f64::NAN)]);
        assert_eq!(nan, Err(FlightError::InputNotFinite { row: 2, column: "delta_lon_rad" }));
        let back = InputSeries::new(vec![sample(0.0, 0.0), sample(0.0, 0.0)]);
        assert_eq!(back, Err(FlightError::TimeNotIncreasing { row: 2, t_s: 0.0, before_s: 0.0 }));
        assert_eq!(InputSeries::new(vec![]), Err(FlightError::TooFewInputs(0)));
    }
}
