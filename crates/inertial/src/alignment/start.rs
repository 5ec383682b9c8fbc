//! Where in a log the turns between poses lie, roughly.

use super::LEAST_TURNS;
use super::turns::PoseTurn;
use crate::gyroscope::{RateErrors, Turned};
use crate::{GyroscopeSeries, InertialError};
use mavsight_geometry::{Matrix3, UnitQuaternion, Vector3};

/// A place of the log.
pub(super) struct Start {
    pub(super) offset_s: f64,
    pub(super) body_from_sensor: UnitQuaternion<f64>,
    correlation: f64,
}

/// Mean rates are compared over at least this, so that errors of single poses weigh little; an aircraft's turns take longer.
const WINDOW_S: f64 = 0.1;
/// Places are tried this far apart: a quarter of that.
const STEP_S: f64 = 0.025;
/// So many mean rates are compared at most, a minute of them: the minute in which the aircraft turns most.
const MOST_RATES: usize = 600;
/// The longest log that is searched: half a day has two million places.
const LONGEST_LOG_S: f64 = 43_200.0;
/// Places nearer than this are one.
const APART_S: f64 = 0.5;
/// Standard deviations by which the best place must be the better one: chance does so once in 700 flights.
const DISTINCT: f64 = 3.0;

/// A mean rate about body axes.
struct MeanRate {
    from_s: f64,
    to_s: f64,
    rate_rad_s: Vector3<f64>,
}

struct Correlated {
    offset_s: f64,
    /// Of body and sensor, over all axes and for the best attitude; 1 where they agree.
    correlation: f64,
    compared: usize,
    body_from_sensor: UnitQuaternion<f64>,
}

/// The place of the largest correlation.
///
/// # Errors
/// [`InertialError::TooLong`], [`InertialError::TooFewPoses`], [`InertialError::TooQuiet`], [`InertialError::NoAgreement`];
/// [`InertialError::Degrees`] where rates in other units have a place and these have none.
pub(super) fn find(turns: &[PoseTurn], gyroscope: &GyroscopeSeries) -> Result<Start, InertialError> {
    let why = match find_place(turns, gyroscope) {
        Err(why @ (InertialError::TooQuiet { .. } | InertialError::NoAgreement { .. })) => why,
        found => return found,
    };
    let in_rad_s = gyroscope.rates_rad_s().iter().map(|rate| rate.map(f64::to_radians)).collect();
    let other = GyroscopeSeries::new(gyroscope.times_ns().to_vec(), in_rad_s)?;
    match find_place(turns, &other) {
        Ok(Start { correlation, .. }) => Err(InertialError::Degrees { correlation }),
        Err(_) => Err(why),
    }
}

fn find_place(turns: &[PoseTurn], gyroscope: &GyroscopeSeries) -> Result<Start, InertialError> {
    let times = gyroscope.times_ns();
    let span_s = times[0].abs_diff(times[times.len() - 1]) as f64 * 1e-9;
    if span_s > LONGEST_LOG_S {
        return Err(InertialError::TooLong { span_s, most_s: LONGEST_LOG_S });
    }
    let all = mean_rates(turns);
    let rates = most_turning(&all);
    let sensor = SensorRates::new(gyroscope, rates);
    let (from_s, to_s) = rates.first().zip(rates.last()).map_or((0.0, 0.0), |(a, b)| (a.from_s, b.to_s));
    let (log_from_s, log_to_s) = sensor.span_s();
    let half_s = 0.5 * (to_s - from_s).min(log_to_s - log_from_s);
    let first_s = log_from_s - to_s + half_s;
    let places = ((log_to_s - from_s - half_s - first_s) / STEP_S).max(0.0) as usize;
    let tried = (0..=places).filter_map(|k| correlated(rates, &sensor, first_s + k as f64 * STEP_S));
    let mut tried: Vec<Correlated> = tried.collect();
    tried.sort_by(|a, b| b.correlation.total_cmp(&a.correlation));
    let Some(best) = tried.first() else {
        return Err(InertialError::TooFewPoses { found: 0, least: LEAST_TURNS });
    };
    let other = tried.iter().find(|t| (t.offset_s - best.offset_s).abs() > APART_S);
    // Fisher (1921): the inverse hyperbolic tangent of a correlation is normal, with variance 1/(n - 3).
    let z = |c: &Correlated| {
        c.correlation.clamp(-1.0, 1.0 - 1e-12).atanh() * (3.0 * c.compared as f64 - 3.0).sqrt()
    };
    if z(best) - other.map_or(0.0, z) < DISTINCT * std::f64::consts::SQRT_2 {
        let Some(other) = other else {
            return Err(InertialError::NoAgreement { correlation: best.correlation });
        };
        let squares: f64 = rates.iter().map(|r| r.rate_rad_s.norm_squared()).sum();
        return Err(InertialError::TooQuiet {
            turn_rms_rad_s: (squares / rates.len() as f64).sqrt(),
            first_s: best.offset_s,
            second_s: other.offset_s,
            first: best.correlation,
            second: other.correlation,
        });
    }
    let Correlated { offset_s, correlation, body_from_sensor, .. } = *best;
    Ok(Start { offset_s, body_from_sensor, correlation })
}

