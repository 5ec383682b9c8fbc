//! Clock, attitude, bias and scale of a log's gyroscope, from the turns between measured poses.

mod start;
#[cfg(test)]
mod tests;
mod turns;

use crate::gyroscope::{RateErrors, Turned};
use crate::{GyroscopeSeries, InertialError};
use mavsight_geometry::{Matrix3, UnitQuaternion, Vector3};
use mavsight_pose::{PoseSample, QUARTZ_DRIFT_STD};
use nalgebra::{SMatrix, SVector};
use start::Start;
use turns::{PoseTurn, pose_turns};

/// Unknowns: offset, drift, turn of the sensor, bias, scale.
pub(crate) const UNKNOWNS: usize = 11;
pub(crate) const TURN: usize = 2;
pub(crate) const BIAS: usize = 5;
pub(crate) const SCALE: usize = 8;

/// Offset of a consumer gyroscope that nobody calibrated: 1 degree a second and more with temperature (data sheets of BMI088
/// and MPU-6000), taken widely.
const BIAS_STD_RAD_S: f64 = 0.05;
/// Tolerance of its sensitivity: 1 % (BMI088) to 3 % (MPU-6000).
const SCALE_STD: f64 = 0.02;
/// A turn of the sensor about an axis about which the aircraft does not turn is unknown by as much as a right angle, about where
/// the turns correlate most.
const TURN_STD_RAD: f64 = std::f64::consts::FRAC_PI_2;

/// What noise adds to the information comes from its slowest parts, of which there are few: so many times its expectation is
/// not exceeded in 99 of 100 flights (simulated: test `about_the_only_axis_of_the_turns_the_attitude_is_unknown`).
const NOISE_BY_CHANCE: f64 = 2.0;

/// Fewer pairs of poses than this leave no room beside the unknowns.
pub(crate) const LEAST_TURNS: usize = 2 * UNKNOWNS;
/// About an axis about which the aircraft hardly turns, steps shorten slowly.
const MAX_STEPS: usize = 100;
/// A step this long, in standard deviations of all unknowns together, ends the fit.
const LAST_STEP: f64 = 0.01;

/// How a log lies beside poses.
///
/// The covariance is of offset (s), drift, a small turn of the sensor about the body's axes (rad), bias (rad/s) and scale about
/// the sensor's axes. It allows for errors of the poses that are new in each of them and for the gyroscope's own noise, and is
/// widened where residuals are larger than both explain.
#[derive(Debug, Clone, PartialEq)]
pub struct LogAlignment {
    /// Time by the poses' clock at which the offset holds: the middle of what both recorded.
    pub at_s: f64,
    /// Time by the log's clock less that by the poses', there.
    pub offset_s: f64,
    /// Seconds that the log's clock gains in a second of the poses'.
    pub drift: f64,
    /// Turns vectors from the sensor's axes to the body's.
    pub body_from_sensor: UnitQuaternion<f64>,
    /// What the sensor measures at rest.
    pub bias_rad_s: Vector3<f64>,
    /// By how much rates are larger than measured: true rates are (measured - bias) times 1 + scale.
    pub scale: Vector3<f64>,
    /// Of all these.
    pub covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// Weighted squares over redundancy, before the covariance was widened by it.
    pub reduced_chi_square: f64,
    /// Pairs of poses that were compared.
    pub turns: usize,
}

impl LogAlignment {
    /// Time by the log's clock at a time by the poses'.
    pub fn log_s(&self, pose_s: f64) -> f64 {
        pose_s + self.offset_s + self.drift * (pose_s - self.at_s)
    }

    /// Time by the poses' clock at a time by the log's.
    pub fn pose_s(&self, log_s: f64) -> f64 {
        self.at_s + (log_s - self.offset_s - self.at_s) / (1.0 + self.drift)
    }

    /// Standard deviation of the offset at a time by the poses' clock.
    pub fn offset_std_s(&self, pose_s: f64) -> f64 {
        let by = [1.0, pose_s - self.at_s];
        let c = &self.covariance;
        let variance: f64 = (0..2).map(|i| (0..2).map(|j| by[i] * c[(i, j)] * by[j]).sum::<f64>()).sum();
        variance.max(0.0).sqrt()
    }
}

