//! Normal equations of rigid bodies at unknown poses: of the cameras, the bodies' points and constant offsets
//! of centres, which all instants share. The poses are eliminated (Schur complement; Triggs et al. 2000,
//! section 6.1).

use crate::BodyMarker;
use crate::reprojection::{PointObservation, Scene, bound2, determine_turn, huber};
use mavsight_geometry::attitude::matrix_of;
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Isometry3, Matrix6, Vector2};
use nalgebra::{DMatrix, DVector, Dyn, OMatrix, SMatrix, U6, Vector6};

/// Steps with which a pose follows the cameras; from a near one two suffice.
const POSE_STEPS: usize = 20;
/// The drop of chi-square that ends the steps, a hundredth of a standard deviation squared.
const CONVERGED: f64 = 1e-4;

#[derive(Clone)]
pub(crate) struct Instant {
    pub(crate) observations: Vec<PointObservation>,
    pub(crate) world_from_body: Isometry3<f64>,
}

/// Rounds in which the lags of an instant and its pose follow each other; two or three converge.
const LAG_ROUNDS: usize = 8;

/// What all instants share. A change of it has 16 rows a camera, then 3 for each point, 2 for each point in each
/// camera (camera by camera) and one for the lag of each camera, the last three where they are free.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) cameras: Vec<Camera>,
    pub(crate) points: Vec<BodyMarker>,
    /// Constant errors of centres, camera by camera, point by point.
    pub(crate) offsets_px: Vec<Vector2<f64>>,
    /// Of each camera behind the common clock: of the instant at hand, where cameras are not in step.
    pub(crate) lags_s: Vec<f64>,
    pub(crate) free_points: bool,
    pub(crate) free_offsets: bool,
    pub(crate) free_lags: bool,
}

impl Shared {
    /// Bodies with exact points and no offsets.
    pub(crate) fn new(cameras: Vec<Camera>, points: Vec<BodyMarker>) -> Self {
        let offsets_px = vec![Vector2::zeros(); cameras.len() * points.len()];
        let lags_s = vec![0.0; cameras.len()];
        let (free_points, free_offsets, free_lags) = (false, false, false);
        Self { cameras, points, offsets_px, lags_s, free_points, free_offsets, free_lags }
    }

    pub(crate) fn first_point(&self) -> usize {
        CAMERA_PARAMETERS * self.cameras.len()
    }

    pub(crate) fn first_offset(&self) -> usize {
        self.first_point() + if self.free_points { 3 * self.points.len() } else { 0 }
    }

    pub(crate) fn first_lag(&self) -> usize {
        self.first_offset() + if self.free_offsets { 2 * self.offsets_px.len() } else { 0 }
    }

    pub(crate) fn rows(&self) -> usize {
        self.first_lag() + if self.free_lags { self.lags_s.len() } else { 0 }
    }

    fn offset(&self, o: &PointObservation) -> usize {
        o.camera * self.points.len() + o.point
    }

