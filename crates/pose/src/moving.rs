//! Rigid bodies seen at unknown poses, as equations of what all instants share: cameras, the bodies' points, and how far
//! centres are off for good. The poses are eliminated (Schur complement; Triggs et al. 2000, section 6.1).

use crate::BodyMarker;
use crate::estimate::noise_weight;
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::camera::d_pixel_d_pose;
use mavsight_geometry::{
    CAMERA_PARAMETERS, Camera, Isometry3, Matrix2, Matrix6, Point3, UnitQuaternion, Vector2, Vector3,
};
use nalgebra::{DMatrix, DVector, Dyn, OMatrix, SMatrix, Translation3, U6, Vector6};

/// Steps with which a pose follows the cameras; from a near one two suffice.
const POSE_STEPS: usize = 20;
/// A step that promises to lower the chi-square by less, a hundredth of a standard deviation squared, is the last: what remains
/// after it is smaller by its square.
const SETTLED: f64 = 1e-4;
/// What is added to the information on a body's turn, of its largest: points on one line say nothing of a turn about it.
const NO_TURN: f64 = 1e-9;

/// A point of a body, seen by a camera.
#[derive(Clone, Copy)]
pub(crate) struct PointSight {
    pub(crate) camera: usize,
    pub(crate) point: usize,
    pub(crate) pixel: Vector2<f64>,
    /// Wᵀ W is the inverse of the claimed covariance.
    pub(crate) whitener: Matrix2<f64>,
}

/// A body at one instant.
#[derive(Clone)]
pub(crate) struct Instant {
    pub(crate) sights: Vec<PointSight>,
    pub(crate) world_from_body: Isometry3<f64>,
}

/// What all instants share. A change of it has 16 rows a camera, then 3 for each point and 2 for each point in each camera
/// (camera by camera), the last two where they are free.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) cameras: Vec<Camera>,
    pub(crate) points: Vec<BodyMarker>,
    /// By how much centres are off, camera by camera, point by point.
    pub(crate) offsets_px: Vec<Vector2<f64>>,
    pub(crate) free_points: bool,
    pub(crate) free_offsets: bool,
}

impl Shared {
    /// Bodies whose points are where they are said to be and seen where they are.
    pub(crate) fn new(cameras: Vec<Camera>, points: Vec<BodyMarker>) -> Self {
        let offsets_px = vec![Vector2::zeros(); cameras.len() * points.len()];
        Self { cameras, points, offsets_px, free_points: false, free_offsets: false }
    }

    /// Where the points' rows begin.
    pub(crate) fn first_point(&self) -> usize {
        CAMERA_PARAMETERS * self.cameras.len()
    }

    /// Where the offsets' rows begin.
    pub(crate) fn first_offset(&self) -> usize {
        self.first_point() + if self.free_points { 3 * self.points.len() } else { 0 }
    }

    /// All rows.
    pub(crate) fn rows(&self) -> usize {
        self.first_offset() + if self.free_offsets { 2 * self.offsets_px.len() } else { 0 }
    }

    /// Rows that a sight depends on, with its whitened derivatives by them, and its whitened residual.
    fn sight(&self, s: &PointSight, pose: &Isometry3<f64>) -> Option<Rows> {
        let body = &self.points[s.point];
        let centre = (pose * Point3::from(body.marker_in_body_m)).coords;
        let view = &self.cameras[s.camera];
        let seen = view.project_ball(&centre, body.radius_m).ok()?;
        let offset = s.camera * self.points.len() + s.point;
        let by_world = s.whitener * seen.d_pixel_d_point_in_world;
        Some(Rows {
            residual: s.whitener * (s.pixel - seen.pixel - self.offsets_px[offset]),
            by_pose: s.whitener * d_pixel_d_pose(&seen, pose, &body.marker_in_body_m),
            by_camera: s.whitener * view.d_pixel_d_camera(&centre).ok()?,
            by_point: by_world * matrix_of(&pose.rotation),
        })
    }

