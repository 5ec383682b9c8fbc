//! A log's rates in the axes of the body, for the smoother.

use crate::alignment::{BIAS, SCALE, TURN, UNKNOWNS};
use crate::{GyroscopeSeries, LogAlignment};
use mavsight_geometry::{Matrix3, Vector3};
use mavsight_pose::{PoseError, RateError, RateSeries, RatesRefusal};

impl LogAlignment {
    /// The rates of the log in body axes, by the clock of the poses, with what is uncertain of the alignment: one [`RateError`]
    /// for each column of the root of its covariance.
    ///
    /// # Errors
    /// [`mavsight_pose::RatesRefusal::Bad`] where the log's rate is so high that times fall together;
    /// [`mavsight_pose::RatesRefusal::BadAlignment`] for a covariance that is not positive definite.
    pub fn body_rates(&self, gyroscope: &GyroscopeSeries) -> Result<RateSeries, PoseError> {
        let body_from_sensor = self.body_from_sensor.to_rotation_matrix().into_inner();
        let gains = self.scale.add_scalar(1.0);
        // A second of the poses' clock has 1 + drift of the log's.
        let in_body = |measured: &Vector3<f64>| {
            body_from_sensor * (measured - self.bias_rad_s).component_mul(&gains) * (1.0 + self.drift)
        };
        let times_ns =
            gyroscope.times_ns().iter().map(|t| (1e9 * self.pose_s(*t as f64 * 1e-9)).round() as i64);
        let rates = gyroscope.rates_rad_s().iter().map(in_body).collect();
        let root = self.covariance.cholesky().ok_or(RatesRefusal::BadAlignment)?.l();
        let error = |c: usize| {
            let column = root.column(c);
            let three = |from: usize| Vector3::new(column[from], column[from + 1], column[from + 2]);
            let scaled = Matrix3::from_diagonal(&three(SCALE).component_div(&gains));
            RateError {
                bias_rad_s: -(body_from_sensor * three(BIAS).component_mul(&gains)),
                gain: three(TURN).cross_matrix() + body_from_sensor * scaled * body_from_sensor.transpose(),
                early_s: column[0] - column[1] * self.at_s,
                drift: column[1],
            }
        };
        RateSeries::new(times_ns.collect(), rates, (0..UNKNOWNS).map(error).collect())
    }
}
