//! Whether a gyroscope and the poses are of one flight.

use super::known_parts;
use crate::smoother::believed::{Believed, believed};
use crate::smoother::noise::Likely;
use crate::smoother::passes::{Flown, forward, informed_start};
use crate::smoother::rates::Rates;
use crate::{PoseError, PoseSample, RatesRefusal};
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Poses, each by what comes before it.
struct Predicted {
    /// Mean normalised square of an innovation.
    square: f64,
    /// Of all, but for a constant.
    log_likelihood: f64,
}

/// Refuses rates under which the poses are less likely than without them.
pub(super) fn require(poses: &[PoseSample], rates: &Rates) -> Result<(), PoseError> {
    let Believed { poses, anew, found, .. } = believed(poses, None)?;
    let failed = PoseError::BadPose { index: 0, what: "the likelihood of the poses" };
    let parts = known_parts(&poses, &anew, &found);
    let without = predicted(&poses, &parts, &found).ok_or(failed.clone())?;
    let with = predicted(&poses, &parts, &found.with_rates(Some(rates))).ok_or(failed)?;
    let loss = without.log_likelihood - with.log_likelihood;
    if loss > 0.0 {
        return Err(RatesRefusal::Disagree { with: with.square, without: without.square, loss }.into());
    }
    Ok(())
}

/// The likelihood of the innovations of the poses. What is uncertain of all rates alike is integrated out: with effects E of
/// one standard deviation on innovations y of covariance S, the information about it is A = 1 + Σ Eᵀ S⁻¹ E, its squares
/// are those of y less bᵀ A⁻¹ b, b = Σ Eᵀ S⁻¹ y, and its determinant that of S times that of A.
fn predicted(poses: &[PoseSample], parts: &[Range<usize>], found: &Likely<'_>) -> Option<Predicted> {
    let columns = found.rates.map_or(0, Rates::columns);
    let (mut count, mut squares, mut log_det) = (0.0_f64, 0.0, 0.0);
    let mut information = DMatrix::identity(columns, columns);
    let mut right = DVector::zeros(columns);
    for part in parts.iter().cloned() {
        let first = part.start;
        let flown = Flown::with_errors_of_rates(&poses[part], first, found.rates);
        let mut state = informed_start(&flown, &found.noise)?;
        for step in forward(&flown, 0..flown.instants.len(), &found.noise, &mut state)? {
            let Some(update) = step.updates.pose else { continue };
            (count, squares) = (count + 1.0, squares + update.chi_square());
            log_det += update.log_determinant();
            update.add_information(&mut information, &mut right);
        }
    }
    let factor = information.cholesky()?;
    squares -= right.dot(&factor.solve(&right));
    log_det += 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
    Some(Predicted { square: squares / count.max(1.0), log_likelihood: -0.5 * (squares + log_det) })
}