/// Finds the clock of a log and the attitude of its gyroscope in the body, from the turns between measured poses that follow each
/// other within half a second.
///
/// The gyroscope is integrated between the times of two poses, its rates joined by lines; a turn that a hole of the log touches
/// is left out. What both say of the turn differs by
/// the errors of the poses, which two neighbouring turns share with the opposite sign, and by the noise of the gyroscope, which
/// is taken from its samples. Clock, drift, attitude, bias and scale follow by weighted least squares (Gauss-Newton; the
/// unknowns are those of Kelly & Sukhatme 2011 and Furgale, Rehder & Siegwart 2013, without a camera's). The start is found
/// among all places of the log that hold half or more of the minute in which the aircraft turns most, by the correlation of
/// turns (Wahba 1965 for the attitude).
///
/// About an axis about which the aircraft does not turn, the attitude remains unknown, and its standard deviation says so.
///
/// # Errors
/// [`InertialError::TooLong`]; [`InertialError::TooFewPoses`]; [`InertialError::TooQuiet`] where two places of the log fit alike,
/// [`InertialError::NoAgreement`] where none fits; [`InertialError::Degrees`];
/// [`InertialError::NotConverged`].
pub fn align_log(poses: &[PoseSample], gyroscope: &GyroscopeSeries) -> Result<LogAlignment, InertialError> {
    let turns = pose_turns(poses);
    if turns.len() < LEAST_TURNS {
        return Err(InertialError::TooFewPoses { found: turns.len(), least: LEAST_TURNS });
    }
    let Start { offset_s, body_from_sensor, .. } = start::find(&turns, gyroscope)?;
    let at_s = middle_s(&turns, gyroscope, offset_s);
    let problem = Problem {
        turns: &turns,
        gyroscope,
        at_s,
        noise_rad_s: gyroscope.noise_rad_s(),
        start: body_from_sensor,
    };
    let errors = RateErrors { bias_rad_s: Vector3::zeros(), scale: Vector3::zeros() };
    problem.fit(Point { offset_s, drift: 0.0, body_from_sensor, errors })
}

/// The middle of what both recorded, by the poses' clock.
fn middle_s(turns: &[PoseTurn], gyroscope: &GyroscopeSeries, offset_s: f64) -> f64 {
    let times = gyroscope.times_ns();
    let [first_s, last_s] = [times[0], times[times.len() - 1]].map(|t| t as f64 * 1e-9 - offset_s);
    let from_s = turns[0].from_s.max(first_s);
    let to_s = turns[turns.len() - 1].to_s.min(last_s);
    0.5 * (from_s + to_s)
}

/// Values of the unknowns.
#[derive(Debug, Clone, Copy)]
struct Point {
    offset_s: f64,
    drift: f64,
    body_from_sensor: UnitQuaternion<f64>,
    errors: RateErrors,
}

impl Point {
    fn moved(&self, step: &SVector<f64, UNKNOWNS>) -> Self {
        let part = |from: usize| Vector3::from(step.fixed_rows::<3>(from));
        Self {
            offset_s: self.offset_s + step[0],
            drift: self.drift + step[1],
            body_from_sensor: UnitQuaternion::from_scaled_axis(part(TURN)) * self.body_from_sensor,
            errors: RateErrors {
                bias_rad_s: self.errors.bias_rad_s + part(BIAS),
                scale: self.errors.scale + part(SCALE),
            },
        }
    }
}

struct Problem<'a> {
    turns: &'a [PoseTurn],
    gyroscope: &'a GyroscopeSeries,
    at_s: f64,
    noise_rad_s: f64,
    /// The attitude of the sensor by the correlation of turns.
    start: UnitQuaternion<f64>,
}

/// The turn that the gyroscope predicts less that between two poses, and its derivative.
struct Residual {
    value: Vector3<f64>,
    by: SMatrix<f64, 3, UNKNOWNS>,
}

/// Sums of the normal equations.
struct Normal {
    information: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    right: SVector<f64, UNKNOWNS>,
    squares: f64,
    turns: usize,
    /// What noise of the gyroscope adds to the information on the turn of the sensor: it turns, by the measured rates, where the
    /// aircraft does not.
    of_noise: Matrix3<f64>,
}

