use super::*;
use crate::{Correlation, least_squares};
use mavsight_random::Random;

/// Longley (1967), as in NIST's file: six regressors, beside a constant.
#[rustfmt::skip]
const LONGLEY: [[f64; 6]; 16] = [
    [83.0, 234289.0, 2356.0, 1590.0, 107608.0, 1947.0], [88.5, 259426.0, 2325.0, 1456.0, 108632.0, 1948.0],
    [88.2, 258054.0, 3682.0, 1616.0, 109773.0, 1949.0], [89.5, 284599.0, 3351.0, 1650.0, 110929.0, 1950.0],
    [96.2, 328975.0, 2099.0, 3099.0, 112075.0, 1951.0], [98.1, 346999.0, 1932.0, 3594.0, 113270.0, 1952.0],
    [99.0, 365385.0, 1870.0, 3547.0, 115094.0, 1953.0], [100.0, 363112.0, 3578.0, 3350.0, 116219.0, 1954.0],
    [101.2, 397469.0, 2904.0, 3048.0, 117388.0, 1955.0], [104.6, 419180.0, 2822.0, 2857.0, 118734.0, 1956.0],
    [108.4, 442769.0, 2936.0, 2798.0, 120445.0, 1957.0], [110.8, 444546.0, 4681.0, 2637.0, 121950.0, 1958.0],
    [112.6, 482704.0, 3813.0, 2552.0, 123366.0, 1959.0], [114.2, 502601.0, 3931.0, 2514.0, 125368.0, 1960.0],
    [115.7, 518173.0, 4806.0, 2572.0, 127852.0, 1961.0], [116.9, 554894.0, 4007.0, 2827.0, 130081.0, 1962.0],
];

fn longley() -> DMatrix<f64> {
    DMatrix::from_fn(16, 7, |i, j| if j == 0 { 1.0 } else { LONGLEY[i][j - 1] })
}

#[test]
fn longleys_collinearity_is_that_of_the_literature() {
    let found = collinearity(&longley()).expect("diagnostics");
    // Variance inflation and condition indices as the SAS/STAT guide prints them for PROC REG, options VIF
    // and COLLIN.
    for (got, printed) in found
        .variance_inflation
        .iter()
        .skip(1)
        .zip([135.53244, 1788.51348, 33.61889, 3.58893, 399.15102, 758.98060])
    {
        assert!((got / printed - 1.0).abs() < 1e-6, "{got} is not {printed}");
    }
    for (got, printed) in
        found.condition_indices.iter().zip([1.0, 9.14172, 12.25574, 25.33661, 230.42395, 1048.0803, 43275.0])
    {
        assert!((got / printed - 1.0).abs() < 1e-5, "{got} is not {printed}");
    }
    for column in found.variance_proportions.column_iter() {
        assert!((column.sum() - 1.0).abs() < 1e-12);
    }
    // The weakest direction holds the constant and the year, as everybody finds.
    let groups = found.entangled(30.0);
    assert!(groups.iter().any(|g| g.contains(&0) && g.contains(&6)), "{groups:?}");
}

#[test]
fn orthogonal_columns_are_not_inflated() {
    let columns = DMatrix::from_fn(8, 3, |i, j| if (i >> j) & 1 == 0 { 1.0 } else { -1.0 });
    let found = collinearity(&columns).expect("diagnostics");
    assert!((found.condition_indices.max() - 1.0).abs() < 1e-12);
    assert!(found.variance_inflation.iter().all(|v| (v - 1.0).abs() < 1e-12));
    assert!(found.entangled(30.0).is_empty());
    let none = collinearity(&DMatrix::zeros(8, 2));
    assert_eq!(none, Err(IdentifyError::RankZero));
}

#[test]
fn correlations_are_of_length_one_on_the_diagonal() {
    let covariance = DMatrix::from_row_slice(3, 3, &[4.0, -1.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    let got = correlations(&covariance);
    assert_eq!(got, DMatrix::from_row_slice(3, 3, &[1.0, -0.5, 0.0, -0.5, 1.0, 0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn autocorrelations_of_an_autoregression_fade_as_powers() {
    let (mut random, mut state) = (Random::new(2, 0), 0.0);
    let series: Vec<f64> = (0..40_000)
        .map(|_| {
            state = 0.7 * state + random.normal();
            state
        })
        .collect();
    for (lag, r) in autocorrelations(&series, 5).into_iter().enumerate() {
        let wanted = 0.7_f64.powi(lag as i32 + 1);
        assert!((r - wanted).abs() < 0.03, "lag {}: {r} is not {wanted}", lag + 1);
    }
    assert_eq!(autocorrelations(&[1.0, 1.0, 1.0], 5), [0.0, 0.0]);
    assert!(autocorrelations(&[], 5).is_empty());
}

#[test]
fn agreement_is_that_of_a_sum_by_hand() {
    // y = 1 2 3 4, z = 2 2 3 5: differences -1 0 0 -1.
    let got = agreement(&[1.0, 2.0, 3.0, 4.0], &[2.0, 2.0, 3.0, 5.0]);
    assert_eq!((got.count, got.max), (4, 1.0));
    assert!((got.rms - 0.5_f64.sqrt()).abs() < 1e-15);
    assert!((got.r2 - (1.0 - 2.0 / 5.0)).abs() < 1e-12);
    assert!((got.theil - 0.5_f64.sqrt() / (7.5_f64.sqrt() + 10.5_f64.sqrt())).abs() < 1e-15);
    let same = agreement(&[1.0, 2.0], &[1.0, 2.0]);
    assert_eq!((same.r2, same.theil), (1.0, 0.0));
    assert_eq!(agreement(&[], &[1.0]), Agreement::default());
}

#[test]
fn press_of_blocks_is_what_leaving_them_out_gives() {
    let (rows, mut random) = (23, Random::new(4, 0));
    let x = DMatrix::from_fn(rows, 3, |i, j| (0.2 * i as f64).powi(j as i32));
    let y = DVector::from_fn(rows, |i, _| 1.0 + (i as f64 * 0.4).sin() + random.normal());
    for block in [1, 4, 7] {
        let mut slow = 0.0;
        for start in (0..rows).step_by(block) {
            let size = block.min(rows - start);
            let (kept_x, kept_y) = (x.clone().remove_rows(start, size), y.clone().remove_rows(start, size));
            let fit = least_squares(&kept_x, &kept_y, Correlation::White).expect("a fit");
            slow += (y.rows(start, size) - x.rows(start, size) * fit.values).norm_squared();
        }
        let fast = press(&x, &y, block).expect("a sum");
        assert!((fast / slow - 1.0).abs() < 1e-9, "{block}: {fast} is not {slow}");
    }
    // A parameter that one block alone shows cannot be predicted there.
    let alone = DMatrix::from_fn(rows, 1, |i, _| if i == 2 { 1.0 } else { 0.0 });
    assert_eq!(press(&alone, &y, 4), Ok(f64::INFINITY));
}
