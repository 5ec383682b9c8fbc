//! Files of other programs, both ways: cameras, trajectories, tracked points, tables.
//!
//! One file a format. Inside this crate everything keeps the house's conventions; what differs (a pixel's
//! origin, the order of a quaternion, which way the world's axes point) is turned here, where the file is
//! read or written. What a format cannot express is refused with a remedy, or said in [`Noted::notes`].

pub mod argus;
pub mod c3d;
mod c3d_parameters;
pub mod dltdv;
pub mod dltdv_points;
pub mod euroc;
pub mod frames;
pub mod kalibr;
pub mod marker_paths;
pub mod opencv;
#[cfg(feature = "parquet")]
pub mod parquet;
pub mod pixels;
pub mod poses;
pub mod rigs;
pub mod ros;
pub(crate) mod text;
pub mod trc;
pub mod tum;
mod yaml;

/// What a file held, and what a reader must know of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Noted<T> {
    /// The content.
    pub value: T,
    /// What was assumed or lost, in sentences.
    pub notes: Vec<String>,
}

impl<T> Noted<T> {
    /// Content with nothing to say about it.
    pub fn plain(value: T) -> Self {
        Self { value, notes: Vec::new() }
    }
}
