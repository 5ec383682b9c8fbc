//! Bundle adjustment of all cameras and of the surveyed points that are not exact.

use super::layout::{Layout, State, add_moved};
use super::model::CameraModel;
use super::normal::Eliminated;
use super::problem::{Choice, Problem};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Vector2, Vector3};
use nalgebra::{DMatrix, DVector};

/// Degrees of freedom that the claimed pixel covariances count for against the residuals: the variance factor of few
/// residuals is as uncertain as that of a normal sample of this size, which a-priori covariances known to a factor
/// of about two deserve (mean of a scaled inverse chi-square, Gelman et al. 2013, section 2.6).
pub(super) const PRIOR_FREEDOM: f64 = 2.0;
/// Spread of the image of a point that is not what it is taken for, of the width.
const STRAY_STD: f64 = 0.05;
/// Levenberg-Marquardt steps, and rounds of it with a new variance factor.
const MAX_STEPS: usize = 60;
const ROUNDS: usize = 4;

/// An adjustment.
#[derive(Clone)]
pub(super) struct Fit {
    pub(super) models: Vec<CameraModel>,
    pub(super) cameras: Vec<Camera>,
    /// Places of the table's rows.
    pub(super) places: Vec<Vector3<f64>>,
    /// Poses of the moved objects, by object and instant, and what their sizes are relative to what was said.
    pub(super) poses: Vec<Vec<Isometry3<f64>>>,
    pub(super) scales: Vec<f64>,
    /// Estimated ratio of the residuals' variance to what the pixels' covariances claim.
    pub(super) variance_factor: f64,
    /// Degrees of freedom of that, the prior ones included.
    pub(super) freedom: f64,
    /// Covariance of all free parameters, at the variance factor.
    pub(super) covariance: DMatrix<f64>,
    pub(super) layout: Layout,
    /// Laplace's approximation of the log of the probability of the data under the models and the choice.
    pub(super) log_evidence: f64,
}

/// The equations at one state.
pub(super) struct Equations {
    pub(super) normal: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
    /// Weighted squares of the pixels, at the claimed covariances.
    pub(super) squares: f64,
    /// Of the priors.
    pub(super) prior: f64,
    /// Sum of the logs of the priors' weights.
    pub(super) log_prior_weight: f64,
    /// Of the moved objects: coordinates, parameters of their poses, and the log determinant of those at the factor.
    pub(super) moved: (usize, usize, f64),
}

struct Adjustment<'a> {
    problem: &'a Problem,
    choice: &'a Choice,
    models: &'a [CameraModel],
    layout: Layout,
}

/// Adjusts the cameras that have used sights under their models; `None` when the iteration leaves the cameras' view or
/// the equations are singular.
pub(super) fn adjust(
    problem: &Problem,
    choice: &Choice,
    models: &[CameraModel],
    start: &[Camera],
) -> Option<Fit> {
    from(problem, choice, models, (start_of(problem, start), 1.0))
}

/// The fit that exact images of these cameras would have if their noise were as claimed: nothing is adjusted, and the
/// variance factor is 1.
pub(super) fn expected(
    problem: &Problem,
    choice: &Choice,
    models: &[CameraModel],
    cameras: &[Camera],
) -> Option<Fit> {
    let layout = Layout::new(problem, choice, models);
    let mut state = start_of(problem, cameras);
    let adjustment = Adjustment { problem, choice, models, layout };
    let equations = adjustment.equations(&mut state, 1.0)?;
    let (coordinates, of_poses, _) = equations.moved;
    let covariance = Eliminated::new(&equations.normal, adjustment.layout.of_cameras, 0.0)?.inverse();
    let n = 2 * choice.used.iter().filter(|u| **u).count() + coordinates;
    let bound = adjustment.bound_by_priors(cameras, &covariance);
    let freedom = PRIOR_FREEDOM + n as f64 - ((adjustment.layout.size + of_poses) as f64 - bound);
    Some(Fit {
        models: models.to_vec(),
        cameras: state.cameras,
        places: state.places,
        poses: state.poses,
        scales: state.scales,
        variance_factor: 1.0,
        freedom,
        covariance,
        layout: adjustment.layout,
        log_evidence: 0.0,
    })
}

fn start_of(problem: &Problem, cameras: &[Camera]) -> State {
    State {
        cameras: cameras.to_vec(),
        places: problem.points.iter().map(|p| p.in_world_m).collect(),
        poses: problem.moved.iter().map(|m| m.start.clone()).collect(),
        scales: vec![1.0; problem.moved.len()],
    }
}

/// The same from a fit under another model.
pub(super) fn readjust(
    problem: &Problem,
    choice: &Choice,
    models: &[CameraModel],
    near: &Fit,
) -> Option<Fit> {
    from(problem, choice, models, (near.state(), near.variance_factor))
}

fn from(
    problem: &Problem,
    choice: &Choice,
    models: &[CameraModel],
    (mut state, factor): (State, f64),
) -> Option<Fit> {
    let layout = Layout::new(problem, choice, models);
    state.cameras = state.cameras.iter().zip(models).map(|(c, m)| m.restricted(c)).collect();
    Adjustment { problem, choice, models, layout }.run(state, factor)
}

