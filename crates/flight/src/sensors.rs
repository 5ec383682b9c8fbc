//! Recorded sensors over time.

use crate::FlightError;
use crate::inputs::nearest;
use mavsight_model::Model;

/// Samples of the sensors of a flight model ([`Model::sensors`]) at increasing times, by the clock of the
/// poses.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorSeries {
    columns: Vec<String>,
    times_ns: Vec<i64>,
    /// Row after row, one value a column; NaN where there is no sample.
    values: Vec<f64>,
}

impl SensorSeries {
    /// Takes rows with a value for each column, NaN where there is no sample.
    ///
    /// # Errors
    /// [`FlightError::DuplicateSensor`], [`FlightError::SensorTable`]; times that do not increase, rows count
    /// from 1.
    pub fn new(columns: Vec<String>, times_ns: Vec<i64>, values: Vec<f64>) -> Result<Self, FlightError> {
        if let Some((_, twice)) = columns.iter().enumerate().find(|(k, name)| columns[..*k].contains(name)) {
            return Err(FlightError::DuplicateSensor(twice.clone()));
        }
        let (rows, count) = (times_ns.len(), columns.len());
        if values.len() != rows * count {
            return Err(FlightError::SensorTable { rows, columns: count, values: values.len() });
        }
        if let Some(k) = times_ns.windows(2).position(|pair| pair[1] <= pair[0]) {
            let [before_s, t_s] = [times_ns[k], times_ns[k + 1]].map(|t| t as f64 * 1e-9);
            return Err(FlightError::SensorTime { row: k + 2, t_s, before_s });
        }
        Ok(Self { columns, times_ns, values })
    }

    /// Takes the samples of each column by themselves, times and values; a row is at every time of any of them.
    ///
    /// # Errors
    /// Those of [`SensorSeries::new`]; times of a column that do not increase.
    pub fn of_samples(columns: Vec<String>, samples: &[Vec<(i64, f64)>]) -> Result<Self, FlightError> {
        for own in samples {
            if let Some(k) = own.windows(2).position(|pair| pair[1].0 <= pair[0].0) {
                let [before_s, t_s] = [own[k], own[k + 1]].map(|(t_ns, _)| t_ns as f64 * 1e-9);
                return Err(FlightError::SensorTime { row: k + 2, t_s, before_s });
            }
        }
        let mut times_ns: Vec<i64> = samples.iter().flatten().map(|(t_ns, _)| *t_ns).collect();
        times_ns.sort_unstable();
        times_ns.dedup();
        let mut next = vec![0; samples.len()];
        let mut values = Vec::with_capacity(times_ns.len() * samples.len());
        for t_ns in &times_ns {
            for (own, next) in samples.iter().zip(&mut next) {
                let sample = own.get(*next).filter(|(own_ns, _)| own_ns == t_ns);
                *next += usize::from(sample.is_some());
                values.push(sample.map_or(f64::NAN, |(_, value)| *value));
            }
        }
        Self::new(columns, times_ns, values)
    }

    /// These samples at other times, such as those of another clock.
    ///
    /// # Errors
    /// Times that do not increase.
    pub fn at_times(&self, time_s: impl Fn(f64) -> f64) -> Result<Self, FlightError> {
        let moved = |t_ns: &i64| (time_s(*t_ns as f64 * 1e-9) * 1e9).round() as i64;
        Self::new(self.columns.clone(), self.times_ns.iter().map(moved).collect(), self.values.clone())
    }

    /// The columns of a model's sensors, in its order.
    ///
    /// # Errors
    /// [`FlightError::NoSensors`]; [`FlightError::MissingSensor`], with the nearest columns.
    pub fn of(&self, model: &Model) -> Result<Self, FlightError> {
        if model.sensors.is_empty() {
            return Err(FlightError::NoSensors(model.name.clone()));
        }
        let place = |name: &String| {
            self.columns.iter().position(|c| c == name).ok_or_else(|| FlightError::MissingSensor {
                name: name.clone(),
                nearest: nearest(name, &self.columns),
            })
        };
        let columns: Vec<String> = model.sensors.iter().map(|s| s.column.clone()).collect();
        let places = columns.iter().map(place).collect::<Result<Vec<usize>, _>>()?;
        let rows = 0..self.times_ns.len();
        let values = rows.flat_map(|k| places.iter().map(move |place| self.row(k)[*place])).collect();
        // Two sensors may show the same column.
        Ok(Self { columns, times_ns: self.times_ns.clone(), values })
    }

