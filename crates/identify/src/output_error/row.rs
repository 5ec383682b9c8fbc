//! One whitened coordinate of a measurement.

use super::propagate::{SEEN, attitude};
use mavsight_geometry::{Isometry3, Vector3, world_from_level};
use nalgebra::{SMatrix, SVector};

/// One whitened coordinate: residual, derivatives of what was predicted, and where it belongs.
#[derive(Debug, Clone)]
pub(crate) struct Row<'a> {
    pub(crate) residual: f64,
    /// Derivative by the degrees of freedom of the pose.
    pub(crate) by_pose: SVector<f64, SEEN>,
    /// Those derivatives by degrees of freedom behind the pose that are not zero.
    pub(crate) by_rest: Vec<(usize, f64)>,
    /// Derivatives by free parameters, with the state held.
    pub(crate) by_parameter: Vec<(usize, f64)>,
    /// Its instant, counted in the series that it belongs to.
    pub(crate) instant: usize,
    /// Which of the coordinates that return at every instant; each has a variance factor.
    pub(crate) channel: usize,
    /// What each nuisance does to it, whitened; empty where none does.
    pub(crate) directions: &'a [f64],
    /// Where it is predicted in the image; the origin for what is no image.
    pub(crate) pixel: [f64; 2],
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

pub(crate) fn pose_of(y: &[f64]) -> Isometry3<f64> {
    Isometry3::from_parts(Vector3::new(y[0], y[1], y[2]).into(), world_from_level() * attitude(y))
}