    fn scene(&self) -> Scene<'_> {
        Scene { cameras: &self.cameras, points: &self.points }
    }

    fn corrected(&self, o: &PointObservation) -> PointObservation {
        let late_px = o.velocity_px_s * self.lags_s[o.camera];
        PointObservation { pixel: o.pixel - self.offsets_px[self.offset(o)] - late_px, ..*o }
    }

    /// Measured less predicted pixel; `None` where the point is not in view.
    pub(crate) fn residual_px(&self, o: &PointObservation, pose: &Isometry3<f64>) -> Option<Vector2<f64>> {
        Some(self.scene().at(&self.corrected(o), pose).ok()?.residual_px)
    }

    /// The pose of least loss under these cameras, from one near. `factor` scales the stated covariances to
    /// those that decide which residuals are long; infinite for none. `None` where a point leaves the view or
    /// the pose is not determined.
    pub(crate) fn best_pose(
        &self,
        observations: &[PointObservation],
        near: &Isometry3<f64>,
        factor: f64,
    ) -> Option<Isometry3<f64>> {
        let own: Vec<_> = observations.iter().map(|o| self.corrected(o)).collect();
        let converged = CONVERGED * factor.min(1.0);
        let fit = self.scene().descend(&own, near, bound2(factor), converged, POSE_STEPS).ok()?;
        Some(fit.world_from_body)
    }

    /// The equations of an instant whose cameras are not in step: their lags, of a standard deviation, are brought to
    /// their minimum together with the pose, and are eliminated like it.
    pub(crate) fn out_of_step(
        &mut self,
        Instant { observations, world_from_body }: &Instant,
        std_s: f64,
        factor: f64,
    ) -> Option<OutOfStep> {
        let scale = if factor.is_finite() { factor } else { 1.0 };
        let (weight, first, n) = (scale / (std_s * std_s), self.first_lag(), self.lags_s.len());
        let mut pose = *world_from_body;
        let mut round = 0;
        loop {
            pose = self.best_pose(observations, &pose, factor)?;
            let mut own = Reduced::new(self.rows());
            own.add(self, observations, &pose, factor)?;
            let lags = DVector::from_column_slice(&self.lags_s);
            let mut slope = own.gradient.rows_mut(first, n);
            slope -= &lags * weight;
            let mut information = own.normal.view((first, first), (n, n)).into_owned();
            (0..n).for_each(|k| information[(k, k)] += weight);
            let covariance = information.cholesky()?.inverse();
            let step = &covariance * own.gradient.rows(first, n);
            round += 1;
            if round == LAG_ROUNDS || step.amax() < 1e-3 * covariance.diagonal().max().sqrt() {
                own.loss += weight * lags.norm_squared();
                own.eliminate_changes(first, weight)?;
                // What the last step, which is not taken, would have gained.
                own.loss -= own.gain;
                return Some(OutOfStep { reduced: own, pose });
            }
            self.lags_s.iter_mut().zip(step.iter()).for_each(|(lag, step)| *lag += step);
        }
    }
}

/// An instant whose cameras are not in step, under lags that are in [`Shared::lags_s`].
pub(crate) struct OutOfStep {
    pub(crate) reduced: Reduced,
    pub(crate) pose: Isometry3<f64>,
}

/// Normal equations of what is shared, with the poses at their minima and eliminated.
#[derive(Clone, Default)]
pub(crate) struct Reduced {
    pub(crate) normal: DMatrix<f64>,
    pub(crate) gradient: DVector<f64>,
    /// Sum of the squared whitened residuals, of Huber's losses, and of the squares as they are weighted.
    pub(crate) squares: f64,
    pub(crate) loss: f64,
    pub(crate) weighted: f64,
    pub(crate) coordinates: usize,
    pub(crate) instants: usize,
    /// Of the normal matrices of what was eliminated, changes over their prior information.
    pub(crate) log_determinant: f64,
    /// Drop of the weighted squares by eliminated changes.
    pub(crate) gain: f64,
}

impl Reduced {
    pub(crate) fn new(rows: usize) -> Self {
        Self { normal: DMatrix::zeros(rows, rows), gradient: DVector::zeros(rows), ..Default::default() }
    }