    /// The rows at the times that are wanted.
    #[must_use]
    pub fn within(&self, wanted: impl Fn(i64) -> bool) -> Self {
        let rows = (0..self.times_ns.len()).filter(|k| wanted(self.times_ns[*k]));
        let (times_ns, values): (Vec<i64>, Vec<&[f64]>) =
            rows.map(|k| (self.times_ns[k], self.row(k))).unzip();
        Self { columns: self.columns.clone(), times_ns, values: values.concat() }
    }

    /// Names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Times of the rows.
    pub fn times_ns(&self) -> &[i64] {
        &self.times_ns
    }

    /// The values of a row, in the order of the columns; NaN where there is no sample.
    pub fn row(&self, k: usize) -> &[f64] {
        &self.values[k * self.columns.len()..(k + 1) * self.columns.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: &str = "schema = 2\nname = \"falling\"\nforces = { z = \"0\" }\n\
        outputs = { acc = { column = \"acc_z_m_s2\", value = \"a_z\", std = 1 }, q = { value = \"q\", std = 1 } }\n";

    fn series(columns: &[&str], times_ns: &[i64]) -> Result<SensorSeries, FlightError> {
        let names = columns.iter().map(|c| (*c).to_owned()).collect();
        let values = (0..columns.len() * times_ns.len()).map(|k| k as f64).collect();
        SensorSeries::new(names, times_ns.to_vec(), values)
    }

    #[test]
    fn columns_come_in_the_order_of_the_model() {
        let model = Model::parse("falling.toml", MODEL).unwrap();
        let own = series(&["q", "other", "acc_z_m_s2"], &[1, 5]).unwrap().of(&model).unwrap();
        assert_eq!(
            (own.columns(), own.row(1)),
            (&["acc_z_m_s2".to_owned(), "q".to_owned()][..], &[5.0, 3.0][..])
        );
        assert_eq!(own.within(|t_ns| t_ns > 2).times_ns(), [5]);
    }

    #[test]
    fn samples_of_streams_of_their_own_share_rows_only_at_the_same_times() {
        let samples = [vec![(1, 10.0), (5, 11.0)], vec![(1, 20.0), (3, 21.0)]];
        let both = SensorSeries::of_samples(vec!["a".into(), "b".into()], &samples).unwrap();
        assert_eq!((both.times_ns(), both.row(0)), (&[1, 3, 5][..], &[10.0, 20.0][..]));
        assert!(both.row(1)[0].is_nan() && both.row(1)[1] == 21.0 && both.row(2)[1].is_nan());
        let later = both.at_times(|t_s| t_s + 1e-9).unwrap();
        assert_eq!((later.times_ns(), later.row(2)[0]), (&[2, 4, 6][..], 11.0));
        let unsorted = SensorSeries::of_samples(vec!["a".into()], &[vec![(3, 1.0), (3, 1.0)]]);
        assert!(matches!(unsorted, Err(FlightError::SensorTime { row: 2, .. })));
    }

    #[test]
    fn what_cannot_be_used_is_refused() {
        let model = Model::parse("falling.toml", MODEL).unwrap();
        let missing = series(&["q", "acc_z"], &[1, 5]).unwrap().of(&model).unwrap_err();
        assert!(missing.to_string().contains("acc_z_m_s2; the nearest are acc_z, q"), "{missing}");
        let unsorted = series(&["q"], &[2, 5, 5]).unwrap_err();
        assert!(matches!(unsorted, FlightError::SensorTime { row: 3, .. }), "{unsorted}");
        assert_eq!(series(&["q", "q"], &[1]), Err(FlightError::DuplicateSensor("q".to_owned())));
        let short = SensorSeries::new(vec!["q".to_owned()], vec![1, 2], vec![0.0]);
        assert_eq!(short, Err(FlightError::SensorTable { rows: 2, columns: 1, values: 1 }));
    }
}
