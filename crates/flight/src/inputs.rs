//! Recorded inputs over time.

use crate::FlightError;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Inputs at increasing times, a value for each named column; each row holds until the next, as a command
/// does.
///
/// A quantity that moves smoothly between rows is so taken late by half their interval: record at 100 Hz or
/// more.
#[derive(Debug, Clone, PartialEq)]
pub struct InputSeries {
    names: Arc<[String]>,
    times_s: Vec<f64>,
    /// Row after row.
    values: Vec<f64>,
}

/// How an input goes from one sample to the next.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// It holds, as a command does.
    #[default]
    Hold,
    /// It moves on a line, as what is measured does.
    Linear,
}

/// Rows that take the place of a line are at most so far apart: of a motion of 10 Hz, faster than small
/// aircraft follow their inputs, they pass the amplitude but for (pi f h)²/6, one in a thousand.
const LINE_STEP_S: f64 = 2.5e-3;

/// Rows that take the place of one line at most: over a gap, a line is a guess however it is divided.
const MOST_LINE_STEPS: f64 = 16.0;

/// By how much a time may lie outside the record: what is lost where times are written in microseconds.
const ROUNDING_S: f64 = 1e-6;

/// How many columns an error offers in place of one that is not there.
const OFFERED: usize = 3;

/// The names that are most like one that there is not.
pub(crate) fn nearest(name: &str, known: &[String]) -> Vec<String> {
    let mut near: Vec<&String> = known.iter().collect();
    near.sort_by_cached_key(|known| strsim::osa_distance(known, name));
    near.into_iter().take(OFFERED).cloned().collect()
}

impl InputSeries {
    /// Checks and takes the rows; `values` has them one after the other, each with a value for every name.
    ///
    /// # Errors
    /// Fewer than two rows, a name that is there twice, another number of values, a number that is not
    /// finite, a time that does not increase; rows count from 1.
    pub fn new(
        names: impl Into<Arc<[String]>>,
        times_s: Vec<f64>,
        values: Vec<f64>,
    ) -> Result<Self, FlightError> {
        let names = names.into();
        if let Some((_, twice)) = names.iter().enumerate().find(|(k, name)| names[..*k].contains(name)) {
            return Err(FlightError::DuplicateInput(twice.clone()));
        }
        let (rows, columns) = (times_s.len(), names.len());
        if rows < 2 {
            return Err(FlightError::TooFewInputs(rows));
        }
        if values.len() != rows * columns {
            return Err(FlightError::InputTable { rows, columns, values: values.len() });
        }
        let series = Self { names, times_s, values };
        let mut before_s = f64::NEG_INFINITY;
        for (k, &t_s) in series.times_s.iter().enumerate() {
            let bad = series.row(k).iter().position(|value| !value.is_finite());
            let column = if t_s.is_finite() { bad.map(|c| series.names[c].as_str()) } else { Some("t_s") };
            if let Some(column) = column {
                return Err(FlightError::InputNotFinite { row: k + 1, column: column.to_owned() });
            }
            if t_s <= before_s {
                return Err(FlightError::TimeNotIncreasing { row: k + 1, t_s, before_s });
            }
            before_s = t_s;
        }
        Ok(series)
    }

    /// The same of samples between which some columns move on lines: a line becomes rows that hold its mean
    /// over their interval, so that everything that reads rows has its integral and no delay. Where all
    /// columns hold, the rows are the samples.
    ///
    /// `interpolation` has one for each name, and what it lacks holds.
    ///
    /// # Errors
    /// Those of [`InputSeries::new`] of the samples.
    pub fn interpolated(
        names: impl Into<Arc<[String]>>,
        times_s: Vec<f64>,
        values: Vec<f64>,
        interpolation: &[Interpolation],
    ) -> Result<Self, FlightError> {
        let samples = Self::new(names, times_s, values)?;
        let is_line = |column: usize| interpolation.get(column) == Some(&Interpolation::Linear);
        if !(0..samples.names.len()).any(is_line) {
            return Ok(samples);
        }
        let (mut times_s, mut values) = (Vec::new(), Vec::new());
        for (k, pair_s) in samples.times_s.windows(2).enumerate() {
            let (from, to) = (samples.row(k), samples.row(k + 1));
            let interval_s = pair_s[1] - pair_s[0];
            let steps = (interval_s / LINE_STEP_S - 1e-6).ceil().clamp(1.0, MOST_LINE_STEPS);
            for step in 0..steps as usize {
                let begin_s = pair_s[0] + interval_s * step as f64 / steps;
                // Steps that are shorter than times resolve are one.
                if times_s.last().is_some_and(|before_s| *before_s >= begin_s) {
                    continue;
                }
                times_s.push(begin_s);
                let middle = (step as f64 + 0.5) / steps;
                let value =
                    |(c, (a, b)): (usize, (&f64, &f64))| if is_line(c) { a + (b - a) * middle } else { *a };
                values.extend(from.iter().zip(to).enumerate().map(value));
            }
        }
        times_s.push(samples.end_s());
        values.extend_from_slice(samples.row(samples.times_s.len() - 1));
        Self::new(samples.names, times_s, values)
    }

