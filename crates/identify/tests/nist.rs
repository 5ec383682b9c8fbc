//! NIST's linear reference sets against answers in exact arithmetic.

use mavsight_identify::{Correlation, least_squares};
use nalgebra::{DMatrix, DVector};
use std::path::{Path, PathBuf};

fn folder() -> Option<PathBuf> {
    let data = std::env::var_os("MAVSIGHT_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let folder = data.join("reference/nist");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: {} is missing", folder.display());
    None
}

fn rows(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).expect("a table");
    let lines = text.trim_start_matches('\u{feff}').lines().skip(1);
    lines.map(|l| l.split(',').map(str::to_owned).collect()).collect()
}

fn numbers(path: &Path) -> Vec<Vec<f64>> {
    let number = |c: &String| c.trim().parse().expect("a number");
    rows(path).iter().map(|r| r.iter().map(number).collect()).collect()
}

/// Regressors and output as the set's model has them.
fn problem(folder: &Path, set: &str) -> (DMatrix<f64>, DVector<f64>) {
    let table = numbers(&folder.join(format!("{set}.csv")));
    let y = DVector::from_iterator(table.len(), table.iter().map(|r| r[0]));
    let power =
        |degree: i32| DMatrix::from_fn(table.len(), degree as usize + 1, |i, j| table[i][1].powi(j as i32));
    let x = match set {
        "filip" => power(10),
        "pontius" => power(2),
        "norris" => power(1),
        "noint1" | "noint2" => DMatrix::from_fn(table.len(), 1, |i, _| table[i][1]),
        "longley" => DMatrix::from_fn(table.len(), 7, |i, j| if j == 0 { 1.0 } else { table[i][j] }),
        _ => power(5),
    };
    (x, y)
}

/// Agreeing decimal digits; of a zero, those below the given size.
fn digits(got: f64, exact: f64, size: f64) -> f64 {
    let error = (got - exact).abs() / if exact == 0.0 { size } else { exact.abs() };
    (-error.log10()).clamp(0.0, 16.0)
}

#[test]
fn every_set_agrees_to_eight_digits_and_filip_to_six() {
    let Some(folder) = folder() else { return };
    let exact = rows(&folder.join("exact.csv"));
    let mut sets: Vec<&str> = exact.iter().map(|r| r[0].as_str()).collect();
    sets.dedup();
    assert_eq!(sets.len(), 11);
    let mut short = Vec::new();
    for set in sets {
        let (x, y) = problem(&folder, set);
        let fit = least_squares(&x, &y, Correlation::White).expect("a fit");
        let (mut values, mut errors) = (16.0_f64, 16.0_f64);
        for (j, row) in exact.iter().filter(|r| r[0] == set).enumerate() {
            let [value, error] = [2, 3].map(|c| row[c].parse::<f64>().expect("a number"));
            values = values.min(digits(fit.values[j], value, 1.0));
            errors = errors.min(digits(fit.white_covariance[(j, j)].sqrt(), error, 1.0));
        }
        println!("{set:10} estimates {values:5.2} standard errors {errors:5.2} digits");
        let needed = if set == "filip" { 6.0 } else { 8.0 };
        if values.min(errors) < needed {
            short.push(set);
        }
    }
    assert!(short.is_empty(), "{short:?} agree to fewer digits than they should");
}
