//! One whitened coordinate of a measurement.

use super::propagate::{SEEN, attitude};
use mavsight_flight::StateVector;
use mavsight_geometry::{Isometry3, Vector3, world_from_level};
use nalgebra::{RowSVector, SMatrix, SVector};

/// One whitened coordinate: residual, its derivative by the seen part of the state, and where it belongs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) residual: f64,
    pub(crate) jacobian: SVector<f64, SEEN>,
    /// Which of the coordinates that return at every instant; each has a variance factor.
    pub(crate) channel: usize,
    /// What each nuisance does to it, whitened; empty where none does.
    pub(crate) directions: &'a [f64],
    /// Where it is predicted in the image; the origin for what is no image.
    pub(crate) pixel: [f64; 2],
}

impl Row<'_> {
    /// A coordinate of no image that no nuisance moves; `by` is its derivative by degrees of freedom of the
    /// state from the `first` on.
    pub(crate) fn new<const N: usize>(
        residual: f64,
        by: RowSVector<f64, N>,
        first: usize,
        channel: usize,
    ) -> Self {
        let mut jacobian = SVector::<f64, SEEN>::zeros();
        jacobian.fixed_rows_mut::<N>(first).copy_from(&by.transpose());
        Self { residual, jacobian, channel, directions: &[], pixel: [0.0; 2] }
    }
}

/// L⁻¹ with L Lᵀ the covariance; none where it is not positive definite.
pub(crate) fn whitener<const N: usize>(covariance: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>>
where
    nalgebra::Const<N>: nalgebra::DimMin<nalgebra::Const<N>, Output = nalgebra::Const<N>>,
{
    let l = Some(covariance).filter(|c| c.iter().all(|v| v.is_finite()))?.cholesky()?.l();
    let inverse = l.solve_lower_triangular(&SMatrix::<f64, N, N>::identity())?;
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// The pose in the world of a state.
pub(crate) fn pose_of(y: &StateVector) -> Isometry3<f64> {
    Isometry3::from_parts(Vector3::new(y[0], y[1], y[2]).into(), world_from_level() * attitude(y))
}
