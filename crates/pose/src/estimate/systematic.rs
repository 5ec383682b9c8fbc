//! Errors that are the same in all frames of a flight: of cameras, of marker positions, of centres.

use crate::Rig;
use mavsight_geometry::{CAMERA_PARAMETERS, Matrix2, Vector2};
use nalgebra::{DMatrix, Matrix2x3, SMatrix};

/// What is not known of cameras, markers and centres, as columns of one standard deviation along
/// independent directions: first those that are known together, then one for each coordinate of each
/// marker in each camera.
#[derive(Debug, Clone)]
pub(super) struct SystematicErrors {
    cameras: usize,
    markers: usize,
    /// 16 rows a camera, 3 a marker, 2 for each marker in each camera (camera by camera).
    factor: DMatrix<f64>,
    /// Columns that say something of markers, and of centres.
    of_markers: Vec<bool>,
    of_centres: Vec<bool>,
    pub(super) bias_px: f64,
    /// Whether the factor is what a fit to the same observations left.
    pub(super) is_fitted: bool,
}

impl SystematicErrors {
    /// Errors of the rig alone.
    pub(super) fn of_rig(rig: &Rig, markers: usize) -> Self {
        let cameras = rig.cameras.len();
        let rows = CAMERA_PARAMETERS * cameras;
        let known = rig.uncertainty.nrows() == rows && rig.uncertainty.iter().all(|x| x.is_finite());
        let columns = if known { rig.uncertainty.ncols() } else { 0 };
        let mut factor = DMatrix::zeros(rows + 3 * markers + 2 * cameras * markers, columns);
        factor.rows_mut(0, rows).copy_from(&rig.uncertainty.columns(0, columns));
        Self::of_factor(factor, (cameras, markers))
    }

    fn of_factor(factor: DMatrix<f64>, (cameras, markers): (usize, usize)) -> Self {
        let any = |from: usize, n: usize| {
            factor.column_iter().map(|c| c.rows(from, n).amax() > 0.0).collect::<Vec<bool>>()
        };
        let at = CAMERA_PARAMETERS * cameras;
        let of_markers = if markers > 0 { any(at, 3 * markers) } else { vec![false; factor.ncols()] };
        let centres = 2 * cameras * markers;
        let of_centres =
            if centres > 0 { any(at + 3 * markers, centres) } else { vec![false; factor.ncols()] };
        Self { cameras, markers, factor, of_markers, of_centres, bias_px: 0.0, is_fitted: false }
    }

    /// With errors of the marker positions that have nothing to do with the others; `None` for a factor
    /// of another shape or not finite.
    pub(super) fn with_markers(self, uncertainty_m: &DMatrix<f64>) -> Option<Self> {
        if uncertainty_m.nrows() != 3 * self.markers || !uncertainty_m.iter().all(|x| x.is_finite()) {
            return None;
        }
        let (rows, columns) = self.factor.shape();
        let mut factor = self.factor.resize(rows, columns + uncertainty_m.ncols(), 0.0);
        factor
            .view_mut((CAMERA_PARAMETERS * self.cameras, columns), uncertainty_m.shape())
            .copy_from(uncertainty_m);
        let bias_px = self.bias_px;
        Some(Self::of_factor(factor, (self.cameras, self.markers)).with_bias_px(bias_px))
    }

    /// What a fit of cameras, markers and centres together has left, in place of all else; `None` for a
    /// factor of another shape or not finite.
    pub(super) fn fitted(self, factor: &DMatrix<f64>) -> Option<Self> {
        let good = factor.nrows() == self.factor.nrows() && factor.iter().all(|x| x.is_finite());
        let own = (self.cameras, self.markers);
        good.then(|| Self { is_fitted: true, ..Self::of_factor(factor.clone(), own) })
    }

    /// With centres that are off by a constant amount.
    pub(super) fn with_bias_px(mut self, bias_px: f64) -> Self {
        self.bias_px = bias_px;
        self
    }

    pub(super) fn columns(&self) -> usize {
        self.factor.ncols() + if self.bias_px > 0.0 { 2 * self.cameras * self.markers } else { 0 }
    }

    /// Hands on what each direction of error does to one whitened observation.
    pub(super) fn effects(
        &self,
        (camera, marker): (usize, usize),
        by_camera: &SMatrix<f64, 2, CAMERA_PARAMETERS>,
        by_marker: &Matrix2x3<f64>,
        whitener: &Matrix2<f64>,
        add: &mut impl FnMut(usize, Vector2<f64>),
    ) {
        let from_markers = CAMERA_PARAMETERS * self.cameras;
        let own = 2 * (camera * self.markers + marker);
        let from_centres = from_markers + 3 * self.markers + own;
        for c in 0..self.factor.ncols() {
            let at = CAMERA_PARAMETERS * camera;
            let mut effect = by_camera * self.factor.fixed_view::<CAMERA_PARAMETERS, 1>(at, c);
            if self.of_markers[c] {
                effect += by_marker * self.factor.fixed_view::<3, 1>(from_markers + 3 * marker, c);
            }
            if self.of_centres[c] {
                effect += whitener * self.factor.fixed_view::<2, 1>(from_centres, c);
            }
            if effect != Vector2::zeros() {
                add(c, effect);
            }
        }
        if self.bias_px > 0.0 {
            (0..2).for_each(|k| add(self.factor.ncols() + own + k, whitener.column(k) * self.bias_px));
        }
    }
}
