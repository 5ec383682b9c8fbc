//! From motion and inputs to parameters: regressors, estimators, diagnostics.
//!
//! The model is equation 3 of Mulyanto, Nurhakim, Muhammad (2012) with both thrusts: each of C_X, C_Z and C_m is linear
//! in 1, alpha_u, alpha_l, q, delta_lon, T_u and T_l.

mod compensated;
mod dependence;
mod diagnostics;
mod error;
mod fit;
mod frequency_domain;
mod least_squares;
mod orthogonal;
mod recursive;
mod regressors;
mod robust_covariance;
mod row_errors;
mod structure;
#[cfg(test)]
mod testing;
mod total_least_squares;
mod verdict;

pub use dependence::{Dependence, independent_columns};
pub use diagnostics::{
    Agreement, Collinearity, agreement, autocorrelations, collinearity, correlations, press,
};
pub use error::IdentifyError;
pub use fit::{Combination, Estimator, Identification, OutputFit, Parameter, identify};
pub use frequency_domain::{Band, fourier_transform, frequency_domain};
pub use least_squares::{LeastSquares, least_squares, student_quantile_975, weighted_least_squares};
pub use recursive::RecursiveLeastSquares;
pub use regressors::{CoefficientTable, Column, Options, Output, coefficients};
pub use robust_covariance::Correlation;
pub use row_errors::total_least_squares_by_row;
pub use structure::{Structure, choose_structure, stepwise};
pub use total_least_squares::{TotalLeastSquares, independent_errors, total_least_squares};
