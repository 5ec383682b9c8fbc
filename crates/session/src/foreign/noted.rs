//! What formats do not say, and what is said of them.

use super::pixels::PixelOrigin;
use mavsight_geometry::ImageSize;

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

/// What a file of cameras does not say.
#[derive(Debug, Clone, Default)]
pub struct CameraOptions {
    /// Names of the cameras; the file's own, or `cam1`, `cam2`, ... where empty.
    pub names: Vec<String>,
    /// Image size: one for all cameras or one each.
    pub sizes: Vec<ImageSize>,
    /// Where pixels are counted from; by the file where left out.
    pub origin: Option<PixelOrigin>,
    /// Whether skew that a format has no place for is dropped.
    pub drop_skew: bool,
}

/// The name of a number, or one made of a stem and the number from 1.
pub(super) fn numbered(names: &[String], k: usize, stem: &str) -> String {
    names.get(k).cloned().unwrap_or_else(|| format!("{stem}{}", k + 1))
}