    /// Measured less expected pixel of a sight; `None` where it is not in view.
    pub(crate) fn residual_px(&self, s: &PointSight, pose: &Isometry3<f64>) -> Option<Vector2<f64>> {
        let body = &self.points[s.point];
        let centre = (pose * Point3::from(body.marker_in_body_m)).coords;
        let seen = self.cameras[s.camera].project_ball(&centre, body.radius_m).ok()?;
        Some(s.pixel - seen.pixel - self.offsets_px[s.camera * self.points.len() + s.point])
    }

    /// The same at the claimed covariance.
    pub(crate) fn whitened(&self, s: &PointSight, pose: &Isometry3<f64>) -> Option<Vector2<f64>> {
        Some(s.whitener * self.residual_px(s, pose)?)
    }

    /// Huber's loss, normal matrix and gradient of a pose.
    fn pose_equations(
        &self,
        sights: &[PointSight],
        pose: &Isometry3<f64>,
        factor: f64,
    ) -> Option<(f64, Matrix6<f64>, Vector6<f64>)> {
        let (mut squares, mut normal, mut gradient) = (0.0, Matrix6::zeros(), Vector6::zeros());
        for s in sights {
            let body = &self.points[s.point];
            let centre = (pose * Point3::from(body.marker_in_body_m)).coords;
            let seen = self.cameras[s.camera].project_ball(&centre, body.radius_m).ok()?;
            let offset = self.offsets_px[s.camera * self.points.len() + s.point];
            let residual = s.whitener * (s.pixel - seen.pixel - offset);
            let by_pose = s.whitener * d_pixel_d_pose(&seen, pose, &body.marker_in_body_m);
            let square = residual.norm_squared();
            let weight = noise_weight(square, factor);
            squares += loss(square, weight);
            normal += by_pose.transpose() * by_pose * weight;
            gradient += by_pose.transpose() * residual * weight;
        }
        determine_turn(&mut normal);
        (squares.is_finite() && gradient.iter().all(|g| g.is_finite())).then_some((squares, normal, gradient))
    }

    /// The pose at its minimum under these cameras, from one near (Levenberg 1944; Marquardt 1963). `None` where a point
    /// leaves the view or the pose is not determined.
    pub(crate) fn settled(
        &self,
        sights: &[PointSight],
        near: &Isometry3<f64>,
        factor: f64,
    ) -> Option<Isometry3<f64>> {
        let mut pose = *near;
        let (mut cost, mut normal, mut gradient) = self.pose_equations(sights, &pose, factor)?;
        let mut damping = 0.0;
        for _ in 0..POSE_STEPS {
            let mut damped = normal;
            (0..6).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let step = damped.cholesky()?.solve(&gradient);
            let decrement = step.dot(&gradient);
            let tried = moved(&pose, &step);
            if decrement < SETTLED * factor.min(1.0) && damping < 1e-3 {
                return Some(tried);
            }
            match self.pose_equations(sights, &tried, factor) {
                Some(better) if better.0 <= cost * (1.0 + 1e-12) + 1e-18 => {
                    pose = tried;
                    (cost, normal, gradient) = better;
                    damping *= 0.1;
                }
                _ => damping = if damping == 0.0 { 1e-3 } else { damping * 10.0 },
            }
        }
        Some(pose)
    }
}

/// Huber's loss in units of half its square: that of a squared whitened residual with its weight.
fn loss(square: f64, weight: f64) -> f64 {
    if weight < 1.0 { square * weight * (2.0 - weight) } else { square }
}

/// Points on one line say nothing of a turn about it: it stays as it is.
fn determine_turn(normal: &mut Matrix6<f64>) {
    let turning = NO_TURN * normal.diagonal().fixed_rows::<3>(3).max();
    (3..6).for_each(|k| normal[(k, k)] += turning);
}

