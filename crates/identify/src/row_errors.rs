//! Total least squares where each row has an error covariance of its own.

use crate::IdentifyError;
use crate::inverse::inverse_of_scaled;
use crate::least_squares::{check, weighted_least_squares};
use crate::robust_covariance::Correlation;
use crate::total_least_squares::{TotalLeastSquares, total_least_squares};
use nalgebra::{DMatrix, DVector};

/// Steps at most; each gains some digits in proportion to how small errors are.
const MAX_STEPS: usize = 100;
/// Change of the sum, relative, below which a step is one of a millionth of a standard deviation or less.
const NEGLIGIBLE: f64 = 1e-15;
/// Halvings of a step that makes the sum of squares grow.
const MAX_HALVINGS: usize = 30;

/// Fits `output` by `regressors` of which row i, with its output last, carries an error of covariance
/// `errors[i]` times a factor common to all rows: the maximum of the likelihood with the true regressors as
/// unknowns.
///
/// Minimises Σ v_i²/σ_i² with v_i = y_i - a_i x and σ_i² the variance of v_i, which is orthogonal distance
/// regression of a linear model (Boggs, Byrd & Schnabel 1987) and element-wise weighted total least squares
/// (Markovsky & Van Huffel 2006). Gauss-Newton steps, which regress v_i on the corrected regressors
/// a_i - s_i v_i/σ_i² with s_i = Σ_ay - Σ_aa x, begin at [`crate::total_least_squares`] with the mean
/// covariance. Covariance by the scores, as there; `level` is Σ v_i²/σ_i² over the degrees of freedom, and
/// the only `singular_values` the root of the sum. `inverse_moment` is of rows divided by their σ_i.
///
/// Zero rows of every covariance mark exact columns. Valid where errors are small beside what the corrected
/// regressors vary by.
///
/// # Errors
/// Columns that [`crate::least_squares`] refuses; [`IdentifyError::BadErrors`] for a covariance of the wrong
/// size, not finite, with negative variances, or one that leaves a residual without error;
/// [`IdentifyError::NotConverged`].
pub fn total_least_squares_by_row(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    errors: &[DMatrix<f64>],
    correlation: Correlation,
) -> Result<TotalLeastSquares, IdentifyError> {
    if errors.len() != regressors.nrows() {
        return Err(IdentifyError::BadErrors { what: ONE_A_ROW, columns: regressors.ncols() });
    }
    by_row(regressors, output, &|i| errors[i].clone(), correlation)
}

/// Total least squares with the error covariance of each row, where the covariances are formed on demand.
pub(crate) fn by_row(
    regressors: &DMatrix<f64>,
    output: &DVector<f64>,
    errors: ErrorsOf<'_>,
    correlation: Correlation,
) -> Result<TotalLeastSquares, IdentifyError> {
    check(regressors, output)?;
    let problem = RowTotalLeastSquares { regressors, output, errors };
    problem.check()?;
    let mut x = problem.start()?;
    let mut state = problem.at(&x)?;
    for _ in 0..MAX_STEPS {
        let mut step = state.step()?;
        // The change of Σ v²/σ² that the step promises.
        let promise = step.dot(&state.score()).abs();
        let mut next = problem.at(&(&x + &step))?;
        let mut halvings = 0;
        while next.sum() > state.sum() * (1.0 + 1e-14) && halvings < MAX_HALVINGS {
            step *= 0.5;
            halvings += 1;
            next = problem.at(&(&x + &step))?;
        }
        if halvings < MAX_HALVINGS {
            x += step;
            state = next;
        }
        if promise <= NEGLIGIBLE * state.sum() || halvings == MAX_HALVINGS {
            return problem.finish(x, &state, correlation);
        }
    }
    Err(IdentifyError::NotConverged { what: "total least squares by rows", steps: MAX_STEPS })
}

const ONE_A_ROW: &str = "must be one matrix a row, with one row a column and one for the output";

/// The covariance of a row's errors.
type ErrorsOf<'a> = &'a dyn Fn(usize) -> DMatrix<f64>;

struct RowTotalLeastSquares<'a> {
    regressors: &'a DMatrix<f64>,
    output: &'a DVector<f64>,
    errors: ErrorsOf<'a>,
}

/// The problem at one x.
struct State {
    /// v/σ.
    residuals: DVector<f64>,
    /// Corrected regressors over σ.
    corrected: DMatrix<f64>,
    /// σ.
    std: DVector<f64>,
}

