//! How much observations disagree with the others, and how surely.

use super::adjust::Fit;
use super::equations::{Linearised, linearised};
use super::problem::Data;
use crate::statistics::beyond_f;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

/// How much a group of observations disagrees with all the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Disagreement {
    /// Root of the drop of the weighted squares per coordinate over the others' variance factor: 1 is usual.
    pub(super) studentised: f64,
    /// Probability of as much or more by chance (F distribution).
    pub(super) probability: f64,
}

impl Fit {
    /// The externally studentised residual of a group of observations, used or not (Cook & Weisberg 1982,
    /// section 2.2.3). Where a part of the variance is that of a survey, the degrees of freedom are
    /// Satterthwaite's (1946).
    ///
    /// `None` where the rest has no redundancy without the group, or the group is not in view.
    pub(super) fn disagreement(&self, data: Data, group: &[usize]) -> Option<Disagreement> {
        let Data { problem, choice } = data;
        let d = 2 * group.len();
        let inside = group.iter().all(|k| choice.used[*k]);
        let mut jacobian = DMatrix::zeros(d, self.layout.size);
        let mut residual = DVector::zeros(d);
        let mut surveyed = DMatrix::zeros(d, 3 * group.len());
        for (i, k) in group.iter().enumerate() {
            let Linearised { residual: own, rows } = linearised(&self.layout, data, &self.state, *k)?;
            residual.fixed_rows_mut::<2>(2 * i).copy_from(&own);
            for (column, by) in &rows {
                jacobian.fixed_view_mut::<2, 1>(2 * i, *column).copy_from(by);
            }
            // A place that nothing else adjusts is as uncertain as its survey.
            let (o, row) = (&problem.observations[*k], choice.place[*k]);
            if self.layout.points[row].is_none() && problem.points[row].std_m > 0.0 {
                let first = group.iter().position(|other| choice.place[*other] == row).unwrap_or(i);
                let camera = &self.state.cameras[o.camera];
                let radius_m = problem.points[o.point].radius_m;
                let predicted = camera.project_ball(&self.state.places[row], radius_m).ok()?;
                let by_place = o.whitener * predicted.d_pixel_d_point_in_world * problem.points[row].std_m;
                surveyed.fixed_view_mut::<2, 3>(2 * i, 3 * first).copy_from(&by_place);
            }
        }
        let scale = self.variance_factor.sqrt();
        (surveyed, residual, jacobian) = (surveyed / scale, residual / scale, jacobian / scale);
        let of_fit = &jacobian * &self.covariance * jacobian.transpose() * if inside { -1.0 } else { 1.0 };
        let spread = of_fit + DMatrix::identity(d, d) + &surveyed * surveyed.transpose();
        let weighted = spread.cholesky()?.solve(&residual);
        let drop = residual.dot(&weighted);
        let below = if inside { self.freedom - d as f64 } else { self.freedom };
        if below < 1.0 {
            return None;
        }
        // The survey's part of a disagreement is measured by its own standard deviation, not by the
        // residuals'.
        let bound = group.iter().any(|k| self.layout.points[choice.place[*k]].is_some());
        let left = if inside && !bound { self.freedom - drop } else { below };
        let ratio = drop / d as f64 * below / left.max(1e-9 * self.freedom);
        let estimated =
            (1.0 - (surveyed.tr_mul(&weighted)).norm_squared() / drop.max(1e-300)).clamp(1e-3, 1.0);
        let probability = beyond_f(ratio, d as f64, below / (estimated * estimated));
        Some(Disagreement { studentised: ratio.sqrt(), probability })
    }
}

/// Half-width of the 95 % region of three coordinates whose variance was estimated with `freedom` degrees of
/// freedom, over that with a known variance: the root of 3 F(3, freedom) over chi-square(3) (Hotelling 1931).
pub(super) fn hotelling_over_normal(freedom: f64) -> f64 {
    let known = ChiSquared::new(3.0).map(|d| d.inverse_cdf(0.95));
    let estimated = FisherSnedecor::new(3.0, freedom.max(2.0)).map(|d| 3.0 * d.inverse_cdf(0.95));
    estimated.ok().zip(known.ok()).map_or(f64::NAN, |(estimated, known)| (estimated / known).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Abramowitz & Stegun, tables 26.9 and 26.10.
        for (ratio, above, below, probability) in [
            (3.49, 2.0, 20.0, 0.05),
            (5.85, 2.0, 20.0, 0.01),
            (6.39, 4.0, 4.0, 0.05),
            (4.43, 4.0, 20.0, 0.01),
        ] {
            let got = beyond_f(ratio, above, below);
            assert!((got / probability - 1.0).abs() < 0.01, "F({above}, {below}) beyond {ratio}: {got}");
        }
        assert!((beyond_f(9.21, 2.0, 1e9) / 1e-4 - 1.0).abs() < 0.02 && beyond_f(-1.0, 2.0, 5.0) == 1.0);
        for (freedom, f) in [(5.0, 5.409), (10.0, 3.708), (20.0, 3.098), (60.0, 2.758)] {
            let got = hotelling_over_normal(freedom).powi(2) * 7.814_73 / 3.0;
            assert!((got / f - 1.0).abs() < 1e-3, "F(3, {freedom}) = {got}");
        }
    }
}
