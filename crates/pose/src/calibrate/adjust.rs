//! Bundle adjustment of all cameras and of the surveyed points that are not exact.

use super::model::CameraModel;
use super::normal::Eliminated;
use super::problem::{Choice, Problem};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, CameraChange, Vector2, Vector3};
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
    /// Estimated ratio of the residuals' variance to what the pixels' covariances claim.
    pub(super) variance_factor: f64,
    /// Degrees of freedom of that, the prior ones included.
    pub(super) freedom: f64,
    /// Covariance of all free parameters, at the variance factor.
    pub(super) covariance: DMatrix<f64>,
    layout: Layout,
    /// Laplace's approximation of the log of the probability of the data under the models and the choice.
    pub(super) log_evidence: f64,
}

/// Where each free parameter stands.
#[derive(Clone)]
struct Layout {
    cameras: Vec<Option<(usize, Vec<CameraChange>)>>,
    points: Vec<Option<usize>>,
    /// Parameters of cameras, which come first.
    of_cameras: usize,
    size: usize,
}

impl Layout {
    fn new(problem: &Problem, choice: &Choice, models: &[CameraModel]) -> Self {
        let mut size = 0;
        let mut cameras = vec![None; problem.sizes.len()];
        let mut points = vec![None; problem.points.len()];
        let used = || (0..problem.sights.len()).filter(|k| choice.used[*k]);
        let sees = |camera: usize| used().any(|k| problem.sights[k].camera == camera);
        for (camera, model) in models.iter().enumerate().filter(|(c, _)| sees(*c)) {
            let basis = model.basis();
            let at = size;
            size += basis.len();
            cameras[camera] = Some((at, basis));
        }
        let of_cameras = size;
        for sight in used() {
            let row = choice.place[sight];
            if problem.points[row].std_m > 0.0 && points[row].is_none() {
                points[row] = Some(size);
                size += 3;
            }
        }
        Self { cameras, points, of_cameras, size }
    }
}

/// The equations at one state.
struct Equations {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Weighted squares of the pixels, at the claimed covariances.
    squares: f64,
    /// Of the priors.
    prior: f64,
    /// Sum of the logs of the priors' weights.
    log_prior_weight: f64,
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
    let places = problem.points.iter().map(|p| p.in_world_m).collect();
    from(problem, choice, models, (start.to_vec(), places, 1.0))
}

/// The same from a fit under another model.
pub(super) fn readjust(
    problem: &Problem,
    choice: &Choice,
    models: &[CameraModel],
    near: &Fit,
) -> Option<Fit> {
    from(problem, choice, models, (near.cameras.clone(), near.places.clone(), near.variance_factor))
}

fn from(
    problem: &Problem,
    choice: &Choice,
    models: &[CameraModel],
    (cameras, places, factor): (Vec<Camera>, Vec<Vector3<f64>>, f64),
) -> Option<Fit> {
    let layout = Layout::new(problem, choice, models);
    let cameras: Vec<Camera> = cameras.iter().zip(models).map(|(c, m)| m.restricted(c)).collect();
    Adjustment { problem, choice, models, layout }.run(cameras, places, factor)
}

