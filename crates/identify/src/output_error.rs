//! Output error: the parameters, and the start, with which the equations of motion pass nearest to what was
//! measured.
//!
//! The measurements are poses, or the images of markers themselves, and sensors beside them; nothing is differentiated or smoothed.
//! The flight is cut into segments that are flown each from its own start and held together by a penalty that
//! is tightened until it is a constraint (multiple shooting, Bock 1983), so that an unstable aircraft does
//! not carry a fit away. Sensitivities are the exact derivative of the integration. Weights follow from the
//! residuals by iterated relaxation (Maine & Iliff 1985; Jategaonkar 2015, chapter 4).
//!
//! Where residuals are not white, part of each channel's errors is taken to last for some time; its share and
//! the time are found by restricted maximum likelihood and weighed. What is still correlated then widens the
//! standard deviations (Morelli & Klein 1997). Output error takes the process itself as free of noise: wind, or a
//! model that lacks a term, is treated as such errors. Filter error estimates its noise.

mod adequacy;
mod ahead;
mod assemble;
mod colour;
mod comparison;
mod condense;
mod contradicted;
mod covariance;
mod determined;
mod disagreement;
mod expected;
mod filter;
mod fit;
mod fitter;
mod flight;
mod image;
mod innovations;
mod log_alone;
mod measure;
mod model;
mod options;
mod prediction;
mod propagate;
mod result;
mod row;
mod sensor;
mod shooting;
mod squares;
mod start;
mod structure;

pub use adequacy::Adequacy;
pub use ahead::{AheadErrors, PoseErrors, predict_ahead};
pub use comparison::Comparison;
pub(crate) use disagreement::chi_square_tail;
pub use disagreement::{Disagreement, Estimates, disagreement};
pub use expected::{ExpectedFit, ExpectedParameter, expected_fit};
pub use filter::filter_error;
pub use fit::output_error;
pub use flight::{
    FILTER_ERROR, FlightFitOptions, FlightFits, Images, InputClock, MotionFits, OUTPUT_ERROR,
    fitted_stretch_s,
};
pub use image::ImageMeasurements;
pub use measure::{LeftOut, Measurements, StateMeasurement};
pub use model::{FlightModel, ModelParameter};
pub use options::{InitialStates, NoiseModel, OutputErrorOptions};
pub use prediction::predict_poses;
pub use result::{DerivedQuantity, Extent, FittedParameter, OutputErrorFit, Prediction, SystematicErrors};
pub use sensor::SensedMeasurements;
pub use structure::{AddedTerm, AskedFor, NotAdded, ScoreTest, StructureSearch, TriedTerm, search_structure};

/// Measurements this near to each other are of one instant: what is lost where times are written in microseconds.
const SAME_TIME_S: f64 = 1e-6;

fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

#[cfg(test)]
mod tests;
