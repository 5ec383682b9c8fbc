//! Every reader and every estimator as a function of bytes, with small inputs and mutations of them.
//!
//! There is one list, [`TARGETS`], which the test of this crate, `examples/mutate.rs` and cargo-fuzz (`fuzz/`)
//! run alike. No other crate depends on this one.

#![allow(clippy::unwrap_used, clippy::panic)]

mod files;
mod mutator;
mod numbers;
mod run;
mod target;
mod targets;
mod text;

pub use mutator::Mutator;
pub use run::{Tally, attempt, input, remember_panics};
pub use target::{Kind, Outcome, Target};
pub use targets::TARGETS;
