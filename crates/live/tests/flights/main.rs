//! Flights through the chain of running cameras.

mod batch;
mod cameras;
mod common;
mod paper_flight;
mod power;
mod recording;