struct Rows {
    residual: Vector2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    by_camera: SMatrix<f64, 2, CAMERA_PARAMETERS>,
    by_point: SMatrix<f64, 2, 3>,
}

/// Normal equations of what is shared, with the poses at their minima and eliminated.
#[derive(Clone)]
pub(crate) struct Reduced {
    pub(crate) normal: DMatrix<f64>,
    pub(crate) gradient: DVector<f64>,
    /// Sum of the squared whitened residuals, of Huber's losses, and of the squares as they are weighted.
    pub(crate) squares: f64,
    pub(crate) loss: f64,
    pub(crate) weighted: f64,
    pub(crate) coordinates: usize,
    pub(crate) instants: usize,
    /// Of the poses' normal matrices together.
    pub(crate) log_determinant: f64,
}

impl Reduced {
    pub(crate) fn new(rows: usize) -> Self {
        Self {
            normal: DMatrix::zeros(rows, rows),
            gradient: DVector::zeros(rows),
            squares: 0.0,
            loss: 0.0,
            weighted: 0.0,
            coordinates: 0,
            instants: 0,
            log_determinant: 0.0,
        }
    }

    /// Adds an instant, whose pose is at its minimum. `factor` is that on the claimed covariances by which residuals count as
    /// long; infinite for none.
    pub(crate) fn add(
        &mut self,
        shared: &Shared,
        (sights, pose): (&[PointSight], &Isometry3<f64>),
        factor: f64,
    ) -> Option<()> {
        let mut own = Matrix6::zeros();
        let mut slope = Vector6::zeros();
        let mut coupling: OMatrix<f64, U6, Dyn> = OMatrix::<f64, U6, Dyn>::zeros(self.normal.nrows());
        for s in sights {
            let rows = shared.sight(s, pose)?;
            let square = rows.residual.norm_squared();
            let weight = noise_weight(square, factor);
            let by_pose = rows.by_pose.transpose() * weight;
            own += by_pose * rows.by_pose;
            slope += by_pose * rows.residual;
            self.add_sight(shared, s, &rows, (weight, &by_pose), &mut coupling);
            self.loss += loss(square, weight);
            self.squares += square;
            self.weighted += square * weight;
            self.coordinates += 2;
        }
        determine_turn(&mut own);
        let factored = own.cholesky()?;
        self.log_determinant += 2.0 * factored.l_dirty().diagonal().map(f64::ln).sum();
        let eliminated = factored.solve(&coupling);
        self.normal.gemm_tr(-1.0, &coupling, &eliminated, 1.0);
        self.gradient.gemv_tr(-1.0, &eliminated, &slope, 1.0);
        self.instants += 1;
        Some(())
    }

    /// Eliminates a change of the rows from `first` on that is these instants' own, with an information of `weight` on each. By how
    /// much that lowers the squares, and the logarithm of the determinant of the change's information.
    pub(crate) fn eliminate_changes(&mut self, first: usize, weight: f64) -> Option<(f64, f64)> {
        let n = self.normal.nrows() - first;
        let mut own = self.normal.view((first, first), (n, n)).into_owned();
        (0..n).for_each(|k| own[(k, k)] += weight);
        let coupling = self.normal.rows(first, n).into_owned();
        let factored = own.cholesky()?;
        let eliminated = factored.solve(&coupling);
        let slope = self.gradient.rows(first, n).into_owned();
        self.normal.gemm_tr(-1.0, &coupling, &eliminated, 1.0);
        self.gradient.gemv_tr(-1.0, &eliminated, &slope, 1.0);
        let log_determinant = 2.0 * factored.l_dirty().diagonal().map(f64::ln).sum();
        Some((slope.dot(&factored.solve(&slope)), log_determinant))
    }

    /// Adds other instants' equations.
    pub(crate) fn join(&mut self, other: &Self) {
        self.normal += &other.normal;
        self.gradient += &other.gradient;
        self.squares += other.squares;
        self.loss += other.loss;
        self.weighted += other.weighted;
        self.coordinates += other.coordinates;
        self.instants += other.instants;
        self.log_determinant += other.log_determinant;
    }

