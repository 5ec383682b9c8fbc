//! Flights through the chain of running cameras.

mod batch;
mod cameras;
mod common;
mod faults;
mod paper_flight;
mod power;
mod recording;
