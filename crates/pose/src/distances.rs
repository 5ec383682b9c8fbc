//! Coordinates of points from distances that a tape measured between them.
//!
//! Least squares on distances, heights and plumb lines. What these leave open, shifts and turns, is fixed twice: the
//! covariance is that of least trace (a free network: Förstner & Wrobel 2016, section 4.5; Baarda 1968 for the test of
//! single measurements), and the axes are put through the first points, which moves coordinates and no distance.

mod axes;
mod refusal;
mod solve;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, Matrix3, Vector3};
pub use refusal::DistanceRefusal;
use statrs::function::gamma::checked_gamma_ur;

/// What a tape, or a string with a weight, says of points, which go by their numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeasuredBetween {
    /// The distance between two points.
    Distance(usize, usize),
    /// The height of a point above one level floor.
    Height(usize),
    /// The first point hangs above the second, on one plumb line: two horizontal coordinates of value 0.
    Plumb(usize, usize),
}

/// A measurement of a network of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetworkMeasurement {
    /// What was measured.
    pub between: MeasuredBetween,
    /// The value, m; 0 for a plumb line.
    pub value_m: f64,
    /// Its standard deviation, m.
    pub std_m: f64,
}

/// Points from distances.
#[derive(Debug, Clone, PartialEq)]
pub struct PointNetwork {
    /// Coordinates: z up, the first point at x = y = 0, the second towards +x, the first further point that is beside the
    /// line through these at y > 0. z is 0 at the floor where heights are given, and at the first point otherwise.
    /// Without heights and plumb lines the first three points that are not in one line are at z = 0, and the first point
    /// outside of their plane is above it.
    pub points_m: Vec<Vector3<f64>>,
    /// Covariance of all coordinates, point by point; that of least trace where shifts and turns are open.
    pub covariance_m2: DMatrix<f64>,
    /// Measured less computed, m; of a plumb line the larger of the two horizontal distances.
    pub residuals_m: Vec<f64>,
    /// Measurements less what they determine.
    pub redundancy: usize,
    /// Weighted square sum of residuals; chi-square of [`Self::redundancy`] where the stated deviations are true.
    pub chi_square: f64,
    /// The measurement that was left out, as dropping it and no other lets the rest agree.
    pub left_out: Option<usize>,
}

impl PointNetwork {
    /// Covariance of one point.
    pub fn point_cov_m2(&self, point: usize) -> Matrix3<f64> {
        self.covariance_m2.fixed_view::<3, 3>(3 * point, 3 * point).into()
    }

    /// Standard deviation of a coordinate of a point, root mean square over the three.
    pub fn std_m(&self, point: usize) -> f64 {
        (self.point_cov_m2(point).trace() / 3.0).max(0.0).sqrt()
    }
}

/// Chance at which sound measurements are taken to disagree: one network in a thousand.
const DISAGREES: f64 = 1e-3;
/// Chance from which on the rest, without one measurement, is taken to agree.
const AGREES: f64 = 0.05;

/// Probability that chi-square exceeds a value by chance.
fn beyond_chi_square(value: f64, freedom: usize) -> f64 {
    if freedom == 0 {
        return 1.0;
    }
    checked_gamma_ur(0.5 * freedom as f64, 0.5 * value).unwrap_or(0.0)
}

