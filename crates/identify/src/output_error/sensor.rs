//! Sensors beside poses or images, at times of their own.

use super::measure::Measurements;
use super::model::Equations;
use super::propagate::{SEEN, by_turn};
use super::row::Row;
use super::{SAME_TIME_S, seconds};
use crate::IdentifyError;
use mavsight_flight::{InputSeries, SensorSeries};
use mavsight_geometry::Isometry3;
use mavsight_model::{Evaluation, Model};
use nalgebra::SVector;
use std::ops::Range;

/// Poses or images, and samples of sensors.
#[derive(Debug, Clone)]
pub struct SensedMeasurements {
    pub(crate) seen: Measurements,
    names: Vec<String>,
    stds: Vec<f64>,
    samples: SensorSeries,
    instants: Vec<Instant>,
}

/// An instant, and which of the poses or images and which of the samples are its.
#[derive(Debug, Clone, Copy)]
struct Instant {
    t_s: f64,
    seen: Option<usize>,
    sample: Option<usize>,
}

/// What the sensors show at one instant.
pub(crate) struct Sample<'a> {
    of: &'a SensedMeasurements,
    instant: usize,
    values: &'a [f64],
}

impl SensedMeasurements {
    pub(super) fn new(
        seen: Measurements,
        model: &Model,
        sensors: &SensorSeries,
    ) -> Result<Self, IdentifyError> {
        let times_s = seen.times_s();
        let first_s = times_s.first().copied().unwrap_or(f64::INFINITY) - SAME_TIME_S;
        let last_s = times_s.last().copied().unwrap_or(f64::NEG_INFINITY) + SAME_TIME_S;
        let samples = sensors.of(model)?.within(|t_ns| (first_s..=last_s).contains(&seconds(t_ns)));
        let instants = instants(&times_s, samples.times_ns());
        let (names, stds) = model.sensors.iter().map(|s| (s.name.clone(), s.std)).unzip();
        Ok(Self { seen, names, stds, samples, instants })
    }

    pub(super) fn times_s(&self) -> Vec<f64> {
        self.instants.iter().map(|i| i.t_s).collect()
    }

    pub(super) fn channels(&self) -> Vec<String> {
        self.seen.channels().into_iter().chain(self.names.iter().cloned()).collect()
    }

    pub(super) fn series(&self) -> Vec<Range<usize>> {
        let seen = self.seen.channels().len();
        vec![0..seen, seen..seen + self.names.len()]
    }

    /// Which pose or image is of an instant.
    pub(super) fn seen_at(&self, instant: usize) -> Option<usize> {
        self.instants[instant].seen
    }

    pub(super) fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        let places = self.instants.iter().enumerate().filter_map(|(k, i)| i.seen.map(|_| k));
        let places: Vec<usize> = places.collect();
        self.seen.poses().into_iter().map(|(k, pose)| (places[k], pose)).collect()
    }

    pub(super) fn sample(&self, instant: usize) -> Option<Sample<'_>> {
        let instant = self.instants[instant].sample?;
        Some(Sample { of: self, instant, values: self.samples.row(instant) })
    }
}

/// All times in order.
fn instants(seen_s: &[f64], sampled_ns: &[i64]) -> Vec<Instant> {
    let mut out = Vec::with_capacity(seen_s.len() + sampled_ns.len());
    let (mut seen, mut sampled) = (0..seen_s.len(), 0..sampled_ns.len());
    let (mut next, mut sample) = (seen.next(), sampled.next());
    while next.is_some() || sample.is_some() {
        let t_s = next.map_or(f64::INFINITY, |k| seen_s[k]);
        let sample_s = sample.map_or(f64::INFINITY, |k| seconds(sampled_ns[k]));
        let is_seen = t_s <= sample_s + SAME_TIME_S;
        let is_sampled = sample_s <= t_s + SAME_TIME_S;
        let own = Instant {
            t_s: if is_seen { t_s } else { sample_s },
            seen: next.filter(|_| is_seen),
            sample: sample.filter(|_| is_sampled),
        };
        out.push(own);
        if is_seen {
            next = seen.next();
        }
        if is_sampled {
            sample = sampled.next();
        }
    }
    out
}