impl Normal {
    /// The covariance of the unknowns, without what is no information: the turn of the sensor is known as well as without it, but
    /// not worse than before the flight, and the others are as their regression on it says.
    fn covariance(&self) -> Option<SMatrix<f64, UNKNOWNS, UNKNOWNS>> {
        let all = self.information.cholesky()?.inverse();
        let own = all.fixed_view::<3, 3>(TURN, TURN).into_owned();
        let known = own.cholesky()?.inverse();
        let mut left = (known - self.of_noise * NOISE_BY_CHANCE).symmetric_eigen();
        left.eigenvalues.apply(|value| *value = value.max(TURN_STD_RAD.powi(-2)));
        let wider = left.recompose().cholesky()?.inverse() - own;
        let regression = all.fixed_columns::<3>(TURN) * known;
        Some(all + regression * wider * regression.transpose())
    }
}

impl Problem<'_> {
    fn fit(&self, start: Point) -> Result<LogAlignment, InertialError> {
        let mut point = start;
        let mut step_s = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let normal = self.normal(&point);
            if normal.turns < LEAST_TURNS {
                return Err(InertialError::TooFewPoses { found: normal.turns, least: LEAST_TURNS });
            }
            let Some(factor) = normal.information.cholesky() else { break };
            let step = factor.solve(&normal.right);
            point = point.moved(&step);
            step_s = step[0];
            let known = normal.covariance().and_then(|covariance| covariance.cholesky());
            if known.is_some_and(|known| step.dot(&known.solve(&step)) < LAST_STEP * LAST_STEP) {
                return self
                    .aligned(&point)
                    .ok_or(InertialError::NotConverged { steps: MAX_STEPS, step_ms: 1e3 * step_s.abs() });
            }
        }
        Err(InertialError::NotConverged { steps: MAX_STEPS, step_ms: 1e3 * step_s.abs() })
    }

    /// None where the equations have no solution there.
    fn aligned(&self, point: &Point) -> Option<LogAlignment> {
        let normal = self.normal(point);
        let redundancy = (3 * normal.turns - UNKNOWNS) as f64;
        let reduced_chi_square = normal.squares / redundancy;
        let covariance = normal.covariance()?;
        Some(LogAlignment {
            at_s: self.at_s,
            offset_s: point.offset_s,
            drift: point.drift,
            body_from_sensor: point.body_from_sensor,
            bias_rad_s: point.errors.bias_rad_s,
            scale: point.errors.scale,
            covariance: covariance * reduced_chi_square.max(1.0),
            reduced_chi_square,
            turns: normal.turns,
        })
    }

    /// The normal equations of whitened residuals, with what is known before the flight.
    ///
    /// The covariance of the residuals is tridiagonal in blocks: its Cholesky factor is built turn by turn.
    fn normal(&self, point: &Point) -> Normal {
        let turned = Turned::new(self.gyroscope, point.errors);
        let mut normal = self.known(point);
        let mut before: Option<Whitened> = None;
        for (k, turn) in self.turns.iter().enumerate() {
            let Some(residual) = self.residual(turn, point, &turned) else {
                before = None;
                continue;
            };
            let density = self.noise_rad_s.powi(2) * self.gyroscope.interval_s();
            let noise_rad2 = density * (turn.to_s - turn.from_s);
            let own = turn.covariance() + Matrix3::identity() * noise_rad2;
            let follows = k > 0 && self.turns[k - 1].to_s == turn.from_s;
            let row = match before.filter(|_| follows) {
                Some(before) => {
                    Whitened::after(&before, &residual, &own, &turn.shared_with_before(), noise_rad2)
                }
                None => Whitened::first(&residual, &own, noise_rad2),
            };
            let Some(row) = row else {
                before = None;
                continue;
            };
            normal.information += row.by.transpose() * row.by;
            normal.right -= row.by.transpose() * row.value;
            normal.squares += row.value.norm_squared();
            normal.turns += 1;
            normal.of_noise += row.of_noise;
            before = Some(row);
        }
        normal
    }

    /// What is known before the flight.
    fn known(&self, point: &Point) -> Normal {
        let errors = &point.errors;
        let (bias, scale) = (errors.bias_rad_s, errors.scale);
        let turn = (point.body_from_sensor * self.start.inverse()).scaled_axis();
        let weight = |std: f64| std.powi(-2);
        let mut weights = SVector::<f64, UNKNOWNS>::zeros();
        let mut away = SVector::<f64, UNKNOWNS>::zeros();
        (weights[1], away[1]) = (weight(QUARTZ_DRIFT_STD), point.drift);
        for k in 0..3 {
            (weights[TURN + k], away[TURN + k]) = (weight(TURN_STD_RAD), turn[k]);
            (weights[BIAS + k], away[BIAS + k]) = (weight(BIAS_STD_RAD_S), bias[k]);
            (weights[SCALE + k], away[SCALE + k]) = (weight(SCALE_STD), scale[k]);
        }
        Normal {
            information: SMatrix::from_diagonal(&weights),
            right: -weights.component_mul(&away),
            squares: 0.0,
            turns: 0,
            of_noise: Matrix3::zeros(),
        }
    }

    /// None outside of the log and where a hole of it touches the turn.
    fn residual(&self, turn: &PoseTurn, point: &Point, turned: &Turned<'_>) -> Option<Residual> {
        let log_s = |t_s: f64| t_s + point.offset_s + point.drift * (t_s - self.at_s);
        let [from, to] = turned.between(log_s(turn.from_s), log_s(turn.to_s))?;
        let of_sensor = from.attitude.inverse() * to.attitude;
        let c = point.body_from_sensor;
        let predicted = c * of_sensor * c.inverse();
        let value = (turn.turned.inverse() * predicted).scaled_axis();
        let back = predicted.inverse();
        let c = c.to_rotation_matrix().into_inner();
        let back = back.to_rotation_matrix().into_inner();
        let mut by = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        let (body_from, body_to) = (c * from.rate_rad_s, c * to.rate_rad_s);
        by.set_column(0, &(body_to - back * body_from));
        by.set_column(1, &(body_to * (turn.to_s - self.at_s) - back * body_from * (turn.from_s - self.at_s)));
        by.fixed_view_mut::<3, 3>(0, TURN).copy_from(&(back - Matrix3::identity()));
        // Over the few degrees of a turn the mean of both ends stands for all attitudes between them.
        let span_s = turn.to_s - turn.from_s;
        let mean = (back * c + c) * 0.5;
        let gains = point.errors.scale.add_scalar(1.0);
        by.fixed_view_mut::<3, 3>(0, BIAS).copy_from(&(mean * Matrix3::from_diagonal(&gains) * -span_s));
        let per_scale = of_sensor.scaled_axis().component_div(&gains);
        by.fixed_view_mut::<3, 3>(0, SCALE).copy_from(&(mean * Matrix3::from_diagonal(&per_scale)));
        Some(Residual { value, by })
    }
}