impl Adjustment<'_> {
    fn run(self, mut state: State, mut factor: f64) -> Option<Fit> {
        for round in 1.. {
            let equations = self.minimise(&mut state, factor)?;
            let (coordinates, of_poses, log_poses) = equations.moved;
            let n = 2 * self.choice.used.iter().filter(|u| **u).count() + coordinates;
            let factors = Eliminated::new(&equations.normal, self.layout.of_cameras, 0.0)?;
            let (covariance, log_determinant) = (factors.inverse(), factors.log_determinant);
            let bound: f64 = self.bound_by_priors(&state.cameras, &covariance);
            let freedom = PRIOR_FREEDOM + n as f64 - ((self.layout.size + of_poses) as f64 - bound);
            if freedom < 1.0 {
                return None;
            }
            let next = (PRIOR_FREEDOM + equations.squares) / freedom;
            let settled = (next / factor - 1.0).abs() < 1e-3;
            if !settled && round < ROUNDS {
                factor = next;
                continue;
            }
            let strays: f64 = self.log_density_of_strays();
            let log_evidence = equations.log_prior_weight + strays
                - 0.5
                    * (equations.squares / factor
                        + equations.prior
                        + n as f64 * factor.ln()
                        + log_determinant
                        + log_poses
                        + PRIOR_FREEDOM * (factor.ln() + 1.0 / factor));
            return Some(Fit {
                models: self.models.to_vec(),
                cameras: state.cameras,
                places: state.places,
                poses: state.poses,
                scales: state.scales,
                variance_factor: factor,
                freedom,
                covariance,
                layout: self.layout,
                log_evidence,
            });
        }
        None
    }

    /// Levenberg-Marquardt at a given variance factor.
    fn minimise(&self, state: &mut State, factor: f64) -> Option<Equations> {
        let mut now = self.equations(state, factor)?;
        let mut damping = 0.0;
        for _ in 0..MAX_STEPS {
            let step = Eliminated::new(&now.normal, self.layout.of_cameras, damping)?.solve(&now.gradient);
            let decrement = step.dot(&now.gradient);
            let mut tried = self.moved(state, &step);
            let cost = now.squares / factor + now.prior;
            let next = self
                .equations(&mut tried, factor)
                .filter(|e| e.squares / factor + e.prior <= cost * (1.0 + 1e-12) + 1e-12);
            if let Some(next) = next {
                (*state, now) = (tried, next);
                damping = if damping < 1e-9 { 0.0 } else { damping * 0.1 };
            } else {
                damping = if damping == 0.0 { 1e-4 } else { damping * 10.0 };
            }
            if decrement < 1e-7 {
                break;
            }
        }
        Some(now)
    }

    fn moved(&self, state: &State, step: &DVector<f64>) -> State {
        let mut out = state.clone();
        for (camera, own) in out.cameras.iter_mut().zip(&self.layout.cameras) {
            let Some(own) = own else { continue };
            let change = own.basis.iter().enumerate().map(|(k, b)| b * step[own.at + k]).sum();
            *camera = camera.moved(&change);
        }
        for (place, at) in out.places.iter_mut().zip(&self.layout.points) {
            *place += at.map_or_else(Vector3::zeros, |at| step.fixed_rows::<3>(at).into_owned());
        }
        for (scale, at) in out.scales.iter_mut().zip(&self.layout.scales) {
            *scale += at.map_or(0.0, |at| step[at]);
        }
        out
    }

    /// The equations, with the moved objects at the poses that suit the cameras best.
    fn equations(&self, state: &mut State, factor: f64) -> Option<Equations> {
        let size = self.layout.size;
        let mut out = Equations {
            normal: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            squares: 0.0,
            prior: 0.0,
            log_prior_weight: 0.0,
            moved: (0, 0, 0.0),
        };
        for k in 0..self.problem.moved.len() {
            add_moved((self.problem, &self.layout), k, state, factor, &mut out)?;
        }
        let (cameras, places) = (&state.cameras, &state.places);
        let mut rows = Vec::with_capacity(CAMERA_PARAMETERS + 3);
        for (k, _) in self.choice.used.iter().enumerate().filter(|(_, used)| **used) {
            let residual =
                sight_rows(&self.layout, (self.problem, self.choice), (cameras, places), k, &mut rows)?;
            out.squares += residual.norm_squared();
            for (i, a) in &rows {
                out.gradient[*i] += a.dot(&residual) / factor;
                for (j, b) in &rows {
                    out.normal[(*i, *j)] += a.dot(b) / factor;
                }
            }
        }
        for ((model, camera), own) in self.models.iter().zip(cameras).zip(&self.layout.cameras) {
            let Some(own) = own else { continue };
            for prior in model.priors(camera) {
                let k = own.at + prior.column - own.held;
                out.normal[(k, k)] += prior.slope * prior.slope;
                out.gradient[k] -= prior.slope * prior.residual;
                out.prior += prior.residual * prior.residual;
                out.log_prior_weight += prior.slope.ln();
            }
        }
        for (row, at) in self.layout.points.iter().enumerate() {
            let Some(at) = at else { continue };
            let point = &self.problem.points[row];
            let off = (places[row] - point.in_world_m) / point.std_m;
            for axis in 0..3 {
                out.normal[(at + axis, at + axis)] += point.std_m.powi(-2);
                out.gradient[at + axis] -= off[axis] / point.std_m;
            }
            out.prior += off.norm_squared();
            out.log_prior_weight -= 3.0 * point.std_m.ln();
        }
        out.normal.iter().chain(out.gradient.iter()).all(|x| x.is_finite()).then_some(out)
    }

    /// How many of the parameters the priors determine: the trace of their part in the normal matrix.
    fn bound_by_priors(&self, cameras: &[Camera], covariance: &DMatrix<f64>) -> f64 {
        let mut sum = 0.0;
        for ((model, camera), own) in self.models.iter().zip(cameras).zip(&self.layout.cameras) {
            let Some(own) = own else { continue };
            for prior in model.priors(camera) {
                let k = own.at + prior.column - own.held;
                sum += covariance[(k, k)] * prior.slope * prior.slope;
            }
        }
        for (at, object) in self.layout.scales.iter().zip(&self.problem.moved) {
            sum += at.map_or(0.0, |at| covariance[(at, at)] / object.scale_std.powi(2));
        }
        for (row, at) in self.layout.points.iter().enumerate() {
            let Some(at) = at else { continue };
            let weight = self.problem.points[row].std_m.powi(-2);
            sum += (0..3).map(|k| covariance[(at + k, at + k)] * weight).sum::<f64>();
        }
        sum
    }

    fn log_density_of_strays(&self) -> f64 {
        let unused = self.problem.sights.iter().zip(&self.choice.used).filter(|(_, used)| !**used);
        unused
            .map(|(s, _)| {
                let stray_px = STRAY_STD * f64::from(self.problem.sizes[s.camera].width_px);
                0.5 * s.covariance_px2.determinant().ln() - 2.0 * stray_px.ln()
            })
            .sum()
    }
}