impl State {
    /// Σ v²/σ².
    fn sum(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Half the negative gradient.
    fn score(&self) -> DVector<f64> {
        self.corrected.tr_mul(&self.residuals)
    }

    fn step(&self) -> Result<DVector<f64>, IdentifyError> {
        let qr = self.corrected.clone().qr();
        let step = qr.r().solve_upper_triangular(&qr.q().tr_mul(&self.residuals));
        step.filter(|s| s.iter().all(|v| v.is_finite())).ok_or(IdentifyError::RankZero)
    }
}

impl RowTotalLeastSquares<'_> {
    /// The covariances of all rows, one at a time.
    fn each_errors(&self) -> impl Iterator<Item = DMatrix<f64>> {
        (0..self.output.len()).map(|i| (self.errors)(i))
    }

    fn bad(&self, what: &'static str) -> IdentifyError {
        IdentifyError::BadErrors { what, columns: self.regressors.ncols() }
    }

    fn check(&self) -> Result<(), IdentifyError> {
        let count = self.regressors.ncols();
        for e in self.each_errors() {
            if e.shape() != (count + 1, count + 1) {
                return Err(self.bad(ONE_A_ROW));
            }
            if !e.iter().all(|v| v.is_finite()) || e.diagonal().iter().any(|v| *v < 0.0) {
                return Err(self.bad("must be finite with variances that are not negative"));
            }
            if e[(count, count)] == 0.0 {
                return Err(self.bad("must leave the output an error: total least squares needs one"));
            }
        }
        Ok(())
    }

    fn at(&self, x: &DVector<f64>) -> Result<State, IdentifyError> {
        let (rows, count) = self.regressors.shape();
        let mut residuals = self.output - self.regressors * x;
        let mut corrected = self.regressors.clone();
        let mut std = DVector::zeros(rows);
        // Of v = y - a x.
        let weights = x.map(|v| -v).push(1.0);
        for (i, errors) in self.each_errors().enumerate() {
            let shared = errors * &weights;
            let variance = shared.dot(&weights);
            if variance.is_nan() || variance <= 0.0 {
                return Err(self.bad("must be positive definite: a residual has no error"));
            }
            std[i] = variance.sqrt();
            let correction = shared.rows(0, count).transpose() * (residuals[i] / variance);
            corrected.set_row(i, &((corrected.row(i) - correction) / std[i]));
            residuals[i] /= std[i];
        }
        Ok(State { residuals, corrected, std })
    }

    /// Total least squares with the mean covariance, or weighted least squares where that has no answer.
    fn start(&self) -> Result<DVector<f64>, IdentifyError> {
        let (rows, count) = self.regressors.shape();
        let zero = DMatrix::zeros(count + 1, count + 1);
        let mean = self.each_errors().fold(zero, |sum, errors| sum + errors / rows as f64);
        if let Ok(fit) = total_least_squares(self.regressors, self.output, &mean, Correlation::White) {
            return Ok(fit.values);
        }
        let output_std: Vec<f64> = self.each_errors().map(|e| e[(count, count)].sqrt()).collect();
        Ok(weighted_least_squares(self.regressors, self.output, &output_std, Correlation::White)?.values)
    }