    /// These rows at other times, such as those of another clock.
    ///
    /// # Errors
    /// A time that is not finite or does not increase.
    pub fn at_times(&self, time_s: impl Fn(f64) -> f64) -> Result<Self, FlightError> {
        let times_s = self.times_s.iter().map(|t_s| time_s(*t_s)).collect();
        Self::new(self.names.clone(), times_s, self.values.clone())
    }

    /// Names of the columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Times of the rows, at least two.
    pub fn times_s(&self) -> &[f64] {
        &self.times_s
    }

    /// The values of a row, in the order of the names; rows count from 0, as many as there are times.
    pub fn row(&self, k: usize) -> &[f64] {
        let columns = self.names.len();
        &self.values[k * columns..(k + 1) * columns]
    }

    /// The values of a column, one a row; `None` for a name that there is not.
    pub fn column(&self, name: &str) -> Option<Vec<f64>> {
        let place = self.place(name)?;
        Some((0..self.times_s.len()).map(|k| self.row(k)[place]).collect())
    }

    /// The series of some columns, in the order asked for.
    ///
    /// # Errors
    /// [`FlightError::MissingInput`], [`FlightError::DuplicateInput`].
    pub fn select(&self, names: &[&str]) -> Result<Self, FlightError> {
        let place = |name: &&str| self.place(name).ok_or_else(|| self.missing(name));
        let places = names.iter().map(place).collect::<Result<Vec<usize>, _>>()?;
        let rows = 0..self.times_s.len();
        let values = rows.flat_map(|k| places.iter().map(move |place| self.row(k)[*place])).collect();
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        Self::new(names, self.times_s.clone(), values)
    }

