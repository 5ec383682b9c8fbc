use super::*;
use crate::testing::linear_problem_of_scipy;
use mavsight_random::Random;
use proptest::prelude::*;

/// Covariance of errors that are independent from column to column: those of the regressors, then of the
/// output.
fn independent_errors(column_std: &[f64], output_std: f64) -> DMatrix<f64> {
    let all = column_std.iter().chain([&output_std]).map(|s| s * s);
    DMatrix::from_diagonal(&DVector::from_iterator(column_std.len() + 1, all))
}

/// SLICOT, example of MB02MD and of MB02ND: M = 6, N = 3, L = 1, total least squares in all columns.
#[rustfmt::skip]
fn slicots_example() -> DMatrix<f64> {
    DMatrix::from_row_slice(6, 4, &[
        0.80010, 0.39985, 0.60005, 0.89999,
        0.29996, 0.69990, 0.39997, 0.82997,
        0.49994, 0.60003, 0.20012, 0.79011,
        0.90013, 0.20016, 0.79995, 0.85002,
        0.39998, 0.80006, 0.49985, 0.99016,
        0.20002, 0.90007, 0.70009, 1.02994,
    ])
}

#[test]
fn slicots_examples_give_their_printed_answers() {
    let c = slicots_example();
    let errors = DMatrix::identity(4, 4);
    let (a, b) = (c.columns(0, 3).into_owned(), c.column(3).into_owned());
    let fit = total_least_squares(&a, &b, &errors, Correlation::White).expect("a fit");
    for (got, printed) in fit.values.iter().zip([0.5003, 0.8003, 0.2995]) {
        assert!((got - printed).abs() < 5e-5, "{got} is not {printed}");
    }
    // MB02MD prints the singular values of C.
    for (got, printed) in fit.singular_values.iter().zip([3.2281, 0.8716, 0.3697, 0.0001]) {
        assert!((got - printed).abs() < 5e-5, "{got} is not {printed}");
    }
    // MB02ND prints the right singular vector in the fourth column of its C.
    let vector = DVector::from_vec(vec![fit.values[0], fit.values[1], fit.values[2], -1.0]).normalize();
    for (got, printed) in vector.iter().zip([-0.3555, -0.5687, -0.2128, 0.7106]) {
        assert!((got + printed).abs() < 5e-5, "{got} is not {}", -printed);
    }
}

#[test]
fn a_line_with_an_exact_intercept_is_that_of_odrpack() {
    // scipy 1.17.1: odr.ODR(RealData([x1, x2], y, sx=[0.2, 0.1], sy=0.3), Model(b0 + b1 x1 + b2 x2, analytic
    // fjacb and fjacd), sstol=1e-16, partol=1e-16), set_job(deriv=3), run() from its own answer until that
    // stands: beta, sum_square and res_var. Its intercept is a parameter, that is an exact column of ones.
    let (x, y) = linear_problem_of_scipy();
    let errors = independent_errors(&[0.0, 0.2, 0.1], 0.3);
    let fit = total_least_squares(&x, &y, &errors, Correlation::White).expect("a fit");
    for (got, printed) in fit.values.iter().zip([1.55090910541, 0.759901235135, -1.18702257613]) {
        assert!((got - printed).abs() < 1e-10, "{got} is not {printed}");
    }
    let sum_square = fit.singular_values[2].powi(2);
    assert!((sum_square - 7.37363692267).abs() < 5e-11, "{sum_square}");
    assert!((fit.level - 0.819292991408).abs() < 5e-12, "{}", fit.level);
}

#[test]
fn errors_that_are_no_covariance_are_refused() {
    let (x, y) = linear_problem_of_scipy();
    let refused = |errors: &DMatrix<f64>| {
        let fit = total_least_squares(&x, &y, errors, Correlation::White);
        assert!(matches!(fit, Err(IdentifyError::BadErrors { columns: 3, .. })), "{fit:?}");
    };
    refused(&DMatrix::identity(3, 3));
    refused(&independent_errors(&[0.0, 0.2, f64::NAN], 0.3));
    refused(&independent_errors(&[0.0, 0.2, 0.1], 0.0));
    let mut errors = independent_errors(&[0.0, 0.2, 0.1], 0.3);
    errors[(1, 2)] = 0.01;
    refused(&errors);
    errors[(2, 1)] = 0.01;
    assert!(total_least_squares(&x, &y, &errors, Correlation::White).is_ok());
    (errors[(1, 2)], errors[(2, 1)]) = (0.1, 0.1);
    refused(&errors);
}