/// Whitened residual of a sight at the claimed covariance, and its derivatives by the free parameters that move it.
pub(super) fn sight_rows(
    layout: &Layout,
    (problem, choice): (&Problem, &Choice),
    (cameras, places): (&[Camera], &[Vector3<f64>]),
    sight: usize,
    rows: &mut Vec<(usize, Vector2<f64>)>,
) -> Option<Vector2<f64>> {
    let s = &problem.sights[sight];
    let row = choice.place[sight];
    let place = places[row];
    let camera = &cameras[s.camera];
    let seen = camera.project_ball(&place, s.radius_m).ok()?;
    rows.clear();
    if let Some(own) = &layout.cameras[s.camera] {
        let by_camera = s.whitener * camera.d_pixel_d_camera(&place).ok()?;
        rows.extend(own.basis.iter().enumerate().map(|(k, direction)| (own.at + k, by_camera * direction)));
    }
    if let Some(at) = layout.points[row] {
        let by_place = s.whitener * seen.d_pixel_d_point_in_world;
        rows.extend((0..3).map(|k| (at + k, by_place.column(k).into_owned())));
    }
    Some(s.whitener * (s.pixel - seen.pixel))
}

impl Fit {
    pub(super) fn state(&self) -> State {
        State {
            cameras: self.cameras.clone(),
            places: self.places.clone(),
            poses: self.poses.clone(),
            scales: self.scales.clone(),
        }
    }

    /// Measured less expected pixel of a sight, whether it was used or not.
    pub(super) fn residual_px(
        &self,
        problem: &Problem,
        choice: &Choice,
        sight: usize,
    ) -> Option<Vector2<f64>> {
        let s = &problem.sights[sight];
        let seen = self.cameras[s.camera].project_ball(&self.places[choice.place[sight]], s.radius_m).ok()?;
        Some(s.pixel - seen.pixel)
    }

    /// Covariance of all sixteen parameters of all cameras.
    pub(super) fn camera_covariance(&self) -> DMatrix<f64> {
        let spread = self.spread();
        &spread * &self.covariance * spread.transpose()
    }

    /// U with U Uᵀ that covariance, one column for each free parameter of the cameras; `None` where it is not positive.
    pub(super) fn camera_root(&self) -> Option<DMatrix<f64>> {
        let own = self.layout.of_cameras;
        let factor = self.covariance.view((0, 0), (own, own)).into_owned().cholesky()?.unpack();
        Some(self.spread().columns(0, own) * factor)
    }

    /// The sixteen parameters of each camera by the free parameters.
    fn spread(&self) -> DMatrix<f64> {
        let rows = CAMERA_PARAMETERS * self.cameras.len();
        let mut spread = DMatrix::zeros(rows, self.layout.size);
        for (camera, at) in self.layout.cameras.iter().enumerate() {
            let Some(own) = at else { continue };
            for (k, direction) in own.basis.iter().enumerate() {
                spread
                    .fixed_view_mut::<CAMERA_PARAMETERS, 1>(CAMERA_PARAMETERS * camera, own.at + k)
                    .copy_from(direction);
            }
        }
        spread
    }
}
