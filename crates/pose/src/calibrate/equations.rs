//! Normal equations of an adjustment at one state.

use super::layout::{Layout, State};
use super::model::CameraModel;
use super::problem::Data;
use crate::moving::{Instant, Reduced};
use mavsight_geometry::Vector2;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

pub(super) struct Adjustment<'a> {
    pub(super) data: Data<'a>,
    pub(super) models: &'a [CameraModel],
    pub(super) layout: Layout,
}

/// The equations, and the terms of the evidence.
#[derive(Default)]
pub(super) struct Equations {
    pub(super) normal: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
    /// Weighted squares of the pixels, at the stated covariances.
    pub(super) squares: f64,
    pub(super) prior: f64,
    pub(super) prior_weight: DVector<f64>,
    /// Coordinates of all pixels that enter.
    pub(super) coordinates: usize,
    pub(super) pose_parameters: usize,
    /// Of the normal matrices of those poses, at the variance factor.
    pub(super) log_poses: f64,
}

impl Equations {
    /// Adds a prior: its residual in standard deviations, and the derivative of that by a parameter.
    fn add_prior(&mut self, parameter: usize, residual: f64, slope: f64) {
        self.normal[(parameter, parameter)] += slope * slope;
        self.gradient[parameter] -= slope * residual;
        self.prior += residual * residual;
        self.prior_weight[parameter] += slope * slope;
    }

    pub(super) fn log_prior_weight(&self) -> f64 {
        self.prior_weight.iter().filter(|w| **w > 0.0).map(|w| 0.5 * w.ln()).sum()
    }

    /// How many of the parameters the priors determine: the trace of their part of the normal matrix.
    pub(super) fn determined_by_priors(&self, covariance: &DMatrix<f64>) -> f64 {
        covariance.diagonal().dot(&self.prior_weight)
    }
}

impl<'a> Adjustment<'a> {
    pub(super) fn new(data: Data<'a>, models: &'a [CameraModel]) -> Self {
        Self { data, models, layout: Layout::new(data, models) }
    }

    /// The equations; moves the objects to the poses that suit the cameras best.
    pub(super) fn equations(&self, state: &mut State, factor: f64) -> Option<Equations> {
        let size = self.layout.size;
        let mut out = Equations {
            normal: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            prior_weight: DVector::zeros(size),
            coordinates: 2 * self.data.choice.used().count(),
            ..Default::default()
        };
        for k in 0..self.data.problem.moved.len() {
            self.add_moved(k, state, factor, &mut out)?;
        }
        for k in self.data.choice.used() {
            let Linearised { residual, rows } = linearised(&self.layout, self.data, state, k)?;
            out.squares += residual.norm_squared();
            for (i, a) in &rows {
                out.gradient[*i] += a.dot(&residual) / factor;
                for (j, b) in &rows {
                    out.normal[(*i, *j)] += a.dot(b) / factor;
                }
            }
        }
        for ((model, camera), own) in self.models.iter().zip(&state.cameras).zip(&self.layout.cameras) {
            let Some(own) = own else { continue };
            for (prior, at) in model.priors(camera).iter().zip(own.first + 6 - own.held..) {
                out.add_prior(at, prior.residual, prior.slope);
            }
        }
        for (row, at) in self.layout.points.iter().enumerate() {
            let Some(at) = at else { continue };
            let point = &self.data.problem.points[row];
            let off = (state.places[row] - point.in_world_m) / point.std_m;
            (0..3).for_each(|axis| out.add_prior(at + axis, off[axis], 1.0 / point.std_m));
        }
        out.normal.iter().chain(out.gradient.iter()).all(|x| x.is_finite()).then_some(out)
    }

