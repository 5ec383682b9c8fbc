//! Flight models as files: forces, moments and further states of a rigid body, written as expressions with
//! units, and the exact derivatives that an estimator needs.
//!
//! [`Model::parse`] reads a file (schema 2, `docs/models.md`), [`Model::values`] gives the parameters of one
//! aircraft, [`Dynamics`] are its equations of motion. Frames and signs are those of CONVENTIONS.md: body x
//! forward, y right, z down; world z up.

mod document;
mod dynamics;
mod fastest;
mod fault;
mod graph;
mod lower;
mod model;
mod program;
mod read;
pub mod regression;
mod rigid_body;
mod sensor_terms;
mod shelf;
mod signal_terms;
mod start;
mod syntax;
mod unit;

pub use dynamics::{Dynamics, Evaluation, Slope};
pub use fastest::Fastest;
pub use fault::{Fault, ModelError, near};
pub use model::{Axis, Body, Derived, Equation, Freedom, FurtherState, Input, Model, Parameter, Sensor};
pub use rigid_body::{BODY_PARAMETERS, RIGID_STATES};
pub use shelf::SHELF;
pub use start::Start;
pub use unit::Unit;
