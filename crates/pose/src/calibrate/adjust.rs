//! Bundle adjustment of all cameras and of the surveyed points that are not exact.

use super::equations::{Adjustment, Equations, factored};
use super::layout::{Layout, State};
use super::model::CameraModel;
use super::problem::{Data, Problem};
use crate::reprojection::PointObservation;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Vector2};
use nalgebra::DMatrix;

/// Degrees of freedom for which the stated covariances count against the residuals, as they are known to a
/// factor of about two (mean of a scaled inverse chi-square, Gelman et al. 2013, section 2.6).
const PRIOR_FREEDOM: f64 = 2.0;
/// Spread of the image of a point that is not what it is taken for, of the width.
const OUTLIER_STD: f64 = 0.05;
/// Levenberg-Marquardt steps, and rounds of it with a new variance factor.
const MAX_STEPS: usize = 60;
const ROUNDS: usize = 4;

#[derive(Clone)]
pub(super) struct Fit {
    pub(super) models: Vec<CameraModel>,
    pub(super) state: State,
    /// Estimated ratio of the residuals' variance to the stated covariances.
    pub(super) variance_factor: f64,
    /// Degrees of freedom of that, the prior ones included.
    pub(super) freedom: f64,
    /// Covariance of all free parameters, at the variance factor.
    pub(super) covariance: DMatrix<f64>,
    pub(super) layout: Layout,
    /// Laplace's approximation of the log of the probability of the data under the models and the choice.
    pub(super) log_evidence: f64,
}

/// Adjusts the cameras that have used observations; `None` for lost views or singular equations.
pub(super) fn adjust(data: Data, models: &[CameraModel], start: &[Camera]) -> Option<Fit> {
    Adjustment::new(data, models).run(State::new(data.problem, start), 1.0)
}

/// [`adjust`] from a fit under another model.
pub(super) fn readjust(data: Data, models: &[CameraModel], near: &Fit) -> Option<Fit> {
    Adjustment::new(data, models).run(near.state.clone(), near.variance_factor)
}

/// The fit of exact images of these cameras with noise as stated: nothing is adjusted.
pub(super) fn expected(data: Data, models: &[CameraModel], cameras: &[Camera]) -> Option<Fit> {
    let adjustment = Adjustment::new(data, models);
    let mut state = State::new(data.problem, cameras);
    let equations = adjustment.equations(&mut state, 1.0)?;
    adjustment.fit(state, &equations, 1.0)
}

