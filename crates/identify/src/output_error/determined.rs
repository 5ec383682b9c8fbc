//! Whether the flight determines every free parameter.

use super::condense::Linear;
use super::fitter::Fitter;
use super::model::ModelParameter;
use super::propagate::TANGENT;
use crate::IdentifyError;
use crate::inverse::inverse;
use mavsight_flight::Coefficient as C;
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::DVector;

/// A change by ten times a parameter's size must be seen by one standard deviation.
const SEEN_SIZES: f64 = 10.0;

/// A size of a parameter below which an uncertainty is worth having: its value, at the start or now, or an
/// effect of one hundredth of the weight (over the rotor's radius; per m/s, per 10 rad/s); 10 ms for the lag.
pub(crate) fn typical(parameter: ModelParameter, fitter: &Fitter<'_>) -> f64 {
    let model = &fitter.start;
    let effect = 0.01 * (model.coefficients.get(C::CzU) + model.coefficients.get(C::CzL)).abs();
    let floor = match parameter {
        ModelParameter::InputLag => 0.01,
        ModelParameter::Coefficient(C::TauLower | C::TauFlybar | C::SwashplateGain | C::FlybarGain) => 0.0,
        ModelParameter::Coefficient(C::ClP | C::CmQ | C::CnR) => 0.1 * effect,
        ModelParameter::Coefficient(_) => effect,
    };
    model.value(parameter).abs().max(fitter.point.model.value(parameter).abs()).max(floor)
}

/// Refuses a fit in which a combination of parameters changes nothing that was measured.
///
/// The least determined direction is taken from the information on the parameters with start and nuisances
/// unknown; what it changes is then added up row by row, which is exact where the information has lost its
/// digits.
pub(crate) fn refuse_undetermined(fitter: &Fitter<'_>, linear: &Linear) -> Result<(), IdentifyError> {
    let free = fitter.free();
    let p = free.len();
    let size = DVector::from_iterator(p, free.iter().map(|q| typical(*q, fitter)));
    let a = linear.information();
    let mine: Vec<usize> = (TANGENT..TANGENT + p).collect();
    let rest: Vec<usize> = (0..TANGENT).chain(TANGENT + p..a.nrows()).collect();
    let a_rm = a.select_rows(&rest).select_columns(&mine);
    let follow = inverse(&a.select_rows(&rest).select_columns(&rest)).ok_or(IdentifyError::RankZero)? * &a_rm;
    let marginal = a.select_rows(&mine).select_columns(&mine) - a_rm.tr_mul(&follow);
    // In units of the information on each parameter alone: that keeps the digits of weak ones.
    let unit = DVector::from_fn(p, |i, _| {
        let own = a[(TANGENT + i, TANGENT + i)];
        if own > 0.0 { 1.0 / own.sqrt() } else { size[i] }
    });
    let symmetric = (&marginal + marginal.transpose()) * 0.5;
    let directions = jacobi_svd(&symmetric.component_mul(&(&unit * unit.transpose()))).v;
    for k in (0..p).rev().take(3) {
        let direction = directions.column(k).component_mul(&unit);
        let largest = direction.component_div(&size).amax();
        if largest == 0.0 {
            continue;
        }
        let direction = direction * (SEEN_SIZES / largest);
        let mut step = DVector::zeros(a.nrows());
        step.rows_mut(TANGENT, p).copy_from(&direction);
        rest.iter().zip(&(&follow * &direction)).for_each(|(row, value)| step[*row] = -value);
        if linear.change(&step) < 1.0 {
            return Err(refusal(free, &direction, &direction.component_div(&size)));
        }
    }
    Ok(())
}

fn refusal(free: &[ModelParameter], direction: &DVector<f64>, sizes: &DVector<f64>) -> IdentifyError {
    let largest = sizes.amax();
    let named: Vec<usize> = (0..free.len()).filter(|k| sizes[*k].abs() > 0.02 * largest).collect();
    let lead = sizes.iamax();
    let part = |k: &usize| format!("{:+.4}·{}", direction[*k] / direction[lead], free[*k].name());
    let change = named.iter().map(part).collect::<Vec<_>>().join(" ");
    let mut combination = format!("a change along {change} leaves every measurement as it is");
    if let [i, j] = named[..] {
        let factor = -direction[i] / direction[j];
        combination += &format!(", only {} {factor:+.4}·{} is seen", free[i].name(), free[j].name());
    }
    IdentifyError::NotDetermined {
        names: named.iter().map(|k| free[*k].name().to_owned()).collect(),
        combination,
    }
}