impl<'a> Sample<'a> {
    /// Rows of the sensors that have a sample, at a state and the inputs of the evaluation, which change at
    /// `input_rates`.
    ///
    /// A sensor that inputs drive jumps with their rows; its derivative by their lag is that of inputs that
    /// move from row to row at a constant rate.
    ///
    /// # Errors
    /// [`IdentifyError::SensorNotFinite`].
    pub(super) fn rows(
        &self,
        y: &[f64],
        evaluation: &mut Evaluation<'_>,
        equations: &Equations,
        input_rates: &[f64],
    ) -> Result<Vec<Row<'a>>, IdentifyError> {
        let stds = &self.of.stds;
        let mut predicted = vec![0.0; stds.len()];
        evaluation.sense(y, &mut predicted);
        let first = self.of.seen.channels().len();
        let row = |k: usize| Row {
            residual: (self.values[k] - predicted[k]) / stds[k],
            by_pose: SVector::<f64, SEEN>::zeros(),
            by_rest: Vec::new(),
            by_parameter: Vec::new(),
            channel: first + k,
            instant: self.instant,
            directions: &[],
            pixel: [0.0; 2],
        };
        let mut rows: Vec<Row<'a>> = (0..stds.len()).map(row).collect();
        let turn = by_turn(y);
        for slope in evaluation.sensors_by_state() {
            let (row, by) = (&mut rows[slope.row], slope.value / stds[slope.row]);
            match slope.column {
                k @ 0..=2 => row.by_pose[k] += by,
                k @ 3..=6 => (0..3).for_each(|axis| row.by_pose[3 + axis] += by * turn[(axis, k - 3)]),
                k => row.by_rest.push((k - 1, by)),
            }
        }
        for slope in evaluation.sensors_by_parameter() {
            let place = equations.places[slope.column];
            rows[slope.row].by_parameter.push((place, slope.value / stds[slope.row]));
        }
        if let Some(lag) = equations.lag {
            for slope in evaluation.sensors_by_input() {
                let by = -slope.value * input_rates[slope.column] / stds[slope.row];
                rows[slope.row].by_parameter.push((lag, by));
            }
        }
        let is_there = |row: &Row<'_>| self.values[row.channel - first].is_finite();
        rows.retain(is_there);
        match rows.iter().find(|row| !row.residual.is_finite()) {
            Some(row) => {
                let t_s = seconds(self.of.samples.times_ns()[self.instant]);
                let name = self.of.names[row.channel - first].clone();
                Err(IdentifyError::SensorNotFinite { name, t_s })
            }
            None => Ok(rows),
        }
    }
}

/// How fast inputs move about a row, from the row before to the one behind.
pub(super) fn input_rates(inputs: &InputSeries, row: usize) -> Vec<f64> {
    let (before, behind) = (row.saturating_sub(1), (row + 1).min(inputs.times_s().len() - 1));
    let time_s = inputs.times_s()[behind] - inputs.times_s()[before];
    inputs.row(behind).iter().zip(inputs.row(before)).map(|(b, a)| (b - a) / time_s).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_are_the_union_of_times_in_order() {
        let found = instants(&[0.0, 0.1, 0.2], &[0, 40_000_000, 100_000_400, 199_999_900]);
        let all: Vec<(f64, Option<usize>, Option<usize>)> =
            found.iter().map(|i| (i.t_s, i.seen, i.sample)).collect();
        let wanted = [
            (0.0, Some(0), Some(0)),
            (0.04, None, Some(1)),
            (0.1, Some(1), Some(2)),
            (0.2, Some(2), Some(3)),
        ];
        assert_eq!(all, wanted);
        assert!(instants(&[], &[]).is_empty());
    }
}