impl Adjustment<'_> {
    fn run(self, mut state: State, mut factor: f64) -> Option<Fit> {
        state.cameras = state.cameras.iter().zip(self.models).map(|(c, m)| m.restricted(c)).collect();
        for round in 1..=ROUNDS {
            let equations = self.minimise(&mut state, factor)?;
            let fit = self.fit(state, &equations, factor)?;
            if fit.freedom < 1.0 {
                return None;
            }
            let next = (PRIOR_FREEDOM + equations.squares) / fit.freedom;
            if (next / factor - 1.0).abs() < 1e-3 || round == ROUNDS {
                return Some(fit);
            }
            (state, factor) = (fit.state, next);
        }
        None
    }

    fn fit(&self, state: State, equations: &Equations, factor: f64) -> Option<Fit> {
        let factors = factored(&equations.normal, 0.0)?;
        let covariance = factors.inverse();
        let n = equations.coordinates as f64;
        let free = (self.layout.size + equations.pose_parameters) as f64;
        let deviance = equations.squares / factor
            + equations.prior
            + n * factor.ln()
            + factors.ln_determinant()
            + equations.log_poses
            + PRIOR_FREEDOM * (factor.ln() + 1.0 / factor);
        Some(Fit {
            models: self.models.to_vec(),
            state,
            variance_factor: factor,
            // Lags have priors of their own scale in the squares: each adds a square and takes one.
            freedom: PRIOR_FREEDOM + n - (free - equations.determined_by_priors(&covariance)),
            covariance,
            layout: self.layout.clone(),
            log_evidence: equations.log_prior_weight() + self.log_density_of_outliers() - 0.5 * deviance,
        })
    }

    /// Levenberg-Marquardt at a given variance factor.
    fn minimise(&self, state: &mut State, factor: f64) -> Option<Equations> {
        let mut now = self.equations(state, factor)?;
        let mut damping = 0.0;
        for _ in 0..MAX_STEPS {
            let step = factored(&now.normal, damping)?.solve(&now.gradient);
            let decrement = step.dot(&now.gradient);
            let mut tried = state.stepped(&self.layout, &step);
            let cost = now.squares / factor + now.prior;
            let next = self
                .equations(&mut tried, factor)
                .filter(|e| e.squares / factor + e.prior <= cost * (1.0 + 1e-12) + 1e-12);
            match next {
                Some(next) => {
                    (*state, now) = (tried, next);
                    damping *= 0.1;
                }
                None => damping = f64::max(1e-4, damping * 10.0),
            }
            if decrement < 1e-7 {
                break;
            }
        }
        Some(now)
    }

    fn log_density_of_outliers(&self) -> f64 {
        let Data { problem, choice } = self.data;
        let unused = problem.observations.iter().zip(&choice.used).filter(|(_, used)| !**used);
        let log_density = |(o, _): (&PointObservation, _)| {
            let outlier_px = OUTLIER_STD * f64::from(problem.sizes[o.camera].width_px);
            0.5 * o.covariance_px2.determinant().ln() - 2.0 * outlier_px.ln()
        };
        unused.map(log_density).sum()
    }
}

/// Residuals of the moved objects in one camera.
#[derive(Default)]
pub(super) struct ObjectResiduals {
    pub(super) squares_px2: f64,
    /// Observations, of two coordinates each.
    pub(super) observations: f64,
    /// Sum over them of the inverse stated variance of a coordinate.
    pub(super) information: f64,
}

impl Fit {
    /// Measured less predicted pixel of an observation, whether it was used or not.
    pub(super) fn residual_px(
        &self,
        Data { problem, choice }: Data,
        observation: usize,
    ) -> Option<Vector2<f64>> {
        let o = &problem.observations[observation];
        let (place, radius_m) =
            (&self.state.places[choice.place[observation]], problem.points[o.point].radius_m);
        Some(o.pixel - self.state.cameras[o.camera].project_ball(place, radius_m).ok()?.pixel)
    }

    pub(super) fn object_residuals(&self, problem: &Problem, camera: usize) -> ObjectResiduals {
        let mut out = ObjectResiduals::default();
        for (k, object) in problem.moved.iter().enumerate() {
            let mut shared = object.adjusted(&self.state, k);
            let states = self.state.poses[k].iter().zip(&self.state.lags_s[k]);
            for (place, (pose, lags_s)) in object.places.iter().zip(states) {
                shared.lags_s.clone_from(lags_s);
                for o in place.observations.iter().filter(|o| o.camera == camera) {
                    let Some(residual_px) = shared.residual_px(o, pose) else { continue };
                    out.squares_px2 += residual_px.norm_squared();
                    out.observations += 1.0;
                    out.information += 2.0 / o.covariance_px2.trace();
                }
            }
        }
        out
    }

    /// Covariance of all sixteen parameters of all cameras.
    pub(super) fn camera_covariance(&self) -> DMatrix<f64> {
        let spread = self.layout.spread(CAMERA_PARAMETERS * self.state.cameras.len());
        &spread * &self.covariance * spread.transpose()
    }

    /// U with U Uᵀ that covariance, a column for each free parameter; `None` where it is not positive.
    pub(super) fn camera_root(&self) -> Option<DMatrix<f64>> {
        let own = self.layout.of_cameras;
        let factor = self.covariance.view((0, 0), (own, own)).into_owned().cholesky()?.unpack();
        let spread = self.layout.spread(CAMERA_PARAMETERS * self.state.cameras.len());
        Some(spread.columns(0, own) * factor)
    }
}