    /// This series with one more column, the last, `t_s`: the time before or since the middle of the record, s.
    ///
    /// # Errors
    /// [`FlightError::DuplicateInput`] where there is a column of that name, which tables have for their times.
    pub fn with_time(&self) -> Result<Self, FlightError> {
        let middle_s = 0.5 * (self.start_s() + self.end_s());
        let row = |(k, t_s): (usize, &f64)| self.row(k).iter().copied().chain([t_s - middle_s]);
        let values = self.times_s.iter().enumerate().flat_map(row).collect();
        let names: Vec<String> = self.names.iter().cloned().chain(["t_s".to_owned()]).collect();
        Self::new(names, self.times_s.clone(), values)
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    fn missing(&self, name: &str) -> FlightError {
        FlightError::MissingInput { name: name.to_owned(), nearest: nearest(name, &self.names) }
    }

    /// Time of the first row.
    pub fn start_s(&self) -> f64 {
        self.times_s[0]
    }

    /// Time of the last row.
    pub fn end_s(&self) -> f64 {
        self.times_s[self.times_s.len() - 1]
    }

    /// The row that holds at a time; `None` outside the record by more than a microsecond.
    pub fn index_at(&self, t_s: f64) -> Option<usize> {
        let covered = t_s >= self.start_s() - ROUNDING_S && t_s <= self.end_s() + ROUNDING_S;
        let after = || self.times_s.partition_point(|row_s| *row_s <= t_s + ROUNDING_S).max(1);
        covered.then(|| after() - 1)
    }

    /// The values that hold at a time; `None` as of [`InputSeries::index_at`].
    pub fn at(&self, t_s: f64) -> Option<&[f64]> {
        self.index_at(t_s).map(|k| self.row(k))
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
    pub fn require(&self, t_s: f64) -> Result<&[f64], FlightError> {
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

    fn names(all: &[&str]) -> Vec<String> {
        all.iter().map(|name| (*name).to_owned()).collect()
    }

    fn series(all: &[&str], times_s: &[f64], values: &[f64]) -> Result<InputSeries, FlightError> {
        InputSeries::new(names(all), times_s.to_vec(), values.to_vec())
    }

    #[test]
    fn a_row_holds_until_the_next() {
        let series = series(&["flap"], &[0.0, 1.0, 3.0], &[0.0, 2.0, 4.0]).expect("valid");
        for (t_s, held) in [(0.25, 0.0), (1.0, 2.0), (1.0 - 0.5e-6, 2.0), (2.9, 2.0), (3.0, 4.0)] {
            assert_eq!(series.at(t_s), Some(&[held][..]), "{t_s}");
            assert_eq!(series.index_at(t_s), Some((held / 2.0) as usize), "{t_s}");
        }
        assert_eq!((series.at(3.1), series.index_at(-0.1), series.at(f64::NAN)), (None, None, None));
        let times_ns: Vec<i64> = (-2..10).map(|k| k * 500_000_000).collect();
        assert_eq!(series.covered(&times_ns, |t| *t), &times_ns[2..9]);
        assert!(
            series.covered(&times_ns[..2], |t| *t).is_empty()
                && series.covered(&times_ns[9..], |t| *t).is_empty()
        );
        assert!(matches!(series.require(-1.0), Err(FlightError::InputsDoNotCover { .. })));
    }

    #[test]
    fn lines_keep_their_integral_and_what_holds_holds() {
        let (times_s, values) = ([0.0, 0.01, 0.012], [1.0, 5.0, 3.0, 6.0, 7.0, 7.0]);
        let both = [Interpolation::Linear, Interpolation::Hold];
        let series =
            InputSeries::interpolated(names(&["speed", "flap"]), times_s.to_vec(), values.to_vec(), &both);
        let series = series.expect("valid");
        assert_eq!(series.times_s(), [0.0, 0.0025, 0.005, 0.0075, 0.01, 0.012]);
        assert_eq!(series.column("speed").expect("it"), [1.25, 1.75, 2.25, 2.75, 5.0, 7.0]);
        assert_eq!(series.column("flap").expect("it"), [5.0, 5.0, 5.0, 5.0, 6.0, 7.0]);
        let steps = series.times_s().windows(2).zip(series.column("speed").expect("it"));
        let integral: f64 = steps.map(|(pair_s, value)| (pair_s[1] - pair_s[0]) * value).sum();
        assert!((integral - (0.01 * 2.0 + 0.002 * 5.0)).abs() < 1e-15);
        let held =
            InputSeries::interpolated(names(&["speed"]), vec![0.0, 1e9], vec![1.0, 2.0], &[]).expect("valid");
        assert_eq!(held.times_s(), [0.0, 1e9]);
        let far = InputSeries::interpolated(names(&["speed"]), vec![0.0, 1e9], vec![1.0, 2.0], &both)
            .expect("valid");
        assert_eq!(far.times_s().len(), 17);
    }

    #[test]
    fn columns_are_had_by_name_in_any_order() {
        let all = ["omega_1_rad_s", "omega_2_rad_s", "aileron_rad"];
        let series = series(&all, &[0.0, 1.0], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).expect("valid");
        assert_eq!((series.names(), series.row(1)), (&names(&all)[..], &[4.0, 5.0, 6.0][..]));
        assert_eq!(series.column("omega_2_rad_s"), Some(vec![2.0, 5.0]));
        assert_eq!(series.column("omega_2"), None);
        let two = series.select(&["aileron_rad", "omega_1_rad_s"]).expect("both are there");
        assert_eq!((two.row(0), two.row(1)), (&[3.0, 1.0][..], &[6.0, 4.0][..]));
        assert_eq!((two.times_s(), two.end_s()), (series.times_s(), 1.0));
        let none = series.select(&[]).expect("no column is a series too");
        assert_eq!((none.row(1), none.at(0.5)), (&[][..], Some(&[][..])));
        let missing = series.select(&["omega_3_rad_s", "aileron_rad"]).expect_err("an error");
        let nearest = names(&all);
        assert_eq!(missing, FlightError::MissingInput { name: "omega_3_rad_s".into(), nearest });
        let refused = series.select(&["ailerom_rad"]).expect_err("an error").to_string();
        assert!(refused.contains("no column ailerom_rad; the nearest are aileron_rad, "), "{refused}");
        let refused = none.select(&["aileron_rad"]).expect_err("an error").to_string();
        assert!(refused.ends_with("no column aileron_rad; there are none: add it"));
    }

    #[test]
    fn bad_rows_and_columns_are_named() {
        let two = ["throttle", "rudder"];
        let not_finite = |row, column: &str| Err(FlightError::InputNotFinite { row, column: column.into() });
        let nan = series(&two, &[0.0, 1.0], &[0.0, 0.0, 0.0, f64::NAN]);
        assert_eq!(nan, not_finite(2, "rudder"));
        let nan = series(&two, &[f64::INFINITY, 1.0], &[f64::NAN, 0.0, 0.0, 0.0]);
        assert_eq!(nan, not_finite(1, "t_s"));
        let back = series(&two, &[0.0, 0.0], &[0.0; 4]);
        assert_eq!(back, Err(FlightError::TimeNotIncreasing { row: 2, t_s: 0.0, before_s: 0.0 }));
        assert_eq!(series(&two, &[], &[]), Err(FlightError::TooFewInputs(0)));
        assert_eq!(
            series(&two, &[0.0, 1.0], &[0.0; 3]),
            Err(FlightError::InputTable { rows: 2, columns: 2, values: 3 })
        );
        let twice = series(&["throttle", "throttle"], &[0.0, 1.0], &[0.0; 4]);
        assert_eq!(twice, Err(FlightError::DuplicateInput("throttle".into())));
    }
}