    fn add_sight(
        &mut self,
        shared: &Shared,
        s: &PointSight,
        rows: &Rows,
        (weight, pose): (f64, &SMatrix<f64, 6, 2>),
        coupling: &mut OMatrix<f64, U6, Dyn>,
    ) {
        // Columns of this sight: its camera's, its point's, its offset's.
        let mut by = SMatrix::<f64, 2, { CAMERA_PARAMETERS + 5 }>::zeros();
        by.fixed_columns_mut::<CAMERA_PARAMETERS>(0).copy_from(&rows.by_camera);
        by.fixed_columns_mut::<3>(CAMERA_PARAMETERS).copy_from(&rows.by_point);
        by.fixed_columns_mut::<2>(CAMERA_PARAMETERS + 3).copy_from(&s.whitener);
        let offset = s.camera * shared.points.len() + s.point;
        let blocks = [
            (true, 0, CAMERA_PARAMETERS, CAMERA_PARAMETERS * s.camera),
            (shared.free_points, CAMERA_PARAMETERS, 3, shared.first_point() + 3 * s.point),
            (shared.free_offsets, CAMERA_PARAMETERS + 3, 2, shared.first_offset() + 2 * offset),
        ];
        for (_, from, n, at) in blocks.iter().filter(|b| b.0) {
            let own = by.columns(*from, *n);
            let mut gradient = self.gradient.rows_mut(*at, *n);
            gradient.gemv_tr(weight, &own, &rows.residual, 1.0);
            let mut bound = coupling.columns_mut(*at, *n);
            bound.gemm(1.0, pose, &own, 1.0);
            for (_, from, m, other) in blocks.iter().filter(|b| b.0) {
                let mut block = self.normal.view_mut((*at, *other), (*n, *m));
                block.gemm_tr(weight, &own, &by.columns(*from, *m), 1.0);
            }
        }
    }
}

