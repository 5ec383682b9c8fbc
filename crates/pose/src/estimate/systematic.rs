//! Errors that are the same in all frames of a flight: of cameras, of marker positions, of centres.

use crate::Rig;
use crate::reprojection::PointObservation;
use mavsight_geometry::{CAMERA_PARAMETERS, Vector2};
use nalgebra::{DMatrix, Matrix2, Matrix2x3, SMatrix};

/// What is not known of cameras, markers and centres, as columns of one standard deviation along independent
/// directions: those known together, then one for each coordinate of each marker in each camera.
#[derive(Debug, Clone)]
pub(super) struct SystematicErrors {
    cameras: usize,
    markers: usize,
    /// 16 rows a camera, 3 a marker, 2 for each marker in each camera (camera by camera).
    factor: DMatrix<f64>,
    /// Standard deviation of the centres' constant errors beyond those; with what overlap leaves open of them.
    pub(super) bias_px: Option<f64>,
    /// Whether the factor is what a fit to the same observations left.
    pub(super) is_fitted: bool,
}

impl SystematicErrors {
    pub(super) fn of_rig(rig: &Rig, markers: usize) -> Self {
        let cameras = rig.cameras.len();
        let rows = CAMERA_PARAMETERS * cameras;
        let known = rig.uncertainty.nrows() == rows && rig.uncertainty.iter().all(|x| x.is_finite());
        let columns = if known { rig.uncertainty.ncols() } else { 0 };
        let mut factor = DMatrix::zeros(rows + 3 * markers + 2 * cameras * markers, columns);
        factor.rows_mut(0, rows).copy_from(&rig.uncertainty.columns(0, columns));
        Self { cameras, markers, factor, bias_px: None, is_fitted: false }
    }

    /// With independent errors of the marker positions; `None` for another shape or what is not finite.
    pub(super) fn with_markers(mut self, uncertainty_m: &DMatrix<f64>) -> Option<Self> {
        if uncertainty_m.nrows() != 3 * self.markers || !uncertainty_m.iter().all(|x| x.is_finite()) {
            return None;
        }
        let at = (CAMERA_PARAMETERS * self.cameras, self.factor.ncols());
        self.factor = self.factor.resize_horizontally(at.1 + uncertainty_m.ncols(), 0.0);
        self.factor.view_mut(at, uncertainty_m.shape()).copy_from(uncertainty_m);
        Some(Self { is_fitted: false, ..self })
    }

    /// What a fit of all together has left, in place of all else; `None` for another shape or not finite.
    pub(super) fn fitted(self, factor: DMatrix<f64>) -> Option<Self> {
        let good = factor.nrows() == self.factor.nrows() && factor.iter().all(|x| x.is_finite());
        good.then_some(Self { is_fitted: true, factor, bias_px: None, ..self })
    }

    pub(super) fn columns(&self) -> usize {
        self.factor.ncols() + self.bias_px.map_or(0, |_| 2 * self.cameras * self.markers)
    }

    /// Hands on what each direction of error does to one whitened observation, of whose centre overlap leaves
    /// `hidden_px` open.
    pub(super) fn effects(
        &self,
        o: &PointObservation,
        by_camera: &SMatrix<f64, 2, CAMERA_PARAMETERS>,
        by_marker: &Matrix2x3<f64>,
        hidden_px: &Vector2<f64>,
        mut add: impl FnMut(usize, Vector2<f64>),
    ) {
        let from_markers = CAMERA_PARAMETERS * self.cameras;
        let own = 2 * (o.camera * self.markers + o.point);
        let from_centres = from_markers + 3 * self.markers + own;
        for (c, column) in self.factor.column_iter().enumerate() {
            let effect = by_camera * column.fixed_rows::<CAMERA_PARAMETERS>(CAMERA_PARAMETERS * o.camera)
                + by_marker * column.fixed_rows::<3>(from_markers + 3 * o.point)
                + o.whitener * column.fixed_rows::<2>(from_centres);
            if effect != Vector2::zeros() {
                add(c, effect);
            }
        }
        let Some(bias_px) = self.bias_px else { return };
        let spread = o.whitener * root_of_both(bias_px, hidden_px);
        (0..2).for_each(|k| add(self.factor.ncols() + own + k, spread.column(k).into()));
    }
}

/// Symmetric root of the covariance of an error alike in all directions and of one along a direction.
fn root_of_both(alike: f64, along: &Vector2<f64>) -> Matrix2<f64> {
    let length = along.norm();
    let unit = if length > 0.0 { along / length } else { Vector2::zeros() };
    Matrix2::identity() * alike + unit * unit.transpose() * (alike.hypot(length) - alike)
}
