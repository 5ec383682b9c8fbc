//! Whether the flight determines every free parameter.

use super::condense::Linear;
use super::fitter::Fitter;
use super::model::{FlightModel, ModelParameter};
use crate::IdentifyError;
use crate::inverse::inverse;
use mavsight_geometry::svd::jacobi_svd;
use nalgebra::DVector;

/// A change by ten times a parameter's size must be seen by one standard deviation.
pub(super) const SEEN_SIZES: f64 = 10.0;

/// Part of a parameter's size by which the next step of a fit that has not converged moves it, to be named.
const MOVING: f64 = 0.1;

impl Fitter<'_> {
    /// Why the fit ended early.
    pub(super) fn not_converged(&self, tightness: f64) -> IdentifyError {
        let (iterations, promise) = (self.iterations, self.promise);
        let model = &self.point.model;
        let names = |of: &dyn Fn(usize, ModelParameter) -> bool| {
            let named = model.free().iter().enumerate().filter(|(k, p)| of(*k, **p));
            named.map(|(_, p)| model.name(*p).to_owned()).collect()
        };
        let step = self.condensed(tightness, 0.0).ok().and_then(|c| c.minimum(&[]));
        let sizes = typical_sizes(self);
        let moves = |k: usize| {
            step.as_ref().is_some_and(|(step, _)| step[self.at.tangent + k].abs() > MOVING * sizes[k])
        };
        let value = |p: &ModelParameter| (model.name(*p).to_owned(), model.value(*p));
        IdentifyError::FitNotConverged {
            iterations,
            too_long_s: self.limit.too_long_s(),
            so_far: model.free().iter().map(value).collect(),
            squares: self.at.merit(tightness),
            promise,
            at_bounds: names(&|_, p| model.is_at_bound(p)),
            moving: names(&|k, p| moves(k) && !model.is_at_bound(p)),
        }
    }
}

/// Sizes of the free parameters below which an uncertainty is worth having: the value, at the start or now,
/// or what makes an acceleration of a hundredth of gravity; 10 ms for the lag. Of what the motion does not
/// answer to, what moves a sensor by the standard deviation of a sample.
///
/// The acceleration is that of the body, or of a point at three radii of gyration for a turn, about trim at
/// 1 m/s and 10 rad/s with further states at their usual excursions.
pub(crate) fn typical_sizes(fitter: &Fitter<'_>) -> Vec<f64> {
    let (before, now) = (&fitter.start, &fitter.point.model);
    let model = before.model();
    let equations = &fitter.problem.equations;
    let mut evaluation = equations.dynamics.with(&equations.values(before));
    let trim = model.trim(before.values());
    evaluation.set_inputs(&trim);
    let mut y = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 10.0, 10.0, 10.0];
    let initial = model.initial(before.values(), &trim);
    y.extend(initial.iter().zip(&model.states).map(|(value, state)| value + state.size));
    evaluation.linearise(&y, &mut vec![0.0; y.len()]);
    let Some((linear, turning)) = before.accelerations(0.01) else { return Vec::new() };
    let mut floors = vec![0.0; before.free().len()];
    for slope in evaluation.by_parameter() {
        let limit = match slope.row {
            7..=9 => linear,
            10..=12 => turning[slope.row - 10],
            _ => continue,
        };
        let floor: &mut f64 = &mut floors[equations.places[slope.column]];
        let own = limit / slope.value.abs();
        if own.is_finite() && (*floor == 0.0 || own < *floor) {
            *floor = own;
        }
    }
    let mut by_sensors = vec![f64::INFINITY; floors.len()];
    evaluation.sense(&y, &mut vec![0.0; model.sensors.len()]);
    for slope in evaluation.sensors_by_parameter() {
        let floor: &mut f64 = &mut by_sensors[equations.places[slope.column]];
        *floor = floor.min(model.sensors[slope.row].std / slope.value.abs());
    }
    let unmoved = floors.iter_mut().zip(by_sensors).filter(|(floor, own)| **floor == 0.0 && own.is_finite());
    unmoved.for_each(|(floor, own)| *floor = own);
    equations.lag.into_iter().for_each(|lag| floors[lag] = 0.01);
    let size = |(floor, p): (f64, &ModelParameter)| {
        let largest = floor.max(before.value(*p).abs()).max(now.value(*p).abs());
        // Of what has no effect about trim and is zero nothing is known: its unit.
        if largest > 0.0 { largest } else { 1.0 }
    };
    floors.into_iter().zip(before.free()).map(size).collect()
}

/// Refuses a fit in which a combination of parameters changes nothing that was measured.
///
/// The least determined direction is taken from the information on the parameters with start and nuisances
/// unknown; what it changes is then added up row by row, which is exact where the information has lost its
/// digits.
pub(crate) fn refuse_undetermined(fitter: &Fitter<'_>, linear: &Linear) -> Result<(), IdentifyError> {
    let free = fitter.free();
    let (p, tangent) = (free.len(), linear.tangent);
    let size = DVector::from_vec(typical_sizes(fitter));
    let a = linear.information();
    let mine: Vec<usize> = (tangent..tangent + p).collect();
    let rest: Vec<usize> = (0..tangent).chain(tangent + p..a.nrows()).collect();
    let a_rm = a.select_rows(&rest).select_columns(&mine);
    let follow = inverse(&a.select_rows(&rest).select_columns(&rest)).ok_or(IdentifyError::RankZero)? * &a_rm;
    let marginal = a.select_rows(&mine).select_columns(&mine) - a_rm.tr_mul(&follow);
    // In units of the information on each parameter alone: that keeps the digits of weak ones.
    let unit = DVector::from_fn(p, |i, _| {
        let own = a[(tangent + i, tangent + i)];
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
        step.rows_mut(tangent, p).copy_from(&direction);
        rest.iter().zip(&(&follow * &direction)).for_each(|(row, value)| step[*row] = -value);
        if linear.change(&step) < 1.0 {
            return Err(refusal(&fitter.start, &direction, &direction.component_div(&size)));
        }
    }
    Ok(())
}

fn refusal(model: &FlightModel, direction: &DVector<f64>, sizes: &DVector<f64>) -> IdentifyError {
    let free = model.free();
    let name = |k: usize| model.name(free[k]);
    let largest = sizes.amax();
    let named: Vec<usize> = (0..free.len()).filter(|k| sizes[*k].abs() > 0.02 * largest).collect();
    let lead = sizes.iamax();
    let part = |k: &usize| format!("{:+.4}·{}", direction[*k] / direction[lead], name(*k));
    let change = named.iter().map(part).collect::<Vec<_>>().join(" ");
    let along = format!("a change along {change} leaves every measurement as it is");
    let combination = match named[..] {
        [_] => "its change leaves every measurement as it is".to_owned(),
        [i, j] => {
            let factor = -direction[i] / direction[j];
            format!("{along}, only {} {factor:+.4}·{} is seen", name(i), name(j))
        }
        _ => along,
    };
    IdentifyError::NotDetermined { names: named.iter().map(|k| name(*k).to_owned()).collect(), combination }
}