    /// Adds an instant, whose pose is at its minimum; `factor` as in [`Shared::best_pose`].
    pub(crate) fn add(
        &mut self,
        shared: &Shared,
        observations: &[PointObservation],
        pose: &Isometry3<f64>,
        factor: f64,
    ) -> Option<()> {
        let mut own = Matrix6::zeros();
        let mut slope = Vector6::zeros();
        let mut coupling: OMatrix<f64, U6, Dyn> = OMatrix::<f64, U6, Dyn>::zeros(self.normal.nrows());
        for o in observations {
            let at = shared.scene().at(&shared.corrected(o), pose).ok()?;
            let square = at.whitened.norm_squared();
            let (weight, loss) = huber(square, bound2(factor));
            let weighted = at.by_pose.transpose() * weight;
            own += weighted * at.by_pose;
            slope += weighted * at.whitened;
            // Columns of this observation: its camera's, its point's, its offset's, its lag's.
            let mut by = SMatrix::<f64, 2, { CAMERA_PARAMETERS + 6 }>::zeros();
            let by_camera = shared.cameras[o.camera].d_pixel_d_camera(&at.centre_in_world).ok()?;
            let by_point = at.projection.d_pixel_d_point_in_world * matrix_of(&pose.rotation);
            by.fixed_columns_mut::<CAMERA_PARAMETERS>(0).copy_from(&(o.whitener * by_camera));
            by.fixed_columns_mut::<3>(CAMERA_PARAMETERS).copy_from(&(o.whitener * by_point));
            by.fixed_columns_mut::<2>(CAMERA_PARAMETERS + 3).copy_from(&o.whitener);
            by.set_column(CAMERA_PARAMETERS + 5, &(o.whitener * o.velocity_px_s));
            let blocks = [
                (true, 0, CAMERA_PARAMETERS, CAMERA_PARAMETERS * o.camera),
                (shared.free_points, CAMERA_PARAMETERS, 3, shared.first_point() + 3 * o.point),
                (shared.free_offsets, CAMERA_PARAMETERS + 3, 2, shared.first_offset() + 2 * shared.offset(o)),
                (shared.free_lags, CAMERA_PARAMETERS + 5, 1, shared.first_lag() + o.camera),
            ];
            for (_, from, n, row) in blocks.iter().filter(|b| b.0) {
                let block = by.columns(*from, *n);
                self.gradient.rows_mut(*row, *n).gemv_tr(weight, &block, &at.whitened, 1.0);
                coupling.columns_mut(*row, *n).gemm(1.0, &weighted, &block, 1.0);
                for (_, from, m, column) in blocks.iter().filter(|b| b.0) {
                    let mut target = self.normal.view_mut((*row, *column), (*n, *m));
                    target.gemm_tr(weight, &block, &by.columns(*from, *m), 1.0);
                }
            }
            self.loss += loss;
            self.squares += square;
            self.weighted += square * weight;
            self.coordinates += 2;
        }
        determine_turn(&mut own);
        let factored = own.cholesky()?;
        self.log_determinant += factored.ln_determinant();
        let eliminated = factored.solve(&coupling);
        self.normal.gemm_tr(-1.0, &coupling, &eliminated, 1.0);
        self.gradient.gemv_tr(-1.0, &eliminated, &slope, 1.0);
        self.instants += 1;
        Some(())
    }

    /// Eliminates a change of these instants' rows from `first` on, with the information `weight` on each.
    pub(crate) fn eliminate_changes(&mut self, first: usize, weight: f64) -> Option<()> {
        let n = self.normal.nrows() - first;
        let mut own = self.normal.view((first, first), (n, n)).into_owned();
        (0..n).for_each(|k| own[(k, k)] += weight);
        let coupling = self.normal.rows(first, n).into_owned();
        let factored = own.cholesky()?;
        let eliminated = factored.solve(&coupling);
        let slope = self.gradient.rows(first, n).into_owned();
        self.normal.gemm_tr(-1.0, &coupling, &eliminated, 1.0);
        self.gradient.gemv_tr(-1.0, &eliminated, &slope, 1.0);
        self.gain += slope.dot(&factored.solve(&slope));
        self.log_determinant += factored.ln_determinant() - n as f64 * weight.ln();
        Some(())
    }

