//! The centre of a ball to a small fraction of a pixel, with its covariance.
//!
//! A forward model of the image: a disc whose edge is blurred by a Gaussian (lens, aperture, pixel) covers a
//! fraction of each pixel; light mixes linearly there, ball and background; the sum is coded by the sRGB
//! curve, and colour differences are means over the pixels that they stand for. The ball has one colour times
//! a shading of first, second and fourth order, as a matt surface does ([`shading`]), and mirrors some light
//! of the lamps' own ([`gloss`]). What is behind comes from what is around ([`surroundings`]), with its
//! covariance: where an arm or an edge meets the ball, those pixels count for less, and the centre is worth
//! less. The parameters are found by generalised least squares (Gauss-Newton) on coded values, where the
//! noise of a sensor and the rounding to 8 bits are about uniform.
//!
//! Mixing in linear light matters: on coded values a ball seems up to a tenth too small or too large, more so
//! on the side where it is darker, which moves its centre.
//!
//! Samples that fit badly (an occluder) lose their weight (Tukey's biweight).
//!
//! Each step goes through five stages, each of which takes the ones before it: the [`layout`] of the samples
//! that the ball touches, the [`background`] behind it, the model [`linearized`] there, the samples
//! [`weighted`] by their covariance and by how far they are believed ([`trust`]), and the step solved from
//! them. Layout and background serve for as long as the ball has not moved. [`policy`] says what a film and a
//! still may take their time for.
//!
//! Samples, derivatives and their sums are held in single precision ([`lanes`]), places from the patch's
//! first pixel; what is solved for, and the equations for it, in double.

mod background;
mod cholesky;
mod constants;
mod curve;
mod edge;
mod fit;
mod glare;
mod gloss;
mod guess;
mod krige;
mod lanes;
mod layout;
mod linearized;
mod metric;
mod model;
mod normal;
mod outcome;
mod places;
mod policy;
mod robust;
mod samples;
mod shading;
mod stages;
mod trust;
mod weighted;

pub use constants::MODEL_STD;
pub(crate) use constants::{LEAST_RADIUS_PX, NOISE_STD};
pub(crate) use curve::encode_one;
pub(crate) use fit::Fitter;
pub(crate) use guess::{Followed, Start};
pub(crate) use outcome::CentreFit;
pub(crate) use policy::FitPolicy;