#[test]
fn an_output_outside_the_regressors_reach_has_no_solution() {
    // The smallest singular vector lies in the regressors: x1 and x2 are the same up to less than the
    // output's spread.
    let x = DMatrix::from_fn(40, 2, |i, j| (i as f64).sin() + 1e-9 * (j as f64) * ((i % 2) as f64 - 0.5));
    let y = DVector::from_fn(40, |i, _| (i as f64 * 2.3).cos());
    let fit = total_least_squares(&x, &y, &DMatrix::identity(3, 3), Correlation::White);
    assert!(matches!(fit, Err(IdentifyError::NonGeneric { .. } | IdentifyError::RankZero)), "{fit:?}");
}

#[test]
fn is_consistent_where_least_squares_is_biased() {
    let (mut random, rows, runs) = (Random::new(1, 0), 400, 100);
    let (mut total, mut plain) = (0.0, 0.0);
    let errors = independent_errors(&[0.0, 0.3], 0.3);
    for _ in 0..runs {
        let clean: Vec<f64> = (0..rows).map(|i| (0.05 * f64::from(i)).sin()).collect();
        let x =
            DMatrix::from_fn(
                rows as usize,
                2,
                |i, j| {
                    if j == 0 { 1.0 } else { clean[i] + 0.3 * random.normal() }
                },
            );
        let y = DVector::from_fn(rows as usize, |i, _| 0.5 + 2.0 * clean[i] + 0.3 * random.normal());
        total += total_least_squares(&x, &y, &errors, Correlation::White).expect("a fit").values[1];
        plain += crate::least_squares(&x, &y, Correlation::White).expect("a fit").values[1];
    }
    let n = f64::from(runs);
    assert!((total / n - 2.0).abs() < 0.02, "mean {}", total / n);
    assert!((plain / n - 2.0).abs() > 0.2, "least squares should be biased: {}", plain / n);
}

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
    let problem = Problem { regressors: &x, output: &y, errors: &of_row };
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
        let x =
            DMatrix::from_fn(rows, 2, |i, j| if j == 0 { 1.0 } else { clean(i) + std[i] * random.normal() });
        let y = DVector::from_fn(rows, |i, _| truth[0] + truth[1] * clean(i) + std[i] * random.normal());
        let fit = total_least_squares_by_row(&x, &y, &errors, Correlation::White).expect("a fit");
        squares += (fit.values[1] - truth[1]).powi(2);
        predicted += fit.covariance[(1, 1)];
        let plain = total_least_squares(&x, &y, &independent_errors(&[0.0, 1.0], 1.0), Correlation::White);
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

proptest! {
    #[test]
    fn exact_columns_alone_are_least_squares(seed: u64) {
        let mut random = Random::new(seed, 0);
        let x = DMatrix::from_fn(30, 3, |_, j| if j == 0 { 1.0 } else { random.normal() });
        let y = DVector::from_fn(30, |_, _| random.normal());
        let how = Correlation::Rows(2);
        let plain = crate::least_squares(&x, &y, how).expect("a fit");
        let total = total_least_squares(&x, &y, &independent_errors(&[0.0; 3], 1.0), how).expect("a fit");
        prop_assert!((&plain.values - &total.values).norm() < 1e-12);
        // Errors that shrink to nothing lead there too, covariance included.
        let errors = independent_errors(&[0.0, 1e-7, 1e-7], 1.0);
        let near = total_least_squares(&x, &y, &errors, how).expect("a fit");
        prop_assert!((near.values - total.values).norm() < 1e-6);
        prop_assert!((near.covariance - plain.covariance).norm() < 1e-6);
    }

    #[test]
    fn units_do_not_matter(seed: u64, unit in 1e-4..1e4) {
        let mut random = Random::new(seed, 0);
        let x = DMatrix::from_fn(40, 3, |i, j| if j == 0 { 1.0 } else { (i as f64 * j as f64 * 0.3).sin() + 0.1 * random.normal() });
        let y = DVector::from_fn(40, |i, _| x[(i, 1)] - 2.0 * x[(i, 2)] + 0.1 * random.normal());
        let errors = independent_errors(&[0.0, 0.1, 0.1], 0.1);
        let fit = total_least_squares(&x, &y, &errors, Correlation::White).expect("a fit");
        let mut scaled = x.clone();
        scaled.column_mut(1).scale_mut(unit);
        let errors = independent_errors(&[0.0, 0.1 * unit, 0.1], 0.1);
        let other = total_least_squares(&scaled, &y, &errors, Correlation::White).expect("a fit");
        prop_assert!((other.values[1] * unit - fit.values[1]).abs() < 1e-9 * fit.values.norm());
        prop_assert!((other.covariance[(1, 1)] * unit * unit / fit.covariance[(1, 1)] - 1.0).abs() < 1e-6);
    }
}