impl Adjustment<'_> {
    fn run(self, mut cameras: Vec<Camera>, mut places: Vec<Vector3<f64>>, mut factor: f64) -> Option<Fit> {
        let n = 2 * self.choice.used.iter().filter(|u| **u).count();
        for round in 1.. {
            let equations = self.minimise(&mut cameras, &mut places, factor)?;
            let factors = Eliminated::new(&equations.normal, self.layout.of_cameras, 0.0)?;
            let (covariance, log_determinant) = (factors.inverse(), factors.log_determinant);
            let bound: f64 = self.bound_by_priors(&cameras, &covariance);
            let freedom = PRIOR_FREEDOM + n as f64 - (self.layout.size as f64 - bound);
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
                        + PRIOR_FREEDOM * (factor.ln() + 1.0 / factor));
            return Some(Fit {
                models: self.models.to_vec(),
                cameras,
                places,
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
    fn minimise(
        &self,
        cameras: &mut Vec<Camera>,
        places: &mut Vec<Vector3<f64>>,
        factor: f64,
    ) -> Option<Equations> {
        let mut now = self.equations(cameras, places, factor)?;
        let mut damping = 0.0;
        for _ in 0..MAX_STEPS {
            let step = Eliminated::new(&now.normal, self.layout.of_cameras, damping)?.solve(&now.gradient);
            let decrement = step.dot(&now.gradient);
            let (tried_cameras, tried_places) = self.moved(cameras, places, &step);
            let cost = now.squares / factor + now.prior;
            let next = self
                .equations(&tried_cameras, &tried_places, factor)
                .filter(|e| e.squares / factor + e.prior <= cost * (1.0 + 1e-12) + 1e-12);
            if let Some(next) = next {
                (*cameras, *places, now) = (tried_cameras, tried_places, next);
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

    fn moved(
        &self,
        cameras: &[Camera],
        places: &[Vector3<f64>],
        step: &DVector<f64>,
    ) -> (Vec<Camera>, Vec<Vector3<f64>>) {
        let cameras = cameras.iter().zip(&self.layout.cameras).map(|(camera, at)| match at {
            None => *camera,
            Some((at, basis)) => {
                let change = basis.iter().enumerate().map(|(k, b)| b * step[at + k]).sum();
                camera.moved(&change)
            }
        });
        let places = places.iter().zip(&self.layout.points).map(|(place, at)| match at {
            None => *place,
            Some(at) => place + step.fixed_rows::<3>(*at),
        });
        (cameras.collect(), places.collect())
    }

    fn equations(&self, cameras: &[Camera], places: &[Vector3<f64>], factor: f64) -> Option<Equations> {
        let size = self.layout.size;
        let mut out = Equations {
            normal: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            squares: 0.0,
            prior: 0.0,
            log_prior_weight: 0.0,
        };
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
        for ((model, camera), at) in self.models.iter().zip(cameras).zip(&self.layout.cameras) {
            let Some((at, _)) = at else { continue };
            for prior in model.priors(camera) {
                let k = at + prior.column;
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
        for ((model, camera), at) in self.models.iter().zip(cameras).zip(&self.layout.cameras) {
            let Some((at, _)) = at else { continue };
            for prior in model.priors(camera) {
                let k = at + prior.column;
                sum += covariance[(k, k)] * prior.slope * prior.slope;
            }
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
fn sight_rows(
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
    if let Some((at, basis)) = &layout.cameras[s.camera] {
        let by_camera = s.whitener * camera.d_pixel_d_camera(&place).ok()?;
        rows.extend(basis.iter().enumerate().map(|(k, direction)| (at + k, by_camera * direction)));
    }
    if let Some(at) = layout.points[row] {
        let by_place = s.whitener * seen.d_pixel_d_point_in_world;
        rows.extend((0..3).map(|k| (at + k, by_place.column(k).into_owned())));
    }
    Some(s.whitener * (s.pixel - seen.pixel))
}

/// How much a group of sights disagrees with all the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Disagreement {
    /// Drop of the weighted squares when the group is left out, at the variance factor of all.
    pub(super) drop: f64,
    /// Coordinates of the group.
    pub(super) coordinates: usize,
    /// Root of the drop per coordinate over the variance factor of the others: 1 is usual.
    pub(super) studentised: f64,
    /// Probability of so much or more by chance (F distribution).
    pub(super) probability: f64,
}

impl Fit {
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

    /// The externally studentised residual of a group of sights, used ones or ones that were left out
    /// (Cook & Weisberg 1982, section 2.2.3; for one coordinate Baarda's and Pope's test).
    ///
    /// `None` when the group's removal would leave the rest without a redundancy, or the group is not seen at all.
    pub(super) fn disagreement(
        &self,
        problem: &Problem,
        choice: &Choice,
        group: &[usize],
    ) -> Option<Disagreement> {
        let d = 2 * group.len();
        let inside = group.iter().all(|k| choice.used[*k]);
        let mut jacobian = DMatrix::zeros(d, self.layout.size);
        let mut residual = DVector::zeros(d);
        let mut rows = Vec::new();
        let mut surveyed = DMatrix::zeros(d, 3 * group.len());
        for (i, k) in group.iter().enumerate() {
            let state = (self.cameras.as_slice(), self.places.as_slice());
            let r = sight_rows(&self.layout, (problem, choice), state, *k, &mut rows)?;
            residual.fixed_rows_mut::<2>(2 * i).copy_from(&r);
            for (column, by) in &rows {
                jacobian.fixed_view_mut::<2, 1>(2 * i, *column).copy_from(by);
            }
            // A place that nothing else adjusts is as uncertain as its survey.
            let (sight, row) = (&problem.sights[*k], choice.place[*k]);
            if self.layout.points[row].is_none() && problem.points[row].std_m > 0.0 {
                let own = group.iter().position(|other| choice.place[*other] == row).unwrap_or(i);
                let seen = self.cameras[sight.camera].project_ball(&self.places[row], sight.radius_m).ok()?;
                let by_place = sight.whitener * seen.d_pixel_d_point_in_world * problem.points[row].std_m;
                surveyed.fixed_view_mut::<2, 3>(2 * i, 3 * own).copy_from(&by_place);
            }
        }
        surveyed /= self.variance_factor.sqrt();
        residual /= self.variance_factor.sqrt();
        jacobian /= self.variance_factor.sqrt();
        let mut spread = &jacobian * &self.covariance * jacobian.transpose();
        if inside {
            spread = -spread;
        }
        spread += DMatrix::identity(d, d) + &surveyed * surveyed.transpose();
        let drop = residual.dot(&spread.cholesky()?.solve(&residual));
        let below = if inside { self.freedom - d as f64 } else { self.freedom };
        let left = if inside { self.freedom - drop } else { self.freedom };
        if below < 1.0 {
            return None;
        }
        let ratio = drop / d as f64 * below / left.max(1e-9 * self.freedom);
        let probability = beyond_f(ratio, d, below);
        Some(Disagreement { drop, coordinates: d, studentised: ratio.sqrt(), probability })
    }

    /// Covariance of all sixteen parameters of all cameras.
    pub(super) fn camera_covariance(&self) -> DMatrix<f64> {
        let rows = CAMERA_PARAMETERS * self.cameras.len();
        let mut spread = DMatrix::zeros(rows, self.layout.size);
        for (camera, at) in self.layout.cameras.iter().enumerate() {
            let Some((at, basis)) = at else { continue };
            for (k, direction) in basis.iter().enumerate() {
                spread
                    .fixed_view_mut::<CAMERA_PARAMETERS, 1>(CAMERA_PARAMETERS * camera, at + k)
                    .copy_from(direction);
            }
        }
        &spread * &self.covariance * spread.transpose()
    }
}

/// Probability that an F ratio of an even number of degrees of freedom above exceeds `ratio` by chance: the finite sum
/// of the incomplete beta function (Abramowitz & Stegun 1964, 26.6.4).
pub(super) fn beyond_f(ratio: f64, above: usize, below: f64) -> f64 {
    if ratio <= 0.0 {
        return 1.0;
    }
    let x = below / (below + above as f64 * ratio);
    let a = below / 2.0;
    let mut term = 1.0;
    let mut sum = 1.0;
    for j in 1..above / 2 {
        term *= (a + j as f64 - 1.0) / j as f64 * (1.0 - x);
        sum += term;
    }
    (x.powf(a) * sum).clamp(0.0, 1.0)
}

/// Half-width of the 95 % region of three coordinates whose variance was estimated with so many degrees of freedom, over
/// that with a known variance: the root of 3 F(3, freedom) over chi-square(3) (Hotelling 1931), by Paulson's normal
/// approximation of F (1942; within 1 % in the half-width from 4 degrees of freedom on).
pub(super) fn hotelling_over_normal(freedom: f64) -> f64 {
    const NORMAL: f64 = 1.644_854;
    const CHI_SQUARE: f64 = 7.814_73;
    let (a, b) = (2.0 / 27.0, 2.0 / (9.0 * freedom.max(2.0)));
    // (1 - b) r - (1 - a) = z sqrt(b r² + a) for the cube root r of F.
    let (p, q, z2) = (1.0 - b, 1.0 - a, NORMAL * NORMAL);
    let (square, half, rest) = (p * p - z2 * b, p * q, q * q - z2 * a);
    let root = (half + (half * half - square * rest).max(0.0).sqrt()) / square.max(0.05);
    (3.0 * root.powi(3) / CHI_SQUARE).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Abramowitz & Stegun, tables 26.9 and 26.10.
        for (ratio, above, below, probability) in
            [(3.49, 2, 20.0, 0.05), (5.85, 2, 20.0, 0.01), (6.39, 4, 4.0, 0.05), (4.43, 4, 20.0, 0.01)]
        {
            let got = beyond_f(ratio, above, below);
            assert!((got / probability - 1.0).abs() < 0.01, "F({above}, {below}) beyond {ratio}: {got}");
        }
        for (freedom, f) in [(5.0, 5.409), (10.0, 3.708), (20.0, 3.098), (60.0, 2.758)] {
            let got = hotelling_over_normal(freedom).powi(2) * 7.814_73 / 3.0;
            assert!((got / f - 1.0).abs() < 0.02, "F(3, {freedom}) = {got}");
        }
    }
}