/// Coordinates of points from measurements between them; the points have the given names, for messages.
///
/// A measurement is left out where the rest agrees without it, and would not without any other. The network must be
/// rigid: eight points need 18 distances at least, and all 28 are better.
///
/// # Errors
/// [`DistanceRefusal::Bad`] for what is no measurement; [`DistanceRefusal::Loose`] where points can move;
/// [`DistanceRefusal::Flat`] where they are so nearly in one plane that distances do not hold them out of it;
/// [`DistanceRefusal::Contradictory`] where measurements contradict each other and no single one explains it.
pub fn points_from_distances(
    names: &[String],
    measured: &[NetworkMeasurement],
) -> Result<PointNetwork, DistanceRefusal> {
    for (k, m) in measured.iter().enumerate() {
        check(names, m, &measured[..k])?;
    }
    let whole = solve::solve(names, measured)?;
    if beyond_chi_square(whole.chi_square, whole.redundancy) > DISAGREES {
        return axes::put(whole, measured);
    }
    let mut without = Vec::new();
    for k in 0..measured.len() {
        let rest: Vec<NetworkMeasurement> =
            measured.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, m)| *m).collect();
        // Without a measurement that the rest needs to be rigid, there is no rest that could agree.
        let Ok(solved) = solve::solve(names, &rest) else { continue };
        let chance = beyond_chi_square(solved.chi_square, solved.redundancy);
        if chance > AGREES && solved.redundancy > 0 {
            without.push((k, rest, solved));
        }
    }
    if without.len() != 1 {
        let suspects: Vec<usize> = without.iter().map(|w| w.0).collect();
        return Err(disagreement(names, measured, &whole, &suspects));
    }
    let (k, rest, solved) = without.remove(0);
    let mut network = axes::put(solved, &rest)?;
    let wrong = &measured[k];
    network.residuals_m.insert(k, solve::residual_m(&network.points_m, wrong));
    network.left_out = Some(k);
    Ok(network)
}

fn check(
    names: &[String],
    measured: &NetworkMeasurement,
    before: &[NetworkMeasurement],
) -> Result<(), DistanceRefusal> {
    let bad = |detail: &str| {
        Err(DistanceRefusal::Bad {
            between: measurement_words(names, measured.between),
            detail: detail.to_owned(),
        })
    };
    let (is_two, value_ok) = match measured.between {
        MeasuredBetween::Distance(a, b) => (a != b, measured.value_m > 0.0),
        MeasuredBetween::Plumb(a, b) => (a != b, measured.value_m == 0.0),
        MeasuredBetween::Height(_) => (true, true),
    };
    let is_known = points_of(measured.between).iter().flatten().all(|p| *p < names.len());
    if !is_known || !is_two {
        return bad("it is not between two points that have names");
    }
    if !value_ok || !measured.value_m.is_finite() {
        return bad("its value is no length: give metres");
    }
    if !(measured.std_m > 0.0 && measured.std_m.is_finite()) {
        return bad("its standard deviation is not above zero: a tape is good to 0.001 or 0.002");
    }
    let is_again = before.iter().any(|b| b.between == measured.between);
    if is_again {
        return bad("it is there twice: give the mean of both, or keep one");
    }
    Ok(())
}

/// The points that a measurement is of.
fn points_of(between: MeasuredBetween) -> [Option<usize>; 2] {
    match between {
        MeasuredBetween::Distance(a, b) | MeasuredBetween::Plumb(a, b) => [Some(a), Some(b)],
        MeasuredBetween::Height(a) => [Some(a), None],
    }
}

/// A measurement in words, as messages name it.
pub fn measurement_words(names: &[String], between: MeasuredBetween) -> String {
    let name = |k: usize| names.get(k).map_or("?", String::as_str);
    match between {
        MeasuredBetween::Distance(a, b) => format!("{} to {}", name(a), name(b)),
        MeasuredBetween::Height(a) => format!("height of {}", name(a)),
        MeasuredBetween::Plumb(a, b) => format!("{} on the plumb line of {}", name(a), name(b)),
    }
}

fn disagreement(
    names: &[String],
    measured: &[NetworkMeasurement],
    solved: &solve::Solved,
    suspects: &[usize],
) -> DistanceRefusal {
    let mut order: Vec<usize> = (0..measured.len()).collect();
    let share = |k: usize| (solved.residuals_m[k] / measured[k].std_m).abs();
    order.sort_by(|a, b| share(*b).total_cmp(&share(*a)));
    let listed = if suspects.is_empty() { &order[..order.len().min(3)] } else { suspects };
    let list: Vec<String> = listed
        .iter()
        .take(6)
        .map(|k| {
            let between = measurement_words(names, measured[*k].between);
            format!("{between} ({:+.1} mm)", 1e3 * solved.residuals_m[*k])
        })
        .collect();
    let ratio = (solved.chi_square / solved.redundancy.max(1) as f64).sqrt();
    DistanceRefusal::Contradictory { ratio, worst: list.join(", "), is_one_of: !suspects.is_empty() }
}
