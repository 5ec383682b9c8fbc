//! Errors that are the same in all frames of a flight: of cameras, of marker positions, of centres.

use crate::Rig;
use mavsight_geometry::{CAMERA_PARAMETERS, Matrix2, Vector2, Vector3};
use nalgebra::{DMatrix, Matrix2x3, SMatrix};

/// What is not known of cameras, markers and centres, as columns of one standard deviation along independent directions: first
/// those of the rig, then those of the markers, then one for each coordinate of each marker in each camera.
#[derive(Debug, Clone)]
pub(super) struct Lasting {
    markers: usize,
    /// 16 rows a camera.
    rig: DMatrix<f64>,
    /// 3 rows a marker: by how much the marker is off its estimated place along each column of all.
    shift_m: DMatrix<f64>,
    /// Columns of `shift_m` that are not zero.
    shifting: Vec<bool>,
    own: Own,
    bias_px: f64,
}

/// What is known of the markers, before it is put together.
#[derive(Debug, Clone)]
struct Own {
    uncertainty_m: DMatrix<f64>,
    by_rig_m: DMatrix<f64>,
    by_centres_m: DMatrix<f64>,
}

impl Lasting {
    /// Errors of the rig alone.
    pub(super) fn of_rig(rig: &Rig, markers: usize) -> Self {
        let rows = CAMERA_PARAMETERS * rig.cameras.len();
        let known = rig.uncertainty.nrows() == rows && rig.uncertainty.iter().all(|x| x.is_finite());
        let factor = if known { rig.uncertainty.clone() } else { DMatrix::zeros(rows, 0) };
        let own = Own {
            uncertainty_m: DMatrix::zeros(3 * markers, 0),
            by_rig_m: DMatrix::zeros(3 * markers, factor.ncols()),
            by_centres_m: DMatrix::zeros(3 * markers, 2 * markers * rig.cameras.len()),
        };
        let shifting = vec![false; factor.ncols()];
        let shift_m = DMatrix::zeros(3 * markers, factor.ncols());
        Self { markers, rig: factor, shift_m, shifting, own, bias_px: 0.0 }
    }

    /// With errors of the marker positions; `None` for factors of another shape or not finite.
    pub(super) fn with_markers(mut self, uncertainty_m: &DMatrix<f64>) -> Option<Self> {
        let good = uncertainty_m.nrows() == 3 * self.markers && uncertainty_m.iter().all(|x| x.is_finite());
        self.own.uncertainty_m = good.then(|| uncertainty_m.clone())?;
        Some(self.put_together())
    }

    /// With what the errors of the rig, and of centres by a pixel, have done to the marker positions.
    pub(super) fn with_markers_by(mut self, rig_m: &DMatrix<f64>, centres_m: &DMatrix<f64>) -> Option<Self> {
        let same =
            rig_m.shape() == self.own.by_rig_m.shape() && centres_m.shape() == self.own.by_centres_m.shape();
        let good = same && rig_m.iter().chain(centres_m.iter()).all(|x| x.is_finite());
        good.then(|| (self.own.by_rig_m, self.own.by_centres_m) = (rig_m.clone(), centres_m.clone()))?;
        Some(self.put_together())
    }

    /// With centres that are off by an amount that stays.
    pub(super) fn with_bias_px(mut self, bias_px: f64) -> Self {
        self.bias_px = bias_px;
        self.put_together()
    }

    fn put_together(mut self) -> Self {
        let (own, rows) = (&self.own, 3 * self.markers);
        let (rig, markers) = (self.rig.ncols(), own.uncertainty_m.ncols());
        let centres = if self.bias_px > 0.0 { own.by_centres_m.ncols() } else { 0 };
        let mut shift_m = DMatrix::zeros(rows, rig + markers + centres);
        // A marker that an error has moved in the file is off the other way.
        shift_m.columns_mut(0, rig).copy_from(&-&own.by_rig_m);
        shift_m.columns_mut(rig, markers).copy_from(&own.uncertainty_m);
        let by_centres = own.by_centres_m.columns(0, centres) * -self.bias_px;
        shift_m.columns_mut(rig + markers, centres).copy_from(&by_centres);
        self.shifting = shift_m.column_iter().map(|c| c.amax() > 0.0).collect();
        self.shift_m = shift_m;
        self
    }

    pub(super) fn columns(&self) -> usize {
        self.shift_m.ncols()
    }

    /// Hands on what each direction of error does to one whitened sight.
    pub(super) fn effects(
        &self,
        (camera, marker): (usize, usize),
        by_camera: &SMatrix<f64, 2, CAMERA_PARAMETERS>,
        by_marker: &Matrix2x3<f64>,
        whitener: &Matrix2<f64>,
        add: &mut impl FnMut(usize, Vector2<f64>),
    ) {
        let from_rig = self.rig.ncols();
        let centres = from_rig + self.own.uncertainty_m.ncols();
        let own = centres + 2 * (camera * self.markers + marker);
        let shift_m =
            |c: usize| -> Vector3<f64> { self.shift_m.fixed_view::<3, 1>(3 * marker, c).into_owned() };
        for c in 0..self.columns() {
            let mut effect = Vector2::zeros();
            if c < from_rig {
                let at = CAMERA_PARAMETERS * camera;
                effect += by_camera * self.rig.fixed_view::<CAMERA_PARAMETERS, 1>(at, c);
            }
            if self.shifting[c] {
                effect += by_marker * shift_m(c);
            }
            if c == own || c == own + 1 {
                effect += whitener.column(c - own) * self.bias_px;
            }
            if effect != Vector2::zeros() {
                add(c, effect);
            }
        }
    }
}