/// The pose after a small motion: position in world axes, turn about body axes.
pub(crate) fn moved(pose: &Isometry3<f64>, by: &Vector6<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + by.fixed_rows::<3>(0)),
        pose.rotation * UnitQuaternion::from_scaled_axis(Vector3::from(by.fixed_rows::<3>(3))),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cameras, normal, normal3};
    use mavsight_geometry::CameraChange;

    fn body() -> Vec<BodyMarker> {
        let corner = |k: usize| BodyMarker {
            name: String::new(),
            marker_in_body_m: Vector3::new((k % 2) as f64 * 0.4, (k / 2) as f64 * 0.3, (k % 3) as f64 * 0.1),
            radius_m: 0.02,
        };
        (0..4).map(corner).collect()
    }

    /// The state after a change of all that is shared.
    fn changed(shared: &Shared, by: &DVector<f64>) -> Shared {
        let mut out = shared.clone();
        for (k, camera) in out.cameras.iter_mut().enumerate() {
            let own: CameraChange = by.fixed_rows::<CAMERA_PARAMETERS>(CAMERA_PARAMETERS * k).into_owned();
            *camera = camera.moved(&own);
        }
        for (k, point) in out.points.iter_mut().enumerate() {
            point.marker_in_body_m += by.fixed_rows::<3>(shared.first_point() + 3 * k);
        }
        for (k, offset) in out.offsets_px.iter_mut().enumerate() {
            *offset += by.fixed_rows::<2>(shared.first_offset() + 2 * k);
        }
        out
    }

    /// The reduced gradient is the derivative of the least loss over the pose.
    #[test]
    fn the_reduced_gradient_is_the_numeric_derivative_of_the_settled_loss() {
        let mut shared = Shared::new(cameras().to_vec(), body());
        (shared.free_points, shared.free_offsets) = (true, true);
        shared.cameras[0].distortion.k1 = -0.2;
        let (mut seed, pose) = (3, moved(&Isometry3::translation(0.2, -0.3, 1.4), &Vector6::repeat(0.3)));
        let sights: Vec<PointSight> = (0..8)
            .map(|k| {
                let (camera, point) = (k / 4, k % 4);
                let centre = (pose * Point3::from(shared.points[point].marker_in_body_m)).coords;
                let seen = shared.cameras[camera].project_ball(&centre, 0.02).unwrap().pixel;
                let noise = Vector2::new(normal(&mut seed), normal(&mut seed));
                PointSight { camera, point, pixel: seen + noise, whitener: Matrix2::new(1.0, 0.0, 0.2, 1.5) }
            })
            .collect();
        // Some of the residuals are longer than Huber's bound.
        let factor = 0.5;
        let loss = |shared: &Shared| {
            let at = shared.settled(&sights, &pose, factor).unwrap();
            let mut out = Reduced::new(shared.rows());
            out.add(shared, (&sights, &at), factor).unwrap();
            out
        };
        let got = loss(&shared);
        for row in 0..shared.rows() {
            // A derivative by the camera's lens is that of a point: a ball's offset moves a little less.
            let step = if row % 16 >= 6 && row < 32 { 1e-3 } else { 1e-5 };
            let mut by = DVector::zeros(shared.rows());
            by[row] = step;
            let numeric =
                (loss(&changed(&shared, &by)).loss - loss(&changed(&shared, &-by)).loss) / (2.0 * step);
            let want = -0.5 * numeric;
            assert!(
                (got.gradient[row] - want).abs()
                    < 2e-3 * (want.abs() + 1e-3 * got.normal[(row, row)].sqrt() + 0.1),
                "row {row}: {} against {want}",
                got.gradient[row]
            );
        }
    }

    /// Six coordinates of a pose less, and a turn about a stick's own axis that stays where it is.
    #[test]
    fn a_stick_keeps_the_turn_about_itself_and_says_nothing_of_its_pose_twice() {
        let mut stick = body();
        stick.truncate(2);
        stick[1].marker_in_body_m = Vector3::new(0.5, 0.0, 0.0);
        let shared = Shared::new(cameras().to_vec(), stick);
        let mut seed = 8;
        let pose =
            moved(&Isometry3::translation(0.1, 0.1, 1.5), &Vector6::new(0.0, 0.0, 0.0, 0.7, 0.2, -0.4));
        let sights: Vec<PointSight> = (0..4)
            .map(|k| {
                let (camera, point) = (k / 2, k % 2);
                let centre = (pose * Point3::from(shared.points[point].marker_in_body_m)).coords;
                let pixel = shared.cameras[camera].project_ball(&centre, 0.02).unwrap().pixel;
                PointSight { camera, point, pixel, whitener: Matrix2::identity() }
            })
            .collect();
        let near = moved(&pose, &Vector6::from_fn(|_, _| 0.01 * normal3(&mut seed).x));
        let settled = shared.settled(&sights, &near, f64::INFINITY).unwrap();
        let ends = |p: &Isometry3<f64>| [p * Point3::origin(), p * Point3::new(0.5, 0.0, 0.0)];
        for (a, b) in ends(&settled).iter().zip(ends(&pose)) {
            assert!((a - b).norm() < 1e-6, "{a} {b}");
        }
        // Eight coordinates less five of the pose leave three that say something of the cameras.
        let mut reduced = Reduced::new(shared.rows());
        reduced.add(&shared, (&sights, &settled), f64::INFINITY).unwrap();
        let scale = reduced.normal.diagonal().map(|d| 1.0 / d.max(1e-12).sqrt());
        let scaled = DMatrix::from_fn(32, 32, |i, j| reduced.normal[(i, j)] * scale[i] * scale[j]);
        let values = scaled.symmetric_eigenvalues();
        assert_eq!(values.iter().filter(|v| **v > 1e-6).count(), 3, "{values}");
    }
}