    /// The equations of one moved object: its poses follow the cameras, and are eliminated.
    fn add_moved(&self, k: usize, state: &mut State, factor: f64, out: &mut Equations) -> Option<()> {
        let object = &self.data.problem.moved[k];
        let mut shared = object.adjusted(state, k);
        let mut reduced = Reduced::new(shared.rows());
        let states = state.poses[k].iter_mut().zip(&mut state.lags_s[k]);
        for (Instant { observations, .. }, (pose, lags_s)) in object.places.iter().zip(states) {
            if shared.free_lags {
                shared.lags_s.clone_from(lags_s);
                let near = Instant { observations: observations.clone(), world_from_body: *pose };
                let own = shared.out_of_step(&near, object.lag_std_s, factor)?;
                (*pose, *lags_s) = (own.pose, shared.lags_s.clone());
                reduced.join(&own.reduced);
            } else {
                *pose = shared.best_pose(observations, pose, factor)?;
                reduced.add(&shared, observations, pose, factor)?;
            }
        }
        // From the rows of what is shared to the free parameters.
        let mut directions = self.layout.spread(shared.rows());
        if let Some(at) = self.layout.scales[k] {
            for (p, point) in object.body.iter().enumerate() {
                let row = shared.first_point() + 3 * p;
                directions.fixed_view_mut::<3, 1>(row, at).copy_from(&point.marker_in_body_m);
            }
            out.add_prior(at, (state.scales[k] - 1.0) / object.scale_std, 1.0 / object.scale_std);
        }
        let of_shape = state.shapes_m[k].iter().flat_map(|p| p.iter().copied());
        let of_offsets = state.offsets_px[k].iter().flat_map(|o| o.iter().copied());
        for (at, row, std, values) in [
            (
                self.layout.shapes[k],
                shared.first_point(),
                object.doubt.points_std_m,
                of_shape.collect::<Vec<f64>>(),
            ),
            (
                self.layout.offsets[k],
                shared.first_offset(),
                object.doubt.centres_std_px,
                of_offsets.collect(),
            ),
        ] {
            let Some(at) = at else { continue };
            for (k, value) in values.iter().enumerate() {
                directions[(row + k, at + k)] = 1.0;
                out.add_prior(at + k, value / std, 1.0 / std);
            }
        }
        out.normal += directions.tr_mul(&reduced.normal) * &directions / factor;
        out.gradient += directions.tr_mul(&reduced.gradient) / factor;
        out.squares += reduced.loss;
        let of_poses = object.pose_parameters() * reduced.instants;
        out.coordinates += reduced.coordinates;
        out.pose_parameters += of_poses;
        out.log_poses += reduced.log_determinant - of_poses as f64 * factor.ln();
        Some(())
    }
}

pub(super) struct Linearised {
    /// Whitened at the stated covariance.
    pub(super) residual: Vector2<f64>,
    /// Free parameters that move the prediction, with its whitened derivatives.
    pub(super) rows: Vec<(usize, Vector2<f64>)>,
}

/// `None` where the point is not in view.
pub(super) fn linearised(
    layout: &Layout,
    Data { problem, choice }: Data,
    state: &State,
    observation: usize,
) -> Option<Linearised> {
    let o = &problem.observations[observation];
    let row = choice.place[observation];
    let (place, camera) = (&state.places[row], &state.cameras[o.camera]);
    let predicted = camera.project_ball(place, problem.points[o.point].radius_m).ok()?;
    let mut rows = Vec::new();
    if let Some(own) = &layout.cameras[o.camera] {
        let by_camera = o.whitener * camera.d_pixel_d_camera(place).ok()?;
        rows.extend(own.basis.iter().zip(own.first..).map(|(direction, at)| (at, by_camera * direction)));
    }
    if let Some(at) = layout.points[row] {
        let by_place = o.whitener * predicted.d_pixel_d_point_in_world;
        rows.extend((0..3).map(|k| (at + k, by_place.column(k).into_owned())));
    }
    Some(Linearised { residual: o.whitener * (o.pixel - predicted.pixel), rows })
}

/// Factors a normal matrix whose diagonal is enlarged by a part of itself; `None` if not positive definite.
pub(super) fn factored(normal: &DMatrix<f64>, damping: f64) -> Option<Cholesky<f64, Dyn>> {
    let mut damped = normal.clone();
    damped.set_diagonal(&(normal.diagonal() * (1.0 + damping)));
    damped.cholesky().filter(|factor| factor.ln_determinant().is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_random::Random;

    fn normal() -> DMatrix<f64> {
        let mut jacobian = DMatrix::<f64>::zeros(60, 21);
        let mut random = Random::new(5, 0);
        for row in 0..60 {
            let (point, camera) = (row / 15, row % 3);
            let mut number = || random.normal();
            (0..3).for_each(|k| jacobian[(row, 3 * camera + k)] = number() * 10f64.powi(k as i32 - 1));
            (0..3).for_each(|k| jacobian[(row, 9 + 3 * point + k)] = number());
        }
        jacobian.tr_mul(&jacobian)
    }

    #[test]
    fn a_matrix_that_is_not_positive_has_no_factors() {
        let mut flat = normal();
        flat.fill_row(2, 0.0);
        flat.fill_column(2, 0.0);
        assert!(factored(&normal(), 0.3).is_some());
        assert!(factored(&flat, 0.0).is_none());
        assert!(factored(&-normal(), 0.0).is_none());
    }
}
