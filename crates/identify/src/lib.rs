//! From motion and inputs to parameters: regressors, estimators, diagnostics.
//!
//! The model is the vehicle's ([`mavsight_model::Model`]); equation error regresses on what its
//! `[[equation]]` sections name, or those of an [`EquationFile`]. That of the paper's helicopter has equation
//! 3 of Mulyanto, Nurhakim, Muhammad (2012) with both thrusts: each of C_X, C_Z and C_m is linear in 1,
//! alpha_u, alpha_l, q, delta_lon, T_u and T_l; and C_Y, C_l and C_n likewise.

mod blocks;
mod coloured;
mod dependence;
mod diagnostics;
mod error;
mod fit;
mod frequency_domain;
mod further;
mod inverse;
mod lag;
mod least_squares;
mod lowpass;
mod model;
mod noise;
mod orthogonal;
pub mod output_error;
mod passed;
mod pooled;
mod recursive;
mod regression;
mod regressors;
mod robust_covariance;
mod several_flights;
mod signals;
mod structure;
mod table;
#[cfg(test)]
mod testing;
mod total_least_squares;
mod verdict;

pub use dependence::{Dependence, DependentColumn, independent_columns};
pub use diagnostics::{
    Agreement, Collinearity, agreement, autocorrelations, collinearity, correlations, press,
};
pub use error::IdentifyError;
pub use fit::{Combination, Diagnostics, Estimator, FitOptions, Identification, OutputFit, Parameter};
pub use frequency_domain::{Band, frequency_domain};
pub use lag::{Clocks, Lag, delayed, estimate_lag, far_lag};
pub use least_squares::{LeastSquares, least_squares, student_quantile_975, weighted_least_squares};
pub use mavsight_model::regression::RegressionError;
pub use model::{EquationFile, Measured, OutputEquation, OutputEquations, Scale, When};
pub use noise::SignalErrors;
pub use pooled::{FlightEstimate, Pooled, pooled};
pub use recursive::RecursiveLeastSquares;
pub use regression::{identify, identify_with};
pub use regressors::{Bandwidth, Options, coefficients};
pub use robust_covariance::Correlation;
pub use several_flights::{FittedFlight, PooledParameter, pooled_parameters};
pub use structure::{Structure, StructureStep, choose_structure, stepwise};
pub use table::{CoefficientTable, Column, Fixed, Output, column_words};
pub use total_least_squares::{TotalLeastSquares, total_least_squares, total_least_squares_by_row};