    fn finish(
        &self,
        values: DVector<f64>,
        state: &State,
        correlation: Correlation,
    ) -> Result<TotalLeastSquares, IdentifyError> {
        let (rows, count) = self.regressors.shape();
        let level = state.sum() / (rows - count) as f64;
        // M = Σ (a aᵀ - Σ_aa)/σ², the part of the scores' derivative that does not vanish in the mean.
        let scaled = DMatrix::from_fn(rows, count, |i, j| self.regressors[(i, j)] / state.std[i]);
        let mut m = scaled.tr_mul(&scaled);
        for (errors, std) in self.each_errors().zip(&state.std) {
            m -= errors.view((0, 0), (count, count)) * (level / (std * std));
        }
        let inverse = inverse_of_scaled(&m, &scaled)?;
        let scores = DMatrix::from_fn(rows, count, |i, j| state.corrected[(i, j)] * state.residuals[i]);
        Ok(TotalLeastSquares {
            covariance: &inverse * correlation.sum(&scores) * &inverse,
            inverse_moment: inverse,
            residuals: self.output - self.regressors * &values,
            values,
            level,
            singular_values: DVector::from_element(1, state.sum().sqrt()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::independent_errors;
    use crate::testing::linear_problem_of_scipy;
    use mavsight_random::Random;

    /// Covariances that differ from row to row, x1 and x2 correlated; as given to scipy.
    fn errors_of_rows() -> Vec<DMatrix<f64>> {
        (0..12)
            .map(|k| {
                let k = f64::from(k);
                let (a, b, c) = (0.1 + 0.02 * k, 0.3 - 0.015 * k, 0.5 * k.sin());
                let mut e = independent_errors(&[0.0, a, b], 0.2 + 0.02 * k);
                (e[(1, 2)], e[(2, 1)]) = (c * a * b, c * a * b);
                e
            })
            .collect()
    }

    #[test]
    fn rows_with_covariances_of_their_own_are_those_of_odrpack() {
        // scipy 1.17.1: as in the test of equal rows, with RealData([x1, x2], y, covx=cov, sy=0.2 + 0.02 i),
        // cov[:, :, i] the 2 x 2 block above. ODRPACK stops when the sum of squares stands, which leaves nine
        // digits of beta.
        let (x, y) = linear_problem_of_scipy();
        let fit = total_least_squares_by_row(&x, &y, &errors_of_rows(), Correlation::White).expect("a fit");
        for (got, printed) in fit.values.iter().zip([1.557_869_605, 0.744_022_965, -1.202_751_159]) {
            assert!((got - printed).abs() < 1e-9, "{got} is not {printed}");
        }
        assert!((fit.level * 9.0 - 4.90808646584).abs() < 5e-11, "{}", fit.level * 9.0);
        assert!((fit.level - 0.545342940649).abs() < 1e-11);
    }

    #[test]
    fn equal_rows_are_total_least_squares() {
        let (x, y) = linear_problem_of_scipy();
        let errors = errors_of_rows().swap_remove(3);
        let how = Correlation::Rows(2);
        let one = total_least_squares(&x, &y, &errors, how).expect("a fit");
        let many = total_least_squares_by_row(&x, &y, &vec![errors; 12], how).expect("a fit");
        assert!((&one.values - &many.values).norm() < 1e-10);
        assert!((&one.covariance - &many.covariance).norm() < 1e-9 * one.covariance.norm());
        assert!((one.level - many.level).abs() < 1e-10);
    }

    #[test]
    fn the_score_is_half_the_negative_gradient() {
        let (x, y) = linear_problem_of_scipy();
        let errors = errors_of_rows();
        let of_row = |i: usize| errors[i].clone();
        let problem = RowTotalLeastSquares { regressors: &x, output: &y, errors: &of_row };
        let at = DVector::from_vec(vec![1.0, 0.5, -0.7]);
        let score = problem.at(&at).expect("a state").score();
        for j in 0..3 {
            let moved = |h: f64| {
                let mut x = at.clone();
                x[j] += h;
                problem.at(&x).expect("a state").sum()
            };
            let numeric = -(moved(1e-5) - moved(-1e-5)) / 4e-5;
            assert!((numeric - score[j]).abs() < 1e-6 * score.norm(), "{numeric} is not {}", score[j]);
        }
    }

    #[test]
    fn knows_its_spread_where_the_quality_of_rows_changes() {
        let (runs, rows, truth) = (400, 300, [0.5, 2.0]);
        let mut random = Random::new(3, 0);
        let std: Vec<f64> = (0..rows).map(|i| if i % 3 == 0 { 0.6 } else { 0.15 }).collect();
        let errors: Vec<DMatrix<f64>> = std.iter().map(|s| independent_errors(&[0.0, *s], *s)).collect();
        let (mut squares, mut predicted, mut unweighted) = (0.0, 0.0, 0.0);
        for _ in 0..runs {
            let clean = |i: usize| (0.07 * i as f64).sin();
            let x = DMatrix::from_fn(
                rows,
                2,
                |i, j| {
                    if j == 0 { 1.0 } else { clean(i) + std[i] * random.normal() }
                },
            );
            let y = DVector::from_fn(rows, |i, _| truth[0] + truth[1] * clean(i) + std[i] * random.normal());
            let fit = total_least_squares_by_row(&x, &y, &errors, Correlation::White).expect("a fit");
            squares += (fit.values[1] - truth[1]).powi(2);
            predicted += fit.covariance[(1, 1)];
            let plain =
                total_least_squares(&x, &y, &independent_errors(&[0.0, 1.0], 1.0), Correlation::White);
            unweighted += (plain.expect("a fit").values[1] - truth[1]).powi(2);
        }
        let ratio = (predicted / squares).sqrt();
        assert!((0.88..1.12).contains(&ratio), "predicted over achieved standard deviation {ratio}");
        assert!(squares < 0.6 * unweighted, "weights should pay: {squares} against {unweighted}");
    }

    #[test]
    fn covariances_that_are_none_are_refused() {
        let (x, y) = linear_problem_of_scipy();
        let refused = |errors: Vec<DMatrix<f64>>| {
            let fit = total_least_squares_by_row(&x, &y, &errors, Correlation::White);
            assert!(matches!(fit, Err(IdentifyError::BadErrors { columns: 3, .. })), "{fit:?}");
        };
        refused(errors_of_rows()[1..].to_vec());
        let mut errors = errors_of_rows();
        errors[4][(1, 1)] = f64::NAN;
        refused(errors);
        let mut errors = errors_of_rows();
        errors[4][(3, 3)] = 0.0;
        refused(errors);
    }
}