/// A residual less what the ones before say of it, in units of its standard deviation.
struct Whitened {
    value: Vector3<f64>,
    by: SMatrix<f64, 3, UNKNOWNS>,
    /// Lower triangular.
    root: Matrix3<f64>,
    /// Expected information of its row on the turn of the sensor where the aircraft does not turn. Of rows before, which are whitened
    /// together, the mean over the axes stands for each.
    of_noise: Matrix3<f64>,
}

impl Whitened {
    /// `noise_rad2`: variance of the gyroscope's turn about each axis.
    fn first(residual: &Residual, own: &Matrix3<f64>, noise_rad2: f64) -> Option<Self> {
        Self::of(residual.value, residual.by, own, noise_rad2)
    }

    /// `shared`: covariance of the turn before with this one.
    fn after(
        before: &Self,
        residual: &Residual,
        own: &Matrix3<f64>,
        shared: &Matrix3<f64>,
        noise_rad2: f64,
    ) -> Option<Self> {
        let gain = before.root.solve_lower_triangular(shared)?.transpose();
        let value = residual.value - gain * before.value;
        let by = residual.by - gain * before.by;
        let mut out = Self::of(value, by, &(own - gain * gain.transpose()), noise_rad2)?;
        let passed_on = out.root.solve_lower_triangular(&gain)?.norm_squared() / 3.0;
        out.of_noise += before.of_noise * passed_on;
        Some(out)
    }

    fn of(
        value: Vector3<f64>,
        by: SMatrix<f64, 3, UNKNOWNS>,
        covariance: &Matrix3<f64>,
        noise_rad2: f64,
    ) -> Option<Self> {
        let factor = covariance.cholesky()?;
        let (root, weight) = (factor.l(), factor.inverse());
        // The derivative by the turn of the sensor is the cross product with the measured turn: of noise n about all axes alike,
        // the expectation of [n]' W [n] is its variance times tr(W) - W.
        Some(Self {
            value: root.solve_lower_triangular(&value)?,
            by: root.solve_lower_triangular(&by)?,
            root,
            of_noise: (Matrix3::identity() * weight.trace() - weight) * noise_rad2,
        })
    }
}
