//! The inputs of the coaxial helicopter.

use crate::{FlightError, InputSeries};

/// The inputs of the coaxial helicopter at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HelicopterInput {
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

impl HelicopterInput {
    /// The columns of an [`InputSeries`] that it is read from.
    pub const COLUMNS: [&str; 4] = ["omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"];

    /// The values of [`HelicopterInput::COLUMNS`].
    pub fn row(&self) -> [f64; 4] {
        [self.omega_u_rad_s, self.omega_l_rad_s, self.delta_lon_rad, self.delta_lat_rad]
    }

    /// The inputs of every row; zero throughout where the series has none of the columns, which is of another
    /// aircraft.
    ///
    /// # Errors
    /// [`FlightError::MissingInput`] where it has some of the columns and not all.
    pub fn series(inputs: &InputSeries) -> Result<Vec<Self>, FlightError> {
        if !inputs.names().iter().any(|name| Self::COLUMNS.contains(&name.as_str())) {
            return Ok(inputs.times_s().iter().map(|&t_s| Self { t_s, ..Self::default() }).collect());
        }
        let own = inputs.select(&Self::COLUMNS)?;
        let of = |(k, &t_s): (usize, &f64)| {
            let row = own.row(k);
            Self {
                t_s,
                omega_u_rad_s: row[0],
                omega_l_rad_s: row[1],
                delta_lon_rad: row[2],
                delta_lat_rad: row[3],
            }
        };
        Ok(own.times_s().iter().enumerate().map(of).collect())
    }

    /// The series that holds some instants.
    ///
    /// # Errors
    /// Those of [`InputSeries::new`].
    pub fn recorded(instants: &[Self]) -> Result<InputSeries, FlightError> {
        InputSeries::new(
            Self::COLUMNS.map(str::to_owned),
            instants.iter().map(|s| s.t_s).collect(),
            instants.iter().flat_map(Self::row).collect(),
        )
    }

    /// What holds at a time, with that time, out of the [`HelicopterInput::series`] of some inputs.
    ///
    /// # Errors
    /// [`FlightError::InputsDoNotCover`].
    pub fn require(series: &[Self], inputs: &InputSeries, t_s: f64) -> Result<Self, FlightError> {
        inputs.require(t_s)?;
        let held = inputs.index_at(t_s).and_then(|k| series.get(k)).copied().unwrap_or_default();
        Ok(Self { t_s, ..held })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_another_aircraft_has_none() {
        let order = ["delta_lat_rad", "motor_1", "omega_l_rad_s", "omega_u_rad_s", "delta_lon_rad"];
        let names = order.map(str::to_owned);
        let values = (0..10).map(f64::from).collect();
        let inputs = InputSeries::new(names, vec![0.5, 1.5], values).expect("inputs");
        let series = HelicopterInput::series(&inputs).expect("all columns");
        assert_eq!((series[1].t_s, series[1].row()), (1.5, [8.0, 7.0, 9.0, 5.0]));
        let held = HelicopterInput::require(&series, &inputs, 1.0).expect("covered");
        assert_eq!((held.t_s, held.row()), (1.0, series[0].row()));
        assert!(HelicopterInput::require(&series, &inputs, 2.0).is_err());
        let again = HelicopterInput::recorded(&series).expect("inputs");
        assert_eq!(again, inputs.select(&HelicopterInput::COLUMNS).expect("all columns"));
        let other = HelicopterInput::series(&inputs.select(&["motor_1"]).expect("a column"));
        assert_eq!(other.expect("zeros")[1], HelicopterInput { t_s: 1.5, ..Default::default() });
        let some = HelicopterInput::series(&inputs.select(&["motor_1", "omega_u_rad_s"]).expect("columns"));
        assert!(matches!(some, Err(FlightError::MissingInput { name, .. }) if name == "omega_l_rad_s"));
    }
}