    pub(crate) fn join(&mut self, other: &Self) {
        self.normal += &other.normal;
        self.gradient += &other.gradient;
        self.squares += other.squares;
        self.loss += other.loss;
        self.weighted += other.weighted;
        self.coordinates += other.coordinates;
        self.instants += other.instants;
        self.log_determinant += other.log_determinant;
        self.gain += other.gain;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reprojection::moved;
    use crate::testing::cameras;
    use mavsight_geometry::{CameraChange, Matrix2, Point3, Vector3};
    use mavsight_random::Random;

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
    fn the_reduced_gradient_is_the_numeric_derivative_of_the_least_loss() {
        let mut shared = Shared::new(cameras().to_vec(), body());
        (shared.free_points, shared.free_offsets) = (true, true);
        shared.cameras[0].distortion.k1 = -0.2;
        let (mut random, pose) =
            (Random::new(3, 0), moved(&Isometry3::translation(0.2, -0.3, 1.4), &Vector6::repeat(0.3)));
        let observations: Vec<PointObservation> = (0..8)
            .map(|k| {
                let (camera, point) = (k / 4, k % 4);
                let centre = (pose * Point3::from(shared.points[point].marker_in_body_m)).coords;
                let seen = shared.cameras[camera].project_ball(&centre, 0.02).unwrap().pixel;
                let noise = Vector2::from(random.normals());
                let covariance_px2 = Matrix2::identity();
                let whitener = Matrix2::new(1.0, 0.0, 0.2, 1.5);
                let velocity_px_s = Vector2::zeros();
                PointObservation {
                    camera,
                    point,
                    pixel: seen + noise,
                    covariance_px2,
                    whitener,
                    velocity_px_s,
                }
            })
            .collect();
        // Some of the residuals are longer than Huber's bound.
        let factor = 0.5;
        let loss = |shared: &Shared| {
            // Again and again: what is left at a usual end shows in the numeric derivative.
            let follow = |at, _| shared.best_pose(&observations, &at, factor).unwrap();
            let at = (0..8).fold(pose, follow);
            let mut out = Reduced::new(shared.rows());
            out.add(shared, &observations, &at, factor).unwrap();
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

    /// A stick determines five coordinates of its pose; the turn about itself keeps its value.
    #[test]
    fn a_stick_keeps_the_turn_about_itself_and_determines_five_coordinates_of_its_pose() {
        let mut stick = body();
        stick.truncate(2);
        stick[1].marker_in_body_m = Vector3::new(0.5, 0.0, 0.0);
        let shared = Shared::new(cameras().to_vec(), stick);
        let mut random = Random::new(8, 0);
        let pose =
            moved(&Isometry3::translation(0.1, 0.1, 1.5), &Vector6::new(0.0, 0.0, 0.0, 0.7, 0.2, -0.4));
        let observations: Vec<PointObservation> = (0..4)
            .map(|k| {
                let (camera, point) = (k / 2, k % 2);
                let centre = (pose * Point3::from(shared.points[point].marker_in_body_m)).coords;
                let pixel = shared.cameras[camera].project_ball(&centre, 0.02).unwrap().pixel;
                PointObservation::new(camera, point, pixel, Matrix2::identity()).unwrap()
            })
            .collect();
        let near = moved(&pose, &Vector6::from_fn(|_, _| 0.01 * Vector3::from(random.normals()).x));
        let found = shared.best_pose(&observations, &near, f64::INFINITY).unwrap();
        let ends = |p: &Isometry3<f64>| [p * Point3::origin(), p * Point3::new(0.5, 0.0, 0.0)];
        for (a, b) in ends(&found).iter().zip(ends(&pose)) {
            assert!((a - b).norm() < 1e-6, "{a} {b}");
        }
        // Eight coordinates less five of the pose leave three that say something of the cameras.
        let mut reduced = Reduced::new(shared.rows());
        reduced.add(&shared, &observations, &found, f64::INFINITY).unwrap();
        let scale = reduced.normal.diagonal().map(|d| 1.0 / d.max(1e-12).sqrt());
        let scaled = DMatrix::from_fn(32, 32, |i, j| reduced.normal[(i, j)] * scale[i] * scale[j]);
        let values = scaled.symmetric_eigenvalues();
        assert_eq!(values.iter().filter(|v| **v > 1e-6).count(), 3, "{values}");
    }
}
