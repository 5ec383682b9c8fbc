//! Sums of products of scores that are correlated over some rows.

use nalgebra::DMatrix;

/// Σ_l w_l Σ_i ψ_i ψ_{i+l}ᵀ with Bartlett weights w_l = 1 - |l|/(lag + 1), of rows ψ_i (Newey & West 1987), with the
/// factor n/(n - p) for the fitted parameters. Positive semidefinite.
pub(crate) fn sandwich(scores: &DMatrix<f64>, lag: usize) -> DMatrix<f64> {
    let (rows, count) = scores.shape();
    let mut sum = scores.transpose() * scores;
    for l in 1..=lag.min(rows.saturating_sub(1)) {
        let weight = 1.0 - l as f64 / (lag + 1) as f64;
        let product = scores.rows(0, rows - l).transpose() * scores.rows(l, rows - l);
        sum += (&product + product.transpose()) * weight;
    }
    sum * (rows as f64 / (rows - count).max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_definition_term_by_term() {
        let scores = DMatrix::from_fn(20, 2, |i, j| ((i * (j + 3)) % 7) as f64 - 3.0);
        let mut slow = DMatrix::zeros(2, 2);
        for i in 0..20_usize {
            for k in 0..20_usize {
                let apart = i.abs_diff(k);
                if apart <= 3 {
                    slow += scores.row(i).transpose() * scores.row(k) * (1.0 - apart as f64 / 4.0);
                }
            }
        }
        assert!((sandwich(&scores, 3) - slow * (20.0 / 18.0)).norm() < 1e-9);
    }
}