fn mean_rates(turns: &[PoseTurn]) -> Vec<MeanRate> {
    let mut out: Vec<MeanRate> = Vec::new();
    let mut open: Option<(f64, f64, UnitQuaternion<f64>)> = None;
    for turn in turns {
        let (from_s, turned) = match open.filter(|o| o.1 == turn.from_s) {
            Some((from_s, _, turned)) => (from_s, turned * turn.turned),
            None => (turn.from_s, turn.turned),
        };
        let span_s = turn.to_s - from_s;
        open = (span_s < WINDOW_S).then_some((from_s, turn.to_s, turned));
        if open.is_none() {
            out.push(MeanRate { from_s, to_s: turn.to_s, rate_rad_s: turned.scaled_axis() / span_s });
        }
    }
    out
}

/// The stretch of so many rates that has the largest sum of squares.
fn most_turning(rates: &[MeanRate]) -> &[MeanRate] {
    let squares = |part: &[MeanRate]| part.iter().map(|r| r.rate_rad_s.norm_squared()).sum::<f64>();
    let starts = (0..rates.len().saturating_sub(MOST_RATES)).step_by(MOST_RATES / 4);
    let stretch = |from: usize| &rates[from..(from + MOST_RATES).min(rates.len())];
    let best = starts.map(stretch).max_by(|a, b| squares(a).total_cmp(&squares(b)));
    best.unwrap_or(stretch(0))
}

/// Mean rates of the sensor over windows as long as those of the poses, which begin [`STEP_S`] apart; none where a hole of the
/// log is in the window.
struct SensorRates {
    first_s: f64,
    rates_rad_s: Vec<Option<Vector3<f64>>>,
    window_s: f64,
}

impl SensorRates {
    fn new(gyroscope: &GyroscopeSeries, like: &[MeanRate]) -> Self {
        let turned =
            Turned::new(gyroscope, RateErrors { bias_rad_s: Vector3::zeros(), scale: Vector3::zeros() });
        let window_s = like.iter().map(|r| r.to_s - r.from_s).sum::<f64>() / like.len().max(1) as f64;
        // Not at the first sample itself, where rounding of the time decides whether it is within the log.
        let times_ns = gyroscope.times_ns();
        let first_s = times_ns[0] as f64 * 1e-9 + STEP_S;
        let last_s = times_ns[times_ns.len() - 1] as f64 * 1e-9;
        let mean_rate = |k: usize| {
            let from_s = first_s + k as f64 * STEP_S;
            let [from, to] = turned.between(from_s, from_s + window_s)?;
            Some((from.attitude.inverse() * to.attitude).scaled_axis() / window_s)
        };
        let windows = ((last_s - window_s - first_s) / STEP_S).ceil().max(0.0) as usize;
        Self { first_s, rates_rad_s: (0..windows).map(mean_rate).collect(), window_s }
    }

    fn span_s(&self) -> (f64, f64) {
        (self.first_s, self.first_s + self.rates_rad_s.len() as f64 * STEP_S + self.window_s)
    }

    /// The rate of the window that begins nearest to a time.
    fn at(&self, t_s: f64) -> Option<Vector3<f64>> {
        let place = ((t_s - self.first_s) / STEP_S).round();
        if place < 0.0 { None } else { self.rates_rad_s.get(place as usize).copied().flatten() }
    }
}

/// The correlation at a place; none where fewer than half of the rates lie within the log.
fn correlated(rates: &[MeanRate], sensor: &SensorRates, offset_s: f64) -> Option<Correlated> {
    let pair = |r: &MeanRate| Some((r.rate_rad_s, sensor.at(r.from_s + offset_s)?));
    let pairs: Vec<(Vector3<f64>, Vector3<f64>)> = rates.iter().filter_map(pair).collect();
    let n = pairs.len() as f64;
    if 2 * pairs.len() < rates.len() || pairs.len() < LEAST_TURNS / 2 {
        return None;
    }
    let sum = pairs.iter().fold((Vector3::zeros(), Vector3::zeros()), |sum, p| (sum.0 + p.0, sum.1 + p.1));
    let (body_mean, sensor_mean) = (sum.0 / n, sum.1 / n);
    let (mut cross, mut squares) = (Matrix3::zeros(), [0.0; 2]);
    for (b, s) in &pairs {
        let (b, s) = (b - body_mean, s - sensor_mean);
        cross += b * s.transpose();
        squares[0] += b.norm_squared();
        squares[1] += s.norm_squared();
    }
    // The rotation of the largest trace (Wahba 1965; Kabsch 1976).
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    let smallest = svd.singular_values.imin();
    let mut signs = Vector3::repeat(1.0);
    signs[smallest] = sign;
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
    let correlation =
        svd.singular_values.dot(&signs) / (squares[0] * squares[1]).sqrt().max(f64::MIN_POSITIVE);
    let body_from_sensor = UnitQuaternion::from_matrix(&rotation);
    Some(Correlated { offset_s, correlation, compared: pairs.len(), body_from_sensor })
}
